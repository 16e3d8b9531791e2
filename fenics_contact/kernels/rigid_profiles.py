"""Signed distance, normal and curvature of plane profiles of lines and arcs, drawn along an axis or turned about it.

A profile lies in the plane (p, z); its tool is on the right as one goes along it. In space z is the tool's third axis, p
its first one or, of a body of revolution, the distance from the third. All corners are arcs, of radius zero where they are
sharp (which only corners that point out of the tool may be): so the nearest place of the profile is always met along the
normal of one piece, and that piece alone says on which side a point lies.
"""

import math

from numba import njit

from fenics_contact.types import Floats

# A piece is seven numbers: its code, a place (2,), a direction (2,), a size and a radius.
PIECE = 7
# Codes: a line from a place along a direction, as long as its size says; without a start, without an end, without both;
# an arc about a place that points out of the tool, or into it, from its middle's direction as far as the cosine `size`.
LINE, NO_START, NO_END, NO_ENDS, ARC, HOLLOW = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
SEAM = 1e-12  # by which pieces overlap where they meet, over the distances there: between them lies no place of none

Found = tuple[float, float, float, float]  # distance, normal (2,), curvature of the parallel line


@njit(cache=True)
def nearest_piece(pieces: Floats, p: float, z: float) -> Found:
    """Signed distance of (p, z) to the profile, its normal there and the curvature of the parallel line through it."""
    best, n0, n1, curvature = 1.0e300, 0.0, 1.0, 0.0
    for i in range(0, len(pieces), PIECE):
        code, d0, d1, size = pieces[i], pieces[i + 3], pieces[i + 4], pieces[i + 5]
        x0, x1 = p - pieces[i + 1], z - pieces[i + 2]
        length = math.hypot(x0, x1)
        along = x0 * d0 + x1 * d1
        if code < ARC:
            seam = SEAM * (length + size)
            if (along < -seam and code != NO_START and code != NO_ENDS) or (along > size + seam and code < NO_END):
                continue
            g = x1 * d0 - x0 * d1
            if abs(g) < abs(best):
                best, n0, n1, curvature = g, -d1, d0, 0.0
        elif along >= (size - SEAM) * length:
            side = 1.0 if code == ARC else -1.0
            g = side * (length - pieces[i + 6])
            if abs(g) < abs(best):
                if length == 0.0:
                    best, n0, n1, curvature = g, side * d0, side * d1, 0.0
                else:
                    best, n0, n1, curvature = g, side * x0 / length, side * x1 / length, side / length
    return best, n0, n1, curvature


@njit(cache=True)
def _drawn(found: Found, n: Floats, H: Floats) -> float:
    """Along the second axis without end."""
    g, n0, n1, curvature = found
    n[0], n[1], n[2] = n0, 0.0, n1
    H[:, :] = 0.0
    H[0, 0], H[2, 2] = curvature * n1 * n1, curvature * n0 * n0
    H[0, 2] = H[2, 0] = -curvature * n0 * n1
    return g


@njit(cache=True)
def _turned(found: Found, y: Floats, p: float, n: Floats, H: Floats) -> float:
    """About the third axis, from which y is p away. On the axis a surface that crosses it is as curved in all directions;
    of sides all around, which are as near, one is as good as another."""
    g, n0, n1, curvature = found
    if p > 0.0:
        e0, e1, around = y[0] / p, y[1] / p, n0 / p
    else:
        e0, e1, around = 1.0, 0.0, curvature if n0 == 0.0 else 0.0
    n[0], n[1], n[2] = n0 * e0, n0 * e1, n1
    t0, t1, t2 = n1 * e0, n1 * e1, -n0
    H[0, 0] = curvature * t0 * t0 + around * e1 * e1
    H[1, 1] = curvature * t1 * t1 + around * e0 * e0
    H[2, 2] = curvature * t2 * t2
    H[0, 1] = H[1, 0] = curvature * t0 * t1 - around * e0 * e1
    H[0, 2] = H[2, 0] = curvature * t0 * t2
    H[1, 2] = H[2, 1] = curvature * t1 * t2
    return g


@njit(cache=True)
def extrusion(pieces: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Signed distance of y (3,) to a profile drawn along the second axis; fills n (3,) and H (3, 3)."""
    return _drawn(nearest_piece(pieces, y[0], y[2]), n, H)


@njit(cache=True)
def revolution(pieces: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Signed distance of y (3,) to a profile turned about the third axis; fills n (3,) and H (3, 3)."""
    p = math.hypot(y[0], y[1])
    return _turned(nearest_piece(pieces, p, y[2]), y, p, n, H)


@njit(cache=True)
def torus(ring: float, tube: float, y: Floats, n: Floats, H: Floats) -> float:
    """Signed distance of y (3,) to a tube whose middle is a circle about the third axis; fills n (3,) and H (3, 3)."""
    p = math.hypot(y[0], y[1])
    length = math.hypot(p - ring, y[2])
    if length == 0.0:  # the tube's middle has no nearest point: any fixed normal keeps the result finite
        return _turned((-tube, 0.0, 1.0, 0.0), y, p, n, H)
    return _turned((length - tube, (p - ring) / length, y[2] / length, 1.0 / length), y, p, n, H)
