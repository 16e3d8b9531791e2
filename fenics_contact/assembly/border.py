"""What couples the matrix of the bodies with the coordinates of the rigid tools."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.types import Floats

ALL = slice(None)


class Border:
    """Couplings with the tools' coordinates: columns, rows (6 tools, local dofs) and corner (6 tools, 6 tools)."""

    def __init__(self, tools: int, dofs: int) -> None:
        self.columns = np.zeros((6 * tools, dofs))
        self.rows = np.zeros((6 * tools, dofs))
        self.corner = np.zeros((6 * tools, 6 * tools))

    def clear(self) -> None:
        for part in (self.columns, self.rows, self.corner):
            part[:] = 0.0

    def add(self, values: Floats, rows: Any = ALL, columns: Any = ALL) -> None:
        """Add to the corner's rows and columns of these numbers of the tools' coordinates."""
        self.corner[rows, columns] += values

    def add_column(self, c: int, forces: Floats) -> None:
        """Add what a coordinate does to the first dofs."""
        self.columns[c, : len(forces)] += forces

    def add_row(self, c: int, rates: Floats) -> None:
        """Add what the first dofs do to the force on a coordinate."""
        self.rows[c, : len(rates)] += rates

    def sum_corner(self, comm: MPI.Comm) -> None:
        """Of all ranks. Collective."""
        self.corner = comm.allreduce(self.corner)

    @contextmanager
    def stiffer(self, by: float) -> Iterator[None]:
        """The tools' coordinates resist more meanwhile, by so much [force/length]."""
        corner = self.corner.copy()
        self.add(np.diag(np.full(len(corner), by)))
        try:
            yield
        finally:
            self.corner = corner
