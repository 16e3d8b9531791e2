"""What goes wrong on one rank alone ends all of them, with one error: users' functions and files may fail anywhere."""

import functools
import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
from mpi4py import MPI

# Seconds that a rank which has failed waits for the others: they may wait for it in turn, in a sum over ranks within the
# same function, and nobody but this rank can end that.
PATIENCE = 30.0
ALIKE = 1e-9  # of its size: what a sum over ranks may differ by from rank to rank is round-off
FEW = 6  # numbers that an error shows; of more the first that differ

Value = TypeVar("Value")
S = TypeVar("S", bound="OnRanks")
P = ParamSpec("P")


class OnRanks(Protocol):
    @property
    def mesh(self) -> "Distributed": ...


class Distributed(Protocol):
    @property
    def comm(self) -> MPI.Comm: ...


def collect_together(comm: MPI.Comm) -> None:
    """Free what Python has dropped, on all ranks at once; from then on its collector comes by nowhere else. Collective.

    Left alone it comes by at another time on each rank. But freeing a mesh or a space frees its communicator, for which
    ranks may wait for each other, and a matrix that one rank has dropped before the solver which holds it, and another one
    after it, freezes PETSc when the program ends.
    """
    if comm.size > 1:
        gc.disable()
        gc.collect()


class Lost(RuntimeError):
    """Another rank has failed in a way that this one cannot know more of."""


@contextmanager
def agreed(comm: MPI.Comm, what: str, kind: type[Exception]) -> Iterator[None]:
    """A block that may fail on any rank: then `kind` is raised on all, naming `what`, the rank and the error. Collective.

    A block that raises `kind` itself has said it all: its words are kept.
    """
    failure = None
    try:
        yield
    except Exception as error:
        failure = error
    if _anyone(comm, failure, what):
        texts = comm.allgather(None if failure is None else _words(failure, what, kind))
        ranks = [rank for rank, text in enumerate(texts) if text is not None]
        text, said = texts[ranks[0]]
        where = "" if said or len(ranks) == comm.size else f" on rank {ranks[0]}"
        raise kind(text.replace("{where}", where)) from (None if isinstance(failure, kind) else failure)


def _words(failure: Exception, what: str, kind: type[Exception]) -> tuple[str, bool]:
    """What to say of a failure, and whether it is said in the failure's own words."""
    if isinstance(failure, kind):
        return str(failure), True
    return f"{what} failed{{where}}: {type(failure).__name__}: {failure}", False


def alike(comm: MPI.Comm, what: str, call: Callable[[], Value], kind: type[Exception]) -> Value:
    """call() made on every rank, a number or an array of one shape that must be the same on all: rank 0's. Collective."""
    with agreed(comm, what, kind):
        here = call()
    if comm.size == 1:
        return here
    first = comm.bcast(here)
    with agreed(comm, what, kind):
        there, known = np.asarray(here).ravel(), np.asarray(first).ravel()
        bound = ALIKE * np.max(np.abs(np.nan_to_num(known, posinf=0.0, neginf=0.0)), initial=0.0)
        off = ~np.isclose(there, known, rtol=0.0, atol=bound, equal_nan=True)
        if off.any():
            shown = (first, here) if there.size <= FEW else (known[off][0], there[off][0])
            raise kind(
                f"{what} gives {shown[0]} on rank 0 and {shown[1]} on rank {comm.rank}: it must not depend on the part of "
                "the mesh that a rank holds; sum or compare over the ranks first, e.g. by comm.allreduce"
            )
    return first


def ends_together(function: Callable[Concatenate[S, P], Value]) -> Callable[Concatenate[S, P], Value]:
    """Of a function of a scene: an exception on one rank alone ends the others too, wherever they are. Collective."""

    @functools.wraps(function)
    def together(scene: S, *arguments: P.args, **options: P.kwargs) -> Value:
        comm = scene.mesh.comm
        try:
            result = function(scene, *arguments, **options)
        except BaseException as error:
            _anyone(comm, error, function.__name__)
            raise
        if _anyone(comm, None, function.__name__):
            raise Lost(f"{function.__name__} failed on another rank; its error says why")
        return result

    return together


def _anyone(comm: MPI.Comm, failure: BaseException | None, what: str) -> bool:
    """Whether any rank has a failure, once all have come here. Collective.

    A non-blocking sum, which no sum of the user's own can be taken for. A rank that has failed ends the run where the
    others do not come.
    """
    if comm.size == 1:
        return failure is not None
    failed, here = np.zeros(1, dtype=int), np.array([failure is not None], dtype=int)
    request = comm.Iallreduce(here, failed, op=MPI.SUM)
    if failure is None:
        request.Wait()
        return bool(failed[0])
    end = time.monotonic() + PATIENCE
    while not request.Test():
        if time.monotonic() > end:
            sys.stderr.write(f"{what} failed on rank {comm.rank} alone: {type(failure).__name__}: {failure}\n")
            sys.stderr.flush()
            MPI.COMM_WORLD.Abort(1)
        time.sleep(0.01)
    return True
