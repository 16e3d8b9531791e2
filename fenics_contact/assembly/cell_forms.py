"""A bilinear form that goes into the matrix by the fast way wherever a cell's nodes are all of this rank."""

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat


class CellForm:
    """A bilinear form on tagged cells, added to a matrix of blocks of three.

    PETSc takes a cell's matrix apart for a matrix that ranks share: 1.2 times the cost of a tangent. Cells inside a
    rank's part need none of that: theirs go whole into the block of the rank's own rows and columns.
    """

    def __init__(self, form):
        self.whole, self._inner, self._rest = compat.compile_form(form), None, None
        space = form.arguments()[0].ufl_function_space()
        if space.mesh.comm.size > 1:
            owned = space.mesh.topology.index_map(3).size_local
            inside = (compat.cell_dofs(space)[:owned] < space.dofmap.index_map.size_local).all(axis=1)
            parts = compat.parts_of_form(form, inside)
            if parts is not None:
                self._inner, self._rest = (compat.compile_form(part) for part in parts)

    def add(self, matrix):
        """Add to a matrix of MatrixPattern, to be assembled afterwards."""
        if self._inner is None:
            compat.assemble_matrix(matrix, self.whole)
            return
        compat.assemble_matrix(matrix.getDiagonalBlock(), self._inner)
        compat.assemble_matrix(matrix, self._rest)


def number_own_block(matrix, count):
    """Let the block of a rank's own rows and columns be filled by local numbers of nodes; count: owned nodes."""
    if matrix.comm.size > 1:
        own = matrix.getDiagonalBlock()
        numbers = PETSc.LGMap().create(np.arange(count, dtype=PETSc.IntType), bsize=3, comm=own.comm)
        own.setLGMap(numbers, numbers)
