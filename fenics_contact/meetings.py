"""Cells that lie on or in others beside the nodes they share: faces drawn twice, sides of three cells, what overlaps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.sets import join
from fenics_contact.types import Array, Floats, Ints64

Side = tuple[str, tuple[str, ...]]  # a volume and its surface groups
Reaches = Callable[[Ints64, Ints64], Array]

_SAME_PLACE = 1e-8  # of the model's size: gmsh's own measure in removeDuplicateNodes, so that this remedy helps
_OPPOSITE = 0.99  # cosine, 8 degrees: sides whose normals are that opposite lie on one another, and do not touch by an edge
_ALONG = 1e-6  # cosine: what is across a face as far as the digits of a file say
_COLLAPSED = 1e-8  # sine between a quadrangle's diagonals, or a triangle's sides: it is a line


@dataclass(frozen=True)
class Mismatch:
    """Faces of cells that meet what does not have all of their nodes: how many, the middle of the first, and the groups of
    either side; of cells that a face touches or lies in only the volume is known."""

    count: int
    place: tuple[float, ...]
    volumes: tuple[str, ...]
    surfaces: tuple[tuple[str, ...], ...]


def key(nodes: Ints64) -> Array:
    """A number per row of nodes (n, k), the same for the same nodes in any order.

    The sum of their hashes (splitmix64): of a million rows two are alike by chance once in ten million meshes, and rows
    are compared a hundred times faster than node by node.
    """
    return hashes(nodes).sum(axis=1, dtype=np.uint64)


def hashes(nodes: Ints64) -> Array:
    """A number per node, from 1 on, of which those of no two sets of nodes are likely to have the same sum."""
    x = np.asarray(nodes).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def place_of(x: Floats) -> str:
    """A place (3,) as text."""
    return "({:.4g}, {:.4g}, {:.4g})".format(*x)


def meetings(
    X: Floats, cells: Ints64, shape: Ints64, face_keys: Array, groups_of: Callable[[int], Side], reaches: Reaches
) -> tuple[tuple[Mismatch, ...], tuple[Mismatch, ...]]:
    """(Meetings of faces that lie on one another, of faces that touch or lie in other cells).

    X (n, 3): nodes [length]; cells (m, k): their corners; shape (f, j): corners of a cell's faces; face_keys (m f,);
    groups_of(face): its volume and its surface groups; reaches(faces, cells): whether the middles of faces lie in cells as
    they are curved, where they do by corners alone. ValueError for faces of more than two cells.
    """
    faces = cells[:, shape].reshape(-1, shape.shape[1])
    _, first, count = np.unique(face_keys, return_index=True, return_counts=True)
    _refuse_crowded(faces[np.sort(first[count > 2])], X)
    outer = np.sort(first[count == 1])  # faces with a cell on one side only
    tolerance = _SAME_PLACE * float(np.linalg.norm(np.ptp(X, axis=0)))
    pairs = _twins(faces[outer], X, tolerance)
    doubled = _gathered(X, faces, outer[pairs], lambda a, b: tuple(sorted((groups_of(a), groups_of(b)))))
    single = np.setdiff1d(outer, outer[pairs])
    touching = _inside(X, cells, shape, single, tolerance)
    touching = touching[reaches(*touching.T)]
    touching = touching[np.unique(touching[:, 0], return_index=True)[1]]
    return doubled, _gathered(X, faces, touching, lambda a, cell: (groups_of(a), (groups_of(cell * len(shape))[0], ())))


def joined_by_nodes(cells: Ints64, face_keys: Array, count: int) -> Ints64:
    """Nodes that cells (m, k) share whose parts of the mesh have no face in common; face_keys (m f,), see `key`; count: of
    nodes."""
    order = np.argsort(face_keys, kind="stable")
    alike = np.flatnonzero(face_keys[order[1:]] == face_keys[order[:-1]])
    part = np.arange(len(cells))
    join(np.column_stack([order[alike], order[alike + 1]]) // (len(face_keys) // len(cells)), part)
    least, most = np.full(count, len(cells)), np.full(count, -1)
    np.minimum.at(least, cells, part[:, None])
    np.maximum.at(most, cells, part[:, None])
    return np.flatnonzero(least < most)


def _refuse_crowded(faces: Ints64, X: Floats) -> None:
    """These faces (n, k) have three cells or more: none may be."""
    if len(faces):
        raise ValueError(
            f"sides of cells have more than two cells, {len(faces)} of them, the first at "
            f"{place_of(X[faces[0]].mean(axis=0))}: cells lie on one another there, or the side has collapsed; draw and "
            "mesh each place once"
        )


def _gathered(
    X: Floats, faces: Ints64, pairs: Ints64, sides_of: Callable[[int, int], tuple[Side, ...]]
) -> tuple[Mismatch, ...]:
    """Meetings of pairs (n, 2), the first of each a face, by the (volume, surfaces) of both sides."""
    found: dict[tuple[Side, ...], list[int]] = {}
    for a, b in pairs.tolist():
        found.setdefault(sides_of(a, b), []).append(a)
    return tuple(
        Mismatch(len(those), tuple(X[faces[those[0]]].mean(axis=0).tolist()), *zip(*sides, strict=True))
        for sides, those in found.items()
    )


def _twins(faces: Ints64, X: Floats, tolerance: float) -> Ints64:
    """Pairs (n, 2) of outer faces, by their rows, whose nodes lie in the same places, in the order of the cells."""
    known = np.unique(faces)
    place = _same_place(X[known], tolerance)
    nodes = place[np.searchsorted(known, faces)]
    shared = np.flatnonzero((np.bincount(place, minlength=len(place)) > 1)[nodes].any(axis=1))
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
    """Pairs (n, 2) of a face and a cell not its own that its middle lies on or in, whatever nodes they share; faces rise. Of
    straight cells that meet face to face there is none.

    On a cell's border only where they lie on one another or the cell reaches into the face's own: an edge or a corner may
    touch a face.
    """
    own, which = np.divmod(faces, len(shape))
    corners = X[cells[own[:, None], shape[which]]]
    middles, normals = corners.mean(axis=1), _normals(corners, X[cells[own]].mean(axis=1))
    offsets, near = candidates(middles, X, cells.astype(np.int64), np.full(len(cells), cells.shape[1]), tolerance)
    point = np.repeat(np.arange(len(middles)), np.diff(offsets))
    other = (near != own[point]) & normals[point].any(axis=1)
    point, near = point[other], near[other]
    within, ahead, facing = np.ones(len(near), dtype=bool), np.zeros(len(near), dtype=bool), np.zeros(len(near), dtype=bool)
    centres = X[cells[near]].mean(axis=1)
    for side in shape:
        x = X[cells[near][:, side]]
        normal = _normals(x, centres)
        depth = np.einsum("nc,nc->n", normal, x.mean(axis=1) - middles[point])
        cosine = np.einsum("nc,nc->n", normal, normals[point])
        within &= depth >= -tolerance
        ahead |= (depth <= tolerance) & (cosine < -_ALONG)
        facing |= (depth <= tolerance) & (cosine < -_OPPOSITE)
    met = within & (facing | ~ahead)
    return np.column_stack([faces[point[met]], near[met]])


def _normals(x: Floats, centres: Floats) -> Floats:
    """Unit normals (n, 3) of sides with corners x (n, k, 3), of quadrangles by their diagonals, away from the centres (n, 3)
    of their cells; zero of a side that has collapsed."""
    plane = x.shape[1] == 2
    one = x[:, 1] - x[:, 0 if plane else -1]
    two = np.broadcast_to([0.0, 0.0, 1.0], one.shape) if plane else x[:, 2] - x[:, 0]
    normals = np.cross(one, two)
    length = np.linalg.norm(normals, axis=1)
    flat = length <= _COLLAPSED * np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    away = np.einsum("nc,nc->n", normals, x.mean(axis=1) - centres)
    normals *= (np.copysign(1.0, away) / np.where(flat, np.inf, length))[:, None]
    return normals
