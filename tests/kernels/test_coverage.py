"""How much of the samples of a facet lies over a master that ends."""

import numpy as np
import pytest

from fenics_contact.contact.samples import corner_shapes, gauss
from fenics_contact.kernels.closest_point import INTERIOR, NONE
from fenics_contact.kernels.coverage import FACING, beyond_edges, coverage, lose_passed, surface_ends
from fenics_contact.kernels.slave_ray import slave_rays

pytestmark = pytest.mark.serial

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def plate(cells=4, size=6.0, wall=0.0):
    """Positions and facets of a square plate that looks along z, cells * cells; wall: it goes on down behind x = size/2."""
    n = cells + 1
    s = np.linspace(-size / 2, size / 2, n)
    x = np.array([[a, b, 0.0] for b in s for a in s])
    facets = [[i + n * j, i + 1 + n * j, i + 1 + n * (j + 1), i + n * (j + 1)] for j in range(cells) for i in range(cells)]
    if wall:
        x = np.concatenate([x, [[size / 2 + wall, b, -1.0] for b in s]])
        facets += [[cells + n * j, n * n + j, n * n + j + 1, cells + n * (j + 1)] for j in range(cells)]
    return x, (np.array(facets), np.full(len(facets), 4))


def covered(corners, x, surface, m=4):
    """Shares of the samples of one facet that looks down on a surface, their weights, and the projection."""
    places, weights = gauss(m, 3)
    N, _ = corner_shapes(m, places)
    points = N @ corners
    n, nf = len(points), len(surface[0])
    ray = (*(np.zeros(n, np.int64) for _ in range(3)), np.zeros((n, 2)), np.zeros(n), np.zeros((n, 3)))
    normals = np.tile([0.0, 0.0, 1.0], (n, 1))
    lists = nf * np.arange(n + 1), np.tile(np.arange(nf), n)
    slave_rays(points, normals, (x, surface), lists, (2.0, 1.0, FACING), ray)
    one, two = x[surface[0][:, 2]] - x[surface[0][:, 0]], x[surface[0][:, 3]] - x[surface[0][:, 1]]
    area = np.cross(one, two)
    ends = surface_ends(surface, area / np.linalg.norm(area, axis=1)[:, None], np.cos(np.pi / 6))
    out = np.empty(n), np.empty((n, 4), np.int64), np.empty((n, 5, 3))
    aside = N.min(axis=1) if m == 3 else 0.5 * (1.0 - np.abs(places)).min(axis=1)
    every = np.concatenate([x, corners])
    samples = points, np.tile(len(x) + np.arange(m), (n, 1)), np.full(n, 1.8 * aside.min()), np.empty(0, np.int64)
    coverage(every, samples, (surface, ends), (ray[5], every), ray, out)
    return out[0], weights / weights.sum(), ray


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4])
def test_the_share_falls_with_the_area_that_is_left(angle):
    """Of a square moved over the end of a plate, against the area over it, and never up on the way."""
    x, surface = plate()
    before = 1.0
    for shift in np.linspace(1.0, 5.0, 81):
        corners = SQUARE @ turned(angle) + [shift, 0.1, 0.05]
        shares, weights, _ = covered(corners, x, surface)
        fine = np.linspace(-1, 1, 401)
        square = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2) @ turned(angle)[:2, :2]
        area = (square[:, 0] + shift < 3.0).mean()
        assert abs(shares @ weights - area) < 0.15  # three rows of samples
        assert shares @ weights < before + 1e-12
        before = shares @ weights
    assert before == 0.0


@pytest.mark.parametrize("m", [3, 4])
@pytest.mark.parametrize("turn", [0.0, 1.1])
def test_surfaces_that_end_together_cover_each_other_whole(m, turn):
    x, surface = plate(size=2.0)
    corners = SQUARE[:m] if m == 4 else SQUARE[[0, 1, 3]]
    shares, _, _ = covered((corners + [0, 0, 0.01]) @ turned(turn), x @ turned(turn), surface, m)
    assert (shares == 1.0).all()


def test_nothing_is_lost_where_facets_meet():
    x, surface = plate(cells=7, size=2.0)
    x[:, 2] = 0.1 * x[:, 0] ** 2
    shares, _, _ = covered(0.9 * SQUARE + [0, 0, 0.2], x, surface)
    assert (shares == 1.0).all()


def test_a_crease_ends_what_looks_away_and_not_what_goes_on():
    corners = SQUARE + [3.05, 0, 0.05]
    alone, weights, _ = covered(corners, *plate())
    steep, _, ray = covered(corners, *plate(wall=0.5))  # 63 degrees
    np.testing.assert_array_equal(steep, alone)
    assert 0.4 < alone @ weights < 0.55
    slope, _, ray = covered(corners, *plate(wall=2.0))
    assert (slope == 1.0).all() and (ray[0] >= 16).any()


def test_a_surface_that_curves_away_ends_without_a_jump_where_it_is_out_of_sight():
    """Strips bent by 15 degrees each: those steeper than 60 look past the samples, and no crease says so."""
    slopes = np.radians(np.arange(0, 90, 15))
    profile = np.concatenate([[[-3.0, 0.0]], np.cumsum(np.column_stack([np.cos(slopes), -np.sin(slopes)]), axis=0)])
    s = np.linspace(-2.0, 2.0, 3)
    x, n = np.array([[a, b, z] for b in s for a, z in profile]), len(profile)
    facets = np.array(
        [[i + n * j, i + 1 + n * j, i + 1 + n * (j + 1), i + n * (j + 1)] for j in range(2) for i in range(n - 1)]
    )
    end, before = profile[5, 0], 1.0  # of the strip at 60 degrees, which rounding leaves in or out of sight
    for shift in np.linspace(end - 2.0, end + 1.0, 301):
        shares, weights, _ = covered(0.5 * SQUARE + [shift, 0.0, profile[5, 1] + 0.3], x, (facets, np.full(len(facets), 4)))
        assert before - 0.05 < shares @ weights < before + 1e-12
        before = shares @ weights
    assert before == 0.0


@pytest.mark.parametrize("chords", [6, 24, 48])
def test_a_long_facet_is_not_continued_past_a_fine_round_edge(chords):
    """What curves away beside it ends far short of the samples that would meet it there: shares rose again, to one."""
    turns = np.linspace(0.0, np.pi / 2, chords + 1)
    edge = 0.3 * np.column_stack([np.sin(turns), np.cos(turns) - 1.0])
    profile = np.concatenate([[[-8.0, 0.0]], edge, [[0.3, -5.0]]])
    s, n = np.linspace(-2.0, 2.0, 3), len(profile)
    x = np.array([[a, b, z] for b in s for a, z in profile])
    facets = np.array(
        [[i + n * j, i + 1 + n * j, i + 1 + n * (j + 1), i + n * (j + 1)] for j in range(2) for i in range(n - 1)]
    )
    surface = facets, np.full(len(facets), 4)
    found = [covered(0.125 * SQUARE + [shift, 0.0, 0.1], x, surface) for shift in np.linspace(-1.0, 3.0, 201)]
    on = np.array([shares @ weights for shares, weights, _ in found])
    assert on[0] == 1.0 and on[-1] == 0.0
    assert (np.diff(on) < 1e-12).all()
    # without shares: what misses it and lies within a tenth of its facet
    off = 0.3 * np.sin(turns[-1]) + 0.05
    point, normal = np.array([[off, 0.1, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    ray = (*(np.zeros(1, np.int64) for _ in range(3)), np.zeros((1, 2)), np.zeros(1), np.zeros((1, 3)))
    slave_rays(point, normal, (x, surface), (np.array([0, len(facets)]), np.arange(len(facets))), (2.0, 0.1, 0.0), ray)
    assert ray[1][0] == INTERIOR and ray[0][0] in (0, n - 1)  # the long ones, continued
    lose_passed(point, (x, surface), beyond_edges(surface), ray)
    assert ray[1][0] == NONE


def test_what_lies_outside_a_corner_is_as_far_as_the_farther_edge():
    x, surface = plate()
    shares = [covered(0.3 * SQUARE + [3.0 + a, 3.0 + b, 0.0], x, surface)[0][4] for a, b in ((0.01, 0.02), (-0.1, 0.02))]
    np.testing.assert_allclose(shares[0], shares[1])
    assert 0.0 < shares[0] < 0.5
