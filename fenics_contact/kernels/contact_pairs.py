"""All pairs of slave points and master facets in one pass: forces, tangent, foreseen gaps, anchors to keep.

Arrays as in kernels/deformable_element.py.  `judged` (np,) are the gaps, shifts added, that decide the points' status where
they are not the present ones; (0,) where they are.
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.deformable_element import (
    DRAG,
    FIRST,
    JUMP,
    NORMAL,
    R1,
    R2,
    SECOND,
    TANGENTIAL,
    TRACTION,
    TRIAL,
    W,
    foot_rate,
    normal_rate,
    place,
    point_traction,
    slide_anchor,
    traction_rate,
    workspace,
)
from fenics_contact.kernels.ray_element import place_along_normal, ray_rates
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK


@njit(cache=True)
def _place(q, coords, slaves, surface, projection, anchors, work):
    """(gap, |t1 x t2| of the slave's facet) of pair q, its kinematics in work."""
    g = place(q, coords, slaves, surface, projection, anchors, work)
    if len(slaves[3]) > 0:
        return place_along_normal(q, coords, slaves, work)
    return g, 0.0


@njit(cache=True)
def _rates(q, g, size, surface, projection, ray, work):
    """Fill the rates of xi and of the normal; returns n . r_1, n . r_2."""
    vec = work[0]
    if not ray:
        kind = projection[1][q]
        foot_rate(kind, surface[1][projection[0][q]], projection[2][q], work)
        normal_rate(kind, g, work)
        return 0.0, 0.0
    ray_rates(g, size, work)
    lean1 = vec[NORMAL, 0] * vec[R1, 0] + vec[NORMAL, 1] * vec[R1, 1] + vec[NORMAL, 2] * vec[R1, 2]
    lean2 = vec[NORMAL, 0] * vec[R2, 0] + vec[NORMAL, 1] * vec[R2, 1] + vec[NORMAL, 2] * vec[R2, 2]
    return lean1, lean2


@njit(cache=True)
def _judged(q, projection, law, judged):
    return judged[q] if len(judged) > 0 else projection[4][q] + law[4][q]


@njit(cache=True)
def add_forces(coords, slaves, surface, projection, anchors, law, judged, forces, status, traction, excess):
    """Add the virtual power area T.(dv_S - dv_M) of (14) to forces (nx, 3) at positions coords (nx, 3).  Pure.

    Fills per point status, traction (np, 3) T = N n + T_T, and excess (np,) = |T_tr| over the Coulomb limit minus 1,
    0 where there is no friction.
    """
    k = slaves[0].shape[1]
    work = workspace(k)
    vec, share = work[0], work[5]
    for q in range(len(status)):
        status[q], excess[q] = OPEN, 0.0
        traction[q, 0] = traction[q, 1] = traction[q, 2] = 0.0
        decides = _judged(q, projection, law, judged)
        if projection[1][q] == NONE or not decides <= law[3]:
            continue  # most points of a surface are open: leave before anything is evaluated
        g, _ = _place(q, coords, slaves, surface, projection, anchors, work)
        press = g + law[4][q]
        state, _, limit = point_traction(q, press, decides if len(judged) > 0 else press, anchors[0][q, 0] >= 0, law, vec)
        status[q] = state
        if state == OPEN:
            continue
        if state != CLOSED:
            size = math.sqrt(vec[TRIAL, 0] ** 2 + vec[TRIAL, 1] ** 2 + vec[TRIAL, 2] ** 2)
            excess[q] = size / max(limit, 1e-300) - 1.0
        for p in range(3):
            traction[q, p] = vec[TRACTION, p]
            for i in range(k):
                forces[slaves[0][q, i], p] += slaves[2][q] * share[JUMP, i] * vec[TRACTION, p]
            for i in range(4):
                node = surface[0][projection[0][q], i]
                forces[node, p] += slaves[2][q] * share[JUMP, k + i] * vec[TRACTION, p]


@njit(cache=True)
def _felt_nodes(q, slaves, surface, projection, anchors, nodes, work):
    """Fill nodes (k + 8,) of pair q; returns how many of them T depends on: on its own facet an anchor adds none."""
    k, share = slaves[0].shape[1], work[5]
    at_home, has_anchor = True, anchors[0][q, 0] >= 0
    for i in range(k):
        nodes[i] = slaves[0][q, i]
    for i in range(4):
        nodes[k + i] = surface[0][projection[0][q], i]
        nodes[k + 4 + i] = anchors[0][q, i] if has_anchor else nodes[k + i]
        at_home = at_home and nodes[k + 4 + i] == nodes[k + i]
    if not at_home:
        return k + 8
    for i in range(4):
        share[DRAG, k + i] += share[DRAG, k + 4 + i]
    return k + 4


@njit(cache=True)
def _find(columns, low, high, wanted):
    """Place of `wanted` in the rising columns[low:high], or -1."""
    end = high
    while low < high:
        middle = (low + high) // 2
        if columns[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low if low < end and columns[low] == wanted else -1


@njit(cache=True)
def add_tangents(coords, slaves, surface, projection, anchors, law, judged, pattern, values, used):
    """Add the exact derivative of the forces, with the foot on the master following, to blocks values (nb, 3, 3).  Pure.

    pattern = (blocks (nx,): global number of each node, first (nx,), end (nx,): where its row begins and ends in
    columns (nb,), rising global numbers).  Marks used (nb,).  With judged gaps the points press with these, which are
    then the pressures of a mixed method.  Returns the number of blocks that were not in the pattern.
    """
    blocks, first, end, columns = pattern
    k, ray = slaves[0].shape[1], len(slaves[3]) > 0
    work, nodes = workspace(k), np.empty(k + 8, np.int64)
    vec, dN, share, beta, dT = work[0], work[4], work[5], work[6], work[8]
    Q, B = np.empty((k + 8, 3, 3)), np.empty((k + 8, 2, 3))
    missing = 0
    for q in range(len(projection[0])):
        decides = _judged(q, projection, law, judged)
        if projection[1][q] == NONE or not decides <= law[3]:
            continue
        g, size = _place(q, coords, slaves, surface, projection, anchors, work)
        if len(judged) == 0:
            decides = g + law[4][q]
        state, N, limit = point_traction(q, decides, decides, anchors[0][q, 0] >= 0, law, vec)
        if state == OPEN:
            continue
        lean1, lean2 = _rates(q, g, size, surface, projection, ray, work)
        traction_rate(q, state, N, limit, law, lean1, lean2, work)
        felt = _felt_nodes(q, slaves, surface, projection, anchors, nodes, work)
        area = slaves[2][q]
        for j in range(felt):
            jump, one, two, drag = share[JUMP, j], share[FIRST, j], share[SECOND, j], share[DRAG, j]
            for b in range(3):
                for a in range(3):
                    Q[j, a, b] = area * (
                        jump * dT[JUMP, a, b] + one * dT[FIRST, a, b] + two * dT[SECOND, a, b] + drag * dT[DRAG, a, b]
                    )
                for a in range(2):
                    B[j, a, b] = area * (jump * beta[a, JUMP, b] + one * beta[a, FIRST, b] + two * beta[a, SECOND, b])
        for i in range(k + 4):
            row, push = nodes[i], share[JUMP, i]
            for j in range(felt):
                at = _find(columns, first[row], end[row], blocks[nodes[j]])
                if at < 0:
                    missing += 1
                    continue
                used[at] = True
                for a in range(3):
                    for b in range(3):
                        values[at, a, b] += push * Q[j, a, b]
                if i >= k:  # x_M moves on its facet
                    for a in range(3):
                        for b in range(3):
                            values[at, a, b] -= vec[TRACTION, a] * (dN[0, i - k] * B[j, 0, b] + dN[1, i - k] * B[j, 1, b])
    return missing


@njit(cache=True)
def foreseen_gaps(coords, slaves, surface, projection, anchors, moved, gaps):
    """Fill gaps (np,): what the gaps at positions coords become, linearised, when the nodes move by moved (nx, 3)."""
    k, ray = slaves[0].shape[1], len(slaves[3]) > 0
    work, nodes = workspace(k), np.empty(k + 8, np.int64)
    vec, share, beta = work[0], work[5], work[6]
    for q in range(len(gaps)):
        gaps[q] = np.inf
        if projection[1][q] == NONE:
            continue
        g, size = _place(q, coords, slaves, surface, projection, anchors, work)
        lean1, lean2 = _rates(q, g, size, surface, projection, True, work) if ray else (0.0, 0.0)
        _felt_nodes(q, slaves, surface, projection, anchors, nodes, work)
        for i in range(k + 4):
            for b in range(3):
                dg = share[JUMP, i] * vec[NORMAL, b]  # (8)
                for mode in range(DRAG if ray else 0):
                    dg -= share[mode, i] * (lean1 * beta[0, mode, b] + lean2 * beta[1, mode, b])
                g += dg * moved[nodes[i], b]
        gaps[q] = g


@njit(cache=True)
def committed_anchors(coords, slaves, surface, projection, anchors, law, new_anchors, sliding):
    """The anchors to keep when a step is accepted: new_anchors = (nodes (np, 4), weights (np, 4)), and sliding (np,).

    Open or frictionless: the projection itself.  Stick: unchanged.  Slip: behind the projection by the elastic slip
    T_T/eps_T, the return mapping of (16).  No partner: none (-1).  sliding is the way the anchor's image moved in
    slip [length].  new_anchors must not be the arrays of anchors.
    """
    facet, kind = projection[0], projection[1]
    nodes, weights = new_anchors
    work = workspace(slaves[0].shape[1])
    vec, N, dN = work[0], work[3], work[4]
    for q in range(len(sliding)):
        sliding[q] = 0.0
        if kind[q] == NONE:
            nodes[q, :] = -1
            weights[q, :] = 0.0
            continue
        g, _ = _place(q, coords, slaves, surface, projection, anchors, work)
        press = g + law[4][q]
        status, _, _ = point_traction(q, press, press, anchors[0][q, 0] >= 0, law, vec)
        for i in range(4):
            if status == STICK:
                nodes[q, i], weights[q, i] = anchors[0][q, i], anchors[1][q, i]
            else:
                nodes[q, i], weights[q, i] = surface[0][facet[q], i], N[i]
        if status == SLIP:
            slide_anchor(q, vec, dN, law[1], weights[q])
            moved = 0.0
            for p in range(3):
                moved += (vec[W, p] - vec[TANGENTIAL, p] / law[1][q]) ** 2
            sliding[q] = math.sqrt(moved)


@njit(cache=True)
def augmented_anchors(coords, slaves, surface, projection, anchors, rests, law, new_anchors, slips):
    """Uzawa's update of friction: the anchors (16) that give sticking points a traction greater by eps_T times their slip.

    rests: like anchors, where the points last came to rest.  slips (np,) = |P(n) (x_M - x_rest)| of sticking points, what
    the penalty gave way [length], else 0.  The new anchors lie on the points' present facets; those of other points stay.
    """
    nodes, weights = new_anchors
    work = workspace(slaves[0].shape[1])
    vec, N, dN = work[0], work[3], work[4]
    for q in range(len(slips)):
        slips[q] = 0.0
        for i in range(4):
            nodes[q, i], weights[q, i] = anchors[0][q, i], anchors[1][q, i]
        if projection[1][q] == NONE or anchors[0][q, 0] < 0:
            continue
        g, _ = _place(q, coords, slaves, surface, projection, anchors, work)
        press = g + law[4][q]
        if point_traction(q, press, press, True, law, vec)[0] != STICK:
            continue
        trial0, trial1, trial2 = vec[TRIAL, 0], vec[TRIAL, 1], vec[TRIAL, 2]
        _place(q, coords, slaves, surface, projection, rests, work)
        along = vec[NORMAL, 0] * vec[W, 0] + vec[NORMAL, 1] * vec[W, 1] + vec[NORMAL, 2] * vec[W, 2]
        vec[TANGENTIAL, 0], vec[TANGENTIAL, 1], vec[TANGENTIAL, 2] = trial0, trial1, trial2
        for p in range(3):
            slip = vec[W, p] - along * vec[NORMAL, p]
            slips[q] += slip * slip
            vec[TANGENTIAL, p] += law[1][q] * slip
        slips[q] = math.sqrt(slips[q])
        for i in range(4):
            nodes[q, i], weights[q, i] = surface[0][projection[0][q], i], N[i]
        slide_anchor(q, vec, dN, law[1], weights[q])


@njit(cache=True)
def stiffened_anchors(coords, slaves, surface, projection, anchors, rests, law, factor, new_anchors):
    """The anchors that tangential penalties greater by `factor` need for points that slip on from rest as they do.

    rests: like anchors, places x_rest of the same traction under either penalty.  New anchors lie on the points' present
    facets and give T_T^tr + (factor - 1) eps_T P(n) (x_M - x_rest); those of points without friction stay.
    """
    nodes, weights = new_anchors
    work = workspace(slaves[0].shape[1])
    vec, N, dN = work[0], work[3], work[4]
    stiffer = law[1] * factor
    for q in range(len(nodes)):
        for i in range(4):
            nodes[q, i], weights[q, i] = anchors[0][q, i], anchors[1][q, i]
        if projection[1][q] == NONE or anchors[0][q, 0] < 0 or rests[0][q, 0] < 0:
            continue
        g, _ = _place(q, coords, slaves, surface, projection, anchors, work)
        press = g + law[4][q]
        status = point_traction(q, press, press, True, law, vec)[0]
        if status not in (STICK, SLIP):
            continue
        trial0, trial1, trial2 = vec[TRIAL, 0], vec[TRIAL, 1], vec[TRIAL, 2]
        _place(q, coords, slaves, surface, projection, rests, work)
        along = vec[NORMAL, 0] * vec[W, 0] + vec[NORMAL, 1] * vec[W, 1] + vec[NORMAL, 2] * vec[W, 2]
        vec[TANGENTIAL, 0], vec[TANGENTIAL, 1], vec[TANGENTIAL, 2] = trial0, trial1, trial2
        for p in range(3):
            vec[TANGENTIAL, p] += (factor - 1.0) * law[1][q] * (vec[W, p] - along * vec[NORMAL, p])
        for i in range(4):
            nodes[q, i], weights[q, i] = surface[0][projection[0][q], i], N[i]
        slide_anchor(q, vec, dN, stiffer, weights[q])
