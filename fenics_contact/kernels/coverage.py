"""How much of a sample lies over the master: its share falls from one to zero while the master's end passes below it.

Seen along the normal n of a sample x, an edge from a to b of the master ends it where nothing that looks towards the sample
goes on beyond.  With nu = (b - a) x n / |...| out of the master, the sample's distance from the end is d = nu . (a - x) and
its share clip(1/2 + d/w, 0, 1); w is a part of what its facet measures along nu, so that surfaces which end together cover
each other whole.  The share is a function of x, n, a, b and of the two corners of the facet between which w is measured.

    ends    (starts (nf + 1,) into the next two for each facet of the master; edges (ne, 2): nodes from a to b with the
            surface on the left, seen from outside; sides (ne, 2): the facet it belongs to and that beyond, -1: none; smooth
            (nf,): from where on in its part of them the surface goes on without a crease)
    cover   (shares (np,), edges (np, 4): a, b and the far and near corner of the slave's facet, -1 where the share is
            constant, slopes (np, 5, 3): rates of the share with x, n, a, b and the far corner, minus that with the near one)
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE, OVERLAP, Lists, Projection
from fenics_contact.kernels.facets import PlacedSurface, Surface
from fenics_contact.kernels.vectors import Vector, cross, dot, less, minus, norm, planar, plus, put, row, times
from fenics_contact.types import Bools, Floats, Ints64

Ends = tuple[Ints64, Ints64, Ints64, Ints64]
Master = tuple[Surface, Ends]
# points (np, 3), corners (np, m) of their facets, rims (np,): w over what these measure, facets (np,) of the master that
# they keep wherever they are, -1: none, (0,): none does
Samples = tuple[Floats, Ints64, Floats, Ints64]
Cover = tuple[Floats, Ints64, Floats]
Sight = tuple[Floats, Floats]  # normals (np, 3) of the samples, into the slave, and places (nx, 3) of all nodes

# Cosine of the angle between a sample's normal and that of a facet that it can meet: surfaces that touch are nearly
# parallel, and along steeper ones (beside a crease) gaps grow so fast that a mean over them jumps
FACING = 0.5
STEEP, LEVEL = 2.0, 0.05  # slope of such a facet, and of an edge's length: how far off an end of it may lie along the normal
# Cosine above which a facet's neighbours look towards its samples, too, but for those beyond a crease: there a surface that
# curves away has no end
LEANING = 0.9
SHUT = 1e-3  # of a facet's size: what lies less far behind it as drawn is the other side of a slit, not of a wall
TIE = 1e-9  # relative: edges meet in a corner and are equally far from what lies outside of it


@njit(cache=True, error_model="numpy")
def _leans_less(f: int, cosine: float, n: Vector, coords: Floats, surface: Surface) -> bool:
    """Whether the angle between n and the normal of facet f has a greater cosine."""
    nodes = surface[0]
    one = minus(row(coords, nodes[f, 2]), row(coords, nodes[f, 0]))
    two = minus(row(coords, nodes[f, 3]), row(coords, nodes[f, 1]))
    area = cross(one, two)
    return dot(area, n) > cosine * norm(area)


@njit(cache=True, error_model="numpy")
def faces(f: int, n: Vector, coords: Floats, surface: Surface) -> bool:
    """Whether facet f as a whole looks towards samples of normal n."""
    return _leans_less(f, FACING, n, coords, surface)


@njit(cache=True)
def in_sight(lists: Lists, sight: Sight, surface: Surface) -> Lists:
    """Of the facets listed for each sample those that look towards it."""
    offsets, listed = lists
    starts, kept, count = np.zeros_like(offsets), np.empty_like(listed), 0
    for q in range(len(offsets) - 1):
        for f in listed[offsets[q] : offsets[q + 1]]:
            if faces(f, row(sight[0], q), sight[1], surface):
                kept[count] = f
                count += 1
        starts[q + 1] = count
    return starts, kept[:count]


@njit(cache=True)
def kept(lists: Lists, facets: Ints64) -> Lists:
    """Of the facets listed for each sample those of samples that have no facet of their own (np,), -1; else that alone."""
    offsets, listed = lists
    starts, out, count = np.zeros_like(offsets), np.empty(len(listed) + len(facets), np.int64), 0
    for q in range(len(facets)):
        if facets[q] >= 0:
            out[count] = facets[q]
            count += 1
        else:
            for f in listed[offsets[q] : offsets[q + 1]]:
                out[count] = f
                count += 1
        starts[q + 1] = count
    return starts, out[:count]


class Walls(NamedTuple):
    """Flat facets as their bodies were drawn, the slave's and the master's `others`: middles (n, 3), unit normals (n, 3) out
    of them, longest sides (n,) [length], and parts (n,), alike in what hangs together; thick (n,): how thick the slave's
    body is behind them, endless where it is not thin [length]."""

    middles: Floats
    normals: Floats
    sizes: Floats
    parts: Ints64
    thick: Floats
    others: tuple[Floats, Floats, Floats, Ints64]


@njit(cache=True, error_model="numpy")
def _backs(s: int, f: int, walls: Walls, search: float) -> bool:
    """Whether facet f of the master was drawn as the other side of the slave's facet s, no farther off than a search: in the
    same body, turned away from it as it is itself, and opposite, so that the body lies in between; or beyond that side."""
    middles, normals, sizes, parts = walls.others
    if walls.parts[s] != parts[f]:
        return False
    n, m, way = row(walls.normals, s), row(normals, f), minus(row(middles, f), row(walls.middles, s))
    size, below = walls.sizes[s] + sizes[f], -dot(n, way)
    if below <= SHUT * size or dot(n, m) > FACING or norm(way) > search + size:
        return False
    if below > walls.thick[s] + SHUT * size:
        return True
    if dot(m, way) <= SHUT * size:
        return False
    out = minus(n, m)
    out = times(1.0 / norm(out), out)
    depth = -dot(out, way)
    return norm(less(way, -depth, out)) <= depth + size


@njit(cache=True)
def in_front(lists: Lists, facet: Ints64, walls: Walls, search: float) -> Lists:
    """Of the facets listed for each point, of the slave's facet (np,), those that are not the other side of its wall."""
    offsets, listed = lists
    starts, kept, count = np.zeros_like(offsets), np.empty_like(listed), 0
    for q in range(len(offsets) - 1):
        for f in listed[offsets[q] : offsets[q + 1]]:
            if not _backs(facet[q], f, walls, search):
                kept[count] = f
                count += 1
        starts[q + 1] = count
    return starts, kept[:count]


@njit(cache=True, error_model="numpy")
def _nearest_end(
    x: Vector, n: Vector, foot: tuple[int, float], coords: Floats, master: Master, by: tuple[Vector, Floats]
) -> tuple[int, float, Vector]:
    """(Edge or -1, d, nu) of the end of the master that lies nearest around the facet f of a foot, at a gap g, seen along n;
    what looks towards the sample is judged `by` its normal and the places (nx, 3) then."""
    (f, g), (surface, (starts, edges, sides, smooth)), (m, then) = foot, master, by
    best, least, distance, out = -1, math.inf, 0.0, n
    last = smooth[f] if _leans_less(f, LEANING, n, coords, surface) else starts[f + 1]
    for e in range(starts[f], last):
        if not faces(sides[e, 0], m, then, surface) or (sides[e, 1] >= 0 and faces(sides[e, 1], m, then, surface)):
            continue
        a = row(coords, edges[e, 0])
        along = minus(row(coords, edges[e, 1]), a)
        across = cross(along, n)
        size = dot(across, across)  # of the edge as seen along n
        if not size > 1e-20 * dot(along, along):
            continue
        y = minus(a, x)
        nu = times(1.0 / math.sqrt(size), across)
        seen, way = planar(along, n), planar(y, n)
        s = min(max(-dot(way, seen) / size, 0.0), 1.0)
        r = norm(less(way, -s, seen))
        if abs(dot(n, less(y, -s, along)) + g) > STEEP * r + LEVEL * norm(along):
            continue  # far above or below where the sample meets the master
        d = dot(nu, y)
        if r < least * (1.0 - TIE) or (r <= least * (1.0 + TIE) and abs(d) > abs(distance)):
            best, least, distance, out = e, min(r, least), d, nu
    return best, distance, out


@njit(cache=True)
def _continued(q: int, size: int, xi: Floats) -> bool:
    """Whether point q lies beyond the facet that it is paired with, one of 3 or 4 corners."""
    s, t, limit = xi[q, 0], xi[q, 1], 1.0 + OVERLAP
    return min(s, t) < -OVERLAP or s + t > limit if size == 3 else max(abs(s), abs(t)) > limit


@njit(cache=True, error_model="numpy")
def _passed(q: int, coords: Floats, master: Master, points: Floats, projection: Projection) -> bool:
    """Whether sample q lies beyond its facet, beside its corners, too, for curved sides bulge, and a facet of the same nodes
    lies there. Between bodies side by side it may meet neither."""
    ((nodes, size), (starts, edges, sides, _)), f, n = master, projection[0][q], row(projection[5], q)
    if not _continued(q, size[f], projection[3]):
        return False
    y = less(row(points, q), projection[4][q], n)
    for e in range(starts[f], starts[f + 1]):
        a, b, g = edges[e, 0], edges[e, 1], sides[e, 1]
        if sides[e, 0] != f or g < 0 or not ((nodes[g] == a).any() and (nodes[g] == b).any()):
            continue
        along = minus(row(coords, b), row(coords, a))
        across = cross(along, n)
        if dot(across, minus(y, row(coords, a))) > TIE * norm(across) * norm(along):
            return True
    return False


@njit(cache=True, error_model="numpy")
def lose_passed(points: Floats, placed: PlacedSurface, beyond: Ints64, projection: Projection) -> None:
    """Points (np, 3) that meet no facet and are paired with one that is continued beyond an edge, though another facet lies
    there that looks towards them, lose their foot: the surface curves away and ends before it comes to them. beyond (nf, 4):
    of `beyond_edges`."""
    (coords, surface), (facet, kind, _, xi, gap, normal) = placed, projection
    nodes, size = surface
    for q in range(len(points)):
        f = facet[q]
        if kind[q] == NONE or not _continued(q, size[f], xi):
            continue
        n, least, there = row(normal, q), math.inf, -1
        y = less(row(points, q), gap[q], n)
        for i in range(size[f]):
            a = row(coords, nodes[f, i])
            along, way = minus(row(coords, nodes[f, (i + 1) % size[f]]), a), minus(y, a)
            s = dot(way, along) / max(dot(along, along), 1e-300)
            off = norm(less(way, min(max(s, 0.0), 1.0), along))
            if off < least:  # outside of a corner two edges are as far
                least, there = off, beyond[f, i] if 0.0 < s < 1.0 else -1
        if there >= 0 and _leans_less(there, 0.0, n, coords, surface):
            facet[q], kind[q], gap[q] = -1, NONE, np.inf


@njit(cache=True, error_model="numpy")
def coverage(
    coords: Floats,
    samples: Samples,
    master: Master,
    sight: Sight,
    projection: Projection,
    cover: Cover,
) -> None:
    """Fill cover; samples of which nothing lies over the master lose their foot in the projection. So do those beyond their
    facet where it does not end: the surface goes on there, curves away, and ends before it comes to them.

    master: its surface and ends; sight: by which it is judged what looks towards the samples.
    """
    (points, corners, rims, kept), (_, edges, _, _), (shares, around, slopes) = samples, master[1], cover
    facet, kind, _, _, gap, normal = projection
    around[:], slopes[:] = -1, 0.0
    for q in range(len(points)):
        shares[q] = 0.0
        if kind[q] == NONE:
            continue
        x, n, shares[q] = row(points, q), row(normal, q), 1.0
        e, d, nu = _nearest_end(x, n, (facet[q], gap[q]), coords, master, (row(sight[0], q), sight[1]))
        far = near = corners[q, 0]
        for c in range(1, corners.shape[1]):
            node = corners[q, c]
            far = node if dot(nu, minus(row(coords, node), row(coords, far))) > 0.0 else far
            near = node if dot(nu, minus(row(coords, node), row(coords, near))) < 0.0 else near
        span = times(rims[q], minus(row(coords, far), row(coords, near)))
        w = max(dot(nu, span), 1e-300)
        share, free = 0.5 + d / w if e >= 0 else 1.0, len(kept) == 0 or kept[q] < 0
        if share >= 1.0 and not (free and _passed(q, coords, master, points, projection)):
            continue
        if share <= 0.0 or share >= 1.0:
            shares[q], facet[q], kind[q], gap[q] = 0.0, -1, NONE, np.inf
            continue
        shares[q] = share
        a, b = row(coords, edges[e, 0]), row(coords, edges[e, 1])
        along, stretch = minus(b, a), -d / (w * w)
        turned = plus(times(1.0 / w, minus(a, x)), times(stretch, span))  # the share's rate with nu, which keeps its length
        turned = times(1.0 / norm(cross(along, n)), planar(turned, nu))
        by_along = cross(n, turned)
        around[q, 0], around[q, 1], around[q, 2], around[q, 3] = edges[e, 0], edges[e, 1], far, near
        put(slopes, q, 0, times(-1.0 / w, nu))
        put(slopes, q, 1, cross(turned, along))
        put(slopes, q, 2, less(times(1.0 / w, nu), 1.0, by_along))
        put(slopes, q, 3, by_along)
        put(slopes, q, 4, times(stretch * rims[q], nu))


def beyond_edges(surface: Surface) -> Ints64:
    """Facets (nf, 4) beyond the edges from each corner to the next, -1: none."""
    nodes, size = surface
    corner = np.arange(nodes.shape[1])
    there = corner < size[:, None]
    a, b = nodes, np.take_along_axis(nodes, np.where(corner + 1 < size[:, None], corner + 1, 0), axis=1)
    count = int(nodes.max(initial=0)) + 1
    key, back = (a * count + b)[there], b * count + a
    order, facet = np.argsort(key), np.nonzero(there)[0]
    at = np.minimum(np.searchsorted(key[order], back), max(len(key) - 1, 0))
    found = there & (key[order][at] == back) if len(key) else there
    return np.where(found, facet[order][at] if len(key) else -1, -1)


def surface_ends(surface: Surface, normals: Floats, cosine: float, counts: Bools | None = None) -> Ends:
    """Edges that can end the master, listed for each facet that has a node of the edge's own facet.

    normals (nf, 3): of the facets in the reference; cosine: of the angle between facets from which on their edge is a
    crease; counts (nf, m): which edges, from each corner to the next, can be ends, None: all.
    """
    nodes, size = surface
    m = nodes.shape[1]
    following = np.where(np.arange(m) + 1 < size[:, None], np.arange(m) + 1, 0)
    there = np.arange(m) < size[:, None]
    f, i = np.nonzero(there if counts is None else there & counts)
    a, b, count = nodes[f, i], nodes[f, following[f, i]], int(nodes.max(initial=0)) + 1
    beyond = beyond_edges(surface)[f, i]
    smooth = (beyond >= 0) & (np.einsum("ec,ec->e", normals[f], normals[beyond]) >= cosine)
    edges, sides = np.column_stack([a, b]).astype(np.int64), np.column_stack([f, beyond]).astype(np.int64)
    # facets of each node, then of each edge: those around any node of its own facet
    corner_facet, i = np.nonzero(there)
    corner_node = nodes[corner_facet, i]
    order = np.argsort(corner_node, kind="stable")
    starts = np.searchsorted(corner_node[order], np.arange(count + 1))
    e, c = np.nonzero(np.arange(m) < size[sides[:, 0]][:, None])
    node = nodes[sides[e, 0], c]
    counts = starts[node + 1] - starts[node]
    at = np.repeat(starts[node] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    e = np.repeat(e, counts)
    pairs = np.unique(np.column_stack([corner_facet[order][at], smooth[e], e]), axis=0)
    first, listed = np.searchsorted(pairs[:, 0], np.arange(len(nodes) + 1)), pairs[:, 2]
    creased = np.bincount(pairs[pairs[:, 1] == 0, 0], minlength=len(nodes))
    return first, np.ascontiguousarray(edges[listed]), np.ascontiguousarray(sides[listed]), first[:-1] + creased
