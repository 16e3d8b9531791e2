"""Patches of slave nodes: who is gathered, what a pattern lacks, and who has come to meet something else."""

import numpy as np
import pytest

from fenics_contact.kernels.mortar import Slaves
from fenics_contact.kernels.mortar_patches import elsewhere, gathered, patches_lack

COUNT = 9


def test_numbers_are_gathered_in_the_order_in_which_they_stand():
    numbers = np.array([3, -1, 0, 3, 8, 0, 3])
    starts, entries = gathered(numbers, COUNT)
    found = [entries[starts[i] : starts[i + 1]].tolist() for i in range(COUNT)]
    assert found == [np.flatnonzero(numbers == i).tolist() for i in range(COUNT)]


def test_a_pattern_lacks_what_is_taken_out_of_it():
    """Rows of what a node acts on, columns of all that it depends on."""
    patches = np.array([0, 4, 4, 7]), np.array([2, 0, 3]), np.array([1, 5, 2, 8, 5, 6, 0])
    needed = {(i, j) for i in (1, 5) for j in (1, 5, 2, 8)} | {(i, j) for i in (5, 6, 0) for j in (5, 6, 0)}

    def rows(pairs):
        heads = np.array([i for i, _ in sorted(pairs)])
        return np.searchsorted(heads, np.arange(COUNT + 1)), np.array([j for _, j in sorted(pairs)])

    assert not patches_lack(patches, *rows(needed | {(3, 3), (1, 0)}))
    for pair in needed:
        assert patches_lack(patches, *rows((needed | {(3, 3)}) - {pair}))


@pytest.mark.parametrize("which, at", [(0, (3,)), (1, (7, 1)), (2, (2, 3))])
def test_nodes_one_of_whose_samples_meets_something_else(which, at):
    """Two facets of two samples and two corners; nodes 0 and 1 on the first, 1 and 2 on the second.

    Changed: the facet of sample 3, its anchor for the second corner, an end below sample 2.
    """
    none, firsts = np.empty((0, 0)), np.array([0, 1, 3, 4])
    facets, places = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    numbers = np.empty((0, 0), np.int64)
    slaves = Slaves(
        numbers,
        numbers,
        firsts,
        facets,
        places,
        np.array([0, 2, 4]),
        np.repeat([0, 1], 2),
        np.ones(4),
        none,
        np.ones((4, 2)),
        np.zeros((2, 2), bool),
        none,
        np.tile(np.eye(3), (3, 1, 1)),
        np.empty(0),
    )
    before = np.arange(4), np.arange(16).reshape(8, 2), np.arange(16).reshape(4, 4)
    now = tuple(part.copy() for part in before)
    now[which][at] = -1
    expected = {0: [False, True, True], 1: [False, False, True], 2: [False, True, True]}[which]
    everyone, no_one = np.ones(3, bool), np.zeros(3, bool)
    assert not elsewhere(everyone, slaves, before, before).any()
    assert elsewhere(everyone, slaves, now, before).tolist() == expected
    assert not elsewhere(no_one, slaves, now, before).any()
