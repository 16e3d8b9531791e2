"""Addition of element forces and couplings into arrays of local dofs, three per node."""

import numpy as np
from numba import njit

from fenics_contact.types import Array, Floats, Ints


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
def find_blocks(nodes: Ints, offsets: Array, columns: Array) -> Ints:
    """Place (ne, k, k) of the block of each two nodes of elements (ne, k) in a matrix by rows, whose columns rise in a row.

    KeyError where the matrix has no such block or more than int32 can count.
    """
    ne, k = nodes.shape
    places = np.empty((ne, k, k), dtype=np.int32)
    if len(columns) > 2**31 - 1:
        raise KeyError
    for e in range(ne):
        for i in range(k):
            first, end = offsets[nodes[e, i]], offsets[nodes[e, i] + 1]
            for j in range(k):
                low, high = first, end
                while low < high:
                    middle = (low + high) // 2
                    if columns[middle] < nodes[e, j]:
                        low = middle + 1
                    else:
                        high = middle
                if low == end or columns[low] != nodes[e, j]:
                    raise KeyError
                places[e, i, j] = low
    return places
