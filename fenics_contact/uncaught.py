"""What is printed of an error that ends a script: of a wrong statement its message and the user's own lines, once."""

import difflib
import functools
import inspect
import linecache
import re
import sys
import sysconfig
import time
import traceback
import zlib
from collections.abc import Callable
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import agreement
from fenics_contact.agreement import PATIENCE, Lost
from fenics_contact.types import Ints64

ECHO = 5.0  # seconds that the other ranks give rank 0 to say what they would say too
LAST_WORDS = 1.0  # seconds in which mpirun passes on what a rank has written, before it hears of the end and no more is
TAG = 31_007  # of the messages between ranks that have failed; far from small numbers, which a script may use
PACKAGE = str(Path(__file__).parent)
AGREEMENT = agreement.__file__  # which hands on the words of `solve`
OF_USERS = tuple(f"{PACKAGE}/{folder}/" for folder in ("demos", "meshes"))
INNER = tuple(
    f"{PACKAGE}/{room}/" for room in ("assembly", "kernels", "solvers")
)  # they know no user: their errors are bugs
UNKNOWN = re.compile(r"([\w.]+)\(\) got an unexpected keyword argument '(\w+)'")
PUBLIC = ("fenics_contact", "fenics_contact.studies")  # modules whose names a script may call
NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
INSIDE = {"method": "Method", "out": "Output", "steps": "ArcSteps", "penalty": "Penalty"}  # what has words of its own there
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


def unknown_word(error: BaseException) -> str | None:
    """What to say of a word that a call of the user's gives to a function of the package's which has none of that name:
    where it is stated, or the one that it resembles. None of other errors."""
    found = UNKNOWN.match(str(error)) if isinstance(error, TypeError) else None
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    if found is None or not frames or not (_is_users(frames[-1]) or frames[-1].f_code.co_filename == AGREEMENT):
        return None
    name, word = found[1].removesuffix(".__init__"), found[2]
    callee = _offered(name, [frame.f_globals | frame.f_locals for frame in frames if _is_users(frame)])
    if callee is None:
        return None
    named = [one for one in inspect.signature(callee).parameters.values() if one.kind in NAMED and one.name != "self"]
    own, inside = {one.name: f"{one.name}=..." for one in named}, dict[str, str]()
    for one in named:
        if (kind := INSIDE.get(one.name)) and kind in str(one.annotation):
            its = inspect.signature(vars(sys.modules[PUBLIC[0]])[kind]).parameters
            inside |= {each: f"{one.name}={kind}({each}=...)" for each in its}
    if word in inside:
        return f"{name} has no '{word}' of its own: give {inside[word]}"
    alike = difflib.get_close_matches(word, both := inside | own, 1)
    return f"{name} has no '{word}'; " + (f"did you mean {both[alike[0]]}?" if alike else f"it has {', '.join(own)}")


def _offered(name: str, scopes: list[dict[str, Any]]) -> Callable[..., object] | None:
    """What the package offers under this name, 'Scene.contact' for instance; where a script's names, of its scopes, do not
    know of it, or have another one so called, None."""
    first, *rest = name.split(".")
    for module in [sys.modules[one] for one in PUBLIC if one in sys.modules]:
        offered = vars(module).get(first)
        known = any(value is offered or value is module for scope in scopes for value in scope.values())
        if offered is not None and known and all(scope.get(first, offered) is offered for scope in scopes):
            found = functools.reduce(lambda owner, one: getattr(owner, one, None), rest, offered)
            return found if callable(found) else None
    return None


def words(error: BaseException, message: str) -> str:
    """What is printed of a refusal: the lines of the user's that lead to it, and its message. An error of another kind
    behind it, of a function of the user's for instance, is printed whole before."""
    cause, before = error.__cause__, ""
    if cause is not None and not is_refusal(cause):
        before = "".join(traceback.format_exception(cause)) + "\nThe error above led to this one:\n\n"
    steps = list(traceback.walk_tb(error.__traceback__))
    own = [step for step in steps if _is_users(step[0])] or steps
    lines = [traceback.FrameSummary(f.f_code.co_filename, line, f.f_code.co_name) for f, line in own]
    place = "".join(traceback.format_list(lines))
    return f"{before}Traceback (most recent call last):\n{place}{type(error).__name__}: {message}\n"


def last_words(error: BaseException) -> str:
    """An error's type and message, as they end what is printed of it."""
    message = unknown_word(error)
    if message is not None:
        return f"{type(error).__name__}: {message}"
    return "".join(traceback.TracebackException.from_exception(error).format_exception_only()).strip()


def _is_users(frame: FrameType) -> bool:
    file = frame.f_code.co_filename
    if file.startswith(OF_USERS):
        return True
    return not file.startswith((f"{PACKAGE}/", "<frozen", *(f"{folder}/" for folder in STANDARD)))


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """The hook. Of several ranks the others print what rank 0 has not printed. Ranks without an error may wait for this one,
    and nothing can tell them: a rank that has failed alone ends them all."""
    message = str(error) if is_refusal(error) else unknown_word(error)
    text = words(error, message) if message is not None else f"{error}\n" if isinstance(error, Lost) else None
    comm, heard, start = _ranks(error), dict[int, int](), time.monotonic()
    mark = zlib.crc32((text or "").encode())
    if comm is not None:
        _announce(comm, mark)
        if text is not None and comm.rank > 0:
            _hear(comm, heard, [0], start + ECHO)
    if text is None:
        _told(kind, error, trace)
    elif heard.get(0) != mark:
        sys.stderr.write(text)
    sys.stderr.flush()
    if comm is not None:
        _hear(comm, heard, [rank for rank in range(comm.size) if rank != comm.rank], start + PATIENCE)
        if len(heard) < comm.size - 1:
            sys.stderr.write(f"rank {comm.rank} has failed, and others have not in {PATIENCE:g} s: all are ended\n")
            sys.stderr.flush()
            time.sleep(LAST_WORDS)
            comm.Abort(1)


def _ranks(error: BaseException) -> MPI.Comm | None:
    """Where there are other ranks to hear of an error."""
    there = MPI.Is_initialized() and not MPI.Is_finalized() and isinstance(error, Exception)
    return MPI.COMM_WORLD if there and MPI.COMM_WORLD.size > 1 else None


_sent: list[tuple[Ints64, MPI.Request]] = []  # alive until the program ends


def _announce(comm: MPI.Comm, mark: int) -> None:
    """Let all other ranks know that this one has failed, and by a number with what words. Not collective: they may be
    elsewhere."""
    message = np.array([mark], dtype=np.int64)
    _sent.extend((message, comm.Isend(message, dest=rank, tag=TAG)) for rank in range(comm.size) if rank != comm.rank)


def _hear(comm: MPI.Comm, heard: dict[int, int], ranks: list[int], end: float) -> None:
    """Add what these ranks have announced, as far as they do so until `end`."""
    message = np.empty(1, dtype=np.int64)
    while waiting := [rank for rank in ranks if rank not in heard]:
        for rank in waiting:
            if comm.Iprobe(source=rank, tag=TAG):
                comm.Recv(message, source=rank, tag=TAG)
                heard[rank] = int(message[0])
        if time.monotonic() > end:
            return
        time.sleep(0.01)
