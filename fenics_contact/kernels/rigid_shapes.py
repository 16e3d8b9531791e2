"""Signed distance, outward normal and curvature of the analytic rigid shapes, in the shape's own frame.

Every shape is the set of points of negative distance. With g the signed distance, the normal is n = grad g and the
curvature tensor of the parallel surface through the point is H = grad n (symmetric, H n = 0).
"""

import math

from numba import njit

PLANE = 0
BOX = 1
SPHERE = 2
CYLINDER = 3


@njit(cache=True)
def _ball(y0, y1, y2, active, radius, n, H):
    """Distance to a ball (three active axes), round edge (two) or flat face (one) about the origin of the axes."""
    a0, a1, a2 = y0 * active[0], y1 * active[1], y2 * active[2]
    length = math.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
    if length == 0.0:  # the centre has no nearest point: any fixed normal keeps the result finite
        n[0], n[1], n[2] = 0.0, 0.0, 0.0
        if active[2] == 1.0:
            n[2] = 1.0
        else:
            n[0] = 1.0
        H[:, :] = 0.0
        return -radius
    n[0], n[1], n[2] = a0 / length, a1 / length, a2 / length
    for i in range(3):
        for j in range(3):
            H[i, j] = -n[i] * n[j] / length
        H[i, i] += active[i] / length
    return length - radius


@njit(cache=True)
def _box(parameters, y, active, n, H):
    """Box |y_i| <= half_i whose edges are rounded with a fillet; a fillet of zero leaves the edges sharp."""
    fillet = parameters[3]
    outside = 0
    deepest = 0
    q_deepest = -1.0e300
    for i in range(3):
        q = abs(y[i]) - (parameters[i] - fillet)
        active[i] = 1.0 if q > 0.0 else 0.0
        if q > 0.0:
            outside += 1
        if q > q_deepest:
            q_deepest, deepest = q, i
    if outside < 2:  # nearest to a flat face
        n[:] = 0.0
        n[deepest] = 1.0 if y[deepest] >= 0.0 else -1.0
        H[:, :] = 0.0
        return q_deepest - fillet
    # nearest to a rounded edge (two axes beyond the flat parts) or corner (three)
    c0 = math.copysign(parameters[0] - fillet, y[0])
    c1 = math.copysign(parameters[1] - fillet, y[1])
    c2 = math.copysign(parameters[2] - fillet, y[2])
    return _ball(y[0] - c0, y[1] - c1, y[2] - c2, active, fillet, n, H)


@njit(cache=True)
def signed_distance(kind, parameters, y, active, n, H):
    """Signed distance of y (3,) to a shape; fills the unit normal n (3,) and the curvature H (3, 3).

    kind: PLANE (body z <= 0), BOX (half sizes and fillet radius), SPHERE (radius), CYLINDER (radius, axis z, endless).
    parameters: (4,) lengths; active: (3,) scratch.
    """
    if kind == PLANE:
        n[0], n[1], n[2] = 0.0, 0.0, 1.0
        H[:, :] = 0.0
        return y[2]
    if kind == BOX:
        return _box(parameters, y, active, n, H)
    active[0], active[1], active[2] = 1.0, 1.0, 1.0
    if kind == CYLINDER:
        active[2] = 0.0
    return _ball(y[0], y[1], y[2], active, parameters[0], n, H)


@njit(cache=True)
def edge_cover(kind, parameters, y, spacing, ds):
    """How far a slave point counts as lying under a sharp-edged face: a share s from 1 to 0, and its gradient ds (3,).

    Points are `spacing` [length] apart. A contact that ends at the edge lies between the last point under the face and
    the next one outside; letting the share of the outer point fall from 1 at the edge to 0 one spacing outside it
    interpolates the contact's end between the two, so that the force does not jump when rows of points slide out. s has
    one continuous derivative. Shapes without sharp edges give 1. Only the faces normal to the last axis (the punch's
    flat face) are treated so; what rises beyond `spacing` beside them meets the sides.
    """
    ds[:] = 0.0
    if kind != BOX or parameters[3] > 0.0 or abs(y[2]) < parameters[2] - spacing:
        return 1.0
    share0 = share1 = 1.0
    for i in range(2):
        t = 1.0 + (parameters[i] - abs(y[i])) / spacing
        if t <= 0.0:
            ds[:] = 0.0
            return 0.0
        if t < 1.0:
            share = t * t * (3.0 - 2.0 * t)
            share0, share1 = (share, share1) if i == 0 else (share0, share)
            ds[i] = math.copysign(6.0 * t * (1.0 - t) / spacing, -y[i])
    ds[0] *= share1
    ds[1] *= share0
    return share0 * share1


@njit(cache=True)
def face_distance(parameters, y, n, H):
    """Distance to the plane of the box's flat face nearest to y, as if the face had no end."""
    n[0], n[1], n[2] = 0.0, 0.0, 1.0 if y[2] >= 0.0 else -1.0
    H[:, :] = 0.0
    return abs(y[2]) - parameters[2]
