"""What holds of any master of facets, however the slave meets it."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Generic, TypeVar

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.crossing import Crossed, Crossing
from fenics_contact.contact.entered import Entered
from fenics_contact.contact.friction import Friction
from fenics_contact.contact.joints import Directions
from fenics_contact.contact.lost import deepest_lost
from fenics_contact.contact.master import MasterSurface, Meeting, ToolSurface, area_vectors
from fenics_contact.contact.meeting import Sights
from fenics_contact.contact.pairing import Watch
from fenics_contact.contact.partner import PointPressures
from fenics_contact.contact.surface import Beside, SlaveSurface
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.closest_point import Projection
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.quadratic import foot_shapes
from fenics_contact.timing import Timers
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints, Ints64

MARGIN = 0.5  # over an edge of the master: slack of the candidate lists, and nearness at which a coupling is provided for
# A slave point and the facet nearest to it say on which side of a tool the body is if their normals are this parallel.
DECISIVE = 0.5
LISTED = 20_000_000  # pairs of a slave point and a facet: what takes a second, and 160 MB
FAR = 10.0  # times the distance that is searched at a step, two cells or more
SAMPLES = 300  # slave points of a rank that are asked for it
SLID_OFF = (
    "the tool has slid past the end of the slave surface: end the path before, keep the tool over it, or, where the tool "
    "itself ends there, make its surface larger"
)
IN_A_CREASE = "where both walls meet in a crease, take finer cells there; else {}"


Feet = TypeVar("Feet", bound=Meeting)


class PlacesOnFacets(Generic[Feet]):
    """Where a slave lies to the facets of a master; `first_feet` and the rest depend on how it meets them.

    surface: SlaveSurface; master: the facets, which each rank knows in full; crossing: what of either lies behind the other;
    slave: (this rank's nodes (n,) of it, first: where the master's nodes begin among the coordinates behind the slave's),
    facets: their nodes and sizes there; search: gaps from this on are not told apart [length].
    """

    sights: Sights | None = None
    _watch: Watch  # over the nodes that positions rest on
    _feet: Feet | None = None
    _crossed: tuple[Feet, Crossed] | None = None

    def __init__(
        self,
        surface: SlaveSurface,
        master: MasterSurface | ToolSurface,
        crossing: Crossing,
        slave: tuple[Ints64, int],
        search: float,
        timers: Timers,
    ) -> None:
        self.surface, self.master, self.crossing = surface, master, crossing
        (self.slave, self.first), self.search = slave, search
        self.comm, self.timers = crossing.skin.comm, timers
        self.facets: Surface = (master.facets[0] + self.first, master.facets[1])
        self.reach = float(np.abs(master.X).max(initial=0.0))
        self._directions: Directions | None = None
        self.meets_itself = False  # a body

    def directed(self, friction: Friction) -> Directions | None:
        """The master's directions of friction; None where one coefficient holds, or one direction for all."""
        if friction.ratio != 1.0 and (self._directions is None or self._directions.friction is not friction):
            self._directions = Directions(self.master, friction)
        known = self._directions
        return known if friction.ratio != 1.0 and known is not None and len(known.parts) else None

    def as_accepted(self) -> AbstractContextManager[None]:
        """Feet are found meanwhile as they were when the last state was accepted."""
        return self.sights.as_accepted() if self.sights else nullcontext()

    def point(self, state: State) -> Floats | None:
        """A tool's reference point (3,) at a state [length]; None for a body."""
        return self.master.point(state)

    def overlap(self, state: State, X: Floats, slave: Bools, bodies: Sequence[Ints64]) -> tuple[Floats, Floats]:
        """Depth (bodies,) [length] of the deepest slave point inside the master, of all bodies of local nodes that have such
        (mask `slave`), and zeros: no node is asked behind it. Collective."""
        depth = -self.first_feet(state).projection[4].min(initial=0.0)
        deepest, *met = np.max(self.comm.allgather([depth, *(slave[nodes].any() for nodes in bodies)]), axis=0)
        return deepest * np.array(met), np.zeros(len(bodies))

    def ways_inside(self, state: State, least: float) -> tuple[Floats, Floats, Floats]:
        """Of this rank's slave points that are deeper than `least` in the master before anything has moved: how deep (n,),
        where they are and where they are led to (n, 3) [length]. Collective."""
        feet = self.first_feet(state)
        facet, gap = feet.projection[0], feet.projection[4]
        deep = np.flatnonzero(gap < -least)
        N = np.empty((len(deep), 3, self.facets[0].shape[1]))
        foot_shapes(deep, self.facets, feet.projection, N)
        led = np.einsum("na,nac->nc", N[:, 0], feet.coords[self.facets[0][facet[deep]]])
        return -gap[deep], feet.points[deep], led

    def meets(self, feet: Feet) -> tuple[Ints64, Ints64, Floats]:
        """Numbers (n,) of points, and of the master's facets that they face, with what areas (n,) [length^2]."""
        raise NotImplementedError

    def farthest(self, feet: Feet) -> float:
        """How far away partners can be, or are looked for at most where all facets would make long lists [length]."""
        if len(feet.points) * len(self.facets[0]) <= LISTED:
            return float(np.linalg.norm(np.ptp(feet.coords, axis=0)))
        return FAR * self.search

    def beside(self, state: State) -> Beside | None:
        """None: nodes off the slave surface are not looked for."""

    def entered(self, state: State, nearly: float = 1.0, normals: Floats | None = None) -> Entered | None:
        """None: between slave points is not looked."""

    def crossed(self, state: State) -> Crossed:
        """Nodes of either surface behind the other's facets. Collective."""
        feet = self.feet(state)
        if self._crossed is None or self._crossed[0] is not feet:
            with self.timers("crossing"):
                self._crossed = feet, self.crossing.found(state)
        return self._crossed[1]

    def lost_depth(self, state: State, trial: Trial) -> float:
        """Depth [length] of the deepest point, or sample, too deep in the master to have a partner, or zero. Collective."""
        return deepest_lost(self, state, trial)

    def passed(self, state: State, trial: Trial) -> tuple[Floats, Floats] | None:
        """None: points without a partner say so, see `lost_depth`."""

    def keys_of(self, nodes: Ints64) -> Ints64:
        """Keys, which no partition changes, of nodes of the master, numbers among the coordinates; -1: none."""
        return np.append(self.master.keys, -1)[np.where(nodes < 0, -1, nodes - self.first)]

    def of_keys(self, keys: Ints64) -> Ints64:
        """The nodes that have these keys."""
        order = np.argsort(self.master.keys)
        at = np.minimum(np.searchsorted(self.master.keys[order], keys), len(order) - 1)
        return np.where(keys < 0, -1, order[at] + self.first)

    def feet(self, state: State) -> Feet:
        """The places at a state; the same object while these do not change on any rank. Collective."""
        if self._watch.moved(state) or self._feet is None:
            with self.timers("projection"):
                self._feet = self._met(state)
        return self._feet

    def _met(self, state: State) -> Feet:
        raise NotImplementedError

    def first_feet(self, state: State) -> Feet:
        raise NotImplementedError

    def far(self, feet: Feet, search: float) -> Projection:
        raise NotImplementedError

    def looks(self, state: State) -> Floats:
        raise NotImplementedError


class OnFacets(PointPressures):
    """What contacts with facets have in common besides `places`."""

    foresees = True
    softens = False
    places: PlacesOnFacets[Any]

    def __init__(self, name: str, places: PlacesOnFacets[Any]) -> None:
        self.name, self.places, self.surface, self.timers = name, places, places.surface, places.timers
        self.grounded, self.edge_kind = places.master.index >= 0, "none"
        if self.grounded:
            self.edge_kind, self.slid_off = f"meshed, {len(places.facets[0])} facets", SLID_OFF
        elif places.meets_itself:
            self.slid_off = IN_A_CREASE.format(self.slid_off)

    @property
    def nodes(self) -> Ints:
        """This rank's nodes of the slave and of the master, local numbers."""
        return np.union1d(self.places.slave, self.places.master.owned)

    def gives(self, held: Array) -> bool:
        """Whether the master could move where the dofs `held` do not: a tool is held."""
        return not (self.grounded or np.isin(3 * self.places.master.owned[:, None] + np.arange(3), held).all())

    def on_slave(self, feet: Meeting, response: Response) -> tuple[Floats, Floats]:
        """Places of the slave nodes that are known here and this rank's forces (n, 3) at them."""
        first = self.places.first
        return feet.coords[:first], -response.forces[:first]

    def held_axes(self, state: State, gap: Floats, rough: bool) -> set[str]:
        """Axes along which the contact can hold a body: without friction, those its normals have a part in. Collective."""
        largest = np.max(self.places.comm.allgather(np.abs(self.places.looks(state)).max(axis=(0, 1), initial=0.0)), axis=0)
        return set("xyz") if rough else {"xyz"[axis] for axis in range(3) if largest[axis] > 1e-6}


def own(anchors: Anchors) -> tuple[Ints64, Floats]:
    """Anchors on facets: nodes (np, 4), local numbers, and their weights (np, 4)."""
    nodes, weights = anchors
    return nodes, weights


def seen_from_behind(comm: MPI.Comm, points: Floats, normals: Floats, corners: Floats, near: float) -> float:
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
