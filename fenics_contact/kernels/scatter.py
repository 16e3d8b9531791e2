"""Addition of element forces and couplings into arrays of local dofs, three per node."""

import numpy as np
from numba import njit

from fenics_contact.kernels.vectors import of_three, row
from fenics_contact.types import Array, Floats, Ints, Ints64


@njit(cache=True)
def stays(nodes: Array, X: Floats, u: Floats, x: Floats) -> bool:
    """Whether nodes (ne, k), at first at X (ne, k, 3), are at x (ne, k, 3) by their displacements, of u (dofs,)."""
    for e in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            for c in range(3):
                if X[e, i, c] + u[3 * nodes[e, i] + c] != x[e, i, c]:
                    return False
    return True


@njit(cache=True)
def scatter_forces(nodes: Array, force: Floats, out: Floats) -> None:
    """out[3 node + c] += force[e, i, c]; nodes (ne, k), force (ne, k, 3), out (dofs,)."""
    for e in range(nodes.shape[0]):
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
def border_of_nodes(
    at: tuple[Floats, Floats], rates: tuple[Floats, Floats], spins: tuple[Floats, float], out: tuple[Floats, Floats, Floats]
) -> None:
    """Fill columns (n, 3, 6), rows (n, 6, 3) and corner (6, 6) of the couplings with a tool, see `tool_blocks`.

    at: (motions (n, 3, 6), forces (n, 3)); rates: (K B (n, 3, 6), B^T K (n, 6, 3)); spins: (rates (3, 3) of the spin with
    the tool's coordinates, lever), as of a Pose.
    """
    (motions, forces), (by_motion, of_wrench), (spin, lever), (columns, rows, corner) = at, rates, spins, out
    alone = np.empty((3, 6))  # a node's forces with travel and spin of the tool alone
    corner[:] = 0.0
    for i in range(len(motions)):
        f = row(forces, i)
        turned = (0.0, -f[2], f[1]), (f[2], 0.0, -f[0]), (-f[1], f[0], 0.0)
        for c in range(3):
            for d in range(3):
                alone[c, d], alone[c, d + 3] = -by_motion[i, c, d], -by_motion[i, c, d + 3] - turned[c][d]
                rows[i, c, d], rows[i, c + 3, d] = -of_wrench[i, c, d], (turned[c][d] - of_wrench[i, c + 3, d]) / lever
                corner[c + 3, d] -= turned[c][d]  # torques are about a point that travels too
        for c in range(3):
            w = of_three((alone[c, 3], alone[c, 4], alone[c, 5]), row(spin, 0), row(spin, 1), row(spin, 2))
            for d in range(3):
                columns[i, c, d], columns[i, c, d + 3] = alone[c, d], w[d]
            for a in range(6):
                for b in range(6):
                    corner[a, b] -= motions[i, c, a] * alone[c, b]
    corner[3:] /= lever
    for a in range(6):
        w = of_three((corner[a, 3], corner[a, 4], corner[a, 5]), row(spin, 0), row(spin, 1), row(spin, 2))
        corner[a, 3], corner[a, 4], corner[a, 5] = w


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
def motions_of_elements(K: Floats, motions: Floats, by_motion: Floats, of_wrench: Floats) -> None:
    """Fill K B (ne k, 3, 6) and B^T K (ne k, 6, 3) of elements K (ne, 3k, 3k) that share no nodes here.

    motions B (ne k, 3, 6): of the nodes of each element when the body that they are part of moves.
    """
    k = K.shape[1] // 3
    by_motion[:], of_wrench[:] = 0.0, 0.0
    for e in range(len(K)):
        for i in range(k):
            for j in range(k):
                for c in range(3):
                    for d in range(3):
                        rate = K[e, 3 * i + c, 3 * j + d]
                        for m in range(6):
                            by_motion[e * k + i, c, m] += rate * motions[e * k + j, d, m]
                            of_wrench[e * k + j, m, d] += rate * motions[e * k + i, c, m]


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
