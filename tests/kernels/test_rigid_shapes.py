"""The analytic rigid shapes: distance, normal and curvature agree with each other and with a plain closest point."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fenics_contact.contact.profiles import rigid_extrusion, rigid_revolution
from fenics_contact.contact.tools import rigid_cone, rigid_cylinder, rigid_plane, rigid_punch, rigid_sphere, rigid_union
from fenics_contact.kernels.rigid_profiles import ARC, PIECE
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
    edge_cover,
    face_distance,
    meets_face,
    signed_distance,
)
from fenics_contact.output.tool_surfaces import profile_line

pytestmark = pytest.mark.serial

HALF = np.array([2.0, 1.5, 1.0])
SHARP = np.array([*HALF, 0.0])
ROUND = np.array([*HALF, 0.4])
BALL = np.array([1.3, 0.0, 0.0, 0.0])
HALF_ANGLE = 1.0
POINTED = np.array([0.0, np.cos(HALF_ANGLE), np.sin(HALF_ANGLE), 0.0])
BLUNT = np.array([0.4, np.cos(HALF_ANGLE), np.sin(HALF_ANGLE), 0.0])
HOLLOW = np.array([-1.3])
RING = np.array([1.5, 0.4])
# a groove with a flat bottom, a round rim and one wall that leans; a turned one, in a plate that starts on the axis
GROOVE = rigid_extrusion([(-3, 0), (-1, 0, 0.3), (-0.8, -2, 0.5), (1, -2, 0.6), (1, 0, 0.4), (3, 0)])
GLAND = rigid_revolution([(0, 0), (1.4, 0, 0.3), (1.5, -1.2, 0.4), (2.6, -1.2, 0.5), (2.6, 0), (4, 0.5)])
PLUG = rigid_revolution([(0, 1.0, 0.3), (1.1, 0.4, 0.2), (1.2, -1.0), (0, -1.0)])
WEDGE = rigid_extrusion([(-1, -2), (-1, 0.5), (1, 0.0, 0.2), (1, -2)], closed=True)
PROFILES = {"groove": GROOVE, "gland": GLAND, "plug": PLUG, "wedge": WEDGE}

# name: kind, parameters, a point, number of curved directions of the surface through it
PLACES = {
    "plane outside": (PLANE, np.zeros(4), [0.3, -0.2, 0.4], 0),
    "plane inside": (PLANE, np.zeros(4), [0.3, -0.2, -0.4], 0),
    "sharp box, top face inside": (BOX, SHARP, [0.3, -0.2, 0.8], 0),
    "sharp box, bottom face outside": (BOX, SHARP, [0.3, -0.2, -1.2], 0),
    "sharp box, x side": (BOX, SHARP, [1.9, 0.4, -0.3], 0),
    "sharp box, -y side": (BOX, SHARP, [0.3, -1.4, 0.2], 0),
    "sharp box, outside its edge": (BOX, SHARP, [-2.2, 0.3, 1.3], 1),
    "sharp box, outside its corner": (BOX, SHARP, [2.2, -1.9, 1.3], 2),
    "fillet box, face": (BOX, ROUND, [0.3, -0.2, 0.9], 0),
    "fillet box, core": (BOX, ROUND, [1.2, -0.2, -0.3], 0),
    "fillet box, side outside": (BOX, ROUND, [-2.3, -0.2, 0.1], 0),
    "fillet box, xz edge outside": (BOX, ROUND, [2.1, 0.3, 1.2], 1),
    "fillet box, xz edge inside": (BOX, ROUND, [1.75, 0.3, 0.8], 1),
    "fillet box, -yz edge inside": (BOX, ROUND, [0.7, -1.3, 0.7], 1),
    "fillet box, xy edge inside": (BOX, ROUND, [-1.8, 1.25, 0.1], 1),
    "fillet box, corner outside": (BOX, ROUND, [2.1, 1.7, -1.2], 2),
    "fillet box, corner inside": (BOX, ROUND, [-1.8, -1.3, 0.75], 2),
    "sphere outside": (SPHERE, BALL, [0.9, -1.2, 0.7], 2),
    "sphere inside": (SPHERE, BALL, [0.4, -0.8, 0.7], 2),
    "cylinder outside": (CYLINDER, BALL, [0.9, -1.2, 7.0], 1),
    "cylinder inside": (CYLINDER, BALL, [0.4, -0.8, -3.0], 1),
    "cone, side outside": (CONE, POINTED, [0.9, -1.2, 0.3], 1),
    "cone, side inside": (CONE, POINTED, [0.4, -0.3, -1.6], 1),
    "cone, beyond its apex": (CONE, POINTED, [0.2, -0.3, 0.9], 2),
    "blunt cone, side outside": (CONE, BLUNT, [0.9, -1.2, 0.3], 1),
    "blunt cone, side inside": (CONE, BLUNT, [0.4, -0.3, -1.6], 1),
    "blunt cone, tip outside": (CONE, BLUNT, [0.2, -0.1, 0.3], 2),
    "blunt cone, tip inside": (CONE, BLUNT, [0.1, 0.1, -0.05], 2),
    "hollow ball, in the hollow": (SPHERE, HOLLOW, [0.4, -0.8, 0.7], 2),
    "hollow ball, in the tool": (SPHERE, HOLLOW, [0.9, -1.2, 0.7], 2),
    "bore, in the hollow": (CYLINDER, HOLLOW, [0.4, -0.8, -3.0], 1),
    "bore, in the tool": (CYLINDER, HOLLOW, [0.9, -1.2, 7.0], 1),
    "torus, outer side": (TORUS, RING, [1.1, -1.6, 0.2], 2),
    "torus, inner side": (TORUS, RING, [0.6, -0.7, 0.3], 2),
    "torus, in the tube": (TORUS, RING, [1.1, -1.2, -0.2], 2),
    "groove, its rim": (EXTRUSION, GROOVE.shape, [-1.05, 3.0, 0.1], 1),
    "groove, in its rim": (EXTRUSION, GROOVE.shape, [1.2, 3.0, -0.2], 1),
    "groove, leaning wall": (EXTRUSION, GROOVE.shape, [-0.6, 3.0, -1.0], 0),
    "groove, its corner": (EXTRUSION, GROOVE.shape, [-0.6, 3.0, -1.85], 1),
    "groove, behind its corner": (EXTRUSION, GROOVE.shape, [0.95, 3.0, -1.9], 1),
    "groove, its floor": (EXTRUSION, GROOVE.shape, [0.1, 3.0, -1.9], 0),
    "groove, its line without end": (EXTRUSION, GROOVE.shape, [9.1, 3.0, -0.3], 0),
    "wedge, its sharp edge": (EXTRUSION, WEDGE.shape, [-1.2, 0.0, 0.8], 1),
    "gland, floor": (REVOLUTION, GLAND.shape, [1.3, -1.6, -1.1], 0),
    "gland, inner wall": (REVOLUTION, GLAND.shape, [1.2, -1.0, -0.6], 1),
    "gland, inner corner": (REVOLUTION, GLAND.shape, [-1.2, 1.1, -1.05], 2),
    "gland, outer corner": (REVOLUTION, GLAND.shape, [1.95, 1.5, -1.0], 2),
    "gland, inner rim": (REVOLUTION, GLAND.shape, [0.8, 1.08, 0.05], 2),
    "gland, its plate on the axis": (REVOLUTION, GLAND.shape, [0.0, 0.0, 0.1], 0),
    "gland, its line without end": (REVOLUTION, GLAND.shape, [1.8, 2.4, 0.3], 1),
    "plug, its tip": (REVOLUTION, PLUG.shape, [0.05, -0.04, 1.0], 2),
    "plug, its tip on the axis": (REVOLUTION, PLUG.shape, [0.0, 0.0, 0.8], 2),
    "plug, its sharp edge": (REVOLUTION, PLUG.shape, [1.1, -0.9, -1.2], 2),
    "plug, inside": (REVOLUTION, PLUG.shape, [0.9, -0.4, -0.3], 1),
}


def at(kind, parameters, y):
    n, H = np.full(3, np.nan), np.full((3, 3), np.nan)
    g = signed_distance(kind, parameters, np.asarray(y, float), n, H)
    return g, n, H


def directions(seed, count=4):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def orders(remainders):
    """Observed orders under halving of the step."""
    return np.log2(remainders[:-1] / remainders[1:])


@pytest.mark.parametrize("name", PLACES)
def test_normal_is_the_gradient_and_H_its_gradient(name):
    kind, parameters, y, curved = PLACES[name]
    g, n, H = at(kind, parameters, y)
    steps = 0.02 / 2.0 ** np.arange(4)  # no place is nearer than 0.03 to where the nearest part of its shape changes
    for d in directions(sum(map(ord, name))):
        moved = [at(kind, parameters, np.asarray(y) + h * d) for h in steps]
        first = np.array([abs(m[0] - g - h * n @ d) for m, h in zip(moved, steps, strict=True)])
        second = np.array([np.linalg.norm(m[1] - n - h * H @ d) for m, h in zip(moved, steps, strict=True)])
        if curved == 0:
            assert first.max() < 1e-14 and second.max() == 0  # linear: rounding of numbers of size 2
            continue
        # third-order terms shift the order by about step times curvature, 0.02 / 0.3 at the sharpest place; the last
        # remainders are far above rounding
        assert orders(first).min() > 1.85 and orders(second).min() > 1.85
        assert first[-1] > 1e-9 and second[-1] > 1e-9


@pytest.mark.parametrize("name", PLACES)
def test_normal_and_curvature_are_those_of_a_distance(name):
    kind, parameters, y, curved = PLACES[name]
    g, n, H = at(kind, parameters, y)
    assert abs(n @ n - 1) < 1e-15 * 4  # a square root and a division
    # |H| is at most 5 here; its products round at 1e-15
    assert np.abs(H @ n).max() < 1e-14 and np.array_equal(H, H.T)
    principal = np.sort(np.abs(np.linalg.eigvalsh(H)))[::-1]
    assert (principal[:curved] > 0.1).all() and np.abs(principal[curved:]).max(initial=0) < 1e-14
    # y - g n lies on the surface (for a sharp edge: on the edge itself)
    assert abs(at(kind, parameters, np.asarray(y) - g * n)[0]) < 1e-14


@pytest.mark.parametrize(("kind", "curved"), [(SPHERE, 2), (CYLINDER, 1)])
@pytest.mark.parametrize("r", [0.5, 1.3, 3.0])
def test_curvature_of_round_shapes_is_one_over_the_radius_through_the_point(kind, curved, r):
    y = r * np.array([0.6, -0.8, 0.0])
    g, n, H = at(kind, BALL, y)
    assert abs(g - (r - 1.3)) < 1e-15 * 4 and np.abs(n - y / r).max() < 1e-15
    assert abs(np.trace(H) - curved / r) < 1e-14  # sums of a few roundings of numbers below 2


@pytest.mark.parametrize("kind", [SPHERE, CYLINDER])
def test_a_point_in_the_centre_gives_finite_numbers(kind):
    g, n, H = at(kind, BALL, [0.0, 0.0, 0.0])
    assert g == -1.3 and n @ n == 1 and not H.any()
    if kind == CYLINDER:
        assert n[2] == 0


@pytest.mark.parametrize("parameters", [POINTED, BLUNT])
def test_cone_against_the_sampled_surface(parameters):
    """In the half-plane of the axis: no point of the side or of the tip's arc is nearer than |g|, one is as near."""
    tip, c, s, _ = parameters
    angle = np.linspace(0, np.pi / 2 - HALF_ANGLE, 2001)
    arc = np.column_stack([tip * np.sin(angle), tip * np.cos(angle) - tip])
    side = arc[-1] + np.linspace(0, 6, 6001)[:, None] * [s, -c]
    surface, rng = np.vstack([arc, side]), np.random.default_rng(7)
    for r, z in zip(rng.uniform(0, 2, 300), rng.uniform(-2, 1, 300), strict=True):
        turn = rng.uniform(0, 2 * np.pi)
        g, n, _ = at(CONE, parameters, [r * np.cos(turn), r * np.sin(turn), z])
        nearest = np.linalg.norm(surface - [r, z], axis=1).min()
        assert -1e-12 < nearest - abs(g) < 1e-3  # samples 1e-3 apart
        assert abs(n @ [-np.sin(turn), np.cos(turn), 0]) < 1e-15  # of a body of revolution
    # a point lies inside where the half-angle seen from the end, or for the blunt one from within, is larger than its own
    assert at(CONE, parameters, [0.5 * s, 0.0, -0.5 * c - 1.0])[0] < 0 < at(CONE, parameters, [2 * s, 0.0, -c])[0]


@pytest.mark.parametrize("parameters", [POINTED, BLUNT])
@pytest.mark.parametrize("z", [-1.5, -1e-6, 0.0, 1e-6, 0.7])
def test_a_cone_is_met_along_its_axis_at_its_end(parameters, z):
    """No side is preferred, also by coordinates that are off the axis by round-off; distance and normal agree along it."""
    for r in (0.0, 1e-11 * abs(z)):
        g, n, H = at(CONE, parameters, [r, 0.0, z])
        assert abs(g - z) < 1e-15 and np.abs(n - [0, 0, 1]).max() < 1e-10
        assert np.isfinite(H).all() and np.abs(H[2]).max() < 1e-4  # of 1/|z| times the angle off the axis


@pytest.mark.parametrize("turn", [0.3, 2.0])
def test_a_cone_is_smooth_where_tip_and_side_meet(turn):
    """Distance and normal are continuous across the last normal of the tip, within and outside of the surface."""
    for g in (-0.2, 0.3):
        ends = []
        for angle in (np.pi / 2 - HALF_ANGLE - 1e-9, np.pi / 2 - HALF_ANGLE + 1e-9):
            r, z = (0.4 + g) * np.sin(angle), (0.4 + g) * np.cos(angle) - 0.4
            ends.append(at(CONE, BLUNT, [r * np.cos(turn), r * np.sin(turn), z]))
        # places 2e-9 times a radius of at most 0.7 apart, normals 2e-9
        assert abs(ends[0][0] - g) < 1e-14 and abs(ends[1][0] - g) < 1e-14 and np.abs(ends[0][1] - ends[1][1]).max() < 1e-8


# ---- hollows, rings and profiles against the same shapes said otherwise, and against sampled lines


def sampled(count=300, size=4.0, seed=11):
    return np.random.default_rng(seed).uniform(-size, size, (count, 3))


@pytest.mark.parametrize("kind", [SPHERE, CYLINDER])
def test_a_hollow_is_the_rest_of_space(kind):
    for y in sampled(50):
        full, hollow = at(kind, BALL, y), at(kind, HOLLOW, y)
        assert full[0] == -hollow[0] and (full[1] == -hollow[1]).all() and (full[2] == -hollow[2]).all()


def lines_of(tool):
    """Places (n, 2) of a profile cut into short lines, of a turned one on one side of its axis."""
    line = profile_line(tool.shape.reshape(-1, PIECE), 20.0, 1e-9)
    return line[line[:, 0] >= 0.0] if tool.kind == REVOLUTION else line


def nearest_by_lines(tool, x):
    """Unsigned distances (n,) of places (n, 2) to a profile."""
    line = lines_of(tool)
    start, step = line[:-1], np.diff(line, axis=0)
    share = np.clip(np.einsum("nlc,lc->nl", x[:, None] - start, step) / (step**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(start + share[..., None] * step - x[:, None], axis=2).min(axis=1)


def material(tool, x):
    """Whether places (n, 2) lie in the tool, by the nearest line to the left or right at their height; None without."""
    line = lines_of(tool)
    a, b = line[:-1], line[1:]
    found = []
    for p, z in x:
        crossed = np.flatnonzero((a[:, 1] > z) != (b[:, 1] > z))
        at_p = a[crossed, 0] + (z - a[crossed, 1]) / (b - a)[crossed, 1] * (b - a)[crossed, 0]
        left, right = at_p < p, at_p > p
        if left.any():  # upwards the tool is to the right of the line
            nearest = crossed[left][at_p[left].argmax()]
            found.append((b - a)[nearest, 1] > 0)
        elif right.any():
            nearest = crossed[right][at_p[right].argmin()]
            found.append((b - a)[nearest, 1] < 0)
        else:
            found.append(None)
    return found


@pytest.mark.parametrize("name", PROFILES)
def test_profiles_against_their_lines(name):
    tool, places = PROFILES[name], sampled(size=2.5)
    turned = tool.kind == REVOLUTION
    plane = np.column_stack([np.hypot(places[:, 0], places[:, 1]) if turned else places[:, 0], places[:, 2]])
    g = np.array([at(tool.kind, tool.shape, y)[0] for y in places])
    # 48 lines per quarter of an arc of 0.6 cut off 8e-5 of it
    assert np.abs(np.abs(g) - nearest_by_lines(tool, plane)).max() < 1e-4
    inside = material(tool, plane)
    assert sum(known is not None for known in inside) > 80  # at the other heights there is no line
    for gap, known in zip(g, inside, strict=True):
        assert known is None or abs(gap) < 1e-4 or known == (gap < 0)


def same_everywhere(one, other, places, moved=(0.0, 0.0, 0.0)):
    for y in places:
        a, b = at(*one, y), at(*other, y - np.asarray(moved))
        # rounding of places of size 5, over the smallest distance at which curvatures are one over it
        assert abs(a[0] - b[0]) < 1e-13 and np.abs(a[1] - b[1]).max() < 1e-11 and np.abs(a[2] - b[2]).max() < 1e-9


def test_a_profile_is_the_shape_it_draws():
    places = sampled(100)
    flat = rigid_extrusion([(-1, 0), (1, 0)])
    same_everywhere((EXTRUSION, flat.shape), (PLANE, np.zeros(4)), places)
    turned_flat = rigid_revolution([(0, 0), (1, 0)])
    same_everywhere((REVOLUTION, turned_flat.shape), (PLANE, np.zeros(4)), places)
    pipe = rigid_revolution([(1.3, 1), (1.3, -1)])
    same_everywhere((REVOLUTION, pipe.shape), (CYLINDER, BALL), places)
    bore = rigid_revolution([(1.3, -1), (1.3, 1)])
    same_everywhere((REVOLUTION, bore.shape), (CYLINDER, HOLLOW), places)
    c, s = np.cos(HALF_ANGLE), np.sin(HALF_ANGLE)
    cone = rigid_revolution([(0, 0.4 / s - 0.4, 0.4), (s, 0.4 / s - 0.4 - c)])
    same_everywhere((REVOLUTION, cone.shape), (CONE, BLUNT), places)
    ring = [(1.9, 0.4, 0.4), (1.9, -0.4, 0.4), (1.1, -0.4, 0.4), (1.1, 0.4, 0.4)]
    same_everywhere((REVOLUTION, rigid_revolution(ring, closed=True).shape), (TORUS, RING), places)
    ball = [(0, 1.3), (1.3, 1.3, 1.3), (1.3, -1.3, 1.3), (0, -1.3)]
    same_everywhere((REVOLUTION, rigid_revolution(ball).shape), (SPHERE, BALL), places)
    bar = [(2, 1, 0.4), (2, -1, 0.4), (-2, -1, 0.4), (-2, 1, 0.4)]
    box = np.array([2.0, 99.0, 1.0, 0.4])
    outside = places[[at(BOX, box, y)[0] > 0.0 for y in places]]  # within, a box is not a distance by its rounded edges
    same_everywhere((EXTRUSION, rigid_extrusion(bar, closed=True).shape), (BOX, box), outside)


def test_no_place_is_forgotten_where_pieces_meet():
    """On the normals through the ends of all lines and arcs, where rounding decides to which piece a place belongs."""
    for tool in PROFILES.values():
        pieces = tool.shape.reshape(-1, PIECE)
        for code, x, z, d0, d1, size, _ in pieces[(pieces[:, 0] < ARC) & (pieces[:, 1] >= 0.0)]:
            for end in (0.0, size):
                for gap in (-0.15, 1e-3, 0.15):
                    y = np.array([x + end * d0 - gap * d1, 0.0, z + end * d1 + gap * d0])
                    g = at(tool.kind, tool.shape, y)[0]
                    # behind its line another one may be nearer
                    assert y[0] <= 0.0 or abs(g - gap) < 1e-12 or (gap < 0.0 and abs(g) < -gap), (code, y)


def test_a_union_is_its_nearest_part():
    parts = [
        rigid_sphere(1.3, (0.5, 0.2, -0.4)),
        rigid_cylinder(0.5, (1.0, -2.0, 0.5), (1.0, 2.0, -0.4)),
        rigid_cone(0.7, (-1.5, 0.0, 1.0), (-1.0, 0.3, 0.8), tip=0.2),
        rigid_punch(0.6, 1.0, (-2.0, 2.0, 1.0), direction=(0.3, 1.0, 0.2), fillet=0.2),
        rigid_plane((0.0, 0.0, -3.0), (0.2, 0.1, 1.0)),
        rigid_extrusion([(-3, 0), (-1, 0, 0.3), (-1, 2, 0.5), (1, 2)], (2.0, 1.0, -1.0), (0, 0.6, 0.8), (0, -0.8, 0.6)),
    ]
    union, nearest = rigid_union(*parts), set()
    assert union.kind == UNION and np.array_equal(union.point, parts[0].point)
    for x in sampled(200):
        alone = []
        for part in parts:
            g, n, H = at(part.kind, part.shape, part.axes.T @ (x - part.origin))
            alone.append((g, part.axes @ n, part.axes @ H @ part.axes.T))
        which = int(np.argmin([g for g, _, _ in alone]))
        nearest.add(which)
        y = x - union.origin
        g, n, H = at(union.kind, union.shape, y)
        assert np.array_equal(y, x - union.origin)
        # rounding of places of size 5
        assert abs(g - alone[which][0]) < 1e-14 and np.abs(n - alone[which][1]).max() < 1e-13
        assert np.abs(H - alone[which][2]).max() < 1e-12 and abs(n @ n - 1) < 1e-14
    assert nearest == set(range(len(parts)))


# ---- against a closest point that knows only the surface's implicit equation


def implicit(parameters, p):
    """Negative inside the box whose edges are rounded: zero set of |max(|p| - core, 0)|^2 = fillet^2."""
    beyond = np.maximum(np.abs(p) - (parameters[:3] - parameters[3]), 0)
    return beyond @ beyond - parameters[3] ** 2


def distance_by_minimisation(parameters, y):
    """Signed distance by SciPy: the nearest of the surface points found from several starts."""
    best = np.inf
    for start in (y, 1.3 * y, 1.1 * y + 0.1, [2.0, y[1], y[2]], [y[0], 1.5, y[2]], [y[0], y[1], -1.0]):
        found = minimize(
            lambda p: (p - y) @ (p - y),
            np.asarray(start, float),
            jac=lambda p: 2 * (p - y),
            constraints={"type": "eq", "fun": lambda p: implicit(parameters, p)},
            method="SLSQP",
            options={"ftol": 1e-15, "maxiter": 300},
        )
        if abs(implicit(parameters, found.x)) < 1e-9:
            best = min(best, np.linalg.norm(found.x - y))
    return best * np.sign(implicit(parameters, y))


@pytest.mark.parametrize("name", [n for n in PLACES if n.startswith("fillet") and "core" not in n])
def test_fillet_box_against_scipy(name):
    _, parameters, y, _ = PLACES[name]
    g, n, _ = at(BOX, parameters, y)
    # the minimiser meets the surface to about sqrt(ftol) = 3e-8; its distance is then good to 1e-7
    assert abs(distance_by_minimisation(parameters, np.array(y)) - g) < 1e-7


def test_box_against_the_sampled_surface():
    """No sampled surface point is nearer than |g|, and one is nearly as near: for any point around or in the boxes."""
    rng = np.random.default_rng(5)
    sphere = rng.normal(size=(40000, 3))
    sphere /= np.linalg.norm(sphere, axis=1)[:, None]
    for parameters in (ROUND, SHARP):
        core = parameters[:3] - parameters[3]
        # every surface point is a corner, edge or face point of the core, pushed out along a normal it has there
        cube = rng.uniform(-1, 1, (40000, 3)) * core
        axis = rng.integers(0, 3, 40000)
        faces = cube.copy()
        faces[np.arange(40000), axis] = np.sign(cube[np.arange(40000), axis]) * parameters[axis]
        edges = np.sign(sphere) * core
        edges[np.arange(40000), axis] = cube[np.arange(40000), axis]
        flat = sphere.copy()
        flat[np.arange(40000), axis] = 0
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        surface = np.vstack([faces, edges + parameters[3] * flat, np.sign(sphere) * core + parameters[3] * sphere])
        for y in rng.uniform(-1.2, 1.2, (200, 3)) * HALF:
            g = at(BOX, parameters, y)[0]
            nearest = np.linalg.norm(surface - y, axis=1).min()
            # 40000 points on faces of 12 area units lie some 0.03 apart; seen from nearby that costs 0.03^2 / 2|g| or,
            # on the surface, 0.03 itself
            assert -1e-12 < nearest - abs(g) < 0.06
            assert np.sign(g) == (1 if implicit(parameters, y) > 0 else -1) or parameters[3] == 0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_box_is_smooth_where_face_and_fillet_meet(axis):
    """Distance and normal are continuous where a second axis passes the end of the flat part."""
    other = (axis + 1) % 3
    y = np.zeros(3)
    y[axis] = HALF[axis] - 0.1
    y[other] = HALF[other] - 0.4
    before, after = y.copy(), y.copy()
    before[other] -= 1e-9
    after[other] += 1e-9
    g0, n0, _ = at(BOX, ROUND, before)
    g1, n1, _ = at(BOX, ROUND, after)
    # curvature 1/0.3 times the step 2e-9
    assert abs(g1 - g0) < 1e-8 and np.abs(n1 - n0).max() < 1e-8


# ---- the share of points that slide out under a sharp edge

SPACING = 0.25
ZONE = {
    "beyond the x edge": [2.1, 0.3, 0.9],
    "beyond the -x edge": [-2.07, 0.3, 0.9],
    "beyond the y edge": [0.3, 1.63, 0.9],
    "beyond a corner": [-2.1, 1.6, -0.95],
    "beyond the edge, deep": [2.1, 0.3, 0.6],
    "beyond a corner, deep": [2.1, -1.58, -0.63],
}


def cover_at(y, parameters=SHARP, kind=BOX):
    s, ds = edge_cover(kind, parameters, np.asarray(y, float), SPACING)
    return s, np.array(ds)


@pytest.mark.parametrize("place", ZONE)
def test_cover_gradient(place):
    y = np.array(ZONE[place])
    s, ds = cover_at(y)
    assert 0 < s < 1
    steps = 2e-3 / 2.0 ** np.arange(4)
    for d in directions(3):
        remainders = np.array([abs(cover_at(y + h * d)[0] - s - h * ds @ d) for h in steps])
        # third-order terms: step 2e-3 over spacing 0.25, times factors of a few
        assert orders(remainders).min() > 1.8
    assert remainders[-1] > 1e-10  # above rounding


def test_cover_falls_monotonically_to_zero_in_one_spacing_and_is_smooth():
    way = np.linspace(-0.2, 1.2, 1401) * SPACING
    s, slope = np.array([(c := cover_at([HALF[0] + t, 0.2, 0.95]))[0:1] + (c[1][0],) for t in way]).T
    assert (s[way <= 0] == 1).all() and (s[way >= SPACING + 1e-12] == 0).all()
    assert (np.diff(s) <= 0).all()
    # neighbours 1e-3 spacings apart: s changes by at most 1.5e-3, its slope by 6e-3 per spacing
    assert np.abs(np.diff(s)).max() < 1.6e-3 and np.abs(np.diff(slope)).max() < 6.1e-3 / SPACING
    middle = cover_at([HALF[0] + SPACING / 2, 0.2, 0.95])[0]
    assert abs(middle - 0.5) < 1e-14  # half-way is half: rounding


@pytest.mark.parametrize("depth", [1.0, 1.5, 2.0])
def test_cover_fades_between_one_and_two_spacings_of_depth(depth):
    s = cover_at([HALF[0] + 1e-12, 0.2, HALF[2] - depth * SPACING])[0]
    assert abs(s - {1.0: 1.0, 1.5: 0.5, 2.0: 0.0}[depth]) < 1e-10  # 1e-12 beyond the edge, over the spacing


@pytest.mark.parametrize(("kind", "parameters"), [(PLANE, np.zeros(4)), (BOX, ROUND), (SPHERE, BALL), (CYLINDER, BALL),
                                                  (CONE, POINTED), (TORUS, RING), (EXTRUSION, WEDGE.shape)])  # fmt: skip
def test_shapes_without_sharp_edges_are_covered(kind, parameters):
    s, ds = cover_at([2.1, 1.6, 0.9], parameters, kind)
    assert s == 1 and not ds.any()
    assert not meets_face(kind, parameters, np.array([0.0, 0.0, 0.9]), SPACING, 1.0)


def test_which_points_meet_the_face():
    def meets(y):
        return meets_face(BOX, SHARP, np.asarray(y, float), SPACING, cover_at(y)[0])

    assert meets([0.0, 0.0, 0.9]) and meets([1.99, 0.0, 0.9]) and meets([2.1, 0.0, -0.9])
    assert not meets([2.26, 0.0, 0.9])  # slid out
    assert not meets([1.99, 0.0, 0.7])  # more than a spacing deep, next to the side


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_face_distance_has_no_end(side):
    n, H = np.empty(3), np.ones((3, 3))
    assert face_distance(SHARP, np.array([50.0, -3.0, 0.9 * side]), n, H) == 0.9 - 1.0
    assert np.array_equal(n, [0, 0, side]) and not H.any()
