"""Matrices of 3x3 blocks as operators of Krylov's method and of multigrid's smoother, by our own products."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from weakref import WeakMethod

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.petsc_memory import HANDLE, REALS, Rows, array_at, block_rows, called, other_columns, row_parts
from fenics_contact.kernels.block_products import (
    BlockRows,
    add_product,
    diagonals,
    earlier,
    inverses,
    less_others,
    split,
)
from fenics_contact.types import Floats, Ints64, Mat, Vec

_PRODUCT = ctypes.CFUNCTYPE(ctypes.c_int, HANDLE, HANDLE, HANDLE)
_MULT = 3  # PETSc's number of the operation y = A x
_INSERT, _FORWARD = 1, 0  # PETSc's numbers of a scatter's modes
_stopped: list[BaseException] = []


class Order(NamedTuple):
    """In which a sweep visits the rows of a process, numbers that rise: first those without columns of other processes,
    `inner`, then, in the process's turn of so many `turns`, `border`; place (rows,): where each row is in it. Processes
    that have each other's columns have different turns."""

    inner: Ints64
    border: Ints64
    place: Ints64
    turn: int
    turns: int


class BlockOperator:
    """y = A x with a matrix of 3x3 blocks, whose entries are not copied, as a PETSc Mat of type shell, `mat`.

    PETSc's own kernel reads the entries past the caches, which takes two to four times as long. `use` gives the matrix, on
    the same processes; one by scalars is converted. `rounded`: the matrix as `use` found it, in single precision, of which
    a product reads half as much: a preconditioner needs no more. order: of its sweeps. Shells and not Mats of type python:
    PETSc frees what ranks share when it ends, after Python. Collective.
    """

    def __init__(self, matrix: Mat) -> None:
        self._made: list[Mat] = []  # from a matrix by scalars
        self._known: tuple[int, ...] | None = None
        self._others: Rows | None = None  # columns that other processes own, and how their entries come here
        self._scatter: Any = None
        self._ghosts: Vec = None
        self._halves: list[BlockRows] = []  # own columns in single precision: before each row and its own, behind it
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
        parts = row_parts(matrix) if matrix.comm.size > 1 else (HANDLE(matrix.handle),)
        self._own, self._others = block_rows(parts[0]), block_rows(parts[1]) if len(parts) > 1 else None
        known = None if pattern is None else (matrix.handle, pattern, len(self._own[1]), *(part.value for part in parts))
        if matrix.comm.tompi4py().allreduce(known is None or known != self._known):
            self._arrange(matrix)
            self._known = known
        self._matrix = matrix
        split(self._own, self.order.place, *self._halves)
        if self._others is not None:
            self._singles = self._others[2].astype(np.float32)

    def _arrange(self, matrix: Mat) -> None:
        """What follows from the nonzero pattern."""
        (offsets, columns, _), rows = self._own, np.arange(self.rows)
        self._diagonal = np.empty(self.rows, dtype=columns.dtype)
        diagonals(offsets, columns, self._diagonal)
        self.order = Order(rows, rows[:0], rows, 0, 1)
        if self._others is not None:
            self._reach(matrix)
            meets = np.diff(self._others[0]) > 0
            inner, border = rows[~meets], rows[meets]
            place = np.empty_like(rows)
            place[np.append(inner, border)] = rows
            self.order = Order(inner, border, place, *_turns(matrix))
        before = np.empty(self.rows, dtype=offsets.dtype)
        earlier(offsets, columns, self.order.place, before)
        self._halves = []
        for counts in (before + 1, np.diff(offsets) - before - 1):
            starts = np.append(offsets[:1], np.cumsum(counts, dtype=offsets.dtype))
            self._halves.append((starts, np.empty(starts[-1], columns.dtype), np.empty(9 * starts[-1], np.float32)))

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
        """The process's own rows and columns in single precision: what comes before each row and its own, and behind it."""
        lower, upper = self._halves
        return lower, upper

    def exchange(self, x: int) -> None:
        """Have what other processes own of a vector, by its handle. Collective."""
        if self._scatter:
            scatter, ghosts = HANDLE(self._scatter.handle), HANDLE(self._ghosts.handle)
            called("VecScatterBegin", scatter, HANDLE(x), ghosts, _INSERT, _FORWARD)
            called("VecScatterEnd", scatter, HANDLE(x), ghosts, _INSERT, _FORWARD)

    def forget(self) -> None:
        """What other processes own is zero until the next exchange."""
        if self._ghosts:
            self._ghosts.set(0.0)

    def less_others(self, b: Floats, out: Floats) -> None:
        """out = b less what the columns of other processes give, rounded, in the rows that have some."""
        if self._others is not None:
            less_others((*self._others[:2], self._singles), self._ghosts.array_r, self.order.border, b, out)

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


def _turns(matrix: Mat) -> tuple[int, int]:
    """The turn of this process and their number. Collective."""
    comm, ends = matrix.comm.tompi4py(), matrix.getOwnershipRanges()
    owners = np.unique(np.searchsorted(ends, 3 * other_columns(matrix), side="right") - 1)
    meets = np.zeros((comm.size, comm.size), dtype=bool)
    for rank, others in enumerate(comm.allgather(owners)):
        meets[rank, others] = meets[others, rank] = True
    turns: list[int] = []
    for rank in range(comm.size):
        taken = {turns[other] for other in range(rank) if meets[rank, other]}
        turns.append(next(turn for turn in range(comm.size) if turn not in taken))
    return turns[comm.rank], max(turns) + 1


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
