"""An analytic rigid tool as a contact's master: where slave points meet it, forces, tangents, anchors in its frame."""

from typing import NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks, tool_blocks
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.term import State
from fenics_contact.contact.friction import Friction, turned
from fenics_contact.contact.surface import Beside, SlaveSurface
from fenics_contact.contact.tools import RigidTool
from fenics_contact.contact.trial import Law, Response, Trial
from fenics_contact.kernels.rigid_element import (
    ElementLaws,
    Points,
    ToolPose,
    committed_anchors,
    contact_elements,
    distances,
    point_normals,
)
from fenics_contact.kernels.scatter import scatter_forces
from fenics_contact.kernels.status import OPEN, STICK
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints, Space


class RigidFeet(NamedTuple):
    """Positions x (ne, k, 3) of the slave nodes [length], and the Pose of the tool."""

    x: Floats
    pose: Pose


def _known(space: Space, nodes: Array) -> Bools:
    """Which of this rank's nodes are among those that any rank names, by its local numbers. Collective."""
    named = compat.Function(space)
    named.x.array.reshape(-1, 3)[nodes] = 1.0
    compat.sum_to_owners(named)
    compat.copy_to_ghosts(named)
    return np.asarray(named.x.array.reshape(-1, 3)[:, 0] > 0.0)


class RigidPartner:
    """Slave points against an analytic tool, whose signed distance holds them.

    surface: SlaveSurface; tool: RigidTool; index: its row in the state's q. Anchors are ((ne, nq, 3),), places in the
    tool's frame.
    """

    grounded = True
    foresees = False
    settles, sights = False, None
    search = np.inf  # gaps from this on are not told apart [length]
    slid_off = "make the master's surface larger where the slave leaves it, raise the penalty, or end the path before"

    def __init__(self, surface: SlaveSurface, tool: RigidTool, index: int) -> None:
        self.surface, self.tool, self.index = surface, tool, index
        self.name, self.edge = tool.name, tool.edge
        self.reach = tool.reach
        self.softens = tool.edge != "sharp"
        self.smooth = tool.edge != "sharp"  # have frictionless forces a potential?
        self._feet: RigidFeet | None = None
        self._beside: Beside | None = None  # once asked for

    def point(self, state: State) -> Floats:
        """The tool's reference point (3,) at a state [length]."""
        return state.pose(self.index).place

    # -- where the points are -------------------------------------------------------------------------------------
    def feet(self, state: State) -> RigidFeet:
        """The places at a state; the same object while these do not change."""
        s, feet = self.surface, self._feet
        now = RigidFeet(s.X + state.u.x.array.reshape(-1, 3)[s.nodes], state.pose(self.index))
        if feet is None or not np.array_equal(now.x, feet.x) or not now.pose.same(feet.pose):
            feet = self._feet = now
        return feet

    first_feet = feet

    def _at(self, feet: RigidFeet, area: Floats | None = None) -> tuple[Points, ToolPose]:
        """Points and tool as kernels/rigid_element.py takes them."""
        s = self.surface
        return (feet.x, s.a, s.area if area is None else area, s.spacing), self._placed_tool(feet.pose)

    def _placed_tool(self, pose: Pose) -> ToolPose:
        tool = self.tool
        return tool.kind, tool.shape, pose.turned(tool.origin), self._axes(pose), pose.travel

    def _axes(self, pose: Pose) -> Floats:
        """The tool's axes (3, 3), columns, where it is."""
        return np.ascontiguousarray(pose.turn @ self.tool.axes)

    def _law(self, law: Law, touch: float | None = None) -> ElementLaws:
        friction = law.friction
        if friction.ratio != 1.0:  # its direction is seen in the tool's frame, with which it turns
            friction = friction._replace(along=tuple(self.tool.axes.T @ friction.along))
        return law.eps_n, law.eps_t, self.surface.stiffness, friction, float(law.touch if touch is None else touch)

    def friction(self, feet: RigidFeet, trial: Trial) -> Friction:
        """The law of friction where the tool is."""
        return turned(trial.law.friction, feet.pose)

    # -- forces and tangent ---------------------------------------------------------------------------------------
    def _evaluate(self, feet: RigidFeet, trial: Trial, want_tangent: bool) -> tuple[Response, Floats]:
        ne, nq, k = self.surface.a.shape
        traction, forces = np.empty((ne, nq, 3)), np.empty((ne, k, 3))
        gap, excess, cover, status = (*(np.empty((ne, nq)) for _ in range(3)), np.empty((ne, nq), dtype=np.int32))
        count = ne if want_tangent else 0
        tangent = np.empty((count, 3 * k, 3 * k))
        history = trial.history.anchors[0], trial.history.shift
        out = forces, tangent, traction, gap, status, excess, cover
        contact_elements(*self._at(feet, trial.area), self._law(trial.law), history, trial.judged, want_tangent, out)
        return Response(traction, gap, status, excess, cover, forces), tangent

    def response(self, feet: RigidFeet, trial: Trial) -> Response:
        return self._evaluate(feet, trial, False)[0]

    def add_forces(self, feet: RigidFeet, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to the slave nodes' forces and its opposite to the tool's, (14)."""
        active = np.flatnonzero((response.status != OPEN).any(axis=1))
        scatter_forces(active, self.surface.nodes, response.forces, residual)
        x, forces = (of_nodes[active].reshape(-1, 3) for of_nodes in (feet.x, response.forces))
        tool_residual[self.index] -= feet.pose.wrench(x, forces)

    def on_slave(self, feet: RigidFeet, response: Response) -> tuple[Floats, Floats]:
        """Places and forces (n, 3) of the slave nodes, a node's in parts."""
        return feet.x.reshape(-1, 3), -response.forces.reshape(-1, 3)

    def tangent(self, feet: RigidFeet, trial: Trial) -> Blocks:
        response, tangent = self._evaluate(feet, trial, True)
        active = np.flatnonzero((response.status != OPEN).any(axis=1))
        nodes, K, (ne, k) = self.surface.nodes[active], tangent[active], (len(active), feet.x.shape[1])
        x, forces = (of_nodes[active].reshape(-1, 3) for of_nodes in (feet.x, response.forces))
        motions = feet.pose.motions(x).reshape(ne, 3 * k, 6)
        rates = (K @ motions).reshape(-1, 3, 6), (K.transpose(0, 2, 1) @ motions).reshape(-1, 3, 6).transpose(0, 2, 1)
        tool = tool_blocks(self.index, feet.pose, nodes.ravel(), (x, forces), rates)
        return Blocks(cells=(nodes, K), tool=tool, at=feet)

    def couplings(self, feet: RigidFeet, trial: Trial) -> None:
        """None: a tool has no dofs, and nodes of one facet are coupled by the solid."""

    def foreseen(self, feet: RigidFeet, before: RigidFeet, trial: Trial) -> Floats:
        """Gaps (ne nq,) at these places, shifts added: on a tool the tangent foresees no others."""
        return (self.response(feet, trial).gap + trial.history.shift).ravel()

    # -- anchors --------------------------------------------------------------------------------------------------
    def _committed(self, feet: RigidFeet, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        new, sliding = np.empty_like(trial.history.anchors[0]), np.empty_like(trial.area)
        history = trial.history.anchors[0], trial.history.shift
        committed_anchors(*self._at(feet), self._law(trial.law, touch), history, new, sliding)
        return (new,), sliding

    def no_anchors(self) -> Anchors:
        return (np.zeros((*self.surface.area.shape, 3)),)

    def places(self, feet: RigidFeet, trial: Trial) -> Anchors:
        """The points' places on the tool."""
        return self._committed(feet, trial, -np.inf)[0]

    resting = places

    def committed(self, feet: RigidFeet, trial: Trial) -> tuple[Anchors, Floats]:
        """The anchors to keep when a step is accepted, and the ways slid in it (ne, nq) [length]."""
        return self._committed(feet, trial, None)

    def slips(self, feet: RigidFeet, trial: Trial, status: Ints) -> Floats:
        """What the penalty gave way in stick (ne, nq) [length]."""
        return np.linalg.norm(self._slip(feet, trial, trial.history.rests, status == STICK), axis=2)

    def _slip(self, feet: RigidFeet, trial: Trial, rests: Anchors, which: Bools | bool = True) -> Floats:
        """Slip (ne, nq, 3) of some points since they were at rest, in the tool's frame [length]; 0 for others."""
        moved, normal = self.places(feet, trial)[0] - rests[0], self.normals(feet) @ self._axes(feet.pose)
        along = np.einsum("eqc,eqc->eq", moved, normal)[..., None] * normal
        return np.where(np.broadcast_to(which, moved.shape[:2])[..., None], moved - along, 0.0)

    def augmented(self, feet: RigidFeet, trial: Trial, status: Ints, share: float) -> Anchors:
        """Uzawa's update of friction: anchors that give sticking points a traction greater by share eps_T times slip."""
        return (trial.history.anchors[0] - share * self._slip(feet, trial, trial.history.rests, status == STICK),)

    def stiffened(self, feet: RigidFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for points that slip on from rest as they do."""
        foot, anchor = self.places(feet, trial)[0], trial.history.anchors[0]
        return (foot - (foot - anchor + (factor - 1.0) * self._slip(feet, trial, rests)) / factor,)

    def chosen(self, points: Bools, ours: Anchors, others: Anchors) -> Anchors:
        """Our anchors at some points (ne, nq), the others elsewhere."""
        return tuple(
            np.where(points.reshape(one.shape[:-1])[..., None], one, two) for one, two in zip(ours, others, strict=True)
        )

    def packed(self, anchors: Anchors, name: str) -> dict[str, Array]:
        """Anchors as arrays (ne, ...) that no partition changes."""
        return {name: anchors[0]}

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        return (np.ascontiguousarray(values[name]),)

    # -- what else is asked of a master ---------------------------------------------------------------------------
    def normals(self, feet: RigidFeet) -> Floats:
        """Unit normals (ne, nq, 3) of the tool at this rank's slave points."""
        out = np.empty((*self.surface.area.shape, 3))
        point_normals(*self._at(feet), out)
        return out

    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which the contact holds this rank's slave points: the tool's normals."""
        return self.normals(self.feet(state))

    def bare(self, feet: RigidFeet) -> Floats:
        """Nothing of the points (n,): a tool has no end."""
        return np.zeros(self.surface.points)

    def features(self, feet: RigidFeet) -> Array:
        """Codes (n, ...): where one changes the traction has a kink."""
        return np.empty((self.surface.points, 0), dtype=int)

    def touches(self, blocks: Array) -> int:
        """Number of this rank's slave nodes among the local nodes `blocks`."""
        return int(np.isin(self.surface.nodes, blocks).sum())

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the dofs `held` do not: a tool is held."""
        return False

    def held_axes(self, state: State, gap: Floats, rough: bool) -> set[str]:
        """Axes along which the contact can hold a body: all with friction, else those of its first normal. Collective."""
        here = (np.inf, np.zeros(3))
        if gap.size:
            nearest = np.unravel_index(gap.argmin(), gap.shape)
            here = (gap[nearest], self.looks(state)[nearest])
        comm = state.u.function_space.mesh.comm
        normal = np.abs(min(comm.allgather(here), key=lambda pair: pair[0])[1])
        return {axis for axis, part in zip("xyz", normal, strict=True) if rough or part > 1e-6}

    def overlap(self, state: State, X: Floats, slave: Bools) -> tuple[float, float]:
        """How deep [length] nodes X (n, 3) lie in the tool: of the slave surface (mask `slave`), and others. Collective."""
        gap = np.empty(len(X))
        distances(X, self._placed_tool(state.pose(self.index)), gap)
        here = -gap[slave].min(initial=0.0), -gap[~slave].min(initial=0.0)
        at_surface, behind = np.max(state.u.function_space.mesh.comm.allgather(here), axis=0)
        return float(at_surface), float(behind)

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Signed distances (n,) to the tool of local nodes with reference positions X (n, 3)."""
        return self._gaps(state, X + state.u.x.array.reshape(-1, 3)[nodes])

    def sags(self, state: State) -> Floats:
        """How much deeper (nf,) facets lie in the tool between slave nodes than at these; none where points are no nodes."""
        if (between := self.surface.between) is None:
            return np.empty(0)
        x = between.X + state.u.x.array.reshape(-1, 3)[between.nodes]
        places = np.concatenate([x, np.einsum("eqk,ekc->eqc", between.a, x)], axis=1)
        gaps = np.minimum(self._gaps(state, places.reshape(-1, 3)).reshape(places.shape[:2]), 0.0)
        count = x.shape[1]
        return np.asarray(gaps[:, :count].min(axis=1, initial=0.0) - gaps[:, count:].min(axis=1, initial=0.0))

    def _gaps(self, state: State, x: Floats) -> Floats:
        """Signed distances (n,) to the tool of places x (n, 3)."""
        gap = np.empty(len(x))
        distances(x, self._placed_tool(state.pose(self.index)), gap)
        return gap

    def lean(self, feet: object, trial: Trial, held: Bools) -> Floats:
        """Nothing: pressure acts along the tool's normals."""
        return np.zeros(4)

    def beside(self, state: State) -> Beside:
        """The nodes that may meet the tool and are no slaves. Collective."""
        if self._beside is None:
            space = state.u.function_space
            free = np.flatnonzero(~_known(space, self.surface.nodes.ravel()))
            X = space.tabulate_dof_coordinates()[free]
            outer = compat.locate_blocks(space, compat.exterior_facets(space.mesh))
            gap = np.empty(len(free))
            distances(X, self._placed_tool(state.poses.at(self.index, np.zeros_like(state.q[self.index]))), gap)
            self._beside = Beside(free, X, ~_known(space, outer)[free] & (gap > 0.0))
        return self._beside

    def lost_depth(self, state: State, trial: Trial) -> float:
        """Zero: an analytic tool knows of every point how deep inside it is."""
        return 0.0

    def back_share(self, state: State) -> float:
        """Zero: an analytic tool knows its outside."""
        return 0.0
