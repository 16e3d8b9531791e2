"""Which facets may lie near which points, or be met by which rays: a hashed uniform grid of the facets' enlarged boxes.

The grid keeps only cells that a box touches, so memory and time grow with the number of facets, not with the
volume they enclose.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import Lists
from fenics_contact.kernels.facets import PlacedSurface
from fenics_contact.kernels.vectors import ZERO, Vector, dot, less, minus, row
from fenics_contact.types import Floats, Ints64

# Boxes may enter this many cells on average before the cells are doubled: a few large facets among many small
# ones then cost some longer lists, not an explosion of entries.  Cubes of mean box size enter 8 at most.
MAX_CELLS_PER_FACET = 16
# Cell numbers are clipped here so that far points cannot overflow an integer; clipped cells hold no box.
MAX_CELL = 1 << 40
# A facet whose ball a ray passes by this much, relative, is not met; above round-off and kernels/closest_point.py's OVERLAP.
CLEAR = 1e-6

Line = tuple[Vector, Vector, tuple[float, float]]  # x, unit n, and where it begins and ends along n
# seen (nf,): the line that found each facet last; of the three axes: the cell, the last cell and the way there; where on the
# line the next cell begins, and how long one lasts
Work = tuple[Ints64, Ints64, Ints64, Ints64, Floats, Floats]
Boxes = tuple[Floats, Floats]  # low, high (n, 3)
Balls = tuple[Floats, Floats]  # centres (nf, 3) and squared radii (nf,) of balls that hold the facets
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
                    free = start[b + 1]
                    cells[free, 0], cells[free, 1], cells[free, 2], facets[free] = i, j, k, f
                    start[b + 1] = free + 1


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
    for at_row in range(start[b], start[b + 1]):
        if cells[at_row, 0] != i or cells[at_row, 1] != j or cells[at_row, 2] != k:
            continue  # another cell of the same bucket
        f = facets[at_row]
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
def _grid(boxes: Boxes) -> Grid:
    """The grid of n > 0 boxes."""
    low, high = boxes
    n, origin = len(low), np.empty(3)
    for p in range(3):
        origin[p] = low[:, p].min()
    h = cell_size(low, high, origin)
    buckets = 1
    while buckets < 4 * n:  # about as many as there are cells of a surface
        buckets *= 2
    start = np.zeros(buckets + 2, np.int64)
    _fill_grid(boxes, (origin, h, buckets - 1, start, np.empty((0, 3), np.int64), np.empty(0, np.int64)))
    for b in range(buckets + 1):
        start[b + 1] += start[b]
    grid = origin, h, buckets - 1, start, np.empty((start[-1], 3), np.int64), np.empty(start[-1], np.int64)
    _fill_grid(boxes, grid)
    return grid


@njit(cache=True)
def candidates(points: Floats, x: Floats, nodes: Ints64, size: Ints64, margin: float) -> Lists:
    """CSR lists of the facets that may lie within margin of each point.

    points (np, 3), x (nx, 3) current positions, nodes (nf, 4) and size (nf,) the surface.  Returns offsets (np + 1,)
    and facets (offsets[-1],), int64, rising for each point.  No facet nearer than margin is missed.
    """
    n_points, n = points.shape[0], nodes.shape[0]
    offsets = np.zeros(n_points + 1, np.int64)
    if n == 0 or n_points == 0:
        return offsets, np.empty(0, np.int64)
    boxes = low, high = np.empty((n, 3)), np.empty((n, 3))
    facet_boxes(x, nodes, size, margin, low, high)
    grid, found = _grid(boxes), np.empty(0, np.int64)
    for q in range(n_points):
        n_q = _query(points[q], boxes, grid, found, 0)
        offsets[q + 1] = offsets[q] + n_q
    found = np.empty(offsets[-1], np.int64)
    for q in range(n_points):
        _query(points[q], boxes, grid, found, offsets[q])
    return offsets, found


@njit(cache=True)
def facet_balls(master: PlacedSurface) -> Balls:
    """The Balls of all facets."""
    coords, (nodes, size) = master
    centres, radii = np.empty((len(size), 3)), np.empty(len(size))
    for f in range(len(size)):
        m, centre, longest = size[f], ZERO, 0.0
        for i in range(m):
            centre = less(centre, -1.0 / m, row(coords, nodes[f, i]))
        for i in range(m):
            arm = minus(row(coords, nodes[f, i]), centre)
            longest = max(longest, dot(arm, arm))
        centres[f, 0], centres[f, 1], centres[f, 2] = centre
        radii[f] = (1.0 + CLEAR) * longest
    return centres, radii


@njit(cache=True, error_model="numpy")
def _clipped(x: Vector, n: Vector, search: float, least: Vector, most: Vector) -> tuple[float, float]:
    """From where to where on x + s n, |s| <= search, the line is in a box between two corners; less is second: nowhere."""
    s0, s1 = -search, search
    for p in range(3):
        if n[p] == 0.0:
            if not (x[p] >= least[p] and x[p] <= most[p]):  # a NaN is outside
                return 1.0, 0.0
            continue
        a, b = (least[p] - x[p]) / n[p], (most[p] - x[p]) / n[p]
        s0, s1 = max(s0, min(a, b)), min(s1, max(a, b))
        if not s0 <= s1:
            return 1.0, 0.0
    return s0, s1


@njit(cache=True, error_model="numpy")
def _walk(line: Line, balls: Balls, grid: Grid, q: int, work: Work, out: Ints64) -> int:
    """Facets whose ball line q passes, in the cells between its ends, written to out, rising; returns how many.

    Amanatides & Woo 1987, A fast voxel traversal algorithm for ray tracing.
    """
    (x, n, ends), (centres, radii), (origin, h, mask, start, cells, facets) = line, balls, grid
    seen, cell, last, step, following, each = work
    for p in range(3):
        cell[p], last[p] = _cell(x[p] + ends[0] * n[p], origin[p], h), _cell(x[p] + ends[1] * n[p], origin[p], h)
        step[p], each[p] = 1 if n[p] > 0.0 else -1, h / abs(n[p])
        following[p] = (origin[p] + h * (cell[p] + max(step[p], 0)) - x[p]) / n[p] if n[p] != 0.0 else np.inf
    count = 0
    for _ in range(abs(last[0] - cell[0]) + abs(last[1] - cell[1]) + abs(last[2] - cell[2]) + 1):
        b = _bucket(cell[0], cell[1], cell[2], mask)
        for k in range(start[b], start[b + 1]):
            f = facets[k]
            if seen[f] == q or cells[k, 0] != cell[0] or cells[k, 1] != cell[1] or cells[k, 2] != cell[2]:
                continue
            seen[f] = q
            arm = minus(row(centres, f), x)
            along = dot(arm, n)
            if dot(arm, arm) - along * along <= radii[f]:
                j = count
                while j > 0 and out[j - 1] > f:
                    out[j] = out[j - 1]
                    j -= 1
                out[j] = f
                count += 1
        axis, nearest = -1, np.inf
        for p in range(3):
            if cell[p] != last[p] and (axis < 0 or following[p] < nearest):
                axis, nearest = p, following[p]
        if axis >= 0:
            cell[axis] += step[axis]
            following[axis] += each[axis]
    return count


@njit(cache=True)
def candidates_along(points: Floats, directions: Floats, balls: Balls, search: float) -> Lists:
    """CSR lists, as of `candidates`, of the facets in whose balls lies a part of the line through each point.

    points (np, 3); directions (np, 3): unit vectors along the lines; balls: centres (nf, 3) and squared radii (nf,);
    search: length of the line to either side. No such facet is missed; some that the line, continued, passes are listed.
    """
    (centres, radii), n_points, n = balls, len(points), len(balls[1])
    offsets, found, count = np.zeros(n_points + 1, np.int64), np.empty(4 * n_points + n, np.int64), 0
    if n == 0 or n_points == 0:
        return offsets, found[:0]
    low, high = np.empty((n, 3)), np.empty((n, 3))
    for f in range(n):
        for p in range(3):
            low[f, p], high[f, p] = centres[f, p] - np.sqrt(radii[f]), centres[f, p] + np.sqrt(radii[f])
    grid, seen = _grid((low, high)), np.full(n, -1, np.int64)
    work = seen, np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3), np.empty(3)
    least, most = (low[:, 0].min(), low[:, 1].min(), low[:, 2].min()), (high[:, 0].max(), high[:, 1].max(), high[:, 2].max())
    for q in range(n_points):
        x, d = row(points, q), row(directions, q)
        ends = _clipped(x, d, search, least, most)
        if ends[0] <= ends[1]:
            if len(found) < count + n:
                found = np.append(found, np.empty(len(found) + n, np.int64))
            count += _walk((x, d, ends), balls, grid, q, work, found[count:])
        offsets[q + 1] = count
    return offsets, found[:count].copy()
