"""The tangent of all pairs of slave points and master facets: exact derivative of the forces, in blocks of the matrix.

Arrays as in kernels/contact_pairs.py.  The points of one slave element that meet the same facet, and whose
anchors lie on the same one, share an element matrix: it goes into the pattern once for all of them.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.contact_pairs import judged_traction, presses
from fenics_contact.kernels.couplings import Pattern, equal_rows, felt_nodes, find
from fenics_contact.kernels.deformable_element import (
    DRAG,
    FIRST,
    JUMP,
    SECOND,
    Anchors,
    Pair,
    Pairs,
    PointLaws,
    Slaves,
    foot_rate,
    normal_rate,
    place,
    traction_rate,
)
from fenics_contact.kernels.law import partials
from fenics_contact.kernels.ray_element import ray_rates
from fenics_contact.kernels.status import OPEN
from fenics_contact.kernels.vectors import Four, Vector
from fenics_contact.types import Bools, Floats, Ints64


@njit(cache=True)
def add_tangents(pairs: Pairs, law: PointLaws, pattern: Pattern, out: tuple[Floats, Bools]) -> int:
    """Add the exact derivative of the forces, with the foot on the master following, to blocks of a matrix.  Pure.

    pattern: as in kernels/couplings.py; out = (values (nb, 3, 3), used (nb,)), which it marks.  With judged gaps the
    points press with these, which are then the pressures of a mixed method.  Returns the number of blocks
    that were not in the pattern.
    """
    _, slaves, surface, projection, anchors = pairs
    points, k = slaves[0].shape
    tables, facet, kind, feature = (slaves[0], surface[0], anchors[0]), projection[0], projection[1], projection[2]
    nodes, matrix = np.empty(k + 8, np.int64), np.zeros((k + 4, 9 * (k + 8)))
    beta, dn, rates = np.zeros((2, 4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, 9))
    share, spread = np.zeros((4, k + 8)), np.zeros((3, 9 * (k + 8)))
    ray, done, missing = len(slaves[3]) > 0, np.zeros(points, np.bool_), 0
    for first in range(points):
        if done[first] or not presses(first, projection, law):
            continue
        felt = felt_nodes(first, tables, facet, nodes)
        matrix[:] = 0.0
        pressed = False
        for q in range(first, points):
            if not equal_rows(slaves[0], first, q):
                break  # the points of an element come one after the other
            same = facet[q] == facet[first] and equal_rows(anchors[0], first, q)
            if done[q] or not same or not presses(q, projection, law):
                continue
            done[q] = True
            pair = place(q, pairs)
            numbers, gaps, found = judged_traction(q, pair, law, anchors)
            if found.status == OPEN:
                continue
            if ray:
                ray_rates(pair, beta, dn)
            else:
                foot_rate(kind[q], surface[1][facet[q]], feature[q], pair, beta)
                normal_rate(kind[q], pair, beta, dn)
            by = partials(numbers, gaps, pair.n, pair.w, found)
            traction_rate(found.T, by, pair, beta, dn, rates)
            _shares(q, slaves, anchors, felt, pair, share)
            _spread(slaves[2][q], felt, rates, share, spread)
            _add_point(q, slaves[1], 9 * felt, pair, spread, matrix)
            pressed = True
        if pressed:
            missing += _insert(matrix, nodes, felt, pattern, out[0], out[1])
    return missing


@njit(cache=True)
def _put_four(table: Floats, i: int, first: int, scale: float, values: Four) -> None:
    for j in range(4):
        table[i, first + j] = scale * values[j]


@njit(cache=True)
def _shares(q: int, slaves: Slaves, anchors: Anchors, felt: int, pair: Pair, share: Floats) -> None:
    """Fill share (4, k + 8): the parts of the nodes in the modes of point q."""
    (_, weights, _, gradients), (anchor_nodes, anchor_weights) = slaves, anchors
    k, has_anchor = weights.shape[1], anchor_nodes[q, 0] >= 0
    _put_four(share, JUMP, k, -1.0, pair.N)
    _put_four(share, DRAG, k, 1.0, pair.N)
    for i in range(k):
        share[JUMP, i] = weights[q, i]
    if len(gradients) > 0:
        for i in range(k):
            share[FIRST, i], share[SECOND, i] = gradients[q, 0, i], gradients[q, 1, i]
    else:
        _put_four(share, FIRST, k, 1.0, pair.N1)
        _put_four(share, SECOND, k, 1.0, pair.N2)
    for i in range(4):
        anchor = anchor_weights[q, i] if has_anchor else 0.0
        if felt > k + 4:
            share[DRAG, k + 4 + i] = -anchor
        else:
            share[DRAG, k + i] -= anchor


@njit(cache=True)
def _spread(area: float, felt: int, rates: Floats, share: Floats, spread: Floats) -> None:
    """Fill spread (3, 9 felt): rates of T, T xi^1 and T xi^2 against the motion of the nodes, 3 x 3 each, times the area."""
    for j in range(felt):
        jump, one, two, drag = area * share[JUMP, j], area * share[FIRST, j], area * share[SECOND, j], area * share[DRAG, j]
        for part in range(3):
            for c in range(9):
                spread[part, 9 * j + c] = (
                    jump * rates[JUMP, part, c] + one * rates[FIRST, part, c] + two * rates[SECOND, part, c]
                ) + drag * rates[DRAG, part, c]


@njit(cache=True)
def _add_point(q: int, weights: Floats, width: int, pair: Pair, spread: Floats, matrix: Floats) -> None:
    """Add the rates of the forces on k slave nodes and on the facet's nodes to the element's matrix (k + 4, 9 felt)."""
    k = weights.shape[1]
    for i in range(k):
        for c in range(width):
            matrix[i, c] += weights[q, i] * spread[0, c]
    _add_row(k, width, (pair.N[0], pair.N1[0], pair.N2[0]), spread, matrix)
    _add_row(k + 1, width, (pair.N[1], pair.N1[1], pair.N2[1]), spread, matrix)
    _add_row(k + 2, width, (pair.N[2], pair.N1[2], pair.N2[2]), spread, matrix)
    _add_row(k + 3, width, (pair.N[3], pair.N1[3], pair.N2[3]), spread, matrix)


@njit(cache=True)
def _add_row(row: int, width: int, shape: Vector, spread: Floats, matrix: Floats) -> None:
    """The forces on a node of the facet, on which x_M moves; shape: N, N_,1 and N_,2 of the node."""
    N, N1, N2 = shape
    for c in range(width):
        matrix[row, c] -= N * spread[0, c] + N1 * spread[1, c] + N2 * spread[2, c]


@njit(cache=True)
def _insert(matrix: Floats, nodes: Ints64, felt: int, pattern: Pattern, values: Floats, used: Bools) -> int:
    """Add an element's matrix to the blocks of the pattern; returns how many of them are not in it."""
    blocks, first, end, columns = pattern
    missing = 0
    for i in range(matrix.shape[0]):
        row = nodes[i]
        for j in range(felt):
            at = find(columns, first[row], end[row], blocks[nodes[j]])
            if at < 0:
                missing += 1
                continue
            used[at] = True
            for a in range(3):
                for b in range(3):
                    values[at, a, b] += matrix[i, 9 * j + 3 * a + b]
    return missing
