"""The element of slave points and a rigid tool: exact tangent in every status on every shape, and friction history."""

import os
import subprocess
import sys

import numpy as np
import pytest

from fenics_contact import coulomb
from fenics_contact.contact.friction import friction_of
from fenics_contact.contact.profiles import rigid_extrusion, rigid_revolution
from fenics_contact.contact.tools import rigid_sphere, rigid_torus, rigid_union
from fenics_contact.kernels import rigid_element as element
from fenics_contact.kernels.rigid_shapes import (
    BOX,
    CONE,
    CYLINDER,
    EXTRUSION,
    PLANE,
    REVOLUTION,
    SPHERE,
    TORUS,
    UNION,
)
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

pytestmark = pytest.mark.serial

EPS_N, EPS_T, BODY, SPACING = 50.0, 20.0, 5.0, 0.4
HALF = [2.0, 1.5, 1.0]
SHARP, ROUND, BALL = np.array([*HALF, 0.0]), np.array([*HALF, 0.6]), np.array([1.5, 0.0, 0.0, 0.0])
HOLLOW, RING = np.array([-1.5]), np.array([1.5, 0.5])
GROOVE = rigid_extrusion([(-3, 0), (-1, 0, 0.6), (-1, -3, 0.7), (1, -3, 0.7), (1, 0, 0.6), (3, 0)]).shape
GLAND = rigid_revolution([(1.0, 2.0), (1.0, -1.0, 0.7), (3.0, -1.0, 0.7), (3.0, 1.0, 0.6), (5.0, 1.0)]).shape
UNITED = rigid_union(rigid_sphere(9.0, (0, 0, 20)), rigid_torus(1.5, 0.5, (0, 0, 20), (0.6, 0, 0.8)),
                     rigid_torus(1.5, 0.5, (0, 0, 0), (0.6, 0.0, 0.8)))  # fmt: skip
POINTED, BLUNT = (np.array([tip, np.cos(1.0), np.sin(1.0), 0.0]) for tip in (0.0, 0.6))
# four Gauss points of a quadrilateral whose nodes run along the rows
GAUSS = np.array([[(1 + s * p) * (1 + t * q) / 4 for q in (-1, 1) for p in (-1, 1)]
                  for t in (-3**-0.5, 3**-0.5) for s in (-3**-0.5, 3**-0.5)])  # fmt: skip


def rotation_about(axis, angle):
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), a)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


class Tool:
    """A shape in tilted axes at an odd place."""

    def __init__(self, kind, shape, tilted=True):
        self.kind, self.shape, self.tilted = kind, shape, tilted
        self.axes = rotation_about([0.3, -0.8, 0.5], 1.1) if tilted else np.eye(3)
        self.origin = np.array([0.4, -1.1, 0.7]) if tilted else np.zeros(3)
        self.travel = np.array([0.02, 0.3, -0.1]) if tilted else np.zeros(3)

    def world(self, y):
        return np.asarray(y) @ self.axes.T + self.origin + self.travel


class Contact:
    """One element (k nodes among nine, nq points) and a tool; evaluates at any displacement and travel."""

    def __init__(self, tool, y, normal, k=1, mu=0.0, touch=0.0, elastic=(0.0, 0.0, 0.0), eps_t=EPS_T):
        rng = np.random.default_rng(2)
        self.tool, self.mu, self.touch, self.eps_t = tool, mu, touch, eps_t
        y = np.asarray(y, float)
        if k == 1:
            self.nodes, self.a, self.area = np.array([[4]], np.int32), np.ones((1, 1, 1)), np.array([[0.3]])
            corners = y[None, :]
        else:
            first = np.cross(normal, [0.2, 0.5, -0.7])
            first /= np.linalg.norm(first)
            second = np.cross(normal, first)
            corners = np.array([y + 0.02 * (p * first + q * second) for q in (-1, 1) for p in (-1, 1)])
            corners += 0.002 * rng.uniform(-1, 1, (4, 3))
            self.nodes, self.a = np.array([[5, 2, 7, 0]], np.int32), GAUSS[None].copy()
            self.area = np.array([[0.1, 0.07, 0.05, 0.08]])
        reference = rng.uniform(-1, 1, (9, 3))
        self.u = rng.uniform(-1, 1, (9, 3))
        self.u[self.nodes[0]] = tool.world(corners) - reference[self.nodes[0]]
        self.X = reference[self.nodes]
        self.travel = tool.travel.copy()
        self.judged = np.empty((0, 4))
        # anchors behind the projections: trial = eps_t * elastic slip
        self.anchor, self.shift = np.zeros((1, self.a.shape[1], 3)), np.zeros((1, self.a.shape[1]))
        self.anchor = self.commit(mu=0.0, touch=-np.inf)[0] - np.asarray(elastic, float)

    def _at(self, u, travel):
        points = self.X + u[self.nodes], self.a, self.area, np.array([SPACING])
        return points, (self.tool.kind, self.tool.shape, self.tool.origin, self.tool.axes, travel)

    def _law(self, mu, touch):
        return *(np.array([v]) for v in (EPS_N, self.eps_t, BODY)), friction_of(mu), float(touch), self.judged

    def evaluate(self, u=None, travel=None, want_tangent=True):
        """Everything the kernel fills, over outputs that started as NaN."""
        u, travel = (self.u if u is None else u), (self.travel if travel is None else travel)
        (_, nq, k), before = self.a.shape, self.anchor.copy()
        force, tangent = np.full((1, k, 3), np.nan), np.full((1, 3 * k, 3 * k), np.nan)
        T, gap, cover = np.full((1, nq, 3), np.nan), *(np.full((1, nq), np.nan) for _ in range(2))
        status = np.full((1, nq), -7, np.int32)
        rubbed = np.zeros((1, nq, 3, 5))
        law, out = self._law(self.mu, self.touch), (force, tangent, T, gap, status, cover, rubbed)
        history = self.anchor, self.shift
        element.contact_elements(*self._at(u, travel), law, history, want_tangent, out)
        assert np.array_equal(before, self.anchor)  # evaluation writes no history
        return {
            "force": force[0], "K": tangent[0], "T": T[0], "gap": gap[0], "status": status[0],
            "cover": cover[0], "normal": self.normals(u, travel), "rubbed": rubbed[0],
        }  # fmt: skip

    def normals(self, u, travel):
        normal = np.full((1, self.a.shape[1], 3), np.nan)
        element.point_normals(*self._at(u, travel), normal)
        return normal[0]

    def commit(self, mu=None, touch=None):
        """(new anchors, sliding); the caller decides whether to keep them."""
        new, sliding, before = np.full_like(self.anchor, np.nan), np.full(self.area.shape, np.nan), self.anchor.copy()
        mu, touch = (self.mu if mu is None else mu), (self.touch if touch is None else touch)
        at, history = self._at(self.u, self.travel), (self.anchor, self.shift)
        element.committed_anchors(*at, self._law(mu, touch), history, new, sliding)
        assert np.array_equal(before, self.anchor)
        return new, sliding[0]

    def accept(self):
        self.anchor, sliding = self.commit()
        return sliding


# ---- places: tool, point of its surface and outward normal there, tangent directions

S2, S3 = 0.5**0.5, 3**-0.5
CORE = np.array(HALF) - 0.6
ACROSS = np.array([0.8, -0.6, 0.0])
SIDE, OUT = (a * ACROSS + [0, 0, b] for a, b in ((np.sin(1.0), -np.cos(1.0)), (np.cos(1.0), np.sin(1.0))))  # of the cones
IN_TUBE = 0.8 * ACROSS + [0, 0, 0.6]  # normal of a torus there
INNER = -0.8 * ACROSS + [0, 0, 0.6]
TILTED = rigid_torus(1.5, 0.5, (0, 0, 0), (0.6, 0.0, 0.8)).axes
PLACES = {
    "plane": (PLANE, np.zeros(4), [0.2, -0.4, 0.0], [0, 0, 1]),
    "punch face": (BOX, SHARP, [0.7, -0.4, 1.0], [0, 0, 1]),
    "punch back": (BOX, SHARP, [0.7, -0.4, -1.0], [0, 0, -1]),
    "punch side": (BOX, SHARP, [0.7, -1.5, -0.05], [0, -1, 0]),
    "fillet face": (BOX, ROUND, [0.7, -0.4, 1.0], [0, 0, 1]),
    "fillet edge": (BOX, ROUND, [CORE[0] + 0.6 * S2, -0.4, CORE[2] + 0.6 * S2], [S2, 0, S2]),
    "fillet edge along z": (BOX, ROUND, [-CORE[0] - 0.36, CORE[1] + 0.48, 0.1], [-0.6, 0.8, 0]),
    "fillet corner": (BOX, ROUND, CORE * [1, -1, 1] + 0.6 * S3 * np.array([1, -1, 1]), [S3, -S3, S3]),
    "sharp edge": (BOX, SHARP, [2.2, 0.3, 1.0], [0, 0, 1]),
    "sharp edge, nearly out": (BOX, SHARP, [0.3, -1.8, 1.0], [0, 0, 1]),
    "sharp corner": (BOX, SHARP, [-2.2, -1.7, -1.0], [0, 0, -1]),
    "sharp edge outside": (BOX, SHARP, [2.6, 0.3, 1.0], [0, 0, 1]),
    "sphere": (SPHERE, BALL, 1.5 * np.array([0.48, -0.6, 0.64]), [0.48, -0.6, 0.64]),
    "cylinder": (CYLINDER, BALL, [0.9, -1.2, 4.0], [0.6, -0.8, 0]),
    "cone": (CONE, POINTED, 1.2 * SIDE, OUT),
    "cone near its apex": (CONE, POINTED, 0.3 * SIDE, OUT),
    "blunt cone": (CONE, BLUNT, 0.6 * OUT - [0, 0, 0.6] + 0.4 * SIDE, OUT),
    "blunt cone's tip": (
        CONE,
        BLUNT,
        0.6 * np.array([0.36, -0.2, 0.0]) + [0, 0, 0.6 * (0.8304**0.5 - 1)],
        [0.36, -0.2, 0.8304**0.5],
    ),
    "hollow ball": (SPHERE, HOLLOW, 1.5 * np.array([0.48, -0.6, 0.64]), [-0.48, 0.6, -0.64]),
    "bore": (CYLINDER, HOLLOW, [0.9, -1.2, 4.0], [-0.6, 0.8, 0]),
    "torus outside": (TORUS, RING, 1.5 * ACROSS + 0.5 * IN_TUBE, IN_TUBE),
    "torus inside": (TORUS, RING, 1.5 * ACROSS + 0.5 * INNER, INNER),
    "groove wall": (EXTRUSION, GROOVE, [-1.0, 2.0, -1.5], [1, 0, 0]),
    "groove corner": (EXTRUSION, GROOVE, [-0.3 - 0.42, 2.0, -2.3 - 0.56], [0.6, 0, 0.8]),
    "groove rim": (EXTRUSION, GROOVE, [1.6 - 0.36, 2.0, -0.6 + 0.48], [-0.6, 0, 0.8]),
    "gland floor": (REVOLUTION, GLAND, [1.6, -1.2, -1.0], [0, 0, 1]),
    "gland corner": (REVOLUTION, GLAND, [*(2.3 + 0.42) * ACROSS[:2], -0.3 - 0.56], [*(-0.6 * ACROSS[:2]), 0.8]),
    "gland rim": (REVOLUTION, GLAND, [*(3.6 - 0.36) * ACROSS[:2], 0.4 + 0.48], [*(-0.6 * ACROSS[:2]), 0.8]),
    "union": (UNION, UNITED.shape, TILTED @ (1.5 * ACROSS + 0.5 * IN_TUBE) - [0, 0, 20], TILTED @ IN_TUBE),
}
FLAT = ("plane", "punch face", "punch back", "punch side", "fillet face", "groove wall", "gland floor")
EDGES = ("sharp edge", "sharp edge, nearly out", "sharp corner")
LAWS = {"open": OPEN, "closed": CLOSED, "stick": STICK, "slip": SLIP, "falling": SLIP, "mu(p)": SLIP, "grooved": SLIP}
FALLING = coulomb(0.3, exponent=-1 / 3, reference=2.0, shear_limit=50.0)
BENT = coulomb(lambda p: 0.1 + 0.2 / (1.0 + p / 4.0), up_to=100.0)
GROOVED = coulomb(0.3, across=0.6, along=(1.0, 2.0, 0.5))  # in the tool's frame
OF_PRESSURE = {
    "falling": lambda p: 0.3 * (2.0 * p**2) ** (1 / 3),
    "mu(p)": lambda p: (0.1 + 0.2 / (1.0 + p / 4.0)) * p,
}
DEPTH = 0.1
CASES = [(p, law, k) for p in PLACES for law in LAWS for k in (1, 4) if p != "sharp edge outside" or law == "open"]
TOUCHING = [case for case in CASES if case[1] != "open"]
RUBBING = [case for case in CASES if case[1] in ("stick", "slip", "falling", "mu(p)", "grooved")]


def build(place, law, k, depth=DEPTH):
    kind, shape, y, normal = PLACES[place]
    normal = np.asarray(normal, float)
    across = np.cross(normal, [0.5, 0.3, -0.6])
    across /= np.linalg.norm(across)
    stuck = 200.0 if place in EDGES else 9.0
    mu = {"closed": 0.0, "stick": stuck, "falling": FALLING, "mu(p)": BENT, "grooved": GROOVED}.get(law, 0.3)
    at = np.asarray(y) + (0.3 * depth if law == "open" else -depth) * normal
    contact = Contact(Tool(kind, shape), at, normal, k, mu, elastic=0.2 * across)
    r = contact.evaluate()
    assert (r["status"] == LAWS[law]).all()
    assert ((r["cover"] < 1) == (place in EDGES)).all()
    return contact, r


def taylor(contact, r, du, dq, largest):
    """Remainders of the forces along displacements du (9, 3) and travel dq (3,), under halving of the step."""
    linear = r["K"] @ (du[contact.nodes[0]] - dq).ravel()  # a tool that travels is one from which all nodes go back
    remainders = []
    for i in range(4):
        h = largest / 2**i
        moved = contact.evaluate(contact.u + h * du, contact.travel + h * dq, want_tangent=False)
        assert np.array_equal(moved["status"], r["status"])
        remainders.append(np.linalg.norm((moved["force"] - r["force"]).ravel() - h * linear))
    return np.array(remainders), largest * np.linalg.norm(linear)


STEP = 1e-3  # against the depth 0.1, the distances 0.1 to the ends of the edge zone and the curvature 1/0.5


def check_order(remainders, linear, is_linear):
    if is_linear:
        assert remainders.max() < 1e-13 * 10  # rounding of forces of size 10
        return
    # far above rounding (1e-15), else the order means nothing; third-order terms shift it by a few STEP / length
    assert remainders[-1] > 1e-12
    assert np.log2(remainders[:-1] / remainders[1:]).min() > 1.9
    assert linear > 5 * remainders[0]  # without the tangent the order would be 1


@pytest.mark.parametrize(("place", "law", "k"), CASES)
@pytest.mark.parametrize("what", ["u", "travel", "both"])
def test_taylor_remainder_is_of_second_order(place, law, k, what):
    contact, r = build(place, law, k)
    rng = np.random.default_rng(CASES.index((place, law, k)))
    for _ in range(2):
        du = rng.uniform(-1, 1, (9, 3)) * (what != "travel")
        dq = rng.uniform(-1, 1, 3) * (what != "u")
        remainders, linear = taylor(contact, r, du, dq, STEP)
        if law == "open":
            assert (remainders == 0).all() and not r["force"].any() and not r["K"].any()
        else:
            check_order(remainders, linear, place in FLAT and law in ("closed", "stick"))


def with_multiplier(place, law, k):
    """The same press and elastic slip as `build`'s, but nearly all of it carried by a multiplier, across an open gap."""
    contact, _ = build(place, law, k)
    lift = 1.4 * DEPTH
    contact.shift[:] = -lift
    contact.u[contact.nodes[0]] += lift * contact.tool.axes @ np.asarray(PLACES[place][3], float)
    r = contact.evaluate()
    assert (r["status"] == LAWS[law]).all() and (r["gap"] > 0.0).all()
    return contact, r


@pytest.mark.parametrize(("place", "law", "k"), TOUCHING)
def test_taylor_with_a_multiplier(place, law, k):
    contact, r = with_multiplier(place, law, k)
    rng = np.random.default_rng(CASES.index((place, law, k)))
    remainders, linear = taylor(contact, r, rng.uniform(-1, 1, (9, 3)), rng.uniform(-1, 1, 3), STEP)
    check_order(remainders, linear, place in FLAT and law in ("closed", "stick"))


@pytest.mark.parametrize(("place", "law", "k"), [c for c in TOUCHING if c[0] in FLAT])
def test_a_multiplier_presses_like_a_gap(place, law, k):
    _, plain = build(place, law, k)
    _, lifted = with_multiplier(place, law, k)
    np.testing.assert_allclose(lifted["T"], plain["T"], rtol=1e-12)  # round-off of the places


@pytest.mark.parametrize(("place", "law", "k"), [c for c in CASES if c[1] in ("slip", "falling")])
def test_taylor_when_the_slip_direction_turns(place, law, k):
    contact, r = build(place, law, k)
    n, T = r["normal"][0], r["T"][0]
    sideways = np.cross(n, T / np.linalg.norm(T))
    du = np.tile(sideways, (9, 1))
    remainders, linear = taylor(contact, r, du, np.zeros(3), STEP)
    check_order(remainders, linear, False)


@pytest.mark.parametrize(("place", "law", "k"), [c for c in CASES if c[1] in ("closed", "stick")])
def test_tangent_is_symmetric_where_it_has_a_potential(place, law, k):
    """Without friction everywhere but at sharp edges; in stick on flat faces, where the anchor is one more spring."""
    _, r = build(place, law, k)
    skew = np.abs(r["K"] - r["K"].T).max() / np.abs(r["K"]).max()
    if place in EDGES:
        assert skew > 1e-2  # the penalty's gradient
    elif law == "closed" or place in FLAT:
        assert skew < 1e-14  # sums of rounded products


@pytest.mark.parametrize("k", [1, 4])
def test_in_slip_the_tangent_is_not_symmetric(k):
    _, r = build("plane", "slip", k)
    assert np.abs(r["K"] - r["K"].T).max() > 0.05 * np.abs(r["K"]).max()  # the mu d|N| block


@pytest.mark.parametrize(("place", "law", "k"), TOUCHING)
def test_laws_hold(place, law, k):
    contact, r = build(place, law, k)
    eps = EPS_N * r["cover"]
    N = np.einsum("qc,qc->q", r["T"], r["normal"])
    assert np.abs(N - eps * r["gap"]).max() < 1e-13  # rounding of a pressure of 5
    along = r["T"] - N[:, None] * r["normal"]
    tangential, pressure = np.linalg.norm(along, axis=1), -eps * r["gap"]
    if law in OF_PRESSURE:
        limit, exact = OF_PRESSURE[law](pressure), 1e-10 * 5 if law == "mu(p)" else 1e-13
    elif law == "grooved":
        part = along @ contact.tool.axes @ GROOVED.along / tangential
        limit, exact = pressure / np.sqrt((part / 0.3) ** 2 + (1 - part**2) / 0.6**2), 1e-13
    else:
        limit, exact = contact.mu * pressure, 1e-13
    if law == "closed":
        assert tangential.max() < 1e-13
    elif LAWS[law] == SLIP:
        assert np.abs(tangential - limit).max() < exact
    else:
        assert (1e-3 * limit < tangential).all() and (tangential < limit).all()
    # the forces are the weighted tractions
    expected = np.einsum("q,qk,qc->kc", contact.area[0], contact.a[0], r["T"])
    assert np.abs(r["force"] - expected).max() < 1e-14 * 10  # sums of rounded products of size 1


@pytest.mark.parametrize(("place", "law", "k"), TOUCHING)
def test_moving_the_tool_back_is_moving_the_nodes(place, law, k):
    contact, r = build(place, law, k)
    shift = np.array([0.01, -0.02, 0.013])
    a = contact.evaluate(contact.u + shift)
    b = contact.evaluate(contact.u, contact.travel - shift)
    # coordinates of size 2 round at 4e-16, times eps_n 50
    assert np.abs(a["force"] - b["force"]).max() < 1e-13 and np.abs(a["force"] - r["force"]).max() > 1e-5


@pytest.mark.parametrize("law", ["closed", "stick"])
@pytest.mark.parametrize("shape", [POINTED, BLUNT])
def test_a_cones_apex_presses_straight_on(law, shape):
    """A point on the axis: depth and force along it, a tangent that is exact for what happens on the axis."""
    contact = Contact(Tool(CONE, shape), [0, 0, -DEPTH], [0, 0, 1.0], mu=0.0 if law == "closed" else 0.3)
    r, axis = contact.evaluate(), contact.tool.axes[:, 2]
    assert (r["status"] == LAWS[law]).all()
    assert np.abs(r["T"][0] + EPS_N * DEPTH * axis).max() < 1e-13  # rounding of a pressure of 5
    du = np.zeros((9, 3))
    du[4] = axis
    for dq in (np.zeros(3), 0.7 * axis):
        remainders, linear = taylor(contact, r, du, dq, STEP)
        assert remainders.max() < 1e-13 and linear > 1e-4


def test_residual_alone_is_the_same_residual():
    for case in CASES:
        contact, r = build(*case)
        assert np.array_equal(contact.evaluate(want_tangent=False)["force"], r["force"])


def test_the_sharp_edge_lets_go_smoothly():
    """A point at constant depth, dragged out under the edge: its force falls to nothing without a jump or a kink."""
    way = np.linspace(-0.1, 1.1, 1201)
    pressure = []
    for t in way:
        contact = Contact(Tool(BOX, SHARP), [2.0 + t * SPACING, 0.3, 0.9], [0, 0, 1.0])
        pressure.append(np.linalg.norm(contact.evaluate(want_tangent=False)["T"][0]))
    pressure = np.array(pressure)
    # rounding at the ends; EPS_N / BODY = 10 makes the slope of the series springs at most 9.1 * 1.5 per spacing
    assert np.abs(pressure[way <= 0] - EPS_N * 0.1).max() < 1e-13 and pressure[way > 1].max() < 1e-13
    assert (np.diff(pressure) <= 1e-13).all() and np.abs(np.diff(pressure)).max() < 5 * 15 * 1e-3
    # series of the penalty and the body's spring at half cover
    half = np.searchsorted(way, 0.5)
    assert abs(pressure[half] - 0.1 * 0.5 / (0.5 / EPS_N + 0.5 / BODY)) < 5e-3  # way[half] is 0.5 to 1e-3 spacings


def test_touch_counts_round_off_gaps_as_closed():
    contact = Contact(Tool(PLANE, np.zeros(4)), [0, 0, 1e-9], [0, 0, 1.0], touch=1e-8)
    r = contact.evaluate()
    assert r["status"][0] == CLOSED and r["K"].any()
    contact.touch = 0.0
    assert contact.evaluate()["status"][0] == OPEN


# ---- history


@pytest.mark.parametrize(("place", "law", "k"), RUBBING)
def test_committing_changes_no_traction(place, law, k):
    contact, r = build(place, law, k)
    anchor = contact.anchor.copy()
    sliding = contact.accept()
    again = contact.evaluate()
    # the anchor is rebuilt by a subtraction of coordinates of size 2: 4e-16 times eps_t 20
    assert np.abs(again["T"] - r["T"]).max() < 1e-13
    if law == "stick":
        assert np.array_equal(contact.anchor, anchor) and not sliding.any()
    else:
        # slips by what exceeds the cone, in the tool's frame; a point that slid stays on its cone
        assert np.abs(sliding - np.linalg.norm(contact.anchor[0] - anchor[0], axis=1)).max() < 1e-15 * 4
        assert (sliding > 0).all() and (again["status"] == SLIP).all()
    twice, more = contact.commit()
    assert np.abs(twice - contact.anchor).max() < 1e-14 and more.max() < 1e-14  # a second commit finds nothing to do


@pytest.mark.parametrize("k", [1, 4])
@pytest.mark.parametrize("kind, shape, y", [(SPHERE, BALL, [0.9, 0.4, 1.3]), (BOX, SHARP, [2.1, 0.2, 1.1]),
                                            (BOX, SHARP, [0.3, 0.2, 0.95])])  # fmt: skip
def test_slips_lead_along_the_tool_to_where_open_points_are_anchored(kind, shape, y, k):
    tool = Tool(kind, shape)
    contact = Contact(tool, y, np.array([0.0, 0.0, 1.0]), k)
    rests, slips = contact.anchor - np.array([0.1, -0.2, 0.3]), np.full_like(contact.anchor, np.nan)
    element.slips_from(*contact._at(contact.u, contact.travel), rests, slips)
    way, n = contact.commit(touch=-np.inf)[0] - rests, contact.normals(contact.u, contact.travel) @ tool.axes
    expected = way - np.einsum("eqc,qc->eq", way, n)[..., None] * n
    np.testing.assert_allclose(slips, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("k", [1, 4])
def test_an_open_point_is_anchored_where_it_will_land(k):
    contact, _ = build("sphere", "open", k)
    contact.accept()
    r = contact.evaluate()
    contact.u -= 0.5 * r["normal"][0]  # straight down by more than the gap
    landed = contact.evaluate()
    assert (landed["status"] == STICK).all()
    if k == 1:
        # no tangential motion, no friction: rounding times eps_t
        assert np.abs(np.cross(landed["T"][0], landed["normal"][0])).max() < 1e-13


# beside a sharp box, more than a spacing from its edges: where a point comes from, where it is held, by which axis' face
COMING_IN = [
    ([2.5, 0.3, 1.05], [2.2, 0.3, 0.9], 2),
    ([2.9, 0.3, 0.3], [2.2, 0.2, 0.9], 2),  # from beside the box
    ([0.3, -2.3, 0.95], [0.5, -1.6, 0.9], 2),
    ([0.3, -2.3, 0.95], [0.5, -1.2, 0.9], 2),
    ([-2.7, -2.1, 1.0], [-2.2, -1.7, 0.9], 2),  # a corner
    ([-2.7, 0.1, -1.0], [-2.3, 0.1, -0.9], 2),
    ([2.5, 0.3, 0.35], [1.9, 0.5, 0.45], 0),
    ([0.3, -2.0, 0.35], [0.1, -1.4, 0.45], 1),
]


@pytest.mark.parametrize(("start", "end", "axis"), COMING_IN)
def test_a_point_that_comes_in_under_a_sharp_edge_rubs_along_its_way(start, end, axis):
    """From the closest point of the box, on its edge, a way leads outwards to the face that goes on beyond it."""
    tool, along = Tool(BOX, SHARP), np.arange(3) != axis
    contact = Contact(tool, start, [0, 0, 1.0], mu=0.05)
    assert (contact.evaluate()["status"] == OPEN).all()
    contact.accept()
    contact.u[contact.nodes[0]] += tool.axes @ np.subtract(end, start)
    r = contact.evaluate()
    way = np.where(along, np.subtract(end, start), 0.0)
    T = tool.axes.T @ r["T"][0]
    assert r["status"][0] == SLIP and abs(np.abs(T[axis]) - np.abs(r["normal"][0] @ r["T"][0])) < 1e-13
    size = 0.05 * abs(T[axis])
    # rounding of coordinates of size 2, times eps_t 20
    np.testing.assert_allclose(T[along], size * way[along] / np.linalg.norm(way), atol=1e-13)
    remainders, linear = taylor(contact, r, np.random.default_rng(1).uniform(-1, 1, (9, 3)), np.zeros(3), STEP)
    check_order(remainders, linear, False)
    assert contact.accept()[0] == pytest.approx(np.linalg.norm(way) - size / EPS_T, rel=1e-12)
    assert np.abs(contact.evaluate()["T"] - r["T"]).max() < 1e-13


def curve(s):
    """A closed curve of the plane with turns and a crossing, of size one."""
    return np.array([np.cos(s) - 1 + 0.3 * np.sin(2 * s), 0.8 * np.sin(s) - 0.25 * np.sin(3 * s)])


@pytest.mark.parametrize("eps_t", [0.5, 20.0, 1e5])
@pytest.mark.parametrize("steps", [12, 97, 1000])
@pytest.mark.parametrize("moved", ["node", "tool"])
def test_friction_is_mu_N_along_a_curved_path(eps_t, steps, moved):
    mu, tool = 0.3, Tool(PLANE, np.zeros(4))
    contact = Contact(tool, [0.2, -0.4, -0.02], [0, 0, 1.0], mu=mu, eps_t=eps_t)
    u, travel, sliding, slipping = contact.u.copy(), contact.travel.copy(), 0.0, 0
    last = np.zeros(2)
    for s in np.linspace(0, 4 * np.pi, steps + 1)[1:]:
        depth = 0.02 + 0.01 * np.sin(3 * s)  # the normal force varies along the way
        shift = tool.axes @ [*curve(s), 0.02 - depth]
        if moved == "node":
            contact.u = u + shift
        else:
            contact.travel = travel - shift
        r = contact.evaluate(want_tangent=False)
        T = tool.axes.T @ r["T"][0]
        N = EPS_N * depth
        assert abs(T[2] + N) < 1e-12  # rounding of coordinates times eps_n
        size = np.linalg.norm(T[:2])
        assert size <= mu * N * (1 + 1e-12)
        if r["status"][0] == SLIP:
            slipping += 1
            assert abs(size - mu * N) < 1e-14  # the return is exact, whatever eps_t and the step
        chord = curve(s) - last
        if eps_t == 1e5:
            # elastic slip 1e5 times shorter than a step: friction follows the chord, against the tool's motion
            assert T[:2] @ chord > (1 - 1e-4) * size * np.linalg.norm(chord)
        last = curve(s)
        sliding += contact.accept()[0]
    # where the way to the cone is short (0.45 / eps_t) nearly all steps slip; turns of a soft spring may stick
    assert slipping >= (0.99 if eps_t == 1e5 else 0.5 if eps_t == 20.0 else 0.05) * steps
    if eps_t == 1e5:
        points = np.array([curve(s) for s in np.linspace(0, 4 * np.pi, steps + 1)])
        way = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert abs(sliding - way) < 1e-4 * way  # elastic slips of at most 5e-6 per step


@pytest.mark.parametrize("place", ["sphere", "cylinder", "fillet edge", "cone", "blunt cone's tip"])
@pytest.mark.parametrize("steps", [15, 300])
def test_friction_is_mu_N_on_curved_tools(place, steps):
    """The tool circles under the node in its tangent plane: depth, normal and the elastic slip's plane change."""
    contact, r = build(place, "slip", 1)
    n = r["normal"][0]
    first = np.cross(n, [0.2, 0.5, -0.7])
    first /= np.linalg.norm(first)
    second, travel, slipping = np.cross(n, first), contact.travel.copy(), 0
    for s in np.linspace(0, 2 * np.pi, steps + 1)[1:]:
        contact.travel = travel + 0.15 * (np.sin(s) * first + (1 - np.cos(s)) * second)
        r = contact.evaluate(want_tangent=False)
        contact.accept()
        if r["status"][0] == OPEN:
            continue
        N = r["T"][0] @ r["normal"][0]
        size = np.linalg.norm(r["T"][0] - N * r["normal"][0])
        assert abs(N - EPS_N * r["gap"][0]) < 1e-13 and size <= 0.3 * -N + 1e-13
        if r["status"][0] == SLIP:
            slipping += 1
            assert abs(size - 0.3 * -N) < 1e-13  # rounding of pressures of size 5
    assert slipping > 0.5 * steps


@pytest.mark.parametrize("eps_t", [2.0, 200.0])
@pytest.mark.parametrize("steps", [7, 50])
def test_hysteresis_loop_of_width_two_mu_N(eps_t, steps):
    mu, depth, tool = 0.4, 0.1, Tool(PLANE, np.zeros(4), tilted=False)
    contact = Contact(tool, [0, 0, -depth], [0, 0, 1.0], mu=mu, eps_t=eps_t)
    u, N, seen = contact.u.copy(), EPS_N * depth, []
    reach = 3 * mu * N / eps_t
    way = reach * np.concatenate([np.linspace(0, 1, steps), *2 * [np.linspace(1, -1, steps), np.linspace(-1, 1, steps)]])
    for x in way:
        contact.u = u + [x, 0, 0]
        seen.append(contact.evaluate(want_tangent=False)["T"][0, 0])
        contact.accept()
    seen = np.array(seen)
    # exact returns; the spring between them is linear
    assert abs(seen.max() - mu * N) < 1e-13 and abs(seen.min() + mu * N) < 1e-13
    loop, x = seen[-2 * steps :], way[-2 * steps :]
    forth, back = loop[steps:], loop[:steps]
    # backwards the force falls from mu N with slope eps_t to -mu N; forwards it is the mirror image
    assert np.abs(back - np.maximum(mu * N - eps_t * (reach - x[:steps]), -mu * N)).max() < 1e-12
    assert np.abs(forth + back).max() < 1e-12


def test_a_step_cut_back_is_the_small_step():
    """Trials that are thrown away leave no trace: history changes by committing alone."""
    kept, direct = (build("cylinder", "slip", 4)[0] for _ in range(2))
    rng = np.random.default_rng(0)
    step = 0.02 * rng.uniform(-1, 1, 3)
    for factor in (8.0, -3.0, 2.0):
        kept.evaluate(kept.u + factor * step)
    for contact in (kept, direct):
        contact.u = contact.u + step
        contact.accept()
    assert np.array_equal(kept.anchor, direct.anchor)


def test_a_batch_is_its_elements_one_by_one():
    """Many nodes in one call: nothing leaks from one element's scratch arrays into the next."""
    rng = np.random.default_rng(4)
    y = np.array([1.0, 0.8, 0.1]) * rng.choice([-1, 1], (80, 3)) * [1.9, 1.7, 9.8] * rng.uniform(0.9, 1.1, (80, 3))
    single = [Contact(Tool(BOX, SHARP), p, [0, 0, 1.0], mu=0.3, elastic=[0.03, -0.02, 0.01]) for p in y]
    alone = [contact.evaluate() for contact in single]
    assert {int(r["status"][0]) for r in alone} == {OPEN, STICK, SLIP}
    assert any(0 < r["cover"][0] < 1 for r in alone)
    tool, ne = single[0].tool, len(y)
    X, u = np.concatenate([c.X for c in single]), np.concatenate([c.u[4:5] for c in single])
    nodes, a, area = np.arange(ne, dtype=np.int32)[:, None], np.ones((ne, 1, 1)), np.full((ne, 1), 0.3)
    history = np.concatenate([c.anchor for c in single]), np.zeros((ne, 1))
    eps_n, eps_t, body, spacing = (np.full(ne, v) for v in (EPS_N, EPS_T, BODY, SPACING))
    force, tangent = np.full((ne, 1, 3), np.nan), np.full((ne, 3, 3), np.nan)
    T, gap, cover = np.zeros((ne, 1, 3)), *(np.zeros((ne, 1)) for _ in range(2))
    status = np.zeros((ne, 1), np.int32)
    placed = tool.kind, tool.shape, tool.origin, tool.axes, tool.travel
    points, law = (X + u[nodes], a, area, spacing), (eps_n, eps_t, body, coulomb(0.3), 0.0, np.empty((0, 4)))
    out = force, tangent, T, gap, status, cover, np.zeros((ne, 1, 3, 5))
    element.contact_elements(points, placed, law, history, True, out)
    for e, r in enumerate(alone):
        assert status[e, 0] == r["status"][0] and gap[e, 0] == r["gap"][0] and cover[e, 0] == r["cover"][0]
        assert np.array_equal(force[e], r["force"]) and np.array_equal(tangent[e], r["K"])
        assert np.array_equal(T[e], r["T"])


def test_pressures_that_a_solve_starts_from():
    """They decide the status and enter the tangent; the force is linear in the gap, so that a solve mends what they miss."""
    tool, n, elastic, eps_t = Tool(*PLACES["plane"][:2]), np.array([0.0, 0.0, 1.0]), (2e-3, 0.0, 0.0), EPS_N
    for depth, status in ((0.1, STICK), (1e-3, SLIP)):
        held = Contact(tool, (0.1, 0.2, 1e-4), n, mu=0.3, elastic=elastic, eps_t=eps_t)  # open, 1e-4 in front of the plane
        held.judged = np.array([[-depth, *elastic]])
        there = Contact(tool, (0.1, 0.2, -depth), n, mu=0.3, elastic=elastic, eps_t=eps_t)
        loose, meant = held.evaluate(), there.evaluate()
        assert loose["status"][0] == meant["status"][0] == status
        np.testing.assert_allclose(loose["K"], meant["K"], rtol=0, atol=1e-12 * np.abs(meant["K"]).max())
        moved = held.evaluate(want_tangent=False)["force"][0] + loose["K"] @ (
            -(1e-4 + depth) * tool.axes[:, 2]
        )  # to where that pressure is the gap's
        np.testing.assert_allclose(moved, meant["force"][0], rtol=0, atol=1e-10 * np.abs(meant["force"]).max())


LIMIT = 0.3 * EPS_N * 0.1 / EPS_T  # way at which a point at a depth of 0.1 slips under mu = 0.3


def rubbed_at(elastic, foreseen):
    """A point at that depth in a flat tool, with its way of friction and the foreseen one in the plane; what it does there,
    its friction in the tool's axes."""
    point = Contact(Tool(*PLACES["plane"][:2]), (0.1, 0.2, -0.1), np.array([0.0, 0.0, 1.0]), mu=0.3, elastic=(*elastic, 0.0))
    point.judged = np.array([[-0.1, *foreseen, 0.0]])
    result = point.evaluate()
    return point, result, (result["T"][0] @ point.tool.axes)[:2]


@pytest.mark.parametrize(
    "elastic, foreseen, status",
    [
        ((0.5, 0.0), (2.0, 0.0), SLIP),  # within the cone, but the solve foresaw more than it can hold
        ((2.0, 0.0), (0.5, 0.0), STICK),  # beyond it, as a tool that turns leaves points off the tangents of its circles
        ((-0.5, 0.0), (2.0, 0.0), STICK),  # before it slides that way it sticks
        ((1.5, 1.5), (2.0, 0.0), SLIP),
        ((0.2, 1.5), (2.0, 0.0), SLIP),
    ],
)
def test_ways_that_a_solve_foresaw_decide(elastic, foreseen, status):
    elastic, foreseen = (LIMIT * np.array(way) for way in (elastic, foreseen))
    _, result, friction = rubbed_at(elastic, foreseen)
    assert result["status"][0] == status
    if status == STICK:
        np.testing.assert_allclose(friction, EPS_T * elastic, rtol=0, atol=1e-12)
    else:  # by its own way, where this does not lead far aside
        along = elastic if elastic @ foreseen > 0.4 * np.linalg.norm(elastic) * np.linalg.norm(foreseen) else foreseen
        np.testing.assert_allclose(friction, EPS_T * LIMIT * along / np.linalg.norm(along), rtol=0, atol=1e-12)


@pytest.mark.parametrize("elastic", [(0.5, 0.2), (1.5, 1.2)], ids=["stick", "slip"])
def test_rates_of_friction_that_foretell_it(elastic):
    """With gap and way, against differences of the friction that nothing foretells."""
    elastic, normal, h = LIMIT * np.array([*elastic, 0.0]), np.array([0.0, 0.0, 1.0]), 1e-6
    tool = Tool(*PLACES["plane"][:2])

    def friction(depth, way):
        result = Contact(tool, (0.1, 0.2, -depth), normal, mu=0.3, elastic=way).evaluate()
        return (result["T"][0] @ tool.axes) * [1.0, 1.0, 0.0], result["rubbed"][0]

    at, rubbed = friction(0.1, elastic)
    np.testing.assert_allclose(rubbed[:, 0], at, rtol=0, atol=1e-12)
    deeper = (friction(0.1 - h, elastic)[0] - friction(0.1 + h, elastic)[0]) / (2 * h)
    np.testing.assert_allclose(rubbed[:, 1], deeper, rtol=0, atol=1e-7)
    for axis in range(2):
        step = h * np.eye(3)[axis]
        further = (friction(0.1, elastic + step)[0] - friction(0.1, elastic - step)[0]) / (2 * h)
        np.testing.assert_allclose(rubbed[:, 2 + axis], further, rtol=0, atol=1e-7)


# ---- compiled against plain Python


def all_numbers():
    """Forces, tangents, tractions, covers, normals and new anchors of every case, in one vector."""
    numbers = []
    for case in CASES:
        contact, r = build(*case)
        new, sliding = contact.commit()
        numbers += [r[key].ravel() for key in ("force", "K", "T", "gap", "cover", "normal")]
        numbers += [new.ravel(), sliding]
    return np.concatenate(numbers)


def test_compiled_equals_plain_python(tmp_path):
    """A process in which nothing is compiled gives the same numbers."""
    out = tmp_path / "plain.npy"
    code = (
        "import numpy, test_rigid_element as t; assert not hasattr(t.element.contact_elements, 'py_func');"
        f"numpy.save({str(out)!r}, t.all_numbers())"
    )
    path = os.pathsep.join([os.path.dirname(__file__), *[p for p in sys.path if p]])
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    subprocess.run([sys.executable, "-c", code], check=True, env=plain)
    # same operations in the same order, no fastmath; a fused multiply-add or a hypot may differ in the last digit
    assert np.allclose(np.load(out), all_numbers(), rtol=1e-12, atol=1e-12)
