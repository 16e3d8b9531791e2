"""Nodes with axes of their own: supports along any direction become prescribed components there, exactly."""

import numpy as np

from fenics_contact.assembly.change import Change, node_rows
from fenics_contact.types import Bools, Floats, Ints64, Space

# Sine of the angle below which two directions of supports are one: supports of planes are stated to more digits than
# that, and the normals of flat surfaces are known to some 1e-15.
ONE = 1e-6


class Turned:
    """The turned nodes of this rank and the supports that meet in them.

    nodes (n,): local numbers, ghosts included, rising; directions (n, m, 3): unit vectors of the statements at each node,
    zero where there are fewer than m. axes (n, 3, 3): columns are a node's own axes, of which the first ones, `held` (n, 3),
    span the directions; shares (n, m, 3): by which statements' displacements make up the held components, and components of
    a force its parts along the statements' directions, equal ones of equal directions.
    """

    def __init__(self, nodes: Ints64, directions: Floats) -> None:
        self.nodes, self.directions = nodes, directions
        wide = np.concatenate([directions, np.zeros((len(nodes), 3, 3))], axis=1)
        left, size, right = np.linalg.svd(wide, full_matrices=False)
        self.held: Bools = size > ONE
        self.axes = np.ascontiguousarray(right.transpose(0, 2, 1))
        inverse = np.divide(1.0, size, out=np.zeros_like(size), where=self.held)
        self.shares = (left * inverse[:, None, :])[:, : directions.shape[1]]

    def change(self, space: Space) -> Change:
        """From components along own axes. Collective."""
        mine = self.nodes < space.dofmap.index_map.size_local
        nodes, axes, none = self.nodes[mine], self.axes[mine], np.empty((int(mine.sum()), 0), dtype=np.int64)
        blocks = np.empty((len(nodes), 0, 3, 3))
        both = (node_rows(space, nodes, none, blocks, own) for own in (axes, axes.transpose(0, 2, 1)))
        return Change(space, *both)

    # -- local arrays, of owned dofs or with the ghosts behind them -----------------------------------------------
    def components(self, array: Floats) -> Floats:
        """Components (n, 3) along the nodes' own axes, of as many nodes as the array holds."""
        count = int(np.searchsorted(self.nodes, len(array) // 3))
        return np.einsum("nck,nc->nk", self.axes[:count], array.reshape(-1, 3)[self.nodes[:count]])

    def put(self, array: Floats, components: Floats) -> None:
        """Set all components (n, 3) along own axes, of as many nodes as the array holds."""
        count = len(components)
        array.reshape(-1, 3)[self.nodes[:count]] = np.einsum("nck,nk->nc", self.axes[:count], components)
