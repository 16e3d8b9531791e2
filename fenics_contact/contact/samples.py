"""Samples of a slave surface whose contact is averaged at its nodes: the facets around these, and their normals."""

import math

import basix
import numpy as np

from fenics_contact.contact.master import MasterSurface
from fenics_contact.kernels.mortar import Slaves
from fenics_contact.kernels.normals import CREASE, Groups, corner_angles, group_normals, group_slots, grouped_corners
from fenics_contact.kernels.quadratic import STRIP, quadratic_shape
from fenics_contact.types import Floats, Ints

FEWEST, MOST = 3, 6  # samples of a facet per direction
PER_FACET = 2.0  # samples of a facet per direction, for each facet of a finer master that it covers


class Samples:
    """Facets of a slave surface that this process evaluates, those around its own nodes, with their samples.

    slaves, groups: as the kernels take them; own (ns,): the nodes of this process that have pressures, those of corners;
    number (nf, m): the own node at each corner, or -1; table, corner (ns, J): samples around each own node and its corner's
    place among those of their facet, -1 where there are fewer; nodes (nf, k), corners (nf, m) of the facets; rim: the way on
    which a sample leaves the master, over its facet's size along it.
    """

    def __init__(self, skin: MasterSurface, count: int) -> None:
        self._skin = skin
        (nodes, size), (flat, around) = skin.facets, skin.corners
        m = int(around[0]) if len(around) else 4
        every = nodes if skin.whole else np.ascontiguousarray(nodes[:, :m])
        ends = flat[:, :m]
        self.own = np.unique(ends[(ends >= skin.mine.start) & (ends < skin.mine.stop)])
        own = np.isin(ends, self.own)
        mine = own.any(axis=1)
        self.nodes, self.corners = np.ascontiguousarray(every[mine]), np.ascontiguousarray(ends[mine])
        # of a strip, which is the same all the way across, one across it; near nodes alone have pressures, far ones the same
        places, weights, N, gradients = sampled(m, count, across=count if skin.section is None else 1)
        ring, _, _, at_corners = sampled(m, 0)
        shapes = N
        if skin.whole:
            (shapes, gradients), (_, at_corners) = (_quadratic(int(size[0]), s) for s in (places, ring))
        tangents = np.einsum("qti,fic->fqtc", gradients, skin.X[self.nodes])
        area = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2) * weights
        if skin.section is not None:  # half a strip's area is that of its near nodes
            at = np.einsum("qi,fic->fqc", shapes, skin.X[self.nodes])
            area *= 2.0 * skin.section.depth(at) / np.linalg.norm(2.0 * tangents[:, :, 1], axis=2)
        group = np.empty((len(every), m), dtype=np.int64)
        cosine = np.cos(np.radians(CREASE))
        starts, facets, corners = grouped_corners(skin.X, every, at_corners, mine, cosine, group)
        angles = corner_angles(skin.X, every, m, facets, corners)
        self.groups: Groups = starts, facets, corners, *group_slots(starts, facets, corners, every, at_corners), angles
        self._every, self._at_corners = every, at_corners
        self.number = np.where(own[mine], np.searchsorted(self.own, self.corners), -1)
        f, c = np.nonzero(self.number >= 0)
        order = np.argsort(self.number[f, c], kind="stable")
        f, c, owner = f[order], c[order], self.number[f, c][order]
        n = len(self.own)
        first = np.searchsorted(owner, np.arange(n + 1))
        on = np.ascontiguousarray(area), shapes, N, np.ascontiguousarray(group[mine])
        self.slaves: Slaves = self.nodes, *on, first, f, c
        most = max(skin.comm.allgather(int(np.diff(first).max(initial=0))))
        nq = len(N)
        self.table, self.corner = np.full((n, most * nq), -1), np.full((n, most * nq), -1)
        column = (np.arange(len(owner)) - first[owner])[:, None] * nq + np.arange(nq)
        self.table[owner[:, None], column] = f[:, None] * nq + np.arange(nq)
        self.corner[owner[:, None], column] = c[:, None]
        self.share = np.where(self.table < 0, 0.0, area.ravel()[self.table] * N[self.table % nq, self.corner])
        # samples of surfaces that end together are covered whole: those nearest to the border, and a little more
        aside = N.min(axis=1) if m == 3 else 0.5 * (1.0 - np.abs(places)).min(axis=1)
        self.rim = 1.8 * float(aside.min())
        self.anchor = np.where(self.table < 0, -1, self.table * m + self.corner)

    def ends(self) -> Ints:
        """The surface's nodes where it ends or has a crease; creases of the facets around this rank's own nodes."""
        ring = self._skin.corners[0]
        sides = [1, 3] if self._skin.section is not None else range(4)  # a strip has no ends across
        pairs = np.concatenate([np.sort(ring[:, [i, (i + 1) % 4]], axis=1) for i in sides])
        pairs, times = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0, return_counts=True)
        normals = np.unique(np.column_stack([self.corners.ravel(), self.slaves[4].ravel()]), axis=0)
        nodes, several = np.unique(normals[:, 0], return_counts=True)
        return np.union1d(pairs[times == 1], nodes[several > 1])

    @property
    def count(self) -> int:
        return self.slaves[1].size

    def normals(self, coords: Floats) -> tuple[Floats, Floats]:
        """Unit normals of the groups and their turns."""
        normals, turns = np.empty((len(self.groups[0]) - 1, 3)), np.empty((len(self.groups[4]), 3, 4))
        group_normals(coords, self._every, self._at_corners, self.groups, normals, turns)
        return normals, turns


def _quadratic(size: int, places: Floats) -> tuple[Floats, Floats]:
    """Shape functions (nq, k) and gradients (nq, 2, k) of facets of degree 2 at places (nq, 2)."""
    out = np.zeros((len(places), 3, size + 1 if size == STRIP else size))
    for i, (s, t) in enumerate(places):
        quadratic_shape(size, s, t, out[i])
    return np.ascontiguousarray(out[:, 0]), np.ascontiguousarray(out[:, 1:])


def samples_for(size: float, master: float) -> int:
    """Samples per direction of facets of a size on a master with facets of another [length]."""
    return min(max(FEWEST, math.ceil(PER_FACET * size / master - 1e-6)), MOST) if master > 0.0 else FEWEST


def sampled(m: int, count: int, across: int = 0) -> tuple[Floats, Floats, Floats, Floats]:
    """Places (nq, 2), weights (nq,), shape functions (nq, m) and gradients (nq, 2, m) of facets with m corners, which run
    counter-clockwise: at count Gauss points along the first side and across it (0: as many), or at the corners."""
    if m == 4:
        along = (max(count, 1), max(across or count, 1))
        (s, w), (t, v) = (basix.make_quadrature(basix.CellType.interval, 2 * n - 1) for n in along)
        s, w = 2.0 * np.stack(np.meshgrid(s, t, indexing="ij"), axis=-1).reshape(-1, 2) - 1.0, 4.0 * np.outer(w, v).ravel()
        ring = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        s = s if count else ring
        one, two = (1.0 + s[:, None, i] * ring[:, i] for i in (0, 1))
        gradients = np.stack([0.25 * ring[:, 0] * two, 0.25 * ring[:, 1] * one], axis=1)
        return s, w, 0.25 * one * two, gradients
    s, w = basix.make_quadrature(basix.CellType.triangle, 2 * max(count, 1) - 1)
    s = s if count else np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    N = np.column_stack([1.0 - s.sum(axis=1), s])
    return s, w, N, np.tile([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (len(s), 1, 1))
