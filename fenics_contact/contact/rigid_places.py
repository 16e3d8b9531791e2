"""Where slave points lie to an analytic tool: distances, normals, and what of the body lies in it."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.entered import Entered, entered
from fenics_contact.contact.passing import Facets, at_start, depths_passed, tool_distances
from fenics_contact.contact.surface import Beside, SlaveSurface
from fenics_contact.contact.tools import RigidTool
from fenics_contact.kernels.rigid_element import Points, ToolPose, distances, point_normals
from fenics_contact.kernels.scatter import stays
from fenics_contact.kernels.status import OPEN
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64, Space

BEHIND = 0.1  # of a cell's height: what of a body may lie in a tool behind the slave surface at the start


class RigidFeet(NamedTuple):
    """Positions x (ne, k, 3) of the slave nodes, facets (nf, m, 3) of the nodes of the facets they lie on, this rank's or
    not [length], and the Pose of the tool."""

    x: Floats
    facets: Floats
    pose: Pose


class RigidPlaces:
    """Of the points of a surface, and the other nodes of its body, at a tool; index: the tool's row in the state's q."""

    sights = None
    crossing = None
    search = np.inf  # gaps from this on are not told apart [length]

    def __init__(self, surface: SlaveSurface, tool: RigidTool, index: int) -> None:
        self.surface, self.tool, self.index = surface, tool, index
        self.reach = tool.reach
        self._feet: RigidFeet | None = None
        self._beside: Beside | None = None  # once asked for
        self._apart = np.empty(0, dtype=np.int64)  # local nodes of bodies that are none of the contact's

    def as_accepted(self) -> AbstractContextManager[None]:
        """Nothing: feet depend on the state alone."""
        return nullcontext()

    def point(self, state: State) -> Floats:
        """The tool's reference point (3,) at a state [length]."""
        return state.pose(self.index).place

    def feet(self, state: State) -> RigidFeet:
        """The places at a state; the same object while these do not change."""
        s, last, pose, u = self.surface, self._feet, state.pose(self.index), state.u.x.array
        x = _placed(s.nodes, s.X, u, None if last is None else last.x)
        facets = x
        if s.between is not None:
            facets = _placed(s.between.nodes, s.between.X, u, None if last is None else last.facets)
        if last is None or x is not last.x or facets is not last.facets or not pose.same(last.pose):
            last = self._feet = RigidFeet(x, facets, pose)
        return last

    first_feet = feet

    def points_at(self, feet: RigidFeet, area: Floats | None = None) -> tuple[Points, ToolPose]:
        """Points and tool as kernels/rigid_element.py takes them."""
        s = self.surface
        return (feet.x, s.a, s.area if area is None else area, s.spacing), self.tool_at(feet.pose)

    def tool_at(self, pose: Pose) -> ToolPose:
        """The tool as kernels/rigid_element.py takes it."""
        tool = self.tool
        return tool.kind, tool.shape, pose.turned(tool.origin), self.axes(pose), pose.travel

    def axes(self, pose: Pose) -> Floats:
        """The tool's axes (3, 3), columns, where it is."""
        return np.ascontiguousarray(pose.turn @ self.tool.axes)

    def normals(self, feet: RigidFeet) -> Floats:
        """Unit normals (ne, nq, 3) of the tool at this rank's slave points."""
        out = np.empty((*self.surface.area.shape, 3))
        point_normals(*self.points_at(feet), out)
        return out

    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which the contact holds this rank's slave points: the tool's normals."""
        return self.normals(self.feet(state))

    def bare(self, feet: RigidFeet, far: bool = False) -> Floats:
        """Nothing of the points (n,): a tool has no end."""
        return np.zeros(self.surface.count)

    def features(self, feet: RigidFeet) -> Array:
        """Codes (n, ...): where one changes the traction has a kink."""
        return np.empty((self.surface.count, 0), dtype=int)

    def overlap(self, state: State, X: Floats, slave: Bools, bodies: Sequence[Ints64]) -> tuple[Floats, Floats]:
        """How deep [length] nodes X (n, 3) of each of the bodies, local nodes, lie in the tool: of the slave surface (mask
        `slave`), and others of the bodies that have such. Another body that lies in the tool is no matter of this contact,
        neither now nor later, see `beside`. Collective."""
        gap = np.empty(len(X))
        distances(X, self.tool_at(state.pose(self.index)), gap)
        parts = [(nodes[slave[nodes]], nodes[~slave[nodes]]) for nodes in bodies]
        here = [(-gap[on].min(initial=0.0), -gap[off].min(initial=0.0), len(on)) for on, off in parts]
        at_surface, behind, count = np.max(state.comm.allgather(here), axis=0).T
        apart = (count == 0) & (behind > BEHIND * self.surface.cell_height)
        self._apart = np.concatenate([bodies[i] for i in np.flatnonzero(apart)] or [self._apart])
        return at_surface, np.where(count > 0, behind, 0.0)

    def cut_off(self, state: State) -> Floats:
        """How much nearer (ne, nq) [length] the slave is to the tool at the points than its facets."""
        return self.surface.cut_off

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Signed distances (n,) to the tool of local nodes with reference positions X (n, 3)."""
        return tool_distances(X + state.u.x.array.reshape(-1, 3)[nodes], self.tool_at(state.pose(self.index)))

    def entered(self, state: State, nearly: float = 1.0, normals: Floats | None = None) -> Entered | None:
        """The facets that the tool has entered between their points, nearly: see `entered`; normals (n, 3): of the
        body at its nodes, in the place of those of facets. None where it has no other side."""
        if self.tool.flat:
            return None
        s, dense, u = self.surface, self.surface.dense, state.u.x.array.reshape(-1, 3)
        x = dense.X + u[dense.nodes]
        points, outward = x if s.between else s.a @ x, None if normals is None else normals[dense.nodes]
        return entered(dense, x, points, self.tool_at(state.pose(self.index)), nearly, outward)

    def crossed(self, state: State) -> None:
        """None: a tool without facets is asked for with `entered`."""

    def beside(self, state: State) -> Beside:
        """The nodes that may meet the tool and are no slaves. Collective."""
        if self._beside is None:
            space = state.u.function_space
            free = np.setdiff1d(np.flatnonzero(~named(space, self.surface.nodes.ravel())), self._apart)
            X = space.tabulate_dof_coordinates()[free]
            outer = compat.locate_blocks(space, compat.exterior_facets(space.mesh))
            gap = np.empty(len(free))
            distances(X, self.tool_at(state.poses.at(self.index, np.zeros_like(state.q[self.index]))), gap)
            self._beside = Beside(free, X, ~named(space, outer)[free] & (gap > 0.0))
        return self._beside

    def lost_depth(self, state: State, trial: Trial) -> float:
        """Zero: an analytic tool knows of every point how deep inside it is."""
        return 0.0

    def passed(self, state: State, trial: Trial) -> tuple[Floats, Floats] | None:
        """How deep (n,) the ways of places on the slave since the last accepted state lead through the tool and out of it
        behind the surface, and the places' reference positions (n, 3) [length]; None where it has no other side."""
        if self.tool.flat:
            return None
        s, now, then = self.surface, self.feet(state), trial.history.feet
        if s.between is not None:
            facets = Facets(s.between.a, s.between.gradients, s.between.X)
        elif s.gradients is not None:
            facets = Facets(s.a, s.gradients, s.X)
        else:
            return None
        before, after = (feet.pose.before(feet.facets) for feet in (then, now))
        return depths_passed(facets, before, after, at_start(self.tool), s.cell_height)

    def back_share(self, state: State) -> float:
        """Zero: an analytic tool knows its outside."""
        return 0.0


def _placed(nodes: Ints, X: Floats, u: Floats, last: Floats | None) -> Floats:
    """Where nodes (ne, k) are (ne, k, 3) with displacements u (dofs,): `last` itself where that is there."""
    return X + u.reshape(-1, 3)[nodes] if last is None or not stays(nodes, X, u, last) else last


def distances_to(places: RigidPlaces, x: Floats, pose: Pose) -> Floats:
    """Signed distances (n,) of places x (n, 3) to a tool in a pose."""
    return tool_distances(x, places.tool_at(pose))


def pressed(space: Space, contacts: Sequence[ContactTerm]) -> Bools:
    """Which of this rank's nodes are of slave facets that contacts press in the state evaluated last. Collective."""
    nodes = [np.empty(0, dtype=np.int32)]
    for contact in contacts:
        if len(statuses := contact.statuses()):
            active = statuses.reshape(contact.surface.area.shape) != OPEN
            nodes.append(contact.surface.nodes[active.any(axis=1)].ravel())
    return named(space, np.concatenate(nodes))


def named(space: Space, nodes: Array) -> Bools:
    """Which of this rank's nodes are among those that any rank names, by its local numbers. Collective."""
    marks = compat.Function(space)
    marks.x.array.reshape(-1, 3)[nodes] = 1.0
    compat.sum_to_owners(marks)
    compat.copy_to_ghosts(marks)
    return np.asarray(marks.x.array.reshape(-1, 3)[:, 0] > 0.0)
