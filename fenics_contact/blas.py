"""The BLAS that PETSc calls: which kernels it runs, which it could run, and how many threads each process may have.

OpenBLAS takes plain kernels without a word where it does not know the processor, up to four times as slow as those for
an older one of its kind. It reads OPENBLAS_CORETYPE once, when it is loaded: NumPy of a distribution loads it too. As a
script this says which core type to set, if any:

    python3 -S -I fenics_contact/blas.py
"""

import ctypes
import os
import re
import subprocess
import sys
from pathlib import Path

LIBRARY = "libblas.so.3"
PLAIN = ("Prescott", "Core2", "Nehalem", "Generic")  # what OpenBLAS falls back to
# flags of a processor that runs a core type's kernels, the fastest first
NEEDS = {
    "SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl", "avx512cd"},
    "Haswell": {"avx2", "fma"},
}
RANKS = ("OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS", "PMIX_LOCAL_SIZE")  # on this machine, as mpirun tells them
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def core() -> str:
    """OpenBLAS' name of the processor whose kernels it runs; loads it. "" where there is no OpenBLAS that says."""
    try:
        name = ctypes.CDLL(LIBRARY).openblas_get_corename
    except (OSError, AttributeError):
        return ""
    name.restype = ctypes.c_char_p
    return str(name().decode())


def better(taken: str, flags: set[str]) -> str:
    """The core type for a processor of these flags where OpenBLAS has fallen back to plain kernels, else ""."""
    return next((name for name, needed in NEEDS.items() if needed <= flags), "") if taken in PLAIN else ""


def processor() -> set[str]:
    """Flags of this machine's processor."""
    try:
        found = re.search(r"^flags\s*:(.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    except OSError:
        return set()
    return set(found[1].split()) if found else set()


def ranks() -> int:
    """Processes that mpirun has begun on this machine."""
    return max(int(os.environ.get(name, "1")) for name in RANKS)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def is_loaded() -> bool:
    """Whether this process holds the BLAS already, not one that NumPy brought along for itself."""
    try:
        held = Path("/proc/self/maps").read_text()
    except OSError:
        return True  # nobody knows: nothing is changed
    return re.search(r"^(?!.*\.libs/).*/lib(open)?blas[^/]*\.so", held, re.M) is not None


def prepare() -> None:
    """Before the BLAS is loaded: its core type and its threads, where the environment does not state them."""
    if is_loaded():
        return
    if ranks() > 1 and not any(name in os.environ for name in THREADS):
        os.environ["OMP_NUM_THREADS"] = str(max(1, cores() // ranks()))
    if "OPENBLAS_CORETYPE" not in os.environ and NEEDS["Haswell"] <= processor():
        found = subprocess.run([sys.executable, "-S", "-I", __file__], capture_output=True, text=True).stdout.strip()
        if found:
            os.environ["OPENBLAS_CORETYPE"] = found


def told() -> str:
    """The BLAS in use, for summaries, and what would be faster."""
    if not (taken := core()):
        return (
            f"no OpenBLAS: {LIBRARY} is another one, many times as slow if it is the reference BLAS (libopenblas0-pthread)"
        )
    said, faster = f"OpenBLAS for {taken}", better(taken, processor())
    if faster:
        said += f"; faster here: export OPENBLAS_CORETYPE={faster}"
    threads = int(ctypes.CDLL(LIBRARY).openblas_get_num_threads())
    if threads > 1 and ranks() * threads > cores():
        said += f"; {threads} threads in each of {ranks()} processes on {cores()} cores: export OMP_NUM_THREADS=1"
    return said


if __name__ == "__main__":
    sys.stdout.write(better(core(), processor()))
