"""Products with matrices of 3x3 blocks, which PETSc stores by columns: its own kernel takes two to four times as long."""

import numpy as np
from numba import njit

from fenics_contact.types import Array, Floats


@njit(cache=True, fastmath={"contract"})
def add_product(offsets: Array, columns: Array, blocks: Floats, x: Floats, y: Floats) -> None:
    """y += A x. offsets (rows + 1,), columns (n,): of the block rows; blocks (9 n,), in either precision; x, y: three
    entries per block.

    As fast as memory can be read: nine sums, none of which waits for another one, and indices that cannot be negative, which
    Numba would look for at each entry.
    """
    blocks, x, y = blocks.reshape(-1, 9), x.reshape(-1, 3), y.reshape(-1, 3)
    for i in range(len(offsets) - 1):
        a = b = c = d = e = f = g = h = m = 0.0
        for k in range(np.uint64(offsets[i]), np.uint64(offsets[i + 1])):
            block, part = blocks[k], x[np.uint64(columns[k])]
            u, v, w = part[0], part[1], part[2]
            a, b, c = a + block[0] * u, b + block[1] * u, c + block[2] * u
            d, e, f = d + block[3] * v, e + block[4] * v, f + block[5] * v
            g, h, m = g + block[6] * w, h + block[7] * w, m + block[8] * w
        y[i, 0] += a + d + g
        y[i, 1] += b + e + h
        y[i, 2] += c + f + m


@njit(cache=True, error_model="numpy")
def inverses(offsets: Array, columns: Array, blocks: Floats, out: Floats) -> None:
    """out (9 rows,): the inverse of every block on the diagonal, stored alike; not finite where it is singular."""
    for i in range(len(offsets) - 1):
        for k in range(offsets[i], offsets[i + 1]):
            if columns[k] != i:
                continue
            m, r = blocks[9 * k : 9 * k + 9], out[9 * i : 9 * i + 9]
            r[0], r[3], r[6] = m[4] * m[8] - m[7] * m[5], m[6] * m[5] - m[3] * m[8], m[3] * m[7] - m[6] * m[4]
            r[1], r[4], r[7] = m[7] * m[2] - m[1] * m[8], m[0] * m[8] - m[6] * m[2], m[6] * m[1] - m[0] * m[7]
            r[2], r[5], r[8] = m[1] * m[5] - m[4] * m[2], m[3] * m[2] - m[0] * m[5], m[0] * m[4] - m[3] * m[1]
            det = m[0] * r[0] + m[3] * r[1] + m[6] * r[2]
            for entry in range(9):
                r[entry] /= det


@njit(cache=True)
def diagonal_product(blocks: Floats, x: Floats, y: Floats) -> None:
    """y = D x with the blocks (9 rows,) of D on the diagonal."""
    blocks, x, y = blocks.reshape(-1, 9), x.reshape(-1, 3), y.reshape(-1, 3)
    for i in range(len(blocks)):
        block, part = blocks[i], x[i]
        u, v, w = part[0], part[1], part[2]
        y[i, 0] = block[0] * u + block[3] * v + block[6] * w
        y[i, 1] = block[1] * u + block[4] * v + block[7] * w
        y[i, 2] = block[2] * u + block[5] * v + block[8] * w
