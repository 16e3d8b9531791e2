"""Where the point of a master surface nearest to a slave point lies: facet, place on it, gap and normal.

The foot is INTERIOR to a facet, on an EDGE or on a VERTEX; NONE says that the point has no partner.  Among the
candidates the nearest facet wins.  That is right on smooth parts, outside a convex ridge (edge, g > 0) and under a
concave valley (edge, g < 0, with a normal that turns from one flank's to the other's).  The sign of g at an edge or a
vertex comes from the angle-weighted normal of the facets that meet there, with which it is exact
(Baerentzen & Aanaes 2005, doi:10.1109/TVCG.2005.49).
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.facets import PlacedSurface, corner, gather, patch, patch_normal
from fenics_contact.types import Floats, Ints64

NONE = 0
INTERIOR = 1
EDGE = 2
VERTEX = 3

# Facets overlap by this much in xi, so that rounding opens no slit between neighbours.
OVERLAP = 1e-10
# Lengths are equal if they differ by this part of the facet size: above rounding, below any mesh.
SAME = 1e-9
# Beyond a free border of the surface a point stays paired while (x_S - x_M) leaves the border's normal by less than
# acos(0.9) = 26 degrees.  A polygon that stands for a round surface ends on a symmetry plane with a tilted normal;
# without this the points of that plane would fall off.
BORDER_COSINE = 0.9
MAX_NEWTON = 60

Lists = tuple[Ints64, Ints64]  # candidates: offsets (np + 1,), facets
# facet (np,), kind (np,), feature (np,), xi (np, 2), gap (np,) [length], normal (np, 3)
Projection = tuple[Ints64, Ints64, Ints64, Floats, Floats, Floats]
Foot = tuple[int, int, float, float, float]  # kind, feature, xi1, xi2, distance^2
# listed facets (n,), and on them, with room for more: kind and feature (., 2); xi1, xi2, distance, facet size (., 4)
Feet = tuple[Ints64, Ints64, Floats]
Terms = tuple[float, float, float, float, float, float, float]  # what `_terms` returns
Limits = tuple[float, float]  # search [length], facing: cosine of normals
# scratch: corners and patch of a facet (4, 3), a normal, a foot and a mean normal (3,)
Work = tuple[Floats, Floats, Floats, Floats, Floats]


@njit(cache=True)
def _closest_on_boundary(x: Floats, m: int, xf: Floats) -> Foot:
    """Nearest point on the m straight edges: (kind, feature, xi1, xi2, distance^2)."""
    best, best_s, best_e = np.inf, 0.0, 0
    for e in range(m):
        q = (e + 1) % m
        ee = de = dd = 0.0
        for p in range(3):
            edge, d = xf[q, p] - xf[e, p], x[p] - xf[e, p]
            ee += edge * edge
            de += d * edge
        s = min(max(de / ee, 0.0), 1.0) if ee > 0.0 else 0.0
        for p in range(3):
            d = x[p] - (1.0 - s) * xf[e, p] - s * xf[q, p]
            dd += d * d
        if dd < best:
            best, best_s, best_e = dd, s, e
    after = (best_e + 1) % m
    s0, t0 = corner(m, best_e)
    s1, t1 = corner(m, after)
    if best_s <= OVERLAP:
        return VERTEX, best_e, s0, t0, best
    if best_s >= 1.0 - OVERLAP:
        return VERTEX, after, s1, t1, best
    return EDGE, best_e, s0 + best_s * (s1 - s0), t0 + best_s * (t1 - t0), best


@njit(cache=True)
def _terms(x: Floats, c: Floats, s: float, t: float) -> Terms:
    """At (s, t): f_alpha = (x - r).r_alpha, a_alpha_beta, (x - r).r_12 and |x - r|^2, as scalars."""
    f1 = f2 = a11 = a12 = a22 = curve = dd = 0.0
    for p in range(3):
        r1, r2 = c[1, p] + c[3, p] * t, c[2, p] + c[3, p] * s
        d = x[p] - (c[0, p] + c[1, p] * s + r2 * t)
        f1 += d * r1
        f2 += d * r2
        a11 += r1 * r1
        a12 += r1 * r2
        a22 += r2 * r2
        curve += d * c[3, p]
        dd += d * d
    return f1, f2, a11, a12, a22, curve, dd


@njit(cache=True)
def _foot_triangle(x: Floats, c: Floats) -> tuple[float, float, bool]:
    """Foot on the plane of a tri3: (xi1, xi2, lies inside)."""
    f1, f2, a11, a12, a22, _, _ = _terms(x, c, 0.0, 0.0)
    det = a11 * a22 - a12 * a12
    if not det > 1e-24 * a11 * a22:  # a needle has no inside; its edges stand for it
        return 0.0, 0.0, False
    s, t = (a22 * f1 - a12 * f2) / det, (a11 * f2 - a12 * f1) / det
    return s, t, s >= -OVERLAP and t >= -OVERLAP and s + t <= 1.0 + OVERLAP


@njit(cache=True)
def _newton_step(terms: Terms, free1: bool, free2: bool) -> tuple[float, float]:
    """Newton step of paper (2) in the directions that are free, with a matrix that makes it descend.

    Scaled by sqrt(a_11) and sqrt(a_22), H = a_ab - (x - r).r_ab (minus the Jacobian of f) is [[1, h], [h, 1]]: its
    eigenvalues are 1 + h and 1 - h, on (1, 1) and (1, -1).  Above a strongly warped patch one of them turns negative;
    its sign is flipped, so that the step leaves the saddle of the distance instead of seeking it.
    """
    f1, f2, a11, a12, a22, curve, _ = terms
    if free1 and free2:
        if not (a11 > 0.0 and a22 > 0.0):  # the facet has shrunk to a line or a point
            return 0.0, 0.0
        scale1, scale2 = math.sqrt(a11), math.sqrt(a22)
        h = (a12 - curve) / (scale1 * scale2)
        plus, minus = 1.0 + h, 1.0 - h
        if plus < 1e-8:
            plus = max(-plus, 1e-2)
        if minus < 1e-8:
            minus = max(-minus, 1e-2)
        along, across = (f1 / scale1 + f2 / scale2) / plus, (f1 / scale1 - f2 / scale2) / minus
        return 0.5 * (along + across) / scale1, 0.5 * (along - across) / scale2
    if free1:
        return (f1 / a11 if a11 > 0.0 else 0.0), 0.0
    if free2:
        return 0.0, (f2 / a22 if a22 > 0.0 else 0.0)
    return 0.0, 0.0


@njit(cache=True)
def _foot_quad(x: Floats, c: Floats) -> tuple[float, float, bool]:
    """Foot on a bilinear patch by projected Newton, paper (2): (xi1, xi2, lies inside)."""
    limit = 1.0 + OVERLAP
    s = t = 0.0
    best = np.inf
    for i in range(2):  # a warped patch may have two minima and, by symmetry, a saddle in the middle: start beside it
        for j in range(2):
            dd = _terms(x, c, i - 0.5, j - 0.5)[6]
            if dd < best:
                best, s, t = dd, i - 0.5, j - 0.5
    for _ in range(MAX_NEWTON):
        terms = _terms(x, c, s, t)
        # a bound is active while the descent direction f points out of it
        free1 = not ((s >= limit and terms[0] > 0.0) or (s <= -limit and terms[0] < 0.0))
        free2 = not ((t >= limit and terms[1] > 0.0) or (t <= -limit and terms[1] < 0.0))
        ds, dt = _newton_step(terms, free1, free2)
        cut = 1.0
        for _ in range(60):
            s_new = min(max(s + cut * ds, -limit), limit)
            t_new = min(max(t + cut * dt, -limit), limit)
            # Near the foot |x - r|^2 no longer shows progress in floating point; there Newton needs no guard.
            if (cut * abs(ds) < 1e-4 and cut * abs(dt) < 1e-4) or _terms(x, c, s_new, t_new)[6] < terms[6]:
                break
            cut *= 0.5
        moved = max(abs(s_new - s), abs(t_new - t))
        s, t = s_new, t_new
        if moved <= 1e-9:  # convergence is quadratic: what is left is of the order of the square
            return s, t, abs(s) < limit and abs(t) < limit
    return s, t, False


@njit(cache=True)
def closest_on_facet(x: Floats, m: int, xf: Floats, c: Floats) -> Foot:
    """Closest point of x (3,) on one facet with corners xf (4, 3); c (4, 3) is filled with its patch.

    Returns (kind, feature, xi1, xi2, distance^2); feature is the number of the edge or corner, -1 inside.
    """
    patch(m, xf, c)
    kind, feature, s, t, dd = _closest_on_boundary(x, m, xf)
    if m == 3:
        s_in, t_in, inside = _foot_triangle(x, c)
    else:
        s_in, t_in, inside = _foot_quad(x, c)
    if inside:
        dd_in = _terms(x, c, s_in, t_in)[6]
        if dd_in <= dd * (1.0 + 1e-12) or dd == 0.0:
            return INTERIOR, -1, s_in, t_in, dd_in
    return kind, feature, s, t, dd


@njit(cache=True)
def _facet_size(m: int, xf: Floats) -> float:
    """Longest edge."""
    longest = 0.0
    for e in range(m):
        ee = 0.0
        for p in range(3):
            ee += (xf[(e + 1) % m, p] - xf[e, p]) ** 2
        longest = max(longest, ee)
    return math.sqrt(longest)


@njit(cache=True)
def _too_far(x: Floats, m: int, xf: Floats, reach: float) -> bool:
    """True if the facet certainly lies farther away than reach: its corners' ball does."""
    centre0 = centre1 = centre2 = radius = 0.0
    for i in range(m):
        centre0 += xf[i, 0] / m
        centre1 += xf[i, 1] / m
        centre2 += xf[i, 2] / m
    for i in range(m):
        rr = (xf[i, 0] - centre0) ** 2 + (xf[i, 1] - centre1) ** 2 + (xf[i, 2] - centre2) ** 2
        radius = max(radius, rr)
    dd = (x[0] - centre0) ** 2 + (x[1] - centre1) ** 2 + (x[2] - centre2) ** 2
    return dd > (1.0 + SAME) * (math.sqrt(radius) + reach) ** 2


@njit(cache=True)
def _corner_angle(m: int, xf: Floats, i: int) -> float:
    """Angle between the two edges that meet in corner i."""
    uu = vv = uv = 0.0
    for p in range(3):
        u, v = xf[(i + 1) % m, p] - xf[i, p], xf[(i + m - 1) % m, p] - xf[i, p]
        uu += u * u
        vv += v * v
        uv += u * v
    scale = math.sqrt(uu * vv)
    return math.acos(min(max(uv / scale, -1.0), 1.0)) if scale > 0.0 else 0.0


@njit(cache=True)
def _scan(x: Floats, x_normal: Floats, master: PlacedSurface, limits: Limits, feet: Feet, work: Work) -> int:
    """Foot on each listed facet; return the winner's place in the list, or -1.

    Fills kinds and places of feet; facets that look the slave point's own way (n . slave normal > facing) or lie beyond
    search get kind NONE.
    """
    (coords, (nodes, size)), (search, facing), (listed, kinds, places) = master, limits, feet
    xf, c, n = work[0], work[1], work[2]
    nearest = np.inf
    for j in range(listed.shape[0]):
        f, m = listed[j], size[listed[j]]
        gather(coords, nodes[f], m, xf)
        kinds[j, 0], kinds[j, 1] = NONE, -1
        # later stages want the facets that tie with the nearest, hence the slack of two lengths SAME
        h = _facet_size(m, xf)
        if _too_far(x, m, xf, min(search, nearest + 2.0 * SAME * h)):
            continue
        kind, feature, s, t, dd = closest_on_facet(x, m, xf, c)
        distance = math.sqrt(dd)
        if not distance <= search or not patch_normal(c, s, t, n) > 0.0:
            continue
        if n[0] * x_normal[0] + n[1] * x_normal[1] + n[2] * x_normal[2] > facing:
            continue
        kinds[j, 0], kinds[j, 1] = kind, feature
        places[j, 0], places[j, 1], places[j, 2], places[j, 3] = s, t, distance, h
        nearest = min(nearest, distance)
    winner = -1
    for j in range(listed.shape[0]):  # among ties: inside before edge before vertex, then the first listed
        tied = kinds[j, 0] != NONE and places[j, 2] <= nearest + SAME * places[j, 3]
        if tied and (winner < 0 or kinds[j, 0] < kinds[winner, 0]):
            winner = j
    return winner


@njit(cache=True)
def _pseudo_normal(winner: int, master: PlacedSurface, feet: Feet, work: Work) -> bool:
    """Angle-weighted normal, the last of work, of the facets that share the winner's foot, the one before it; True if they
    surround it."""
    (coords, (nodes, size)), (listed, kinds, places) = master, feet
    xf, c, n, foot, pseudo = work
    kind = kinds[winner, 0]
    pseudo[:] = 0.0
    count, ring = 0, 0
    for j in range(listed.shape[0]):
        if kinds[j, 0] != kind or places[j, 2] > places[winner, 2] + SAME * places[j, 3]:
            continue
        f, m, feature = listed[j], size[listed[j]], kinds[j, 1]
        gather(coords, nodes[f], m, xf)
        patch(m, xf, c)
        s, t = places[j, 0], places[j, 1]
        off = 0.0
        for p in range(3):
            off += (c[0, p] + c[1, p] * s + c[2, p] * t + c[3, p] * s * t - foot[p]) ** 2
        # feet of one edge or vertex, found from two facets, differ by rounding only
        if off > (1e2 * SAME * places[winner, 3]) ** 2:
            continue
        patch_normal(c, s, t, n)
        weight = _corner_angle(m, xf, feature) if kind == VERTEX else 1.0
        for p in range(3):
            pseudo[p] += weight * n[p]
        count += 1
        # around an inner vertex each edge enters one facet and leaves another, so all node numbers cancel
        ring ^= nodes[f, (feature + 1) % m] ^ nodes[f, (feature + m - 1) % m]
    length = math.sqrt(pseudo[0] ** 2 + pseudo[1] ** 2 + pseudo[2] ** 2)
    for p in range(3):
        pseudo[p] /= max(length, 1e-300)
    return count >= 2 and (kind == EDGE or ring == 0)


@njit(cache=True)
def _gap_and_normal(
    x: Floats, winner: int, master: PlacedSurface, feet: Feet, normal: Floats, work: Work
) -> tuple[int, float]:
    """Signed gap and normal (paper (1)) at the winner; returns (kind, gap), NONE beyond a free border."""
    (coords, (nodes, size)), (listed, kinds, places) = master, feet
    xf, c, foot, pseudo = work[0], work[1], work[3], work[4]
    f, kind, distance = listed[winner], kinds[winner, 0], places[winner, 2]
    s, t = places[winner, 0], places[winner, 1]
    gather(coords, nodes[f], size[f], xf)
    patch(size[f], xf, c)
    patch_normal(c, s, t, normal)
    gap = 0.0
    for p in range(3):
        foot[p] = c[0, p] + c[1, p] * s + c[2, p] * t + c[3, p] * s * t
        gap += (x[p] - foot[p]) * normal[p]
    if kind == INTERIOR or distance <= 1e-2 * SAME * places[winner, 3]:
        return INTERIOR, gap  # at an edge itself (x_S - x_M)/g has no direction: take the facet's normal
    closed = _pseudo_normal(winner, master, feet, work)
    along = 0.0
    for p in range(3):
        along += (x[p] - foot[p]) * pseudo[p]
    if not closed and abs(along) < BORDER_COSINE * distance:
        return NONE, 0.0
    gap = distance if along >= 0.0 else -distance
    for p in range(3):
        normal[p] = (x[p] - foot[p]) / gap
    return kind, gap


@njit(cache=True)
def closest_points(
    points: Floats,
    point_normals: Floats,
    master: PlacedSurface,
    lists: Lists,
    limits: Limits,
    projection: Projection,
) -> None:
    """Project slave points (np, 3) with outward normals (np, 3) on master = (coords (nx, 3), (nodes, size)).

    lists = (offsets, facets) are the candidates, limits = (search, facing): how far partners may be, and from which cosine
    of outward normals on facets are none.  Fills projection = (facet (np,), kind (np,), feature (np,) int64, xi (np, 2),
    gap (np,), normal (np, 3)).  Without a partner: facet -1, kind NONE, gap inf.
    """
    offsets, listed = lists
    facet, kind, feature, xi, gap, normal = projection
    longest = 0
    for q in range(points.shape[0]):
        longest = max(longest, offsets[q + 1] - offsets[q])
    kinds, places = np.empty((longest, 2), np.int64), np.empty((longest, 4))
    work = (np.empty((4, 3)), np.empty((4, 3)), np.empty(3), np.empty(3), np.empty(3))
    for q in range(points.shape[0]):
        facet[q], kind[q], feature[q], gap[q] = -1, NONE, -1, np.inf
        xi[q, 0] = xi[q, 1] = normal[q, 0] = normal[q, 1] = normal[q, 2] = 0.0
        mine = listed[offsets[q] : offsets[q + 1]]
        feet = mine, kinds, places
        winner = _scan(points[q], point_normals[q], master, limits, feet, work)
        if winner < 0:
            continue
        found, g = _gap_and_normal(points[q], winner, master, feet, normal[q], work)
        if found == NONE:
            normal[q, 0] = normal[q, 1] = normal[q, 2] = 0.0
            continue
        facet[q], kind[q], gap[q] = mine[winner], found, g
        feature[q] = -1 if found == INTERIOR else kinds[winner, 1]
        xi[q, 0], xi[q, 1] = places[winner, 0], places[winner, 1]
