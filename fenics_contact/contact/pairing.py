"""Pairing of slave points with the facet of the master surface that is nearest to each."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.term import State
from fenics_contact.kernels import coverage
from fenics_contact.kernels.broad_phase import candidates, candidates_along, facet_balls
from fenics_contact.kernels.closest_point import Lists, Projection, closest_points
from fenics_contact.kernels.facets import MAX_NODES, PlacedSurface, Surface
from fenics_contact.kernels.quadratic import quadratic_rays
from fenics_contact.kernels.slave_ray import slave_rays
from fenics_contact.timing import Timers
from fenics_contact.types import Floats, Ints64

FACING = 0.0  # cosine of outward normals above which a facet looks the slave's own way and is no partner
# Of a facet's radius: by how much a normal from the border of a surface may miss the master. Surfaces that end together part
# by less, and a point that far outside has left.
BEYOND = 0.1
FAR_BEYOND = 1.0  # the same for samples, of which some lies over the master while they miss it by less than their own size
# Of a facet's radius: what lies on it is no farther from its middle, curved ones included
WIDER = 1.1
NO_EDGES = np.empty((0, 4), dtype=np.int64)

Walled = tuple[Ints64, coverage.Walls]


class Watch:
    """Says whether any of the local nodes `watched`, or a tool, has moved on any rank since it was asked last."""

    def __init__(self, comm: MPI.Comm, watched: Ints64) -> None:
        self._comm, self._watched = comm, watched
        self._seen: tuple[Floats, ...] | None = None

    def moved(self, state: State) -> bool:
        """Collective."""
        now = state.u.x.array.reshape(-1, 3)[self._watched], state.q.copy(), state.poses.turns.copy()
        same = self._seen is not None and all(np.array_equal(a, b) for a, b in zip(now, self._seen, strict=True))
        moved = np.array([not same], dtype=np.int32)
        self._comm.Allreduce(MPI.IN_PLACE, moved)
        if moved[0]:
            self._seen = now
        return bool(moved[0])


class Seek(NamedTuple):
    """What finds partners.

    fill(points, normals, (coords, facets) of the master, lists, search, projection): fills the arrays of
    kernels/closest_point.py; beyond: partners lie along normals, which may miss a facet by this share of its radius; None:
    all around.
    """

    fill: Callable[[Floats, Floats, PlacedSurface, Lists, float, Projection], None]
    beyond: float | None


class Pairing:
    """Partners of slave points on a master surface within `search` [length].

    facets: the master's (nodes, size). walled: the slave's facet of each point (np,), and which facets of the master are the
    other sides of these (kernels/coverage.py): they are no candidates.

    All around points, candidate lists are a cache: they hold all facets within search + margin and are renewed when points
    and facets have moved by more than the margin since; no result depends on when. Along normals they are short, and made
    as fast as read.
    """

    def __init__(
        self, facets: Surface, seek: Seek, search: float, margin: float = 0.0, walled: Walled | None = None
    ) -> None:
        self.facets, self.seek, self.search, self.margin, self._walled = facets, seek, search, margin, walled
        self._lists: Lists | None = None
        self._places: tuple[Floats, Floats] | None = None

    def project(self, points: Floats, normals: Floats, coords: Floats, timers: Timers) -> Projection:
        """Projection of points (np, 3) with outward normals (np, 3) on the facets at positions coords (nx, 3)."""
        lists = self._lists
        if lists is None or self._strayed(points, coords):
            with timers("search"):
                lists = self._met(points, normals, coords, self.search + self.margin)
            if self.seek.beyond is None:
                self._lists, self._places = lists, (points, coords)
        return self._sought(points, normals, coords, lists, self.search)

    def _strayed(self, points: Floats, coords: Floats) -> bool:
        before = self._places or (points, coords)
        far = [(np.square(a - b)).sum(axis=1).max(initial=0.0) for a, b in zip((points, coords), before, strict=True)]
        return not np.sqrt(far).sum() <= self.margin

    def within(self, points: Floats, coords: Floats, search: float) -> Lists:
        """CSR lists (offsets, facets) of the facets whose box, enlarged by `search`, holds the points (np, 3)."""
        return candidates(points, coords, *self.facets, search)

    def far(self, points: Floats, normals: Floats, coords: Floats, search: float) -> Projection:
        """Projection with another search distance, nothing kept."""
        return self._sought(points, normals, coords, self._met(points, normals, coords, search), search)

    def _met(self, points: Floats, normals: Floats, coords: Floats, search: float) -> Lists:
        """Lists of the facets that may be met within a distance, without what no point can meet."""
        if self.seek.beyond is None:
            lists = self.within(points, coords, search)
        else:
            centres, radii = facet_balls((coords, self.facets))
            lists = candidates_along(points, normals, (centres, (WIDER + self.seek.beyond) ** 2 * radii), search)
        return lists if self._walled is None else coverage.in_front(lists, *self._walled, search)

    def _sought(self, points: Floats, normals: Floats, coords: Floats, lists: Lists, search: float) -> Projection:
        n = len(points)
        facet, kind, feature = (np.empty(n, dtype=np.int64) for _ in range(3))
        out = facet, kind, feature, np.empty((n, 2)), np.empty(n), np.empty((n, 3))
        self.seek.fill(points, normals, (coords, self.facets), lists, search, out)
        return out


def _closest(points: Floats, normals: Floats, master: PlacedSurface, lists: Lists, search: float, out: Projection) -> None:
    closest_points(points, normals, master, lists, (search, FACING), out)


# The closest point on the master, for slave nodes
CLOSEST = Seek(_closest, None)


def along_normals(beyond: float, quadratic: bool = False, around: Ints64 = NO_EDGES) -> Seek:
    """Seeks along given unit normals (np, 3) out of the slave, which may miss facets by `beyond` where the surface does not
    go on; around (nf, 4): of `coverage.beyond_edges`, where they may; quadratic: facets are of degree 2."""
    rays = quadratic_rays if quadratic else slave_rays

    def fill(points: Floats, normals: Floats, master: PlacedSurface, lists: Lists, search: float, out: Projection) -> None:
        rays(points, -normals, master, lists, (search, beyond, FACING), out)
        if beyond > 0.0:
            coverage.lose_passed(points, master, around, out)

    return Seek(fill, beyond)


def in_sight(
    corners: Surface, held: coverage.Sight | None = None, kept: Ints64 | None = None, beyond: float = FAR_BEYOND
) -> Seek:
    """Seeks along given unit normals (np, 3) out of the slave among the facets (their corners) that look towards the points
    as a whole, for so their ends are found, too; held: in a sight that is held; kept (np,): the facet that alone a point is
    paired with, -1: any. By its slope at the foot alone a curved facet came and went under a sample, with all of its
    share."""

    def fill(points: Floats, normals: Floats, master: PlacedSurface, lists: Lists, search: float, out: Projection) -> None:
        rays = slave_rays if master[1][0].shape[1] == MAX_NODES else quadratic_rays
        seen = coverage.in_sight(lists, held or (-normals, master[0]), corners)
        seen = seen if kept is None else coverage.kept(seen, kept)
        rays(points, -normals, master, seen, (search, beyond, FACING), out)

    return Seek(fill, beyond)
