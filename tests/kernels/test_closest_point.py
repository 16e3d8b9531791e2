"""Closest points against SciPy and against surfaces whose answer is known."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.closest_point import EDGE, INTERIOR, NONE, VERTEX, closest_on_facet, closest_points
from fenics_contact.kernels.facets import shape

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def rotation(rng):
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


def on_facet(m, xf, s, t):
    return np.array(shape(m, s, t))[:m] @ xf[:m]


def foot(x, m, xf):
    return closest_on_facet(np.asarray(x, float), m, xf, np.empty((4, 3)))


def project(points, normals, coords, nodes, size, search=10.0, facing=0.0, lists=None):
    """All facets are candidates unless lists are given; returns a dict of arrays."""
    points, normals = np.atleast_2d(points).astype(float), np.atleast_2d(normals).astype(float)
    n, nf = len(points), len(nodes)
    if lists is None:
        lists = (np.arange(n + 1, dtype=np.int64) * nf, np.tile(np.arange(nf, dtype=np.int64), n))
    out = (np.full(n, 7), np.full(n, 7), np.full(n, 7), np.full((n, 2), 7.0), np.full(n, 7.0), np.full((n, 3), 7.0))
    closest_points(points, normals, (coords, (nodes, size)), lists, (search, facing), out)
    return dict(zip(("facet", "kind", "feature", "xi", "gap", "normal"), out, strict=False))


def scipy_distance(x, m, xf):
    """Least distance over nine starts of a bounded minimiser; a triangle is a collapsed square."""

    def square(z):
        N = np.array([(1 - z[0]) * (1 - z[1]), z[0] * (1 - z[1]), z[0] * z[1], (1 - z[0]) * z[1]])
        dN = np.array([[z[1] - 1, 1 - z[1], z[1], -z[1]], [z[0] - 1, -z[0], z[0], 1 - z[0]]])
        corners = xf if m == 4 else xf[[0, 1, 2, 0]]
        d = N @ corners - x
        return 0.5 * d @ d, dN @ corners @ d

    how = {"jac": True, "bounds": [(0, 1)] * 2, "method": "L-BFGS-B", "options": {"ftol": 1e-16, "gtol": 1e-12}}
    runs = [minimize(square, (a, b), **how) for a in (0.1, 0.5, 0.9) for b in (0.1, 0.5, 0.9)]
    return np.sqrt(2 * min(run.fun for run in runs))


@pytest.mark.parametrize("m", [3, 4])
def test_distance_is_the_least_that_scipy_finds_on_warped_and_turned_facets(m):
    rng = np.random.default_rng(10 + m)
    kinds = set()
    for _ in range(80):
        xf = (SQUARE + rng.uniform(-0.35, 0.35, (4, 3))) @ rotation(rng).T + rng.uniform(-3, 3, 3)
        if m == 3:
            xf[3] = xf[2]
        x = xf.mean(axis=0) + rng.normal(size=3) * rng.choice([0.05, 0.3, 1.0])
        kind, feature, s, t, dd = foot(x, m, xf)
        kinds.add(kind)
        # the place that is returned has the distance that is returned, up to rounding of coordinates of size 3
        assert abs(np.linalg.norm(on_facet(m, xf, s, t) - x) - np.sqrt(dd)) < 1e-13
        # SciPy stops when the square of the distance stalls at 1e-16: the distance is then good to 1e-8
        assert abs(np.sqrt(dd) - scipy_distance(x, m, xf)) < 3e-8
    assert kinds == {INTERIOR, EDGE, VERTEX}


def test_a_saddle_with_several_minima_gives_the_lowest():
    """Above the middle of a strongly warped patch the centre is a saddle of the distance, with a minimum beside it."""
    rng = np.random.default_rng(20)
    inside = 0
    for i in range(60):
        xf = 2 * SQUARE + [[0, 0, 0.8], [0, 0, -0.8], [0, 0, 0.8], [0, 0, -0.8]]
        x = np.array([1.0, 1.0, rng.choice([-1.4, 1.4])])
        Q = np.eye(3)
        if i > 4:  # the first few lie exactly above the saddle
            x += rng.uniform(-0.1, 0.1, 3)
            Q = rotation(rng)
        kind, _, _, _, dd = foot(x @ Q.T, 4, xf @ Q.T)
        inside += kind == INTERIOR
        assert abs(np.sqrt(dd) - scipy_distance(x, 4, xf)) < 3e-8  # as above
    assert inside > 50


def test_inside_the_foot_is_orthogonal_to_machine_precision():
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(300):
        xf = SQUARE + rng.uniform(-0.3, 0.3, (4, 3))
        x = xf.mean(axis=0) + rng.normal(size=3) * 0.3
        kind, _, s, t, dd = foot(x, 4, xf)
        if kind != INTERIOR:
            continue
        found += 1
        c1 = 0.25 * np.array([-(1 - t), 1 - t, 1 + t, -(1 + t)]) @ xf
        c2 = 0.25 * np.array([-(1 - s), -(1 + s), 1 + s, 1 - s]) @ xf
        d = x - on_facet(4, xf, s, t)
        # Taylor tests of the element need f = 0 far below their smallest remainder; 1e-13 is 50 roundings
        assert max(abs(d @ c1), abs(d @ c2)) < 1e-13
    assert found > 100


def test_far_from_the_origin_newton_ends_as_well():
    shift = np.array([1e4, -2e4, 3e4])
    kind, _, s, t, dd = foot(np.array([0.3, 0.6, -0.1]) + shift, 4, SQUARE + shift)
    assert kind == INTERIOR
    assert abs(s + 0.4) < 1e-10 and abs(t - 0.2) < 1e-10  # coordinates of 1e4 round at 4e-12
    assert abs(np.sqrt(dd) - 0.1) < 1e-11


def test_edges_and_corners_have_the_documented_numbers():
    for m, corners in ((4, SQUARE), (3, SQUARE[[0, 1, 3, 3]])):
        centre = corners[:m].mean(axis=0)
        for i in range(m):
            out = corners[i] + (corners[i] - centre)
            assert foot(out, m, corners)[:2] == (VERTEX, i)
            middle = 0.5 * (corners[i] + corners[(i + 1) % m])
            assert foot(2 * middle - centre, m, corners)[:2] == (EDGE, i)


def test_needles_and_collapsed_facets_answer_with_their_edges():
    kind, _, _, _, dd = foot([0.5, 1.0, 0.0], 3, np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.5, 0, 0]]))
    assert kind in (EDGE, VERTEX) and dd == 1.0
    kind, _, _, _, dd = foot([0.0, 2.0, 0.0], 4, np.zeros((4, 3)))
    assert kind != NONE and dd == 4.0
    collapsed = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, 1, 0]])  # a quad with two equal corners
    assert foot([0.5, 0.4, 0.2], 4, collapsed)[0] == INTERIOR


# ---- whole surfaces

TWO = np.array([[0, 1, 2, 3], [1, 4, 5, 2]])
FOURS = np.array([4, 4])


def fold(height):
    """Two squares that share the edge x = 1; height > 0 lifts the far sides: a valley; < 0: a ridge."""
    return np.array([[0.0, 0, height], [1, 0, 0], [1, 1, 0], [0, 1, height], [2, 0, height], [2, 1, height]], dtype=float)


DOWN = np.array([0.0, 0.0, -1.0])


def test_a_flat_seam_leaves_no_slit():
    x = np.stack([np.linspace(0.99, 1.01, 401), np.full(401, 0.37), np.full(401, -0.01)], axis=1)
    x[200, 0] = 1.0  # exactly above the common edge
    x[201, 0] = np.nextafter(1.0, 2.0)
    rng = np.random.default_rng(5)
    Q = rotation(rng)
    r = project(x @ Q.T, np.tile(Q @ DOWN, (401, 1)), fold(0.0) @ Q.T, TWO, FOURS)
    assert (r["kind"] == INTERIOR).all()
    assert np.allclose(r["gap"], -0.01, atol=1e-14)  # rounding of coordinates of size one
    assert np.allclose(r["normal"], Q @ -DOWN, atol=1e-13)
    assert (np.diff(r["facet"]) >= 0).all()  # one change of facet, no flutter


def test_outside_a_ridge_the_edge_answers_with_positive_gap():
    r = project([1.0, 0.5, 0.2], DOWN, fold(-0.5), TWO, FOURS)
    assert r["kind"][0] == EDGE and np.isclose(r["gap"][0], 0.2, rtol=1e-15)
    assert np.allclose(r["normal"][0], [0, 0, 1], atol=1e-15)


def test_under_a_ridge_the_nearer_flank_answers():
    slope = np.array([0.5, 0, 1.0]) / np.sqrt(1.25)
    r = project([[1.1, 0.5, -0.2], [0.9, 0.5, -0.2]], [DOWN] * 2, fold(-0.5), TWO, FOURS)
    assert r["facet"].tolist() == [1, 0] and (r["kind"] == INTERIOR).all()
    assert np.allclose(r["normal"], [slope, slope * [-1, 1, 1]], atol=1e-15)
    assert np.allclose(r["gap"], -(0.2 - 0.05) / np.sqrt(1.25), atol=1e-15)
    # on the bisector both are equally near: the first in the list, whatever the order of rounding
    tie = project([1.0, 0.5, -0.2], DOWN, fold(-0.5), TWO, FOURS)
    assert tie["facet"][0] == 0


def test_under_a_valley_the_normal_turns_continuously_from_flank_to_flank():
    x = np.stack([np.linspace(0.7, 1.3, 601), np.full(601, 0.5), np.full(601, -0.3)], axis=1)
    r = project(x, np.tile(DOWN, (601, 1)), fold(0.5), TWO, FOURS)
    assert set(r["kind"]) == {INTERIOR, EDGE} and (r["gap"] < 0).all()
    turn = np.linalg.norm(np.diff(r["normal"], axis=0), axis=1)
    # an edge's normal turns by (path/distance): 0.001/0.3 per point here; a jump would be 0.9
    assert turn.max() < 1.01 * 0.001 / 0.3
    assert np.allclose(r["normal"][0], np.array([0.5, 0, 1]) / np.sqrt(1.25))
    assert np.abs(np.diff(r["gap"])).max() < 0.001 * 1.01  # a distance changes by no more than the path


def pit(depth, n=5):
    """n triangles around a vertex that lies depth under their rim: a pit, or a peak for depth < 0."""
    a = 2 * np.pi * np.arange(n) / n
    coords = np.vstack([[0.0, 0, 0], np.stack([np.cos(a), np.sin(a), np.full(n, depth)], axis=1)])
    nodes = np.array([[0, 1 + i, 1 + (i + 1) % n, 1 + (i + 1) % n] for i in range(n)])
    return coords, nodes, np.full(n, 3)


def test_vertices_of_pits_and_peaks():
    r = project([0.02, 0.01, -0.3], DOWN, *pit(0.5))
    assert r["kind"][0] == VERTEX and np.isclose(r["gap"][0], -np.sqrt(0.0905), rtol=1e-14)
    assert np.allclose(r["normal"][0], np.array([-0.02, -0.01, 0.3]) / np.sqrt(0.0905), atol=1e-15)
    r = project([0.02, 0.01, 0.3], DOWN, *pit(-0.5))
    assert r["kind"][0] == VERTEX and np.isclose(r["gap"][0], np.sqrt(0.0905), rtol=1e-14)
    # a steep pit: d leaves the mean normal by more than a free border would allow
    r = project([0.15, 0.0, -0.15], DOWN, *pit(2.0, 4))
    assert r["kind"][0] in (VERTEX, EDGE) and r["gap"][0] < 0


def test_the_sign_at_a_vertex_does_not_depend_on_how_a_flank_is_split():
    """A spike with one flank cut into twenty slivers; the point lies outside the opposite flank, beyond the tip."""
    coords, _, _ = pit(-5.0, 4)
    cuts = np.linspace(coords[1], coords[2], 21)[1:-1]
    rim = [1, *range(5, 24), 2]
    coords = np.vstack([coords, cuts])
    nodes = np.array([[0, a, b, b] for a, b in zip(rim, rim[1:], strict=False)] + [[0, 2, 3, 3], [0, 3, 4, 4], [0, 4, 1, 1]])
    opposite = np.cross(coords[3], coords[4])
    x = 0.1 * opposite / np.linalg.norm(opposite) + [0, 0, 0.01]
    r = project(x, DOWN, coords, nodes, np.full(len(nodes), 3), facing=2.0)  # 2: no facet is taken to look away
    assert r["kind"][0] == VERTEX and r["gap"][0] > 0


def test_beyond_a_free_border_a_point_falls_off_but_a_tilted_one_stays():
    below = project([[-0.1, 0.5, -0.1], [-0.001, 0.5, -0.1], [-0.2, -0.2, -0.1]], [DOWN] * 3, fold(0.0), TWO, FOURS)
    assert below["kind"].tolist() == [NONE, EDGE, NONE]
    assert below["facet"].tolist() == [-1, 0, -1] and np.isinf(below["gap"][[0, 2]]).all()
    assert below["gap"][1] < 0


def test_facets_that_look_away_or_lie_too_far_never_pair():
    flat = fold(0.0)
    x = [0.5, 0.5, -0.05]
    assert project(x, DOWN, flat, TWO, FOURS)["kind"][0] == INTERIOR
    assert project(x, -DOWN, flat, TWO, FOURS)["kind"][0] == NONE
    assert project(x, DOWN, flat, TWO, FOURS, search=0.04)["kind"][0] == NONE
    assert project(x, DOWN, flat, TWO, FOURS, facing=-1.1)["kind"][0] == NONE
    # a thin plate: the point has passed the middle, yet pairs with the side that looks at it
    plate = np.vstack([flat[:4], flat[:4] - [0, 0, 0.08]])
    nodes = np.array([[0, 1, 2, 3], [4, 7, 6, 5]])
    r = project(x, DOWN, plate, nodes, FOURS)
    assert r["facet"][0] == 0 and np.isclose(r["gap"][0], -0.05)
    assert project([np.nan, 0, 0], DOWN, flat, TWO, FOURS)["kind"][0] == NONE


def cube_sphere(n):
    """The unit sphere, six n x n patches of quads with outward normals; nodes on seams are shared."""
    index, coords, nodes = {}, [], []
    grid = np.tan(np.linspace(-np.pi / 4, np.pi / 4, n + 1))
    for axis in range(3):
        for side in (-1, 1):
            ids = np.empty((n + 1, n + 1), np.int64)
            for i, a in enumerate(grid):
                for j, b in enumerate(grid):
                    p = np.roll([side, a * side, b], axis)
                    p = p / np.linalg.norm(p)
                    ids[i, j] = index.setdefault(tuple(np.round(p, 9) + 0.0), len(coords))
                    if ids[i, j] == len(coords):
                        coords.append(p)
            for i in range(n):
                for j in range(n):
                    nodes.append([ids[i, j], ids[i + 1, j], ids[i + 1, j + 1], ids[i, j + 1]])
    return np.array(coords), np.array(nodes), np.full(len(nodes), 4)


@pytest.mark.parametrize("inward", [False, True])
def test_sign_and_normal_on_a_closed_surface(inward):
    """Ball (inward False) and hole: the sign of the gap is right everywhere, also at edges and vertices."""
    n = 12
    coords, nodes, size = cube_sphere(n)
    if inward:
        nodes = np.ascontiguousarray(nodes[:, ::-1])
    rng = np.random.default_rng(8)
    direction = rng.normal(size=(3000, 3))
    direction = np.vstack([direction, coords])  # also straight above vertices
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    # corners lie on the sphere within an angle a of their facet's centre: the facets sag by a^2/2 = 0.0096 at most
    centre = coords[nodes].mean(axis=1)
    a = np.linalg.norm(coords[nodes] - centre[:, None], axis=2).max()
    assert a**2 / 2 < 0.01  # all radii stay clear of the shell between the polyhedron and the sphere
    radius = rng.choice([0.93, 0.97, 1.03, 1.1], len(direction))
    outward = -direction if inward else direction
    points = direction * radius[:, None]
    lists = candidates(points, coords, nodes, size, 0.12)
    r = project(points, -outward, coords, nodes, size, 0.12, 0.0, lists)
    assert (r["kind"] != NONE).all()
    height = (radius - 1.0) * (-1 if inward else 1)
    assert np.abs(r["gap"] - height).max() < a**2 / 2
    # a facet's normal leaves the radius by that angle at most; 0.02 for the warp of the facets
    assert (np.einsum("ij,ij->i", r["normal"], outward) > np.cos(a + 0.02)).all()
    assert set(r["kind"]) == {INTERIOR, EDGE, VERTEX}


def test_the_answer_turns_with_the_surface():
    rng = np.random.default_rng(9)
    coords, nodes, size = cube_sphere(5)
    points = coords[::2] * 0.9 + rng.uniform(-0.1, 0.1, coords[::2].shape)
    Q, shift = rotation(rng), rng.normal(size=3)
    a = project(points, -points, coords, nodes, size)
    b = project(points @ Q.T + shift, -points @ Q.T, coords @ Q.T + shift, nodes, size)
    assert np.allclose(a["gap"], b["gap"], atol=1e-14)  # rounding
    # the place of a foot is worse than the gap by the condition of the facet, about ten
    same = a["facet"] == b["facet"]
    assert same.mean() > 0.9  # vertices belong to several facets
    assert np.allclose(a["normal"] @ Q.T, b["normal"], atol=1e-12)


def test_order_of_candidates_does_not_matter():
    rng = np.random.default_rng(11)
    coords, nodes, size = cube_sphere(4)
    points = coords * 1.05 + rng.normal(size=coords.shape) * 0.05
    a = project(points, -points, coords, nodes, size)
    order = rng.permutation(len(nodes))
    b = project(points, -points, coords, nodes[order], size)
    assert np.allclose(a["gap"], b["gap"], atol=1e-15) and np.allclose(a["normal"], b["normal"], atol=1e-12)


def test_compiled_equals_plain_python():
    rng = np.random.default_rng(12)
    for m in (3, 4):
        for _ in range(20):
            xf = SQUARE + rng.uniform(-0.3, 0.3, (4, 3))
            x = rng.uniform(-0.5, 1.5, 3)
            a, b = foot(x, m, xf), closest_on_facet.py_func(x, m, xf, np.empty((4, 3)))
            assert a[:2] == b[:2] and np.allclose(a[2:], b[2:], atol=1e-14, rtol=0)  # no fastmath: rounding at most
