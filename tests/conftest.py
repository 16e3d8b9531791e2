"""Tests on several ranks: what a test leaves behind goes on all of them at once."""

import gc
import os
import signal
import tempfile
import threading
from pathlib import Path

import pytest

# Asked of the environment: importing mpi4py starts MPI, and a process in which MPI runs hands its variables on to those it
# starts, whose own mpirun then fails. So the process that hands out tests to others must not import it.
SEVERAL = int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1"))) > 1

# Each rank is a session of pytest's own, which deletes the folders of older ones: of one root two would delete the same.
if SEVERAL:
    _rank = os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0"))
    _root = Path(tempfile.gettempdir()) / f"pytest-{os.getuid()}-rank-{_rank}"
    _root.mkdir(exist_ok=True)
    os.environ["PYTEST_DEBUG_TEMPROOT"] = str(_root)

# A process that others hand tests to may run them beside its main thread. Gmsh sets a signal's handler as it is imported and
# ends, which Python lets the main thread alone do: all tests ended with an error there, once in many runs
if threading.current_thread() is not threading.main_thread():
    signal.signal = lambda number, handler: signal.getsignal(number)

# Freeing a mesh or a space frees its communicator, for which ranks may wait for each other: Python's collector, which comes
# by at another time on each rank, must not do it in the middle of a test.
if SEVERAL:
    gc.disable()


# Takes longest of all, for it compiles kernels anew: begun last, one of two processes would wait for it with nothing to do
LONGEST = "test_wheel.py"


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.path.name != LONGEST)


def pytest_collection_finish():
    """What all tests have imported by now stays: no collection need look through it again."""
    if SEVERAL:
        gc.collect()
        gc.freeze()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """All ranks end a test before any begins the next, and free what it has left. Between files all is looked through, what
    a file has solved once for its tests and what was compiled; within one the collector looks at what is new alone."""
    yield
    if SEVERAL:
        from mpi4py import MPI

        other = nextitem is None or nextitem.path != item.path
        if other:
            gc.unfreeze()
        gc.collect()
        if other:
            gc.freeze()
        MPI.COMM_WORLD.Barrier()
