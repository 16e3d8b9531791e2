"""How friction along two directions of a master that deforms turns with them: their part of the tangent of pairs.

A point's direction is a vector d = sum_j c_j x_j of the nodes of its master facet, which turns and shears with that from the
direction stated on the undeformed body. Arrays as in kernels/contact_pairs.py.
"""

from numba import njit

from fenics_contact.kernels.contact_pairs import judged_traction, presses
from fenics_contact.kernels.couplings import find
from fenics_contact.kernels.deformable_element import Pairs, PointLaws, place_apart
from fenics_contact.kernels.law import direction_rate
from fenics_contact.kernels.status import SLIP
from fenics_contact.kernels.vectors import Vector, norm, row
from fenics_contact.types import Bools, Floats, Ints64

Matrix = tuple[Ints64, Ints64, Ints64, Ints64, Floats, Bools]  # a Pattern, values (nb, 3, 3) and used (nb,) of its blocks
Parts = tuple[Ints64, Floats]  # nodes (np, l) of the points' directions and their parts c (np, l) in them


@njit(cache=True, error_model="numpy")
def add_turning_tangents(pairs: Pairs, law: PointLaws, parts: Parts, matrix: Matrix) -> int:
    """Add the derivative of the forces with the points' directions; returns the number of blocks that have no place in the
    matrix."""
    _, (nodes, weights, area, _), (corners, _), projection, anchors = pairs
    k, missing = nodes.shape[1], 0
    for q in range(len(nodes)):
        if not presses(q, projection, law):
            continue
        pair = place_apart(q, pairs)
        numbers, _, found = judged_traction(q, pair, law, anchors)
        length = norm(row(law[2].directions, q))
        if found.status != SLIP or length == 0.0:
            continue
        rates = direction_rate(numbers.friction, found.tangential, length)
        for i in range(k):
            missing += _add_row(nodes[q, i], area[q] * weights[q, i], rates, q, parts, matrix)
        for i in range(4):
            missing += _add_row(corners[projection[0][q], i], -area[q] * pair.N[i], rates, q, parts, matrix)
    return missing


@njit(cache=True)
def _add_row(node: int, share: float, rates: tuple[Vector, Vector, Vector], q: int, parts: Parts, matrix: Matrix) -> int:
    """A node's share in the force of point q; returns the number of blocks that are not in the pattern."""
    blocks, first, end, columns, values, used = matrix
    missing = 0
    for j in range(parts[0].shape[1]):
        part = share * parts[1][q, j]
        if part == 0.0:
            continue
        at = find(columns, first[node], end[node], blocks[parts[0][q, j]])
        if at < 0:
            missing += 1
            continue
        used[at] = True
        for a in range(3):
            for b in range(3):
                values[at, a, b] += part * rates[a][b]
    return missing
