"""Which facets may lie near which points: a hashed uniform grid of the facets' enlarged boxes.

The grid keeps only cells that a box touches, so memory and time grow with the number of facets, not with the
volume they enclose.
"""

import numpy as np
from numba import njit

from fenics_contact.types import Floats, Ints64

# Boxes may enter this many cells on average before the cells are doubled: a few large facets among many small
# ones then cost some longer lists, not an explosion of entries.  Cubes of mean box size enter 8 at most.
MAX_CELLS_PER_FACET = 16
# Cell numbers are clipped here so that far points cannot overflow an integer; clipped cells hold no box.
MAX_CELL = 1 << 40

Boxes = tuple[Floats, Floats]  # low, high (n, 3)
Grid = tuple[Floats, float, int, Ints64, Ints64, Ints64]  # origin, cell size, mask, start, cells, facets of `_fill_grid`


@njit(cache=True)
def facet_boxes(x: Floats, nodes: Ints64, size: Ints64, margin: float, low: Floats, high: Floats) -> None:
    """Fill low, high (n, 3): each facet's bounding box, enlarged by margin on all sides."""
    for f in range(nodes.shape[0]):
        for p in range(3):
            a = x[nodes[f, 0], p]
            b = a
            for i in range(1, size[f]):
                a = min(a, x[nodes[f, i], p])
                b = max(b, x[nodes[f, i], p])
            low[f, p] = a - margin
            high[f, p] = b + margin


@njit(cache=True)
def _cell(value: float, origin: float, h: float) -> int:
    cell = np.floor((value - origin) / h)
    return int(min(max(cell, -1.0 * MAX_CELL), 1.0 * MAX_CELL))


@njit(cache=True)
def _bucket(i: int, j: int, k: int, mask: int) -> int:
    # the primes of Teschner et al. 2003 (Optimized spatial hashing); the shift brings high bits down
    key = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791)
    return (key ^ (key >> 15)) & mask


@njit(cache=True)
def _entries(low: Floats, high: Floats, origin: Floats, h: float) -> float:
    """Number of (box, cell) pairs as a float: it may be too large for an integer before h has grown."""
    total = 0.0
    for f in range(low.shape[0]):
        n = 1.0
        for p in range(3):
            n *= np.floor((high[f, p] - origin[p]) / h) - np.floor((low[f, p] - origin[p]) / h) + 1.0
        total += n
    return total


@njit(cache=True)
def cell_size(low: Floats, high: Floats, origin: Floats) -> float:
    """Mean largest extent of the boxes, doubled until the boxes enter few cells on average."""
    n = low.shape[0]
    h = 0.0
    for f in range(n):
        h += max(high[f, 0] - low[f, 0], high[f, 1] - low[f, 1], high[f, 2] - low[f, 2]) / n
    if not (h > 0.0 and h < np.inf):
        return 1.0  # facets shrunk to points, no margin: any size is right
    while _entries(low, high, origin, h) > MAX_CELLS_PER_FACET * n:
        h *= 2.0
    return h


@njit(cache=True)
def _fill_grid(boxes: Boxes, grid: Grid) -> None:
    """Enter each box into the cells it touches: bucket b holds rows start[b] to start[b + 1].

    Called twice: with no rows in cells it counts into start[b + 2]; then it fills and moves start[b + 1] along.
    """
    (low, high), (origin, h, mask, start, cells, facets) = boxes, grid
    count_only = cells.shape[0] == 0
    for f in range(low.shape[0]):
        i0, i1 = _cell(low[f, 0], origin[0], h), _cell(high[f, 0], origin[0], h)
        j0, j1 = _cell(low[f, 1], origin[1], h), _cell(high[f, 1], origin[1], h)
        k0, k1 = _cell(low[f, 2], origin[2], h), _cell(high[f, 2], origin[2], h)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    b = _bucket(i, j, k, mask)
                    if count_only:
                        start[b + 2] += 1
                        continue
                    row = start[b + 1]
                    cells[row, 0], cells[row, 1], cells[row, 2], facets[row] = i, j, k, f
                    start[b + 1] = row + 1


@njit(cache=True)
def _query(point: Floats, boxes: Boxes, grid: Grid, out: Ints64, at: int) -> int:
    """Facets whose box holds the point, written to out from place at unless out is empty; return how many.

    A box enters a cell once and a point asks one cell, so no facet is found twice; facets come in rising order.
    """
    low, high = boxes
    origin, h, mask, start, cells, facets = grid
    i, j, k = _cell(point[0], origin[0], h), _cell(point[1], origin[1], h), _cell(point[2], origin[2], h)
    b = _bucket(i, j, k, mask)
    n = 0
    for row in range(start[b], start[b + 1]):
        if cells[row, 0] != i or cells[row, 1] != j or cells[row, 2] != k:
            continue  # another cell of the same bucket
        f = facets[row]
        inside = True
        for p in range(3):
            # written so that a NaN is outside
            inside = inside and point[p] >= low[f, p] and point[p] <= high[f, p]
        if inside:
            if out.shape[0] > 0:
                out[at + n] = f
            n += 1
    return n


@njit(cache=True)
def candidates(points: Floats, x: Floats, nodes: Ints64, size: Ints64, margin: float) -> tuple[Ints64, Ints64]:
    """CSR lists of the facets that may lie within margin of each point.

    points (np, 3), x (nx, 3) current positions, nodes (nf, 4) and size (nf,) the surface.  Returns offsets (np + 1,)
    and facets (offsets[-1],), int64, rising for each point.  No facet nearer than margin is missed.
    """
    n_points, n = points.shape[0], nodes.shape[0]
    offsets = np.zeros(n_points + 1, np.int64)
    if n == 0 or n_points == 0:
        return offsets, np.empty(0, np.int64)
    low, high, origin = np.empty((n, 3)), np.empty((n, 3)), np.empty(3)
    facet_boxes(x, nodes, size, margin, low, high)
    for p in range(3):
        origin[p] = low[:, p].min()
    h = cell_size(low, high, origin)

    buckets = 1
    while buckets < 4 * n:  # about as many as there are cells of a surface
        buckets *= 2
    start = np.zeros(buckets + 2, np.int64)
    boxes, empty = (low, high), (np.empty((0, 3), np.int64), np.empty(0, np.int64))
    _fill_grid(boxes, (origin, h, buckets - 1, start, *empty))
    for b in range(buckets + 1):
        start[b + 1] += start[b]
    grid = origin, h, buckets - 1, start, np.empty((start[-1], 3), np.int64), np.empty(start[-1], np.int64)
    _fill_grid(boxes, grid)

    found = np.empty(0, np.int64)
    for q in range(n_points):
        n_q = _query(points[q], boxes, grid, found, 0)
        offsets[q + 1] = offsets[q] + n_q
    found = np.empty(offsets[-1], np.int64)
    for q in range(n_points):
        _query(points[q], boxes, grid, found, offsets[q])
    return offsets, found
