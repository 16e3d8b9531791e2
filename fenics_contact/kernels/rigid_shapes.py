"""Signed distance, outward normal and curvature of the analytic rigid shapes, in the shape's own frame.

Every shape is the set of points of negative distance. With g the signed distance, the normal is n = grad g and the
curvature tensor of the parallel surface through the point is H = grad n (symmetric, H n = 0).
"""

import math

from numba import njit

from fenics_contact.kernels.rigid_profiles import extrusion, revolution, torus
from fenics_contact.kernels.vectors import ZERO, Vector
from fenics_contact.types import Floats

PLANE = 0
BOX = 1
SPHERE = 2
CYLINDER = 3
CONE = 4
TORUS = 5
EXTRUSION = 6
REVOLUTION = 7
UNION = 8
# A part of a union: its kind, the length of its parameters, its origin (3,), its axes (3, 3) row by row, its parameters.
PART = 14
ON_AXIS = 1e-9  # of the distance from the apex: nearer to the axis a cone has no side to prefer


@njit(cache=True)
def _ball(radius: float, y: Vector, active: Vector, n: Floats, H: Floats) -> float:
    """Distance to a ball (three active axes), round edge (two) or flat face (one) about the origin of the axes."""
    a0, a1, a2 = y[0] * active[0], y[1] * active[1], y[2] * active[2]
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
    H[0, 0] += active[0] / length
    H[1, 1] += active[1] / length
    H[2, 2] += active[2] / length
    return length - radius


@njit(cache=True)
def _box(parameters: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Box |y_i| <= half_i whose edges are rounded with a fillet; a fillet of zero leaves the edges sharp."""
    fillet = parameters[3]
    outside = 0
    deepest = 0
    q_deepest = -1.0e300
    for i in range(3):
        q = abs(y[i]) - (parameters[i] - fillet)
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
    beyond0 = 1.0 if abs(y[0]) > parameters[0] - fillet else 0.0
    beyond1 = 1.0 if abs(y[1]) > parameters[1] - fillet else 0.0
    beyond2 = 1.0 if abs(y[2]) > parameters[2] - fillet else 0.0
    return _ball(fillet, (y[0] - c0, y[1] - c1, y[2] - c2), (beyond0, beyond1, beyond2), n, H)


@njit(cache=True)
def _cone(parameters: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Cone about -z that ends at the origin; its tip is a ball: the surface parallel to a sharp cone within it."""
    tip, c, s = parameters[0], parameters[1], parameters[2]
    z = y[2] + tip  # above the apex of the sharp cone
    r = math.hypot(y[0], y[1])
    H[:, :] = 0.0
    if r <= -ON_AXIS * z:  # all sides are as near: the apex is met along the axis, distance and normal agree along it
        n[0], n[1], n[2] = 0.0, 0.0, 1.0
        return z - tip
    if r * s <= z * c:  # nearest to the tip
        return _ball(tip, (y[0], y[1], z), (1.0, 1.0, 1.0), n, H)
    x0, x1 = y[0] / r, y[1] / r
    n[0], n[1], n[2] = c * x0, c * x1, s
    H[0, 0], H[1, 1] = c / r * x1 * x1, c / r * x0 * x0
    H[0, 1] = H[1, 0] = -c / r * x0 * x1
    return r * c + z * s - tip


@njit(cache=True)
def _round(kind: int, radius: float, y: Floats, n: Floats, H: Floats) -> float:
    """Ball or endless cylinder; with a radius below zero the hollow of that radius in a tool without end."""
    g = _ball(abs(radius), (y[0], y[1], y[2]), (1.0, 1.0, 0.0 if kind == CYLINDER else 1.0), n, H)
    if radius >= 0.0:
        return g
    for i in range(3):
        n[i] = -n[i]
        for j in range(3):
            H[i, j] = -H[i, j]
    return -g


@njit(cache=True)
def _single(kind: int, parameters: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """`signed_distance` of what is no union."""
    if kind == PLANE:
        n[0], n[1], n[2] = 0.0, 0.0, 1.0
        H[:, :] = 0.0
        return y[2]
    if kind == BOX:
        return _box(parameters, y, n, H)
    if kind == CONE:
        return _cone(parameters, y, n, H)
    if kind == TORUS:
        return torus(parameters[0], parameters[1], y, n, H)
    if kind == EXTRUSION:
        return extrusion(parameters, y, n, H)
    if kind == REVOLUTION:
        return revolution(parameters, y, n, H)
    return _round(kind, parameters[0], y, n, H)


@njit(cache=True)
def _part(parts: Floats, at: int, x: Vector, y: Floats) -> tuple[int, Floats]:
    """Kind and parameters of the part of a union that begins at `at`; fills y with place x in its frame."""
    r0, r1, r2 = x[0] - parts[at + 2], x[1] - parts[at + 3], x[2] - parts[at + 4]
    for i in range(3):
        y[i] = parts[at + 5 + i] * r0 + parts[at + 8 + i] * r1 + parts[at + 11 + i] * r2
    first = at + PART
    return int(parts[at]), parts[first : first + int(parts[at + 1])]


@njit(cache=True)
def _union(parts: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Distance to the nearest of the parts, with its normal and curvature, all in the union's frame."""
    x = y[0], y[1], y[2]
    least, nearest, at = 1.0e300, 0, 0
    while at < len(parts):
        kind, parameters = _part(parts, at, x, y)
        g = _single(kind, parameters, y, n, H)
        if g < least:
            least, nearest = g, at
        at += PART + int(parts[at + 1])
    kind, parameters = _part(parts, nearest, x, y)
    g = _single(kind, parameters, y, n, H)
    axes = nearest + 5
    _turn(parts, axes, n)
    for i in range(3):
        _turn(parts, axes, H[i])
    for i in range(3):
        _turn(parts, axes, H[:, i])
    y[0], y[1], y[2] = x
    return g


@njit(cache=True)
def _turn(parts: Floats, axes: int, v: Floats) -> None:
    """v <- Q v, with Q (3, 3) row by row from `axes` on."""
    v0, v1, v2 = v[0], v[1], v[2]
    for i in range(3):
        v[i] = parts[axes + 3 * i] * v0 + parts[axes + 3 * i + 1] * v1 + parts[axes + 3 * i + 2] * v2


@njit(cache=True)
def signed_distance(kind: int, parameters: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Signed distance of y (3,) to a shape; fills the unit normal n (3,) and the curvature H (3, 3).

    kind: PLANE (body z <= 0), BOX (half sizes and fillet radius), SPHERE (radius), CYLINDER (radius, axis z, endless), both
    hollow with a radius below zero, CONE (radius of its tip, cosine and sine of its half-angle; ends at z = 0, endless
    towards -z), TORUS (radius of its ring about z, radius of its tube), EXTRUSION along y and REVOLUTION about z (pieces of
    a profile, see rigid_profiles), UNION (parts one after another, see PART).
    parameters: as many as the kind takes.
    """
    if kind == UNION:
        return _union(parameters, y, n, H)
    return _single(kind, parameters, y, n, H)


@njit(cache=True)
def _fade(t: float) -> tuple[float, float]:
    """Smooth step from 0 (t <= 0) to 1 (t >= 1), and its slope."""
    if t <= 0.0:
        return 0.0, 0.0
    if t >= 1.0:
        return 1.0, 0.0
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)


@njit(cache=True)
def ends_sharply(kind: int, parameters: Floats) -> bool:
    """Whether a shape is the box without fillet, whose flat faces hold points beyond their sharp edges, too."""
    return kind == BOX and parameters[3] == 0.0


@njit(cache=True)
def edge_cover(kind: int, parameters: Floats, y: Floats, spacing: float) -> tuple[float, Vector]:
    """How far a slave point counts as lying under a sharp-edged face: a share s from 1 to 0, and its gradient.

    Points are `spacing` [length] apart. A contact that ends at the edge lies between the last point under the face and
    the next one outside; letting the share of the outer point fall from 1 at the edge to 0 one spacing outside it
    interpolates the contact's end between the two, so that the force does not jump when rows of points slide out. s has
    one continuous derivative. Shapes without sharp edges give 1. Only the faces normal to the last axis (the punch's
    flat face) are treated so: the share fades where a point rises one to two spacings beside the punch.
    """
    if not ends_sharply(kind, parameters) or (abs(y[0]) <= parameters[0] and abs(y[1]) <= parameters[1]):
        return 1.0, ZERO
    s0, d0 = _fade(1.0 + (parameters[0] - abs(y[0])) / spacing)
    s1, d1 = _fade(1.0 + (parameters[1] - abs(y[1])) / spacing)
    s2, d2 = _fade(2.0 + (abs(y[2]) - parameters[2]) / spacing)
    ds0, ds1 = -math.copysign(d0 * s1 * s2 / spacing, y[0]), -math.copysign(s0 * d1 * s2 / spacing, y[1])
    return s0 * s1 * s2, (ds0, ds1, math.copysign(s0 * s1 * d2 / spacing, y[2]))


@njit(cache=True)
def meets_face(kind: int, parameters: Floats, y: Floats, spacing: float, cover: float) -> bool:
    """Whether y belongs to a sharp-edged flat face rather than to the nearest side.

    True for covered points less than `spacing` deep, however near to the edge they are: a point next to the edge is held
    by the face until it has slid out, and does not flip to the side by being a little nearer to it.
    """
    if not ends_sharply(kind, parameters) or cover == 0.0:
        return False
    return cover < 1.0 or abs(y[2]) > parameters[2] - spacing


@njit(cache=True)
def face_distance(parameters: Floats, y: Floats, n: Floats, H: Floats) -> float:
    """Distance to the plane of the box's flat face nearest to y, as if the face had no end."""
    n[0], n[1], n[2] = 0.0, 0.0, 1.0 if y[2] >= 0.0 else -1.0
    H[:, :] = 0.0
    return abs(y[2]) - parameters[2]
