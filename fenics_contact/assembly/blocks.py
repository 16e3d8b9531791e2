"""A term's part of the tangent as plain blocks, and the one place that inserts them into the matrix and the border."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.cell_forms import CellForm
from fenics_contact.kernels.scatter import scatter_border
from fenics_contact.types import Array, Floats, Ints64, Mat


@dataclass(frozen=True)
class TravelBlocks:
    """Couplings with the travel of the tool with a number `index`: columns (n, 3, 3), the rate of the force on each of the
    local nodes (n,) with the travel; rows (n, 3, 3), that of the tool's force with the motion of the node; corner (3, 3)."""

    index: int
    nodes: Array
    columns: Floats
    rows: Floats
    corner: Floats


@dataclass(frozen=True)
class Blocks:
    """forms: bilinear forms, which know the fast way into the matrix; cells: local nodes (n, k) and matrices (n, 3k, 3k) of
    elements; pairs: rows (m,), rising, columns (m,) and blocks (m, 3, 3) of pairs of nodes, local ones or, with `whole`,
    numbers of the System's blocks; travel: with a tool; free: diagonal (3 tools,) on the travel of tools, counted once; at:
    where a contact's points were, for what it foresees from this tangent."""

    forms: tuple[CellForm, ...] = ()
    cells: tuple[Array, Floats] | None = None
    pairs: tuple[Array, Array, Floats] | None = None
    whole: bool = True
    travel: TravelBlocks | None = None
    free: Floats | None = None
    at: Any = None


class Border:
    """Couplings with the tools' travel: columns, rows (3 tools, local dofs) and corner (3 tools, 3 tools)."""

    def __init__(self, tools: int, dofs: int) -> None:
        self.columns = np.zeros((3 * tools, dofs))
        self.rows = np.zeros((3 * tools, dofs))
        self.corner = np.zeros((3 * tools, 3 * tools))

    def clear(self) -> None:
        for part in (self.columns, self.rows, self.corner):
            part[:] = 0.0


def insert(blocks: Blocks, matrix: PETSc.Mat, border: Border | None) -> None:
    """Add a term's blocks to the matrix, to be assembled afterwards, and to the border where there are tools."""
    for form in blocks.forms:
        form.add(matrix)
    if blocks.cells is not None and len(blocks.cells[0]):
        nodes, values = blocks.cells
        matrix.setValuesBlockedLocalRCV(nodes, nodes, values, addv=True)
    if blocks.pairs is not None:
        _insert_pairs(*blocks.pairs, blocks.whole, matrix)
    if border is None:
        return
    if blocks.travel is not None:
        _insert_travel(blocks.travel, border)
    if blocks.free is not None:
        border.corner += np.diag(blocks.free)


def _insert_pairs(rows: Ints64, columns: Ints64, values: Floats, whole: bool, matrix: Mat) -> None:
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    offsets, rows = np.append(starts, len(values)).astype(np.int32), rows[starts].astype(np.int32)
    add = matrix.setValuesBlockedIJV if whole else matrix.setValuesBlockedLocalIJV
    add(offsets, columns.astype(np.int32), values, addv=True, rowmap=rows)


def _insert_travel(travel: TravelBlocks, border: Border) -> None:
    mine = slice(3 * travel.index, 3 * travel.index + 3)
    scatter_border(travel.nodes, travel.columns, travel.rows, border.columns[mine], border.rows[mine])
    border.corner[mine, mine] += travel.corner
