"""Where the inward normal of a slave facet meets the master surface: facet, place on it, gap.

The point x_S of a slave facet with outward normal n_S is paired with the point r(xi) of the master for which
x_S - r(xi) = g n, n = -n_S.  Direction and gap are continuous where r(xi) passes from one master facet to the next, on
ridges and in valleys alike; a closest point is not, for g < 0 under a ridge.  Puso & Laursen 2004,
doi:10.1016/j.cma.2003.10.010, for the use of the slave's normal.

Points on the border of their surface may meet the master just beyond its own: where both surfaces end on one plane they part
by what their strains differ, and polygons that stand for round surfaces have normals there that lean out of the body by half
the angle between facets.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.broad_phase import Balls, facet_balls
from fenics_contact.kernels.closest_point import INTERIOR, NONE, OVERLAP, Lists, Projection
from fenics_contact.kernels.facets import PlacedSurface
from fenics_contact.kernels.normals import tangents_at
from fenics_contact.kernels.vectors import ZERO, Vector, cross, dot, less, minus, norm, plus, row, times
from fenics_contact.types import Floats, Ints64

Patch = tuple[Vector, Vector, Vector, Vector]  # c0, c1, c2, c3

MAX_NEWTON = 30


@njit(cache=True, error_model="numpy")
def _meet(x: Vector, n: Vector, m: int, patch: Patch) -> tuple[bool, bool, float, float, float]:
    """Newton for x - r(xi) = g n on the patch r = c0 + c1 s + c2 t + c3 s t; returns (found, inside, xi1, xi2, g)."""
    c0, c1, c2, c3 = patch
    s = t = 1.0 / 3.0 if m == 3 else 0.0
    size = max(max(abs(c1[0]), abs(c1[1]), abs(c1[2])), max(abs(c2[0]), abs(c2[1]), abs(c2[2])))
    for _ in range(MAX_NEWTON):
        r1, r2 = less(c1, -t, c3), less(c2, -s, c3)
        d = less(less(minus(x, c0), s, c1), t, r2)
        # n x (d - r_a dxi^a) = 0, projected on r_1 x n and r_2 x n
        one, two = cross(r2, n), cross(n, r1)
        det = dot(r1, one)
        if not abs(det) > 1e-12 * size * size:
            return False, False, 0.0, 0.0, 0.0
        ds, dt = dot(d, one) / det, dot(d, two) / det
        s, t = s + ds, t + dt
        if abs(s) > 50.0 or abs(t) > 50.0:
            return False, False, 0.0, 0.0, 0.0
        if max(abs(ds), abs(dt)) < 1e-12:
            g = dot(less(less(minus(x, c0), s, c1), t, less(c2, -s, c3)), n)
            low = -OVERLAP if m == 3 else -1.0 - OVERLAP
            inside = s >= low and t >= low and (s + t <= 1.0 + OVERLAP if m == 3 else max(s, t) <= 1.0 + OVERLAP)
            return True, inside, s, t, g
    return False, False, 0.0, 0.0, 0.0


@njit(cache=True)
def _patch(m: int, x0: Vector, x1: Vector, x2: Vector, x3: Vector) -> Patch:
    """c0, c1, c2, c3 of r(s, t) = c0 + c1 s + c2 t + c3 s t on a facet with these corners."""
    if m == 3:
        return x0, minus(x1, x0), minus(x2, x0), ZERO
    one, two = minus(x1, x0), minus(x2, x3)
    low, high = plus(x0, x1), plus(x2, x3)
    return (
        times(0.25, plus(low, high)),
        times(0.25, plus(one, two)),
        times(0.25, minus(high, low)),
        times(0.25, minus(two, one)),
    )


@njit(cache=True)
def _facet_patch(f: int, master: PlacedSurface) -> Patch:
    """`_patch` of facet f."""
    coords, (nodes, size) = master
    x0, x1, x2, x3 = row(coords, nodes[f, 0]), row(coords, nodes[f, 1]), row(coords, nodes[f, 2]), row(coords, nodes[f, 3])
    return _patch(size[f], x0, x1, x2, x3)


@njit(cache=True)
def _faces(n: Vector, s: float, t: float, patch: Patch, facing: float) -> bool:
    """True where the cosine between the patch's normal and n is above `facing`."""
    _, c1, c2, c3 = patch
    area = cross(less(c1, -t, c3), less(c2, -s, c3))
    return dot(area, n) > facing * norm(area)


@njit(cache=True, error_model="numpy")
def slave_rays(
    points: Floats,
    directions: Floats,
    master: PlacedSurface,
    lists: Lists,
    reach: tuple[float, float, float],
    projection: Projection,
) -> None:
    """Pair points (np, 3) of slave facets with the master facet that their normal meets nearest within a search distance.

    directions (np, 3): unit normals into the slave; master, lists, projection as in kernels/closest_point.py, kind INTERIOR
    or NONE. reach: (search [length]; beyond: a ray that meets no facet is paired with the one it misses least, continued, if
    it misses that by no more than this share of the radius of the facet's ball; facing: cosine of the angle between n and
    the normals of facets that are no partners up to it, 0: those that look the slave's own way).
    """
    size, (offsets, listed), (search, beyond, facing) = master[1][1], lists, reach
    facet, kind, feature, xi, gap, normal = projection
    balls = centres, radii = facet_balls(master)
    for q in range(points.shape[0]):
        facet[q], kind[q], feature[q], gap[q] = -1, NONE, -1, np.inf
        xi[q, 0] = xi[q, 1] = 0.0
        n, x = row(directions, q), row(points, q)
        normal[q, 0], normal[q, 1], normal[q, 2] = n
        mine, nearest = listed[offsets[q] : offsets[q + 1]], np.inf
        for f in mine:
            d = minus(row(centres, f), x)
            along = dot(d, n)
            if dot(d, d) - along * along > radii[f]:
                continue  # the ray passes by
            patch = _facet_patch(f, master)
            _, inside, s, t, g = _meet(x, n, size[f], patch)
            if not inside or not abs(g) <= search or abs(g) >= nearest or not _faces(n, s, t, patch, facing):
                continue
            nearest = abs(g)
            facet[q], kind[q], gap[q] = f, INTERIOR, g
            xi[q, 0], xi[q, 1] = s, t
        if kind[q] == NONE and beyond > 0.0:
            f, s, t, g = _least_missed(x, n, mine, master, reach, balls)
            if f >= 0:
                facet[q], kind[q], gap[q] = f, INTERIOR, g
                xi[q, 0], xi[q, 1] = s, t


@njit(cache=True, error_model="numpy")
def _least_missed(
    x: Vector,
    n: Vector,
    mine: Ints64,
    master: PlacedSurface,
    reach: tuple[float, float, float],
    balls: Balls,
) -> tuple[int, float, float, float]:
    """(facet or -1, xi1, xi2, g): of the listed facets, continued, the one whose border the ray passes nearest."""
    best, least, place1, place2, gap = -1, np.inf, 0.0, 0.0, 0.0
    size, (search, beyond, facing), (centres, radii) = master[1][1], reach, balls
    for f in mine:
        arm = minus(row(centres, f), x)
        along = dot(arm, n)
        if dot(arm, arm) - along * along > (1.0 + beyond) ** 2 * radii[f]:
            continue
        patch = _facet_patch(f, master)
        found, _, s, t, g = _meet(x, n, size[f], patch)
        if not found or not abs(g) <= search or not _faces(n, s, t, patch, facing):
            continue
        miss = _off_facet(less(x, g, n), f, master)
        if miss * miss <= beyond * beyond * radii[f] and miss < least:
            best, least, place1, place2, gap = f, miss, s, t, g
    return best, place1, place2, gap


@njit(cache=True, error_model="numpy")
def _off_facet(p: Vector, f: int, master: PlacedSurface) -> float:
    """Distance of place p from the nearest edge of facet f."""
    coords, (nodes, size) = master
    nearest = np.inf
    for i in range(size[f]):
        start, end = row(coords, nodes[f, i]), row(coords, nodes[f, (i + 1) % size[f]])
        edge, d = minus(end, start), minus(p, start)
        along = min(max(dot(d, edge) / max(dot(edge, edge), 1e-300), 0.0), 1.0)
        nearest = min(nearest, norm(less(d, along, edge)))
    return nearest


@njit(cache=True, error_model="numpy")
def facet_directions(coords: Floats, nodes: Ints64, gradients: Floats, directions: Floats) -> None:
    """Fill directions (np, 3) with the unit normals of the points' own facets, into the slave.

    nodes (np, k) of the facet; gradients (np, 2, k) of their shape functions, counter-clockwise seen from outside.
    """
    for q in range(len(directions)):
        t1, t2 = tangents_at(coords, nodes, q, gradients, q)
        n = cross(t2, t1)
        directions[q, 0], directions[q, 1], directions[q, 2] = times(1.0 / max(norm(n), 1e-300), n)
