"""Contact elements of slave points with an analytic rigid tool: forces, tangent blocks and committed anchors.

An element is a group of slave points that move with the same slave nodes: one point for a node with its tributary
area, the quadrature points of a slave facet otherwise. The tool's frame has the axes to which it has been turned and lies
at origin + travel.

Arrays travel in groups (tuples):
    points   (x (ne, k, 3) present positions of the slave nodes, weights a (ne, nq, k) of the nodes in a point, area (ne, nq)
             tributary reference areas [length^2], spacing (ne,) of the points [length])
    tool     (kind, shape (4,), origin (3,), axes (3, 3), travel (3,)), kind and shape as in kernels/rigid_shapes.py
    law      (eps_n (ne,), eps_t (ne,), body (ne,): penalties and stiffness beneath [pressure/length], Friction of
             kernels/law.py, touch [length], judged (ne nq, 4): pressures that points start from over -eps_n [length], with
             which the tangent is taken, and ways in the tool's frame, see kernels/foreseen.py, which decide their status;
             (0, 4): present ones)
    history  (anchor (ne, nq, 3) in the tool's frame, shift (ne, nq) [length]: multiplier over eps_n, by which a point
             presses more than its gap does)
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.foreseen import rubs
from fenics_contact.kernels.law import Friction, Gaps, Law, Partials, partials, traction
from fenics_contact.kernels.rigid_shapes import edge_cover, ends_sharply, face_distance, meets_face, signed_distance
from fenics_contact.kernels.status import OPEN, SLIP
from fenics_contact.kernels.vectors import ZERO, Vector, dot, got, less, minus, norm, of_three, planar, plus, put, row, times
from fenics_contact.types import Floats, Ints

# The groups, in this order
Points = tuple[Floats, Floats, Floats, Floats]
ToolPose = tuple[int, Floats, Floats, Floats, Floats]
ElementLaws = tuple[Floats, Floats, Floats, Friction, float, Floats]
ToolHistory = tuple[Floats, Floats]
# force, tangent, traction, gap, status, cover, rubbed of `contact_elements`
Elements = tuple[Floats, Floats, Floats, Floats, Ints, Floats, Floats]
Scratch = tuple[Floats, Floats, Floats, Floats, Floats]
Rows = tuple[Vector, Vector, Vector]


@njit(cache=True)
def _to_tool(x: Vector, tool: ToolPose) -> Vector:
    """Place x in the tool's frame, axes^T (x - origin - travel)."""
    _, _, origin, axes, travel = tool
    x = x[0] - origin[0] - travel[0], x[1] - origin[1] - travel[1], x[2] - origin[2] - travel[2]
    return of_three(x, row(axes, 0), row(axes, 1), row(axes, 2))


@njit(cache=True)
def _to_world(axes: Floats, vector: Vector) -> Vector:
    return dot(row(axes, 0), vector), dot(row(axes, 1), vector), dot(row(axes, 2), vector)


@njit(cache=True)
def _scratch() -> Scratch:
    """Arrays y (3,), active (3,), n (3,), H (3, 3), dcover (3,): what kernels/rigid_shapes.py fills for a point."""
    return np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)


@njit(cache=True)
def _meet(e: int, q: int, points: Points, tool: ToolPose, scratch: Scratch) -> tuple[float, Vector, Vector, float]:
    """(gap, place in the tool's frame, normal, cover) of point q of element e; fills scratch."""
    at, a, _, spacing = points
    y, active, n, H, dcover = scratch
    x = ZERO
    for i in range(a.shape[2]):
        x = less(x, -a[e, q, i], got(at, e, i))
    x = _to_tool(x, tool)
    y[0], y[1], y[2] = x
    cover = edge_cover(tool[0], tool[1], y, spacing[e], dcover)
    if meets_face(tool[0], tool[1], y, spacing[e], cover):
        gap = face_distance(tool[1], y, n, H)
    else:
        gap, cover = signed_distance(tool[0], tool[1], y, active, n, H), 1.0
    return gap, x, (n[0], n[1], n[2]), cover


@njit(cache=True)
def _edge_penalty(eps: float, body: float, cover: float) -> tuple[float, float]:
    """Penalty of a point that lies only by the share `cover` under a sharp edge, and its rate with the cover.

    In series with the penalty acts the spring of the body beneath, (1/cover - 1)/body: half the cover carries about half
    the force, whatever eps. A plain eps * cover would hold the point until the cover is nearly gone and then drop it.
    eps, body [pressure/length].
    """
    if cover == 1.0:
        return eps, 0.0
    m = cover / eps + (1.0 - cover) / body
    return cover / m, 1.0 / (body * m * m)


@njit(cache=True)
def contact_elements(
    points: Points, tool: ToolPose, law: ElementLaws, history: ToolHistory, want_tangent: bool, out: Elements
) -> None:
    """Evaluate all contact elements of one surface with one tool. Pure: the anchors are read, never written.

    out: (force (ne, k, 3) = sum of a area T, tangent (ne, 3k, 3k) its derivative; per point traction (ne, nq, 3), gap,
    status (ne, nq), and cover (ne, nq) = penalty over eps_n, below one where the point slides out under a sharp edge; with a
    tangent rubbed (ne, nq, 3, 5): friction's part of the traction, and its rates with gap and way, in the tool's frame).
    """
    a, area, axes = points[1], points[2], tool[3]
    eps_n, eps_t, body, friction, touch, judged = law
    force, tangent, tractions, gap, status, cover, rubbed = out
    scratch, D = _scratch(), np.empty((3, 3))
    H, dcover = scratch[3:]
    ne, nq, k = a.shape
    for e in range(ne):
        force[e] = 0.0
        if want_tangent:
            tangent[e] = 0.0
        for q in range(nq):
            g, x, n, share = _meet(e, q, points, tool, scratch)
            eps, by_cover = _edge_penalty(eps_n[e], body[e], share)
            gap[e, q], cover[e, q] = g, eps / eps_n[e]
            put(tractions, e, q, ZERO)
            press = g + history[1][e, q]
            decides = judged[e * nq + q, 0] if len(judged) > 0 else press
            if decides > touch:  # most points of a surface are open: leave before any law is evaluated
                status[e, q] = OPEN
                continue
            numbers, gaps = Law(eps, eps_t[e], friction, touch), Gaps(decides if want_tangent else press, decides)
            w = minus(less(x, g, n), got(history[0], e, q))  # the foot by (3)
            told, along, weight = rubs(numbers, body[e], judged, e * nq + q, n, w)
            found = traction(numbers, gaps, n, along, told)
            status[e, q] = found.status
            T = _to_world(axes, found.T)
            put(tractions, e, q, T)
            for i in range(k):
                put(force, e, i, less(got(force, e, i), -a[e, q, i] * area[e, q], T))
            if want_tangent:
                by = _weighed(partials(numbers, gaps, n, along, found), weight)
                pull = traction(numbers, Gaps(press, decides), n, along, told).tangential
                _put_rubbed(rubbed, e, q, pull, by, n)
                rows = _rate(by, g, n, H, times(by_cover, (dcover[0], dcover[1], dcover[2])))
                for i in range(3):
                    D[i, 0], D[i, 1], D[i, 2] = _to_world(axes, of_three(row(axes, i), rows[0], rows[1], rows[2]))
                _scatter_tangent(a, area, e, q, D, tangent)


@njit(cache=True)
def _weighed(by: Partials, weight: float) -> Partials:
    """With a part of dT/dw."""
    return Partials(by.g, by.eps_n, by.n, (times(weight, by.w[0]), times(weight, by.w[1]), times(weight, by.w[2])))


@njit(cache=True)
def _put_rubbed(rubbed: Floats, e: int, q: int, pull: Vector, by: Partials, n: Vector) -> None:
    across = planar(by.g, n)
    for i in range(3):
        rubbed[e, q, i, 0], rubbed[e, q, i, 1] = pull[i], across[i]
        rubbed[e, q, i, 2], rubbed[e, q, i, 3], rubbed[e, q, i, 4] = by.w[i]


@njit(cache=True)
def _rate(by: Partials, g: float, n: Vector, H: Floats, deps: Vector) -> Rows:
    """dT/dx by rows, of Partials `by`: dg = n.dx, dn = H dx, dw = (I - n n^T - g H) dx by (4), and dT/dw n = 0."""
    turn, gradients = (row(H, 0), row(H, 1), row(H, 2)), (n, deps)
    return (
        _rate_row((by.g[0], by.eps_n[0]), gradients, less(by.n[0], g, by.w[0]), by.w[0], turn),
        _rate_row((by.g[1], by.eps_n[1]), gradients, less(by.n[1], g, by.w[1]), by.w[1], turn),
        _rate_row((by.g[2], by.eps_n[2]), gradients, less(by.n[2], g, by.w[2]), by.w[2], turn),
    )


@njit(cache=True)
def _rate_row(slopes: tuple[float, float], gradients: tuple[Vector, Vector], by_n: Vector, by_w: Vector, H: Rows) -> Vector:
    """slopes: with gap and penalty, that have these gradients."""
    return plus(less(less(by_w, -slopes[0], gradients[0]), -slopes[1], gradients[1]), of_three(by_n, H[0], H[1], H[2]))


@njit(cache=True)
def _scatter_tangent(a: Floats, area: Floats, e: int, q: int, D: Floats, tangent: Floats) -> None:
    k = a.shape[2]
    for i in range(k):
        w = a[e, q, i] * area[e, q]
        for c in range(3):
            for d in range(3):
                for j in range(k):
                    tangent[e, 3 * i + c, 3 * j + d] += w * a[e, q, j] * D[c, d]


@njit(cache=True)
def committed_anchors(
    points: Points, tool: ToolPose, law: ElementLaws, history: ToolHistory, new_anchor: Floats, sliding: Floats
) -> None:
    """The anchors to keep when a step is accepted (tool's frame), and how far points that do not stick went in the step.

    Open points are anchored at their projection, sticking points keep their anchor, slipping ones are anchored where
    the elastic slip T_T/eps_T ends: the return mapping of (16). Fills new_anchor and sliding (ne, nq) [length].

    Outside a sharp edge the closest point is on the edge, but what holds the point next is a face, continued beyond it: a
    way from the edge would lead outwards whichever way the point comes. It is anchored where it is itself, for of the way
    from there the law takes what is along the face that holds it, and of its slip that is all.
    """
    eps_n, eps_t, body, friction, touch, _ = law
    scratch, sharp = _scratch(), ends_sharply(tool[0], tool[1])
    for e in range(sliding.shape[0]):
        for q in range(sliding.shape[1]):
            g, x, n, share = _meet(e, q, points, tool, scratch)
            foot, anchor = less(x, g, n), got(history[0], e, q)
            eps, press = _edge_penalty(eps_n[e], body[e], share)[0], g + history[1][e, q]
            found = traction(Law(eps, eps_t[e], friction, touch), Gaps(press, press), n, minus(foot, anchor))
            kept = anchor
            if found.status == OPEN:
                kept = x if sharp and g > 0.0 else foot
            elif found.status == SLIP:
                kept = less(foot, 1.0 / eps_t[e], found.tangential)
            slip = minus(kept, anchor)
            if sharp:
                slip = planar(slip, n)
            sliding[e, q] = norm(slip)
            put(new_anchor, e, q, kept)


@njit(cache=True)
def point_normals(points: Points, tool: ToolPose, normal: Floats) -> None:
    """Unit normals (ne, nq, 3) of the tool at the slave points, in world axes: what splits a traction for the output."""
    scratch = _scratch()
    for e in range(normal.shape[0]):
        for q in range(normal.shape[1]):
            put(normal, e, q, _to_world(tool[3], _meet(e, q, points, tool, scratch)[2]))


@njit(cache=True)
def distances(X: Floats, tool: ToolPose, gap: Floats) -> None:
    """Signed distances (n,) of fixed points X (n, 3) to a tool."""
    y, active, n, H, _ = _scratch()
    for p in range(len(X)):
        y[0], y[1], y[2] = _to_tool(row(X, p), tool)
        gap[p] = signed_distance(tool[0], tool[1], y, active, n, H)
