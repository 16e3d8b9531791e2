"""Which blocks of the matrix contact pairs fill: provided for before they are needed, and filled."""

from collections.abc import Callable

import numpy as np

from fenics_contact.kernels.couplings import coupled_pairs, lacks, lists_lack, newly_met, unique_pairs
from fenics_contact.types import Bools, Floats, Ints64


class PairPattern:
    """Couplings between nodes as rising keys row * count + column of their blocks.

    slave_nodes (np, k), corners (nf, m): local nodes of the slave points and of the master's facets; blocks (nx,): the
    block of each local node, of `count` blocks in all.
    """

    def __init__(self, slave_nodes: Ints64, corners: Ints64, blocks: Ints64, count: int) -> None:
        self._slave_nodes, self._corners, self._blocks, self._count = slave_nodes, corners, blocks, count
        self._met = np.full(len(slave_nodes), -2), np.full((len(slave_nodes), corners.shape[1]), -2)
        self.set(np.empty(0, dtype=np.int64))

    def set(self, keys: Ints64) -> None:
        """Take these keys, each once and rising."""
        self.keys = keys
        self.rows, columns = np.divmod(keys, self._count)
        first, end = (np.searchsorted(keys, (self._blocks + more) * self._count) for more in (0, 1))
        self.arrays = self._blocks, first, end, columns
        self._values, self._used = np.zeros((len(keys), 3, 3)), np.zeros(len(keys), dtype=bool)

    def suffices(self, closed: Bools, facet: Ints64, anchor_nodes: Ints64) -> bool:
        """True while the pattern holds the pairs of all closed points (np,)."""
        new = newly_met(closed, facet, anchor_nodes, *self._met)
        if not new.any():
            return True
        if len(self.keys) == 0 or self._lacks(new, facet, anchor_nodes):
            return False
        self._meet(new, facet, anchor_nodes)
        return True

    def _lacks(self, new: Bools, facet: Ints64, anchor_nodes: Ints64) -> bool:
        if self._corners.shape[1] == 4:
            return lacks(new, (self._slave_nodes, self._corners, anchor_nodes), facet, self.arrays)
        return lists_lack(new, self._slave_nodes, self._corners[facet], anchor_nodes, self.arrays)

    def _meet(self, which: Bools, facet: Ints64, anchor_nodes: Ints64) -> None:
        self._met[0][which], self._met[1][which] = facet[which], anchor_nodes[which]

    def provide(self, offsets: Ints64, facets: Ints64, closed: Bools, facet: Ints64, anchor_nodes: Ints64) -> None:
        """Renew the pattern: slave points with the facets of CSR lists, and closed ones (np,) with theirs."""
        added = np.cumsum(np.concatenate([[0], closed]))
        facets = np.insert(facets, offsets[:-1][closed], facet[closed])
        lists = (offsets + added, facets), (self._slave_nodes, self._corners, anchor_nodes)
        none = np.empty(0, dtype=np.int64)
        heads, tails = (np.empty(coupled_pairs(*lists, none, none) if len(offsets) > 1 else 0, dtype=np.int64) for _ in "rc")
        if len(heads):
            coupled_pairs(*lists, heads, tails)
        rows, columns = unique_pairs(heads, tails, len(self._blocks))
        self.set(np.sort(self._blocks[rows] * self._count + self._blocks[columns]))
        self._met[0][:] = -2  # pairs of points that are open now may be in the old pattern only
        self._meet(closed, facet, anchor_nodes)

    def filled(self, add: Callable[..., int]) -> tuple[Ints64, Ints64, Floats, int]:
        """(rows (n,), rising, columns (n,), blocks (n, 3, 3), couplings missed) of add(pattern, (values, used))."""
        missing = add(self.arrays, (self._values, self._used))
        places = np.flatnonzero(self._used)
        values = self._values[places]
        self._values[places], self._used[places] = 0.0, False
        return self.rows[places], self.arrays[3][places], values, missing
