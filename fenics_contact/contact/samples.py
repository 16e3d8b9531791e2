"""Facets of a slave surface whose contact is averaged at its nodes, their normals, and the samples on them."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import compress

import basix
import numpy as np

from fenics_contact.contact.master import MasterSurface, area_vectors
from fenics_contact.contact.mirrors import MIRRORED, Mirror, Mirrors, Standing, kept
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.coverage import Ends
from fenics_contact.kernels.mortar import Slaves, sample_places
from fenics_contact.kernels.normals import CREASE, Groups, corner_angles, group_normals, group_slots, grouped_corners
from fenics_contact.kernels.quadratic import STRIP, quadratic_shape
from fenics_contact.kernels.segments import Joined, Rule, Rules, Sites, facet_parts
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64

FEWEST, MOST = 3, 6  # samples per direction of a facet that is not cut into parts
PER_FACET = 2.0  # of them, for each facet of a finer master that it covers
LINEAR, QUADRATIC = 2, 4  # samples per direction of parts: products of shape functions there are of that degree and one more
RINGS = {
    3: np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    4: np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]),
}
PLACES = {  # of the nodes of facets, by their number and that of corners, in the order of kernels/quadratic.py
    (3, 3): RINGS[3],
    (4, 4): RINGS[4],
    (6, 3): np.array([*RINGS[3], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]]),
    (6, 4): np.array([*RINGS[4], [0.0, -1.0], [0.0, 1.0]]),
    (9, 4): np.array([*RINGS[4], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, 0.0]]),
}
ROUNDED = 1e-13  # of an area: what sums leave
# (np, 2), (nf, m): parts of their facets' tangents in what is added to the normals of samples, and how much of it where
# each corner presses
Steered = tuple[Floats, Floats]
SHARP = 8.0  # over the longest side around a node: of gaps that differ by a tenth of it one counts half as much as the other
NEAREST = 1.8  # of a sample's distance from the border of its facet: the way on which it leaves the master


class NodeNormals:
    """Normals in the nodes of facets: means over those around that no crease parts.

    X (nx, 3): of the reference; nodes (nf, k) of the facets, of which so many are corners, first; gradients (k, 2, k) of
    their shape functions in the nodes; wanted (nf,): which are asked for; mirrors: planes of symmetry, with the nodes on
    them. groups: as in kernels/normals.py; group (nf, k): that of each node.
    """

    def __init__(
        self, X: Floats, nodes: Ints64, corners: int, gradients: Floats, wanted: Bools, mirrors: Sequence[Mirror]
    ) -> None:
        self._facets, self.group = (nodes, gradients), np.empty(nodes.shape, dtype=np.int64)
        where = grouped_corners(X, *self._facets, wanted, np.cos(np.radians(CREASE)), self.group)
        angles = corner_angles(X, nodes, corners, *where[1:])
        alone = np.tile(np.eye(3), (len(where[0]) - 1, 1, 1))
        self.groups: Groups = *where, *group_slots(*where, *self._facets), angles, alone
        at, here, self._known = np.empty(len(alone), dtype=np.int64), self.group >= 0, {(False,) * len(mirrors): alone}
        at[self.group[here]] = nodes[here]  # nodes without an area have groups of no facets
        self._mirrors, self._drawn = [(normal, on[at]) for normal, on in mirrors], self(X, (False,) * len(mirrors))[0]

    def kept(self, standing: Standing) -> Floats:
        """What stays (ng, 3, 3) of the sums of groups with their images behind these planes."""
        if standing not in self._known:
            self._known[standing] = kept(self._drawn, list(compress(self._mirrors, standing)))
        return self._known[standing]

    def __call__(self, coords: Floats, standing: Standing) -> tuple[Floats, Floats]:
        """Unit normals (ng, 3) of the groups and their turns (ns, 3, 4), with nodes at coords (nx, 3); standing: planes of
        symmetry there."""
        normals, turns = np.empty((len(self.groups[0]) - 1, 3)), np.empty((len(self.groups[4]), 3, 4))
        groups = *self.groups[:7], self.kept(standing)
        group_normals(coords, *self._facets, groups, normals, turns)
        return normals, turns


class SlaveFacets:
    """Facets of a slave surface that this process evaluates, those around its own nodes, and their normals.

    own (ns,): the nodes of this process that have pressures, those of corners, where a crease parts the facets around one
    once for each part: what presses on one side of an edge may be far off on the other, and a mean over both would say of
    neither what it does; of (ns,): their numbers without that; nodes (nf, k), corners (nf, m) of the facets; number (nf, m):
    the own node at each corner, or -1; starts (ns + 1,), facets, places (ne,): where each own node is a
    corner; groups, group (nf, k): normals in the nodes, as the kernels take them; whole: samples of facets that nothing
    crosses; parts (nf, m): what each corner has of its facet's reference area [length^2]; heights (nf, m, m): `_heights` in
    the reference; nearest: the least one of the FEWEST samples in a unit facet; tips (nf, m): which corners are ends or
    creases of the surface; held: ways (n, 3, 3) that supports leave the nodes, by rows, and the planes of symmetry of
    both surfaces; joined (nx,): which nodes of the surface the master has, too. Collective.
    """

    def __init__(self, skin: MasterSurface, count: int, held: tuple[Array, Mirrors], joined: Bools) -> None:
        self._skin = skin
        (nodes, size), (flat, around) = skin.facets, skin.corners
        m = int(around[0]) if len(around) else 4
        every = nodes if skin.whole else np.ascontiguousarray(nodes[:, :m])
        ends = flat[:, :m]
        self.own = np.unique(ends[(ends >= skin.mine.start) & (ends < skin.mine.stop)])
        own = np.isin(ends, self.own)
        mine = own.any(axis=1)
        self.nodes, self.corners = np.ascontiguousarray(every[mine]), np.ascontiguousarray(ends[mine])
        self._size = int(size[0]) if len(size) else m
        free, mirrors = held
        self.normals = NodeNormals(skin.X, every, m, self.shapes(PLACES[every.shape[1], m])[1], mine, mirrors.slave)
        self.groups, self.group = self.normals.groups, np.ascontiguousarray(self.normals.group[mine])
        here, self.number = own[mine], np.full(self.corners.shape, -1)
        pairs = np.column_stack(
            [np.searchsorted(self.own, self.corners[here]), _sides(self.groups)[self.group[:, :m][here]]]
        )
        pairs, number = np.unique(pairs, axis=0, return_inverse=True)
        self.number[here], self.of = number.ravel(), pairs[:, 0]
        self.own = self.own[self.of]
        f, c = np.nonzero(self.number >= 0)
        order = np.argsort(self.number[f, c], kind="stable")
        self.facets, self.places, owner = f[order], c[order], self.number[f, c][order]
        self.starts = np.searchsorted(owner, np.arange(len(self.own) + 1))
        first = self.starts[:-1]  # all of a node's facets lie on the same side of its creases
        self._kept_of = self.group[self.facets[first], self.places[first]]
        part = QUADRATIC if skin.whole else LINEAR
        # of a strip, which is the same all the way across, one across it; near nodes alone have pressures, far ones the same
        strip = skin.section is not None
        rule, nf = gauss(m, count, 1 if strip else count), len(self.nodes)
        self._rules: Rules = gauss(4, part, 1 if strip else part), gauss(3, part), rule, not skin.whole
        (places, weights), n = rule, len(rule[1])
        self.whole: Sites = n * np.arange(nf + 1), np.tile(places, (nf, 1)), np.tile(weights, nf)
        self._room = len(self.whole[2])  # for samples
        N, area = corner_shapes(m, places)[0], self.areas(np.repeat(np.arange(nf), n), *self.whole[1:]).reshape(nf, n)
        self.parts, self.heights = area @ N, _heights(skin.X[self.corners])
        self.sharp = self._sharp() if skin.whole else np.empty(0)
        self.tips = np.isin(self.corners, self._ends(free[self.of])) & ~joined[self.corners]  # there it goes on
        few = corner_shapes(m, gauss(m, FEWEST, 1 if strip else FEWEST)[0])[0]
        self.nearest = np.einsum("ic,qc->qi", _heights(RINGS[m][None, :, [0, 1, 1]] * [1.0, 1.0, 0.0])[0], few).min()

    def _sharp(self) -> Floats:
        """Of own nodes (ns,), see kernels/sharp_means.py [1/length], by the longest side around them: over that gaps
        vary, of thin layers and beside small facets, too."""
        x = self._skin.X[self.corners]
        sides = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=2)
        most = (sides[:, ::2] if self._skin.section is not None else sides).max(axis=1)
        return SHARP / np.maximum.reduceat(most[self.facets], self.starts[:-1]) if len(self.own) else np.empty(0)

    def kept(self, standing: Standing) -> Floats:
        """What counts (ns, 3, 3) of the nodes' mean ways, as of Slaves, where these are planes of symmetry."""
        return self.normals.kept(standing)[self._kept_of]

    def parted(self, surface: SlaveSurface) -> SlaveSurface:
        """The nodes of a surface as they are here, with their parts of the area. Collective."""
        of, here, comm = self.of, self.number >= 0, self._skin.comm
        area = np.bincount(self.number[here], self.parts[here], len(of))
        part = (area / np.bincount(of, area, len(surface.area))[of])[:, None]
        side = np.arange(len(of)) - np.searchsorted(of, of)
        key = surface.key[of] + side * (1 + max(comm.allgather(surface.key.max(initial=0))))
        names = "nodes", "a", "area", "X", "stiffness", "height", "spacing", "cut_off"
        out = replace(surface, key=key, **{name: getattr(surface, name)[of] for name in names})
        return replace(out, area=part * out.area)

    def at_corners(self, values: Floats) -> Floats:
        """Values (nf, m, v) at the facets' corners, of those (ns, v) of all processes' own nodes, else zero, as at the far
        side of a strip; beyond a crease on another process it may be that of its other side. Collective."""
        out, parts = np.asarray(values[self.number], dtype=float), self._skin.comm.allgather((self.own, values))
        own, theirs = (np.concatenate(part) for part in zip(*parts, strict=True))
        out[self.number < 0] = 0.0
        nodes, first = np.unique(own, return_index=True)
        elsewhere = (self.number < 0) & np.isin(self.corners, nodes)
        out[elsewhere] = theirs[first[np.searchsorted(nodes, self.corners[elsewhere])]]
        return out

    def shapes(self, places: Floats) -> tuple[Floats, Floats]:
        """Shape functions (nq, k) of the facets' nodes and their gradients (nq, 2, k) at places (nq, 2)."""
        if not self._skin.whole:
            return corner_shapes(self.corners.shape[1], places)
        out = np.zeros((len(places), 3, self._size + 1 if self._size == STRIP else self._size))
        for i, (s, t) in enumerate(places):
            quadratic_shape(self._size, s, t, out[i])
        return np.ascontiguousarray(out[:, 0]), np.ascontiguousarray(out[:, 1:])

    def areas(self, facet: Ints, places: Floats, weights: Floats) -> Floats:
        """Reference areas (np,) [length^2] of samples of facets at places, with weights there; half a strip's is that of its
        near nodes."""
        (shapes, gradients), X = self.shapes(places), self._skin.X[self.nodes[facet]]
        tangents = np.einsum("qti,qic->qtc", gradients, X)
        area = np.linalg.norm(np.cross(tangents[:, 0], tangents[:, 1]), axis=1) * weights
        if (section := self._skin.section) is not None:
            area *= 2.0 * section.depth(np.einsum("qi,qic->qc", shapes, X)) / np.linalg.norm(2.0 * tangents[:, 1], axis=1)
        return area

    def crossed(self, coords: Floats, normals: Floats, master: Joined, search: float) -> Sites:
        """Samples where edges of facets of the master, no farther off than search [length], cross those of the slave at
        positions coords (nx, 3); normals (ng, 3) of the groups."""
        around = candidates(coords[self.corners].mean(axis=1), coords, *master[0], search + self._skin.longest)
        near, mean = (around, search), normals[self.group].sum(axis=1)
        slave = self.corners, unit(mean)
        first, kernel = np.empty(len(self.nodes) + 1, dtype=np.int64), (coords, slave, master, near, self._rules)
        while True:
            places, weights = np.empty((self._room, 2)), np.empty(self._room)
            count = facet_parts(*kernel, (first, places, weights))
            if count <= self._room:
                return first, places[:count], weights[:count]
            self._room = count

    def most(self, here: int) -> int:
        """The greatest such number of all processes. Collective."""
        return max(self._skin.comm.allgather(here))

    def unpacked(self, values: Floats) -> tuple[Sites, Steered | None]:
        """Those that `Samples.packed` gave."""
        _, entry = np.unique(self.facets, return_index=True)  # of one own node each
        node = np.searchsorted(self.starts, entry, side="right") - 1
        on = values[node, :, 0] == (entry - self.starts[node])[:, None]
        _, s, t, weights, *turns = values[node][on].T[:6]
        sites = np.append(0, np.cumsum(on.sum(axis=1))), np.column_stack([s, t]), np.ascontiguousarray(weights)
        if not turns:
            return sites, None
        row, column = np.nonzero(values[..., 0] >= 0)
        at, shares = self.starts[row] + values[row, column, 0].astype(int), np.zeros(self.corners.shape)
        shares[self.facets[at], self.places[at]] = values[row, column, 6]
        return sites, (np.column_stack(turns), shares)

    def _ends(self, free: Array) -> Ints:
        """The surface's nodes where it ends or has a crease; creases of the facets around this rank's own nodes. Where
        supports let end nodes (ns, 3, 3) go no way across an end, as at a plane of symmetry, it goes on:
        facets of round sides lean by half of what they turn there. Collective."""
        skin, ring = self._skin, self._skin.corners[0]
        ways, n = np.tile(np.eye(3), (len(skin.X), 1, 1)), len(skin.moving)
        for own, theirs in skin.comm.allgather((self.own, free)):
            ways[own] = theirs
        ways[n:] = ways[:n][: len(ways) - n]  # far nodes of strips are the near ones
        sides = [1, 3] if skin.section is not None else range(4)  # a strip has no ends across
        pairs = np.concatenate([ring[:, [i, (i + 1) % 4]] for i in sides])
        out = np.tile(area_vectors(skin.X[ring]), (len(sides), 1))
        across = unit(np.cross(skin.X[pairs[:, 1]] - skin.X[pairs[:, 0]], out))
        _, where, times = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True, return_counts=True)
        moves = np.linalg.norm(np.einsum("eifc,ec->eif", ways[pairs], across), axis=2).max(axis=1, initial=0.0)
        ends = (pairs[:, 0] != pairs[:, 1]) & (times[where.ravel()] == 1) & (moves > MIRRORED)
        group = self.group[:, : self.corners.shape[1]]
        normals = np.unique(np.column_stack([self.corners.ravel(), group.ravel()]), axis=0)
        nodes, several = np.unique(normals[:, 0], return_counts=True)
        return np.union1d(pairs[ends], nodes[several > 1])


def _sides(groups: Groups) -> Ints64:
    """For each group the first of those that lie on the same side of all creases: they share facets at their node, or with
    others that do."""
    starts, facets, places = groups[:3]
    group = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    _, corner = np.unique(np.column_stack([facets, places]), axis=0, return_inverse=True)
    corner, out = corner.ravel(), np.arange(len(starts) - 1)
    while True:
        before, least = out.copy(), np.full(len(group), len(out))
        np.minimum.at(least, corner, out[group])
        np.minimum.at(out, group, least[corner])
        if np.array_equal(out, before):
            return out


class Samples:
    """Samples of slave facets, held within a step. Made on all processes at once.

    sites: on their facets; slaves: as the kernels take them; rims (np,): the ways on which samples leave the master, over
    their facets' size along them; table, corner (ns, J): samples around each own node and its corner's place among those of
    their facet, -1 where there are fewer; share (ns, J): what they have of the node's area [length^2]; anchor (ns, J): where
    they have theirs; steered: None: they press along their normals; ends: where the master ends for them.
    """

    def __init__(self, around: SlaveFacets, sites: Sites, ends: Ends, steered: Steered | None = None) -> None:
        (first, places, weights), self.sites, self.ends = sites, sites, ends
        facet, m = np.repeat(np.arange(len(around.nodes)), np.diff(first)), around.corners.shape[1]
        (N, _), (shape, self._gradients) = corner_shapes(m, places), around.shapes(places)
        area = _weighed(around, facet, N, around.areas(facet, places, weights))
        where = around.nodes, around.group, around.starts, around.facets, around.places
        nothing = np.zeros((0, shape.shape[1])), np.zeros(around.corners.shape)
        self.slaves = Slaves(*where, first, facet, area, shape, N, *nothing, np.empty((0, 3, 3)), around.sharp)
        self._steer(steered)
        self.corners = np.ascontiguousarray(around.corners[facet])
        # samples of surfaces that end together are covered whole: those nearest to the border, and a little more; but where
        # more samples lie nearer, as those of degree 2 do, shares that fell on their way alone would hardly be gradual:
        # Newton's method would cycle
        self.rims = NEAREST * np.minimum(np.einsum("qic,qc->qi", around.heights[facet], N).min(axis=1), around.nearest)
        counts = np.diff(first)[around.facets]
        node = np.repeat(np.arange(len(around.own)), np.diff(around.starts))
        before = np.cumsum(counts) - counts  # of all parts that samples have in nodes, those around the nodes before
        row, at = np.repeat(node, counts), np.arange(counts.sum())
        column = at - np.append(before, 0)[around.starts[:-1]][row]
        most = around.most(int(column.max(initial=-1)) + 1)
        self.table, self.corner = np.full((2, len(around.own), most), -1)
        self.table[row, column] = np.repeat(first[around.facets] - before, counts) + at
        self.corner[row, column] = np.repeat(around.places, counts)
        self.share = np.where(self.table < 0, 0.0, area[self.table] * N[self.table, self.corner])
        self.anchor = np.where(self.table < 0, -1, self.table * m + self.corner)

    @property
    def count(self) -> int:
        return len(self.slaves.facet)

    def at(self, coords: Floats, normals: Floats) -> tuple[Floats, Floats, Floats]:
        """Places (np, 3), unit directions (np, 3) into the slave and lengths (np,) of the mean normals that these have, with
        nodes at coords (nx, 3) and normals (ng, 3) of the groups."""
        out = np.empty((self.count, 3)), np.empty((self.count, 3)), np.empty(self.count)
        sample_places(coords, self.slaves, normals, *out)
        return out

    def _steer(self, steered: Steered | None) -> None:
        self.steered = steered
        if steered is not None:
            turned, shares = steered
            self.slaves = self.slaves._replace(aside=np.einsum("qa,qai->qi", turned, self._gradients), leans=shares)

    def fitted(self, coords: Floats, aside: Floats, some: Bools) -> Floats:
        """Parts (nf, m, 2) of facets' tangents, by their corners, that give best what is given at some of the samples, aside
        (np, 3), with nodes at coords (nx, 3): as much of it as lies in their facets."""
        facet, N = self.slaves.facet, self.slaves.N * some[:, None]
        tangents = np.einsum("qai,qic->qac", self._gradients, coords[self.slaves.nodes[facet]])
        metric = np.einsum("qac,qbc->qab", tangents, tangents)
        parts = np.linalg.solve(metric, np.einsum("qac,qc->qa", tangents, aside)[..., None])[..., 0]
        products, sums = (np.zeros((len(self.slaves.nodes), N.shape[1], k)) for k in (N.shape[1], 2))
        weights = self.slaves.weights[:, None, None]
        np.add.at(products, facet, weights * N[:, :, None] * N[:, None])
        np.add.at(sums, facet, weights * N[:, :, None] * parts[:, None])
        return np.asarray(np.linalg.pinv(products, hermitian=True) @ sums)

    def pressing(self, parts: Floats, shares: Floats) -> "Samples":
        """The same samples, that press along their normals and these parts (nf, m, 2) of their facets' tangents, with which
        they turn; shares (nf, m): how much of it where corners press."""
        out = copy(self)
        out._steer((np.einsum("qc,qca->qa", self.slaves.N, parts[self.slaves.facet]), shares))
        return out

    def packed(self) -> Floats:
        """Of the samples around each own node (ns, J, 4 or 7): which of its facets they are on, counted from zero, -1:
        there are no more, place and weight there, and what is `steered`, if anything is. No partition changes it."""
        (first, places, weights), f, c = self.sites, self.slaves.facets, self.slaves.places
        (row, column), columns = np.nonzero(self.table >= 0), 4 if self.steered is None else 7
        out = np.full((*self.table.shape, columns), -1.0)
        entry = np.repeat(np.arange(len(f)), np.diff(first)[f])
        sample = self.table[row, column]
        turned = [] if self.steered is None else [self.steered[0][sample], self.steered[1][f[entry], c[entry]]]
        out[row, column] = np.column_stack([entry - self.slaves.starts[row], places[sample], weights[sample], *turned])
        return out


def samples_for(size: float, master: float) -> int:
    """Samples per direction of facets of a size on a master with facets of another [length]."""
    return min(max(FEWEST, math.ceil(PER_FACET * size / master - 1e-6)), MOST) if master > 0.0 else FEWEST


def _weighed(around: SlaveFacets, facet: Ints, N: Floats, area: Floats) -> Floats:
    """Areas (np,) of samples with shape functions N (np, m) of corners, so changed that each corner has what it has of its
    facet's area: in parts of distorted quadrilaterals a rule integrates that to an error."""
    if not len(area):
        return area
    first = np.searchsorted(facet, np.arange(len(around.nodes)))
    lack = around.parts - np.add.reduceat(N * area[:, None], first)
    some = np.flatnonzero(np.abs(lack).max(axis=1) > ROUNDED * around.parts.max(axis=1))
    if not len(some):
        return area
    products, change = np.add.reduceat(N[:, :, None] * N[:, None] * area[:, None, None], first), np.zeros_like(lack)
    inverse = np.linalg.pinv(products[some], hermitian=True)  # near and far nodes of strips have the same
    change[some] = np.einsum("fab,fb->fa", inverse, lack[some])
    return area * (1.0 + np.einsum("qc,qc->q", N, change[facet]))


def _heights(x: Floats) -> Floats:
    """(nf, m, m): how far from each side of facets with corners x (nf, m, 3) each corner is, over what they measure across
    that side."""
    along = np.roll(x, -1, axis=1) - x
    out = np.cross(along, np.cross(along, along[:, [-1, *range(x.shape[1] - 1)]]))  # from each side into the facet
    heights = np.einsum("fic,fjc->fij", out, x)
    heights -= np.diagonal(heights, axis1=1, axis2=2)[:, :, None]
    return heights / np.ptp(heights, axis=2)[:, :, None]


def gauss(m: int, count: int, across: int = 0) -> Rule:
    """Places (nq, 2) and weights (nq,) of facets with m corners: count Gauss points along the first side and across it (0:
    as many), on triangles what integrates polynomials as far."""
    if m == 3:
        return basix.make_quadrature(basix.CellType.triangle, 2 * count - 1)
    (s, w), (t, v) = (basix.make_quadrature(basix.CellType.interval, 2 * n - 1) for n in (count, across or count))
    places = 2.0 * np.stack(np.meshgrid(s, t, indexing="ij"), axis=-1).reshape(-1, 2) - 1.0
    return places, 4.0 * np.outer(w, v).ravel()


def corner_shapes(m: int, places: Floats) -> tuple[Floats, Floats]:
    """Shape functions (nq, m) of a facet's corners, which run counter-clockwise, and their gradients (nq, 2, m)."""
    ring = RINGS[m]
    if m == 3:
        N = np.column_stack([1.0 - places.sum(axis=1), places])
        return N, np.tile([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (len(places), 1, 1))
    one, two = (1.0 + places[:, None, i] * ring[:, i] for i in (0, 1))
    return 0.25 * one * two, np.stack([0.25 * ring[:, 0] * two, 0.25 * ring[:, 1] * one], axis=1)
