"""The tangent of all pairs of slave points and master facets: exact derivative of the forces, in blocks of the matrix.

Arrays as in kernels/contact_pairs.py.  The points of one slave element that meet the same facet, and whose
anchors lie on the same one, share an element matrix: it goes into the pattern once for all of them.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.couplings import Pattern, equal_rows, felt_nodes, find
from fenics_contact.kernels.deformable_element import (
    DRAG,
    FIRST,
    JUMP,
    SECOND,
    Pair,
    Pairs,
    PointLaws,
    facet_corners,
    foot_rate,
    normal_rate,
    pair_of,
    traction_rate,
)
from fenics_contact.kernels.law import NO_RUBBING, Gaps, Law, partials, rubbing, traction
from fenics_contact.kernels.normals import tangents_at
from fenics_contact.kernels.ray_element import ray_rates
from fenics_contact.kernels.status import OPEN
from fenics_contact.kernels.vectors import ZERO, Four, Vector, of_nodes
from fenics_contact.types import Bools, Floats, Ints64

NO_WEIGHTS = (0.0, 0.0, 0.0, 0.0)


@njit(cache=True)
def add_tangents(pairs: Pairs, law: PointLaws, pattern: Pattern, out: tuple[Floats, Bools]) -> int:
    """Add the exact derivative of the forces, with the foot on the master following, to blocks of a matrix.  Pure.

    pattern: as in kernels/couplings.py; out = (values (nb, 3, 3), used (nb,)), which it marks.  With judged gaps the
    points press with these, which are then the pressures of a mixed method.  Returns the number of blocks
    that were not in the pattern.
    """
    coords, (slaves, weights, area, gradients), surface, projection, (held, held_weights) = pairs
    (corners, size), (facet, kind, feature, xi, gap, _), (points, k) = surface, projection, slaves.shape
    (eps_n, eps_t, friction, touch, shift, judged), tables, (values, used) = law, (slaves, corners, held), out
    nodes, matrix = np.empty(k + 8, np.int64), np.zeros((k + 4, 9 * (k + 8)))
    beta, dn, rates = np.zeros((2, 4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, 9))
    share, spread = np.zeros((4, k + 8)), np.zeros((3, 9 * (k + 8)))
    ray, done, missing = len(gradients) > 0, np.zeros(points, np.bool_), 0
    for q in range(points):
        done[q] = kind[q] == NONE or (judged[q] if len(judged) > 0 else gap[q] + shift[q]) > touch  # open
    for first in range(points):
        if done[first]:
            continue
        felt = felt_nodes(first, tables, facet, nodes)
        matrix[:] = 0.0
        pressed = False
        for q in range(first, points):
            if not equal_rows(slaves, first, q):
                break  # the points of an element come one after the other
            if done[q] or facet[q] != facet[first] or not equal_rows(held, first, q):
                continue
            done[q] = True
            f, anchored = facet[q], held[q, 0] >= 0
            t1, t2 = tangents_at(coords, slaves, q, gradients, q) if ray else (ZERO, ZERO)
            anchor = anchored, of_nodes(held_weights, q, held, coords) if anchored else ZERO
            at, x = (kind[q], size[f], xi[q, 0], xi[q, 1], gap[q]), of_nodes(weights, q, slaves, coords)
            pair = pair_of(at, facet_corners(coords, corners, f), x, anchor, (ray, t1, t2))
            g = judged[q] if len(judged) > 0 else pair.g + shift[q]
            rub, gaps = rubbing(friction, q, -eps_n[q] * g) if anchored else NO_RUBBING, Gaps(g, g)
            numbers = Law(eps_n[q], eps_t[q], rub, touch)
            found = traction(numbers, gaps, pair.n, pair.w)
            if found.status == OPEN:
                continue
            if ray:
                ray_rates(pair, beta, dn)
            else:
                foot_rate(kind[q], size[f], feature[q], pair, beta)
                normal_rate(kind[q], pair, beta, dn)
            by = partials(numbers, gaps, pair.n, pair.w, found)
            traction_rate(found.T, by, pair, beta, dn, rates)
            h0, h1, h2, h3 = held_weights[q, 0], held_weights[q, 1], held_weights[q, 2], held_weights[q, 3]
            _slave_shares(q, weights, gradients, pair, share)
            _shares(k, felt, pair, (h0, h1, h2, h3) if anchored else NO_WEIGHTS, share)
            _spread(area[q], felt, rates, share, spread)
            _add_point(q, weights, 9 * felt, pair, spread, matrix)
            pressed = True
        if pressed:
            missing += _insert(matrix, nodes, felt, pattern, values, used)
    return missing


@njit(cache=True)
def _put_four(table: Floats, i: int, first: int, scale: float, values: Four) -> None:
    for j in range(4):
        table[i, first + j] = scale * values[j]


@njit(cache=True)
def _slave_shares(q: int, weights: Floats, gradients: Floats, pair: Pair, share: Floats) -> None:
    """Fill share (4, k + 8) where it belongs to slave nodes, or to tangents: the parts of the nodes in the modes of q."""
    k = weights.shape[1]
    for i in range(k):
        share[JUMP, i] = weights[q, i]
    if len(gradients) > 0:
        for i in range(k):
            share[FIRST, i], share[SECOND, i] = gradients[q, 0, i], gradients[q, 1, i]
    else:
        _put_four(share, FIRST, k, 1.0, pair.N1)
        _put_four(share, SECOND, k, 1.0, pair.N2)


@njit(cache=True)
def _shares(k: int, felt: int, pair: Pair, anchor: Four, share: Floats) -> None:
    """Fill the rest of share (4, k + 8): of the facet's nodes, and the anchor's with weights (4,)."""
    _put_four(share, JUMP, k, -1.0, pair.N)
    _put_four(share, DRAG, k, 1.0, pair.N)
    for i in range(4):
        if felt > k + 4:
            share[DRAG, k + 4 + i] = -anchor[i]
        else:
            share[DRAG, k + i] -= anchor[i]


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
