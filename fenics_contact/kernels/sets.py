"""Disjoint sets: which things hang together because some rows name them in one breath."""

from numba import njit

from fenics_contact.types import Ints64


@njit(cache=True)
def _root(parent: Ints64, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def join(rows: Ints64, parent: Ints64) -> None:
    """Unite the members of every row. rows (n, k) int64 < m; parent (m,) int64, arange at first, ends as the lowest member
    of each one's set."""
    for row in range(rows.shape[0]):
        a = _root(parent, rows[row, 0])
        for column in range(1, rows.shape[1]):
            b = _root(parent, rows[row, column])
            if b < a:
                parent[a], a = b, b
            elif a < b:
                parent[b] = a
    for i in range(len(parent)):
        parent[i] = _root(parent, i)
