"""Where rays meet curved facets of degree 2: no facet is left out that a ray goes through, and few are tried in vain."""

import numpy as np
import pytest

from fenics_contact.kernels.broad_phase import facet_balls
from fenics_contact.kernels.closest_point import INTERIOR
from fenics_contact.kernels.facets import corner
from fenics_contact.kernels.quadratic import (
    LINE,
    QUADRILATERAL,
    STRIP,
    TRIANGLE,
    _hulls,
    _passes_by,
    _within,
    quadratic_rays,
    quadratic_shape,
)

KINDS = [LINE, STRIP, TRIANGLE, QUADRILATERAL]


def facet(m, bulge, rng):
    """(coords, (nodes, size)) of one facet around the origin that faces z, or y in the plane, its nodes moved at random."""
    if m == LINE:
        x = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        way = [1.0, 1.0, 0.0]
    else:
        ring = np.array([(*corner(3 if m == TRIANGLE else 4, i), 0.0) for i in range(3 if m == TRIANGLE else 4)])
        middles = 0.5 * (ring + np.roll(ring, -1, axis=0))
        x = np.concatenate([ring, middles[::2] if m == STRIP else middles, ring.mean(axis=0)[None]])
        x, way = x[: 6 if m == STRIP else m], [1.0, 1.0, 1.0]
    x = x + bulge * rng.uniform(-1.0, 1.0, x.shape) * way
    return x, (np.arange(len(x))[None], np.array([m]))


def places(m, count, rng):
    """Places (count, 2) in a facet, on its corners and edges first."""
    s, t = rng.uniform(-1.0, 1.0, (2, count))
    s[:4], t[:4] = [-1.0, 1.0, 1.0, -0.3], [-1.0, -1.0, 1.0, -1.0]
    if m == TRIANGLE:
        s, t = 0.5 * (1.0 + s), 0.25 * (1.0 + t) * (1.0 - s)
    return np.column_stack([s, t])


def on(m, master, place):
    """Position and unit normal of the facet at a place."""
    N = np.zeros((3, len(master[0])))
    quadratic_shape(m, *place, N)
    r, r1, r2 = N @ master[0]
    normal = np.cross(r1, [0.0, 0.0, 1.0] if m == LINE else r2)
    return r, normal / np.linalg.norm(normal)


def met(points, directions, master, beyond):
    n = len(points)
    whole = [np.empty(n, dtype=np.int64) for _ in range(3)]
    out = *whole, np.empty((n, 2)), np.empty(n), np.empty((n, 3))
    lists = np.arange(n + 1), np.zeros(n, dtype=np.int64)
    quadratic_rays(points, directions, master, lists, (1.0, beyond, 0.0), out)
    return out


@pytest.mark.serial
@pytest.mark.parametrize("m", KINDS)
@pytest.mark.parametrize("beyond", [0.0, 1.0])
def test_rays_through_curved_facets(m, beyond):
    """Rays that start off a place of a facet and go through it meet it, there or nearer."""
    rng = np.random.default_rng(m)
    for _ in range(50):
        master = facet(m, 0.15, rng)
        start, ways, gaps = [], [], rng.uniform(-0.999, 0.999, 20)
        for place, gap in zip(places(m, 20, rng), gaps, strict=True):
            r, normal = on(m, master, place)
            n = normal + 0.3 * rng.uniform(-1.0, 1.0, 3) * [1.0, 1.0, m != LINE]
            n /= np.linalg.norm(n)
            start, ways = [*start, r + gap * n], [*ways, n]
        points, directions = np.array(start), np.array(ways)
        _, kind, _, xi, gap, _ = met(points, directions, master, beyond)
        assert (kind == INTERIOR).all() and (np.abs(gap) <= np.abs(gaps) + 1e-9).all()
        feet = np.array([on(m, master, place)[0] for place in xi])
        off = points - gap[:, None] * directions - feet
        assert np.abs(off[:, : 2 if m == LINE else 3]).max() < 1e-9


@pytest.mark.serial
@pytest.mark.parametrize("m", KINDS)
def test_rays_past_flat_facets(m):
    """Facets that rays go past by a thousandth of their size are left out before they are tried."""
    master = facet(m, 0.0, np.random.default_rng(0))
    ball, normal = facet_balls(master)[1][0], on(m, master, (0.3, 0.3))[1]
    centre = master[0].mean(axis=0)
    for place in [(0.0, 0.4), (0.4, 0.0)] if m == TRIANGLE else [(-1.0, 0.2), (1.0, 0.2), (0.2, -1.0), (0.2, 1.0)]:
        if m == LINE and abs(place[0]) < 1.0:
            continue  # goes on along z for ever
        edge = on(m, master, place)[0]
        for size, past in ((1.001, True), (0.999, False)):
            x = centre + size * (edge - centre) - 0.3 * normal
            assert _passes_by(tuple(x), tuple(normal), 0, m, _hulls(master), ball) == past


@pytest.mark.parametrize("m", [TRIANGLE, QUADRILATERAL])
def test_the_nearest_place_of_a_facet_is_none_outside_of_it(m):
    """Past a corner, too: of a grid of places in the facet none is nearer."""
    s, t = np.meshgrid(*[np.linspace(0.0 if m == TRIANGLE else -1.0, 1.0, 201)] * 2)
    inside = np.column_stack([s.ravel(), t.ravel()])
    inside = inside[inside.sum(axis=1) < 1.0 + 1e-9] if m == TRIANGLE else inside
    for place in np.random.default_rng(3).uniform(-2.0, 2.5, (200, 2)):
        nearest = np.array(_within(m, *place))
        assert np.linalg.norm(inside - nearest, axis=1).min() < 0.01
        assert np.linalg.norm(place - nearest) < np.linalg.norm(inside - place, axis=1).min() + 1e-9
