"""The contact element of a slave point and a deformable master facet: place, traction, rates, slide of the anchor.

A slave point is x_S = sum a_i x_i over k slave nodes: one node, or the nodes of a slave facet seen from a quadrature
point.  The history of a point is its ANCHOR: node numbers and weights W_i (sum 1) on the facet where it last slid.  Its
image x_a = sum W_i x_i moves with the master body, knows no parametrisation and turns with the body, so traction is
continuous over facet edges and frame-indifferent.

Nodes of an element in order: k slave nodes, 4 master facet nodes, 4 anchor nodes: k + 8.  All that the traction depends on
are four vectors, its MODES, each a sum of node positions with the coefficients share[mode, node]:
    JUMP    x_S - x_M, place on the facet held
    FIRST   r_1, and SECOND r_2: tangents of the master facet (in kernels/ray_element.py: of the slave's facet)
    DRAG    x_M - x_a, place on the facet held
so rates are taken with respect to the modes (d(xi) = sum_m beta[m] . d(mode m), and so on) and spread to nodes at the end.

Arrays travel in groups (tuples, C-contiguous, float64 and int64):
    slaves     (nodes (np, k), weights a (np, k), area (np,) [length^2], gradients (np, 2, k) of the slave facet's shape
               functions where its normal seeks the master; (0, 2, k) where the closest point is meant)
    surface    (nodes (nf, 4), size (nf,)) as in kernels/facets.py
    projection (facet (np,), kind (np,), feature (np,), xi (np, 2), gap (np,), normal (np, 3)) as filled by
               kernels/closest_point.py or kernels/slave_ray.py at the same coordinates
    anchors    (nodes (np, 4), weights W (np, 4)); nodes[:, 0] = -1: no anchor yet
    law        (eps_n (np,), eps_t (np,) [pressure/length], mu, touch [length], shift (np,) [length]); shift: multiplier over
               eps_n, by which a point presses more than its gap does; touch: gap + shift up to it counts as closed
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import EDGE, INTERIOR
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
T1, T2 = 9, 10  # tangents of the slave's facet
# Modes.
JUMP, FIRST, SECOND, DRAG = 0, 1, 2, 3


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
def workspace(k):
    """vec, xf, c, N, dN, share (4, k + 8), and per mode beta (2, 4, 3) = d(xi), dn (4, 3, 3), dT (4, 3, 3)."""
    return (
        np.zeros((11, 3)), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros((2, 4)), np.zeros((4, k + 8)),
        np.zeros((2, 4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, 3)),
    )  # fmt: skip


@njit(cache=True)
def place(q, coords, slaves, surface, projection, anchors, work):
    """Kinematics (1) of pair q: fill D, R1, R2, R12, NORMAL, W, the shape functions and share; return the gap."""
    slave_nodes, slave_weights = slaves[0], slaves[1]
    facet_nodes, size = surface
    facet, kind, _, xi, gap, _ = projection
    anchor_nodes, anchor_weights = anchors
    vec, xf, c, N, dN, share = work[0], work[1], work[2], work[3], work[4], work[5]
    k = slave_nodes.shape[1]
    m, s, t = size[facet[q]], xi[q, 0], xi[q, 1]
    gather(coords, facet_nodes[facet[q]], m, xf)
    patch(m, xf, c)
    shape(m, s, t, N)
    shape_gradient(m, s, t, dN)
    has_anchor = anchor_nodes[q, 0] >= 0
    share[:, :] = 0.0
    for i in range(k):
        share[JUMP, i] = slave_weights[q, i]
    for i in range(4):
        share[JUMP, k + i], share[FIRST, k + i], share[SECOND, k + i] = -N[i], dN[0, i], dN[1, i]
        share[DRAG, k + i], share[DRAG, k + 4 + i] = N[i], -anchor_weights[q, i] if has_anchor else 0.0
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
def point_traction(q, g, judged, has_anchor, law, vec):
    """Laws (15)-(18) at g, the gap with its shift: fill TRIAL, TANGENTIAL and TRACTION; return (status, N, limit).

    judged: the gap that decides between open and closed, stick and slip: g itself, or the one that Newton's last solve
    foresaw (contact/deformable.py).
    """
    eps_n, eps_t, mu, touch, _ = law
    for p in range(3):
        vec[TRIAL, p] = vec[TANGENTIAL, p] = vec[TRACTION, p] = 0.0
    if not judged <= touch:
        return OPEN, 0.0, 0.0
    N = eps_n[q] * g
    status, limit = CLOSED, 0.0
    if mu > 0.0 and has_anchor:
        along = vec[NORMAL, 0] * vec[W, 0] + vec[NORMAL, 1] * vec[W, 1] + vec[NORMAL, 2] * vec[W, 2]
        for p in range(3):  # T_tr = eps_T P(n) (x_M - x_a) in place of T_T(t_k) + eps_T (xi(k+1) - xi(k)) of (17)
            vec[TRIAL, p] = eps_t[q] * (vec[W, p] - along * vec[NORMAL, p])
        limit = mu * max(-eps_n[q] * judged, 0.0)  # (16); a gap within touch presses on nothing
        size = math.sqrt(vec[TRIAL, 0] ** 2 + vec[TRIAL, 1] ** 2 + vec[TRIAL, 2] ** 2)
        if size <= eps_t[q] * touch:  # no way beyond round-off: it has no direction to slip in
            status = STICK
            vec[TANGENTIAL, :] = vec[TRIAL]
        else:
            status = coulomb_return(vec[TRIAL], limit, vec[TANGENTIAL])
        if status == SLIP and judged != g:
            for p in range(3):
                vec[TANGENTIAL, p] = -mu * N * vec[TRIAL, p] / size
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
def foot_rate(kind, m, feature, work):
    """Fill beta (2, 4, 3): xi^alpha moves by sum_m beta[alpha, m] . d(mode m), (8)."""
    vec, beta = work[0], work[6]
    g11, g12, g22 = _foot_metric(kind, m, feature, vec)
    for p in range(3):
        # (v_S - v_M).r_b + g n.v_M,b of (8)
        beta[0, JUMP, p] = g11 * vec[R1, p] + g12 * vec[R2, p]
        beta[1, JUMP, p] = g12 * vec[R1, p] + g22 * vec[R2, p]
        beta[0, FIRST, p], beta[1, FIRST, p] = g11 * vec[D, p], g12 * vec[D, p]
        beta[0, SECOND, p], beta[1, SECOND, p] = g12 * vec[D, p], g22 * vec[D, p]


@njit(cache=True)
def normal_rate(kind, g, work):
    """Fill dn (4, 3, 3): n moves by sum_m dn[m] d(mode m), from (6) inside and from n = d/g at edges and vertices."""
    vec, beta, dn = work[0], work[6], work[7]
    a11 = a12 = a22 = twist = 0.0
    for p in range(3):
        a11 += vec[R1, p] * vec[R1, p]
        a12 += vec[R1, p] * vec[R2, p]
        a22 += vec[R2, p] * vec[R2, p]
        twist += vec[NORMAL, p] * vec[R12, p]
    det = a11 * a22 - a12 * a12
    for mode in range(DRAG):
        for b in range(3):
            if kind == INTERIOR:
                # n.(v_M,a + r_ab xi^b) with r_12 the only second derivative of the patch
                w1 = twist * beta[1, mode, b] + (vec[NORMAL, b] if mode == FIRST else 0.0)
                w2 = twist * beta[0, mode, b] + (vec[NORMAL, b] if mode == SECOND else 0.0)
                u1, u2 = (a22 * w1 - a12 * w2) / det, (a11 * w2 - a12 * w1) / det
                for a in range(3):
                    dn[mode, a, b] = -vec[R1, a] * u1 - vec[R2, a] * u2
                continue
            along = 0.0
            for a in range(3):
                dn[mode, a, b] = -vec[R1, a] * beta[0, mode, b] - vec[R2, a] * beta[1, mode, b]
                if a == b and mode == JUMP:
                    dn[mode, a, b] += 1.0
                along += vec[NORMAL, a] * dn[mode, a, b]
            for a in range(3):
                dn[mode, a, b] = (dn[mode, a, b] - vec[NORMAL, a] * along) / g


@njit(cache=True)
def traction_rate(q, status, N, limit, law, lean1, lean2, work):
    """Fill dT (4, 3, 3): (26) for the normal part, (27) for stick, (28) with the mu d|N| block for slip.

    lean1, lean2: n . r_alpha, zero where n is the master's own normal.
    """
    vec, beta, dn, dT = work[0], work[6], work[7], work[8]
    eps_n, eps_t, mu, _, _ = law
    along = size = 0.0
    for p in range(3):
        along += vec[NORMAL, p] * vec[W, p]
        size += vec[TRIAL, p] * vec[TRIAL, p]
    size = math.sqrt(size)
    for mode in range(4):
        jump, drag = 1.0 if mode == JUMP else 0.0, 1.0 if mode == DRAG else 0.0
        for b in range(3):
            # (8): on the master's own normal the rate of the gap needs no rate of xi
            dg = jump * vec[NORMAL, b] - lean1 * beta[0, mode, b] - lean2 * beta[1, mode, b]
            for a in range(3):
                dT[mode, a, b] = eps_n[q] * dg * vec[NORMAL, a] + N * dn[mode, a, b]
            if status == CLOSED:
                continue
            dw0 = vec[R1, 0] * beta[0, mode, b] + vec[R2, 0] * beta[1, mode, b] + (drag if b == 0 else 0.0)
            dw1 = vec[R1, 1] * beta[0, mode, b] + vec[R2, 1] * beta[1, mode, b] + (drag if b == 1 else 0.0)
            dw2 = vec[R1, 2] * beta[0, mode, b] + vec[R2, 2] * beta[1, mode, b] + (drag if b == 2 else 0.0)
            turn = vec[NORMAL, 0] * dw0 + vec[NORMAL, 1] * dw1 + vec[NORMAL, 2] * dw2
            for a in range(3):
                turn += dn[mode, a, b] * vec[W, a]
            # d(P w) = dw - n (n.dw + dn.w) - dn (n.w)
            dt0 = eps_t[q] * (dw0 - vec[NORMAL, 0] * turn - dn[mode, 0, b] * along)
            dt1 = eps_t[q] * (dw1 - vec[NORMAL, 1] * turn - dn[mode, 1, b] * along)
            dt2 = eps_t[q] * (dw2 - vec[NORMAL, 2] * turn - dn[mode, 2, b] * along)
            scale, push = 1.0, 0.0
            if status == SLIP:
                scale = limit / size
                push = -scale * (vec[TRIAL, 0] * dt0 + vec[TRIAL, 1] * dt1 + vec[TRIAL, 2] * dt2) / (size * size)
                if N < 0.0:
                    push -= mu * eps_n[q] * dg / size
            dT[mode, 0, b] += scale * dt0 + push * vec[TRIAL, 0]
            dT[mode, 1, b] += scale * dt1 + push * vec[TRIAL, 1]
            dT[mode, 2, b] += scale * dt2 + push * vec[TRIAL, 2]


@njit(cache=True)
def slide_anchor(q, vec, dN, eps_t, weights):
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
