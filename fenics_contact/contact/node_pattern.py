"""Which blocks of the matrix contact averaged at slave nodes fills: provided for before they are needed, and filled."""

from collections.abc import Callable

import numpy as np

from fenics_contact.contact.pair_pattern import PairPattern
from fenics_contact.contact.samples import Samples
from fenics_contact.kernels.couplings import coupled_pairs, lists_lack, unique_pairs
from fenics_contact.types import Array, Bools, Floats, Ints64


class NodePattern:
    """Couplings between all nodes that the traction of a slave node depends on, with those that it acts on.

    samples: of the slave's facets; corners (nf, l): nodes of the master's; blocks (nx,): the block of each node, of `count`.
    """

    def __init__(self, samples: Samples, corners: Ints64, blocks: Ints64, count: int) -> None:
        self._samples, self._corners, self._blocks, self._count = samples, corners, blocks, count
        self._pairs = PairPattern(np.empty((0, 1), dtype=np.int64), corners, blocks, count)
        self._ring = _rings(samples)
        self._met: tuple[Array, ...] | None = None

    @property
    def keys(self) -> Ints64:
        return self._pairs.keys

    def filled(self, add: Callable[..., int]) -> tuple[Ints64, Ints64, Floats, int]:
        """As PairPattern.filled."""
        return self._pairs.filled(add)

    def suffices(self, closed: Bools, facet: Ints64, anchor_nodes: Ints64, ends: Ints64) -> bool:
        """True while the pattern holds the couplings of all closed nodes (ns,); ends (np, 4) of kernels/coverage.py."""
        now = closed, facet, anchor_nodes, ends
        if self._met and all(np.array_equal(a, b) for a, b in zip(now, self._met, strict=True)):
            return True
        enough = len(self.keys) > 0 or not closed.any()
        if enough and lists_lack(closed, *self._lists(facet, anchor_nodes, ends), self._pairs.arrays):
            return False
        if enough:
            self._met = tuple(part.copy() for part in now)
        return enough

    def _lists(self, facet: Ints64, anchor_nodes: Ints64, ends: Ints64) -> tuple[Ints64, Ints64, Ints64]:
        """Nodes of the slave (ns, k), of the master (ns, l), of anchors and the master's ends (ns, n) around each slave
        node, -1: none."""
        s = self._samples
        met = np.where(s.table < 0, -1, facet[s.table])
        shape = len(self._ring), self._corners.shape[1] * s.table.shape[1]
        masters = np.where((met < 0)[..., None], -1, self._corners[met]).reshape(shape)
        anchors = np.where((s.anchor < 0)[..., None], -1, anchor_nodes[s.anchor]).reshape(shape)
        edges = np.where((s.table < 0)[..., None], -1, ends[s.table, :2]).reshape(len(self._ring), 2 * s.table.shape[1])
        return self._ring, masters, np.concatenate([anchors, edges], axis=1)

    def provide(
        self, offsets: Ints64, facets: Ints64, closed: Bools, facet: Ints64, anchor_nodes: Ints64, ends: Ints64
    ) -> None:
        """Renew the pattern: slave nodes with the facets of the samples' CSR lists around them and those that they meet."""
        s, n = self._samples, len(self._ring)
        owner, place = np.nonzero(s.table >= 0)
        sample = s.table[owner, place]
        counts = np.diff(offsets)[sample]
        at = np.repeat(offsets[sample] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        met = facet[sample] >= 0
        pairs = np.concatenate([
            np.column_stack([np.repeat(owner, counts), facets[at]]),
            np.column_stack([owner[met], facet[sample][met]]),
        ])  # fmt: skip
        pairs = np.unique(pairs, axis=0)
        starts = np.searchsorted(pairs[:, 0], np.arange(n + 1))
        ring = np.where(self._ring < 0, self._ring[:, :1], self._ring)
        anchors = self._lists(facet, anchor_nodes, ends)[2]
        anchors = np.where(anchors < 0, ring[:, :1], anchors)
        lists = starts, np.ascontiguousarray(pairs[:, 1]), ring, self._corners, anchors
        none = np.empty(0, dtype=np.int64)
        heads, tails = (np.empty(coupled_pairs(*lists, none, none) if n else 0, dtype=np.int64) for _ in "rc")
        if len(heads):
            coupled_pairs(*lists, heads, tails)
        rows, columns = unique_pairs(heads, tails, len(self._blocks))
        self._pairs.set(np.unique(self._blocks[rows] * self._count + self._blocks[columns]))
        self._met = closed.copy(), facet.copy(), anchor_nodes.copy(), ends.copy()


def _rings(samples: Samples) -> Ints64:
    """Nodes (ns, k) of the facets around each slave node and of those that their normals depend on, -1: no more."""
    first, facets = samples.slaves[5], samples.slaves[6]
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    slot_starts, slot_nodes = samples.groups[3], samples.groups[4]
    group = samples.slaves[4][facets].ravel()
    owners = np.repeat(owner, samples.slaves[4].shape[1])
    counts = slot_starts[group + 1] - slot_starts[group]
    at = np.repeat(slot_starts[group] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    nodes = samples.nodes[facets]
    pairs = np.concatenate([
        np.column_stack([np.repeat(owner, nodes.shape[1]), nodes.ravel()]),
        np.column_stack([np.repeat(owners, counts), slot_nodes[at]]),
    ])  # fmt: skip
    pairs = np.unique(pairs, axis=0)
    starts = np.searchsorted(pairs[:, 0], np.arange(len(first)))
    ring = np.full((len(first) - 1, int(np.diff(starts).max(initial=0))), -1)
    ring[pairs[:, 0], np.arange(len(pairs)) - starts[pairs[:, 0]]] = pairs[:, 1]
    return ring
