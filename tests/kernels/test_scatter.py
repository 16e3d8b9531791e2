"""What elements add where, against the sums as NumPy writes them."""

import numpy as np
import pytest

from fenics_contact.assembly.blocks import tool_blocks
from fenics_contact.assembly.pose import Pose, rotation, skew, spin_rate
from fenics_contact.kernels.scatter import motions_of_elements, stays

pytestmark = pytest.mark.serial

RNG = np.random.default_rng(5)
VECTOR, LEVER = np.array([0.3, -0.4, 0.2]), 2.5
POSE = Pose(np.array([0.1, 0.2, -0.3]), np.array([0.4, 0.0, 0.6]), rotation(VECTOR), spin_rate(VECTOR) / LEVER, LEVER)


def by_elements(K, motions):
    rates = np.full((len(motions), 3, 6), np.nan), np.full((len(motions), 6, 3), np.nan)
    motions_of_elements(K, motions, *rates)
    return rates


@pytest.mark.parametrize("k", [1, 4])
def test_motions_of_elements(k):
    K, x = RNG.normal(size=(5, 3 * k, 3 * k)), RNG.normal(size=(5 * k, 3))
    motions = POSE.motions(x)
    by_motion, of_wrench = by_elements(K, motions)
    B = motions.reshape(5, 3 * k, 6)
    np.testing.assert_allclose(by_motion.reshape(5, 3 * k, 6), K @ B, rtol=0, atol=1e-13)
    expected = (B.transpose(0, 2, 1) @ K).reshape(5, 6, k, 3).transpose(0, 2, 1, 3).reshape(5 * k, 6, 3)
    np.testing.assert_allclose(of_wrench, expected, rtol=0, atol=1e-13)


def test_couplings_with_a_tool():
    """A tool that moves alone is both bodies' motion and the nodes' way back, see `tool_blocks`."""
    n = 7
    K, motions, f = RNG.normal(size=(n, 3, 3)), POSE.motions(RNG.normal(size=(n, 3))), RNG.normal(size=(n, 3))
    rates = by_elements(K, motions)
    found = tool_blocks(2, POSE, np.arange(3), (motions, f), rates)  # own nodes are fewer, before sums over processes
    columns, rows = -rates[0], -rates[1]
    columns[..., 3:] -= skew(f)
    rows[..., 3:, :] += skew(f)
    corner = -np.einsum("nca,ncb->ab", motions, columns)
    corner[3:, :3] -= skew(f).sum(axis=0)
    rows[..., 3:, :] /= LEVER
    corner[3:] /= LEVER
    for got, expected in ((found.columns, POSE.by_coordinates(columns)), (found.rows, rows),
                          (found.corner, POSE.by_coordinates(corner))):  # fmt: skip
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13)


def test_nodes_stay_until_one_of_theirs_moves():
    nodes, X, u = np.array([[0, 2], [2, 5]], np.int32), RNG.normal(size=(2, 2, 3)), RNG.normal(size=18)
    x = X + u.reshape(-1, 3)[nodes]
    assert stays(nodes, X, u, x)
    u[3] += 1.0  # of node 1, which is none of them
    assert stays(nodes, X, u, x)
    u[17] = np.nextafter(u[17], 2.0) + 1e-9
    assert not stays(nodes, X, u, x)
    u[17] = np.nan
    assert not stays(nodes, X, u, X + u.reshape(-1, 3)[nodes])  # no number is no place
