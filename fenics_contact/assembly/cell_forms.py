"""Forms into vectors and into the matrix, by the fast way wherever a cell's nodes are all of this rank; symmetric or not."""

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.lanes import Lanes
from fenics_contact.assembly.petsc_memory import HANDLE, block_rows, own_part, pattern_of
from fenics_contact.assembly.supports import Supports
from fenics_contact.kernels.scatter import find_blocks
from fenics_contact.types import Floats, Form, Function, Mat


class LinearForm:
    """A linear form, added to local vectors; that of its cells several cells at once."""

    def __init__(self, form: Form) -> None:
        lanes = [Lanes(part) for part in compat.on_cells_and_others(form)]
        self._nodes = [compat.cell_dofs(form.arguments()[0].ufl_function_space())[part.cells] for part in lanes]
        self._lanes = lanes

    def add(self, array: Floats) -> None:
        """Add to a local array (owned and ghost dofs), without exchange between ranks."""
        for part, nodes in zip(self._lanes, self._nodes, strict=True):
            if part.usable:
                part.add(nodes, array)
            else:
                compat.assemble_vector(array, part.compiled)


class CellForm:
    """A bilinear form on cells, added to a matrix of blocks of three.

    PETSc looks for each block's place whenever it takes a cell's matrix, and takes it apart where ranks share the matrix:
    that costs more than its entries. So the places of the cells inside a rank's part, all but one layer, are looked up once
    per pattern. Where the form has no usable Lanes dolfinx adds it.
    """

    def __init__(self, form: Form, symmetric: bool = False) -> None:
        lanes = Lanes(form, symmetric)
        self.whole, self._usable = lanes.compiled, lanes.usable
        space = form.arguments()[0].ufl_function_space()
        nodes = compat.cell_dofs(space)
        inside = (nodes < space.dofmap.index_map.size_local).all(axis=1)
        self._inner, self._rest = lanes.on(inside), lanes.on(~inside)
        self._nodes, self._rest_nodes = (np.ascontiguousarray(nodes[part.cells]) for part in (self._inner, self._rest))
        self._pattern, self._places = (-1, -1), np.empty(0, dtype=np.int32)

    def add(self, matrix: Mat) -> None:
        """Add to a matrix of MatrixPattern, to be assembled afterwards."""
        if not self._usable:
            compat.assemble_matrix(matrix, self.whole)
            return
        own = own_part(matrix)
        offsets, columns, blocks = block_rows(HANDLE(own.handle))
        if self._pattern != pattern_of(own):
            nodes = self._nodes.astype(np.int64)
            self._places = find_blocks(nodes, nodes, offsets, columns)
            if (self._places < 0).any():
                raise KeyError("cells couple nodes that the matrix does not")
            self._pattern = pattern_of(own)
        self._inner.add(self._places, blocks)
        self._add_by_petsc(matrix)

    def _add_by_petsc(self, matrix: Mat) -> None:
        """Cells with nodes of other ranks."""
        nodes = self._rest_nodes
        cells, k = nodes.shape
        blocks = np.zeros((cells, k, k, 3, 3))
        self._rest.add(np.arange(cells * k * k, dtype=np.int32).reshape(cells, k, k), blocks)
        if cells:
            values = np.ascontiguousarray(blocks.transpose(0, 1, 4, 2, 3)).reshape(cells, 3 * k, 3 * k)
            matrix.setValuesBlockedLocalRCV(nodes, nodes, values, addv=True)


def is_symmetric(tangent_form: Form, u: Function, supports: Supports) -> bool:
    """Whether a bilinear form is symmetric on the dofs that no support holds, in a random configuration. Collective."""
    saved = u.x.array.copy()
    u.x.array[:] = np.random.default_rng(0).standard_normal(len(saved))
    supports.put(u.x.array, supports.values(1.0))
    compat.copy_to_ghosts(u)
    matrix = compat.create_matrix(tangent_form)
    compat.assemble_matrix(matrix, tangent_form)
    matrix.assemble()
    matrix = supports.eliminated(matrix, 0.0)
    size = matrix.norm()
    transposed = matrix.transpose(PETSc.Mat())
    transposed.axpy(-1.0, matrix, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    u.x.array[:] = saved
    asymmetry = transposed.norm()
    transposed.destroy()
    if supports.change is None:
        matrix.destroy()
    return asymmetry <= 1e-10 * size  # sums of round-off; a real asymmetry is of the order of the entries
