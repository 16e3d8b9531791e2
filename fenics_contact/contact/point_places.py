"""Where the points of slave facets, or slave nodes, meet the facets of a master."""

from typing import NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.pairs import Image
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.term import State
from fenics_contact.contact.crossing import Crossing
from fenics_contact.contact.lost import FIRST_SEARCH
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.on_facets import MARGIN, PlacesOnFacets, seen_from_behind
from fenics_contact.contact.pairing import BEYOND, CLOSEST, Pairing, Seek, Watch, along_normals
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.coverage import beyond_edges
from fenics_contact.kernels.deformable_element import slave_points
from fenics_contact.kernels.quadratic import foot_shapes
from fenics_contact.kernels.slave_ray import facet_directions
from fenics_contact.timing import Timers
from fenics_contact.types import Array, Floats, Ints64, Space


class FacetFeet(NamedTuple):
    """Positions coords (nx, 3) of this rank's slave nodes, then of all master nodes; points (np, 3); normals (np, 3), along
    which they look for the master; pose: of a tool; the projection of kernels/closest_point.py there."""

    coords: Floats
    points: Floats
    normals: Floats
    pose: Pose | None
    projection: Projection


class PointPlaces(PlacesOnFacets[FacetFeet]):
    """Of slave points that seek the master along their own facet's normal, or of nodes that seek the closest point on it.

    facets: oriented facets (nodes (nf, 4) local, size (nf,), ...) of the slave group, whose normals say where nodes look;
    nodes (np, k), gradients (np, 2, k): of the points' facets, numbers among the coordinates. Methods that take a state are
    collective.
    """

    def __init__(
        self,
        surface: SlaveSurface,
        facets: tuple[Ints64, Ints64, Ints64],
        master: MasterSurface | ToolSurface,
        crossing: Crossing,
        space: Space,
        timers: Timers,
    ) -> None:
        slave = np.unique(surface.nodes).astype(np.int64)  # this rank's slave nodes come first
        search = max(surface.cell_height, master.longest)
        super().__init__(surface, master, crossing, (slave, len(slave)), search, timers)
        self.space = space
        (_, nq, k), along = surface.a.shape, surface.gradients
        self.nodes = np.repeat(np.searchsorted(slave, surface.nodes), nq, axis=0).astype(np.int64)
        self.gradients = np.empty((0, 2, k)) if along is None else np.ascontiguousarray(along.reshape(-1, along.shape[2], k))
        self._X = space.tabulate_dof_coordinates()
        self._ring, self._normal = facets[0], compat.Function(space)
        watched = np.unique(np.concatenate([slave, master.owned, self._ring.ravel()]))  # what positions rest on
        self._watch = Watch(self.comm, watched)
        self.pairing = Pairing(self.facets, self._seek(), search, MARGIN * master.edge)
        self._closest = Pairing(self.facets, CLOSEST, search)  # of nodes between Gauss points

    def _seek(self) -> Seek:
        s = self.surface
        if s.gradients is None:
            return CLOSEST
        return along_normals(BEYOND, around=beyond_edges(self.facets)) if s.corners else along_normals(0.0)

    def _met(self, state: State) -> FacetFeet:
        coords, points, normals, _ = placed = self._placed(state)
        return FacetFeet(*placed, self.pairing.project(points, normals, coords, self.timers))

    def first_feet(self, state: State) -> FacetFeet:
        """The places of the first search, which looks farther. Collective."""
        coords, points, normals, _ = placed = self._placed(state)
        return FacetFeet(*placed, self.pairing.far(points, normals, coords, FIRST_SEARCH * self.search))

    def gaps_of(self, image: Image, feet: FacetFeet) -> Floats:
        """Gaps (np,) at an image of the points, endless without a partner."""
        coords = np.concatenate([image.of(feet.coords[: self.first]), feet.coords[self.first :]])
        return self.pairing.far(image.of(feet.points), feet.normals @ image.turn.T, coords, self.search)[4]

    def far(self, feet: FacetFeet, search: float) -> Projection:
        """Projection from the same places with another search distance."""
        return self.pairing.far(feet.points, feet.normals, feet.coords, search)

    def _placed(self, state: State) -> tuple[Floats, Floats, Floats, Pose | None]:
        """All of FacetFeet but the projection."""
        u, s = state.u.x.array, self.surface
        coords = np.concatenate([self._X[self.slave] + u.reshape(-1, 3)[self.slave], self.master.positions(state)])
        points = np.empty((s.area.size, 3))
        slave_points(coords, self.nodes, s.a.reshape(-1, s.a.shape[2]), points)
        normals = self._outward(coords) if s.gradients is not None else self._point_normals(u)
        return coords, points, normals, self.master.pose(state)

    def _outward(self, coords: Floats) -> Floats:
        """Unit normals (np, 3) of the points' own facets, the nodes at coords."""
        inward = np.empty((len(self.nodes), 3))
        facet_directions(coords, self.nodes, self.gradients, inward)
        return -inward

    def _point_normals(self, u: Floats) -> Floats:
        """Outward unit normals (np, 3) at the points, means of those of the facets around. Collective."""
        s = self.surface
        at_nodes, normals = self._nodal_normals(u)[self.slave], np.empty((s.area.size, 3))
        slave_points(at_nodes, self.nodes, s.a.reshape(-1, s.a.shape[2]), normals)
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

    def normals(self, feet: FacetFeet) -> Floats:
        """Unit normals (ne, nq, 3) along which pressure acts on this rank's slave points; zero without a partner."""
        kind, normal = feet.projection[1], feet.projection[5]
        return np.where((kind != NONE)[:, None], normal, 0.0).reshape((*self.surface.area.shape, 3))

    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which this rank's slave points look for the master: their normals. Collective."""
        return self._point_normals(state.u.x.array).reshape((*self.surface.area.shape, 3))

    def meets(self, feet: FacetFeet) -> tuple[Ints64, Ints64, Floats]:
        """Numbers (n,) of points, and of the master's facets that they face, with what areas (n,) [length^2]."""
        at = np.flatnonzero(feet.projection[1] != NONE)
        return at, feet.projection[0][at], self.surface.area.ravel()[at]

    def bare(self, feet: FacetFeet, far: bool = False) -> Floats:
        """Shares (n,) of the points' areas without a partner; far: however far away it is."""
        found = self.far(feet, self.farthest(feet)) if far else feet.projection
        return (found[1] == NONE).astype(float)

    def features(self, feet: FacetFeet) -> Array:
        """Codes (n, ...): where one changes the traction has a kink."""
        return np.column_stack(feet.projection[:3])

    def cut_off(self, state: State) -> Floats:
        """How much nearer (ne, nq) [length] the surfaces are to each other at the points than their facets. Collective."""
        facet, kind = (projection := self.feet(state).projection)[:2]
        there = np.where(kind != NONE, self.master.cut_off[facet], 0.0)
        if self.master.whole:
            nodes, N = self.master.facets[0], np.empty((len(facet), 3, self.master.facets[0].shape[1]))
            foot_shapes(np.arange(len(facet)), self.master.facets, projection, N)
            there = np.einsum("pm,pm->p", N[:, 0], self.master.arches[nodes[facet]])
        return self.surface.cut_off + there.reshape(self.surface.area.shape)

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Gaps (n,) of slave nodes from their closest points on the master, endless without one. Collective."""
        normals, coords = self._nodal_normals(state.u.x.array)[nodes], self.feet(state).coords
        points = coords[np.searchsorted(self.slave, nodes)]
        gaps = self._closest.far(points, normals, coords, self.search)[4]
        return np.where(np.any(normals != 0.0, axis=1), gaps, np.inf)  # degree 2: a facet's normal is known at its corners

    def back_share(self, state: State) -> float:
        """Share of the slave points that see the nearest facet of a tool from behind; those of bodies point out of them.
        Collective."""
        coords, points, normals, pose = self._placed(state)
        if pose is None:
            return 0.0
        return seen_from_behind(self.comm, points, normals, coords[self.facets[0]], self.surface.cell_height)
