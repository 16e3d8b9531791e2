"""The contact element of a slave Gauss point whose own facet's normal finds the master: residual, tangent, anchor.

Same nodes, arrays and history as kernels/deformable_element.py; what differs is the normal n = -n_S of the slave facet,
and with it the rates: x_S - x_M = g n gives, with m = r_1 x r_2,

    dxi^a from the two components of  jump du - r_a dxi^a - g dn  normal to n,   dg = n . (jump du) - n . r_a dxi^a.

slaves has a fourth array: gradients (np, 2, k) of the slave facet's shape functions at the point.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.deformable_element import (
    NORMAL,
    R1,
    R2,
    TANGENTIAL,
    TRACTION,
    TRIAL,
    D,
    W,
    _place,
    _point_traction,
    _scatter_tangent,
    _slide_anchor,
    _traction_rate,
    _workspace,
)
from fenics_contact.kernels.slave_ray import slave_normal
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP


@njit(cache=True)
def _place_ray(q, coords, slaves, surface, projection, anchors, work, t1, t2):
    """Kinematics of pair q: as _place, with the slave's normal; returns (gap, |t1 x t2|)."""
    vec = work[0]
    _place(q, coords, slaves[:3], surface, projection, anchors, work)
    size = slave_normal(coords, slaves[0][q], slaves[3][q], t1, t2, vec[NORMAL])
    g = 0.0
    for p in range(3):
        g += vec[D, p] * vec[NORMAL, p]
    return g, size


@njit(cache=True)
def _ray_rates(k, g, size, gradients, t1, t2, work):
    """Fill dn (nd, 3, 3) from the slave's facet and beta (2, nd, 3), the rates of xi."""
    vec, jump, beta, dn = work[0], work[5], work[7], work[8]
    cross, turned = np.empty(3), np.empty(3)
    det = 0.0
    for p in range(3):
        a, b = (p + 1) % 3, (p + 2) % 3
        det += vec[NORMAL, p] * (vec[R1, a] * vec[R2, b] - vec[R1, b] * vec[R2, a])
    for j in range(k + 4):
        for b in range(3):
            # n = (t2 x t1)/size: d(t2 x t1) with dt_alpha = gradients[alpha, j] e_b
            along = 0.0
            for p in range(3):
                cross[p] = 0.0
            if j < k:
                e, f = (b + 1) % 3, (b + 2) % 3
                # gradients[1] e_b x t1 + gradients[0] t2 x e_b
                cross[f] = gradients[1, j] * t1[e] - gradients[0, j] * t2[e]
                cross[e] = -gradients[1, j] * t1[f] + gradients[0, j] * t2[f]
                for p in range(3):
                    along += vec[NORMAL, p] * cross[p]
            for p in range(3):
                dn[j, p, b] = (cross[p] - along * vec[NORMAL, p]) / size
                turned[p] = -g * dn[j, p, b] + (jump[j] if p == b else 0.0)
            first = second = 0.0
            for p in range(3):
                e, f = (p + 1) % 3, (p + 2) % 3
                first += vec[NORMAL, p] * (turned[e] * vec[R2, f] - turned[f] * vec[R2, e])
                second += vec[NORMAL, p] * (vec[R1, e] * turned[f] - vec[R1, f] * turned[e])
            beta[0, j, b], beta[1, j, b] = first / det, second / det


@njit(cache=True)
def contact_elements(
    coords, slaves, surface, projection, anchors, law, want_tangent, residual, tangent, status, traction, gap, slip
):
    """Evaluate all pairs, as contact_elements of kernels/deformable_element.py. Pure."""
    kind, k, area = projection[1], slaves[0].shape[1], slaves[2]
    nd = k + 8
    work = _workspace(k)
    vec, jump, _beta = work[0], work[5], work[7]
    t1, t2 = np.empty(3), np.empty(3)
    for q in range(kind.shape[0]):
        residual[q, :] = 0.0
        traction[q, :] = 0.0
        if want_tangent:
            tangent[q, :, :] = 0.0
        status[q], gap[q], slip[q] = OPEN, projection[4][q], 0.0
        if kind[q] == NONE or not gap[q] <= law[3]:
            continue
        g, size = _place_ray(q, coords, slaves, surface, projection, anchors, work, t1, t2)
        state, N, limit = _point_traction(q, g, anchors[0][q, 0] >= 0, law, vec)
        gap[q], status[q] = g, state
        if state == OPEN:
            continue
        if state != CLOSED:
            trial = np.sqrt(vec[TRIAL, 0] ** 2 + vec[TRIAL, 1] ** 2 + vec[TRIAL, 2] ** 2)
            slip[q] = trial / max(limit, 1e-300) - 1.0
        for p in range(3):
            traction[q, p] = vec[TRACTION, p]
            for i in range(k + 4):
                residual[q, 3 * i + p] = area[q] * jump[i] * vec[TRACTION, p]
        if want_tangent:
            _ray_rates(k, g, size, slaves[3][q], t1, t2, work)
            lean1 = lean2 = 0.0
            for p in range(3):
                lean1 += vec[NORMAL, p] * vec[R1, p]
                lean2 += vec[NORMAL, p] * vec[R2, p]
            _traction_rate(q, k, nd, state, N, limit, law, lean1, lean2, work)
            _scatter_tangent(k, nd, area[q], work, tangent[q])


@njit(cache=True)
def committed_anchors(coords, slaves, surface, projection, anchors, law, new_anchors, sliding):
    """The anchors to keep when a step is accepted, as committed_anchors of kernels/deformable_element.py."""
    facet, kind = projection[0], projection[1]
    nodes, weights = new_anchors
    work = _workspace(slaves[0].shape[1])
    vec, N, dN = work[0], work[3], work[4]
    t1, t2 = np.empty(3), np.empty(3)
    for q in range(kind.shape[0]):
        sliding[q] = 0.0
        if kind[q] == NONE:
            nodes[q, :] = -1
            weights[q, :] = 0.0
            continue
        g, _ = _place_ray(q, coords, slaves, surface, projection, anchors, work, t1, t2)
        status, _, _ = _point_traction(q, g, anchors[0][q, 0] >= 0, law, vec)
        for i in range(4):
            if status in (OPEN, CLOSED, SLIP):
                nodes[q, i], weights[q, i] = surface[0][facet[q], i], N[i]
            else:
                nodes[q, i], weights[q, i] = anchors[0][q, i], anchors[1][q, i]
        if status == SLIP:
            _slide_anchor(q, vec, dN, law[1], weights[q])
            for p in range(3):
                sliding[q] += (vec[W, p] - vec[TANGENTIAL, p] / law[1][q]) ** 2
            sliding[q] = np.sqrt(sliding[q])
