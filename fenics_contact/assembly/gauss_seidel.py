"""Gauss and Seidel's sweeps with a matrix of 3x3 blocks, as multigrid's smoother, the same on any number of processes."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from fenics_contact.assembly.block_operator import BlockOperator, called_back, entries
from fenics_contact.assembly.petsc_memory import HANDLE, called
from fenics_contact.kernels.block_products import BlockRows, sweep_down, sweep_up
from fenics_contact.types import Ints64


class GaussSeidel:
    """y = M^-1 x by sweeps in 3x3 blocks, each down and back up, from zero, as a PC of type shell; must live as long.

    Rows that no other process' columns meet come first, on all processes at once; then those with columns of others, one
    process after another where they meet, and back. So a process always has what its neighbours have found before: sweeps
    of each one's own columns alone diverge where several meet.
    """

    def __init__(self, pc: Any, blocks: BlockOperator, sweeps: int) -> None:
        self._blocks, self._sweeps, self._inverses = blocks, sweeps, np.zeros(9 * blocks.rows)
        above, below, self._right = (np.zeros(3 * blocks.rows) for _ in range(3))
        self._parts = above, below  # products with what lies above and below the diagonal
        self._product = called_back(self._multiply)
        pc.setType("shell")
        called("PCShellSetApply", HANDLE(pc.handle), self._product)
        self.renew()

    def renew(self) -> None:
        """Invert the blocks on the diagonal as they are now."""
        self._blocks.inverses(self._inverses)

    def _multiply(self, x: int, y: int) -> None:
        blocks, order, (lower, upper) = self._blocks, self._blocks.order, self._blocks.halves
        down, up = (sweep_down, lower), (sweep_up, upper)
        self._parts[0][:] = 0.0
        blocks.forget()
        called("VecSet", HANDLE(y), ctypes.c_double(0.0))
        for _ in range(self._sweeps):
            self._sweep(*down, order.inner, x, y)
            for turn in range(order.turns):
                if turn:
                    blocks.exchange(y)
                if turn == order.turn:
                    self._sweep(*down, order.border, x, y)
            for turn in reversed(range(order.turns)):
                if turn + 1 < order.turns:
                    blocks.exchange(y)
                if turn == order.turn:
                    self._sweep(*up, order.border, x, y)
            self._sweep(*up, order.inner, x, y)

    def _sweep(self, sweep: Callable[..., None], half: BlockRows, rows: Ints64, x: int, y: int) -> None:
        """One way over some rows; half: the blocks on their side that it reads."""
        if not len(rows):
            return
        size = len(self._right)
        with entries(x, size) as b, entries(y, size, written=True) as out:
            if rows is self._blocks.order.border:
                self._blocks.less_others(b, self._right)
                b = self._right
            sweep(half, self._inverses, rows, b, out, self._parts)
