"""The candidate grid against the test of every point with every box."""

import time

import numpy as np
import pytest

from fenics_contact.kernels.broad_phase import candidates, candidates_along, cell_size, facet_balls, facet_boxes


def bumpy_sheet(n, rng, width=1.0):
    """n x n irregular quads, every third split so that it is a triangle and a hole."""
    a = np.linspace(0.0, width, n + 1)
    X, Y = np.meshgrid(a, a, indexing="ij")
    x = np.stack([X.ravel(), Y.ravel(), 0.1 * np.sin(5 * X).ravel()], axis=1)
    x += rng.uniform(-0.2, 0.2, x.shape) * width / n
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    first = (i * (n + 1) + j).ravel()
    nodes = np.stack([first, first + n + 1, first + n + 2, first + 1], axis=1).astype(np.int64)
    size = np.full(len(nodes), 4, np.int64)
    size[::3] = 3
    nodes[::3, 3] = nodes[::3, 2]
    return x, nodes, size


def placed_sheet(turn, seed):
    """A sheet, as it is or turned and far away, and points around it and on its corners themselves."""
    rng = np.random.default_rng(seed)
    x, nodes, size = bumpy_sheet(12, rng)
    if turn:
        x = x @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T + 100.0
    return rng, (x, nodes, size), np.vstack([x.mean(axis=0) + rng.uniform(-0.8, 0.8, (300, 3)), x])


def brute_force(points, x, nodes, size, margin):
    corners = x[nodes]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    return [np.flatnonzero(((p >= low) & (p <= high)).all(axis=1)) for p in points]


def assert_same(points, x, nodes, size, margin):
    offsets, found = candidates(points, x, nodes, size, margin)
    expected = brute_force(points, x, nodes, size, margin)
    for q, facets in enumerate(expected):
        assert np.array_equal(found[offsets[q] : offsets[q + 1]], facets)
    return offsets[-1]


@pytest.mark.parametrize("margin", [0.0, 0.01, 0.3])
@pytest.mark.parametrize("turn", [False, True])
def test_lists_are_those_of_brute_force(margin, turn):
    _, (x, nodes, size), points = placed_sheet(turn, 1)
    assert assert_same(points, x, nodes, size, margin) > 100  # the comparison is not one of empty lists


def test_one_huge_facet_among_small_ones_and_far_points():
    rng = np.random.default_rng(2)
    x, nodes, size = bumpy_sheet(20, rng)
    n = len(x)
    x = np.vstack([x, [[-1e5, -1e5, 0.0], [1e5, -1e5, 0.0], [1e5, 1e5, 0.0], [-1e5, 1e5, 0.0]]])
    nodes = np.vstack([nodes, [[n, n + 1, n + 2, n + 3]]])
    size = np.append(size, 4)
    points = np.vstack([rng.uniform(0, 1, (100, 3)) * [1, 1, 0.1], [[1e30, 0, 0], [-9e4, 9e4, 0.0], [np.nan, 0, 0]]])
    assert assert_same(points, x, nodes, size, 0.02) > 100


def test_degenerate_surfaces():
    points = np.zeros((2, 3))
    x = np.zeros((4, 3))
    none = np.empty((0, 4), np.int64)
    assert candidates(points, x, none, np.empty(0, np.int64), 1.0)[0].tolist() == [0, 0, 0]
    one = np.array([[0, 1, 2, 3]])
    assert candidates(points, x, one, np.array([4]), 0.0)[0].tolist() == [0, 1, 2]  # a facet shrunk onto the points
    assert candidates(points[:0], x, one, np.array([4]), 0.0)[0].tolist() == [0]


def met_by(points, directions, balls, search):
    """Of each line the facets in whose balls a part of it lies, and those whose ball it passes when continued."""
    arms, radii = balls[0][None] - points[:, None], balls[1]
    along = np.einsum("qfc,qc->qf", arms, directions)
    over = np.maximum(np.abs(along) - search, 0.0)
    off = np.einsum("qfc,qfc->qf", arms, arms) - along**2
    return off + over**2 <= radii * (1.0 - 1e-9), off <= radii * (1.0 + 1e-9)


@pytest.mark.parametrize("search", [0.0, 0.05, 0.5, 50.0])
@pytest.mark.parametrize("turn", [False, True])
def test_lines_find_all_facets_whose_balls_they_pass(search, turn):
    rng, (x, nodes, size), points = placed_sheet(turn, 5)
    directions = rng.normal(size=points.shape)
    directions[::7] = np.sign(directions[::7]) * [0.0, 0.0, 1.0]  # along an axis, and in a plane of two
    directions[::5, 0] = 0.0
    directions[::35] = [0.0, -1.0, 0.0]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    centres, radii = facet_balls((x, (nodes, size)))
    for wider in (1.0, 4.0):
        balls = centres, wider * radii
        offsets, found = candidates_along(points, directions, balls, search)
        must, may = met_by(points, directions, balls, search)
        assert offsets[0] == 0 and must.sum() > 100
        for q in range(len(points)):
            mine = found[offsets[q] : offsets[q + 1]]
            assert np.all(np.diff(mine) > 0) and may[q, mine].all()
            assert set(np.flatnonzero(must[q])) <= set(mine)


def test_lines_of_nothing():
    x, nodes, size = bumpy_sheet(3, np.random.default_rng(6))
    up, balls = np.tile([0.0, 0.0, 1.0], (2, 1)), facet_balls((x, (nodes, size)))
    points = np.array([[np.nan, 0.5, 0.0], [1e30, 0.5, 0.0]])
    assert candidates_along(points, up, balls, 1.0)[0].tolist() == [0, 0, 0]
    assert candidates_along(points, np.full((2, 3), np.nan), balls, 1.0)[0].tolist() == [0, 0, 0]
    assert candidates_along(points[:0], up[:0], balls, 1.0)[0].tolist() == [0]
    none = np.empty((0, 3)), np.empty(0)
    assert candidates_along(points, up, none, 1.0)[0].tolist() == [0, 0, 0]
    shrunk = np.zeros((1, 3)), np.zeros(1)  # a facet shrunk onto a point
    assert candidates_along(np.zeros((2, 3)), up, shrunk, 1.0)[1].tolist() == [0, 0]


def test_a_fine_surface_costs_a_coarse_slave_no_more_than_its_lines_meet():
    """Facets within two of a coarse slave's cells grow with the square of how much finer they are, those met do not."""
    rng = np.random.default_rng(7)
    counts = []
    for n in (10, 80):
        x, nodes, size = bumpy_sheet(n, rng)
        points = np.column_stack([rng.uniform(0.3, 0.7, (200, 2)), np.zeros(200)])
        balls = facet_balls((x, (nodes, size)))
        counts.append(len(candidates_along(points, np.tile([0.0, 0.0, 1.0], (200, 1)), balls, 0.4)[1]))
    assert counts[1] < 1.5 * counts[0]


def test_compiled_equals_plain_python():
    x, nodes, size = bumpy_sheet(6, np.random.default_rng(3))
    a = candidates(x, x, nodes, size, 0.05)
    b = candidates.py_func(x, x, nodes, size, 0.05)
    assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
    low, high = np.empty((len(nodes), 3)), np.empty((len(nodes), 3))
    facet_boxes(x, nodes, size, 0.05, low, high)
    assert cell_size(low, high, low.min(axis=0)) == cell_size.py_func(low, high, low.min(axis=0))


def test_time_grows_about_linearly():
    def seconds(n):
        rng = np.random.default_rng(4)
        x, nodes, size = bumpy_sheet(n, rng)
        best = np.inf
        for _ in range(9):
            start = time.process_time()
            candidates(x, x, nodes, size, 0.2 / n)
            best = min(best, time.process_time() - start)
        return best

    seconds(20)
    # 16 times the facets: linear is 16, n log n about 21, quadratic 256; 64 leaves room for caches and a busy machine
    assert seconds(200) / seconds(50) < 64
