"""Nodes with axes of their own: supports along any direction become prescribed components there, exactly and symmetrically.

u = T v: v is u itself, but for the turned nodes, whose components in v are those along their own axes. The solvers and the
output know u alone. Only where supports are eliminated is the tangent T^T K T, and a solve's right-hand side T^T r.
"""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.exchange import lasting
from fenics_contact.types import Bools, Floats, Ints64, Mat, Space

# Sine of the angle below which two directions of supports are one: supports of planes are stated to more digits than
# that, and the normals of flat surfaces are known to some 1e-15.
ONE = 1e-6


class Turned:
    """The turned nodes of this rank and the supports that meet in them. Construction is collective.

    space: of u; nodes (n,): local numbers, ghosts included, rising; directions (n, m, 3): unit vectors of the statements at
    each node, zero where there are fewer than m. axes (n, 3, 3): columns are a node's own axes, of which the first ones,
    `held` (n, 3), span the directions; shares (n, m, 3): by which statements' displacements make up the held components,
    and components of a force its parts along the statements' directions, equal ones of equal directions.
    """

    def __init__(self, space: Space, nodes: Ints64, directions: Floats) -> None:
        self.nodes, self.directions = nodes, directions
        wide = np.concatenate([directions, np.zeros((len(nodes), 3, 3))], axis=1)
        left, size, right = np.linalg.svd(wide, full_matrices=False)
        self.held: Bools = size > ONE
        self.axes = np.ascontiguousarray(right.transpose(0, 2, 1))
        inverse = np.divide(1.0, size, out=np.zeros_like(size), where=self.held)
        self.shares = (left * inverse[:, None, :])[:, : directions.shape[1]]
        self._change, self._comm = self._matrix(space), lasting(space.mesh.comm)
        self._scalars: Mat = None  # the tangent by scalars, and turned
        self._product: Mat = None
        self._pattern: int | None = None

    def _matrix(self, space: Space) -> Mat:
        """T, of owned rows."""
        index_map = space.dofmap.index_map
        owned, first = index_map.size_local, 3 * index_map.local_range[0]
        mine = self.nodes < owned
        full = np.zeros(owned, dtype=bool)
        full[self.nodes[mine]] = True
        lengths = np.repeat(np.where(full, 3, 1), 3)
        offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(PETSc.IntType)
        rows = np.arange(3 * owned)
        columns, values = np.repeat(rows, lengths), np.ones(offsets[-1])
        at = offsets[3 * self.nodes[mine][:, None] + np.arange(3)][:, :, None] + np.arange(3)  # (n, component, own axis)
        columns[at] = 3 * self.nodes[mine][:, None, None] + np.arange(3)
        values[at] = self.axes[mine]
        size = (3 * owned, 3 * index_map.size_global)
        csr = offsets, (columns + first).astype(PETSc.IntType), values
        return PETSc.Mat().createAIJ((size, size), bsize=3, csr=csr, comm=lasting(space.mesh.comm))

    # -- vectors: local arrays, of owned dofs or with the ghosts behind them --------------------------------------
    def _within(self, array: Floats) -> int:
        """How many of the nodes a local array holds."""
        return int(np.searchsorted(self.nodes, len(array) // 3))

    def components(self, array: Floats) -> Floats:
        """Components (n, 3) along the nodes' own axes."""
        count = self._within(array)
        return np.einsum("nck,nc->nk", self.axes[:count], array.reshape(-1, 3)[self.nodes[:count]])

    def put(self, array: Floats, components: Floats) -> None:
        """Set all components (n, 3) along own axes."""
        count = self._within(array)
        array.reshape(-1, 3)[self.nodes[:count]] = np.einsum("nck,nk->nc", self.axes[:count], components[:count])

    def turn(self, array: Floats) -> None:
        """u to v: array <- T^T array."""
        array.reshape(-1, 3)[self.nodes[: self._within(array)]] = self.components(array)

    def turn_back(self, array: Floats) -> None:
        """v to u: array <- T array."""
        self.put(array, array.reshape(-1, 3)[self.nodes[: self._within(array)]].copy())

    # -- matrices -------------------------------------------------------------------------------------------------
    def turned(self, matrix: Mat, pattern: int | None) -> Mat:
        """T^T K T by scalars, in one Mat as long as the number `pattern` of K's nonzero pattern is the same, not None."""
        if pattern is None or pattern != self._pattern:
            self._drop()
            self._scalars, self._pattern = matrix.convert("aij", out=PETSc.Mat()), pattern
            self._product = self._scalars.ptap(self._change)
            self._product.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        else:
            matrix.convert("aij", out=self._scalars)
            self._scalars.ptap(self._change, result=self._product)
        return self._product

    def turned_back(self, matrix: Mat) -> Mat:
        """T K T^T of a turned matrix."""
        transposed = self._change.transpose(PETSc.Mat())
        return matrix.ptap(transposed)

    def _drop(self) -> None:
        for matrix in (self._scalars, self._product):
            if matrix is not None:
                matrix.destroy()
        PETSc.garbage_cleanup(self._comm)
