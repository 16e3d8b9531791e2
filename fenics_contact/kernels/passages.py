"""Which part of a straight edge lies within a surface that it passes through, in and out again between its ends."""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import Lists
from fenics_contact.kernels.facets import PlacedSurface
from fenics_contact.kernels.vectors import Vector, cross, dot, less, minus, row
from fenics_contact.types import Floats

# Relative: an edge through a seam of two facets, as of meshes with equal steps, is to meet one of them at least
SLACK = 1e-9
MISSED = (-1.0, 0.0)


@njit(cache=True, error_model="numpy")
def _passed(a: Vector, d: Vector, p: Vector, q: Vector, r: Vector) -> tuple[float, float]:
    """(t, side) where a + t d goes through a triangle, side < 0: into what lies behind it; MISSED: it does not."""
    one, two = minus(q, p), minus(r, p)
    n = cross(one, two)
    side, area = dot(d, n), dot(n, n)
    if side == 0.0:
        return MISSED
    t = dot(minus(p, a), n) / side
    foot = less(minus(a, p), -t, d)
    u, v = dot(cross(foot, two), n) / area, dot(cross(one, foot), n) / area
    return (t, side) if u >= -SLACK and v >= -SLACK and u + v <= 1.0 + SLACK else MISSED


@njit(cache=True, error_model="numpy")
def _longest(passed: Floats) -> tuple[float, float]:
    """The longest part of 0 ... 1 between a way in, or 0, and the next of passages (n, 2) if that leads out, or 1."""
    n, best = len(passed), (0.0, 0.0)
    for i in range(-1, n if n > 0 else -1):
        start = 0.0 if i < 0 else passed[i, 0]
        if i >= 0 and passed[i, 1] > 0.0:
            continue
        end, out = 1.0, True
        for j in range(n):
            if start < passed[j, 0] < end:
                end, out = passed[j, 0], passed[j, 1] > 0.0
        if out and end - start > best[1] - best[0]:
            best = (start, end)
    return best


@njit(cache=True, error_model="numpy")
def parts_within(ends: Floats, lists: Lists, surface: PlacedSurface) -> Floats:
    """Of edges with ends (n, 2, 3) the longest parts (n, 2), from 0 to 1 along each, between passages through their listed
    facets of a surface, which are counter-clockwise seen from outside; 0, 0: they pass through none."""
    (offsets, listed), (x, (nodes, size)) = lists, surface
    most = np.diff(offsets).max() if len(ends) > 0 else 0
    out, passed = np.zeros((len(ends), 2)), np.empty((2 * most, 2))
    for e in range(len(ends)):
        a, d, n = row(ends[e], 0), minus(row(ends[e], 1), row(ends[e], 0)), 0
        for f in listed[offsets[e] : offsets[e + 1]]:
            for i in range(2, size[f]):
                corners = row(x, nodes[f, 0]), row(x, nodes[f, i - 1]), row(x, nodes[f, i])
                t, side = _passed(a, d, *corners)
                if 0.0 < t < 1.0:
                    passed[n, 0], passed[n, 1] = t, side
                    n += 1
        if n > 0:
            out[e, 0], out[e, 1] = _longest(passed[:n])
    return out
