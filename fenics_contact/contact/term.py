"""Contact of a slave surface with a rigid tool as one term of a System: forces, tangent, history."""

import numpy as np

from fenics_contact import compat
from fenics_contact.contact.friction import friction_of
from fenics_contact.contact.measures import contact_measures
from fenics_contact.contact.points import SlavePoints
from fenics_contact.kernels.rigid_element import committed_anchors, contact_elements, distances, point_normals
from fenics_contact.kernels.scatter import scatter_border, scatter_forces
from fenics_contact.kernels.status import OPEN, STICK
from fenics_contact.timing import Timers

# Gaps up to this fraction of a cell's height count as touching: surfaces drawn in contact carry round-off gaps.
TOUCH = 1e-10


class RigidContact(SlavePoints):
    """Penalty contact with Coulomb friction between slave points and a rigid tool.

    surface: SlaveSurface; tool: RigidTool; index: row of the tool in the state's travel; friction: Coulomb's mu
    or what contact/friction.py gives; normal_penalty, tangential_penalty (ne,) [pressure/length]. Evaluation is pure;
    `commit` writes the anchors.
    """

    grounded = True

    def __init__(self, name, surface, tool, index, friction, normal_penalty, tangential_penalty):
        self.name, self.surface, self.tool, self.index = name, surface, tool, index
        self.friction = friction_of(friction)
        self.normal_penalty, self.tangential_penalty = normal_penalty, tangential_penalty
        self.master_name, self.edge = tool.name, tool.edge
        self.softens = tool.edge != "sharp"
        self.symmetric = not self.rough and tool.edge != "sharp"
        self.touch = TOUCH * surface.cell_height
        ne, k = surface.nodes.shape
        nq = surface.area.shape[1]
        self._force = np.zeros((ne, k, 3))
        self._tangent = np.zeros((ne, 3 * k, 3 * k))
        self._arm = np.zeros((ne, k, 3, 3))
        self.traction = np.zeros((ne, nq, 3))
        self.gap = np.zeros((ne, nq))
        self.status = np.zeros((ne, nq), dtype=np.int32)
        self.excess = np.zeros((ne, nq))
        self.cover = np.ones((ne, nq))
        self.slip_path = np.zeros((ne, nq))
        self.met = np.zeros((ne, nq), dtype=bool)
        self._anchor, self._rest, self.shift = np.zeros((ne, nq, 3)), np.zeros((ne, nq, 3)), np.zeros((ne, nq))
        self._kept = self._anchor, self.shift  # those of the last accepted step
        self._feet = None  # where the points were on the tool then, in its frame
        self._beside = None  # (local numbers, reference positions) of the nodes that are no slaves, once asked for
        self.set_up_penalties()
        self.timers = Timers()  # those of the System it becomes part of

    def initialise(self, state):
        """Anchor every point at its projection in the initial state."""
        self._feet = self._rest = self._anchor = self.before = self._anchors(state, -np.inf)[0]
        self._kept = self._anchor, self.shift
        self.evaluate(state, True)

    def _placed_tool(self, state):
        tool = self.tool
        return tool.kind, tool.shape, tool.origin, tool.axes, state.travel[self.index]

    def _at(self, state):
        """Points, displacements and tool as kernels/rigid_element.py takes them."""
        s = self.surface
        return (s.X, s.nodes, s.a, s.area, s.spacing), state.u.x.array, self._placed_tool(state)

    def _law(self, touch):
        return self.normal_penalty, self.tangential_penalty, self.surface.stiffness, self.friction, float(touch)

    def evaluate(self, state, want_tangent=False):
        """Evaluate all points; returns the numbers of the elements in contact."""
        if self._feet is None:  # the first state after a restart
            self._feet = self._anchors(state, -np.inf)[0]
        at, law = self._at(state), self._law(self.touch)
        at_points = self.traction, self.gap, self.status, self.excess, self.cover
        out = self._force, self._tangent, self._arm, *at_points
        with self.timers("contact kernel"):
            contact_elements(*at, law, (self._anchor, self.shift), self._judged, want_tangent, out)
        return np.flatnonzero((self.status != OPEN).any(axis=1))

    def add_residual(self, state, residual, tool_residual):
        """Add a area T to the slave nodes' forces and its opposite to the tool's, (14)."""
        active = self.evaluate(state)
        with self.timers("insertion"):
            scatter_forces(active, self.surface.nodes, self._force, residual)
            tool_residual[self.index] -= self._force[active].sum(axis=(0, 1))

    def couplings(self, state):
        """None: a tool has no dofs, and nodes of one facet are coupled by the solid."""

    def add_tangent(self, state, matrix, border):
        active = self.evaluate(state, True)
        nodes = self.surface.nodes[active]
        with self.timers("insertion"):
            if len(active):
                matrix.setValuesBlockedLocalRCV(nodes, nodes, self._tangent[active], addv=True)
            if border is not None:
                mine = slice(3 * self.index, 3 * self.index + 3)
                scatter_border(active, self.surface.nodes, self._arm, border.columns[mine], border.rows[mine])
                border.corner[mine, mine] += self._arm[active].sum(axis=(0, 1))

    def touches(self, blocks):
        """Number of this rank's slave nodes among the local nodes `blocks`."""
        return int(np.isin(self.surface.nodes, blocks).sum())

    def held_axes(self, state, comm):
        """Axes along which the contact can hold a body: all with friction, else those of its first normal. Collective."""
        normal = np.abs(self.first_normal(state, comm))
        return {axis for axis, part in zip("xyz", normal, strict=True) if self.rough or part > 1e-6}

    def commit(self, state):
        """Accept the state: the only place where friction history changes."""
        self.release()
        self.evaluate(state)
        self.met = self.met | (self.status != OPEN)
        resting, self._feet = (self.status == STICK)[..., None], self._anchors(state, -np.inf)[0]
        self._rest, self.before = np.where(resting, self._rest, self._feet), self._anchor
        self._anchor, sliding = self._anchors(state, self.touch)
        self.slip_path = self.slip_path + sliding
        self._kept = self._anchor, self.shift
        self.keep_penalties()

    def drop(self):
        """Back to the multipliers and penalties of the last accepted step."""
        self._anchor, self.shift = self._kept
        self.drop_penalties()

    @property
    def anchors(self):
        return self._anchor

    def swap_anchors(self, anchors):
        old, self._anchor = self._anchor, anchors
        return old

    def hold_friction(self, factor):
        self._anchor = self._feet - (self._feet - self._anchor) / factor

    def rest_anchors(self, state, factor):
        self.evaluate(state)
        foot, sticks = self._anchors(state, -np.inf)[0], (self.status == STICK)[..., None]
        return np.where(sticks, foot - (foot - self._anchor + (factor - 1.0) * self._slip(state)) / factor, self._anchor)

    def _slip(self, state):
        """Slip (ne, nq, 3) of sticking points since they came to rest, in the tool's frame [length]; 0 for others."""
        foot, normal = self._anchors(state, -np.inf)[0], self.normals(state) @ self.tool.axes
        moved = foot - self._rest
        along = np.einsum("eqc,eqc->eq", moved, normal)[..., None] * normal
        return np.where((self.status == STICK)[..., None], moved - along, 0.0)

    def slips(self, state):
        """What the penalty gave way in stick (ne, nq) [length], at the state evaluated last."""
        return np.linalg.norm(self._slip(state), axis=2)

    def shift_anchors(self, state):
        self._anchor = self._anchor - self._slip(state)

    def _anchors(self, state, touch):
        """(anchors to keep, slid distance) at a state; with touch = -inf the points' places on the tool."""
        new, sliding = np.empty_like(self._anchor), np.empty_like(self.gap)
        committed_anchors(*self._at(state), self._law(touch), (self._anchor, self.shift), new, sliding)
        return new, sliding

    def history(self):
        out = {
            "anchor": self._anchor,
            "rest": self._rest,
            "slip_path": self.slip_path,
            "met": self.met,
            "raised": self.raised,
        }
        return out if self.tolerance is None else out | {"shift": self.shift}

    def restore(self, values):
        values = {name: np.ascontiguousarray(values[name]) for name in self.history()}
        self._anchor, self._rest, self.slip_path, self.met, raised = (
            values[name] for name in ("anchor", "rest", "slip_path", "met", "raised")
        )
        self.shift = values.get("shift", self.shift)
        self._kept, self.before, self._feet = (self._anchor, self.shift), self._anchor, None
        self.restore_penalties(raised)

    def overlap(self, state, X, slave, comm):
        """How deep [length] nodes X (n, 3) lie in the tool: of the slave surface (mask `slave`), and others. Collective."""
        gap = np.empty(len(X))
        distances(X, self._placed_tool(state), gap)
        here = -gap[slave].min(initial=0.0), -gap[~slave].min(initial=0.0)
        return np.max(comm.allgather(here), axis=0)

    def node_gaps(self, state, nodes, X):
        """Signed distances (n,) to the tool of local nodes with reference positions X (n, 3)."""
        gap = np.empty(len(nodes))
        distances(X + state.u.x.array.reshape(-1, 3)[nodes], self._placed_tool(state), gap)
        return gap

    def depth_beside(self, state):
        """Depth [length] and place of the deepest node that lies inside the tool without being a slave. Collective."""
        space = state.u.function_space
        if self._beside is None:
            slave = compat.Function(space)  # on all ranks that know a node
            slave.x.array.reshape(-1, 3)[self.surface.nodes.ravel()] = 1.0
            compat.sum_to_owners(slave)
            compat.copy_to_ghosts(slave)
            nodes = np.flatnonzero(slave.x.array.reshape(-1, 3)[:, 0] == 0.0)
            self._beside = nodes, space.tabulate_dof_coordinates()[nodes]
        nodes, X = self._beside
        depth, place = self._worst(space.mesh.comm, -self.node_gaps(state, nodes, X), X)
        return max(depth, 0.0), place

    def lost_depth(self, state, comm):
        """Zero: an analytic tool knows of every point how deep inside it is."""
        return 0.0

    def back_share(self, state, comm):
        """Zero: an analytic tool knows its outside."""
        return 0.0

    def normals(self, state):
        """Unit normals (ne, nq, 3) of the tool at this rank's slave points."""
        out = np.empty_like(self.traction)
        point_normals(*self._at(state), out)
        return out

    def looks(self, state):
        """Unit directions (ne, nq, 3) in which the contact holds this rank's slave points: the tool's normals."""
        return self.normals(state)

    def split_traction(self, state):
        """Contact pressure (ne, nq) and friction traction on the body (ne, nq, 3) [pressure, per reference area]."""
        normal = self.normals(state)
        pressure = -np.einsum("eqc,eqc->eq", self.traction, normal)
        return pressure, -self.traction - pressure[..., None] * normal

    def first_normal(self, state, comm):
        """Tool normal (3,) where the surface is nearest to the tool: the direction in which contact holds at first."""
        self.evaluate(state)
        if not self.gap.size:
            here = (np.inf, np.zeros(3))
        else:
            nearest = np.unravel_index(self.gap.argmin(), self.gap.shape)
            here = (self.gap[nearest], self.normals(state)[nearest])
        return min(comm.allgather(here), key=lambda pair: pair[0])[1]

    def measures(self, state, comm):
        """Sums over all ranks for the history: force and moment on the body [force, force x length], areas, counts."""
        held = self.gap[self.cover >= 1.0]  # points half out under a sharp edge are meant to sink in
        return contact_measures(self, state, comm, self.status != OPEN, held)
