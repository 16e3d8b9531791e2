"""Where the inward normal of a slave facet meets the master surface: facet, place on it, gap.

The point x_S of a slave facet with outward normal n_S is paired with the point r(xi) of the master for which
x_S - r(xi) = g n, n = -n_S.  Direction and gap are continuous where r(xi) passes from one master facet to the next, on
ridges and in valleys alike; a closest point is not, for g < 0 under a ridge.  Puso & Laursen 2004,
doi:10.1016/j.cma.2003.10.010, for the use of the slave's normal.
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import INTERIOR, NONE, OVERLAP
from fenics_contact.kernels.facets import gather, patch, patch_normal

MAX_NEWTON = 30


@njit(cache=True)
def slave_normal(coords, nodes, gradients, t1, t2, n):
    """Fill t1, t2 = sum dN_i,alpha x_i and n = -(t1 x t2)/|t1 x t2|; returns |t1 x t2|."""
    for p in range(3):
        t1[p] = t2[p] = 0.0
        for i in range(nodes.shape[0]):
            t1[p] += gradients[0, i] * coords[nodes[i], p]
            t2[p] += gradients[1, i] * coords[nodes[i], p]
    n[0], n[1], n[2] = t1[2] * t2[1] - t1[1] * t2[2], t1[0] * t2[2] - t1[2] * t2[0], t1[1] * t2[0] - t1[0] * t2[1]
    size = math.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
    for p in range(3):
        n[p] /= max(size, 1e-300)
    return size


@njit(cache=True)
def _meet(x, n, m, c, size):
    """Newton for x - r(xi) = g n on one patch; returns (found, xi1, xi2, g)."""
    s = t = 1.0 / 3.0 if m == 3 else 0.0
    for _ in range(MAX_NEWTON):
        d0 = x[0] - c[0, 0] - c[1, 0] * s - c[2, 0] * t - c[3, 0] * s * t
        d1 = x[1] - c[0, 1] - c[1, 1] * s - c[2, 1] * t - c[3, 1] * s * t
        d2 = x[2] - c[0, 2] - c[1, 2] * s - c[2, 2] * t - c[3, 2] * s * t
        # cross(n, r_a): rows of the reduced system n x (d - r_a dxi^a) = 0, projected on r_1 x n and r_2 x n
        a0, a1, a2 = c[1, 0] + c[3, 0] * t, c[1, 1] + c[3, 1] * t, c[1, 2] + c[3, 2] * t
        b0, b1, b2 = c[2, 0] + c[3, 0] * s, c[2, 1] + c[3, 1] * s, c[2, 2] + c[3, 2] * s
        det = n[0] * (a1 * b2 - a2 * b1) + n[1] * (a2 * b0 - a0 * b2) + n[2] * (a0 * b1 - a1 * b0)
        if not abs(det) > 1e-12 * size * size:
            return False, 0.0, 0.0, 0.0
        ds = (n[0] * (d1 * b2 - d2 * b1) + n[1] * (d2 * b0 - d0 * b2) + n[2] * (d0 * b1 - d1 * b0)) / det
        dt = (n[0] * (a1 * d2 - a2 * d1) + n[1] * (a2 * d0 - a0 * d2) + n[2] * (a0 * d1 - a1 * d0)) / det
        s, t = s + ds, t + dt
        if abs(s) > 50.0 or abs(t) > 50.0:
            return False, 0.0, 0.0, 0.0
        if max(abs(ds), abs(dt)) < 1e-12:
            g = 0.0
            for p in range(3):
                g += (x[p] - c[0, p] - c[1, p] * s - c[2, p] * t - c[3, p] * s * t) * n[p]
            low = -OVERLAP if m == 3 else -1.0 - OVERLAP
            inside = s >= low and t >= low and (s + t <= 1.0 + OVERLAP if m == 3 else max(s, t) <= 1.0 + OVERLAP)
            return inside, s, t, g
    return False, 0.0, 0.0, 0.0


@njit(cache=True)
def slave_rays(points, slave_nodes, gradients, coords, surface, lists, search, projection):
    """Pair points (np, 3) of slave facets with the master facet that their normal meets nearest within `search`.

    slave_nodes (np, k), gradients (np, 2, k): nodes of the slave facet and derivatives of their shape functions in
    the point, counter-clockwise seen from outside; surface, lists, projection as in kernels/closest_point.py,
    kind INTERIOR or NONE. Facets that look the slave's own way are no partners.
    """
    nodes, size = surface
    offsets, listed = lists
    facet, kind, feature, xi, gap, normal = projection
    xf, c, nm, t1, t2 = np.empty((4, 3)), np.empty((4, 3)), np.empty(3), np.empty(3), np.empty(3)
    for q in range(points.shape[0]):
        facet[q], kind[q], feature[q], gap[q] = -1, NONE, -1, np.inf
        xi[q, 0] = xi[q, 1] = 0.0
        slave_normal(coords, slave_nodes[q], gradients[q], t1, t2, normal[q])
        nearest = np.inf
        for j in range(offsets[q], offsets[q + 1]):
            f = listed[j]
            gather(coords, nodes[f], size[f], xf)
            patch(size[f], xf, c)
            longest = 0.0
            for p in range(3):
                longest = max(longest, max(abs(c[1, p]), abs(c[2, p])))
            found, s, t, g = _meet(points[q], normal[q], size[f], c, longest)
            if not found or not abs(g) <= search or abs(g) >= nearest:
                continue
            patch_normal(c, s, t, nm)
            if not nm[0] * normal[q, 0] + nm[1] * normal[q, 1] + nm[2] * normal[q, 2] > 0.0:
                continue
            nearest = abs(g)
            facet[q], kind[q], gap[q] = f, INTERIOR, g
            xi[q, 0], xi[q, 1] = s, t
