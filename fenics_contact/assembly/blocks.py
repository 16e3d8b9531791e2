"""A term's part of the tangent as plain blocks, and the one place that inserts them into the matrix and the border."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.border import Border
from fenics_contact.assembly.cell_forms import CellForm
from fenics_contact.assembly.pose import Pose, skew
from fenics_contact.kernels.scatter import scatter_border
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
        nodes, values = np.ascontiguousarray(blocks.cells[0]), blocks.cells[1]  # as PETSc asks for them
        matrix.setValuesBlockedLocalRCV(nodes, nodes, values, addv=True)
    if blocks.pairs is not None:
        _insert_pairs(*blocks.pairs, blocks.whole, matrix)
    if border is None:
        return
    if blocks.tool is not None:
        _insert_tool(blocks.tool, border)
    if blocks.free is not None:
        border.corner += np.diag(blocks.free)


def _insert_pairs(rows: Ints64, columns: Ints64, values: Floats, whole: bool, matrix: Mat) -> None:
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    offsets, rows = np.append(starts, len(values)).astype(np.int32), rows[starts].astype(np.int32)
    add = matrix.setValuesBlockedIJV if whole else matrix.setValuesBlockedLocalIJV
    add(offsets, columns.astype(np.int32), values, addv=True, rowmap=rows)


def _insert_tool(tool: ToolBlocks, border: Border) -> None:
    mine = slice(6 * tool.index, 6 * tool.index + 6)
    scatter_border(tool.nodes, tool.columns, tool.rows, border.columns[mine], border.rows[mine])
    border.corner[mine, mine] += tool.corner


def tool_blocks(index: int, pose: Pose, nodes: Array, at: tuple[Floats, Floats], rates: tuple[Floats, Floats]) -> ToolBlocks:
    """Couplings of slave nodes with the rigid tool that they meet, from those of the nodes with one another.

    at: (places x (n, 3) of the nodes, forces f (n, 3) on them); rates: (K B (n, 3, 6), B^T K (n, 6, 3)) of the rates K of
    the forces with the nodes and the nodes' motions B = Pose.motions(x). All of it may be one process' part of sums.

    A motion of nodes and tool as one body turns the forces and changes them in no other way. So a tool that moves alone is
    such a motion of both and the nodes' way back: df = w x f - K B (d, w). The wrench on the tool is -B^T f.
    """
    (x, forces), (by_motion, of_wrench) = at, rates
    motions, turned = pose.motions(x), skew(forces)
    columns = -by_motion
    columns[..., 3:] -= turned
    rows = -of_wrench
    rows[..., 3:, :] += turned
    corner = -np.einsum("nca,ncb->ab", motions, columns)
    corner[3:, :3] -= turned.sum(axis=0)  # torques are about a point that travels too
    rows[..., 3:, :] /= pose.lever
    corner[3:] /= pose.lever
    return ToolBlocks(index, nodes, pose.by_coordinates(columns), np.ascontiguousarray(rows), pose.by_coordinates(corner))
