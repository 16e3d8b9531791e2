"""What is printed of an error that ends a script: of a wrong statement its message and the user's own lines, once."""

import linecache
import sys
import sysconfig
import time
import traceback
import zlib
from pathlib import Path
from types import FrameType, TracebackType

import numpy as np
from mpi4py import MPI

from fenics_contact.agreement import Lost
from fenics_contact.types import Ints64

PATIENCE = 5.0  # seconds that the other ranks give rank 0 to say what they would say too
TAG = 31_007  # of the messages by which it does; far from small numbers, which a script may use
PACKAGE = str(Path(__file__).parent)
OF_USERS = tuple(f"{PACKAGE}/{folder}/" for folder in ("demos", "meshes"))
INNER = tuple(
    f"{PACKAGE}/{room}/" for room in ("assembly", "kernels", "solvers")
)  # they know no user: their errors are bugs
STANDARD = tuple(sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib"))

_told = sys.excepthook  # what prints all other errors


def install() -> None:
    """Let errors that end a script be printed so. Those that a script catches are as ever."""
    global _told
    if sys.excepthook is not _tell:
        _told, sys.excepthook = sys.excepthook, _tell


def is_refusal(error: BaseException) -> bool:
    """Whether an error is a wrong statement that the package has found: a ValueError of its own, or one that a `raise` of
    its own has made. What fails without such a line is a bug, or an error of the user's own functions."""
    if not isinstance(error, ValueError):
        return False
    if type(error).__module__.partition(".")[0] == __name__.partition(".")[0]:
        return True
    *_, (frame, line) = [(None, 0), *traceback.walk_tb(error.__traceback__)]
    if (
        frame is None
        or not (file := frame.f_code.co_filename).startswith(f"{PACKAGE}/")
        or file.startswith(OF_USERS + INNER)
    ):
        return False
    return linecache.getline(file, line).strip().startswith("raise ")


def words(error: BaseException) -> str:
    """What is printed of a refusal: the lines of the user's that lead to it, and its message. An error of another kind
    behind it, of a function of the user's for instance, is printed whole before."""
    cause, before = error.__cause__, ""
    if cause is not None and not is_refusal(cause):
        before = "".join(traceback.format_exception(cause)) + "\nThe error above led to this one:\n\n"
    steps = list(traceback.walk_tb(error.__traceback__))
    own = [step for step in steps if _is_users(step[0])] or steps
    lines = [traceback.FrameSummary(f.f_code.co_filename, line, f.f_code.co_name) for f, line in own]
    place = "".join(traceback.format_list(lines))
    return f"{before}Traceback (most recent call last):\n{place}{type(error).__name__}: {error}\n"


def _is_users(frame: FrameType) -> bool:
    file = frame.f_code.co_filename
    if file.startswith(OF_USERS):
        return True
    return not file.startswith((f"{PACKAGE}/", "<frozen", *(f"{folder}/" for folder in STANDARD)))


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """The hook. Ranks do not wait for each other in it by a collective call, for some may be elsewhere: rank 0 sends what it
    has printed, and the others print what it has not."""
    text = words(error) if is_refusal(error) else f"{error}\n" if isinstance(error, Lost) else None
    comm = MPI.COMM_WORLD if MPI.Is_initialized() and not MPI.Is_finalized() else None
    if comm is None or comm.size == 1 or not isinstance(error, Exception):
        comm = None
    if text is not None and (comm is None or comm.rank == 0 or not _said(comm, text)):
        sys.stderr.write(text)
        sys.stderr.flush()
    elif text is None:
        _told(kind, error, trace)
    if comm is not None and comm.rank == 0:
        mark = _mark(text or "")
        _sent.extend((mark, comm.Isend(mark, dest=rank, tag=TAG)) for rank in range(1, comm.size))


_sent: list[tuple[Ints64, MPI.Request]] = []  # alive until the program ends


def _mark(text: str) -> Ints64:
    """A number (1,) that stands for a text."""
    return np.array([zlib.crc32(text.encode())], dtype=np.int64)


def _said(comm: MPI.Comm, text: str) -> bool:
    """Whether rank 0 has printed just this text, as far as it says so in time."""
    end = time.monotonic() + PATIENCE
    while not comm.Iprobe(source=0, tag=TAG):
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    mark = np.empty(1, dtype=np.int64)
    comm.Recv(mark, source=0, tag=TAG)
    return bool(mark[0] == _mark(text)[0])
