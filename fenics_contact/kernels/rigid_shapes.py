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
