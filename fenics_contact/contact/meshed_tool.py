"""A meshed rigid tool as a contact's master: facets that move as one and have no dofs; met by points or by averages."""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.blocks import Blocks, tool_blocks
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.term import State
from fenics_contact.contact.facets import FacetFeet, FacetPartner, unit
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.mortar import MortarPartner
from fenics_contact.contact.node_pattern import NodePattern
from fenics_contact.contact.pair_pattern import PairPattern
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.tools import MeshedTool
from fenics_contact.contact.trial import Trial
from fenics_contact.kernels.scatter import motions_of_pairs
from fenics_contact.timing import Timers
from fenics_contact.types import Array, Floats, Ints64, Space

# A slave point and the facet nearest to it say on which side of the tool the body is if their normals are this parallel.
DECISIVE = 0.5
SAMPLES = 300  # slave points of a rank that are asked for it
SLID_OFF = (
    "the tool has slid past the end of the slave surface: end the path before, keep the tool over it, or, where the tool "
    "itself ends there, make its surface larger; or, where the body snaps past it, let damping carry it on: solve(..., "
    "damping=True)"
)


class MeshedToolPartner(FacetPartner):
    """Slave points against a meshed tool: its forces act on its six coordinates."""

    grounded = True
    slid_off = SLID_OFF

    def __init__(
        self,
        surface: SlaveSurface,
        facets: tuple[Ints64, Ints64, Ints64],
        tool: MeshedTool,
        index: int,
        space: Space,
        timers: Timers,
    ) -> None:
        super().__init__(tool.name, surface, facets, ToolSurface(tool, index), space, timers)
        self.index, self.edge = index, f"meshed, {len(tool.nodes)} facets"

    def _new_pattern(self, space: Space) -> PairPattern:
        # what the tool's nodes are coupled by follows from the slave's: behind this rank's slave nodes they are one node
        tool = len(self._local)
        blocks = np.concatenate([np.arange(tool), np.full(len(self.master.X), tool)])
        pattern = PairPattern(self._nodes, self._facets[0], blocks, tool + 1)
        nodes = np.column_stack([self._nodes, np.full(len(self._nodes), tool)])
        pattern.set(np.unique(nodes[:, :, None] * (tool + 1) + nodes[:, None, :]))
        return pattern

    def tangent(self, feet: FacetFeet, trial: Trial) -> Blocks:
        rows, columns, values = self._tangent(feet, trial)
        slave, pose = len(self._local), _pose(feet)
        inside = (rows < slave) & (columns < slave)
        pairs = rows[inside], columns[inside], values[inside]
        at = feet.coords[:slave], self.response(feet, trial).forces[:slave]
        tool = tool_blocks(self.index, pose, self._local, at, _by_motions(pairs, pose.motions(at[0])))
        return Blocks(pairs=(*(self._local[part] for part in pairs[:2]), pairs[2]), whole=False, tool=tool, at=feet)

    def couplings(self, feet: FacetFeet, trial: Trial) -> None:
        """None: a tool has no dofs, and nodes of one facet are coupled by the solid."""

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the dofs `held` do not: a tool is held."""
        return False

    def back_share(self, state: State) -> float:
        """Share of the slave points that see the nearest facet of the tool from behind. Collective."""
        coords, points, normals, _ = self._placed(state)
        s = self.surface
        if s.gradients is not None:  # nodal normals are means of facets of degree 1
            x = s.X + state.u.x.array.reshape(-1, 3)[s.nodes]
            tangents = np.einsum("eqtk,ekc->eqtc", s.gradients, x).reshape(-1, 2, 3)
            normals = unit(np.cross(tangents[:, 0], tangents[:, 1]))
        return _seen_from_behind(self._comm, points, normals, coords[self._facets[0]], s.cell_height)


class MeshedToolAverages(MortarPartner):
    """Slave nodes against a meshed tool, through samples of the facets around them."""

    grounded = True
    slid_off = SLID_OFF

    def __init__(self, surface: SlaveSurface, skin: MasterSurface, tool: MeshedTool, index: int, timers: Timers) -> None:
        super().__init__(tool.name, surface, skin, ToolSurface(tool, index), timers)
        self.index, self.edge = index, f"meshed, {len(tool.nodes)} facets"

    def _new_pattern(self) -> NodePattern:
        # what the tool's nodes are coupled by follows from the slave's: behind all blocks of the System they are one more
        tool = self.skin.size
        blocks = np.concatenate([self.skin.blocks, np.full(len(self.master.X), tool)]).astype(np.int64)
        return NodePattern(self.samples, self._facets[0], blocks, tool + 1)

    def couplings(self, feet: MortarFeet, trial: Trial) -> Ints64 | None:
        keys = super().couplings(feet, trial)
        if keys is None:
            return None
        tool = self.skin.size
        rows, columns = np.divmod(keys, tool + 1)
        inside = (rows < tool) & (columns < tool)
        return rows[inside] * tool + columns[inside]

    def tangent(self, feet: MortarFeet, trial: Trial) -> Blocks:
        """Collective: what moves with the tool may belong to other ranks."""
        rows, columns, values, linearised = self._tangent(feet, trial)
        slave, pose, nodes = len(self.skin.X), _pose(feet), self.skin.size
        inside = (rows < nodes) & (columns < nodes)
        pairs = rows[inside], columns[inside], values[inside]
        numbered = *(np.searchsorted(self.skin.moving, part) for part in pairs[:2]), pairs[2]
        at = self.skin.each(feet.coords[:slave], self.response(feet, trial).forces[:slave])
        tool = tool_blocks(self.index, pose, self.skin.owned, at, _by_motions(numbered, pose.motions(at[0])))
        border = np.stack([tool.columns, tool.rows.transpose(0, 2, 1)])
        self._comm.Allreduce(MPI.IN_PLACE, border)
        columns_here, rows_here = border[:, self.skin.mine]
        tool = replace(tool, columns=columns_here, rows=np.ascontiguousarray(rows_here.transpose(0, 2, 1)))
        return Blocks(pairs=pairs, tool=tool, at=linearised)

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the dofs `held` do not: a tool is held."""
        return False

    def back_share(self, state: State) -> float:
        """Share of the samples that see the nearest facet of the tool from behind. Collective."""
        feet = self.feet(state)
        normals, corners = -feet.projection[5], feet.coords[self._facets[0]]
        return _seen_from_behind(self._comm, feet.points, normals, corners, self.surface.cell_height)


def _pose(feet: FacetFeet | MortarFeet) -> Pose:
    """The tool's, which feet on one have."""
    if feet.pose is None:
        raise ValueError("these feet are on no tool")
    return feet.pose


def _by_motions(pairs: tuple[Array, Array, Floats], motions: Floats) -> tuple[Floats, Floats]:
    """K B (n, 3, 6) and B^T K (n, 6, 3) of rates K as rows, columns and blocks of pairs of nodes, B (n, 3, 6)."""
    by_motion, of_wrench = np.zeros((len(motions), 3, 6)), np.zeros((len(motions), 6, 3))
    motions_of_pairs(*pairs, motions, by_motion, of_wrench)
    return by_motion, of_wrench


def _seen_from_behind(comm: MPI.Comm, points: Floats, normals: Floats, corners: Floats, near: float) -> float:
    """Share of points (np, 3) with outward normals (np, 3) that see the nearest facet, corners (nf, 4, 3), from behind.

    near: how close [length] to it only the normals decide. Collective.
    """
    some = slice(None, None, max(len(points) // SAMPLES, 1))
    centres, outward = corners.mean(axis=1), unit(area_vectors(corners))
    nearest = np.array([np.argmin(((centres - x) ** 2).sum(axis=1)) for x in points[some]], dtype=np.int64)
    toward = np.einsum("pc,pc->p", points[some] - centres[nearest], outward[nearest])
    facing = -np.einsum("pc,pc->p", normals[some], outward[nearest])
    behind = (facing < -DECISIVE) & (toward < near)
    before = (facing > DECISIVE) & (toward > -near)
    behind, before = comm.allreduce(np.array([behind.sum(), before.sum()]))
    return behind / max(behind + before, 1)
