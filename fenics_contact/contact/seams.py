"""Seams of meshed tools: corners that are one but for rounding, and corners that lie on edges of other facets.

Files leave such seams open: an .stl file states each facet by itself, with as many digits as its writer has, and patches
may have other numbers of facets along the edge in which they meet.  An edge without a facet beyond it ends the master (see
kernels/coverage.py and kernels/segments.py), so here open corners in one place become one, and facets are divided where an
open corner lies on an open edge of theirs.  What has facets on both sides, and what is farther apart, stays as it is; ends
that are neither one nor apart are found, to be told.
"""

from typing import NamedTuple

import numpy as np

from fenics_contact.contact.master import area_vectors
from fenics_contact.contact.tools import Slits
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.coverage import beyond_edges
from fenics_contact.kernels.facets import Surface
from fenics_contact.types import Floats, Ints64

# Of a tool's size: places that are one differ by less. Text has six digits where nothing else is asked for, so that
# roundings of one number differ by up to 1e-5 of it, along each axis; float32 has a digit more
ROUNDED = 2e-5
FINEST = 1e-6  # of a tool's size: facets that are smaller are rounding themselves
STEP = 0.25  # of a facet's size: how far one of two surfaces side by side may stand out beside the other
APART = 0.05  # of a facet's size: its corners are farther from one another, whatever the tool's
ALONG = 0.9  # cosine between two edges of which one runs along the other, whichever way
MANY = 100_000  # nodes that are asked at once, which bounds memory
FACING = -0.5  # cosine, seen along an edge, between the ways out of its facet and to another one that lies beyond the edge


def joined(surface: Surface, X: Floats, thin: bool) -> tuple[Surface, Floats, int]:
    """The same surface, nodes (nf, 4) and size (nf,), and its places (nx, 3), without open seams; and how many of its facets
    that leaves out: those that shrink to an edge, with `thin` those whose corners lie on a line but for rounding, too."""
    nodes, size = surface
    near, _ = _rounding(nodes, size, X)
    if thin:
        nodes, size = _without_thin(nodes, size, X, near)
    pairs = _beside(nodes, size, X, near)
    node, end = np.repeat(pairs.node, 2), pairs.ends.ravel()
    nodes, size = _without_repeats(_one_place(node, end, X, near)[nodes], size)
    if thin:
        nodes, size = _without_thin(nodes, size, X, near)
    left_out = len(surface[0]) - len(nodes)
    nodes, size, X = _divided(nodes, size, X, near)
    used, numbers = np.unique(nodes, return_inverse=True)
    nodes = np.ascontiguousarray(numbers.reshape(nodes.shape), dtype=np.int64)
    return (nodes, size), np.ascontiguousarray(X[used]), left_out


def joined_sides(ends: Ints64, X: Floats) -> tuple[Ints64, Floats]:
    """Sides (ns, 2) of a curve, from node to node, that go on where one ends and another begins but for rounding; X."""
    lengths = np.linalg.norm(X[ends[:, 1]] - X[ends[:, 0]], axis=1)
    near = np.full(len(X), ROUNDED * np.ptp(X, axis=0).max())
    np.minimum.at(near, ends, APART * lengths[:, None])
    begins, stops = np.setdiff1d(ends[:, 0], ends[:, 1]), np.setdiff1d(ends[:, 1], ends[:, 0])
    i, j = _boxed(begins, stops[:, None], X, near.max())
    used, numbers = np.unique(_one_place(begins[i], stops[j], X, near)[ends], return_inverse=True)
    return np.ascontiguousarray(numbers.reshape(ends.shape), dtype=np.int64), np.ascontiguousarray(X[used])


def _one_place(i: Ints64, j: Ints64, X: Floats, near: Floats) -> Ints64:
    """For each node (nx,) the first one of those that are one with it: of pairs (np,) those that are near each other."""
    first = np.arange(len(X))
    one = np.linalg.norm(X[i] - X[j], axis=1) <= np.minimum(near[i], near[j])
    i, j = i[one], j[one]
    while True:
        least = first.copy()
        np.minimum.at(least, i, first[j])
        np.minimum.at(least, j, first[i])
        least = least[least]
        if np.array_equal(least, first):
            return first
        first = least


def slits(surface: Surface, X: Floats) -> Slits | None:
    """Open ends of facets that lie side by side and nearer to each other than facets are long, without being one."""
    nodes, size = surface
    _, apart = _rounding(nodes, size, X)
    pairs = _beside(nodes, size, X, apart)
    found = np.flatnonzero(pairs.off <= np.minimum(apart[pairs.node], apart[pairs.ends].min(axis=1)))
    if not len(found):
        return None
    worst = found[np.argmax(pairs.off[found])]
    return Slits(len(np.unique(pairs.node[found])), X[pairs.node[worst]], float(pairs.off[worst]))


class Abutting(NamedTuple):
    """Open edges that end on those of other facets, as they lie: facet and first corner (n,) of each, the facet beyond."""

    facet: Ints64
    corner: Ints64
    beyond: Ints64


def abutting(surface: Surface, X: Floats) -> Abutting:
    """Those both of whose ends lie on open edges of facets on their other side, at places X (nx, 3)."""
    nodes, size = surface
    apart = STEP / APART * _rounding(nodes, size, X)[1]
    pairs = _beside(nodes, size, X, apart)
    start, end = X[pairs.ends[:, 0]], X[pairs.ends[:, 1]]
    off = X[pairs.node] - start - (pairs.at / pairs.length)[:, None] * (end - start)
    normal = unit(area_vectors(X[nodes[pairs.facet]]))
    step = np.einsum("pc,pc->p", off, normal)
    allowed = np.minimum(apart[pairs.node], apart[pairs.ends].min(axis=1))
    near = (np.abs(step) <= allowed) & (np.linalg.norm(off - step[:, None] * normal, axis=1) <= APART / STEP * allowed)
    facet, edges = _open(nodes, size)
    other, node, beyond = pairs.other[near], pairs.node[near], pairs.facet[near]
    first = np.full((len(edges), 2), -1)
    for end in (0, 1):
        at = node == edges[other, end]
        first[other[at], end] = beyond[at]
    both = (first >= 0).all(axis=1)
    return Abutting(facet[both], edges[both, 0], first[both, 0])


def _rounding(nodes: Ints64, size: Ints64, X: Floats) -> tuple[Floats, Floats]:
    """How far off each node may be, and how far what is another one is at least (nx,) [length]. Of needles, whose shortest
    side may be rounding, the next one is the size."""
    box = np.ptp(X, axis=0).max()
    sides = _sides(nodes, X)
    own = np.where(size == 4, sides[:, 1], sides[:, 2])
    apart = np.full(len(X), APART * box)
    np.minimum.at(apart, nodes, np.where(own > FINEST * box, APART * own, np.inf)[:, None])
    return np.minimum(ROUNDED * box, apart), apart


def _sides(nodes: Ints64, X: Floats) -> Floats:
    """Lengths (nf, 4) of the facets' sides, rising; that from a triangle's third corner to itself is zero."""
    return np.sort(np.linalg.norm(X[np.roll(nodes, -1, axis=1)] - X[nodes], axis=2), axis=1)


def _without_thin(nodes: Ints64, size: Ints64, X: Floats, near: Floats) -> Surface:
    """Facets that are higher over their longest side than rounding."""
    area = np.linalg.norm(area_vectors(X[nodes]), axis=1)
    keep = 2.0 * area > near[nodes].min(axis=1) * _sides(nodes, X)[:, 3]
    return nodes[keep], size[keep]


def _without_repeats(nodes: Ints64, size: Ints64) -> Surface:
    """Facets with each of their corners once: a quadrilateral may be left as a triangle, others as nothing."""
    nodes, size, keep = nodes.copy(), size.copy(), np.ones(len(nodes), dtype=bool)
    ordered = np.sort(nodes, axis=1)
    for f in np.flatnonzero((np.diff(ordered, axis=1) == 0).sum(axis=1) > 4 - size):
        ring = list(dict.fromkeys(nodes[f]))
        keep[f] = len(ring) == 3 and nodes[f, 0] != nodes[f, 2] and nodes[f, 1] != nodes[f, 3]
        nodes[f], size[f] = (ring + ring[-1:] * 3)[:4], 3
    return nodes[keep], size[keep]


def _open(nodes: Ints64, size: Ints64) -> tuple[Ints64, Ints64]:
    """Facets (ne,) and edges (ne, 2) that have no facet beyond."""
    corner = np.arange(4)
    f, i = np.nonzero((corner < size[:, None]) & (beyond_edges((nodes, size)) < 0))
    return f, np.column_stack([nodes[f, i], nodes[f, (i + 1) % size[f]]])


def _boxed(points: Ints64, rows: Ints64, X: Floats, margin: float) -> tuple[Ints64, Ints64]:
    """Pairs of one of some nodes (np,) and one of the rows (n, k) of nodes, by their numbers there, whose box it is in."""
    count = rows.shape[1]
    ring = np.ascontiguousarray(rows[:, np.minimum(np.arange(4), count - 1)])
    offsets, found = candidates(X[points], X, ring, np.full(len(rows), count), margin)
    return np.repeat(np.arange(len(points)), np.diff(offsets)), found


class _Beside(NamedTuple):
    """Open nodes beside open edges of facets that they are no corners of, where an open edge of theirs runs along that one
    and has its facet on the other side: the facet, the ends (n, 2) of its edge and the length of that, the node and the
    number of its open edge, and where along the edge and how far off it the node is [length]."""

    facet: Ints64
    ends: Ints64
    length: Floats
    node: Ints64
    other: Ints64
    at: Floats
    off: Floats


def _beside(nodes: Ints64, size: Ints64, X: Floats, margin: Floats) -> _Beside:
    """Those nearer than the greatest margin (nx,) of these nodes, along each axis."""
    facet, edges = _open(nodes, size)
    way, middles = X[edges[:, 1]] - X[edges[:, 0]], X[nodes].mean(axis=1)
    along, out = unit(way), unit(np.cross(way, area_vectors(X[nodes])[facet]))
    none = np.empty(0, dtype=np.int64)
    found = [(none, none, none)]
    for first in range(0, 2 * len(edges), MANY):
        ends = edges.ravel()[first : first + MANY]  # a node with each of its open edges
        p, e = _boxed(ends, edges, X, margin[edges].max())
        v, other = ends[p], (first + p) // 2
        there = middles[facet[other]] - X[v]
        there -= np.einsum("pc,pc->p", there, along[e])[:, None] * along[e]
        keep = np.einsum("pc,pc->p", there, out[e]) > FACING * np.linalg.norm(there, axis=1)
        keep &= np.abs(np.einsum("pc,pc->p", along[other], along[e])) > ALONG
        keep &= (nodes[facet[e]] != v[:, None]).all(axis=1)
        found.append((v[keep], e[keep], other[keep]))
    v, e, other = (np.concatenate(rows) for rows in zip(*found, strict=True))
    length = np.linalg.norm(way[e], axis=1)
    at = np.clip(np.einsum("pc,pc->p", X[v] - X[edges[e, 0]], along[e]), 0.0, length)
    off = np.linalg.norm(X[v] - X[edges[e, 0]] - at[:, None] * along[e], axis=1)
    return _Beside(facet[e], edges[e], length, v, other, at, off)


def _on_edges(nodes: Ints64, size: Ints64, X: Floats, near: Floats) -> dict[int, set[tuple[int, float, int]]]:
    """Open nodes on open edges, away from their ends: by facet (first node of the edge, place along it, node)."""
    pairs = _beside(nodes, size, X, 2.0 * near)
    allowed = np.minimum(near[pairs.node], near[pairs.ends].min(axis=1))
    to_end = np.minimum(pairs.at, pairs.length - pairs.at)
    on = (pairs.off <= 2.0 * allowed) & (to_end > allowed)  # what became one has moved by its rounding, too
    found: dict[int, set[tuple[int, float, int]]] = {}
    for k in np.flatnonzero(on):
        place = int(pairs.ends[k, 0]), float(pairs.at[k]), int(pairs.node[k])
        found.setdefault(int(pairs.facet[k]), set()).add(place)
    return found


def _divided(nodes: Ints64, size: Ints64, X: Floats, near: Floats) -> tuple[Ints64, Ints64, Floats]:
    """Facets with nodes on their edges as triangles around their middle, which leave a flat one as it is."""
    found = _on_edges(nodes, size, X, near)
    if not found:
        return nodes, size, X
    parts, middles = list[tuple[int, ...]](), list[Floats]()
    for f, more in sorted(found.items()):
        corners = [int(one) for one in nodes[f, : size[f]]]
        ring = [node for a in corners for node in (a, *(v for start, _, v in sorted(more) if start == a))]
        middle = len(X) + len(middles)
        middles.append(X[corners].mean(axis=0))
        parts += [(a, b, middle, middle) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    whole = np.ones(len(nodes), dtype=bool)
    whole[list(found)] = False
    divided = np.concatenate([nodes[whole], np.array(parts, dtype=np.int64)])
    return divided, np.concatenate([size[whole], np.full(len(parts), 3)]), np.concatenate([X, middles])
