"""Compiled forms in the cache: processes side by side, and one that was killed while it compiled."""

import os
import subprocess
import sys
import threading
import time
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import numpy as np
import pytest
import ufl
from mpi4py import MPI

from fenics_contact import compat, form_files

HELD = """
import fcntl, sys, time
lock = open(sys.argv[1] + ".lock", "w")
fcntl.flock(lock, fcntl.LOCK_EX)
print("held", flush=True)
time.sleep({seconds})
for ending in sys.argv[2:]:
    open(sys.argv[1] + ending, "wb").write(open({source!r} + ending, "rb").read())
time.sleep(60)
"""


@pytest.fixture
def compiled() -> Path:
    """Path, without its ending, of what FFCx has compiled for a form."""
    folder = compat.forms_folder()
    mesh = compat.dolfinx_mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    compat.compile_form(compat.Constant(mesh, 1.0) * ufl.dx)
    return next(path.with_suffix("") for path in folder.glob("libffcx_forms_*.c") if Path(f"{path}.cached").exists())


def test_a_killed_compilation_is_begun_again_at_once(tmp_path: Path) -> None:
    (tmp_path / "form.c").write_text("half of a form")
    before = time.monotonic()
    assert form_files.found("form", [], tmp_path, 1) == (None, None)
    assert time.monotonic() - before < 0.9  # FFCx waits for one second here, then raises
    assert (tmp_path / "form.c").read_text() == ""


def test_a_process_that_compiles_is_waited_for(tmp_path: Path, compiled: Path) -> None:
    """Longer than FFCx would wait; what the other has compiled is used."""
    path, endings = str(tmp_path / compiled.name), [EXTENSION_SUFFIXES[0], ".c.cached"]
    Path(path + ".c").write_text("")
    program = HELD.format(seconds=1.5, source=str(compiled))
    with subprocess.Popen([sys.executable, "-c", program, path, *endings], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        objects, module = form_files.found(compiled.name, [], tmp_path, 1)
        assert other.poll() is None
        other.kill()
    assert objects == [] and Path(module.__file__).parent == tmp_path


def test_a_killed_process_that_was_waited_for_leaves_the_compiling_to_the_next(tmp_path: Path) -> None:
    path = str(tmp_path / "form")
    program = HELD.format(seconds=60, source="")
    with subprocess.Popen([sys.executable, "-c", program, path], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        threading.Timer(0.5, other.kill).start()
        assert form_files.found("form", [], tmp_path, 1) == (None, None)
        assert other.wait() != 0


def test_forms_compiled_side_by_side_are_the_same(tmp_path: Path) -> None:
    program = (
        "import numpy as np, ufl; from fenics_contact import compat; from mpi4py import MPI;"
        "mesh = compat.dolfinx_mesh.create_unit_square(MPI.COMM_SELF, 2, 2); x = ufl.SpatialCoordinate(mesh);"
        "print(compat.assemble_scalar(compat.compile_form(ufl.exp(x[0]) * x[1] * ufl.dx)))"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path)}
    both = [subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, env=environment) for _ in range(2)]
    values = [float(one.communicate()[0]) for one in both]
    assert np.allclose(values, (np.e - 1) / 2, rtol=1e-6) and values[0] == values[1]
