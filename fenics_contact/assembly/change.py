"""A change of unknowns u = T v under which supports along any direction, and pairs of nodes, are prescribed components of v.

The solvers and the output know u alone. Only where supports are eliminated is the tangent T^T K T, and a solve's right-hand
side T^T r.
"""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.exchange import lasting
from fenics_contact.types import Floats, Ints64, Mat, Space, Vec


class Change:
    """T, which is the identity but for the rows of some nodes.

    forward, back: T and its inverse, by scalars.
    """

    def __init__(self, space: Space, forward: Mat, back: Mat) -> None:
        self._forward, self._back, self._comm = forward, back, lasting(space.mesh.comm)
        self._scalars: Mat = None  # the tangent by scalars, and changed
        self._product: Mat = None
        self._pattern: int | None = None

    def after(self, other: "Change", space: Space) -> "Change":
        """u = T T' v, T' being the other's. Collective."""
        return Change(space, self._forward.matMult(other._forward), other._back.matMult(self._back))

    # -- of the owned dofs, in place; collective ------------------------------------------------------------------
    def to_own(self, u: Vec) -> None:
        """A displacement u to v = T^-1 u."""
        _apply(self._back.mult, u)

    def to_space(self, v: Vec) -> None:
        """v to the displacement u = T v."""
        _apply(self._forward.mult, v)

    def to_own_forces(self, forces: Vec) -> None:
        """Forces f to T^T f."""
        _apply(self._forward.multTranspose, forces)

    # -- matrices -------------------------------------------------------------------------------------------------
    def changed(self, matrix: Mat, pattern: int | None) -> Mat:
        """T^T K T by scalars, in one Mat as long as the number `pattern` of K's nonzero pattern is the same, not None."""
        if pattern is None or pattern != self._pattern:
            self._drop()
            self._scalars, self._pattern = matrix.convert("aij", out=PETSc.Mat()), pattern
            self._product = self._scalars.ptap(self._forward)
            self._product.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        else:
            matrix.convert("aij", out=self._scalars)
            self._scalars.ptap(self._forward, result=self._product)
        return self._product

    def changed_back(self, matrix: Mat) -> Mat:
        """T^-T K T^-1 of a changed matrix."""
        return matrix.ptap(self._back)

    def _drop(self) -> None:
        for matrix in (self._scalars, self._product):
            if matrix is not None:
                matrix.destroy()
        PETSc.garbage_cleanup(self._comm)


def _apply(product: Vec, vector: Vec) -> None:
    out = vector.duplicate()
    product(vector, out)
    vector.array_w[:] = out.array_r
    out.destroy()


def node_rows(space: Space, nodes: Ints64, columns: Ints64, values: Floats, own: Floats) -> Mat:
    """The identity but for the rows of owned nodes (n,), rising: blocks own (n, 3, 3) on their diagonal, and values
    (n, m, 3, 3) in the columns (n, m), global numbers of other nodes. Collective."""
    index_map = space.dofmap.index_map
    owned, first = index_map.size_local, index_map.local_range[0]
    per_node = np.ones(owned, dtype=np.int64)
    per_node[nodes] = 3 * (1 + columns.shape[1])
    lengths = np.repeat(per_node, 3)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    rows = np.arange(3 * owned)
    numbers, entries = np.repeat(rows, lengths) + 3 * first, np.ones(offsets[-1])
    blocks = np.column_stack([nodes + first, columns])
    order = np.argsort(blocks, axis=1)
    blocks, at = np.take_along_axis(blocks, order, axis=1), np.concatenate([own[:, None], values], axis=1)
    at = np.take_along_axis(at, order[:, :, None, None], axis=1)  # (n, blocks, row, column)
    width = 3 * blocks.shape[1]
    places = offsets[3 * nodes[:, None] + np.arange(3)][:, :, None] + np.arange(width)
    wide = (3 * blocks[:, :, None] + np.arange(3)).reshape(len(nodes), 1, width)
    numbers[places] = np.broadcast_to(wide, places.shape)
    entries[places] = at.transpose(0, 2, 1, 3).reshape(places.shape)
    size = 3 * owned, 3 * index_map.size_global
    csr = offsets.astype(PETSc.IntType), numbers.astype(PETSc.IntType), entries
    return PETSc.Mat().createAIJ((size, size), bsize=3, csr=csr, comm=lasting(space.mesh.comm))
