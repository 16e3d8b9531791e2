"""Refusals as tests ask for them: one message, the same on all ranks."""

import pytest
from mpi4py import MPI


def refused(action, *words, kind=ValueError):
    """The action raises `kind` (SceneError is a ValueError) on every rank, with all words in its one message; returns it."""
    with pytest.raises(kind) as caught:
        action()
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert len(set(MPI.COMM_WORLD.allgather(message))) == 1, "the ranks say different things"
    return message
