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
from fenics_contact.kernels.law import Friction, Gaps, Law, Partials, partials, rubbing, traction
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
Rows = tuple[Vector, Vector, Vector]
Frame = tuple[Vector, Vector, Rows]


@njit(cache=True)
def _frame(tool: ToolPose) -> Frame:
    """(origin, travel, rows of the axes): numbers, for an array of a tuple costs more in reference counts, wherever it is
    looked at, than a point's arithmetic. So kernels unpack before their loops, too."""
    _, _, origin, axes, travel = tool
    rows = row(axes, 0), row(axes, 1), row(axes, 2)
    return (origin[0], origin[1], origin[2]), (travel[0], travel[1], travel[2]), rows


@njit(cache=True)
def _to_tool(x: Vector, frame: Frame) -> Vector:
    """Place x in the tool's frame, axes^T (x - origin - travel)."""
    origin, travel, rows = frame
    return of_three(minus(minus(x, origin), travel), rows[0], rows[1], rows[2])


@njit(cache=True)
def _to_world(frame: Frame, vector: Vector) -> Vector:
    rows = frame[2]
    return dot(rows[0], vector), dot(rows[1], vector), dot(rows[2], vector)


@njit(cache=True)
def _place(at: Floats, a: Floats, e: int, q: int) -> Vector:
    """Where point q of element e is."""
    x = ZERO
    for i in range(a.shape[2]):
        x = less(x, -a[e, q, i], got(at, e, i))
    return x


@njit(cache=True)
def _meet(kind: int, shape: Floats, y: Floats, spacing: float, n: Floats, H: Floats) -> tuple[float, float, Vector]:
    """(gap, cover, its gradient) of a point at y (3,) in the tool's frame; fills its normal n (3,) there and H (3, 3)."""
    cover, gradient = edge_cover(kind, shape, y, spacing)
    if meets_face(kind, shape, y, spacing, cover):
        return face_distance(shape, y, n, H), cover, gradient
    return signed_distance(kind, shape, y, n, H), 1.0, gradient


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
    (at, a, area, spacing), (kind, shape, _, _, _), (anchor, shift), frame = points, tool, history, _frame(tool)
    eps_n, eps_t, body, friction, touch, judged = law
    force, tangent, tractions, gap, status, cover, rubbed = out
    y, normal, H, D = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    ne, nq, k = a.shape
    for e in range(ne):
        force[e] = 0.0
        if want_tangent:
            tangent[e] = 0.0
        for q in range(nq):
            x = y[0], y[1], y[2] = _to_tool(_place(at, a, e, q), frame)
            g, share, by_place = _meet(kind, shape, y, spacing[e], normal, H)
            n = normal[0], normal[1], normal[2]
            eps, by_cover = _edge_penalty(eps_n[e], body[e], share)
            gap[e, q], cover[e, q] = g, eps / eps_n[e]
            put(tractions, e, q, ZERO)
            press = g + shift[e, q]
            decides = judged[e * nq + q, 0] if len(judged) > 0 else press
            if decides > touch:  # most points of a surface are open: leave before any law is evaluated
                status[e, q] = OPEN
                continue
            rub, gaps = rubbing(friction, e * nq + q, -eps * decides), Gaps(decides if want_tangent else press, decides)
            numbers = Law(eps, eps_t[e], rub, touch)
            w = minus(less(x, g, n), got(anchor, e, q))  # the foot by (3)
            told, along, weight = rubs(numbers, body[e], judged, e * nq + q, n, w)
            found = traction(numbers, gaps, n, along, told)
            status[e, q] = found.status
            T = _to_world(frame, found.T)
            put(tractions, e, q, T)
            for i in range(k):
                put(force, e, i, less(got(force, e, i), -a[e, q, i] * area[e, q], T))
            if want_tangent:
                by = _weighed(partials(numbers, gaps, n, along, found), weight)
                if decides != press:  # by what is foreseen: friction under the present gap
                    found = traction(numbers, Gaps(press, decides), n, along, told)
                _put_rubbed(rubbed, e, q, found.tangential, by, n)
                rows = _rate(by, g, n, H, times(by_cover, by_place))
                for i in range(3):
                    D[i, 0], D[i, 1], D[i, 2] = _to_world(frame, of_three(frame[2][i], rows[0], rows[1], rows[2]))
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
    (at, a, _, spacing), (kind, shape, _, _, _), (anchors, shift), frame = points, tool, history, _frame(tool)
    eps_n, eps_t, body, friction, touch, _ = law
    y, normal, H, sharp = np.empty(3), np.empty(3), np.empty((3, 3)), ends_sharply(kind, shape)
    for e in range(sliding.shape[0]):
        for q in range(sliding.shape[1]):
            x = y[0], y[1], y[2] = _to_tool(_place(at, a, e, q), frame)
            g, share, _ = _meet(kind, shape, y, spacing[e], normal, H)
            n = normal[0], normal[1], normal[2]
            foot, anchor = less(x, g, n), got(anchors, e, q)
            eps, press = _edge_penalty(eps_n[e], body[e], share)[0], g + shift[e, q]
            numbers = Law(eps, eps_t[e], rubbing(friction, e * sliding.shape[1] + q, -eps * press), touch)
            found = traction(numbers, Gaps(press, press), n, minus(foot, anchor))
            kept = anchor
            if found.status == OPEN:
                kept = _anchored(x, g, n, sharp)
            elif found.status == SLIP:
                kept = less(foot, 1.0 / eps_t[e], found.tangential)
            slip = minus(kept, anchor)
            if sharp:
                slip = planar(slip, n)
            sliding[e, q] = norm(slip)
            put(new_anchor, e, q, kept)


@njit(cache=True)
def slips_from(points: Points, tool: ToolPose, rests: Floats, slip: Floats) -> None:
    """Fill slip (ne, nq, 3): the ways along the tool, in its frame, from rests (ne, nq, 3) to where open points would be
    anchored [length]."""
    (at, a, _, spacing), (kind, shape, _, _, _), frame = points, tool, _frame(tool)
    y, normal, H, sharp = np.empty(3), np.empty(3), np.empty((3, 3)), ends_sharply(kind, shape)
    for e in range(slip.shape[0]):
        for q in range(slip.shape[1]):
            x = y[0], y[1], y[2] = _to_tool(_place(at, a, e, q), frame)
            g = _meet(kind, shape, y, spacing[e], normal, H)[0]
            n = normal[0], normal[1], normal[2]
            put(slip, e, q, planar(minus(_anchored(x, g, n, sharp), got(rests, e, q)), n))


@njit(cache=True)
def _anchored(x: Vector, g: float, n: Vector, sharp: bool) -> Vector:
    """Where an open point at x in the tool's frame is anchored, see `committed_anchors`."""
    return x if sharp and g > 0.0 else less(x, g, n)


@njit(cache=True)
def point_normals(points: Points, tool: ToolPose, normal: Floats) -> None:
    """Unit normals (ne, nq, 3) of the tool at the slave points, in world axes: what splits a traction for the output."""
    (at, a, _, spacing), (kind, shape, _, _, _), frame = points, tool, _frame(tool)
    y, n, H = np.empty(3), np.empty(3), np.empty((3, 3))
    for e in range(normal.shape[0]):
        for q in range(normal.shape[1]):
            y[0], y[1], y[2] = _to_tool(_place(at, a, e, q), frame)
            _meet(kind, shape, y, spacing[e], n, H)
            put(normal, e, q, _to_world(frame, (n[0], n[1], n[2])))


@njit(cache=True)
def distances(X: Floats, tool: ToolPose, gap: Floats) -> None:
    """Signed distances (n,) of fixed points X (n, 3) to a tool."""
    (kind, shape, _, _, _), frame = tool, _frame(tool)
    y, n, H = np.empty(3), np.empty(3), np.empty((3, 3))
    for p in range(len(X)):
        y[0], y[1], y[2] = _to_tool(row(X, p), frame)
        gap[p] = signed_distance(kind, shape, y, n, H)
