"""Parts of edges within a surface against the box that it encloses."""

import numpy as np
import pytest

from fenics_contact.kernels.passages import parts_within

pytestmark = pytest.mark.serial
RINGS = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
CORNERS = 2.0 * ((np.arange(8)[:, None] >> np.arange(3)) & 1) - 1.0  # of the box -1 ... 1
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def surface(triangles):
    """Facets of the box, seen from outside counter-clockwise: quadrilaterals, or halves of them."""
    if not triangles:
        return RINGS, np.full(6, 4)
    halves = np.concatenate([RINGS[:, [0, 1, 2, 2]], RINGS[:, [0, 2, 3, 3]]])
    return halves, np.full(12, 3)


def parts(ends, triangles=False, turn=TURN):
    facets = surface(triangles)
    n, nf = len(ends), len(facets[0])
    lists = nf * np.arange(n + 1), np.tile(np.arange(nf), n)
    return parts_within(np.ascontiguousarray(ends @ turn.T), lists, (np.ascontiguousarray(CORNERS @ turn.T), facets))


def clipped(ends):
    """Where edges lie in the box: between the last of three ways in and the first of three ways out."""
    a, d = ends[:, 0], ends[:, 1] - ends[:, 0]
    low, high = np.sort([(-1.0 - a) / d, (1.0 - a) / d], axis=0)
    return np.stack([np.clip(low.max(axis=1), 0.0, 1.0), np.clip(high.min(axis=1), 0.0, 1.0)], axis=1)


@pytest.mark.parametrize("triangles", [False, True])
def test_edges_lie_in_a_box_where_its_sides_clip_them(triangles):
    ends = np.random.default_rng(1).uniform(-2.5, 2.5, (2000, 2, 3))
    found, known = parts(ends, triangles), clipped(ends)
    passes = (known[:, 1] > known[:, 0]) & ((known[:, 0] > 0.0) | (known[:, 1] < 1.0))  # else all within, or out
    assert 200 < passes.sum() < 1800
    assert found[passes] == pytest.approx(known[passes], abs=1e-12) and not found[~passes].any()


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_edges_through_seams_of_facets_are_not_missed(turn):
    """Through the middles of opposite faces, where halves of them meet, and through corners."""
    ends = np.array([[[0.0, 0.0, -2.0], [0.0, 0.0, 2.0]], [[0.5, 0.5, -2.0], [0.5, 0.5, 2.0]], [[-2.0] * 3, [2.0] * 3]])
    assert parts(ends, True, turn) == pytest.approx(np.tile([0.25, 0.75], (3, 1)), abs=1e-9)


def test_the_longest_of_parts_counts():
    """Of two boxes, through which an edge goes one after the other."""
    x = np.concatenate([CORNERS, 0.5 * CORNERS + [3.0, 0.0, 0.0]])
    facets = np.concatenate([RINGS, RINGS + 8])
    ends = np.array([[[-4.0, 0.1, 0.2], [4.0, 0.1, 0.2]]])
    for order in (np.arange(12), np.arange(12)[::-1].copy()):
        found = parts_within(ends, (np.array([0, 12]), order), (x, (facets, np.full(12, 4))))
        assert found == pytest.approx(np.array([[3 / 8, 5 / 8]]))
