"""Contact elements of slave points with an analytic rigid tool: forces, tangent blocks and committed anchors.

An element is a group of slave points that move with the same slave nodes: one point for a node with its tributary
area, the quadrature points of a slave facet otherwise. The tool translates by `travel`; its frame is (axes, origin).
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.laws import edge_penalty, point_traction
from fenics_contact.kernels.rigid_shapes import edge_cover, face_distance, meets_face, signed_distance
from fenics_contact.kernels.status import OPEN, SLIP


@njit(cache=True)
def _to_tool(X, u, nodes, a, e, q, origin, axes, travel, y, x):
    """Position of slave point q of element e in the tool's frame, y = axes^T (x - origin - travel)."""
    for c in range(3):
        x[c] = -origin[c] - travel[c]
        for i in range(nodes.shape[1]):
            x[c] += a[e, q, i] * (X[e, i, c] + u[3 * nodes[e, i] + c])
    for r in range(3):
        y[r] = axes[0, r] * x[0] + axes[1, r] * x[1] + axes[2, r] * x[2]


@njit(cache=True)
def _gap_and_penalty(kind, shape, y, eps, body, spacing, active, n, H, ds, deps):
    """Gap with n (3,) and H (3, 3), and the penalty with its gradient: softened where y slides out under a sharp edge."""
    deps[:] = 0.0
    cover = edge_cover(kind, shape, y, spacing, ds)
    if not meets_face(kind, shape, y, spacing, cover):
        return signed_distance(kind, shape, y, active, n, H), eps
    gap = face_distance(shape, y, n, H)
    return gap, edge_penalty(eps, body, cover, ds, deps)


@njit(cache=True)
def _rotate(axes, local, out):
    for i in range(3):
        out[i] = axes[i, 0] * local[0] + axes[i, 1] * local[1] + axes[i, 2] * local[2]


@njit(cache=True)
def contact_elements(
    X, nodes, a, area, u, kind, shape, origin, axes, travel, anchor, shift, judged, eps_n, eps_t, body, spacing,
    mu, touch, want_tangent, force, tangent, arm, traction, gap, status, slip, cover,
):  # fmt: skip
    """Evaluate all contact elements of one surface with one tool. Pure: the anchors are read, never written.

    X (ne, k, 3) reference positions; nodes (ne, k) local node numbers; a (ne, nq, k) weights of the nodes in a point;
    area (ne, nq) tributary reference areas; u local displacements, three per node; anchor (ne, nq, 3) in the tool's
    frame; shift (ne, nq): multiplier over penalty [length]; judged (ne nq,): pressures that points start from
    over -eps_n [length], which decide their status and with which the tangent is taken; (0,): present ones;
    eps_n, eps_t, body (ne,) penalties and stiffness beneath [pressure/length]; spacing (ne,) of the points.
    Fills force (ne, k, 3) = sum of a area T, tangent (ne, 3k, 3k) its derivative,
    arm (ne, k, 3, 3) its derivative against a motion of all slave nodes at once (minus that against the tool's
    travel); per point traction (ne, nq, 3), gap, status, slip (ne, nq) = trial over Coulomb limit minus one,
    and cover (ne, nq) = penalty over eps_n, below one where the point slides out under a sharp edge.
    """
    ds, deps = np.empty(3), np.empty(3)
    ne, k = nodes.shape
    nq = area.shape[1]
    x, y, n, z = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    active, trial, T, tangential, world = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    H, dT, dtrial, half, D = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(ne):
        force[e] = 0.0
        if want_tangent:
            tangent[e] = 0.0
            arm[e] = 0.0
        for q in range(nq):
            _to_tool(X, u, nodes, a, e, q, origin, axes, travel, y, x)
            g, eps = _gap_and_penalty(kind, shape, y, eps_n[e], body[e], spacing[e], active, n, H, ds, deps)
            gap[e, q] = g
            cover[e, q] = eps / eps_n[e]
            traction[e, q] = 0.0
            slip[e, q] = 0.0
            press = g + shift[e, q]
            decides = judged[e * nq + q] if len(judged) > 0 else press
            if decides > touch:  # most points of a surface are open: leave before any law is evaluated
                status[e, q] = OPEN
                continue
            z[:] = y - g * n - anchor[e, q]
            if want_tangent:
                press = decides
            state = point_traction(
                g, press, decides, n, H, z, eps, deps, eps_t[e], mu, touch, want_tangent, trial, T, tangential, dtrial, dT
            )
            status[e, q] = state
            if mu > 0.0:
                limit = mu * max(-eps * decides, 1e-300)
                slip[e, q] = np.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2) / limit - 1.0
            _rotate(axes, T, world)
            traction[e, q] = world
            for i in range(k):
                w = a[e, q, i] * area[e, q]
                for c in range(3):
                    force[e, i, c] += w * world[c]
            if want_tangent:
                _world_tensor(axes, dT, half, D)
                _scatter_tangent(a, area, e, q, k, D, tangent, arm)


@njit(cache=True)
def _world_tensor(axes, local, half, out):
    """out = axes local axes^T."""
    for i in range(3):
        for j in range(3):
            half[i, j] = axes[i, 0] * local[0, j] + axes[i, 1] * local[1, j] + axes[i, 2] * local[2, j]
    for i in range(3):
        for j in range(3):
            out[i, j] = half[i, 0] * axes[j, 0] + half[i, 1] * axes[j, 1] + half[i, 2] * axes[j, 2]


@njit(cache=True)
def _scatter_tangent(a, area, e, q, k, D, tangent, arm):
    for i in range(k):
        w = a[e, q, i] * area[e, q]
        for c in range(3):
            for d in range(3):
                arm[e, i, c, d] += w * D[c, d]
                for j in range(k):
                    tangent[e, 3 * i + c, 3 * j + d] += w * a[e, q, j] * D[c, d]


@njit(cache=True)
def committed_anchors(
    X,
    nodes,
    a,
    u,
    kind,
    shape,
    origin,
    axes,
    travel,
    anchor,
    shift,
    eps_n,
    eps_t,
    body,
    spacing,
    mu,
    touch,
    new_anchor,
    sliding,
):
    """The anchors to keep when a step is accepted (tool's frame), and the slip distance of the step per point.

    Open points are anchored at their projection, sticking points keep their anchor, slipping ones are anchored where
    the elastic slip T_T/eps_T ends: the return mapping of (16). Fills new_anchor and sliding (ne, nq) [length].
    """
    ds, deps = np.empty(3), np.empty(3)
    ne, nq = anchor.shape[0], anchor.shape[1]
    x, y, n, z = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    active, trial, T, tangential = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    H, dT, dtrial = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(ne):
        for q in range(nq):
            _to_tool(X, u, nodes, a, e, q, origin, axes, travel, y, x)
            g, eps = _gap_and_penalty(kind, shape, y, eps_n[e], body[e], spacing[e], active, n, H, ds, deps)
            z[:] = y - g * n - anchor[e, q]
            press = g + shift[e, q]
            state = point_traction(
                g, press, press, n, H, z, eps, deps, eps_t[e], mu, touch, False, trial, T, tangential, dtrial, dT
            )
            sliding[e, q] = 0.0
            if state == OPEN:
                new_anchor[e, q] = y - g * n
            elif state == SLIP:
                new_anchor[e, q] = y - g * n - tangential / eps_t[e]
                moved = new_anchor[e, q] - anchor[e, q]
                sliding[e, q] = np.sqrt(moved[0] ** 2 + moved[1] ** 2 + moved[2] ** 2)
            else:
                new_anchor[e, q] = anchor[e, q]


@njit(cache=True)
def point_normals(X, nodes, a, u, kind, shape, origin, axes, travel, spacing, normal):
    """Unit normals (ne, nq, 3) of the tool at the slave points, in world axes: what splits a traction for the output."""
    x, y, n = np.empty(3), np.empty(3), np.empty(3)
    active, ds, H = np.empty(3), np.empty(3), np.empty((3, 3))
    for e in range(normal.shape[0]):
        for q in range(normal.shape[1]):
            _to_tool(X, u, nodes, a, e, q, origin, axes, travel, y, x)
            cover = edge_cover(kind, shape, y, spacing[e], ds)
            if meets_face(kind, shape, y, spacing[e], cover):
                face_distance(shape, y, n, H)
            else:
                signed_distance(kind, shape, y, active, n, H)
            _rotate(axes, n, normal[e, q])


@njit(cache=True)
def distances(X, kind, shape, origin, axes, travel, gap):
    """Signed distances (n,) of fixed points X (n, 3) to a tool."""
    y, n, active, H = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for p in range(len(X)):
        for r in range(3):
            y[r] = 0.0
            for c in range(3):
                y[r] += axes[c, r] * (X[p, c] - origin[c] - travel[c])
        gap[p] = signed_distance(kind, shape, y, active, n, H)
