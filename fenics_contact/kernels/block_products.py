"""Products with matrices of 3x3 blocks, which PETSc stores by columns: its own kernel takes two to four times as long."""

from typing import Any, TypeAlias

import numpy as np
from numba import njit

from fenics_contact.kernels.vectors import Vector
from fenics_contact.types import Array, Floats, Ints64

Count: TypeAlias = Any  # np.uint64
BlockRows = tuple[Array, Array, Array]  # offsets, columns, blocks by columns, flat
Products = tuple[Floats, Floats]  # U x (3 rows,) and L x (3 rows,), what lies above and below the diagonal


@njit(cache=True)
def add_product(offsets: Array, columns: Array, blocks: Array, x: Floats, y: Floats) -> None:
    """y += A x. offsets (rows + 1,), columns (n,): of the block rows; blocks (9 n,), in either precision; x, y: three
    entries per block.

    As fast as memory can be read: nine sums, none of which waits for another one, and indices that cannot be negative, which
    Numba would look for at each entry.
    """
    blocks, x, y = blocks.reshape(-1, 9), x.reshape(-1, 3), y.reshape(-1, 3)
    for i in range(len(offsets) - 1):
        first = np.uint64(offsets[i])
        u, v, w = _rightwards(first, np.uint64(offsets[i + 1]) - first, columns, blocks, x)
        y[i, 0] += u
        y[i, 1] += v
        y[i, 2] += w


@njit(cache=True)
def diagonals(offsets: Array, columns: Array, out: Array) -> None:
    """out (rows,): where the block on the diagonal of each row stands among the blocks, whose columns rise."""
    for i in range(len(out)):
        k = offsets[i]
        while columns[k] < i:
            k += 1
        out[i] = k


@njit(cache=True, error_model="numpy")
def inverses(diagonal: Array, blocks: Floats, out: Floats) -> None:
    """out (9 rows,): the inverses of the blocks at these places, stored alike; not finite where one is singular."""
    for i, k in enumerate(diagonal):
        m, r = blocks[9 * k : 9 * k + 9], out[9 * i : 9 * i + 9]
        r[0], r[3], r[6] = m[4] * m[8] - m[7] * m[5], m[6] * m[5] - m[3] * m[8], m[3] * m[7] - m[6] * m[4]
        r[1], r[4], r[7] = m[7] * m[2] - m[1] * m[8], m[0] * m[8] - m[6] * m[2], m[6] * m[1] - m[0] * m[7]
        r[2], r[5], r[8] = m[1] * m[5] - m[4] * m[2], m[3] * m[2] - m[0] * m[5], m[0] * m[4] - m[3] * m[1]
        det = m[0] * r[0] + m[3] * r[1] + m[6] * r[2]
        for entry in range(9):
            r[entry] /= det


@njit(cache=True)
def earlier(offsets: Array, columns: Array, place: Ints64, out: Array) -> None:
    """out (rows,): how many columns of each row come before it in an order; place (rows,): where in it each row is."""
    for i in range(len(out)):
        out[i] = 0
        for k in range(offsets[i], offsets[i + 1]):
            out[i] += place[columns[k]] < place[i]


@njit(cache=True)
def split(rows: BlockRows, place: Ints64, lower: BlockRows, upper: BlockRows) -> None:
    """Fill `lower` with the blocks of each row that come before it in an order, its own last, `upper` with those behind it,
    their offsets at hand.

    Apart, for a sweep that reads half of each row has the processor fetch all of it.
    """
    (offsets, columns, blocks), (low, low_columns, low_blocks), (high, high_columns, high_blocks) = rows, lower, upper
    for i in range(len(place)):
        a, b = low[i], high[i]
        for k in range(offsets[i], offsets[i + 1]):
            j = columns[k]
            if place[j] > place[i]:
                high_columns[b] = j
                for entry in range(9):
                    high_blocks[9 * b + entry] = blocks[9 * k + entry]
                b += 1
                continue
            at = low[i + 1] - 1 if j == i else a
            low_columns[at] = j
            for entry in range(9):
                low_blocks[9 * at + entry] = blocks[9 * k + entry]
            a += j != i


@njit(cache=True)
def less_others(others: BlockRows, beyond: Floats, rows: Ints64, b: Floats, out: Floats) -> None:
    """out = b - B x in some rows; others: B, the columns that other processes own; beyond: their entries of x."""
    offsets, columns, blocks = others
    blocks, x, b, out = blocks.reshape(-1, 9), beyond.reshape(-1, 3), b.reshape(-1, 3), out.reshape(-1, 3)
    for i in rows:
        first = np.uint64(offsets[i])
        u, v, w = _rightwards(first, np.uint64(offsets[i + 1]) - first, columns, blocks, x)
        out[i, 0], out[i, 1], out[i, 2] = b[i, 0] - u, b[i, 1] - v, b[i, 2] - w


@njit(cache=True)
def sweep_down(lower: BlockRows, inverse: Floats, rows: Ints64, b: Floats, x: Floats, products: Products) -> None:
    """Gauss-Seidel over rows in their order: x_i = D_i^-1 (b_i - (L x)_i - (U x)_i), with the U x of products; fills L x.

    lower: the blocks before each row and its own; inverse (9 n,): of these. As U x is known from the sweep before, and L x
    is for the next one, a sweep reads half the matrix (Conrad & Wallach 1979, doi:10.1007/BF01399555).
    """
    (offsets, columns, blocks), (above, below) = lower, products
    blocks, x, b = blocks.reshape(-1, 9), x.reshape(-1, 3), b.reshape(-1, 3)
    inverse, above, below = inverse.reshape(-1, 9), above.reshape(-1, 3), below.reshape(-1, 3)
    for i in rows:
        first = np.uint64(offsets[i])
        u, v, w = _rightwards(first, np.uint64(offsets[i + 1] - 1) - first, columns, blocks, x)
        below[i, 0], below[i, 1], below[i, 2] = u, v, w
        u, v, w = b[i, 0] - u - above[i, 0], b[i, 1] - v - above[i, 1], b[i, 2] - w - above[i, 2]
        x[i, 0], x[i, 1], x[i, 2] = _times(inverse[i], u, v, w)


@njit(cache=True)
def sweep_up(upper: BlockRows, inverse: Floats, rows: Ints64, b: Floats, x: Floats, products: Products) -> None:
    """The sweep back, as `sweep_down`, with the L x of products; fills U x; upper: the blocks behind each row."""
    (offsets, columns, blocks), (above, below) = upper, products
    blocks, x, b = blocks.reshape(-1, 9), x.reshape(-1, 3), b.reshape(-1, 3)
    inverse, above, below = inverse.reshape(-1, 9), above.reshape(-1, 3), below.reshape(-1, 3)
    for i in rows[::-1]:
        last = np.uint64(offsets[i + 1])
        u, v, w = _leftwards(last, last - np.uint64(offsets[i]), columns, blocks, x)
        above[i, 0], above[i, 1], above[i, 2] = u, v, w
        u, v, w = b[i, 0] - below[i, 0] - u, b[i, 1] - below[i, 1] - v, b[i, 2] - below[i, 2] - w
        x[i, 0], x[i, 1], x[i, 2] = _times(inverse[i], u, v, w)


@njit(cache=True, fastmath={"contract"})
def _rightwards(first: Count, count: Count, columns: Array, blocks: Floats, x: Floats) -> Vector:
    """The sum of so many blocks times their parts of x, from a place on."""
    a = b = c = d = e = f = g = h = m = 0.0
    for k in range(first, first + count):
        block, part = blocks[k], x[np.uint64(columns[k])]
        u, v, w = part[0], part[1], part[2]
        a, b, c = a + block[0] * u, b + block[1] * u, c + block[2] * u
        d, e, f = d + block[3] * v, e + block[4] * v, f + block[5] * v
        g, h, m = g + block[6] * w, h + block[7] * w, m + block[8] * w
    return a + d + g, b + e + h, c + f + m


@njit(cache=True, fastmath={"contract"})
def _leftwards(last: Count, count: Count, columns: Array, blocks: Floats, x: Floats) -> Vector:
    """The same sum backwards, of the blocks before a place: in a sweep up the latest x comes last, and nothing waits."""
    a = b = c = d = e = f = g = h = m = 0.0
    for back in range(np.uint64(1), count + np.uint64(1)):
        k = last - back
        block, part = blocks[k], x[np.uint64(columns[k])]
        u, v, w = part[0], part[1], part[2]
        a, b, c = a + block[0] * u, b + block[1] * u, c + block[2] * u
        d, e, f = d + block[3] * v, e + block[4] * v, f + block[5] * v
        g, h, m = g + block[6] * w, h + block[7] * w, m + block[8] * w
    return a + d + g, b + e + h, c + f + m


@njit(cache=True)
def _times(block: Floats, u: float, v: float, w: float) -> Vector:
    """A block (9,) by columns times a vector."""
    return (
        block[0] * u + block[3] * v + block[6] * w,
        block[1] * u + block[4] * v + block[7] * w,
        block[2] * u + block[5] * v + block[8] * w,
    )
