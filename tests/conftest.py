"""Tests on several ranks: what a test leaves behind goes on all of them at once."""

import gc

import pytest
from mpi4py import MPI

COMM = MPI.COMM_WORLD

# Freeing a mesh or a space frees its communicator, for which ranks may wait for each other: Python's collector, which comes
# by at another time on each rank, must not do it in the middle of a test.
if COMM.size > 1:
    gc.disable()


@pytest.fixture(autouse=True)
def together():
    """All ranks end a test before any begins the next."""
    yield
    if COMM.size > 1:
        gc.collect()
        COMM.Barrier()
