"""Parts of a slave's facets that lie over one facet of the master each, and samples in them.

Where edges of the master cross a facet of the slave, what is averaged over it has kinks, which Gauss points of the whole
facet do not see: bodies under a uniform pressure whose meshes do not match feel an uneven one.  So the facet and those of
the master are seen along the mean normal of its corners, it is clipped by them (Sutherland & Hodgman 1974,
doi:10.1145/360767.360802), and each part has samples of its own: Puso & Laursen 2004, doi:10.1016/j.cma.2003.10.010.

Triangular and quadrangular parts have the rule of their shape. Others have four samples on their ellipse of inertia, or,
where products of shape functions are of a high degree, are cut into triangles around their centroid: it does not matter in
which corner they begin.  A facet of which one part is all, or whose parts do not add up to it, because
the master ends or goes on beyond a crease, has the samples of a facet that nothing crosses.

    rules      ((places (n, 2) and weights (n,) on a quadrilateral [-1, 1]^2) and (the same on the unit triangle) for parts,
               (the same) of facets that nothing crosses, whether four samples on an ellipse are enough for other parts)
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import Lists
from fenics_contact.kernels.coverage import faces
from fenics_contact.kernels.facets import Surface, shape, shape_gradient
from fenics_contact.kernels.vectors import ZERO, Vector, cross, dot, less, minus, norm, row, times
from fenics_contact.types import Bools, Floats, Ints64

Rule = tuple[Floats, Floats]
Rules = tuple[Rule, Rule, Rule, bool]
# the master's facets, and those beyond their edges (nf, 4); -1: none; JOINT - g: facet g, whose own edge lies beside
Joined = tuple[Surface, Ints64]
Sites = tuple[Ints64, Floats, Floats]  # first (nf + 1,), places (np, 2) on the facets, weights (np,) of these coordinates

MOST = 16  # corners of a part: eight, and room for edges that nearly coincide
ON = 1e-8  # of a facet's size: how far off an edge of the master counts as on it
WHOLE = 1e-6  # of a facet's area: what may lack of it
SEAM = 0.1  # the same where facets side by side have no common nodes: there is a gap between them, or they overlap
JOINT = -2
NONE = 1e-9  # of a facet's area: parts that are none
# Of a part's area: what a corner cuts off is less where edges of slave and master coincide but for what a gap between them
# shifts them by, seen along a normal. A part without that corner has the samples of one on a plane of symmetry: other ones
# measure differently how much of them lies beyond an end, by up to a percent of the force. Four on an ellipse hardly do
CUT_OFF = 1e-4
MAX_NEWTON = 20


@njit(cache=True, error_model="numpy")
def facet_parts(
    coords: Floats,
    slave: tuple[Ints64, Floats],
    master: Joined,
    near: tuple[Lists, float],
    rules: Rules,
    sites: Sites,
) -> int:
    """Fill sites of the slave's facets; returns how many samples they have: called again where that is more than there is
    room for.

    slave: (corners (nf, m), normals (nf, 3) out of it in the facets' centres); near: (CSR lists of the master's facets that
    may lie over each, and how far off they may be along the normal [length]).
    """
    (corners, normals), ((offsets, listed), search), (first, places, weights) = slave, near, sites
    surface, goes_on = master[0], np.empty(4, np.bool_)
    m, end = corners.shape[1], 0
    own, clip, room = np.empty((m, 2)), np.empty((4, 2)), np.empty((2, MOST, 2))
    parts, sizes = np.empty((8, MOST, 2)), np.empty(8, np.int64)
    for f in range(len(corners)):
        first[f], n, total, greatest, seam = end, 0, 0.0, 0.0, False
        x, e1, e2, normal = _frame(coords, corners[f], row(normals, f))
        for i in range(m):
            _put_seen(own, i, minus(row(coords, corners[f, i]), x), e1, e2)
        area, low, high = _area(own, m), _least(own), _greatest(own)
        for g in listed[offsets[f] : offsets[f + 1]]:
            if not faces(g, times(-1.0, normal), coords, surface):
                continue
            if not _put_facet(clip, coords, surface[0][g, : surface[1][g]], (x, e1, e2, normal), search):
                continue
            if not _overlap(clip[: surface[1][g]], low, high):
                continue
            for e in range(surface[1][g]):
                goes_on[e], joint = _goes_on(g, e, master, times(-1.0, normal), coords)
                seam = seam or joint
            size = _clipped(own, clip[: surface[1][g]], goes_on, ON * np.sqrt(abs(area)), room)
            part = _area(room[0], size)
            if not part > NONE * area:
                continue
            if n == len(parts):
                parts, sizes = _longer(parts, sizes)
            parts[n, :size], sizes[n] = room[0, :size], size
            n, total, greatest = n + 1, total + part, max(greatest, part)
        if greatest >= (1.0 - WHOLE) * area or not abs(total - area) <= (SEAM if seam else WHOLE) * area:
            end = _put_whole(rules[2], places, weights, end)
            continue
        for i in range(n):
            end = _put_part(own, parts[i, : sizes[i]], rules, places, weights, end)
    first[len(corners)] = end
    return end


@njit(cache=True)
def _longer(parts: Floats, sizes: Ints64) -> tuple[Floats, Ints64]:
    """The same with room for twice as many."""
    n = len(parts)
    more, counts = np.empty((2 * n, MOST, 2)), np.empty(2 * n, np.int64)
    more[:n], counts[:n] = parts, sizes
    return more, counts


@njit(cache=True, error_model="numpy")
def _frame(coords: Floats, corners: Ints64, normal: Vector) -> tuple[Vector, Vector, Vector, Vector]:
    """The centre of a facet, two directions normal to its normal and to one another, and the normal, all of length one."""
    m, x = len(corners), ZERO
    for i in range(m):
        x = less(x, -1.0 / m, row(coords, corners[i]))
    along = minus(row(coords, corners[1]), row(coords, corners[0]))
    along = less(along, dot(along, normal), normal)
    e1 = times(1.0 / norm(along), along)
    return x, e1, cross(normal, e1), normal


@njit(cache=True)
def _goes_on(g: int, e: int, master: Joined, n: Vector, coords: Floats) -> tuple[bool, bool]:
    """Whether the master goes on beyond the edge that starts in a corner of facet g as `_put_facet` counts these: else it
    ends there, and what of the slave lies beyond is told by shares, see kernels/coverage.py; and whether it does so on
    another facet's edge, see `Joined`."""
    m = master[0][1][g]
    beyond = master[1][g, (2 * m - 2 - e) % m]
    joint = beyond <= JOINT
    beyond = JOINT - beyond if joint else beyond
    goes_on = beyond >= 0 and faces(beyond, n, coords, master[0])
    return goes_on, joint and goes_on


@njit(cache=True)
def _put_seen(polygon: Floats, i: int, x: Vector, e1: Vector, e2: Vector) -> None:
    polygon[i, 0], polygon[i, 1] = dot(x, e1), dot(x, e2)


@njit(cache=True)
def _put_facet(
    polygon: Floats, coords: Floats, nodes: Ints64, frame: tuple[Vector, Vector, Vector, Vector], search: float
) -> bool:
    """Put corners of a facet of the master as seen along the normal, counter-clockwise like those of the slave; False where
    it is too far off along the normal."""
    (x, e1, e2, normal), m, low, high = frame, len(nodes), np.inf, -np.inf
    for i in range(m):
        y = minus(row(coords, nodes[m - 1 - i]), x)
        low, high = min(low, dot(y, normal)), max(high, dot(y, normal))
        _put_seen(polygon, i, y, e1, e2)
    return low <= search and high >= -search


@njit(cache=True)
def _least(polygon: Floats) -> tuple[float, float]:
    return polygon[:, 0].min(), polygon[:, 1].min()


@njit(cache=True)
def _greatest(polygon: Floats) -> tuple[float, float]:
    return polygon[:, 0].max(), polygon[:, 1].max()


@njit(cache=True)
def _overlap(polygon: Floats, low: tuple[float, float], high: tuple[float, float]) -> bool:
    """Whether its box overlaps the one from low to high."""
    (l0, l1), (h0, h1) = _least(polygon), _greatest(polygon)
    return l0 < high[0] and h0 > low[0] and l1 < high[1] and h1 > low[1]


@njit(cache=True)
def _area(polygon: Floats, n: int) -> float:
    area = 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        area += 0.5 * (polygon[i, 0] * polygon[j, 1] - polygon[j, 0] * polygon[i, 1])
    return area


@njit(cache=True, error_model="numpy")
def _clipped(own: Floats, clip: Floats, goes_on: Bools, on: float, room: Floats) -> int:
    """Put the part of a convex polygon that lies on the left of those edges of another one beyond which it goes on, both
    counter-clockwise, into room[0]; returns how many corners it has."""
    now, n = 0, len(own)
    room[now, :n] = own
    for e in range(len(clip)):
        a0, a1 = clip[e]
        b0, b1 = clip[(e + 1) % len(clip)]
        length, there, k = np.hypot(b0 - a0, b1 - a1), 1 - now, 0
        if not goes_on[e] or not length > 0.0:
            continue
        for i in range(n):
            p, q = room[now, i], room[now, (i + 1) % n]
            d = ((b0 - a0) * (p[1] - a1) - (b1 - a1) * (p[0] - a0)) / length
            h = ((b0 - a0) * (q[1] - a1) - (b1 - a1) * (q[0] - a0)) / length
            if d >= -on and k < MOST:
                room[there, k], k = p, k + 1
            if (d > on and h < -on or d < -on and h > on) and k < MOST:
                room[there, k, 0], room[there, k, 1] = p[0] + d / (d - h) * (q[0] - p[0]), p[1] + d / (d - h) * (q[1] - p[1])
                k += 1
        now, n = there, k
    if now == 1:
        room[0, :n] = room[1, :n]
    return n


@njit(cache=True)
def _put_whole(whole: Rule, places: Floats, weights: Floats, end: int) -> int:
    for i in range(len(whole[1])):
        if end < len(weights):
            places[end], weights[end] = whole[0][i], whole[1][i]
        end += 1
    return end


@njit(cache=True, error_model="numpy")
def _put_part(own: Floats, part: Floats, rules: Rules, places: Floats, weights: Floats, end: int) -> int:
    """Put samples of a part behind the others while there is room; returns where they end."""
    n = len(part) if rules[3] else _straightened(part)
    part = part[:n]
    if n == 4 or n == 3 and not rules[3]:
        return _put_shape(own, part, rules[0] if n == 4 else rules[1], places, weights, end)
    c0, c1, area = _centroid(part)
    if rules[3]:
        return _put_ellipse(own, part, (c0, c1, area), places, weights, end)
    triangle = np.empty((3, 2))
    triangle[2, 0], triangle[2, 1] = c0, c1
    for i in range(n):
        triangle[0], triangle[1] = part[i], part[(i + 1) % n]
        end = _put_shape(own, triangle, rules[1], places, weights, end)
    return end


@njit(cache=True)
def _straightened(part: Floats) -> int:
    """Drop corners that cut off next to nothing; returns how many there are then."""
    n, i, least = len(part), 0, 2.0 * CUT_OFF * abs(_area(part, len(part)))
    while i < n and n > 3:
        p, q, r = part[i - 1 if i > 0 else n - 1], part[i], part[(i + 1) % n]
        if abs((q[0] - p[0]) * (r[1] - q[1]) - (q[1] - p[1]) * (r[0] - q[0])) > least:
            i += 1
            continue
        for j in range(i, n - 1):
            part[j] = part[j + 1]
        n, i = n - 1, 0
    return n


@njit(cache=True, error_model="numpy")
def _centroid(part: Floats) -> tuple[float, float, float]:
    """Centroid and area."""
    c0 = c1 = area = 0.0
    for i in range(1, len(part) - 1):
        x, y, u, v = (
            part[i, 0] - part[0, 0],
            part[i, 1] - part[0, 1],
            part[i + 1, 0] - part[0, 0],
            part[i + 1, 1] - part[0, 1],
        )
        size = 0.5 * (x * v - y * u)
        c0, c1, area = c0 + size * (x + u) / 3.0, c1 + size * (y + v) / 3.0, area + size
    return part[0, 0] + c0 / area, part[0, 1] + c1 / area, area


@njit(cache=True, error_model="numpy")
def _put_ellipse(
    own: Floats, part: Floats, centre: tuple[float, float, float], places: Floats, weights: Floats, end: int
) -> int:
    """Put four samples c + L (+-1, +-1), L L = mean of (x - c) (x - c): these, of any polygon, integrate what is quadratic
    exactly, and lie inside where it is convex, on the ellipse of its inertia."""
    c0, c1, area = centre
    xx = xy = yy = 0.0
    for i in range(len(part)):
        j = (i + 1) % len(part)
        x, y, u, v = part[i, 0] - c0, part[i, 1] - c1, part[j, 0] - c0, part[j, 1] - c1
        share = 0.5 * (x * v - y * u) / (12.0 * area)  # of a triangle with its third corner in c
        xx += share * (x * x + u * u + (x + u) * (x + u))
        xy += share * (x * y + u * v + (x + u) * (y + v))
        yy += share * (y * y + v * v + (y + v) * (y + v))
    s = np.sqrt(max(xx * yy - xy * xy, 0.0))
    t = np.sqrt(xx + yy + 2.0 * s)
    for i in range(4):
        if end < len(weights):
            a, b = 1.0 - 2.0 * (i % 2), 1.0 - 2.0 * (i // 2)
            p, q, scale = _place(own, c0 + ((xx + s) * a + xy * b) / t, c1 + (xy * a + (yy + s) * b) / t)
            places[end, 0], places[end, 1], weights[end] = p, q, 0.25 * area / scale
        end += 1
    return end


@njit(cache=True, error_model="numpy")
def _put_shape(own: Floats, part: Floats, rule: Rule, places: Floats, weights: Floats, end: int) -> int:
    """Put samples of a triangle or quadrilateral."""
    for i in range(len(rule[1])):
        if end < len(weights):
            p0, p1, size = _seen(part, rule[0][i, 0], rule[0][i, 1])
            s, t, scale = _place(own, p0, p1)
            places[end, 0], places[end, 1], weights[end] = s, t, rule[1][i] * size / scale
        end += 1
    return end


@njit(cache=True)
def _seen(polygon: Floats, s: float, t: float) -> tuple[float, float, float]:
    """Where the place (s, t) of a triangle or quadrilateral is seen, and how much greater its area is there."""
    p0 = p1 = x1 = x2 = y1 = y2 = 0.0
    m = len(polygon)
    N, (one, two) = shape(m, s, t), shape_gradient(m, s, t)
    for i in range(m):
        a, b = polygon[i]
        p0, p1 = p0 + N[i] * a, p1 + N[i] * b
        x1, y1 = x1 + one[i] * a, y1 + one[i] * b
        x2, y2 = x2 + two[i] * a, y2 + two[i] * b
    return p0, p1, x1 * y2 - x2 * y1


@njit(cache=True, error_model="numpy")
def _place(polygon: Floats, p0: float, p1: float) -> tuple[float, float, float]:
    """The place (s, t) that is seen there, by Newton's method, and the scale of areas."""
    m = len(polygon)
    s = t = 1.0 / 3.0 if m == 3 else 0.0
    for _ in range(MAX_NEWTON):
        r0, r1, scale = _seen(polygon, s, t)
        one, two = shape_gradient(m, s, t)
        x1 = x2 = y1 = y2 = 0.0
        for i in range(m):
            x1, y1 = x1 + one[i] * polygon[i, 0], y1 + one[i] * polygon[i, 1]
            x2, y2 = x2 + two[i] * polygon[i, 0], y2 + two[i] * polygon[i, 1]
        ds, dt = (y2 * (p0 - r0) - x2 * (p1 - r1)) / scale, (x1 * (p1 - r1) - y1 * (p0 - r0)) / scale
        s, t = s + ds, t + dt
        if max(abs(ds), abs(dt)) < 1e-8:  # the next one would be of its square
            break
    return s, t, _seen(polygon, s, t)[2]
