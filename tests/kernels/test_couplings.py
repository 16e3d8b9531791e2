"""Which pairs of nodes contact pairs couple: against sets in plain Python."""

import numpy as np
import pytest

from fenics_contact.kernels.couplings import coupled_pairs, find, lacks, newly_met, unique_pairs

ELEMENTS, POINTS, FACETS, NODES = 7, 4, 12, 40


@pytest.fixture
def scene():
    """Slave elements of four points on nodes 0 ... 19, facets on 20 ... 39; lists of up to five facets; anchors on some."""
    rng = np.random.default_rng(4)
    slave_nodes = np.repeat([rng.permutation(20)[:4] for _ in range(ELEMENTS)], POINTS, axis=0)
    corners = np.array([20 + rng.permutation(20)[:4] for _ in range(FACETS)])
    listed = [rng.permutation(FACETS)[: rng.integers(0, 6)] for _ in slave_nodes]
    offsets = np.concatenate([[0], np.cumsum([len(some) for some in listed])])
    anchors = corners[rng.integers(0, FACETS, len(slave_nodes))]
    anchors[::5] = -1
    return offsets, np.concatenate(listed), slave_nodes, corners, anchors


def pairs_of(scene):
    (offsets, listed, *tables), none = scene, np.empty(0, dtype=np.int64)
    lists = (offsets, listed), tuple(tables)
    rows, columns = (np.empty(coupled_pairs(*lists, none, none), dtype=np.int64) for _ in range(2))
    assert coupled_pairs(*lists, rows, columns) == len(rows)
    return rows, columns


def test_all_nodes_of_a_point_its_anchor_and_its_facets_are_coupled(scene):
    offsets, listed, slave_nodes, corners, anchors = scene
    coupled = set()
    for q in range(len(slave_nodes)):
        facets = listed[offsets[q] : offsets[q + 1]]
        if len(facets):
            nodes = {*slave_nodes[q], *corners[facets].ravel(), *anchors[q]} - {-1}
            coupled |= {(q, (i, j)) for i in nodes for j in nodes}
    expected = {pair for _, pair in coupled}
    rows, columns = pairs_of(scene)
    assert set(zip(rows, columns, strict=True)) == expected
    # once per element of four points: a pair that all of them couple would come four times
    assert len(rows) == len({(q // POINTS, *pair) for q, pair in coupled})
    once = unique_pairs(rows, columns, NODES)
    assert set(zip(*once, strict=True)) == expected and len(once[0]) == len(expected)
    assert (np.diff(once[0]) >= 0).all()


def test_a_pattern_lacks_what_is_taken_out_of_it(scene):
    offsets, listed, slave_nodes, corners, anchors = scene
    has = np.diff(offsets) > 0
    facet = np.where(has, listed[np.minimum(offsets[:-1], len(listed) - 1)], -1)
    rows, columns = unique_pairs(*pairs_of(scene), NODES)
    keys = np.sort(rows * NODES + columns)

    def without(key):
        kept = keys[keys != key]
        ends = (np.searchsorted(kept, (np.arange(NODES) + more) * NODES) for more in (0, 1))
        return np.arange(NODES), *ends, kept % NODES

    tables = slave_nodes, corners, anchors
    assert not lacks(has, tables, facet, without(-1))
    q = np.flatnonzero(has)[0]
    needed = slave_nodes[q, 0] * NODES + corners[facet[q], 2]
    assert lacks(has, tables, facet, without(needed))
    assert not lacks(np.zeros_like(has), tables, facet, without(needed))


def test_places_are_those_of_searchsorted():
    columns = np.array([3, 5, 8, 9, 14, 20, 21])
    for low in range(8):
        for high in range(low, 8):
            for wanted in range(23):
                inside = np.flatnonzero(columns[low:high] == wanted)
                assert find(columns, low, high, wanted) == (low + inside[0] if len(inside) else -1)


def test_new_pairs_are_closed_ones_on_another_facet_or_anchor():
    closed, met = np.array([True, True, False, True]), np.array([1, 2, 3, 4])
    anchors = np.arange(16).reshape(4, 4)
    moved = anchors.copy()
    moved[3, 2] = 99
    new = newly_met(closed, np.array([1, 7, 7, 4]), moved, met, anchors)
    assert new.tolist() == [False, True, False, True]
