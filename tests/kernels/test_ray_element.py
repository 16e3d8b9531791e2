"""Slave normals as rays: the foot on warped facets, continuity over master edges, exact tangent."""

import numpy as np
import pytest
from dense import evaluated

from fenics_contact import coulomb
from fenics_contact.kernels.closest_point import INTERIOR, NONE
from fenics_contact.kernels.deformable_element import slave_points
from fenics_contact.kernels.slave_ray import facet_directions, slave_rays
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

AREA, EPS_N, EPS_T = 0.3, 50.0, 20.0
# two quads that share x = 1, folded to a ridge of the master; slave facet above, counter-clockwise seen from below
RIDGE = np.array([[0, 0, -0.2], [1, 0, 0.1], [1, 1, 0.05], [0, 1.1, -0.3], [2.1, 0.1, -0.25], [1.9, 0.9, -0.15]])
FACETS = [[0, 1, 2, 3], [1, 4, 5, 2]]
TRIANGLES = [[0, 1, 2, 2], [0, 2, 3, 3], [1, 4, 5, 5], [1, 5, 2, 2]]
SLAVE = np.array([[0.2, 0.1, 0.02], [0.1, 0.9, -0.03], [0.8, 1.0, 0.04], [0.9, 0.2, 0.0]])
XI = (0.2, -0.3)


def shapes(s, t):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    N = 0.25 * (1 + corners[:, 0] * s) * (1 + corners[:, 1] * t)
    gradient = 0.25 * np.array([corners[:, 0] * (1 + corners[:, 1] * t), corners[:, 1] * (1 + corners[:, 0] * s)])
    return N, gradient


def directions(coords, nodes, gradients):
    """Unit normals into the slave."""
    found = np.empty((len(nodes), 3))
    facet_directions(coords, nodes, gradients, found)
    return found


class Pair:
    """One point of a slave facet over a folded master; beyond: how far its ray may miss the master, over the
    radius of a facet."""

    def __init__(self, lift, facets=FACETS, mu=0.0, anchor=None, at=XI, aside=0.0, beyond=0.0):
        self.coords, self.beyond = np.vstack([RIDGE, SLAVE + [aside, 0.0, lift]]), beyond
        self.surface = (np.array(facets), np.array([len(set(f)) for f in facets]))
        weights, gradients = shapes(*at)
        self.slaves = (np.arange(6, 10)[None], weights[None], np.array([AREA]), gradients[None])
        self.law = (np.array([EPS_N]), np.array([EPS_T]), coulomb(mu), 0.0, np.zeros(1))
        self.anchors = (np.full((1, 4), -1), np.zeros((1, 4)))
        if anchor:
            self.anchors = (np.array([anchor[0]]), np.array([anchor[1]]))

    def evaluate(self, coords):
        point, n = np.empty((1, 3)), len(self.surface[0])
        slave_points(coords, self.slaves[0], self.slaves[1], point)
        out = (*(np.zeros(1, np.int64) for _ in range(3)), np.zeros((1, 2)), np.zeros(1), np.zeros((1, 3)))
        lists = (np.array([0, n]), np.arange(n))
        slave_rays(
            point,
            directions(coords, self.slaves[0], self.slaves[3]),
            (coords, self.surface),
            lists,
            (2.0, self.beyond, 0.0),
            out,
        )
        pairs = (coords, self.slaves, self.surface, out, self.anchors, self.law)
        residual, tangent, status, T = evaluated(*pairs)
        gap = out[4]
        return residual, tangent, status[0], gap[0], T[0], out, point[0]


ANCHOR = ([1, 4, 5, 2], [0.6, -0.1, 0.1, 0.4])
# the slave facet's first corner, 0.015 beyond the master's border and 0.1 deep
CORNER = {"at": (-1, -1), "aside": -0.215, "beyond": 0.1}
STATES = {
    "open": ({"lift": 0.6}, OPEN),
    "closed": ({"lift": -0.3}, CLOSED),
    "closed triangle": ({"lift": -0.3, "facets": TRIANGLES}, CLOSED),
    "stick": ({"lift": -0.3, "mu": 9.0, "anchor": ANCHOR}, STICK),
    "slip": ({"lift": -0.3, "mu": 0.3, "anchor": ANCHOR}, SLIP),
    "beyond the border": ({"lift": -0.3, "mu": 0.3, "anchor": ANCHOR} | CORNER, SLIP),
    "beyond, triangle": ({"lift": -0.3, "facets": TRIANGLES} | CORNER, CLOSED),
}


@pytest.mark.parametrize("name", STATES)
def test_taylor_remainder_is_of_second_order(name):
    options, status = STATES[name]
    pair = Pair(**options)
    R, K, found, *_ = pair.evaluate(pair.coords)
    assert found == status
    if status == OPEN:
        assert not R.any() and not K.any()
        return
    way = np.random.default_rng(3).uniform(-1, 1, pair.coords.shape)
    remainders = []
    for h in 1e-3 / 2.0 ** np.arange(4):
        moved = pair.evaluate(pair.coords + h * way)
        assert moved[2] == status
        remainders.append(np.linalg.norm(moved[0] - R - h * K @ way.ravel()))
    assert np.log2(np.array(remainders[:-1]) / remainders[1:]).min() > 1.98  # third-order terms shift it by the step


@pytest.mark.parametrize("name", [n for n in STATES if n != "open"])
def test_taylor_with_a_multiplier(name):
    options, status = STATES[name]
    pair = Pair(**options | {"lift": 0.1})
    pair.law[4][:] = -0.4
    R, K, found, gap, *_ = pair.evaluate(pair.coords)
    assert found == status and gap > 0.0
    way = np.random.default_rng(3).uniform(-1, 1, pair.coords.shape)
    steps = 1e-3 / 2.0 ** np.arange(4)
    remainders = [np.linalg.norm(pair.evaluate(pair.coords + h * way)[0] - R - h * K @ way.ravel()) for h in steps]
    assert np.log2(np.array(remainders[:-1]) / remainders[1:]).min() > 1.98  # third-order terms shift it by the step


@pytest.mark.parametrize("name", [n for n in STATES if n != "open"])
def test_forces_balance(name):
    pair = Pair(**STATES[name][0])
    R, *_ = pair.evaluate(pair.coords)
    force = R.reshape(-1, 3)
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * np.abs(force).max()
    if STATES[name][1] == CLOSED:  # x_S - x_M = g n is parallel to T = N n: no moment either
        assert np.abs(np.cross(pair.coords, force).sum(axis=0)).max() < 1e-13 * np.abs(force).max()


def test_the_foot_lies_on_the_normal_of_the_slave():
    pair = Pair(-0.3)
    *_, gap, _, out, point = pair.evaluate(pair.coords)
    assert out[1][0] == INTERIOR
    t = pair.slaves[3][0] @ pair.coords[6:]
    n = -np.cross(t[0], t[1])
    n /= np.linalg.norm(n)
    N, _ = shapes(*out[3][0])
    foot = N @ pair.coords[pair.surface[0][out[0][0]]]
    assert np.abs(point - foot - gap * n).max() < 1e-14
    assert np.abs(out[5][0] - n).max() < 1e-15


def test_traction_is_continuous_over_a_ridge_in_penetration():
    """The closest point's normal jumps from flank to flank under a ridge; the slave's does not."""
    pair = Pair(-0.3)
    tractions, facets = [], set()
    for x in np.linspace(0.0, 1.0, 2001):
        coords = pair.coords.copy()
        coords[6:, 0] += x
        *_, T, out, _ = pair.evaluate(coords)
        tractions.append(T)
        facets.add(int(out[0][0]))
    assert facets == {0, 1}
    # steps of 5e-4 times a slope of the flanks of 0.4 times eps_n 50
    assert np.linalg.norm(np.diff(tractions, axis=0), axis=1).max() < 5e-4 * 0.5 * EPS_N


def test_a_facet_that_looks_the_slaves_way_is_no_partner():
    turned = [[f[0], f[3], f[2], f[1]] for f in FACETS]
    pair = Pair(-0.3, facets=turned)
    assert pair.evaluate(pair.coords)[5][1][0] == NONE


@pytest.mark.parametrize("facets", [[[0, 1, 2, 3]], [[0, 1, 2, 2], [0, 2, 3, 3]]])
@pytest.mark.parametrize(
    "aside, deep, paired", [(-0.06, -0.1, True), (-0.08, -0.1, False), (-0.06, 0.1, True), (0.3, -0.1, True)]
)
def test_a_corner_may_miss_the_master_by_a_share_of_a_facet(facets, aside, deep, paired):
    """A level facet over the unit square: the ray is vertical, and the plane beyond the border is that of the square,
    whose ball has a radius of 0.707."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], dtype=float)
    level = [[0, 0, deep], [0, 0.5, deep], [0.5, 0.5, deep], [0.5, 0, deep]]
    for beyond, found in ((0.1, paired), (0.0, paired and aside > 0.0)):
        pair = Pair(0.0, facets=facets, at=(-1, -1), beyond=beyond)
        pair.coords = np.vstack([square, np.add(level, [aside, 0.2, 0.0])])
        *_, gap, _, out, point = pair.evaluate(pair.coords)
        assert (out[1][0] == INTERIOR) == found
        if found:
            N = shapes(*out[3][0])[0] if len(facets) == 1 else [1 - out[3][0].sum(), *out[3][0], 0.0]
            assert np.allclose(N @ square[facets[out[0][0]]], [*point[:2], 0.0], atol=1e-14) and abs(gap - deep) < 1e-15


def facet_of_points(mu, anchors=None):
    """The arrays of nine Gauss points of one slave facet over the folded master, as Pair has them for one."""
    pair = Pair(-0.3, mu=mu)
    s = np.array([-1.0, 0.0, 1.0]) * np.sqrt(0.6)
    places = [shapes(a, b) for b in s for a in s]
    weights, gradients = (np.array([place[i] for place in places]) for i in (0, 1))
    n = len(weights)
    pair.slaves = (np.tile(np.arange(6, 10), (n, 1)), weights, np.linspace(0.1, 0.4, n), gradients)
    pair.law = (np.full(n, EPS_N), np.full(n, EPS_T), coulomb(mu), 0.0, np.zeros(n))
    pair.anchors = (np.full((n, 4), -1), np.zeros((n, 4))) if anchors is None else anchors
    return pair


def projected(pair):
    n, nf = len(pair.slaves[2]), len(pair.surface[0])
    points = np.empty((n, 3))
    slave_points(pair.coords, *pair.slaves[:2], points)
    out = (*(np.zeros(n, np.int64) for _ in range(3)), np.zeros((n, 2)), np.zeros(n), np.zeros((n, 3)))
    lists = (nf * np.arange(n + 1), np.tile(np.arange(nf), n))
    slave_rays(
        points,
        directions(pair.coords, pair.slaves[0], pair.slaves[3]),
        (pair.coords, pair.surface),
        lists,
        (2.0, 0.0, 0.0),
        out,
    )
    return out


@pytest.mark.parametrize("mu", [0.0, 0.3, 9.0])
def test_points_of_a_facet_share_a_matrix_that_is_the_sum_of_theirs(mu):
    """Some of the points meet one facet and some the other, some are anchored on one, some on the other, two nowhere."""
    nodes, weights = np.tile(FACETS[0], (9, 1)), np.tile([0.1, 0.5, 0.3, 0.1], (9, 1))
    nodes[3:6], nodes[7:] = FACETS[1], -1
    pair = facet_of_points(mu, (nodes, weights))
    pair.coords[6:, 0] += 0.6
    out = projected(pair)
    assert set(out[0]) == {0, 1} and (out[4] < 0.0).all()
    together = evaluated(pair.coords, pair.slaves, pair.surface, out, pair.anchors, pair.law)
    forces, tangent = np.zeros_like(together[0]), np.zeros_like(together[1])
    for q in range(9):
        one = slice(q, q + 1)
        law = (*(eps[one] for eps in pair.law[:2]), *pair.law[2:4], pair.law[4][one])
        slaves, alone = (tuple(part[one] for part in group) for group in (pair.slaves, out))
        parts = evaluated(pair.coords, slaves, pair.surface, alone, tuple(part[one] for part in pair.anchors), law)
        forces, tangent = forces + parts[0], tangent + parts[1]
    # sums of nine terms in another order
    assert np.abs(together[0] - forces).max() < 1e-14 * np.abs(forces).max()
    assert np.abs(together[1] - tangent).max() < 1e-14 * np.abs(tangent).max()


def test_rays_hit_the_triangles_that_the_closed_form_finds():
    """Random triangles and rays; Cramer's rule for x - r(xi) = g n (Moeller & Trumbore 1997)."""
    rng = np.random.default_rng(5)
    corners = rng.uniform(-1, 1, (60, 1, 3)) + rng.uniform(-0.6, 0.6, (60, 3, 3))
    slave = rng.uniform(-1, 1, (200, 1, 3)) + rng.uniform(-0.2, 0.2, (200, 3, 3))
    coords = np.concatenate([corners.reshape(-1, 3), slave.reshape(-1, 3)])
    facets = np.arange(180).reshape(-1, 3)[:, [0, 1, 2, 2]]
    points = slave.mean(axis=1)
    gradients = np.tile([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (200, 1, 1))
    out = (*(np.zeros(200, np.int64) for _ in range(3)), np.zeros((200, 2)), np.zeros(200), np.zeros((200, 3)))
    lists = (60 * np.arange(201), np.tile(np.arange(60), 200))
    nodes = np.arange(180, 780).reshape(-1, 3)
    master = coords, (facets, np.full(60, 3))
    slave_rays(points, directions(coords, nodes, gradients), master, lists, (3.0, 0.0, 0.0), out)
    n = -np.cross(slave[:, 1] - slave[:, 0], slave[:, 2] - slave[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    matrices = np.concatenate(
        [np.broadcast_to(edges, (200, 60, 3, 2)), np.broadcast_to(n[:, None, :, None], (200, 60, 3, 1))], 3
    )
    s, t, g = np.moveaxis(np.linalg.solve(matrices, points[:, None, :, None] - corners[None, :, 0, :, None])[..., 0], 2, 0)
    faces = np.einsum("fc,pc->pf", np.cross(edges[..., 0], edges[..., 1]), n) > 0.0
    met = np.where((s >= 0) & (t >= 0) & (s + t <= 1) & faces, np.abs(g), np.inf)
    hit = np.isfinite(met).any(axis=1)
    assert 50 < hit.sum() < 200
    assert np.array_equal(out[1] == INTERIOR, hit) and np.array_equal(out[0][hit], met.argmin(axis=1)[hit])
    # the condition of nearly edge-on triangles; the least angle of the sample is about a degree
    assert np.abs(out[4][hit] - g[hit, met.argmin(axis=1)[hit]]).max() < 1e-12
