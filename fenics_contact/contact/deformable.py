"""Contact of a slave surface with a deformable master surface as one term of a System: forces, tangent, history."""

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.contact.friction import friction_of
from fenics_contact.contact.master import area_vectors
from fenics_contact.contact.measures import contact_measures
from fenics_contact.contact.pair_pattern import PairPattern
from fenics_contact.contact.pair_penalties import PairPenalties
from fenics_contact.contact.pairing import Pairing, seek_along_normals, seek_closest
from fenics_contact.contact.points import SlavePoints
from fenics_contact.contact.term import TOUCH
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.contact_pairs import (
    add_forces,
    augmented_anchors,
    committed_anchors,
    foreseen_gaps,
)
from fenics_contact.kernels.contact_tangent import add_tangents
from fenics_contact.kernels.deformable_element import slave_points
from fenics_contact.kernels.status import OPEN, STICK
from fenics_contact.timing import Timers

# Over the search distance: how far the first search looks for a partner to anchor at and for surfaces that overlap.
FIRST_SEARCH = 3.0
# Over an edge of the master: slack of the candidate lists, and nearness at which a coupling is provided for.
MARGIN = 0.5


class DeformableContact(PairPenalties, SlavePoints):
    """Penalty contact with Coulomb friction between slave points and the facets of another body.

    Points of slave facets, Gauss points or corners, seek the master along their own facet's normal, which stays continuous
    over the master's edges; slave nodes without a facet seek the closest point on the master and its normal (the paper).
    surface: SlaveSurface; facets: oriented facets (nodes (nf, 4) local, size (nf,), ...) of the slave group, whose normals
    say where a slave node looks; master: MasterSurface; friction: Coulomb's mu or what contact/friction.py gives;
    normal_penalty, tangential_penalty (ne,) [pressure/length]. Each rank evaluates its slave points against the whole
    master surface; forces on the master go back by a sum over its nodes. All methods that take a state are collective.
    Evaluation is pure; `commit` writes the anchors.
    """

    edge = "none"
    foresees = True
    grounded = False

    def __init__(self, name, master_name, surface, facets, master, friction, normal_penalty, tangential_penalty, space):
        self.name, self.master_name, self.surface, self.master = name, master_name, surface, master
        self.friction = friction_of(friction)
        # along the slave's normal even frictionless forces have no potential
        self.symmetric = not self.rough and surface.gradients is None
        self.normal_penalty, self.tangential_penalty = normal_penalty, tangential_penalty
        self.touch = TOUCH * surface.cell_height
        self.search = max(surface.cell_height, master.longest)
        ne, nq, k = surface.a.shape
        self._local = np.unique(surface.nodes).astype(np.int64)  # this rank's slave nodes come first
        nodes = np.repeat(np.searchsorted(self._local, surface.nodes), nq, axis=0).astype(np.int64)
        gradients = np.empty((0, 2, k)) if surface.gradients is None else surface.gradients.reshape(-1, 2, k)
        self._slaves = (nodes, surface.a.reshape(-1, k), surface.area.ravel(), gradients)
        first = len(self._local)
        self._facets = (master.facets[0] + first, master.facets[1])
        blocks = np.concatenate([compat.global_blocks(space)[self._local], master.blocks]).astype(np.int64)
        self._pattern = PairPattern(nodes, self._facets[0], blocks, space.dofmap.index_map.size_global)
        self._comm = space.mesh.comm
        self._X = space.tabulate_dof_coordinates()
        self._ring, self._normal = facets[0], compat.Function(space)
        self._watched = np.unique(np.concatenate([self._local, master.owned, self._ring.ravel()]))  # what positions rest on
        self.shift = np.zeros((ne, nq))
        self.put_penalties(normal_penalty, tangential_penalty)
        self.set_up_penalties()
        seek = seek_closest if surface.gradients is None else seek_along_normals(nodes, gradients, surface.corners)
        self._pairing = Pairing(self._facets, seek, self.search, MARGIN * master.edge)
        self._nodes = Pairing(self._facets, seek_closest, self.search, 0.0)  # of nodes between Gauss points
        self._rests = self._anchors = self._no_anchors()
        self._kept = self._anchors, self.shift  # those of the last accepted step
        self._seen = self._projected = self._linearised = self._places = None
        self._gaps = (np.full(ne * nq, self.search),) * 2  # with shifts, when a step was last accepted, and before
        self.timers = Timers()  # those of the System it becomes part of
        self.traction, self.gap, self.excess = np.zeros((ne, nq, 3)), np.zeros((ne, nq)), np.zeros((ne, nq))
        self.status = np.zeros((ne, nq), dtype=np.int32)
        self.met = np.zeros((ne, nq), dtype=bool)
        self.cover, self.slip_path = np.ones((ne, nq)), np.zeros((ne, nq))

    @property
    def anchors(self):
        return self._anchors

    def _no_anchors(self):
        n = len(self._slaves[2])
        return np.full((n, 4), -1, dtype=np.int64), np.zeros((n, 4))

    @property
    def _law(self):
        return (*self._penalties, self.friction, self.touch, self.shift.reshape(-1))

    # -- kinematics -----------------------------------------------------------------------------------------------
    def _positions(self, state):
        """Positions (nx, 3) of this rank's slave nodes, then of all master nodes; points (np, 3); normals (np, 3) where
        they say in which direction a slave node looks."""
        u = state.u.x.array
        coords = np.concatenate([self._X[self._local] + u.reshape(-1, 3)[self._local], self.master.positions(state)])
        points = np.empty((len(self._slaves[2]), 3))
        slave_points(coords, self._slaves[0], self._slaves[1], points)
        return coords, points, points if self.surface.gradients is not None else self._point_normals(u)

    def _point_normals(self, u):
        """Outward unit normals (np, 3) at the points, means of those of the facets around. Collective."""
        at_nodes, normals = self._nodal_normals(u)[self._local], np.empty((len(self._slaves[2]), 3))
        slave_points(at_nodes, self._slaves[0], self._slaves[1], normals)
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    def _nodal_normals(self, u):
        """Sum of the area vectors of the slave facets around each node (nodes, 3), facets of all ranks."""
        values = self._normal.x.array.reshape(-1, 3)
        values[:] = 0.0
        x = self._X[self._ring] + u.reshape(-1, 3)[self._ring]
        np.add.at(values, self._ring, area_vectors(x)[:, None, :])
        compat.sum_to_owners(self._normal)
        compat.copy_to_ghosts(self._normal)
        return values

    def _project(self, state):
        """(coords, points, projection) at the state, kept until it changes on some rank. Collective."""
        now = state.u.x.array.reshape(-1, 3)[self._watched], state.travel.copy()
        same = self._seen is not None and all(np.array_equal(a, b) for a, b in zip(now, self._seen, strict=True))
        moved = np.array([not same], dtype=np.int32)
        self._comm.Allreduce(MPI.IN_PLACE, moved)
        if moved[0]:
            with self.timers("projection"):
                self._placed = coords, points, normals = self._positions(state)
                self._projected = coords, points, self._pairing.project(points, normals, coords, self.timers)
            self._seen = now
        return self._projected

    def _first_projection(self, state):
        coords, points, normals = self._positions(state)
        return coords, self._pairing.far(points, normals, coords, FIRST_SEARCH * self.search)

    def overlap(self, state, X, slave, comm):
        """Depth [length] of the deepest slave point inside the master, and zero: no node is asked behind it. Collective."""
        gaps = self._first_projection(state)[1][4]
        return -min(comm.allgather(gaps.min(initial=0.0))), 0.0

    def lost_depth(self, state, comm):
        """Depth [length] of the deepest slave point inside the master that is too deep to have a partner, else zero.

        A Newton step that carries bodies through each other by more than the search distance ends in such a state, which
        looks like an open contact. Beyond the first search's distance a point counts if it was in front of the master when
        the last state was accepted: no point can be deeper than the bodies have moved since. Collective.
        """
        unpaired = self.unpaired(state)
        if not comm.allreduce(bool(unpaired.any()), op=MPI.LOR):
            return 0.0
        gaps = self._first_projection(state)[1][4]
        moved = max(comm.allgather(sum(np.abs(now - then).max(initial=0.0) for now, then in self._moved(state))))
        reach = self.search + np.sqrt(3.0) * moved
        if reach > FIRST_SEARCH * self.search:
            now, then = self._placed, self._places
            far, before = (self._pairing.far(points, normals, coords, reach) for coords, points, normals in (now, then))
            gaps = np.where((before[1] != NONE) & (before[4] > -self.touch), np.minimum(gaps, far[4]), gaps)
        return -min(comm.allgather(gaps[unpaired].min(initial=0.0)))

    def node_gaps(self, state, nodes, X):
        """Gaps (n,) of slave nodes from their closest points on the master, endless without one. Collective."""
        normals, coords = self._nodal_normals(state.u.x.array)[nodes], self._project(state)[0]
        points = coords[np.searchsorted(self._local, nodes)]
        gaps = self._nodes.far(points, normals, coords, self.search)[4]
        return np.where(np.any(normals != 0.0, axis=1), gaps, np.inf)  # degree 2: a facet's normal is known at its corners

    def _moved(self, state):
        """Positions now and at the last accepted state, of slave nodes and of master nodes."""
        coords, first = self._project(state)[0], len(self._local)
        return (coords[:first], self._places[0][:first]), (coords[first:], self._places[0][first:])

    def back_share(self, state, comm):
        """Zero: normals of a body's facets point out of it."""
        return 0.0

    def touches(self, blocks):
        """Number of this rank's slave and master nodes among the local nodes `blocks`."""
        return int(np.isin(self._local, blocks).sum() + np.isin(self.master.owned, blocks).sum())

    def held_axes(self, state, comm):
        """Axes along which the contact can hold a body: without friction, those its normals have a part in."""
        normals = np.abs(self._point_normals(state.u.x.array)).max(axis=0, initial=0.0)
        largest = np.max(comm.allgather(normals), axis=0)
        return set("xyz") if self.rough else {"xyz"[axis] for axis in range(3) if largest[axis] > 1e-6}

    def looks(self, state):
        """Unit directions (ne, nq, 3) in which this rank's slave points look for the master: their normals. Collective."""
        return self._point_normals(state.u.x.array).reshape(self.traction.shape)

    # -- evaluation -----------------------------------------------------------------------------------------------
    def evaluate(self, state):
        """Evaluate all points: traction, status, gap and excess; returns forces (nx, 3) on slave and master nodes."""
        coords, _, projection = self._project(state)
        if self._places is None:  # the first state after a restart
            self._places = self._placed
        forces, shape = np.zeros_like(coords), self.gap.shape
        with self.timers("contact kernel"):
            out = forces, self.status.reshape(-1), self.traction.reshape(-1, 3), self.excess.reshape(-1)
            add_forces(coords, self._slaves, self._facets, projection, self._anchors, self._law, self._judged, out)
        self.gap = np.minimum(projection[4], self.search).reshape(shape)
        return forces

    def add_residual(self, state, residual, tool_residual):
        """Add a area T to the slave nodes' forces and its opposite to the master's, (14)."""
        forces, first = self.evaluate(state), len(self._local)
        with self.timers("insertion"):
            residual.reshape(-1, 3)[self._local] += forces[:first]
            self.master.add_forces(forces[first:], residual, tool_residual)

    def add_tangent(self, state, matrix, border):
        rows, columns, values = self._tangent_blocks(state)
        starts = np.flatnonzero(np.diff(rows, prepend=-1))
        offsets, rows = np.append(starts, len(values)).astype(np.int32), rows[starts].astype(np.int32)
        with self.timers("insertion"):
            matrix.setValuesBlockedIJV(offsets, columns.astype(np.int32), values, addv=True, rowmap=rows)

    def _tangent_blocks(self, state):
        """Rows (n,), rising, columns (n,) and blocks (n, 3, 3) of the tangent: each pair of nodes once."""
        coords, _, projection = self._project(state)
        self._linearised = coords, projection
        pairs = coords, self._slaves, self._facets, projection, self._anchors, self._law, self._judged
        with self.timers("contact kernel"):
            *blocks, missing = self._pattern.filled(lambda *out: add_tangents(*pairs, *out))
        if missing:
            raise RuntimeError(f"contact '{self.name}': {missing} couplings are not in the pattern")
        return blocks

    # -- Newton's own unknowns ------------------------------------------------------------------------------------
    def foresee(self, state):
        """Take the pressures that the last tangent foresees at the state as unknowns of their own until `release`."""
        coords, _, projection = self._project(state)
        before, pairs = self._linearised
        gaps = np.empty(len(projection[4]))
        foreseen_gaps(before, self._slaves, self._facets, pairs, self._anchors, coords - before, gaps)
        self._judged = np.where(np.isfinite(gaps), gaps, projection[4]) + self.shift.reshape(-1)

    def hold(self, share):
        """Take the pressures of the last accepted step, carried on by `share` of the change in it, as unknowns."""
        now, before = self._gaps
        # a pressure doubles or halves at most: it stays one, and what was open before gives no slope
        self._judged = np.where(now < 0.0, np.clip(now + share * (now - before), 2.0 * now, 0.5 * now), now)

    # -- pattern --------------------------------------------------------------------------------------------------
    def couplings(self, state):
        """None while all closed pairs lie in the pattern asked for last; else keys row * N + column of a new one.

        Provided for: each slave point near the master with all facets that it may reach within MARGIN of their edges.
        """
        coords, points, projection = self._project(state)
        gaps = self._judged if len(self._judged) else projection[4] + self.shift.reshape(-1)
        now = (gaps <= self.touch) & (projection[1] != NONE), projection[0], self._anchors[0]
        if self._pattern.suffices(*now):
            return None
        with self.timers("search"):
            near = self._pairing.within(points, coords, MARGIN * self.master.edge)
        self._pattern.provide(*near, *now)
        return self._pattern.keys

    # -- history --------------------------------------------------------------------------------------------------
    def initialise(self, state):
        """Anchor every point at its projection in the initial state, so that it can stick in the first step."""
        self._rests = self._anchors = self.before = self._new_anchors(*self._first_projection(state), -np.inf)[0]
        self._kept = self._anchors, self.shift
        self._places = self._positions(state)
        self.evaluate(state)

    def commit(self, state):
        """Accept the state: the only place where friction history changes."""
        self.release()
        self.evaluate(state)
        self.met = self.met | (self.status != OPEN)
        coords, _, projection = self._project(state)
        self._places = self._placed
        self._gaps = (self.gap + self.shift).ravel(), self._gaps[0]
        if self.rough or self.tolerance is not None:
            resting, feet = (self.status == STICK).reshape(-1, 1), self._new_anchors(coords, projection, -np.inf)[0]
            self._rests = tuple(np.where(resting, old, new) for old, new in zip(self._rests, feet, strict=True))
        self.before = self._anchors
        self._anchors, sliding = self._new_anchors(coords, projection, self.touch)
        self.slip_path = self.slip_path + sliding.reshape(self.gap.shape)
        self._kept = self._anchors, self.shift
        self.keep_penalties()

    def _new_anchors(self, coords, projection, touch):
        """(anchors to keep, slid distance (np,)); with touch = -inf the points' places on the master."""
        new, sliding = self._no_anchors(), np.empty(self.gap.size)
        law = (*self._penalties, self.friction, touch, self.shift.reshape(-1))
        committed_anchors(coords, self._slaves, self._facets, projection, self._anchors, law, new, sliding)
        return new, sliding

    def drop(self):
        """Back to the multipliers and penalties of the last accepted step."""
        self._anchors, self.shift = self._kept
        self.drop_penalties()

    def _augmented(self, state):
        """(anchors with greater tractions, what the penalty gave way in stick (np,) [length])."""
        coords, _, projection = self._project(state)
        new, slips, pairs = self._no_anchors(), np.empty(self.gap.size), (coords, self._slaves, self._facets, projection)
        augmented_anchors(*pairs, self._anchors, self._rests, self._law, new, slips)
        return new, slips

    def slips(self, state):
        return self._augmented(state)[1]

    def shift_anchors(self, state):
        self._anchors = self._augmented(state)[0]

    def weigh(self, area):
        super().weigh(area)
        self._slaves = (*self._slaves[:2], area.ravel(), self._slaves[3])

    def branches(self, state):
        self.evaluate(state)
        facet, kind, feature = self._project(state)[2][:3]
        return np.column_stack([self.status.ravel(), facet, kind, feature])

    def unpaired(self, state):
        return self._project(state)[2][1] == NONE

    def history(self):
        """Anchors as keys of the master's nodes (-1: none) and their weights, slip paths, multipliers, the last two gaps."""
        out = self._keyed("anchor", "weight", self._anchors) | self._keyed("rest", "rest_weight", self._rests)
        out |= {"slip_path": self.slip_path, "met": self.met, "raised": self.raised}
        out["gaps"] = np.stack(self._gaps, axis=-1).reshape(*self.gap.shape, 2)
        return out if self.tolerance is None else out | {"shift": self.shift}

    def _keyed(self, name, weight, anchors):
        shape, (nodes, weights) = (*self.gap.shape, 4), anchors
        keys = np.append(self.master.keys, -1)[np.where(nodes < 0, -1, nodes - len(self._local))]
        return {name: keys.reshape(shape), weight: weights.reshape(shape)}

    def restore(self, values):
        self._anchors, self._places = self._numbered(values["anchor"], values["weight"]), None
        self._rests = self._numbered(values["rest"], values["rest_weight"])
        self.slip_path, self.met = (np.ascontiguousarray(values[name]) for name in ("slip_path", "met"))
        self._gaps = tuple(np.ascontiguousarray(values["gaps"].reshape(-1, 2).T))
        self.before = self._anchors
        self.restore_penalties(np.ascontiguousarray(values["raised"]))
        if self.tolerance is not None:
            self.shift = np.ascontiguousarray(values["shift"])
        self._kept = self._anchors, self.shift

    def _numbered(self, keys, weights):
        keys, order = keys.reshape(-1, 4), np.argsort(self.master.keys)
        nodes = order[np.minimum(np.searchsorted(self.master.keys[order], keys), len(order) - 1)] + len(self._local)
        return np.where(keys < 0, -1, nodes), np.ascontiguousarray(weights.reshape(-1, 4))

    # -- output ---------------------------------------------------------------------------------------------------
    def normals(self, state):
        """Unit normals (ne, nq, 3) along which pressure acts on this rank's slave points; zero without a partner."""
        projection = self._project(state)[2]
        return np.where((projection[1] != NONE)[:, None], projection[5], 0.0).reshape(self.traction.shape)

    def split_traction(self, state):
        """Contact pressure (ne, nq) and friction traction on the slave (ne, nq, 3) [pressure, per reference area]."""
        normal = self.normals(state)
        pressure = -np.einsum("eqc,eqc->eq", self.traction, normal)
        return pressure, -self.traction - pressure[..., None] * normal

    def measures(self, state, comm):
        """Sums over all ranks for the history: force and moment on the slave [force, force x length], areas, counts."""
        closed = self.status != OPEN
        return contact_measures(self, state, comm, closed, self.gap)
