"""Cells that lie on or in others without sharing nodes: faces drawn twice, and parts that touch or overlap."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.sets import join
from fenics_contact.types import Array, Floats, Ints64

Side = tuple[str, tuple[str, ...]]  # a volume and its surface groups

_SAME_PLACE = 1e-8  # of the model's size: gmsh's own measure in removeDuplicateNodes, so that this remedy helps


@dataclass(frozen=True)
class Meeting:
    """Faces of cells that meet what shares no nodes with them: how many, the middle of the first, and the groups of either
    side; of cells that a face touches or lies in only the volume is known."""

    count: int
    place: tuple[float, ...]
    volumes: tuple[str, ...]
    surfaces: tuple[tuple[str, ...], ...]


def key(nodes: Ints64) -> Array:
    """A number per row of nodes (n, k), the same for the same nodes in any order.

    The sum of their hashes (splitmix64): of a million rows two are alike by chance once in ten million meshes, and rows
    are compared a hundred times faster than node by node.
    """
    x = np.asarray(nodes).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (x ^ (x >> np.uint64(31))).sum(axis=1, dtype=np.uint64)


def meetings(
    X: Floats, cells: Ints64, shape: Ints64, face_keys: Array, groups_of: Callable[[int], Side]
) -> tuple[tuple[Meeting, ...], tuple[Meeting, ...]]:
    """(Meetings of faces that lie on one another, of faces that touch or lie in cells of another part).

    X (n, 3): nodes [length]; cells (m, k): their corners; shape (f, j): corners of a cell's faces; face_keys (m f,);
    groups_of(face): its volume and its surface groups.
    """
    faces = cells[:, shape].reshape(-1, shape.shape[1])
    _, first, count = np.unique(face_keys, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])  # faces with a cell on one side only
    tolerance = _SAME_PLACE * float(np.linalg.norm(np.ptp(X, axis=0)))
    pairs = _twins(faces[outer], X, tolerance)
    doubled = _gathered(X, faces, outer[pairs], lambda a, b: tuple(sorted((groups_of(a), groups_of(b)))))
    single = np.setdiff1d(outer, outer[pairs])
    touching = _inside(X, cells, shape, single, tolerance)
    return doubled, _gathered(X, faces, touching, lambda a, cell: (groups_of(a), (groups_of(cell * len(shape))[0], ())))


def _gathered(
    X: Floats, faces: Ints64, pairs: Ints64, sides_of: Callable[[int, int], tuple[Side, ...]]
) -> tuple[Meeting, ...]:
    """Meetings of pairs (n, 2), the first of each a face, by the (volume, surfaces) of both sides."""
    found: dict[tuple[Side, ...], list[int]] = {}
    for a, b in pairs.tolist():
        found.setdefault(sides_of(a, b), []).append(a)
    return tuple(
        Meeting(len(those), tuple(X[faces[those[0]]].mean(axis=0).tolist()), *zip(*sides, strict=True))
        for sides, those in found.items()
    )


def _twins(faces: Ints64, X: Floats, tolerance: float) -> Ints64:
    """Pairs (n, 2) of outer faces, by their rows, whose nodes lie in the same places, in the order of the cells."""
    known = np.unique(faces)
    place = _same_place(X[known], tolerance)
    nodes = place[np.searchsorted(known, faces)]
    shared = np.flatnonzero((np.bincount(place, minlength=len(place)) > 1)[nodes].all(axis=1))
    keys = key(nodes[shared] + 1)
    order = np.argsort(keys, kind="stable")
    i = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    pairs = np.column_stack([order[i], order[i + 1]])
    return shared[pairs[np.argsort(pairs[:, 0])]]


def _same_place(X: Floats, tolerance: float) -> Ints64:
    """For every point (n, 3) the lowest number of those in its place."""
    along = X @ [0.5377, 0.6180, 0.5734]  # a direction in which points of a lattice rarely lie side by side
    order, label = np.argsort(along), np.arange(len(X))
    for step in range(1, len(X)):
        near = np.flatnonzero(along[order[step:]] - along[order[:-step]] <= tolerance)
        if not len(near):
            break
        a, b = order[near], order[near + step]
        same = np.abs(X[a] - X[b]).max(axis=1) <= tolerance
        np.minimum.at(label, a[same], b[same])
        np.minimum.at(label, b[same], a[same])
    return label


def _inside(X: Floats, cells: Ints64, shape: Ints64, faces: Ints64, tolerance: float) -> Ints64:
    """Pairs (n, 2) of a face whose middle lies on or in a cell of another part of the mesh, and the first such cell."""
    part = np.arange(len(X))
    join(cells.astype(np.int64), part)
    part = part[cells[:, 0]]
    if (part == part[0]).all():
        return np.empty((0, 2), dtype=np.int64)
    own, which = np.divmod(faces, len(shape))
    middles = X[cells[own[:, None], shape[which]]].mean(axis=1)
    size = np.full(len(cells), cells.shape[1])
    offsets, near = candidates(middles, X, cells.astype(np.int64), size, tolerance)
    point = np.repeat(np.arange(len(middles)), np.diff(offsets))
    other = part[near] != part[own[point]]
    point, near = point[other], near[other]
    within = np.ones(len(near), dtype=bool)
    centre = X[cells[near]].mean(axis=1)
    for corners in shape:
        x = X[cells[near][:, corners]]
        plane = x.shape[1] == 2  # sides of plane cells; else of a quadrangle by its diagonals
        across = np.broadcast_to([0.0, 0.0, 1.0], x[:, 0].shape) if plane else x[:, 2] - x[:, 0]
        normal = np.cross(x[:, 1] - x[:, 0 if plane else -1], across)
        away = np.einsum("nc,nc->n", normal, x.mean(axis=1) - centre)
        normal *= np.copysign(1.0 / np.linalg.norm(normal, axis=1), away)[:, None]
        within &= np.einsum("nc,nc->n", normal, middles[point] - x.mean(axis=1)) <= tolerance
    point, at = np.unique(point[within], return_index=True)
    return np.column_stack([faces[point], near[within][at]])
