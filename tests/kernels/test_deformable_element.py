"""The element of a slave point and a deformable facet: exact tangent, balance, objectivity, history over edges."""

import os
import subprocess
import sys

import numpy as np
import pytest
from dense import evaluated

from fenics_contact import coulomb
from fenics_contact.contact.friction import friction_of
from fenics_contact.kernels import contact_pairs as element
from fenics_contact.kernels.closest_point import EDGE, INTERIOR, NONE, VERTEX, closest_points
from fenics_contact.kernels.deformable_element import slave_points
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

DOWN = np.array([0.0, 0.0, -1.0])
EPS_N, EPS_T, AREA = 50.0, 20.0, 0.3


def rotation_about(axis, angle):
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), a)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


class Pair:
    """One slave point over a small surface; everything an element needs, with projection at any coordinates."""

    def __init__(self, coords, nodes, slave, weights=(1.0,), mu=0.0, touch=0.0, anchor=None):
        self.coords = np.ascontiguousarray(coords, float)
        size = np.array([len(set(f)) for f in nodes], np.int64)
        self.surface = (np.array(nodes, np.int64), size)
        self.slaves = (
            np.array([slave], np.int64),
            np.array([weights], float),
            np.array([AREA]),
            np.empty((0, 2, len(slave))),
        )
        self.law = (np.array([EPS_N]), np.array([EPS_T]), friction_of(mu), float(touch), np.zeros(1))
        self.anchors = (np.full((1, 4), -1, np.int64), np.zeros((1, 4)))
        self.up = -DOWN
        if anchor is not None:
            self.anchors = (np.array([anchor[0]], np.int64), np.array([anchor[1]], float))

    def project(self, coords):
        point = np.zeros((1, 3))
        slave_points(coords, self.slaves[0], self.slaves[1], point)
        n = len(self.surface[0])
        lists = (np.array([0, n]), np.arange(n))
        ints = [np.zeros(1, np.int64) for _ in range(3)]
        out = (*ints, np.zeros((1, 2)), np.zeros(1), np.zeros((1, 3)))
        closest_points(point, -self.up[None, :], (coords, self.surface), lists, (5.0, 0.0), out)
        return out

    def evaluate(self, coords=None, want_tangent=True):
        """Residual and tangent on all coordinates, by insertion; and what the kernel says about the point."""
        coords = self.coords if coords is None else np.ascontiguousarray(coords)
        projection = self.project(coords)
        pairs = (coords, self.slaves, self.surface, projection, self.anchors, self.law)
        residual, tangent, status, T = evaluated(*pairs, want_tangent=want_tangent)
        return {"R": residual, "K": tangent, "status": status[0], "T": T[0], "gap": projection[4][0],
                    "kind": projection[1][0], "facet": projection[0][0], "normal": projection[5][0]}  # fmt: skip

    def commit(self, coords=None):
        coords = self.coords if coords is None else np.ascontiguousarray(coords)
        new, sliding = (np.zeros((1, 4), np.int64), np.zeros((1, 4))), np.zeros(1)
        projection = self.project(coords)
        before = [a.copy() for a in self.anchors]
        pairs = (coords, self.slaves, self.surface, projection, self.anchors)
        element.committed_anchors(pairs, self.law, new, sliding)
        assert all(np.array_equal(a, b) for a, b in zip(before, self.anchors, strict=False))
        self.anchors = new
        return sliding[0]


# ---- the states; master nodes first, slave nodes last

QUADS = [[0, 1, 2, 3], [1, 4, 5, 2]]
TRIS = [[0, 1, 2, 2], [0, 2, 3, 3], [1, 4, 5, 5], [1, 5, 2, 2]]
NODE = ([0.31, 0.42, 0.0],)
PATCH = ([0.1, 0.2, 0.03], [0.7, 0.1, -0.02], [0.6, 0.8, 0.01], [0.05, 0.7, 0.02])
PATCH_WEIGHTS = (0.1, 0.2, 0.4, 0.3)


def sheet(warp=0.0, fold=0.0):
    """Two unit facets that share x = 1, their far sides lifted by fold, corners lifted by warp."""
    z = np.array([fold + warp, 0, warp, fold - 0.5 * warp, fold, fold + 0.7 * warp])
    return np.stack([[0, 1, 1, 0, 2.1, 1.9], [0, 0, 1, 1.1, 0.1, 0.9], z], axis=1)


def pit(depth):
    """Four quads around node 0, which lies depth under its neighbours (a peak for depth < 0)."""
    a = [[0, 0], [1, 0], [1, 1], [0, 1.1], [-1, 1], [-1.2, 0], [-1, -1], [0, -1], [1, -1]]
    coords = np.array([[p, q, depth * max(abs(p), abs(q))] for p, q in a], float)
    return coords, [[0, 1, 2, 3], [0, 3, 4, 5], [0, 5, 6, 7], [0, 7, 8, 1]]


def make(surface, nodes, gap, slave=NODE, weights=(1.0,), tilt=True, at=None, **options):
    """Put the slave point gap above its foot (or at a place), anchored where options say; tilt everything."""
    n, slave = len(surface), np.array(slave, float)
    pair = Pair(np.vstack([surface, slave]), nodes, list(range(n, n + len(slave))), weights, **options)
    if at is not None:
        pair.coords[n:] += np.array(at) - np.array(weights) @ pair.coords[n:]
    else:
        for _ in range(60):  # creep to the wanted gap; on curved patches the foot moves along
            r = pair.evaluate(want_tangent=False)
            if abs(r["gap"] - gap) < 1e-15:
                break
            pair.coords[n:] += (gap - r["gap"]) * r["normal"]
    if tilt:
        Q = rotation_about([0.3, -0.8, 0.5], 1.1)
        pair.coords = np.ascontiguousarray(pair.coords @ Q.T)
        pair.up = Q @ pair.up
    return pair


SAME_FACET = ([0, 1, 2, 3], [0.4, 0.25, 0.15, 0.2])
NEXT_FACET = ([1, 4, 5, 2], [0.6, -0.1, 0.1, 0.4])
VALLEY = {"at": [1.03, 0.45, -0.3]}
BOTTOM = {"at": [0.03, -0.02, -0.3]}
WARPED, FLAT = sheet(warp=0.25), sheet()

FALLING = coulomb(0.3, exponent=-1 / 3, reference=0.5)  # at 5, half of its mu
BENT = coulomb(lambda p: 0.1 + 0.2 / (1.0 + p / 4.0), up_to=100.0)
GROOVED = coulomb(0.3, across=0.6, along=(1.0, 2.0, 0.5))
CAPPED = coulomb(0.3, exponent=-1 / 3, reference=0.5, shear_limit=0.5)

STATES = {
    # name: (builder, status, kind)
    "open": (lambda: make(WARPED, QUADS, 0.05), OPEN, INTERIOR),
    "closed flat": (lambda: make(FLAT, QUADS, -0.1), CLOSED, INTERIOR),
    "closed flat untilted": (lambda: make(FLAT, QUADS, -0.1, tilt=False), CLOSED, INTERIOR),
    "closed warped": (lambda: make(WARPED, QUADS, -0.1), CLOSED, INTERIOR),
    "closed deep": (lambda: make(WARPED, QUADS, -0.4), CLOSED, INTERIOR),
    "closed shallow": (lambda: make(WARPED, QUADS, -1e-3), CLOSED, INTERIOR),
    "closed at g = 1e-9": (lambda: make(WARPED, QUADS, 1e-9, touch=0.1), CLOSED, INTERIOR),
    "closed triangle": (lambda: make(WARPED, TRIS, -0.1), CLOSED, INTERIOR),
    "closed patch": (lambda: make(WARPED, QUADS, -0.1, PATCH, PATCH_WEIGHTS), CLOSED, INTERIOR),
    "closed without anchor": (lambda: make(WARPED, QUADS, -0.1, mu=0.3), CLOSED, INTERIOR),
    "closed valley edge": (lambda: make(sheet(0.1, 0.5), QUADS, 0, **VALLEY), CLOSED, EDGE),
    "closed triangle edge": (lambda: make(sheet(0.0, 0.5), TRIS, 0, **VALLEY), CLOSED, EDGE),
    "closed ridge edge": (lambda: make(sheet(0.1, -0.5), QUADS, 0, at=[1.03, 0.45, 0.3], touch=1.0), CLOSED, EDGE),
    "closed pit vertex": (lambda: make(*pit(0.5), 0, **BOTTOM), CLOSED, VERTEX),
    "closed peak vertex": (lambda: make(*pit(-0.5), 0, at=[0.03, -0.02, 0.3], touch=1.0), CLOSED, VERTEX),
    "stick same facet": (lambda: make(WARPED, QUADS, -0.1, mu=5.0, anchor=SAME_FACET), STICK, INTERIOR),
    "stick next facet": (lambda: make(WARPED, QUADS, -0.1, mu=9.0, anchor=NEXT_FACET), STICK, INTERIOR),
    "stick deep": (lambda: make(WARPED, QUADS, -0.4, mu=5.0, anchor=SAME_FACET), STICK, INTERIOR),
    "stick patch": (
        lambda: make(WARPED, QUADS, -0.1, PATCH, PATCH_WEIGHTS, mu=9.0, anchor=NEXT_FACET), STICK, INTERIOR),
    "stick triangle": (lambda: make(WARPED, TRIS, -0.1, mu=9.0, anchor=NEXT_FACET), STICK, INTERIOR),
    "stick valley edge": (
        lambda: make(sheet(0.1, 0.5), QUADS, 0, mu=5.0, anchor=SAME_FACET, **VALLEY), STICK, EDGE),
    "stick pit vertex": (lambda: make(*pit(0.5), 0, mu=5.0, anchor=SAME_FACET, **BOTTOM), STICK, VERTEX),
    "slip same facet": (lambda: make(WARPED, QUADS, -0.1, mu=0.3, anchor=SAME_FACET), SLIP, INTERIOR),
    "slip next facet": (lambda: make(WARPED, QUADS, -0.1, mu=0.3, anchor=NEXT_FACET), SLIP, INTERIOR),
    "slip deep": (lambda: make(WARPED, QUADS, -0.4, mu=0.1, anchor=NEXT_FACET), SLIP, INTERIOR),
    "slip shallow": (lambda: make(WARPED, QUADS, -1e-3, mu=0.3, anchor=SAME_FACET), SLIP, INTERIOR),
    "slip patch": (
        lambda: make(WARPED, QUADS, -0.1, PATCH, PATCH_WEIGHTS, mu=0.3, anchor=NEXT_FACET), SLIP, INTERIOR),
    "slip triangle": (lambda: make(WARPED, TRIS, -0.1, mu=0.3, anchor=NEXT_FACET), SLIP, INTERIOR),
    "slip valley edge": (
        lambda: make(sheet(0.1, 0.5), QUADS, 0, mu=0.1, anchor=SAME_FACET, **VALLEY), SLIP, EDGE),
    "slip pit vertex": (lambda: make(*pit(0.5), 0, mu=0.05, anchor=SAME_FACET, **BOTTOM), SLIP, VERTEX),
    "slip, mu falls": (lambda: make(WARPED, QUADS, -0.1, mu=FALLING, anchor=SAME_FACET), SLIP, INTERIOR),
    "slip, mu falls, valley edge": (
        lambda: make(sheet(0.1, 0.5), QUADS, 0, mu=FALLING, anchor=SAME_FACET, **VALLEY), SLIP, EDGE),
    "slip, shear limit": (lambda: make(WARPED, QUADS, -0.1, mu=CAPPED, anchor=NEXT_FACET), SLIP, INTERIOR),
    "slip, mu(p)": (lambda: make(WARPED, QUADS, -0.1, mu=BENT, anchor=SAME_FACET), SLIP, INTERIOR),
    "slip, mu(p), pit vertex": (
        lambda: make(*pit(0.5), 0, mu=BENT, anchor=SAME_FACET, **BOTTOM), SLIP, VERTEX),
    "slip, two directions": (lambda: make(WARPED, QUADS, -0.1, mu=GROOVED, anchor=NEXT_FACET), SLIP, INTERIOR),
    "slip, two directions, valley edge": (
        lambda: make(sheet(0.1, 0.5), QUADS, 0, mu=GROOVED, anchor=SAME_FACET, **VALLEY), SLIP, EDGE),
    "slip in tension": (
        lambda: make(WARPED, QUADS, 1e-2, mu=0.3, touch=0.02, anchor=SAME_FACET), SLIP, INTERIOR),
}  # fmt: skip
ALL = sorted(STATES)
TOUCHING = [name for name in ALL if STATES[name][1] != OPEN]
RUBBING = [name for name in ALL if STATES[name][1] in (STICK, SLIP)]


def build(name):
    make_pair, status, kind = STATES[name]
    pair = make_pair()
    r = pair.evaluate()
    assert (r["status"], r["kind"]) == (status, kind), name
    return pair, r


def taylor_orders(pair, r, direction, largest):
    remainders = []
    for i in range(4):
        h = largest / 2**i
        moved = pair.evaluate(pair.coords + h * direction, want_tangent=False)
        assert (moved["status"], moved["kind"], moved["facet"]) == (r["status"], r["kind"], r["facet"])
        remainders.append(np.linalg.norm(moved["R"] - r["R"] - h * r["K"] @ direction.ravel()))
    return np.array(remainders)


@pytest.mark.parametrize("name", ALL)
def test_taylor_remainder_is_of_second_order(name):
    pair, r = build(name)
    rng = np.random.default_rng(ALL.index(name))
    # stay clear of g = 0, where the status changes: the gap moves by no more than twice the step
    largest = 2e-3 if abs(r["gap"]) > 1e-2 or r["gap"] > 0 else 0.2 * abs(r["gap"])
    for _ in range(3):
        direction = rng.uniform(-1, 1, pair.coords.shape)
        remainders = taylor_orders(pair, r, direction, largest)
        if STATES[name][1] == OPEN:
            assert (remainders == 0).all() and not r["K"].any()
            continue
        if (r["status"], r["kind"]) == (CLOSED, VERTEX):  # T = eps_n (x_S - x_vertex) is linear
            assert remainders.max() < 1e-14  # rounding
            continue
        # the smallest remainder is far above rounding (1e-16 of forces of size 10), else the order means nothing
        assert remainders[-1] > 1e-11
        # third-order terms shift the order by about the step: 2e-3 times a curvature of up to 30 (large g)
        assert np.log2(remainders[:-1] / remainders[1:]).min() > 1.9
        # and the tangent's part is no small one: without it the order would be 1
        assert np.linalg.norm(largest * r["K"] @ direction.ravel()) > 5 * remainders[0]


PAPER = ["closed flat", "closed warped", "closed deep", "closed patch"]


@pytest.mark.parametrize("name", PAPER)
def test_tangent_is_the_papers_without_friction(name):
    """(26), eps_N (dg Dg + g Ddg), by (6), (8), the rates of xi beneath (10), and (12) with a plus before its last term."""
    pair, r = build(name)
    facet, _, _, xi, gap, normal = pair.project(pair.coords)
    corners, slave = pair.surface[0][facet[0]], pair.slaves[0][0]
    (s, t), g, n = xi[0], gap[0], normal[0]
    N = np.array([(1 - s) * (1 - t), (1 + s) * (1 - t), (1 + s) * (1 + t), (1 - s) * (1 + t)]) / 4
    N_a = np.array([[t - 1, 1 - t, 1 + t, -1 - t], [s - 1, -1 - s, 1 + s, 1 - s]]) / 4
    N_12 = np.array([1, -1, 1, -1]) / 4
    r_a, r_12 = N_a @ pair.coords[corners], N_12 @ pair.coords[corners]
    a, cross = r_a @ r_a.T, np.array([[0, 1], [1, 0]])
    H = a - g * (r_12 @ n) * cross

    def rates(v):
        """v_S - v_M, v_M,a, the rate of the foot and that of the normal, (6)."""
        jump, v_a = pair.slaves[1][0] @ v[slave] - N @ v[corners], N_a @ v[corners]
        foot = np.linalg.solve(H, r_a @ jump + g * v_a @ n)
        return jump, v_a, foot, -np.linalg.solve(a, (v_a + np.outer(cross @ foot, r_12)) @ n) @ r_a

    rng = np.random.default_rng(PAPER.index(name))
    for _ in range(5):
        d, D = rng.uniform(-1, 1, (2, *pair.coords.shape))
        (jump, v_a, foot, turn), (Jump, V_a, Foot, Turn) = rates(d), rates(D)
        twelve = -(Foot @ v_a + foot @ V_a + (Foot @ cross @ foot) * r_12) @ n + g * turn @ Turn
        ours = AREA * EPS_N * ((jump @ n) * (Jump @ n) + g * twelve)
        assert abs(d.ravel() @ r["K"] @ D.ravel() - ours) < 1e-11 * AREA * EPS_N  # the foot is found to 1e-12
        if "flat" not in name:  # the print's sign is another tangent
            assert abs(2 * g * g * turn @ Turn) > 1e-6


@pytest.mark.parametrize("name", [n for n in TOUCHING if STATES[n][2] == INTERIOR and "1e-9" not in n])
def test_taylor_with_a_multiplier(name):
    """Lifted to an open gap, the point presses by its multiplier as deep as before."""
    pair, r = build(name)
    lift = max(-2.0 * r["gap"], 0.05)
    pair.law[4][:] = -lift
    pair.coords[pair.slaves[0][0]] += lift * r["normal"]
    lifted = pair.evaluate()
    assert lifted["status"] == r["status"] and lifted["gap"] > 0.0
    rng = np.random.default_rng(ALL.index(name))
    # the gap with its multiplier stays below zero, and third-order terms small beside the distance to r's curvature
    largest = min(2e-3, 0.2 * abs(r["gap"]))
    remainders = taylor_orders(pair, lifted, rng.uniform(-1, 1, pair.coords.shape), largest)
    assert remainders[-1] > 1e-12  # rounding is 1e-16 of forces of size 10
    assert np.log2(remainders[:-1] / remainders[1:]).min() > 1.9


@pytest.mark.parametrize("share", [1.0, 0.25])
@pytest.mark.parametrize("name", [n for n in TOUCHING if STATES[n][1] == STICK and STATES[n][2] == INTERIOR])
def test_augmented_friction_adds_the_slip_to_the_elastic_one(name, share):
    """Uzawa: T_T' = T_T + eps_T P(n) (x_M - x_rest), or a share of that, whatever facet the new anchor lies on."""
    pair, r = build(name)
    rest = (np.array([[0, 1, 2, 3]]), np.array([[0.3, 0.3, 0.2, 0.2]]))
    pairs = (pair.coords, pair.slaves, pair.surface, pair.project(pair.coords), pair.anchors)
    *new, ways = element.anchors_since_rest(pairs, rest, pair.law, (share, 1.0))
    point = pair.slaves[1][0] @ pair.coords[pair.slaves[0][0]]
    foot = point - r["gap"] * r["normal"]
    moved = foot - rest[1][0] @ pair.coords[rest[0][0]]
    slip = moved - (moved @ r["normal"]) * r["normal"]
    np.testing.assert_allclose(ways[0, 0], np.linalg.norm(slip), rtol=1e-12)
    assert ways[0, 0] > 1e-3
    pair.anchors, pair.law = (
        tuple(new),
        (*pair.law[:2], coulomb(1e3), *pair.law[3:]),
    )  # a cone that holds the greater traction too
    after = pair.evaluate(want_tangent=False)
    assert after["status"] == STICK
    np.testing.assert_allclose(after["T"], r["T"] + share * EPS_T * slip, atol=1e-10 * EPS_T)  # round-off of the foot, 1e-12


@pytest.mark.parametrize("share", [1.0, 0.25])
@pytest.mark.parametrize(
    "name", [n for n in TOUCHING if STATES[n][1] == SLIP and STATES[n][2] == INTERIOR and "tension" not in n]
)
def test_augmented_friction_of_what_slips_is_taken_within_its_limit(name, share):
    """T_T^tr' = T_T^tr + share (T_T + eps_T s - T_T^tr): the multiplier beneath becomes what the point has, by a share."""
    pair, r = build(name)
    rest = (np.array([[0, 1, 2, 3]]), np.array([[0.3, 0.3, 0.2, 0.2]]))
    pairs, endless = (pair.coords, pair.slaves, pair.surface, pair.project(pair.coords), pair.anchors), coulomb(1e3)
    *new, ways = element.anchors_since_rest(pairs, rest, pair.law, (share, 1.0))
    across = np.eye(3) - np.outer(r["normal"], r["normal"])
    foot = pair.slaves[1][0] @ pair.coords[pair.slaves[0][0]] - r["gap"] * r["normal"]
    slip = across @ (foot - rest[1][0] @ pair.coords[rest[0][0]])
    way = across @ r["T"] / np.linalg.norm(across @ r["T"])
    np.testing.assert_allclose(ways[0, 2], np.linalg.norm(slip - max(slip @ way, 0.0) * way), rtol=1e-9)
    pair.law = (*pair.law[:2], endless, *pair.law[3:])
    trial = across @ pair.evaluate(want_tangent=False)["T"]
    pair.anchors = tuple(new)
    after = across @ pair.evaluate(want_tangent=False)["T"]
    expected = trial + share * (across @ r["T"] + EPS_T * slip - trial)
    np.testing.assert_allclose(after, expected, atol=1e-10 * EPS_T)  # round-off of the foot, 1e-12


@pytest.mark.parametrize("name", [n for n in ALL if STATES[n][1] == SLIP and "tension" not in n])
def test_taylor_when_the_slip_direction_turns(name):
    pair, r = build(name)
    slave = pair.slaves[0][0]
    tangential = r["T"] - (r["T"] @ r["normal"]) * r["normal"]
    direction = np.zeros_like(pair.coords)
    direction[slave] = np.cross(r["normal"], tangential / np.linalg.norm(tangential))
    largest = 2e-3 if abs(r["gap"]) > 1e-2 else 0.2 * abs(r["gap"])
    remainders = taylor_orders(pair, r, direction, largest)
    assert np.log2(remainders[:-1] / remainders[1:]).min() > 1.9


@pytest.mark.parametrize("name", [n for n in TOUCHING if STATES[n][1] == CLOSED])
def test_without_friction_the_tangent_is_symmetric(name):
    _, r = build(name)
    # entries are sums of products of size eps_n area = 15; at an edge they carry 1/g as well
    assert np.abs(r["K"] - r["K"].T).max() < 1e-13 * np.abs(r["K"]).max()


def test_in_slip_the_tangent_is_not_symmetric():
    _, r = build("slip same facet")
    assert np.abs(r["K"] - r["K"].T).max() > 0.05 * np.abs(r["K"]).max()  # the mu d|N| block


@pytest.mark.parametrize("name", TOUCHING)
def test_forces_and_moments_balance(name):
    pair, r = build(name)
    force = r["R"].reshape(-1, 3)
    scale = np.abs(force).max()
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * scale
    moment = np.cross(pair.coords, force).sum(axis=0)
    # T acts on the slave at x_S and back on the master at x_M, g n apart: friction leaves the moment g n x T of (14)
    left = AREA * r["gap"] * np.cross(r["normal"], r["T"])
    assert np.abs(moment - left).max() < 1e-13 * scale
    if STATES[name][1] == CLOSED:
        assert np.abs(moment).max() < 1e-13 * scale


@pytest.mark.parametrize("name", TOUCHING)
def test_a_translation_changes_no_force_and_a_rotation_turns_it(name):
    pair, r = build(name)
    Q, shift = rotation_about([1.0, 2.0, -0.4], 2.2), np.array([3.0, -2.0, 5.0])
    pair.up = Q @ pair.up
    groove = Q @ pair.law[2].along  # of a tool, that turns with it
    pair.law = *pair.law[:2], pair.law[2]._replace(along=tuple(map(float, groove))), *pair.law[3:]
    turned = pair.evaluate(pair.coords @ Q.T + shift)
    # coordinates of size 5 round at 1e-15, times eps_n 50
    assert np.abs(turned["T"] - Q @ r["T"]).max() < 2e-13
    assert turned["status"] == r["status"]
    assert np.abs(turned["K"] @ np.tile(np.eye(3), (len(pair.coords), 1))).max() < 1e-12  # no force from translation


def elastic_slip(pair, r, coords):
    """P(n) (x_M - x_a)."""
    way = pair.slaves[1][0] @ coords[pair.slaves[0][0]] - r["gap"] * r["normal"]
    way -= pair.anchors[1][0] @ coords[pair.anchors[0][0]]
    return way - (way @ r["normal"]) * r["normal"]


@pytest.mark.parametrize("name", RUBBING)
def test_laws_hold(name):
    pair, r = build(name)
    N = EPS_N * r["gap"]
    tangential = r["T"] - N * r["normal"]
    assert abs(tangential @ r["normal"]) < 1e-14 * EPS_N
    friction, limit = pair.law[2], pair.law[2].mu * max(-N, 0.0)
    if friction.exponent:
        limit *= (-N / friction.reference) ** friction.exponent
    if friction.shear:
        assert limit > friction.shear
        limit = friction.shear
    exact = 1e-14
    if friction is BENT:
        limit, exact = -N * (0.1 + 0.2 / (1.0 - N / 4.0)), 1e-10 * 5
    if friction is GROOVED:
        part = tangential @ GROOVED.along / np.linalg.norm(tangential)
        limit = -N / np.sqrt((part / 0.3) ** 2 + (1 - part**2) / 0.6**2)
    size, trial = np.linalg.norm(tangential), EPS_T * np.linalg.norm(elastic_slip(pair, r, pair.coords))
    if r["status"] == SLIP:
        assert abs(size - limit) < exact and trial > size
    else:
        assert 0.02 * limit < size < limit and abs(trial - size) < 1e-14 * EPS_T  # a real trial, not a zero one
    # elsewhere the foot, and with it the elastic slip, does not follow the slave; and without pressure no friction pulls
    if r["kind"] != INTERIOR or limit == 0.0:
        return
    # dissipation: pulling the slave along +T_T stretches the elastic slip (T_T grows with +g_T)
    slave = pair.slaves[0][0]
    ahead = pair.coords.copy()
    ahead[slave] += 1e-3 * tangential / max(size, 1e-300)
    assert EPS_T * np.linalg.norm(elastic_slip(pair, pair.evaluate(ahead), ahead)) >= trial


@pytest.mark.parametrize("name", TOUCHING)
def test_committing_changes_no_traction(name):
    pair, r = build(name)
    pair.commit()
    again = pair.evaluate()
    # slip comes back on its cone, stick exactly; the anchor's weights round at 1e-15, times eps_t 20
    assert np.abs(again["T"] - r["T"]).max() < 1e-13
    assert abs(pair.anchors[1].sum() - 1.0) < 1e-14


def test_a_batch_is_its_pairs_one_by_one():
    """Many points in one call, in an order that mixes states: nothing leaks from one pair into the next."""
    coords, nodes = pit(0.5)
    rng = np.random.default_rng(6)
    n_points = 60
    points = np.vstack([rng.uniform(-1.5, 1.5, (n_points - 20, 2)), rng.uniform(-0.2, 0.2, (20, 2))])
    depth = rng.uniform(-0.4, 0.1, n_points)
    points = np.column_stack([points, 0.5 * np.abs(points).max(axis=1) + depth])
    points[:10, 2] = -0.3
    points = points[rng.permutation(n_points)]
    single = []
    for i, p in enumerate(points):
        anchor = (nodes[i % 4], [0.3, 0.3, 0.2, 0.2]) if i % 3 else None
        single.append(make(coords, nodes, 0, at=p, tilt=False, mu=0.5, anchor=anchor))
    alone = [pair.evaluate() for pair in single]
    assert {(r["status"], r["kind"]) for r in alone} >= {
        (OPEN, NONE), (OPEN, INTERIOR), (CLOSED, INTERIOR), (STICK, INTERIOR), (SLIP, INTERIOR), (SLIP, EDGE)
    }  # fmt: skip

    first = len(coords)
    points = np.array([pair.coords[-1] for pair in single])  # make() may have rounded
    together = Pair(np.vstack([coords, points]), nodes, [first], mu=0.5)
    slaves = (
        np.arange(first, first + n_points)[:, None],
        np.ones((n_points, 1)),
        np.full(n_points, AREA),
        np.empty((0, 2, 1)),
    )
    anchors = tuple(np.concatenate([pair.anchors[i] for pair in single]) for i in (0, 1))
    law = (np.full(n_points, EPS_N), np.full(n_points, EPS_T), coulomb(0.5), 0.0, np.zeros(n_points))
    lists = (4 * np.arange(n_points + 1), np.tile(np.arange(4), n_points))
    ints = [np.zeros(n_points, np.int64) for _ in range(3)]
    projection = (*ints, np.zeros((n_points, 2)), np.zeros(n_points), np.zeros((n_points, 3)))
    up = np.tile(DOWN, (n_points, 1))
    closest_points(points, up, (together.coords, together.surface), lists, (5.0, 0.0), projection)
    R, K, status, T = evaluated(together.coords, slaves, together.surface, projection, anchors, law)
    tip = 3 * first
    for i, r in enumerate(alone):
        assert status[i] == r["status"] and np.array_equal(T[i], r["T"])
        mine = slice(tip + 3 * i, tip + 3 * i + 3)
        assert np.array_equal(R[mine], r["R"][tip:])
        assert np.array_equal(K[mine, mine], r["K"][tip:, tip:])
        assert np.array_equal(K[mine, :tip], r["K"][tip:, :tip]) and np.array_equal(K[:tip, mine], r["K"][:tip, tip:])
    # what the pairs share, the master, takes their sum: 60 terms of size 15
    assert np.abs(R[:tip] - sum(r["R"][:tip] for r in alone)).max() < 1e-12
    assert np.abs(K[:tip, :tip] - sum(r["K"][:tip, :tip] for r in alone)).max() < 1e-12


def test_sliding_is_the_way_of_the_anchor():
    pair = make(FLAT, QUADS, -0.1, tilt=False, mu=0.3, anchor=([0, 1, 2, 3], [0.25] * 4))
    trial = np.linalg.norm(pair.coords[-1, :2] - [0.5, 0.525])
    # flat and untilted: the way is the elastic slip minus its part within the cone
    assert abs(pair.commit() - (trial - 0.3 * EPS_N * 0.1 / EPS_T)) < 1e-14


def test_residual_alone_is_the_same_residual():
    for name in ALL:
        pair, r = build(name)
        assert np.array_equal(pair.evaluate(want_tangent=False)["R"], r["R"])


def test_a_point_without_partner_gives_zeros_and_forgets_its_anchor():
    pair = make(FLAT, QUADS, -0.1, mu=0.3, anchor=SAME_FACET, tilt=False)
    pair.coords[-1] = [40.0, 0.0, 0.0]
    r = pair.evaluate()
    assert r["kind"] == NONE and r["status"] == OPEN and not r["R"].any() and not r["K"].any() and np.isinf(r["gap"])
    pair.commit()
    assert (pair.anchors[0] == -1).all() and not pair.anchors[1].any()


# ---- history over many facets


def strip(n, rng):
    """n x 2 irregular flat facets, every third pair of triangles instead of a quad."""
    X, Y = np.meshgrid(np.arange(n + 1.0), np.arange(3.0), indexing="ij")
    coords = np.stack([X.ravel(), Y.ravel(), 0 * X.ravel()], axis=1)
    coords[:, :2] += rng.uniform(-0.3, 0.3, (len(coords), 2))
    nodes = []
    for i in range(n):
        for j in range(2):
            a, b, c, d = 3 * i + j, 3 * i + 3 + j, 3 * i + 4 + j, 3 * i + j + 1
            nodes += [[a, b, c, d]] if (i + j) % 3 else [[a, b, c, c], [a, c, d, d]]
    return coords, nodes


@pytest.mark.parametrize("step", [0.11, 0.73, 2.3])
def test_dragging_over_fifty_facets_under_constant_pressure(step):
    coords, nodes = strip(36, np.random.default_rng(1))
    Q = rotation_about([0.2, 0.9, -0.3], 0.8)
    pair = make(coords, nodes, 0, at=[0.5, 1.0, -0.02], tilt=False, mu=0.3)
    pair.coords, pair.up = np.ascontiguousarray(pair.coords @ Q.T), Q @ pair.up
    pair.commit()  # no anchor before the first contact: this sets it
    ahead = Q @ np.array([1.0, 0.0, 0.0])
    N, seen = EPS_N * 0.02, set()
    for _i in range(int(34.5 / step)):
        pair.coords[-1] += step * ahead
        r = pair.evaluate(want_tangent=False)
        seen.add(r["facet"])
        # the first step already exceeds the elastic slip mu N / eps_t = 0.015; coordinates of 35 and sums of them round
        # at some 1e-14, times eps_n = 50 in N; the number of steps is no factor in it
        assert r["status"] == SLIP
        assert np.abs(r["T"] - (-N * (Q @ [0, 0, 1.0]) + 0.3 * N * ahead)).max() < 1e-11
        pair.commit()
    if step == 0.11:
        assert len(seen) >= 50


def test_traction_is_continuous_where_stick_crosses_edges():
    """A soft eps_t keeps the point stuck over several facets, forth and back: T is linear in the way, facet or no."""
    coords, nodes = strip(10, np.random.default_rng(2))
    pair = make(coords, nodes, 0, at=[1.5, 1.03, -0.02], tilt=False, mu=300.0)
    pair.commit()
    start, seen = pair.coords[-1].copy(), set()
    for x in np.concatenate([np.linspace(0, 6, 301), np.linspace(6, 0, 101)]):
        pair.coords[-1] = start + [x, 0.3 * np.sin(x), 0]
        r = pair.evaluate(want_tangent=False)
        seen.add(r["facet"])
        assert r["status"] == STICK
        # eps_t 20 times the rounding of coordinates of size 10
        assert np.abs(r["T"] - [EPS_T * x, EPS_T * 0.3 * np.sin(x), -0.02 * EPS_N]).max() < 1e-12
        pair.commit()
    assert len(seen) > 6


def test_slip_then_reverse_over_an_edge_unloads_along_the_stick_slope():
    pair = make(FLAT, QUADS, 0, at=[0.8, 0.5, -0.1], tilt=False, mu=0.3)
    pair.commit()
    pair.coords[-1, 0] = 1.05
    assert pair.evaluate()["status"] == SLIP
    pair.commit()
    for x in np.linspace(1.04, 0.96, 9):
        pair.coords[-1, 0] = x
        r = pair.evaluate()
        assert r["status"] == STICK
        assert abs(r["T"][0] - (0.3 * EPS_N * 0.1 - EPS_T * (1.05 - x))) < 1e-13  # rounding times eps_t
        pair.commit()


@pytest.mark.parametrize("name", [n for n in RUBBING if "tension" not in n and "directions" not in n])
def test_a_full_turn_in_twenty_commits_changes_no_traction(name):
    pair, r = build(name)
    slipping = r["status"] == SLIP
    start, up = pair.coords.copy(), pair.up.copy()
    pair.commit()
    for i in range(1, 21):
        Q = rotation_about([0.5, 1.0, -0.7], 2 * np.pi * i / 20)
        pair.coords, pair.up = np.ascontiguousarray(start @ Q.T), Q @ up
        now = pair.evaluate()
        assert np.abs(now["T"] - Q @ r["T"]).max() < 1e-12  # 20 roundings of eps_t times coordinates of size 2
        assert slipping or now["status"] == STICK
        pair.commit()


# ---- compiled against plain Python


def all_numbers():
    """Residual, tangent, traction and new anchor of every state, in one vector."""
    numbers = []
    for name in ALL:
        pair, r = build(name)
        pair.commit()
        numbers += [r["R"], r["K"].ravel(), r["T"], pair.anchors[1].ravel(), pair.anchors[0].ravel()]
    return np.concatenate(numbers)


def test_compiled_equals_plain_python(tmp_path):
    """A process in which nothing is compiled, closest point included, gives the same numbers."""
    out = tmp_path / "plain.npy"
    code = (
        "import numpy, test_deformable_element as t; assert not hasattr(t.element.add_forces, 'py_func');"
        f"numpy.save({str(out)!r}, t.all_numbers())"
    )
    path = os.pathsep.join([os.path.dirname(__file__), *[p for p in sys.path if p]])
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    subprocess.run([sys.executable, "-c", code], check=True, env=plain)
    # same operations in the same order, no fastmath; a fused multiply-add or a hypot may differ in the last digit
    assert np.allclose(np.load(out), all_numbers(), rtol=1e-12, atol=1e-12)
