"""Facets of another body as a contact's master: where slave points meet them, forces, tangents, anchors."""

from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.term import State
from fenics_contact.contact.friction import Friction, turned
from fenics_contact.contact.joints import Directions
from fenics_contact.contact.lost import FIRST_SEARCH, deepest_lost
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.pair_pattern import PairPattern
from fenics_contact.contact.pairing import Pairing, Seek, Watch, seek_along_normals, seek_closest
from fenics_contact.contact.surface import Beside, SlaveSurface
from fenics_contact.contact.trial import Response, Trial
from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.contact_pairs import (
    add_forces,
    augmented_anchors,
    committed_anchors,
    foreseen_gaps,
    stiffened_anchors,
)
from fenics_contact.kernels.contact_tangent import add_tangents
from fenics_contact.kernels.couplings import Pattern
from fenics_contact.kernels.deformable_element import Pairs, PointLaws, Slaves, slave_points
from fenics_contact.kernels.turning import add_turning_tangents
from fenics_contact.timing import Timers
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints, Ints64, Space

MARGIN = 0.5  # over an edge of the master: slack of the candidate lists, and nearness at which a coupling is provided for


class Placed(NamedTuple):
    """Positions coords (nx, 3) of this rank's slave nodes, then of all master nodes; points (np, 3); normals (np, 3) where
    they say in which direction a slave node looks, else the points; pose: of a tool."""

    coords: Floats
    points: Floats
    normals: Floats
    pose: Pose | None


class FacetFeet(NamedTuple):
    """Where slave points and master facets are, and the projection of kernels/closest_point.py there."""

    placed: Placed
    projection: Projection

    @property
    def coords(self) -> Floats:
        return self.placed.coords

    @property
    def pose(self) -> Pose | None:
        return self.placed.pose


class OnFacets:
    """What holds of any master of facets, however the slave meets it; `looks` and `first_feet` are the partner's."""

    edge = "none"
    foresees = True
    grounded = False
    softens = False
    slid_off = "make the master's surface larger where the slave leaves it, raise the penalty, or end the path before"
    master: MasterSurface | ToolSurface
    _comm: MPI.Comm

    _led: Directions | None = None

    def _directed(self, friction: Friction) -> Directions | None:
        """The master's directions of friction; None where one coefficient holds, or one direction for all."""
        if friction.ratio != 1.0 and (self._led is None or self._led.friction is not friction):
            self._led = Directions(self.master, friction)
        return self._led if friction.ratio != 1.0 and self._led is not None and len(self._led.parts) else None

    def looks(self, state: State) -> Floats:
        raise NotImplementedError

    def first_feet(self, state: State) -> Any:
        raise NotImplementedError

    def point(self, state: State) -> Floats | None:
        """A tool's reference point (3,) at a state [length]; None for a body."""
        return self.master.point(state)

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the dofs `held` do not."""
        return not np.isin(3 * self.master.owned[:, None] + np.arange(3), held).all()

    def held_axes(self, state: State, gap: Floats, rough: bool) -> set[str]:
        """Axes along which the contact can hold a body: without friction, those its normals have a part in. Collective."""
        largest = np.max(self._comm.allgather(np.abs(self.looks(state)).max(axis=(0, 1), initial=0.0)), axis=0)
        return set("xyz") if rough else {"xyz"[axis] for axis in range(3) if largest[axis] > 1e-6}

    def overlap(self, state: State, X: Floats, slave: Bools) -> tuple[float, float]:
        """Depth [length] of the deepest slave point inside the master, and zero: no node is asked behind it. Collective."""
        return -min(self._comm.allgather(self.first_feet(state).projection[4].min(initial=0.0))), 0.0

    def lean(self, feet: Any, trial: Trial, held: Bools) -> Floats:
        """Nothing: it is asked of averages alone."""
        return np.zeros(4)

    def beside(self, state: State) -> Beside | None:
        """None: nodes off the slave surface are not looked for."""

    def sags(self, state: State) -> Floats:
        """None: between slave nodes is not looked."""
        return np.empty(0)

    def back_share(self, state: State) -> float:
        """Zero: normals of a body's facets point out of it."""
        return 0.0


class FacetPartner(OnFacets):
    """Slave points against the facets of another body.

    Points of slave facets, Gauss points or corners, seek the master along their own facet's normal, which stays continuous
    over the master's edges; slave nodes without a facet seek the closest point on the master and its normal (the paper).
    surface: SlaveSurface; facets: oriented facets (nodes (nf, 4) local, size (nf,), ...) of the slave group, whose normals
    say where nodes look; master: MasterSurface, the whole of which each rank evaluates its slave points against. Its forces
    are summed over its nodes. Anchors: (nodes (np, m), weights (np, m)). Methods that take a state are collective.
    """

    settles, sights = False, None

    def __init__(
        self,
        name: str,
        surface: SlaveSurface,
        facets: tuple[Ints64, Ints64, Ints64],
        master: MasterSurface | ToolSurface,
        space: Space,
        timers: Timers,
    ) -> None:
        self.name, self.surface, self.master, self.timers = name, surface, master, timers
        self.smooth = surface.gradients is None  # along the slave's normal even frictionless forces have no potential
        self.search = max(surface.cell_height, master.longest)
        self.reach = float(np.abs(master.X).max(initial=0.0))
        (_, nq, k), along = surface.a.shape, surface.gradients
        self._local = np.unique(surface.nodes).astype(np.int64)  # this rank's slave nodes come first
        self._nodes = np.repeat(np.searchsorted(self._local, surface.nodes), nq, axis=0).astype(np.int64)
        self._gradients = np.empty((0, 2, k)) if along is None else along.reshape(-1, along.shape[2], k)
        first = len(self._local)
        self._facets = (master.facets[0] + first, master.facets[1])
        self._pattern = self._new_pattern(space)
        self._comm = space.mesh.comm
        self._X = space.tabulate_dof_coordinates()
        self._ring, self._normal = facets[0], compat.Function(space)
        watched = np.unique(np.concatenate([self._local, master.owned, self._ring.ravel()]))  # what positions rest on
        self._watch = Watch(self._comm, watched)
        self._pairing = Pairing(self._facets, self._seek(), self.search, MARGIN * master.edge)
        self._closest = Pairing(self._facets, seek_closest, self.search, 0.0)  # of nodes between Gauss points
        self._feet: FacetFeet | None = None

    def _seek(self) -> Seek:
        s = self.surface
        return seek_closest if s.gradients is None else seek_along_normals(self._nodes, self._gradients, s.corners)

    def _new_pattern(self, space: Space) -> PairPattern:
        blocks = np.concatenate([compat.global_blocks(space)[self._local], self.master.blocks]).astype(np.int64)
        return PairPattern(self._nodes, self._facets[0], blocks, space.dofmap.index_map.size_global)

    # -- where the points are -------------------------------------------------------------------------------------
    def _slaves(self, area: Floats | None = None) -> Slaves:
        """Slaves as kernels/deformable_element.py takes them."""
        s = self.surface
        weights = s.a.reshape(-1, s.a.shape[2])
        return self._nodes, weights, (s.area if area is None else area).reshape(-1), self._gradients

    def _placed(self, state: State) -> Placed:
        u, s = state.u.x.array, self.surface
        coords = np.concatenate([self._X[self._local] + u.reshape(-1, 3)[self._local], self.master.positions(state)])
        points = np.empty((s.area.size, 3))
        slave_points(coords, self._nodes, s.a.reshape(-1, s.a.shape[2]), points)
        normals = points if s.gradients is not None else self._point_normals(u)
        return Placed(coords, points, normals, self.master.pose(state))

    def _point_normals(self, u: Floats) -> Floats:
        """Outward unit normals (np, 3) at the points, means of those of the facets around. Collective."""
        s = self.surface
        at_nodes, normals = self._nodal_normals(u)[self._local], np.empty((s.area.size, 3))
        slave_points(at_nodes, self._nodes, s.a.reshape(-1, s.a.shape[2]), normals)
        return unit(normals)

    def _nodal_normals(self, u: Floats) -> Floats:
        """Sum of the area vectors of the slave facets around each node (nodes, 3), facets of all ranks."""
        values = self._normal.x.array.reshape(-1, 3)
        values[:] = 0.0
        x = self._X[self._ring] + u.reshape(-1, 3)[self._ring]
        np.add.at(values, self._ring, area_vectors(x)[:, None, :])
        compat.sum_to_owners(self._normal)
        compat.copy_to_ghosts(self._normal)
        return values

    def feet(self, state: State) -> FacetFeet:
        """The places at a state; the same object while these do not change on any rank. Collective."""
        moved, feet = self._watch.moved(state), self._feet
        if moved or feet is None:
            with self.timers("projection"):
                coords, points, normals, _ = placed = self._placed(state)
                feet = self._feet = FacetFeet(placed, self._pairing.project(points, normals, coords, self.timers))
        return feet

    def first_feet(self, state: State) -> FacetFeet:
        """The places of the first search, which looks farther. Collective."""
        placed = self._placed(state)
        return FacetFeet(placed, self._far(placed, FIRST_SEARCH * self.search))

    def far(self, feet: FacetFeet, search: float) -> Projection:
        """Projection from the same places with another search distance."""
        return self._far(feet.placed, search)

    def _far(self, placed: Placed, search: float) -> Projection:
        return self._pairing.far(placed.points, placed.normals, placed.coords, search)

    # -- forces and tangent ---------------------------------------------------------------------------------------
    def _law(self, feet: FacetFeet, trial: Trial, touch: float | None = None) -> PointLaws:
        law, nq = trial.law, self.surface.area.shape[1]
        penalties = np.repeat(law.eps_n, nq), np.repeat(law.eps_t, nq)
        touch = float(law.touch if touch is None else touch)
        return *penalties, self.friction(feet, trial), touch, trial.history.shift.reshape(-1), trial.judged

    def friction(self, feet: FacetFeet, trial: Trial) -> Friction:
        """The law of friction at these feet, with what directions it has there."""
        law, (nodes, parts) = turned(trial.law.friction, feet.pose), self._directions(feet, trial)
        return law._replace(directions=np.einsum("qi,qic->qc", parts, feet.coords[nodes])) if len(parts) else law

    def _directions(self, feet: FacetFeet, trial: Trial) -> tuple[Ints64, Floats]:
        """Nodes (np, m) of the points' directions of friction and their parts in them; (0, m): one holds for all."""
        if (directed := self._directed(trial.law.friction)) is None:
            return self._facets[0][:0], np.empty((0, self._facets[0].shape[1]))
        leading = directed.leading(feet.projection)
        return self._facets[0][leading], directed.parts[leading]

    def _pairs(self, feet: FacetFeet, trial: Trial, area: Floats | None = None) -> Pairs:
        """What the kernels take of the pairs of points and facets."""
        return feet.coords, self._slaves(area), self._facets, feet.projection, own(trial.history.anchors)

    def response(self, feet: FacetFeet, trial: Trial) -> Response:
        forces, (ne, nq) = np.zeros_like(feet.coords), self.surface.area.shape
        traction, excess, status = np.empty((ne * nq, 3)), np.empty(ne * nq), np.empty(ne * nq, dtype=np.int32)
        out = forces, status, traction, excess
        add_forces(*self._pairs(feet, trial, trial.area), self._law(feet, trial), out)
        gap, points = np.minimum(feet.projection[4], self.search), (ne, nq)
        cover = np.ones(points)
        return Response(
            traction.reshape(ne, nq, 3), gap.reshape(points), status.reshape(points), excess.reshape(points), cover, forces
        )

    def add_forces(self, feet: FacetFeet, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to the slave nodes' forces and its opposite to the master's, (14)."""
        residual.reshape(-1, 3)[self._local] += response.forces[: len(self._local)]
        self.master.react(feet, response.forces, residual, tool_residual)

    def on_slave(self, feet: FacetFeet, response: Response) -> tuple[Floats, Floats]:
        """Places and forces (n, 3) at this rank's slave nodes."""
        first = len(self._local)
        return feet.coords[:first], -response.forces[:first]

    def tangent(self, feet: FacetFeet, trial: Trial) -> Blocks:
        return Blocks(pairs=self._tangent(feet, trial), at=feet)

    def _tangent(self, feet: FacetFeet, trial: Trial) -> tuple[Ints64, Ints64, Floats]:
        """Rows (n,), rising, columns (n,) and blocks (n, 3, 3) of the tangent: each pair of nodes once."""
        pairs, parts = (*self._pairs(feet, trial, trial.area), self._law(feet, trial)), self._directions(feet, trial)

        def add(pattern: Pattern, out: tuple[Floats, Bools]) -> int:
            missing = add_tangents(*pairs, pattern, out)
            return missing + (add_turning_tangents(*pairs, parts, (*pattern, *out)) if len(parts[1]) else 0)

        rows, columns, blocks, missing = self._pattern.filled(add)
        if missing:
            raise RuntimeError(f"contact with '{self.name}': {missing} couplings are not in the pattern")
        return rows, columns, blocks

    def couplings(self, feet: FacetFeet, trial: Trial) -> Ints64 | None:
        """None while all closed pairs lie in the pattern asked for last; else keys row * N + column of a new one.

        Provided for: each slave point near the master with all facets that it may reach within MARGIN of their edges.
        """
        coords, points, *_ = feet.placed
        facet, kind, gap, anchor_nodes = feet.projection[0], feet.projection[1], feet.projection[4], trial.history.anchors[0]
        gaps = trial.judged if len(trial.judged) else gap + trial.history.shift.reshape(-1)
        now = (gaps <= 2.0 * trial.law.touch) & (kind != NONE), facet, anchor_nodes
        if self._pattern.suffices(*now):
            return None
        with self.timers("search"):
            near = self._pairing.within(points, coords, MARGIN * self.master.edge)
        self._pattern.provide(*near, *now)
        return self._pattern.keys

    def foreseen(self, feet: FacetFeet, before: FacetFeet, trial: Trial) -> Floats:
        """Gaps (np,) that the tangent at the places `before` foresees at these, shifts added."""
        gaps = np.empty(len(before.projection[4]))
        foreseen_gaps(*self._pairs(before, trial), feet.coords - before.coords, gaps)
        return np.where(np.isfinite(gaps), gaps, feet.projection[4]) + trial.history.shift.reshape(-1)

    # -- anchors --------------------------------------------------------------------------------------------------
    def no_anchors(self) -> tuple[Ints64, Floats]:
        shape = self.surface.area.size, self._facets[0].shape[1]
        return np.full(shape, -1, dtype=np.int64), np.zeros(shape)

    def _committed(self, feet: FacetFeet, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        new, sliding = self.no_anchors(), np.empty(self.surface.area.size)
        committed_anchors(*self._pairs(feet, trial), self._law(feet, trial, touch), new, sliding)
        return new, sliding.reshape(self.surface.area.shape)

    def places(self, feet: FacetFeet, trial: Trial) -> Anchors:
        """The points' places on the master."""
        return self._committed(feet, trial, -np.inf)[0]

    resting = places

    def committed(self, feet: FacetFeet, trial: Trial) -> tuple[Anchors, Floats]:
        """The anchors to keep when a step is accepted, and the ways slid in it (ne, nq) [length]."""
        return self._committed(feet, trial, None)

    def _augmented(self, feet: FacetFeet, trial: Trial, share: float = 1.0) -> tuple[Anchors, Floats]:
        *new, slips = augmented_anchors(*self._pairs(feet, trial), own(trial.history.rests), self._law(feet, trial), share)
        return tuple(new), slips.reshape(self.surface.area.shape)

    def slips(self, feet: FacetFeet, trial: Trial, status: Ints) -> Floats:
        """What the penalty gave way in stick (ne, nq) [length]."""
        return self._augmented(feet, trial)[1]

    def augmented(self, feet: FacetFeet, trial: Trial, status: Ints, share: float) -> Anchors:
        """Uzawa's update of friction: anchors that give sticking points a traction greater by share eps_T times slip."""
        return self._augmented(feet, trial, share)[0]

    def stiffened(self, feet: FacetFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for points that slip on from rest as they do."""
        return stiffened_anchors(*self._pairs(feet, trial), own(rests), self._law(feet, trial), factor)

    def chosen(self, points: Bools, ours: Anchors, others: Anchors) -> Anchors:
        """Our anchors at some points (ne, nq), the others elsewhere."""
        return tuple(
            np.where(points.reshape(one.shape[:-1])[..., None], one, two) for one, two in zip(ours, others, strict=True)
        )

    def packed(self, anchors: Anchors, name: str) -> dict[str, Array]:
        """Anchors as keys of the master's nodes (-1: none) and their weights, arrays (ne, ...) that no partition changes."""
        (nodes, weights), shape = anchors, (*self.surface.area.shape, anchors[0].shape[1])
        keys = np.append(self.master.keys, -1)[np.where(nodes < 0, -1, nodes - len(self._local))]
        return {name: keys.reshape(shape), f"{name}_weight": weights.reshape(shape)}

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        keys, order = values[name].reshape(-1, self._facets[0].shape[1]), np.argsort(self.master.keys)
        nodes = order[np.minimum(np.searchsorted(self.master.keys[order], keys), len(order) - 1)] + len(self._local)
        return np.where(keys < 0, -1, nodes), np.ascontiguousarray(values[f"{name}_weight"].reshape(keys.shape))

    # -- what else is asked of a master ---------------------------------------------------------------------------
    def normals(self, feet: FacetFeet) -> Floats:
        """Unit normals (ne, nq, 3) along which pressure acts on this rank's slave points; zero without a partner."""
        kind, normal = feet.projection[1], feet.projection[5]
        return np.where((kind != NONE)[:, None], normal, 0.0).reshape((*self.surface.area.shape, 3))

    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which this rank's slave points look for the master: their normals. Collective."""
        return self._point_normals(state.u.x.array).reshape((*self.surface.area.shape, 3))

    def bare(self, feet: FacetFeet) -> Floats:
        """Shares (n,) of the points' areas without a partner."""
        return (feet.projection[1] == NONE).astype(float)

    def features(self, feet: FacetFeet) -> Array:
        """Codes (n, ...): where one changes the traction has a kink."""
        return np.column_stack(feet.projection[:3])

    def touches(self, blocks: Array) -> int:
        """Number of this rank's slave and master nodes among the local nodes `blocks`."""
        return int(np.isin(self._local, blocks).sum() + np.isin(self.master.owned, blocks).sum())

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Gaps (n,) of slave nodes from their closest points on the master, endless without one. Collective."""
        normals, coords = self._nodal_normals(state.u.x.array)[nodes], self.feet(state).coords
        points = coords[np.searchsorted(self._local, nodes)]
        gaps = self._closest.far(points, normals, coords, self.search)[4]
        return np.where(np.any(normals != 0.0, axis=1), gaps, np.inf)  # degree 2: a facet's normal is known at its corners

    def lost_depth(self, state: State, trial: Trial) -> float:
        """Depth [length] of the deepest slave point too deep in the master to have a partner, else zero. Collective."""
        return deepest_lost(self, len(self._local), state, trial)


def own(anchors: Anchors) -> tuple[Ints64, Floats]:
    """Anchors on facets: nodes (np, 4), local numbers, and their weights (np, 4)."""
    nodes, weights = anchors
    return nodes, weights


def unit(vectors: Floats) -> Floats:
    """Vectors (n, 3) of length one; zero ones stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
