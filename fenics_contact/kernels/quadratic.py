"""Master facets of degree 2, straight or curved: their shape functions, and where rays along a slave's normal meet them.

A surface is a pair of arrays: nodes (nf, m) int64 and size (nf,) int64, the number m of nodes: 9 of quadrilaterals, 6 of
triangles, 3 of the sides of a plane mesh.  Corners come first, as in kernels/facets.py, then the middles of the sides, the
first between the corners 0 and 1, then the centre.  A side of a plane mesh lives on [-1, 1] and goes on along z for ever:
its second coordinate is that way, and r_2 = e_z.  Where it ends, as far behind the plane as before it, it is a strip of 6
nodes, near ends, far ends, near and far middle, whose size is said to be 5, for triangles have 6.

What first derivatives tell of such a facet at a foot is told by the flat one that touches it there, with corners x_M,
x_M + r_1, x_M + r_2: these are sums of the facet's nodes.  The tangent of a ray's pair, kernels/ray_element.py, asks for no
more, so the kernels of flat facets serve, and what they give is carried from the corners to the nodes.
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.broad_phase import CLEAR, Balls, facet_balls
from fenics_contact.kernels.closest_point import INTERIOR, NONE, OVERLAP, Lists, Projection
from fenics_contact.kernels.couplings import Pattern, find
from fenics_contact.kernels.facets import MAX_NODES, PlacedSurface, Surface, shape, shape_gradient
from fenics_contact.kernels.slave_ray import MAX_NEWTON
from fenics_contact.kernels.vectors import ZERO, Vector, cross, dot, got, less, minus, norm, row
from fenics_contact.types import Bools, Floats, Ints64

LINE, STRIP, TRIANGLE, QUADRILATERAL = 3, 5, 6, 9
ALONG_Z = (0.0, 0.0, 1.0)
# of a facet's squared radius: between its nodes a curved facet may bulge out of the ball that holds these
BULGE = 1.2
FAR = 4.0  # a facet continued beyond that is no facet any more
# where Newton's method starts on a facet until a foot is found
STARTS_2 = np.array([[0.0, 0.0], [-0.6, -0.6], [0.6, 0.6], [0.6, -0.6], [-0.6, 0.6]])
STARTS_3 = np.array([[1.0 / 3.0, 1.0 / 3.0], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8]])


@njit(cache=True)
def _line(s: float) -> tuple[float, float, float, float, float, float]:
    """Shape functions of the ends and the middle of [-1, 1], then their derivatives."""
    return 0.5 * s * (s - 1.0), 0.5 * s * (s + 1.0), 1.0 - s * s, s - 0.5, s + 0.5, -2.0 * s


@njit(cache=True)
def quadratic_shape(m: int, s: float, t: float, N: Floats) -> None:
    """Fill N (3, m) with N_i, N_i,1 and N_i,2 at (s, t); N_i,2 = 0 on a side of a plane mesh."""
    if m == LINE:
        N[0, 0], N[0, 1], N[0, 2], N[1, 0], N[1, 1], N[1, 2] = _line(s)
        N[2, 0] = N[2, 1] = N[2, 2] = 0.0
    elif m == STRIP:
        a0, a1, a2, d0, d1, d2 = _line(s)
        low, high = 0.5 * (1.0 - t), 0.5 * (1.0 + t)
        N[0, 0], N[0, 1], N[0, 2], N[0, 3], N[0, 4], N[0, 5] = low * a0, low * a1, high * a1, high * a0, low * a2, high * a2
        N[1, 0], N[1, 1], N[1, 2], N[1, 3], N[1, 4], N[1, 5] = low * d0, low * d1, high * d1, high * d0, low * d2, high * d2
        N[2, 0], N[2, 1], N[2, 4] = -0.5 * a0, -0.5 * a1, -0.5 * a2
        N[2, 2], N[2, 3], N[2, 5] = 0.5 * a1, 0.5 * a0, 0.5 * a2
    elif m == TRIANGLE:
        r = 1.0 - s - t
        N[0, 0], N[0, 1], N[0, 2] = r * (2.0 * r - 1.0), s * (2.0 * s - 1.0), t * (2.0 * t - 1.0)
        N[0, 3], N[0, 4], N[0, 5] = 4.0 * r * s, 4.0 * s * t, 4.0 * t * r
        N[1, 0], N[1, 1], N[1, 2] = 1.0 - 4.0 * r, 4.0 * s - 1.0, 0.0
        N[1, 3], N[1, 4], N[1, 5] = 4.0 * (r - s), 4.0 * t, -4.0 * t
        N[2, 0], N[2, 1], N[2, 2] = 1.0 - 4.0 * r, 0.0, 4.0 * t - 1.0
        N[2, 3], N[2, 4], N[2, 5] = -4.0 * s, 4.0 * s, 4.0 * (r - t)
    else:
        a0, a1, a2, d0, d1, d2 = _line(s)
        b0, b1, b2, e0, e1, e2 = _line(t)
        _nine(N, 0, (a0, a1, a2), (b0, b1, b2))
        _nine(N, 1, (d0, d1, d2), (b0, b1, b2))
        _nine(N, 2, (a0, a1, a2), (e0, e1, e2))


@njit(cache=True)
def _nine(N: Floats, i: int, a: Vector, b: Vector) -> None:
    """Fill N[i] with the products of what the ends and the middle have along both sides, a along the first."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    N[i, 0], N[i, 1], N[i, 2], N[i, 3] = a0 * b0, a1 * b0, a1 * b1, a0 * b1
    N[i, 4], N[i, 5], N[i, 6], N[i, 7], N[i, 8] = a2 * b0, a1 * b2, a2 * b1, a0 * b2, a2 * b2


@njit(cache=True)
def foot_shapes(at: Ints64, surface: Surface, projection: Projection, N: Floats) -> None:
    """Fill N (n, 3, m): shape functions and derivatives at the feet of the points `at` (n,), on flat facets too."""
    (nodes, size), facet, kind, xi = surface, projection[0], projection[1], projection[3]
    N[:] = 0.0
    for i in range(len(at)):
        q = at[i]
        if kind[q] == NONE:
            continue
        f, s, t = facet[q], xi[q, 0], xi[q, 1]
        if nodes.shape[1] == MAX_NODES:
            N[i, 0, 0], N[i, 0, 1], N[i, 0, 2], N[i, 0, 3] = shape(size[f], s, t)
            one, two = shape_gradient(size[f], s, t)
            N[i, 1, 0], N[i, 1, 1], N[i, 1, 2], N[i, 1, 3] = one
            N[i, 2, 0], N[i, 2, 1], N[i, 2, 2], N[i, 2, 3] = two
        else:
            quadratic_shape(size[f], s, t, N[i])


@njit(cache=True)
def _frame(x: Vector, f: int, master: PlacedSurface, N: Floats) -> tuple[Vector, Vector, Vector]:
    """x - r, r_1, r_2 of facet f with the shape functions N (3, m): sums of how far its nodes are from x, for sums of places
    far from the origin round by more than Newton's method ends at."""
    coords, (nodes, size) = master
    d, r1, r2 = ZERO, ZERO, ALONG_Z if size[f] == LINE else ZERO
    for i in range(nodes.shape[1]):
        arm = minus(x, row(coords, nodes[f, i]))
        d, r1, r2 = less(d, -N[0, i], arm), less(r1, N[1, i], arm), less(r2, N[2, i], arm)
    return d, r1, r2


@njit(cache=True, error_model="numpy")
def _meet(
    x: Vector, n: Vector, f: int, master: PlacedSurface, start: Floats, N: Floats
) -> tuple[bool, float, float, float, float]:
    """Newton for x - r(xi) = g n on facet f from a start (2,); returns (found, xi1, xi2, g, cosine of n and its normal)."""
    s, t, m = start[0], start[1], master[1][1][f]
    if m == LINE:
        t = 0.0
    for _ in range(MAX_NEWTON):
        quadratic_shape(m, s, t, N)
        d, r1, r2 = _frame(x, f, master, N)
        # n x (d - r_a dxi^a) = 0, projected on r_1 x n and r_2 x n
        one, two = cross(r2, n), cross(n, r1)
        det = dot(r1, one)
        if not abs(det) > 1e-12 * norm(r1) * norm(r2):
            return False, 0.0, 0.0, 0.0, 0.0
        ds, dt = dot(d, one) / det, dot(d, two) / det
        s, t = s + ds, t + dt
        if abs(s) > FAR or m != LINE and abs(t) > FAR:
            return False, 0.0, 0.0, 0.0, 0.0
        if max(abs(ds), abs(dt)) < 1e-12:
            area = cross(r1, r2)
            return True, s, t, dot(less(less(d, ds, r1), dt, r2), n), dot(area, n) / norm(area)
    return False, 0.0, 0.0, 0.0, 0.0


@njit(cache=True)
def _within(m: int, s: float, t: float) -> tuple[float, float]:
    """The place of a facet that is nearest to (s, t) in its coordinates: inside (s, t) itself, but for rounding."""
    if m == TRIANGLE:
        over = 0.5 * max(s + t - 1.0, 0.0)
        s, t = s - over, t - over
        return min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
    return min(max(s, -1.0), 1.0), t if m == LINE else min(max(t, -1.0), 1.0)


@njit(cache=True)
def _corners(m: int) -> int:
    return 2 if m == LINE else 3 if m == TRIANGLE else 4


@njit(cache=True)
def _hulls(master: PlacedSurface) -> Floats:
    """Control points (nf, k, 3) of the facets: each facet lies in their convex hull."""
    coords, (nodes, size) = master
    hulls = coords[nodes.ravel()].reshape((*nodes.shape, 3))
    for f in range(len(size)):
        x, m, c = hulls[f], size[f], _corners(size[f])
        if m == QUADRILATERAL:
            for p in range(3):
                x[8, p] = 4.0 * x[8, p] - x[4:8, p].sum() + 0.25 * x[:4, p].sum()
        for i in range(1 if m == LINE else 2 if m == STRIP else c):
            a, b = (2 * i, 2 * i + 1) if m == STRIP else (i, (i + 1) % c)
            x[c + i] = 2.0 * x[c + i] - 0.5 * (x[a] + x[b])
    return hulls


@njit(cache=True)
def _passes_by(x: Vector, n: Vector, f: int, m: int, hulls: Floats, radius: float) -> bool:
    """Whether all control points of facet f, of a ball of this squared radius, lie on one side of the ray from x along n, as
    seen along an edge: then the ray does not meet the facet."""
    c = _corners(m)
    for i in range(1 if m == LINE else c):
        edge = ALONG_Z if m == LINE else minus(got(hulls, f, (i + 1) % c), got(hulls, f, i))
        across, low, high = cross(n, edge), np.inf, -np.inf
        for j in range(hulls.shape[1]):
            d = dot(across, minus(got(hulls, f, j), x))
            low, high = min(low, d), max(high, d)
        if max(low, -high) > CLEAR * math.sqrt(radius * dot(across, across)):
            return True
    return False


@njit(cache=True)
def _near(arm: Vector, n: Vector, limit: float, search: float) -> bool:
    """Whether a ray along n comes nearer to what lies at the end of this arm than a squared distance, within search."""
    along = dot(arm, n)
    over = max(abs(along) - search, 0.0)
    return dot(arm, arm) - along * along + over * over <= limit


@njit(cache=True, error_model="numpy")
def quadratic_rays(
    points: Floats,
    directions: Floats,
    master: PlacedSurface,
    lists: Lists,
    reach: tuple[float, float, float],
    projection: Projection,
) -> None:
    """Pair points (np, 3) of slave facets with the master facet that their normal meets nearest within a search distance.

    All as in kernels/slave_ray.py.
    """
    size, (offsets, listed), (search, beyond, facing) = master[1][1], lists, reach
    facet, kind, feature, xi, gap, normal = projection
    balls, hulls, N = facet_balls(master), _hulls(master), np.zeros((3, QUADRILATERAL))
    centres, radii = balls
    for q in range(points.shape[0]):
        facet[q], kind[q], feature[q], gap[q] = -1, NONE, -1, np.inf
        xi[q, 0] = xi[q, 1] = 0.0
        n, x = row(directions, q), row(points, q)
        normal[q, 0], normal[q, 1], normal[q, 2] = n
        mine, nearest = listed[offsets[q] : offsets[q + 1]], np.inf
        for f in mine:
            if not _near(minus(row(centres, f), x), n, BULGE * radii[f], min(search, nearest)):
                continue
            if _passes_by(x, n, f, size[f], hulls, radii[f]):
                continue
            starts = STARTS_3 if size[f] == TRIANGLE else STARTS_2
            for i in range(LINE if size[f] == LINE else len(starts)):
                found, s, t, g, cosine = _meet(x, n, f, master, starts[i], N)
                if not found or not cosine > facing or not abs(g) <= search:
                    continue
                u, v = _within(size[f], s, t)
                if max(abs(s - u), abs(t - v)) > OVERLAP:
                    continue
                if abs(g) < nearest:
                    nearest = abs(g)
                    facet[q], kind[q], gap[q] = f, INTERIOR, g
                    xi[q, 0], xi[q, 1] = s, t
                break
        if kind[q] == NONE and beyond > 0.0:
            f, s, t, g = _least_missed(x, n, mine, master, reach, balls)
            if f >= 0:
                facet[q], kind[q], gap[q] = f, INTERIOR, g
                xi[q, 0], xi[q, 1] = s, t


@njit(cache=True, error_model="numpy")
def _least_missed(
    x: Vector, n: Vector, mine: Ints64, master: PlacedSurface, reach: tuple[float, float, float], balls: Balls
) -> tuple[int, float, float, float]:
    """(facet or -1, xi1, xi2, g): of the listed facets, continued, the one that the ray misses least."""
    best, least, place1, place2, gap = -1, np.inf, 0.0, 0.0, 0.0
    size, (search, beyond, facing), (centres, radii) = master[1][1], reach, balls
    N = np.zeros((3, QUADRILATERAL))
    for f in mine:
        if not _near(minus(row(centres, f), x), n, (1.0 + beyond) ** 2 * BULGE * radii[f], np.inf):
            continue
        starts = STARTS_3 if size[f] == TRIANGLE else STARTS_2
        for i in range(LINE if size[f] == LINE else len(starts)):
            found, s, t, g, cosine = _meet(x, n, f, master, starts[i], N)
            if not found or not cosine > facing or not abs(g) <= search:
                continue
            u, v = _within(size[f], s, t)
            quadratic_shape(size[f], u, v, N)
            miss = norm(_frame(less(x, g, n), f, master, N)[0])
            if miss * miss <= beyond * beyond * radii[f] and miss < least:
                best, least, place1, place2, gap = f, miss, s, t, g
    return best, place1, place2, gap


@njit(cache=True)
def add_lifted(matrices: Floats, lift: Floats, nodes: Ints64, rows: int, pattern: Pattern, out: tuple[Floats, Bools]) -> int:
    """Add lift^T matrix lift of each pair to the blocks of a pattern; returns the number of blocks that are not in it.

    matrices (n, c, c, 3, 3): blocks between the corners of flat facets; lift (n, c, k): the parts of the nodes (n, k) in
    them; forces act on the first `rows` of these. pattern: as in kernels/couplings.py; out = (values (nb, 3, 3), used
    (nb,)).
    """
    (blocks, first, end, columns), (values, used), missing = pattern, out, 0
    corners, k = lift.shape[1:]
    half = np.empty((corners, k, 9))
    for q in range(len(nodes)):
        half[:] = 0.0
        for c in range(corners):
            for d in range(corners):
                for j in range(k):
                    part = lift[q, d, j]
                    if part != 0.0:
                        for e in range(9):
                            half[c, j, e] += part * matrices[q, c, d, e // 3, e % 3]
        for i in range(rows):
            node = nodes[q, i]
            for j in range(k):
                if nodes[q, j] < 0:
                    continue  # no anchor
                at = find(columns, first[node], end[node], blocks[nodes[q, j]])
                if at < 0:
                    missing += 1
                    continue
                used[at] = True
                for c in range(corners):
                    part = lift[q, c, i]
                    if part != 0.0:
                        for e in range(9):
                            values[at, e // 3, e % 3] += part * half[c, j, e]
    return missing
