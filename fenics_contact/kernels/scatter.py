"""Addition of element forces and couplings into arrays of local dofs, three per node."""

import numpy as np
from numba import njit

from fenics_contact.types import Array, Floats, Ints, Ints64


@njit(cache=True)
def scatter_forces(elements: Array, nodes: Array, force: Floats, out: Floats) -> None:
    """out[3 node + c] += force[e, i, c] over the listed elements; nodes (ne, k), force (ne, k, 3), out (dofs,)."""
    for e in elements:
        for i in range(nodes.shape[1]):
            for c in range(3):
                out[3 * nodes[e, i] + c] += force[e, i, c]


@njit(cache=True)
def scatter_border(nodes: Array, columns: Floats, rows: Floats, column: Floats, row: Floats) -> None:
    """Couplings of nodes (n,) with a tool: column[d, dof] += dR_dof/dq_d, row[d, dof] += dR_d/du_dof, (6, dofs).

    columns (n, 3, 6): rates of the nodes' forces with its coordinates; rows (n, 6, 3): of its wrench with the nodes.
    """
    for i in range(len(nodes)):
        for c in range(3):
            for d in range(6):
                column[d, 3 * nodes[i] + c] += columns[i, c, d]
                row[d, 3 * nodes[i] + c] += rows[i, d, c]


@njit(cache=True)
def motions_of_pairs(rows: Array, columns: Array, K: Floats, motions: Floats, by_motion: Floats, of_wrench: Floats) -> None:
    """by_motion (nodes, 3, 6) += K B and of_wrench (nodes, 6, 3) += B^T K of pairs of nodes with blocks K (n, 3, 3).

    motions B (nodes, 3, 6): of the nodes when the body that they are part of moves.
    """
    for pair in range(len(rows)):
        i, j = rows[pair], columns[pair]
        for c in range(3):
            for d in range(3):
                for m in range(6):
                    by_motion[i, c, m] += K[pair, c, d] * motions[j, d, m]
                    of_wrench[j, m, d] += motions[i, c, m] * K[pair, c, d]


@njit(cache=True)
def find_blocks(rows: Ints64, others: Ints64, offsets: Array, columns: Array) -> Ints:
    """Place (n, k, k) of each block of rows (n, k) with others (n, k) in a square matrix by rows, -1: it has no such block.

    OverflowError where the matrix has more blocks than int32 can count.
    """
    (n, k), size = rows.shape, len(offsets) - 1
    places, place_of = np.empty((n, k, k), dtype=np.int32), np.full(size, -1, dtype=np.int32)  # a column's, in the last row
    row = first = end = -1
    if len(columns) > 2**31 - 1:
        raise OverflowError
    for e in range(n):
        for i in range(k):
            if rows[e, i] != row:
                row, inside = rows[e, i], 0 <= rows[e, i] < size
                first, end = (offsets[row], offsets[row + 1]) if inside else (0, 0)
                for place in range(first, end):
                    place_of[columns[place]] = place
            for j in range(k):
                column = others[e, j]
                place = place_of[column] if 0 <= column < size else -1
                places[e, i, j] = place if first <= place < end else -1  # out of these bounds it is an earlier row's
    return places


@njit(cache=True, error_model="numpy")
def add_blocks(places: Ints, blocks: Floats, values: Floats) -> None:
    """Add blocks (n, k, k, 3, 3) to a matrix's values, by columns of blocks, flat, at places (n, k, k), -1: nowhere."""
    n, k = places.shape[:2]
    for e in range(n):
        for i in range(k):
            for j in range(k):
                if places[e, i, j] >= 0:
                    at = 9 * np.int64(places[e, i, j])
                    for c in range(3):
                        for d in range(3):
                            values[at + 3 * d + c] += blocks[e, i, j, c, d]
