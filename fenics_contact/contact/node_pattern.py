"""Which blocks of the matrix contact averaged at slave nodes fills: provided for before they are needed."""

from collections.abc import Callable

import numpy as np

from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.samples import Samples, SlaveFacets
from fenics_contact.kernels import mortar_patches as kernel
from fenics_contact.kernels.closest_point import Lists
from fenics_contact.kernels.couplings import coupled_pairs, unique_pairs
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.mortar import Anchors
from fenics_contact.types import Bools, Floats, Ints64


class NodePattern:
    """Couplings between all nodes that the traction of a slave node depends on, with those that it acts on.

    around: the slave's facets; facets: the master's, of l nodes; numbers (nx,): the block of each node, of `count`.
    keys: rising numbers row * count + column of their blocks.
    """

    def __init__(self, around: SlaveFacets, facets: Surface, numbers: Ints64, count: int) -> None:
        self._groups, self._facets, self._count = around.groups, facets, count
        self._numbers, self.blocks = np.unique(numbers, return_inverse=True)  # few of all blocks, counted from zero here
        self._ring = _rings(around)
        self._members = np.empty(0, dtype=np.int64)
        self._out = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty((0, 3, 3))
        self._set(np.empty(0, dtype=np.int64))

    def _set(self, keys: Ints64) -> None:
        self.keys, n = keys, len(self._numbers)
        rows, columns = (np.searchsorted(self._numbers, part) for part in np.divmod(keys, self._count))
        self._rows = np.searchsorted(rows, np.arange(n + 1)), columns
        # of nodes that the pattern is known to suffice for: which they are, and what their samples meet
        self._met: tuple[Samples, Bools, tuple[Ints64, Ints64, Ints64]] | None = None

    @property
    def size(self) -> int:
        """Number of blocks that can be coupled."""
        return len(self._numbers)

    def patches(self, asked: Ints64, feet: MortarFeet, anchors: Anchors, leading: Ints64) -> kernel.Patches:
        """Those of kernels/mortar_patches.py for which something is asked (ns,); leading: as there."""
        felt = leading, self._groups[3], self._groups[4]
        starts, heights = np.empty(len(asked) + 1, dtype=np.int64), np.empty(len(asked), dtype=np.int64)
        where = asked, feet.pairs(self._facets, anchors), felt, self.blocks, self.size
        need = kernel.node_patches(*where, (starts, heights, self._members))
        if need > len(self._members):
            self._members = np.empty(need + need // 4, dtype=np.int64)
            kernel.node_patches(*where, (starts, heights, self._members))
        return starts, heights, self._members[:need]

    def filled(self, add: Callable[[tuple[Ints64, Ints64, Floats]], int]) -> tuple[Ints64, Ints64, Floats]:
        """Rows (n,), rising, columns (n,) and blocks (n, 3, 3) that add(their arrays) fills, with numbers of all blocks; it
        returns how many there are, and is called again where that is more than there is room for."""
        need = add(self._out)
        if need > len(self._out[0]):
            n = need + need // 4
            self._out = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64), np.empty((n, 3, 3))
            add(self._out)
        rows, columns, blocks = self._out
        return self._numbers[rows[:need]], self._numbers[columns[:need]], blocks[:need]

    def suffices(self, closed: Bools, feet: MortarFeet, anchors: Anchors) -> bool:
        """True while the pattern holds the couplings of all closed nodes (ns,)."""
        now, samples, last = (feet.met[0], anchors[0], feet.met[7]), feet.samples, self._met
        asked = closed
        if last is not None and last[0] is samples:
            asked = closed & (~last[1] | kernel.elsewhere(closed & last[1], samples.slaves, now, last[2]))
        if asked.any():
            patches = self.patches(np.where(asked, kernel.ROUGH, 0), feet, anchors, np.empty(0, dtype=np.int64))
            if kernel.patches_lack(patches, *self._rows):
                return False
        self._met = samples, closed, now
        return True

    def provide(self, near: Lists, closed: Bools, feet: MortarFeet, anchors: Anchors) -> None:
        """Renew the pattern: slave nodes with the facets of the samples' CSR lists around them and those that they meet."""
        (offsets, facets), s, n, met = near, feet.samples, len(self._ring), feet.met
        facet, corners, anchor_nodes = met[0], self._facets[0], anchors[0]
        owner, place = np.nonzero(s.table >= 0)
        sample = s.table[owner, place]
        counts = np.diff(offsets)[sample]
        at = np.repeat(offsets[sample] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        seated = facet[sample] >= 0
        pairs = np.concatenate([
            np.column_stack([np.repeat(owner, counts), facets[at]]),
            np.column_stack([owner[seated], facet[sample][seated]]),
        ])  # fmt: skip
        pairs = np.unique(pairs, axis=0)
        starts = np.searchsorted(pairs[:, 0], np.arange(n + 1))
        ring = np.where(self._ring < 0, self._ring[:, :1], self._ring)
        l, most = corners.shape[1], s.table.shape[1]
        trailing = np.where((s.anchor < 0)[..., None], -1, anchor_nodes[s.anchor]).reshape(n, l * most)
        edges = np.where((s.table < 0)[..., None], -1, met[7][s.table, :2]).reshape(n, 2 * most)
        felt = np.concatenate([trailing, edges], axis=1)
        felt = np.where(felt < 0, ring[:, :1], felt)
        lists = (starts, np.ascontiguousarray(pairs[:, 1])), (ring, corners, felt)
        none = np.empty(0, dtype=np.int64)
        heads, tails = (np.empty(coupled_pairs(*lists, none, none) if n else 0, dtype=np.int64) for _ in "rc")
        if len(heads):
            coupled_pairs(*lists, heads, tails)
        rows, columns = (self._numbers[self.blocks[part]] for part in unique_pairs(heads, tails, len(self.blocks)))
        self._set(np.unique(rows * self._count + columns))
        self._met = s, closed, (facet, anchor_nodes, met[7])


def _rings(around: SlaveFacets) -> Ints64:
    """Nodes (ns, k) of the facets around each slave node and of those that their normals depend on, -1: no more."""
    first, facets = around.starts, around.facets
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    slot_starts, slot_nodes = around.groups[3], around.groups[4]
    group = around.group[facets].ravel()
    owners = np.repeat(owner, around.group.shape[1])
    counts = slot_starts[group + 1] - slot_starts[group]
    at = np.repeat(slot_starts[group] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    nodes = around.nodes[facets]
    pairs = np.concatenate([
        np.column_stack([np.repeat(owner, nodes.shape[1]), nodes.ravel()]),
        np.column_stack([np.repeat(owners, counts), slot_nodes[at]]),
    ])  # fmt: skip
    pairs = np.unique(pairs, axis=0)
    starts = np.searchsorted(pairs[:, 0], np.arange(len(first)))
    ring = np.full((len(first) - 1, int(np.diff(starts).max(initial=0))), -1)
    ring[pairs[:, 0], np.arange(len(pairs)) - starts[pairs[:, 0]]] = pairs[:, 1]
    return ring
