"""A preconditioner that knows only the rows of a tangent that no support holds."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.assembly.block_operator import called_back, entries
from fenics_contact.assembly.petsc_memory import HANDLE, called, values_of
from fenics_contact.types import Ints, Ints64, Mat


@dataclass(frozen=True)
class Rows:
    """Of matrices: the processes that share them, their number in all, and those owned ones, by local number, that supports
    hold: they have their diagonal alone; plane: whether cells that couple them lie in a plane."""

    comm: MPI.Comm
    size: int
    held: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    plane: bool = False


class FreeRows:
    """A PC of type shell, `pc`, that leaves all rows but the held ones to another one, `inner`, with options of this prefix.

    A held row has its diagonal and nothing else, but in the matrix's pattern it stays what it was: a factorisation of a
    plane scene, all of whose nodes are held along z, takes half of the time without. Must live as long as `pc`. Collective.
    """

    def __init__(self, rows: Rows, prefix: str) -> None:
        comm = rows.comm
        some_free = comm.allreduce(len(rows.held)) < rows.size
        self._held = rows.held if some_free else rows.held[:0]  # a matrix of no rows is singular to MUMPS
        self._free, self._diagonal = np.empty(0, dtype=PETSc.IntType), np.empty(0)
        self._part: Mat = None  # the free rows and columns by scalars
        self._sources: list[Ints64] = []  # the places of its entries among those of the whole matrix
        self._ends: tuple[Any, ...] = ()  # vectors of them
        self._solver, self.pc = PETSc.KSP().create(comm), PETSc.PC().create(comm)
        self._solver.setType("preonly")
        self._solver.setOptionsPrefix(prefix)
        self.inner = self._solver.getPC()
        self.pc.setOptionsPrefix(f"{prefix}all_")  # options without it are meant for the other one
        self._applied = called_back(self._apply)
        self.pc.setType("shell")
        called("PCShellSetApply", HANDLE(self.pc.handle), self._applied)

    def use(self, matrix: Mat, same_pattern: bool, symmetric: bool) -> None:
        """Precondition a matrix from now on, whose pattern is that of the one before or not; `set_up` is due then."""
        if not same_pattern or self._part is None:
            self._cut(matrix)
        self._diagonal = matrix.getDiagonal().array_r[self._held]
        given = np.concatenate(values_of(matrix))
        for values, sources in zip(values_of(self._part), self._sources, strict=True):
            np.take(given, sources, out=values)
        self._part.stateIncrease()
        self._part.setOption(PETSc.Mat.Option.SYMMETRIC, symmetric)
        self._solver.setOperators(self._part)

    def _cut(self, matrix: Mat) -> None:
        """Make the part, and find where its entries come from: it is cut once from a matrix whose entries are numbers."""
        self._forget()
        start, end = matrix.getOwnershipRange()
        self._free = np.setdiff1d(np.arange(end - start, dtype=PETSc.IntType), self._held)
        numbers, first = matrix.duplicate(), 0
        for values in values_of(numbers):
            values[:] = first + np.arange(len(values))
            first += len(values)
        scalars = numbers.convert("aij", out=PETSc.Mat())
        rows = PETSc.IS().createGeneral(self._free + start, comm=matrix.comm)
        self._part = scalars.createSubMatrix(rows, rows)
        self._sources = [values.astype(np.int64) for values in values_of(self._part)]
        self._ends = self._part.createVecs()
        for thing in (numbers, scalars, rows):
            thing.destroy()

    @property
    def entries(self) -> int:
        """Entries of this process's part."""
        return sum(map(len, self._sources))

    def set_up(self) -> int:
        """Factorise. Returns 0, or PETSc's negative reason where that fails."""
        self._solver.setUp()
        return min(self._solver.getConvergedReason(), 0)

    def destroy(self) -> None:
        """Free PETSc's objects."""
        self._forget()
        self.pc.destroy(), self._solver.destroy()

    def _forget(self) -> None:
        for thing in (self._part, *self._ends):
            if thing is not None:
                thing.destroy()
        self._part, self._sources, self._ends = None, [], ()

    def _apply(self, x: int, y: int) -> None:
        size, (right, solution) = len(self._free) + len(self._held), self._ends
        with entries(x, size) as given:
            right.array_w[:] = given[self._free]
            held = given[self._held] / self._diagonal
        try:
            self.inner.apply(right, solution)
        except PETSc.Error:  # the same on all ranks: what is no number ends the solve
            solution.set(np.nan)
        with entries(y, size, written=True) as out:
            out[self._free], out[self._held] = solution.array_r, held
