"""Averaged normals: who shares one, and how it moves."""

import numpy as np
import pytest

from fenics_contact.kernels.normals import corner_angles, group_normals, group_slots, grouped_corners

RING = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
QUADS = np.stack(
    [0.25 * RING[:, 0] * (1 + RING[:, 1:] @ RING.T[1:]), 0.25 * RING[:, 1] * (1 + RING[:, :1] @ RING.T[:1])], axis=1
)
TRIANGLES = np.tile([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (3, 1, 1))


def strip(angles, triangles=False):
    """A strip of three facets along x, folded up by angles [degrees] one after the other."""
    heading = np.radians(np.cumsum([0.0, *angles]))
    line = np.vstack([np.zeros(2), np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)])
    x = np.array([[a, y, b] for a, b in line for y in (0.0, 1.0)])
    nodes = np.array([[2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1] for i in range(3)])
    if triangles:
        nodes = np.concatenate([nodes[:, [0, 1, 2]], nodes[:, [0, 2, 3]]])
    return x, nodes, TRIANGLES if triangles else QUADS


def averaged(x, nodes, gradients, degrees=30.0):
    group = np.empty((len(nodes), gradients.shape[0]), dtype=np.int64)
    every = np.ones(len(nodes), dtype=bool)
    found = grouped_corners(x, nodes, gradients, every, np.cos(np.radians(degrees)), group)
    angles, alone = corner_angles(x, nodes, gradients.shape[0], *found[1:]), np.tile(np.eye(3), (len(found[0]) - 1, 1, 1))
    groups = *found, *group_slots(*found, nodes, gradients), angles, alone

    def at(coords):
        normals, turns = np.empty((len(groups[0]) - 1, 3)), np.empty((len(groups[4]), 3, 3))
        group_normals(coords, nodes, gradients, groups, normals, turns)
        return normals, turns

    return group, groups, at


@pytest.mark.parametrize("triangles", [False, True])
def test_a_crease_parts_normals_and_a_bend_does_not(triangles):
    x, nodes, gradients = strip([20.0, 50.0], triangles)
    group, _, at = averaged(x, nodes, gradients)
    normals, _ = at(x)
    of_node = [{int(group[f, c]) for f, c in zip(*np.nonzero(nodes == node), strict=True)} for node in range(len(x))]
    assert [len(groups) for groups in of_node] == [1, 1, 1, 1, 2, 2, 1, 1]
    up = normals[:, 0] * 0 + normals[:, 2]
    (bend,), crease = of_node[2], sorted(up[list(of_node[4])])
    assert up[bend] == pytest.approx(np.cos(np.radians(10.0)), rel=1e-12)  # mean of 0 and 20 degrees
    np.testing.assert_allclose(crease, np.cos(np.radians([70.0, 20.0])), rtol=1e-12)  # each facet's own


@pytest.mark.parametrize("triangles", [False, True])
def test_turns_are_the_derivative_of_normals(triangles):
    x, nodes, gradients = strip([15.0, 50.0], triangles)
    rng = np.random.default_rng(1)
    _, groups, at = averaged(x, nodes, gradients)
    x = x + 0.05 * rng.standard_normal(x.shape)
    way = rng.standard_normal(x.shape)
    normals, turns = at(x)
    slope = np.zeros_like(normals)
    owner = np.repeat(np.arange(len(normals)), np.diff(groups[3]))
    np.add.at(slope, owner, np.einsum("sab,sb->sa", turns, way[groups[4]]))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-14)
    remainders = np.array([np.abs(at(x + h * way)[0] - normals - h * slope).max() for h in 1e-3 / 2.0 ** np.arange(4)])
    assert np.log2(remainders[:-1] / remainders[1:]).min() > 1.99
