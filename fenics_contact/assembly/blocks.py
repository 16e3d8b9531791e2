"""A term's part of the tangent as plain blocks, and the one place that inserts them into the matrix and the border."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.border import Border
from fenics_contact.assembly.cell_forms import CellForm
from fenics_contact.assembly.petsc_memory import HANDLE, block_rows, other_columns, own_part
from fenics_contact.assembly.pose import Pose
from fenics_contact.kernels.scatter import add_blocks, border_of_nodes, find_blocks, scatter_border
from fenics_contact.types import Array, Floats, Ints64, Mat


@dataclass(frozen=True)
class ToolBlocks:
    """Couplings with the coordinates of the tool with a number `index`: columns (n, 3, 6), the rate of the force on each of
    the local nodes (n,) with them; rows (n, 6, 3), that of the tool's wrench with the motion of the node; corner (6, 6)."""

    index: int
    nodes: Array
    columns: Floats
    rows: Floats
    corner: Floats


@dataclass(frozen=True)
class Blocks:
    """forms: bilinear forms, which know the fast way into the matrix; cells: local nodes (n, k) and matrices (n, 3k, 3k) of
    elements; pairs: rows (m,), rising, columns (m,) and blocks (m, 3, 3) of pairs of nodes, local ones or, with `whole`,
    numbers of the System's blocks; tool: with one; free: diagonal (6 tools,) on the coordinates of tools, counted once; at:
    where a contact's points were, for what it foresees from this tangent; parts: more of the same."""

    forms: tuple[CellForm, ...] = ()
    cells: tuple[Array, Floats] | None = None
    pairs: tuple[Array, Array, Floats] | None = None
    whole: bool = True
    tool: ToolBlocks | None = None
    free: Floats | None = None
    at: Any = None
    parts: tuple["Blocks", ...] = ()


def insert(blocks: Blocks, matrix: PETSc.Mat, border: Border | None) -> None:
    """Add a term's blocks to the matrix, to be assembled afterwards, and to the border where there are tools."""
    for part in blocks.parts:
        insert(part, matrix, border)
    for form in blocks.forms:
        form.add(matrix)
    if blocks.cells is not None and len(blocks.cells[0]):
        nodes, (n, k) = np.ascontiguousarray(blocks.cells[0], dtype=np.int64), blocks.cells[0].shape
        _add(nodes, nodes, blocks.cells[1].reshape(n, k, 3, k, 3).transpose(0, 1, 3, 2, 4), False, matrix)
    if blocks.pairs is not None and len(blocks.pairs[0]):
        rows, columns, values = blocks.pairs
        _add(rows[:, None], columns[:, None], values[:, None, None], blocks.whole, matrix)
    if border is None:
        return
    if blocks.tool is not None:
        _insert_tool(blocks.tool, border)
    if blocks.free is not None:
        border.add(np.diag(blocks.free))


def _add(rows: Ints64, columns: Ints64, blocks: Floats, whole: bool, matrix: Mat) -> None:
    """Add blocks (n, k, k, 3, 3) of rows (n, k) and columns (n, k): those of this process's own nodes where PETSc has them,
    for it takes three times as long; the others by PETSc, which raises an error where the matrix has no place for one."""
    first = matrix.getOwnershipRange()[0] // 3 if whole else 0
    *pattern, values = block_rows(HANDLE(own_part(matrix).handle))
    places = find_blocks(rows - first, columns - first, *pattern)
    add_blocks(places, blocks, values)
    left = places < 0
    if not left.any():
        return
    heads, tails = (np.broadcast_to(part, left.shape)[left] for part in (rows[:, :, None], columns[:, None]))
    _check(heads, tails, whole, matrix)
    starts = np.flatnonzero(np.diff(heads, prepend=-1))
    offsets, tails, heads = (part.astype(PETSc.IntType) for part in (np.append(starts, len(heads)), tails, heads[starts]))
    add = matrix.setValuesBlockedIJV if whole else matrix.setValuesBlockedLocalIJV
    add(offsets, tails, blocks[left], addv=True, rowmap=heads)


def _check(rows: Ints64, columns: Ints64, whole: bool, matrix: Mat) -> None:
    """PETSc puts a block of a process's own row that has no place into that row's first column of another process, if the
    process knows no such column: PETSc.Error in the place of that."""
    if matrix.comm.size == 1:
        return
    if not whole:
        numbers = matrix.getLGMap()[0].block_indices
        rows, columns = numbers[rows], numbers[columns]
    first, end = (n // 3 for n in matrix.getOwnershipRange())
    outside = columns[(first <= rows) & (rows < end) & ((columns < first) | (columns >= end))]
    if not np.isin(outside, other_columns(matrix)).all():
        raise PETSc.Error(63)  # argument out of range, as PETSc says of other blocks without a place


def _insert_tool(tool: ToolBlocks, border: Border) -> None:
    mine = slice(6 * tool.index, 6 * tool.index + 6)
    scatter_border(tool.nodes, tool.columns, tool.rows, border.columns[mine], border.rows[mine])
    border.add(tool.corner, mine, mine)


def tool_blocks(index: int, pose: Pose, nodes: Array, at: tuple[Floats, Floats], rates: tuple[Floats, Floats]) -> ToolBlocks:
    """Couplings of slave nodes with the rigid tool that they meet, from those of the nodes with one another.

    at: (motions B (n, 3, 6) of the nodes, as Pose.motions gives them, forces f (n, 3) on them); rates: (K B (n, 3, 6),
    B^T K (n, 6, 3)) of the rates K of the forces with the nodes. All of it may be one process' part of sums.

    A motion of nodes and tool as one body turns the forces and changes them in no other way. So a tool that moves alone is
    such a motion of both and the nodes' way back: df = w x f - K B (d, w). The wrench on the tool is -B^T f.
    """
    count = len(at[0])  # of all processes' nodes, where sums over them are still to come
    out = np.empty((count, 3, 6)), np.empty((count, 6, 3)), np.empty((6, 6))
    border_of_nodes(at, rates, (pose.rate, pose.lever), out)
    return ToolBlocks(index, nodes, *out)
