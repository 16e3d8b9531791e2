"""Bilinear forms: into the matrix by the fast way wherever a cell's nodes are all of this rank; symmetric or not."""

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.supports import Supports
from fenics_contact.types import Form, Function, Mat


class CellForm:
    """A bilinear form on tagged cells, added to a matrix of blocks of three.

    PETSc takes a cell's matrix apart for a matrix that ranks share: 1.2 times the cost of a tangent. Cells inside a
    rank's part need none of that: theirs go whole into the block of the rank's own rows and columns.
    """

    def __init__(self, form: Form) -> None:
        self.whole, self._inner, self._rest = compat.compile_form(form), None, None
        space = form.arguments()[0].ufl_function_space()
        if space.mesh.comm.size > 1:
            owned = compat.cell_map(space.mesh).size_local
            inside = (compat.cell_dofs(space)[:owned] < space.dofmap.index_map.size_local).all(axis=1)
            parts = compat.parts_of_form(form, inside)
            if parts is not None:
                self._inner, self._rest = (compat.compile_form(part) for part in parts)

    def add(self, matrix: Mat) -> None:
        """Add to a matrix of MatrixPattern, to be assembled afterwards."""
        if self._inner is None:
            compat.assemble_matrix(matrix, self.whole)
            return
        compat.assemble_matrix(matrix.getDiagonalBlock(), self._inner)
        compat.assemble_matrix(matrix, self._rest)


def number_own_block(matrix: Mat, count: int) -> None:
    """Let the block of a rank's own rows and columns be filled by local numbers of nodes; count: owned nodes."""
    if matrix.comm.size > 1:
        own = matrix.getDiagonalBlock()
        numbers = PETSc.LGMap().create(np.arange(count, dtype=PETSc.IntType), bsize=3, comm=own.comm)
        own.setLGMap(numbers, numbers)


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
