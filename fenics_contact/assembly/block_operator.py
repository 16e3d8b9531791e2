"""Matrices of 3x3 blocks as operators of Krylov's method and of multigrid's smoother, by our own products."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any
from weakref import WeakMethod

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.petsc_memory import HANDLE, REALS, Rows, array_at, block_rows, called, other_columns, row_parts
from fenics_contact.kernels.block_products import (
    BlockRows,
    add_product,
    diagonal_product,
    diagonals,
    inverses,
    split,
    sweep_down,
    sweep_up,
)
from fenics_contact.types import Floats, Mat, Vec

_PRODUCT = ctypes.CFUNCTYPE(ctypes.c_int, HANDLE, HANDLE, HANDLE)
_MULT = 3  # PETSc's number of the operation y = A x
_INSERT, _FORWARD = 1, 0  # PETSc's numbers of a scatter's modes
_stopped: list[BaseException] = []


class Blocks:
    """y = A x with a matrix of 3x3 blocks, whose entries are not copied, as a PETSc Mat of type shell, `mat`.

    PETSc's own kernel reads the entries past the caches, which takes two to four times as long. `use` gives the matrix, on
    the same processes; one by scalars is converted. `rounded`: the matrix as `use` found it, in single precision, of which
    a product reads half as much: a preconditioner needs no more. Shells and not Mats of type python: PETSc frees what ranks
    share when it ends, after Python. Collective.
    """

    def __init__(self, matrix: Mat) -> None:
        self._made: list[Mat] = []  # from a matrix by scalars
        self._known: tuple[int, int, int | None, int | None] | None = None
        self._others: Rows | None = None  # columns that other processes own, and how their entries come here
        self._scatter: Any = None
        self._ghosts: Vec = None
        self._halves: list[BlockRows] = []  # own columns in single precision: up to the diagonal, behind it
        self._singles = np.empty(0, dtype=np.float32)  # blocks of the others
        self._products = [called_back(multiply) for multiply in (self._multiply, self._multiply_rounded)]
        self.mat, self.rounded = (_shell(matrix, product) for product in self._products)
        self.use(matrix)

    def use(self, matrix: Mat, pattern: int | None = None) -> None:
        """Multiply by this matrix from now on; again after PETSc has rearranged it: new couplings, a conversion.

        pattern: number that changes with its nonzero pattern, None: not known.
        """
        if not matrix.getType().endswith("baij"):
            self._free()
            matrix, pattern = matrix.convert("baij", out=PETSc.Mat()), None
            self._made.append(matrix)
        if matrix.comm.size == 1:
            self._own = block_rows(HANDLE(matrix.handle))
        else:
            own, others, ghosts = row_parts(matrix)
            self._own, self._others = block_rows(own), block_rows(others)
            known = None if pattern is None else (matrix.handle, pattern, others.value, ghosts.value)
            if matrix.comm.tompi4py().allreduce(known is None or known != self._known):
                self._reach(matrix)
                self._known = known
        self._matrix = matrix
        self._diagonal = np.empty(self.rows, dtype=self._own[1].dtype)
        diagonals(*self._own[:2], self._diagonal)
        self._round()

    def _round(self) -> None:
        """Copy the matrix in single precision."""
        offsets, columns, _ = self._own
        counts = self._diagonal - offsets[:-1] + 1, offsets[1:] - self._diagonal - 1
        sizes = [int(count.sum()) for count in counts]
        if [len(half[1]) for half in self._halves] != sizes:
            self._halves = [
                (np.zeros_like(offsets), np.empty(size, columns.dtype), np.empty(9 * size, np.float32)) for size in sizes
            ]
        for half, count in zip(self._halves, counts, strict=True):
            np.cumsum(count, out=half[0][1:])
        split(self._own, self._diagonal, *self._halves)
        if self._others is not None:
            self._singles = self._others[2].astype(np.float32)

    def _reach(self, matrix: Mat) -> None:
        """Make the exchange of the entries that other processes own."""
        for thing in (self._scatter, self._ghosts):
            if thing is not None:
                thing.destroy()
        columns = other_columns(matrix)
        places = PETSc.IS().createBlock(3, columns, comm=matrix.comm)
        x = matrix.createVecRight()
        self._ghosts = PETSc.Vec().createSeq(3 * len(columns))
        self._scatter = PETSc.Scatter().create(x, places, self._ghosts, None)
        x.destroy(), places.destroy()

    def inverses(self, out: Floats) -> None:
        """The inverse of every block on the diagonal into out (9 rows,), by columns; not finite where it is singular."""
        inverses(self._diagonal, self._own[2], out)

    @property
    def halves(self) -> tuple[BlockRows, BlockRows]:
        """The process's own rows and columns in single precision: up to the diagonal and with it, and behind it."""
        lower, upper = self._halves
        return lower, upper

    @property
    def rows(self) -> int:
        """Block rows of this process."""
        return len(self._own[0]) - 1

    def destroy(self) -> None:
        """Free PETSc's objects."""
        self._free()
        for thing in (self._scatter, self._ghosts, self.mat, self.rounded):
            if thing is not None:
                thing.destroy()

    def _free(self) -> None:
        for thing in self._made:
            thing.destroy()
        self._made = []

    def _multiply(self, x: int, y: int) -> None:
        self._multiplied(x, y, [self._own], self._others)

    def _multiply_rounded(self, x: int, y: int) -> None:
        beside = None if self._others is None else (*self._others[:2], self._singles)
        self._multiplied(x, y, self._halves, beside)

    def _multiplied(self, x: int, y: int, own: Sequence[BlockRows], others: Rows | None) -> None:
        size = 3 * self.rows
        scatter = [HANDLE(one.handle) for one in (self._scatter, self._ghosts)] if self._scatter else []
        if scatter:
            called("VecScatterBegin", scatter[0], HANDLE(x), scatter[1], _INSERT, _FORWARD)
        try:
            with entries(x, size) as given, entries(y, size, written=True) as out:
                out[:] = 0.0
                for rows in own:
                    add_product(*rows, given, out)
        finally:  # one that has begun must end, or it can never be freed
            if scatter:
                called("VecScatterEnd", scatter[0], HANDLE(x), scatter[1], _INSERT, _FORWARD)
        if others is not None:
            with entries(y, size, written=True) as out:
                add_product(*others, self._ghosts.array_r, out)


class BlockJacobi:
    """y = D^-1 x with the 3x3 blocks on the diagonal of a matrix, as a PC of type shell; must live as long as that."""

    def __init__(self, pc: Any, blocks: Blocks) -> None:
        self._blocks, self._inverses, self._product = blocks, np.zeros(9 * blocks.rows), called_back(self._multiply)
        pc.setType("shell")
        called("PCShellSetApply", HANDLE(pc.handle), self._product)
        self.renew()

    def renew(self) -> None:
        """Invert the blocks as they are now."""
        self._blocks.inverses(self._inverses)

    def _multiply(self, x: int, y: int) -> None:
        size = len(self._inverses) // 3
        with entries(x, size) as given, entries(y, size, written=True) as out:
            diagonal_product(self._inverses, given, out)


class GaussSeidel(BlockJacobi):
    """y = M^-1 x by sweeps of Gauss-Seidel in 3x3 blocks, each down and back up, from zero; of one process' matrix.

    Columns of other processes would be left out: where several of these meet, M^-1 A gets eigenvalues far above one, and
    sweeps damped by that, or by half of what a row has there added to its diagonal (Baker et al. 2011,
    doi:10.1137/100798806), smooth worse than block Jacobi.
    """

    def __init__(self, pc: Any, blocks: Blocks, sweeps: int) -> None:
        size = 3 * blocks.rows
        self._sweeps, self._above, self._below = sweeps, np.zeros(size), np.zeros(size)
        super().__init__(pc, blocks)

    def _multiply(self, x: int, y: int) -> None:
        size, (lower, upper) = len(self._above), self._blocks.halves
        self._above[:] = 0.0
        with entries(x, size) as right, entries(y, size, written=True) as out:
            for _ in range(self._sweeps):
                sweep_down(lower, self._inverses, right, self._above, out, self._below)
                sweep_up(upper, self._inverses, right, self._below, out, self._above)


class entries:
    """A process's entries of a vector by its handle, in a with statement."""

    def __init__(self, vector: int, size: int, written: bool = False) -> None:
        self._vector, self._size, self._kind = HANDLE(vector), size, "" if written else "Read"
        self._pointer = HANDLE()

    def __enter__(self) -> Floats:
        called(f"VecGetArray{self._kind}", self._vector, ctypes.byref(self._pointer))
        return array_at(self._pointer, REALS, self._size)

    def __exit__(self, *_: object) -> None:
        called(f"VecRestoreArray{self._kind}", self._vector, ctypes.byref(self._pointer))


def _shell(matrix: Mat, product: Any) -> Mat:
    """A matrix of the sizes of another one whose product is a function that PETSc can call."""
    shell = PETSc.Mat().create(matrix.comm)
    shell.setSizes(matrix.getSizes())
    shell.setType("shell")
    shell.setUp()
    called("MatShellSetOperation", HANDLE(shell.handle), _MULT, product)
    return shell


def called_back(multiply: Callable[[int, int], None]) -> Any:
    """A function of (object, x, y) that PETSc can call as long as the method's object lives, which may hold it."""
    method = WeakMethod(multiply)  # no cycle: what ranks share would wait for Python's collector

    def product(_: int, x: int, y: int) -> int:
        known = method()
        try:
            if known is not None and not _stopped:
                known(x, y)
        except BaseException as stop:  # ctypes would print it and go on, an interrupt too
            _stopped.append(stop)
        if (
            known is None or _stopped
        ):  # no error: PETSc's multigrid cannot be freed after one; what is no number ends a solve
            called("VecSet", HANDLE(y), ctypes.c_double(np.nan))
        return 0

    return _PRODUCT(product)


def raise_stopped() -> None:
    """Raise what has ended a product since, an interrupt for instance, which PETSc knows as a result that is no number."""
    if _stopped:
        stop = _stopped[0]
        _stopped.clear()
        raise stop
