"""The tangent of all pairs of slave points and master facets: exact derivative of the forces, in blocks of the matrix.

Arrays as in kernels/contact_pairs.py.  The points of one slave element that meet the same facet, and whose
anchors lie on the same one, share an element matrix: it goes into the pattern once for all of them.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.contact_pairs import deciding_gap, presses
from fenics_contact.kernels.couplings import equal_rows, felt_nodes, find
from fenics_contact.kernels.deformable_element import (
    DRAG,
    FIRST,
    JUMP,
    SECOND,
    foot_rate,
    normal_rate,
    place,
    point_traction,
    traction_rate,
)
from fenics_contact.kernels.ray_element import ray_rates
from fenics_contact.kernels.status import OPEN
from fenics_contact.kernels.vectors import dot


@njit(cache=True)
def add_tangents(coords, slaves, surface, projection, anchors, law, judged, pattern, values, used):
    """Add the exact derivative of the forces, with the foot on the master following, to blocks values (nb, 3, 3).  Pure.

    pattern: as in kernels/couplings.py.  Marks used (nb,).  With judged gaps the points press with these, which are
    then the pressures of a mixed method.  Returns the number of blocks that were not in the pattern.
    """
    points, k = slaves[0].shape
    nodes, matrix = np.empty(k + 8, np.int64), np.zeros((3 * (k + 4), 3 * (k + 8)))
    rates = np.zeros((2, 4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, 3))
    share, Q = np.zeros((4, k + 8)), np.zeros((5, 3 * (k + 8)))
    done, missing = np.zeros(points, np.bool_), 0
    for first in range(points):
        if done[first] or not presses(first, projection, law, judged):
            continue
        felt = felt_nodes(first, slaves[0], surface[0], projection[0], anchors[0], nodes)
        matrix[:] = 0.0
        pressed = False
        for q in range(first, points):
            if not equal_rows(slaves[0], first, q):
                break  # the points of an element come one after the other
            same = projection[0][q] == projection[0][first] and equal_rows(anchors[0], first, q)
            if done[q] or not same or not presses(q, projection, law, judged):
                continue
            done[q] = True
            pair, traction = _point_rates(q, coords, slaves, surface, projection, anchors, law, judged, felt, rates, share)
            if traction.status != OPEN:
                _spread(slaves[2][q], felt, rates, share, Q)
                _add_point(q, slaves[1], 3 * felt, pair, traction.T, Q, matrix)
                pressed = True
        if pressed:
            missing += _insert(matrix, nodes, felt, pattern, values, used)
    return missing


@njit(cache=True)
def _put_four(table, i, first, scale, values):
    for j in range(4):
        table[i, first + j] = scale * values[j]


@njit(cache=True, error_model="numpy")
def _point_rates(q, coords, slaves, surface, projection, anchors, law, judged, felt, rates, share):
    """Fill rates = (beta, dn, dT) and share (4, k + 8) of point q; returns its Pair and Traction."""
    (beta, dn, _), gradients, k = rates, slaves[3], slaves[0].shape[1]
    pair, has_anchor = place(q, coords, slaves, surface, projection, anchors), anchors[0][q, 0] >= 0
    decides = deciding_gap(q, projection, law, judged) if len(judged) > 0 else pair.g + law[4][q]
    traction = point_traction(q, decides, decides, has_anchor, law, pair)
    if traction.status == OPEN:
        return pair, traction
    lean1 = lean2 = 0.0
    _put_four(share, JUMP, k, -1.0, pair.N)
    _put_four(share, DRAG, k, 1.0, pair.N)
    for i in range(k):
        share[JUMP, i] = slaves[1][q, i]
    if len(gradients) > 0:
        lean1, lean2 = dot(pair.n, pair.r1), dot(pair.n, pair.r2)
        ray_rates(pair, beta, dn)
        for i in range(k):
            share[FIRST, i], share[SECOND, i] = gradients[q, 0, i], gradients[q, 1, i]
    else:
        kind = projection[1][q]
        foot_rate(kind, surface[1][projection[0][q]], projection[2][q], pair, beta)
        normal_rate(kind, pair, beta, dn)
        _put_four(share, FIRST, k, 1.0, pair.N1)
        _put_four(share, SECOND, k, 1.0, pair.N2)
    for i in range(4):
        anchor = anchors[1][q, i] if has_anchor else 0.0
        if felt > k + 4:
            share[DRAG, k + 4 + i] = -anchor
        else:
            share[DRAG, k + i] -= anchor
    traction_rate(q, traction, law, lean1, lean2, pair, rates)
    return pair, traction


@njit(cache=True)
def _spread(area, felt, rates, share, Q):
    """Fill Q (5, 3 felt): rates of T (3 rows) and of xi (2 rows) against the motion of the nodes, times the area."""
    beta, _, dT = rates
    for j in range(felt):
        jump, one, two, drag = area * share[JUMP, j], area * share[FIRST, j], area * share[SECOND, j], area * share[DRAG, j]
        for b in range(3):
            for a in range(3):
                Q[a, 3 * j + b] = (
                    jump * dT[JUMP, a, b] + one * dT[FIRST, a, b] + two * dT[SECOND, a, b] + drag * dT[DRAG, a, b]
                )
            for a in range(2):
                Q[3 + a, 3 * j + b] = jump * beta[a, JUMP, b] + one * beta[a, FIRST, b] + two * beta[a, SECOND, b]


@njit(cache=True)
def _add_point(q, weights, width, pair, T, Q, matrix):
    """Add the rates of the forces on k slave nodes and on the facet's nodes to the element's matrix."""
    k = weights.shape[1]
    for i in range(k):
        for a in range(3):
            for j in range(width):
                matrix[3 * i + a, j] += weights[q, i] * Q[a, j]
    _add_rows(3 * k, width, pair.N[0], pair.N1[0], pair.N2[0], T, Q, matrix)
    _add_rows(3 * k + 3, width, pair.N[1], pair.N1[1], pair.N2[1], T, Q, matrix)
    _add_rows(3 * k + 6, width, pair.N[2], pair.N1[2], pair.N2[2], T, Q, matrix)
    _add_rows(3 * k + 9, width, pair.N[3], pair.N1[3], pair.N2[3], T, Q, matrix)


@njit(cache=True)
def _add_rows(row, width, N, N1, N2, T, Q, matrix):
    """The rows of a node of the facet, on which x_M moves."""
    for j in range(width):
        moved = N1 * Q[3, j] + N2 * Q[4, j]
        matrix[row, j] -= N * Q[0, j] + T[0] * moved
        matrix[row + 1, j] -= N * Q[1, j] + T[1] * moved
        matrix[row + 2, j] -= N * Q[2, j] + T[2] * moved


@njit(cache=True)
def _insert(matrix, nodes, felt, pattern, values, used):
    """Add an element's matrix to the blocks of the pattern; returns how many of them are not in it."""
    blocks, first, end, columns = pattern
    missing = 0
    for i in range(matrix.shape[0] // 3):
        row = nodes[i]
        for j in range(felt):
            at = find(columns, first[row], end[row], blocks[nodes[j]])
            if at < 0:
                missing += 1
                continue
            used[at] = True
            for a in range(3):
                for b in range(3):
                    values[at, a, b] += matrix[3 * i + a, 3 * j + b]
    return missing
