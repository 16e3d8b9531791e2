"""A plane's cut with the facets of a surface: points on their edges and corners, joined facet by facet to chains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.types import Floats, Ints, Ints64

ALIKE = 1e-9  # of the range of what orders the points: less does not tell two ends apart


@dataclass(frozen=True)
class Cut:
    """Points of a cut: ends (n, 2), keys of the two corners between which each lies, twice that of the one it lies on; share
    (n,) of the second; joined (m, 2): rows of points that are neighbours on a facet; flat: how many facets lie in the plane.
    """

    ends: Ints64
    share: Floats
    joined: Ints64
    flat: int


def cut_facets(keys: Ints64, away: Floats) -> Cut:
    """The cut of facets with corners (ne, k) around them, of these keys and these distances from the plane, zero on it."""
    after, beyond = np.roll(keys, -1, axis=1), np.roll(away, -1, axis=1)
    flat = (away == 0.0).all(axis=1)
    # around a facet: corner, edge behind it, next corner, ...
    there = np.stack([away == 0.0, away * beyond < 0.0], axis=2).reshape(len(keys), 2 * keys.shape[1]) & ~flat[:, None]
    ends = np.stack([np.stack([keys, keys], axis=2), np.stack([keys, after], axis=2)], axis=2).reshape(*there.shape, 2)
    whole = np.where(away * beyond < 0.0, away - beyond, 1.0)
    share = np.stack([np.zeros_like(away), away / whole], axis=2).reshape(there.shape)
    swap = ends[..., 0] > ends[..., 1]  # the same from both facets of an edge
    ends, share = np.sort(ends, axis=-1), np.where(swap, 1.0 - share, share)
    number = np.cumsum(there.ravel()).reshape(there.shape) - 1
    joined = [pair for row, has in zip(number, there, strict=True) for pair in _pairs(row[has])]
    return Cut(ends[there], share[there], np.array(joined, dtype=np.int64).reshape(-1, 2), int(flat.sum()))


def along_sides(keys: Ints64) -> Cut:
    """The whole of a surface whose facets are sides of plane cells with corners (ne, 2) of these keys."""
    ends = np.repeat(keys.reshape(-1, 1), 2, axis=1)
    return Cut(ends, np.zeros(len(ends)), np.arange(len(ends), dtype=np.int64).reshape(-1, 2), 0)


def _pairs(points: Ints64) -> list[tuple[int, int]]:
    """Points of one facet, in their order around it, that the cut joins: each once where it runs through."""
    return [(points[i], points[i + 1]) for i in range(0, len(points) - 1, 1 if len(points) == 3 else 2)]


def together(comm: MPI.Comm, cut: Cut, values: Floats) -> tuple[Floats, Ints64]:
    """Points of all ranks, each once, in an order that no partition changes: values (n, ...) and neighbours. Collective."""
    names = cut.ends[cut.joined].reshape(-1, 4)
    ends, values, names = (np.concatenate(comm.allgather(part)) for part in (cut.ends, values, names))
    ends, first, row = np.unique(ends, axis=0, return_index=True, return_inverse=True)
    row = row.ravel()
    place = {tuple(end): i for i, end in enumerate(ends.tolist())}
    joined = [sorted((place[a, b], place[c, d])) for a, b, c, d in names.tolist()]
    return values[first], np.unique(np.array(joined, dtype=np.int64).reshape(-1, 2), axis=0)


def chains(joined: Ints64, order: Floats) -> list[Ints]:
    """Points along each chain; order (n,) says at which of its ends a chain starts, and which chain comes first.

    A closed one starts at its first point by that order, goes on to that neighbour which comes first, and ends where it
    starts. Points without a neighbour are in none.
    """
    rank = np.round(order / max(float(np.ptp(order)), 1e-300) / ALIKE) if len(order) else order
    left: dict[int, list[int]] = {}
    for a, b in joined.tolist():
        left.setdefault(a, []).append(b)
        left.setdefault(b, []).append(a)

    def first(points: Sequence[int]) -> int:
        return min(points, key=lambda i: (rank[i], i))

    found = []
    while open_ends := [point for point, others in left.items() if others]:
        group = _connected(left, first(open_ends))
        ends = [point for point in group if len(left[point]) % 2] or group
        chain = [first(ends)]
        while left[chain[-1]]:
            here, following = chain[-1], first(left[chain[-1]])
            left[here].remove(following)
            left[following].remove(here)
            chain.append(following)
        found.append(np.array(chain, dtype=np.int32))
    return sorted(found, key=lambda chain: (rank[chain[0]], chain[0]))


def _connected(left: dict[int, list[int]], start: int) -> list[int]:
    seen, todo = {start}, [start]
    while todo:
        fresh = [point for point in left[todo.pop()] if point not in seen]
        seen.update(fresh)
        todo += fresh
    return list(seen)
