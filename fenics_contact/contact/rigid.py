"""An analytic rigid tool as a contact's master: forces, their tangent, and what it holds."""

from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.blocks import Blocks, tool_blocks
from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.friction import Friction, turned
from fenics_contact.contact.partner import PointPressures, weighed
from fenics_contact.contact.passing import tool_distances
from fenics_contact.contact.rigid_anchors import RigidAnchors
from fenics_contact.contact.rigid_places import RigidFeet, RigidPlaces
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.tools import RigidTool
from fenics_contact.kernels.foreseen import WEIGHT
from fenics_contact.kernels.rigid_element import ElementLaws, contact_elements
from fenics_contact.kernels.scatter import motions_of_elements, scatter_forces
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.types import Array, Bools, Floats, Ints

WAYS = tuple(0.5**k for k in range(6))  # of the slave's size, of a body that is looked at whether it runs into a tool
NEARER = 1e-3  # of its way: what comes nearer by less goes along the tool


class Linearised(NamedTuple):
    """What a tangent knew: where the points were, what they did there, and rubbed (ne, nq, 3, 5): their friction, and its
    rates with gap and way, in the tool's frame."""

    feet: RigidFeet
    response: Response
    rubbed: Floats


class RigidPartner(PointPressures):
    """Slave points against an analytic tool, whose signed distance holds them.

    surface: SlaveSurface; tool: RigidTool; index: its row in the state's q.
    """

    grounded = True
    settles = False

    def __init__(self, surface: SlaveSurface, tool: RigidTool, index: int) -> None:
        self.surface, self.tool, self.index = surface, tool, index
        self.name, self.edge_kind = tool.name, tool.edge_kind
        # over a sharp edge the distance jumps, and frictionless forces have no potential
        self.foresees = self.foretells = self.softens = self.smooth = tool.edge_kind != "sharp"
        self.places, self.anchors = RigidPlaces(surface, tool, index), RigidAnchors(self)

    def laws(self, trial: Trial, touch: float | None = None) -> ElementLaws:
        """Laws as kernels/rigid_element.py takes them; touch [length]: in the place of the law's own."""
        law, friction = trial.law, trial.law.friction
        if friction.ratio != 1.0:  # its direction is seen in the tool's frame, with which it turns
            friction = friction._replace(along=tuple(self.tool.axes.T @ friction.along))
        touch = float(law.touch if touch is None else touch)
        return law.eps_n, law.eps_t, self.surface.stiffness, friction, touch, trial.judged.reshape(-1, 4)

    def friction(self, feet: RigidFeet, trial: Trial) -> Friction:
        """The law of friction where the tool is."""
        return turned(trial.law.friction, feet.pose)

    def _evaluate(self, feet: RigidFeet, trial: Trial, want_tangent: bool) -> tuple[Response, Floats, Floats]:
        ne, nq, k = self.surface.a.shape
        traction, forces = np.empty((ne, nq, 3)), np.empty((ne, k, 3))
        gap, cover, status = np.empty((ne, nq)), np.empty((ne, nq)), np.empty((ne, nq), dtype=np.int32)
        count = ne if want_tangent else 0
        tangent, rubbed = np.empty((count, 3 * k, 3 * k)), np.zeros((count, nq, 3, 5))
        history = trial.history.anchors[0], trial.history.shift
        out = forces, tangent, traction, gap, status, cover, rubbed
        where = self.places.points_at(feet, trial.area)
        contact_elements(*where, self.laws(trial), history, want_tangent, out)
        return Response(traction, gap, status, cover, forces), tangent, rubbed

    def response(self, feet: RigidFeet, trial: Trial) -> Response:
        return self._evaluate(feet, trial, False)[0]

    def add_forces(self, feet: RigidFeet, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to the slave nodes' forces and its opposite to the tool's, (14)."""
        scatter_forces(self.surface.nodes, response.forces, residual)
        tool_residual[self.index] -= feet.pose.wrench(feet.x.reshape(-1, 3), response.forces.reshape(-1, 3))

    def on_slave(self, feet: RigidFeet, response: Response) -> tuple[Floats, Floats]:
        """Places and forces (n, 3) of the slave nodes, a node's in parts."""
        return feet.x.reshape(-1, 3), -response.forces.reshape(-1, 3)

    def tangent(self, feet: RigidFeet, trial: Trial) -> Blocks:
        response, tangent, rubbed = self._evaluate(feet, trial, True)
        active = np.flatnonzero((response.status != OPEN).any(axis=1))
        nodes, K = self.surface.nodes[active], tangent[active]
        x, forces = (of_nodes[active].reshape(-1, 3) for of_nodes in (feet.x, response.forces))
        motions, rates = feet.pose.motions(x), (np.empty((len(x), 3, 6)), np.empty((len(x), 6, 3)))
        motions_of_elements(K, motions, *rates)
        tool = tool_blocks(self.index, feet.pose, nodes.ravel(), (motions, forces), rates)
        return Blocks(cells=(nodes, K), tool=tool, at=Linearised(feet, response, rubbed))

    def couplings(self, feet: RigidFeet, trial: Trial) -> None:
        """None: a tool has no dofs, and nodes of one facet are coupled by the solid."""

    def foreseen(self, feet: RigidFeet, before: Linearised, trial: Trial) -> Floats:
        """Gaps, shifts added, and ways (4 ne nq,) that decide, as the tangent `before` foresees them at these places: were
        the tool as flat as it is before each point there, and did it go along the tangents of its circles, as the points do
        in a solve; of ways a share of what is found there."""
        then, now = (np.einsum("eqk,ekc->eqc", self.surface.a, at.x) for at in (before.feet, feet))
        way, normals = now - then - before.feet.pose.way(feet.pose, then), self.places.normals(before.feet)
        rise = np.einsum("eqc,eqc->eq", normals, way)[..., None]
        gaps = before.response.gap + rise[..., 0] + trial.history.shift
        if not trial.rough:
            return _deciding(gaps, np.zeros_like(way))
        along = np.einsum("eqc,cd->eqd", way - rise * normals, self.places.axes(before.feet.pose))
        change = np.concatenate([rise, along], axis=2)
        stick = trial.law.eps_t[:, None, None]
        ways = (before.rubbed[..., 0] + np.einsum("eqab,eqb->eqa", before.rubbed[..., 1:], change)) / stick
        found = self.anchors.slip(feet, trial.history.anchors)
        share = np.minimum(WEIGHT * self.surface.stiffness[:, None, None] / stick, 1.0)
        # what comes to touch is pressed by all of its gap, and rubs by all of its way
        ways = weighed(ways, found, np.where((before.response.status == OPEN)[..., None], 1.0, share))
        return _deciding(gaps, ways)

    def deciding(self, feet: RigidFeet, before: Trial, trial: Trial, gaps: Floats, wide: Floats) -> Floats:
        """See `Partner.deciding`: these gaps, and the ways (4 ne nq,) of what stuck by the friction that it had; of what is
        to slip the farther."""
        found, stick = self.response(feet, before), trial.law.eps_t[:, None, None]
        ways = self.anchors.slip(feet, trial.history.anchors) / np.minimum(wide, 1.0)[..., None]
        return _deciding(gaps, np.where((found.status == STICK)[..., None], self._rubbed(feet, found) / stick, ways))

    def carried_on(self, trial: Trial, share: float) -> Floats:
        """Gaps, shifts added, carried on from those of the last accepted step by a share of the change in it, and ways
        (4 ne nq,) that decide at the start of the next: of what slipped beyond its cone."""
        feet, anchors = trial.history.feet, trial.history.anchors
        further = np.where(self.response(feet, trial).status == SLIP, 2.0, 1.0)[..., None]
        return _deciding(trial.history.carried_on(share), further * self.anchors.slip(feet, anchors))

    def ahead(self, feet: RigidFeet, before: Linearised, trial: Trial) -> Floats:
        """See `ContactPartner.ahead`: of the ways that decide what sticks, in the tool's frame."""
        rubbed, slips = self._rubbed(before.feet, before.response), before.response.status == SLIP
        ways = [self.anchors.here(at, trial)[0] - trial.history.anchors[0] for at in (before.feet, feet)]
        return np.stack([np.einsum("pc,pc->p", rubbed[slips], way[slips]) for way in ways], axis=-1)

    def _rubbed(self, feet: RigidFeet, response: Response) -> Floats:
        """Friction (ne, nq, 3) in the tool's frame [pressure]."""
        traction, normals = response.traction, self.places.normals(feet)
        return (traction - np.einsum("eqc,eqc->eq", traction, normals)[..., None] * normals) @ self.places.axes(feet.pose)

    @property
    def nodes(self) -> Ints:
        """This rank's nodes of the slave, local numbers."""
        return np.unique(self.surface.nodes)

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the dofs `held` do not: a tool is held."""
        return False

    def held_axes(self, state: State, gap: Floats, rough: bool) -> set[str]:
        """Axes along which the contact can hold a body: all with friction, else those in which its first normal has a part,
        and those along which the body runs into the tool, as into the walls of a groove. Collective."""
        here = (np.inf, np.zeros(3))
        if gap.size:
            nearest = np.unravel_index(gap.argmin(), gap.shape)
            here = (gap[nearest], self.places.looks(state)[nearest])
        normal = np.abs(min(state.comm.allgather(here), key=lambda pair: pair[0])[1])
        holds = (normal > 1e-6) | self._runs_into(state)
        return {axis for axis, held in zip("xyz", holds, strict=True) if rough or held}

    def _runs_into(self, state: State) -> Bools:
        """Along which axes (3,), one way or the other, a slave that moves as a rigid body comes nearer to the tool than it
        is, or deeper into it. Collective."""
        feet, comm = self.places.feet(state), state.comm
        x, tool = (self.surface.a @ feet.x).reshape(-1, 3), self.places.tool_at(feet.pose)
        low, high = np.min(comm.allgather([x.min(axis=0, initial=np.inf), (-x).min(axis=0, initial=np.inf)]), axis=0)
        ways = np.linalg.norm(low + high) * np.array([0.0, *WAYS, *(-way for way in WAYS)])
        nearest = [[tool_distances(x + way * axis, tool).min(initial=np.inf) for way in ways] for axis in np.eye(3)]
        gaps = np.min(comm.allgather(nearest), axis=0)
        return np.asarray((gaps < gaps[:, :1] - NEARER * np.abs(ways)).any(axis=1))


def _deciding(gaps: Floats, ways: Floats) -> Floats:
    """Gaps and ways (ne, nq, 3) as `Trial.judged` has them."""
    return np.concatenate([gaps.reshape(*ways.shape[:2], 1), ways], axis=2).ravel()
