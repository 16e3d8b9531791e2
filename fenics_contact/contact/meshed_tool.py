"""A meshed rigid tool as a contact's master: facets that move as one and have no dofs; met by points or by averages."""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.blocks import Blocks, tool_blocks
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.facets import FacetPartner
from fenics_contact.contact.master import Meeting
from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.mortar import MortarPartner
from fenics_contact.contact.node_pattern import NodePattern
from fenics_contact.contact.pair_pattern import PairPattern
from fenics_contact.contact.point_places import FacetFeet
from fenics_contact.kernels.scatter import motions_of_pairs
from fenics_contact.types import Array, Floats, Ints64


class MeshedToolPartner(FacetPartner):
    """Slave points against a meshed tool: its forces act on its six coordinates."""

    def _new_pattern(self) -> PairPattern:
        # what the tool's nodes are coupled by follows from the slave's: behind this rank's slave nodes they are one node
        tool = self.places.first
        blocks = np.concatenate([np.arange(tool), np.full(len(self.places.master.X), tool)])
        pattern = PairPattern(self.places.nodes, self.places.facets[0], blocks, tool + 1)
        nodes = np.column_stack([self.places.nodes, np.full(len(self.places.nodes), tool)])
        pattern.set(np.unique(nodes[:, :, None] * (tool + 1) + nodes[:, None, :]))
        return pattern

    def tangent(self, feet: FacetFeet, trial: Trial) -> Blocks:
        rows, columns, values = self._tangent(feet, trial)
        slave, pose = self.places.first, _pose(feet)
        inside = (rows < slave) & (columns < slave)
        pairs = rows[inside], columns[inside], values[inside]
        at = pose.motions(feet.coords[:slave]), self.response(feet, trial).forces[:slave]
        tool = tool_blocks(self.places.master.index, pose, self.places.slave, at, _by_motions(pairs, at[0]))
        return Blocks(pairs=(*(self.places.slave[part] for part in pairs[:2]), pairs[2]), whole=False, tool=tool, at=feet)

    def couplings(self, feet: FacetFeet, trial: Trial) -> None:
        """None: a tool has no dofs, and nodes of one facet are coupled by the solid."""


class MeshedToolAverages(MortarPartner):
    """Slave nodes against a meshed tool, through samples of the facets around them."""

    def _new_pattern(self) -> NodePattern:
        # what the tool's nodes are coupled by follows from the slave's: behind all blocks of the System they are one more
        tool = self.places.skin.size
        blocks = np.concatenate([self.places.skin.blocks, np.full(len(self.places.master.X), tool)]).astype(np.int64)
        return NodePattern(self.places.around, self.places.facets, blocks, tool + 1)

    def couplings(self, feet: MortarFeet, trial: Trial) -> Ints64 | None:
        keys = super().couplings(feet, trial)
        if keys is None:
            return None
        tool = self.places.skin.size
        rows, columns = np.divmod(keys, tool + 1)
        inside = (rows < tool) & (columns < tool)
        return rows[inside] * tool + columns[inside]

    def tangent(self, feet: MortarFeet, trial: Trial) -> Blocks:
        """Collective: what moves with the tool may belong to other ranks."""
        rows, columns, values, linearised = self._tangent(feet, trial)
        slave, pose, nodes = len(self.places.skin.X), _pose(feet), self.places.skin.size
        inside = (rows < nodes) & (columns < nodes)
        pairs = rows[inside], columns[inside], values[inside]
        numbered = *(np.searchsorted(self.places.skin.moving, part) for part in pairs[:2]), pairs[2]
        x, forces = self.places.skin.each(feet.coords[:slave], self.response(feet, trial).forces[:slave])
        motions = pose.motions(x)
        at = motions, forces
        tool = tool_blocks(self.places.master.index, pose, self.places.skin.owned, at, _by_motions(numbered, motions))
        border = np.stack([tool.columns, tool.rows.transpose(0, 2, 1)])
        self.places.comm.Allreduce(MPI.IN_PLACE, border)
        columns_here, rows_here = border[:, self.places.skin.mine]
        tool = replace(tool, columns=columns_here, rows=np.ascontiguousarray(rows_here.transpose(0, 2, 1)))
        return Blocks(pairs=pairs, tool=tool, at=linearised)


def _pose(feet: Meeting) -> Pose:
    """The tool's, which feet on one have."""
    if feet.pose is None:
        raise ValueError("these feet are on no tool")
    return feet.pose


def _by_motions(pairs: tuple[Array, Array, Floats], motions: Floats) -> tuple[Floats, Floats]:
    """K B (n, 3, 6) and B^T K (n, 6, 3) of rates K as rows, columns and blocks of pairs of nodes, B (n, 3, 6)."""
    by_motion, of_wrench = np.zeros((len(motions), 3, 6)), np.zeros((len(motions), 6, 3))
    motions_of_pairs(*pairs, motions, by_motion, of_wrench)
    return by_motion, of_wrench
