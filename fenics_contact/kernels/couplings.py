"""Pairs of nodes that contact pairs couple: those of one pair, all that points may need soon, and their places in a pattern.

Arrays as in kernels/deformable_element.py.  A pattern is (blocks (nx,): global number of each node, first (nx,), end (nx,):
where its row begins and ends in columns (nb,), rising global numbers).  Tables are (nodes (np, k) of the slave points,
(nf, l) of the master's facets, (np, m) of the points' anchors; -1 in an anchor's first: it has none).
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import Lists
from fenics_contact.types import Bools, Ints64

Pattern = tuple[Ints64, Ints64, Ints64, Ints64]  # blocks, first, end, columns
Tables = tuple[Ints64, Ints64, Ints64]


@njit(cache=True)
def equal_rows(table: Ints64, i: int, j: int) -> bool:
    """True if rows i and j of a table (n, k) are the same."""
    same = True
    for column in range(table.shape[1]):
        same = same and table[i, column] == table[j, column]
    return same


@njit(cache=True)
def felt_nodes(q: int, tables: Tables, facet: Ints64, nodes: Ints64) -> int:
    """Fill nodes (k + 8,) of pair q, on facet (np,); returns how many of them T depends on: on its own facet an anchor adds
    none."""
    slave_nodes, corners, anchor_nodes = tables
    k = slave_nodes.shape[1]
    at_home, has_anchor = True, anchor_nodes[q, 0] >= 0
    for i in range(k):
        nodes[i] = slave_nodes[q, i]
    for i in range(4):
        nodes[k + i] = corners[facet[q], i]
        nodes[k + 4 + i] = anchor_nodes[q, i] if has_anchor else nodes[k + i]
        at_home = at_home and nodes[k + 4 + i] == nodes[k + i]
    return k + 4 if at_home else k + 8


@njit(cache=True)
def find(columns: Ints64, low: int, high: int, wanted: int) -> int:
    """Place of `wanted` in the rising columns[low:high], or -1."""
    n = high - low
    while n > 1:  # without branches, which nothing could foresee
        half = n // 2
        low += half * (columns[low + half - 1] < wanted)
        n -= half
    return low if n == 1 and columns[low] == wanted else -1


@njit(cache=True)
def newly_met(closed: Bools, facet: Ints64, anchor_nodes: Ints64, met: Ints64, met_anchors: Ints64) -> Bools:
    """True for each closed point (np,) whose facet or anchor is not the one taken down in met (np,), met_anchors (np, m)."""
    new = np.zeros(len(closed), np.bool_)
    for q in range(len(closed)):
        if closed[q]:
            new[q] = facet[q] != met[q]
            for i in range(anchor_nodes.shape[1]):
                new[q] = new[q] or anchor_nodes[q, i] != met_anchors[q, i]
    return new


@njit(cache=True)
def lacks(asked: Bools, tables: Tables, facet: Ints64, pattern: Pattern) -> bool:
    """True if the pattern lacks couplings of the pairs of points, each on its facet (np,), that are asked for (np,)."""
    blocks, first, end, columns = pattern
    k = tables[0].shape[1]
    nodes = np.empty(k + 8, np.int64)
    for q in range(len(asked)):
        if not asked[q]:
            continue
        felt = felt_nodes(q, tables, facet, nodes)
        for i in range(k + 4):
            for j in range(felt):
                if find(columns, first[nodes[i]], end[nodes[i]], blocks[nodes[j]]) < 0:
                    return True
    return False


@njit(cache=True)
def coupled_pairs(lists: Lists, tables: Tables, rows: Ints64, columns: Ints64) -> int:
    """Write all pairs among the nodes of each slave point, its anchor and the facets listed for it (CSR); returns how many.

    Points without a facet count for nothing. Each pair comes once per slave element, whose points follow one another.
    Called twice: with no place in rows (n,), columns (n,) it only counts.
    """
    slave_nodes, corners, _ = tables
    points, first = len(slave_nodes), 0
    count = 1 + max(slave_nodes.max(), corners.max())
    number, known, local, at = np.empty(count, np.int64), np.full(count, -1), np.empty(count, np.int64), 0
    here, seen, together = np.empty(count, np.int64), np.full(count, -1), np.empty((0, 0), np.bool_)
    while first < points:
        end, n = first, 0
        while end < points and equal_rows(slave_nodes, first, end):
            for i in here[: _nodes_of(end, lists, tables, here, seen, 2 * end)]:
                if known[i] != first:
                    known[i], number[i], local[n] = first, n, i
                    n += 1
            end += 1
        if len(together) < n:
            together = np.empty((2 * n, 2 * n), np.bool_)
        together[:n, :n] = False
        for q in range(first, end):
            m = _nodes_of(q, lists, tables, here, seen, 2 * q + 1)
            for i in range(m):
                here[i] = number[here[i]]
            for i in here[:m]:
                for j in here[:m]:
                    together[i, j] = True
        for i in range(n):
            for j in range(n):
                if together[i, j]:
                    if len(rows) > 0:
                        rows[at], columns[at] = local[i], local[j]
                    at += 1
        first = end
    return at


@njit(cache=True)
def _nodes_of(q: int, lists: Lists, tables: Tables, nodes: Ints64, seen: Ints64, stamp: int) -> int:
    """Write the nodes of point q, each once, none if no facet is listed; returns how many. seen (count,) is scratch."""
    (offsets, listed), (slave_nodes, corners, anchor_nodes), n = lists, tables, 0
    for at in range(offsets[q], offsets[q + 1]):
        n = _join(corners, listed[at], nodes, n, seen, stamp)
    if n > 0:
        n = _join(slave_nodes, q, nodes, n, seen, stamp)
        if anchor_nodes[q, 0] >= 0:
            n = _join(anchor_nodes, q, nodes, n, seen, stamp)
    return n


@njit(cache=True)
def _join(table: Ints64, row: int, nodes: Ints64, n: int, seen: Ints64, stamp: int) -> int:
    for i in range(table.shape[1]):
        node = table[row, i]
        if node >= 0 and seen[node] != stamp:
            seen[node], nodes[n] = stamp, node
            n += 1
    return n


@njit(cache=True)
def unique_pairs(rows: Ints64, columns: Ints64, count: int) -> tuple[Ints64, Ints64]:
    """The pairs (rows (n,), columns (n,)) of nodes below count, each once, rows rising."""
    start, order = np.zeros(count + 1, np.int64), np.empty(len(rows), np.int64)
    for i in rows:
        start[i + 1] += 1
    for i in range(count):
        start[i + 1] += start[i]
    place = start[:-1].copy()
    for n in range(len(rows)):
        order[place[rows[n]]] = columns[n]
        place[rows[n]] += 1
    seen, kept, row_of = np.full(count, -1), 0, np.empty(len(rows), np.int64)
    for i in range(count):
        for n in range(start[i], start[i + 1]):
            column = order[n]
            if seen[column] != i:
                seen[column] = i
                order[kept], row_of[kept] = column, i
                kept += 1
    return row_of[:kept], order[:kept]


@njit(cache=True)
def lists_lack(asked: Bools, slaves: Ints64, masters: Ints64, anchors: Ints64, pattern: Pattern) -> bool:
    """True if the pattern has not all couplings of the nodes listed in each row that is asked for (n,), -1: none there.

    Rows of the matrix are those of slaves (n, k) and masters (n, l), columns also those of anchors (n, m).
    """
    blocks, first, end, columns = pattern
    nodes, seen = np.empty(len(blocks), np.int64), np.full(len(blocks), -1)
    for q in range(len(asked)):
        if not asked[q]:
            continue
        n = _join(slaves, q, nodes, 0, seen, q)
        height = _join(masters, q, nodes, n, seen, q)
        n = _join(anchors, q, nodes, height, seen, q)
        for i in range(height):
            for j in range(n):
                if find(columns, first[nodes[i]], end[nodes[i]], blocks[nodes[j]]) < 0:
                    return True
    return False
