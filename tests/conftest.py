"""Tests on several ranks: what a test leaves behind goes on all of them at once."""

import gc
import os

import pytest

# Asked of the environment: importing mpi4py starts MPI, and a process in which MPI runs hands its variables on to those it
# starts, whose own mpirun then fails. So the process that hands out tests to others must not import it.
SEVERAL = int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1"))) > 1

# Freeing a mesh or a space frees its communicator, for which ranks may wait for each other: Python's collector, which comes
# by at another time on each rank, must not do it in the middle of a test.
if SEVERAL:
    gc.disable()


@pytest.fixture(autouse=True)
def together():
    """All ranks end a test before any begins the next."""
    yield
    if SEVERAL:
        from mpi4py import MPI

        gc.collect()
        MPI.COMM_WORLD.Barrier()
