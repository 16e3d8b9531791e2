"""The contact element of a slave point and a deformable master facet: residual, exact tangent and committed anchor.

A slave point is x_S = sum a_i x_i over k slave nodes: one node, or the nodes of a slave facet seen from a quadrature
point.  The history of a point is its ANCHOR: node numbers and weights W_i (sum 1) on the facet where it last slid.  Its
image x_a = sum W_i x_i moves with the master body, knows no parametrisation and turns with the body, so traction is
continuous over facet edges and frame-indifferent.

Nodes of an element in order: k slave nodes, 4 master facet nodes, 4 anchor nodes: k + 8.  Rows of the anchor nodes
are zero, since T acts at x_M; their columns are not.  A node may occur twice (anchor on the projection's facet):
insertion adds.

Arrays travel in groups (tuples, C-contiguous, float64 and int64):
    slaves     (nodes (np, k), weights a (np, k), area (np,) [length^2])
    surface    (nodes (nf, 4), size (nf,)) as in kernels/facets.py
    projection (facet (np,), kind (np,), feature (np,), xi (np, 2), gap (np,), normal (np, 3)) as filled by
               kernels/closest_point.py at the same coordinates
    anchors    (nodes (np, 4), weights W (np, 4)); nodes[:, 0] = -1: no anchor yet
    law        (eps_n (np,), eps_t (np,) [pressure/length], mu, touch [length]); touch: gaps up to it count as closed
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import EDGE, INTERIOR, NONE
from fenics_contact.kernels.facets import corner, gather, patch, patch_normal, shape, shape_gradient
from fenics_contact.kernels.laws import coulomb_return
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

# Rows of the vector workspace.
D = 0  # x_S - x_M
R1, R2, R12 = 1, 2, 3  # r_1, r_2, r_12
NORMAL = 4
W = 5  # x_M - x_a, the elastic slip before projection
TRIAL = 6  # T_T^tr
TANGENTIAL = 7  # T_T
TRACTION = 8  # T


@njit(cache=True)
def slave_points(coords, nodes, weights, points):
    """Fill points (np, 3) with x_S = sum a_i x_i of nodes (np, k) and weights (np, k)."""
    for q in range(nodes.shape[0]):
        for p in range(3):
            points[q, p] = 0.0
            for i in range(nodes.shape[1]):
                points[q, p] += weights[q, i] * coords[nodes[q, i], p]


@njit(cache=True)
def element_nodes(slave_nodes, facet_nodes, facet, anchor_nodes, nodes):
    """Fill nodes (np, k + 8) with valid node numbers: where a part is missing its rows and columns are zero."""
    k = slave_nodes.shape[1]
    for q in range(slave_nodes.shape[0]):
        nodes[q, :k] = slave_nodes[q]
        for i in range(4):
            nodes[q, k + i] = facet_nodes[facet[q], i] if facet[q] >= 0 else slave_nodes[q, 0]
            nodes[q, k + 4 + i] = anchor_nodes[q, i] if anchor_nodes[q, 0] >= 0 else nodes[q, k + i]


@njit(cache=True)
def _workspace(k):
    vec, xf, c = np.zeros((9, 3)), np.zeros((4, 3)), np.zeros((4, 3))
    N, dN = np.zeros(4), np.zeros((2, 4))
    jump, drag = np.zeros(k + 8), np.zeros(k + 8)
    # coefficients of dx_S - dx_M and of dx_M - dx_a per node, xi held; then d(xi)/du, dn/du, dT/du per node
    beta, dn, dT = np.zeros((2, k + 8, 3)), np.zeros((k + 8, 3, 3)), np.zeros((k + 8, 3, 3))
    return vec, xf, c, N, dN, jump, drag, beta, dn, dT


@njit(cache=True)
def _place(q, coords, slaves, surface, projection, anchors, work):
    """Kinematics (1) of pair q: fill D, R1, R2, R12, NORMAL, W, the shape functions, jump and drag; return the gap."""
    slave_nodes, slave_weights, _ = slaves
    facet_nodes, size = surface
    facet, kind, _, xi, gap, _ = projection
    anchor_nodes, anchor_weights = anchors
    vec, xf, c, N, dN, jump, drag = work[0], work[1], work[2], work[3], work[4], work[5], work[6]
    k = slave_nodes.shape[1]
    m, s, t = size[facet[q]], xi[q, 0], xi[q, 1]
    gather(coords, facet_nodes[facet[q]], m, xf)
    patch(m, xf, c)
    shape(m, s, t, N)
    shape_gradient(m, s, t, dN)
    has_anchor = anchor_nodes[q, 0] >= 0
    for i in range(k):
        jump[i] = slave_weights[q, i]
    for i in range(4):
        jump[k + i], drag[k + i] = -N[i], N[i]
        drag[k + 4 + i] = -anchor_weights[q, i] if has_anchor else 0.0
    g = 0.0
    for p in range(3):
        x_s = x_a = 0.0
        for i in range(k):
            x_s += slave_weights[q, i] * coords[slave_nodes[q, i], p]
        x_m = c[0, p] + c[1, p] * s + c[2, p] * t + c[3, p] * s * t
        if has_anchor:
            for i in range(4):
                x_a += anchor_weights[q, i] * coords[anchor_nodes[q, i], p]
        vec[D, p] = x_s - x_m
        vec[W, p] = x_m - x_a if has_anchor else 0.0
        vec[R1, p], vec[R2, p], vec[R12, p] = c[1, p] + c[3, p] * t, c[2, p] + c[3, p] * s, c[3, p]
        g += vec[D, p] * vec[D, p]
    if kind[q] == INTERIOR:
        patch_normal(c, s, t, vec[NORMAL])
        return vec[D, 0] * vec[NORMAL, 0] + vec[D, 1] * vec[NORMAL, 1] + vec[D, 2] * vec[NORMAL, 2]
    g = math.copysign(math.sqrt(g), gap[q])
    for p in range(3):
        vec[NORMAL, p] = vec[D, p] / g
    return g


@njit(cache=True)
def _point_traction(q, g, has_anchor, law, vec):
    """Laws (15)-(18) at gap g: fill TRIAL, TANGENTIAL and TRACTION; return (status, N, limit)."""
    eps_n, eps_t, mu, touch = law
    for p in range(3):
        vec[TRIAL, p] = vec[TANGENTIAL, p] = vec[TRACTION, p] = 0.0
    if not g <= touch:
        return OPEN, 0.0, 0.0
    N = eps_n[q] * g
    status, limit = CLOSED, 0.0
    if mu > 0.0 and has_anchor:
        along = vec[NORMAL, 0] * vec[W, 0] + vec[NORMAL, 1] * vec[W, 1] + vec[NORMAL, 2] * vec[W, 2]
        for p in range(3):  # T_tr = eps_T P(n) (x_M - x_a) in place of T_T(t_k) + eps_T (xi(k+1) - xi(k)) of (17)
            vec[TRIAL, p] = eps_t[q] * (vec[W, p] - along * vec[NORMAL, p])
        limit = mu * max(-N, 0.0)  # (16); a gap within touch presses on nothing
        status = coulomb_return(vec[TRIAL], limit, vec[TANGENTIAL])
    for p in range(3):
        vec[TRACTION, p] = N * vec[NORMAL, p] + vec[TANGENTIAL, p]
    return status, N, limit


@njit(cache=True)
def _foot_metric(kind, m, feature, vec):
    """G in d(xi)^a = G^ab (jump r_b + d N_,b) du: H^-1 of (8) inside, its like along an edge, 0 at a vertex."""
    if kind == INTERIOR:
        a11 = a12 = a22 = 0.0
        for p in range(3):
            a11 += vec[R1, p] * vec[R1, p]
            a12 += vec[R1, p] * vec[R2, p] - vec[D, p] * vec[R12, p]  # H_ab = a_ab - g n.r_ab
            a22 += vec[R2, p] * vec[R2, p]
        det = a11 * a22 - a12 * a12
        if det == 0.0:  # x_S in the centre of curvature: the foot has no rate there
            return 0.0, 0.0, 0.0
        return a22 / det, -a12 / det, a11 / det
    if kind == EDGE:
        s0, t0 = corner(m, feature)
        s1, t1 = corner(m, (feature + 1) % m)
        ds, dt = s1 - s0, t1 - t0
        ee = 0.0
        for p in range(3):
            ee += (ds * vec[R1, p] + dt * vec[R2, p]) ** 2
        return ds * ds / ee, ds * dt / ee, dt * dt / ee
    return 0.0, 0.0, 0.0


@njit(cache=True)
def _foot_rate(kind, m, k, feature, work):
    """Fill beta (2, nd, 3): xi^alpha moves by sum_j beta[alpha, j] . du_j."""
    vec, dN, jump, beta = work[0], work[4], work[5], work[7]
    g11, g12, g22 = _foot_metric(kind, m, feature, vec)
    for j in range(k + 4):
        n1, n2 = 0.0, 0.0
        if j >= k:
            n1, n2 = dN[0, j - k], dN[1, j - k]
        for p in range(3):
            f1 = jump[j] * vec[R1, p] + n1 * vec[D, p]  # (v_S - v_M).r_b + g n.v_M,b of (8)
            f2 = jump[j] * vec[R2, p] + n2 * vec[D, p]
            beta[0, j, p] = g11 * f1 + g12 * f2
            beta[1, j, p] = g12 * f1 + g22 * f2


@njit(cache=True)
def _normal_rate(kind, k, g, work):
    """Fill dn (nd, 3, 3): n moves by sum_j dn[j] du_j, from (6) inside and from n = d/g at edges and vertices."""
    vec, dN, jump, beta, dn = work[0], work[4], work[5], work[7], work[8]
    a11 = a12 = a22 = twist = 0.0
    for p in range(3):
        a11 += vec[R1, p] * vec[R1, p]
        a12 += vec[R1, p] * vec[R2, p]
        a22 += vec[R2, p] * vec[R2, p]
        twist += vec[NORMAL, p] * vec[R12, p]
    det = a11 * a22 - a12 * a12
    for j in range(k + 4):
        n1, n2 = 0.0, 0.0
        if j >= k:
            n1, n2 = dN[0, j - k], dN[1, j - k]
        for b in range(3):
            if kind == INTERIOR:
                # n.(v_M,a + r_ab xi^b) with r_12 the only second derivative of the patch
                w1 = n1 * vec[NORMAL, b] + twist * beta[1, j, b]
                w2 = n2 * vec[NORMAL, b] + twist * beta[0, j, b]
                u1, u2 = (a22 * w1 - a12 * w2) / det, (a11 * w2 - a12 * w1) / det
                for a in range(3):
                    dn[j, a, b] = -vec[R1, a] * u1 - vec[R2, a] * u2
                continue
            along = 0.0
            for a in range(3):
                dn[j, a, b] = -vec[R1, a] * beta[0, j, b] - vec[R2, a] * beta[1, j, b]
                if a == b:
                    dn[j, a, b] += jump[j]
                along += vec[NORMAL, a] * dn[j, a, b]
            for a in range(3):
                dn[j, a, b] = (dn[j, a, b] - vec[NORMAL, a] * along) / g


@njit(cache=True)
def _traction_rate(q, k, nd, status, N, limit, law, lean1, lean2, work):
    """Fill dT (nd, 3, 3): (26) for the normal part, (27) for stick, (28) with the mu d|N| block for slip.

    lean1, lean2: n . r_alpha, zero where n is the master's own normal.
    """
    vec, jump, drag, beta, dn, dT = work[0], work[5], work[6], work[7], work[8], work[9]
    eps_n, eps_t, mu, _ = law
    along = size = 0.0
    for p in range(3):
        along += vec[NORMAL, p] * vec[W, p]
        size += vec[TRIAL, p] * vec[TRIAL, p]
    size = math.sqrt(size)
    for j in range(nd):
        for b in range(3):
            # (8): on the master's own normal the rate of the gap needs no rate of xi
            dg = jump[j] * vec[NORMAL, b] - lean1 * beta[0, j, b] - lean2 * beta[1, j, b]
            for a in range(3):
                dT[j, a, b] = eps_n[q] * dg * vec[NORMAL, a] + N * dn[j, a, b]
            if status == CLOSED:
                continue
            dw0 = vec[R1, 0] * beta[0, j, b] + vec[R2, 0] * beta[1, j, b] + (drag[j] if b == 0 else 0.0)
            dw1 = vec[R1, 1] * beta[0, j, b] + vec[R2, 1] * beta[1, j, b] + (drag[j] if b == 1 else 0.0)
            dw2 = vec[R1, 2] * beta[0, j, b] + vec[R2, 2] * beta[1, j, b] + (drag[j] if b == 2 else 0.0)
            turn = vec[NORMAL, 0] * dw0 + vec[NORMAL, 1] * dw1 + vec[NORMAL, 2] * dw2
            for a in range(3):
                turn += dn[j, a, b] * vec[W, a]
            # d(P w) = dw - n (n.dw + dn.w) - dn (n.w)
            dt0 = eps_t[q] * (dw0 - vec[NORMAL, 0] * turn - dn[j, 0, b] * along)
            dt1 = eps_t[q] * (dw1 - vec[NORMAL, 1] * turn - dn[j, 1, b] * along)
            dt2 = eps_t[q] * (dw2 - vec[NORMAL, 2] * turn - dn[j, 2, b] * along)
            scale, push = 1.0, 0.0
            if status == SLIP:
                scale = limit / size
                push = -scale * (vec[TRIAL, 0] * dt0 + vec[TRIAL, 1] * dt1 + vec[TRIAL, 2] * dt2) / (size * size)
                if N < 0.0:
                    push -= mu * eps_n[q] * dg / size
            dT[j, 0, b] += scale * dt0 + push * vec[TRIAL, 0]
            dT[j, 1, b] += scale * dt1 + push * vec[TRIAL, 1]
            dT[j, 2, b] += scale * dt2 + push * vec[TRIAL, 2]


@njit(cache=True)
def _scatter_tangent(k, nd, area, work, tangent):
    """tangent[3i + a, 3j + b] = area d(jump_i T_a)/du_jb for the rows of slave and master nodes."""
    vec, dN, jump, beta, dT = work[0], work[4], work[5], work[7], work[9]
    for i in range(k + 4):
        for a in range(3):
            n1, n2 = 0.0, 0.0
            if i >= k:
                n1, n2 = dN[0, i - k] * vec[TRACTION, a], dN[1, i - k] * vec[TRACTION, a]
            for j in range(nd):
                for b in range(3):
                    tangent[3 * i + a, 3 * j + b] = area * (jump[i] * dT[j, a, b] - n1 * beta[0, j, b] - n2 * beta[1, j, b])


@njit(cache=True)
def contact_elements(
    coords, slaves, surface, projection, anchors, law, want_tangent, residual, tangent, status, traction, gap, slip
):
    """Evaluate all pairs at positions coords (nx, 3).  Pure: projection and anchors are read, never written.

    Fills residual (np, 3 (k + 8)), the virtual power area T.(dv_S - dv_M) of (14), and tangent
    (np, 3 (k + 8), 3 (k + 8)), its exact derivative with the projection following; per point status, traction (np, 3)
    T = N n + T_T, gap (np,), and slip (np,) = |T_tr| over the Coulomb limit minus 1, 0 where there is no friction.
    Without want_tangent, tangent is not touched and may be empty.
    """
    kind, feature = projection[1], projection[2]
    k, area = slaves[0].shape[1], slaves[2]
    nd = k + 8
    work = _workspace(k)
    vec, jump = work[0], work[5]
    for q in range(kind.shape[0]):
        residual[q, :] = 0.0
        traction[q, :] = 0.0
        if want_tangent:
            tangent[q, :, :] = 0.0
        status[q], gap[q], slip[q] = OPEN, np.inf, 0.0
        if kind[q] == NONE:
            continue
        gap[q] = projection[4][q]
        if not gap[q] <= law[3]:  # most points of a surface are open: leave before anything is evaluated
            continue
        g = _place(q, coords, slaves, surface, projection, anchors, work)
        state, N, limit = _point_traction(q, g, anchors[0][q, 0] >= 0, law, vec)
        gap[q], status[q] = g, state
        if state == OPEN:
            continue
        if state != CLOSED:
            size = math.sqrt(vec[TRIAL, 0] ** 2 + vec[TRIAL, 1] ** 2 + vec[TRIAL, 2] ** 2)
            slip[q] = size / max(limit, 1e-300) - 1.0
        for p in range(3):
            traction[q, p] = vec[TRACTION, p]
            for i in range(k + 4):
                residual[q, 3 * i + p] = area[q] * jump[i] * vec[TRACTION, p]
        if want_tangent:
            _foot_rate(kind[q], surface[1][projection[0][q]], k, feature[q], work)
            _normal_rate(kind[q], k, g, work)
            _traction_rate(q, k, nd, state, N, limit, law, 0.0, 0.0, work)
            _scatter_tangent(k, nd, area[q], work, tangent[q])


@njit(cache=True)
def _slide_anchor(q, vec, dN, eps_t, weights):
    """Take e^alpha N_i,alpha off weights: the anchor trails x_M by the elastic slip e = T_T/eps_T.

    At an edge or vertex e is normal to n but may leave the facet's plane; there the vector e' of the plane with
    P(n) e' = e stands for it, so that the committed traction is felt again unchanged.
    """
    cross0 = vec[R1, 1] * vec[R2, 2] - vec[R1, 2] * vec[R2, 1]
    cross1 = vec[R1, 2] * vec[R2, 0] - vec[R1, 0] * vec[R2, 2]
    cross2 = vec[R1, 0] * vec[R2, 1] - vec[R1, 1] * vec[R2, 0]
    up = cross0 * vec[NORMAL, 0] + cross1 * vec[NORMAL, 1] + cross2 * vec[NORMAL, 2]
    out = cross0 * vec[TANGENTIAL, 0] + cross1 * vec[TANGENTIAL, 1] + cross2 * vec[TANGENTIAL, 2]
    area2 = cross0 * cross0 + cross1 * cross1 + cross2 * cross2
    # cos of 84 degrees: a normal that lies flatter on its facet than that has no such e'
    tilt = out / up if up > 0.1 * math.sqrt(area2) else 0.0
    a11 = a12 = a22 = e1 = e2 = 0.0
    for p in range(3):
        e = (vec[TANGENTIAL, p] - tilt * vec[NORMAL, p]) / eps_t[q]
        a11 += vec[R1, p] * vec[R1, p]
        a12 += vec[R1, p] * vec[R2, p]
        a22 += vec[R2, p] * vec[R2, p]
        e1 += e * vec[R1, p]
        e2 += e * vec[R2, p]
    det = a11 * a22 - a12 * a12
    for i in range(4):  # e^alpha = a^ab e_b
        weights[i] -= ((a22 * e1 - a12 * e2) * dN[0, i] + (a11 * e2 - a12 * e1) * dN[1, i]) / det


@njit(cache=True)
def committed_anchors(coords, slaves, surface, projection, anchors, law, new_anchors, sliding):
    """The anchors to keep when a step is accepted: new_anchors = (nodes (np, 4), weights (np, 4)), and sliding (np,).

    Open or frictionless: the projection itself.  Stick: unchanged.  Slip: behind the projection by the elastic slip
    T_T/eps_T, the return mapping of (16).  No partner: none (-1).  sliding is the way the anchor's image moved in
    slip [length].  new_anchors must not be the arrays of anchors.
    """
    facet, kind = projection[0], projection[1]
    nodes, weights = new_anchors
    work = _workspace(slaves[0].shape[1])
    vec, N, dN = work[0], work[3], work[4]
    for q in range(kind.shape[0]):
        sliding[q] = 0.0
        if kind[q] == NONE:
            nodes[q, :] = -1
            weights[q, :] = 0.0
            continue
        g = _place(q, coords, slaves, surface, projection, anchors, work)
        status, _, _ = _point_traction(q, g, anchors[0][q, 0] >= 0, law, vec)
        if status != STICK:
            for i in range(4):
                nodes[q, i], weights[q, i] = surface[0][facet[q], i], N[i]
        else:
            for i in range(4):
                nodes[q, i], weights[q, i] = anchors[0][q, i], anchors[1][q, i]
        if status == SLIP:
            _slide_anchor(q, vec, dN, law[1], weights[q])
            moved = 0.0
            for p in range(3):
                moved += (vec[W, p] - vec[TANGENTIAL, p] / law[1][q]) ** 2
            sliding[q] = math.sqrt(moved)
