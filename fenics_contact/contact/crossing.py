"""How deep nodes and edges of two meshed surfaces in contact lie behind each other's facets, between what holds them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.term import State
from fenics_contact.contact.led import FIXED
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.unit import unit
from fenics_contact.contact.walls import walls_at
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.closest_point import EDGE, VERTEX, closest_points
from fenics_contact.kernels.coverage import Walls, in_front
from fenics_contact.kernels.facets import MAX_NODES, PlacedSurface
from fenics_contact.kernels.passages import parts_within
from fenics_contact.kernels.quadratic import QUADRILATERAL, STRIP, TRIANGLE
from fenics_contact.types import Bools, Floats, Ints64

# Cosine of outward normals above which a facet does not look towards a node: sides of a body pass along each other
FACING = -0.25
# Sine of what the surface turns in an edge from which on that is asked how it passes through the other one: where two facets
# are flatter, an edge between their nodes hides no hundredth of a cell
BLUNT = 0.02
ALONG_EDGE = np.arange(1, 8) / 8  # of the part of an edge that lies within the other surface: where that is asked
REACH = 2.0  # times the longest piece of the other surface: what lies deeper has been let in by steps before
# Flat pieces of facets of degree 2, which have each node for a corner
PIECES = {
    QUADRILATERAL: np.array([[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]]),
    TRIANGLE: np.array([[0, 3, 5, 5], [3, 1, 4, 4], [5, 4, 2, 2], [3, 4, 5, 5]]),
    STRIP: np.array([[0, 4, 5, 3], [4, 1, 2, 5]]),
}
ALONG = np.array([True, False, True, False])  # sides of a strip that lie along its curve


class Crossed(NamedTuple):
    """Nodes of either surface, and places on its edges, that lie behind the other's facets: n of them, of this rank.

    depth (n,) [length]; size (n,): shortest side of the slave's facet there [length]; X (n, 3): a place on the slave in the
    reference; normals (n, 3): out of the slave; slaves (n,): which are nodes of the slave; edges (n,): which are on edges of
    either; at (n,): of nodes of the slave their numbers on it, else those of the slave's facets that the others lie behind,
    or that its edges are sides of; led (n,): supports hold the slave's node along the normal.
    """

    depth: Floats
    size: Floats
    X: Floats
    normals: Floats
    slaves: Bools
    edges: Bools
    at: Ints64
    led: Bools


class _Asked(NamedTuple):
    """Of a side's nodes or places on its edges points (n, 3), outward normals (n, 3), reference positions X (n, 3), each
    one's place, or one beside it, among the side's nodes (n,); size (n,) and at (n,) as of Crossed if it is the slave."""

    points: Floats
    normals: Floats
    X: Floats
    beside: Ints64
    size: Floats
    at: Ints64


@dataclass(frozen=True)
class _Side:
    """A surface in flat pieces, corners (m, 4) and how many (m,), of its facets `of` (m,): these facets' shortest
    sides (m,) [length]; which sides and corners of the pieces lie on the surface's border (m, 4); edges (ne, 2) and
    the pieces to either side of each (ne, 2), on the border one twice; nodes (n,), each once, and the shortest side of a
    facet around each (n,) [length]."""

    surface: MasterSurface | ToolSurface
    corners: Ints64
    size: Ints64
    of: Ints64
    shortest: Floats
    border: dict[int, Bools]
    edges: Ints64
    beside: Ints64
    nodes: Ints64
    around: Floats


def _edges(corners: Ints64, size: Ints64) -> tuple[Ints64, Bools]:
    """Ends (m, 4, 2), rising, of the sides of facets, and which sides there are (m, 4)."""
    after = np.roll(corners, -1, axis=1)
    after[size == 3, 2] = corners[size == 3, 0]
    return np.sort(np.stack([corners, after], axis=-1), axis=-1), np.arange(MAX_NODES) < size[:, None]


def _side(surface: MasterSurface | ToolSurface, plane: bool) -> _Side:
    """Pieces of a surface; plane: it is a curve of strips."""
    corners, size = surface.facets
    of = np.arange(len(corners))
    if surface.whole and len(corners):
        pieces = PIECES[int(size[0])]
        corners, of = np.ascontiguousarray(corners[:, pieces].reshape(-1, MAX_NODES)), np.repeat(of, len(pieces))
        size = np.where(corners[:, 2] == corners[:, 3], 3, 4)
    ends, counts = _edges(*surface.corners)
    length = np.linalg.norm(surface.X[ends[..., 0]] - surface.X[ends[..., 1]], axis=-1)
    shortest = np.where(counts & (ALONG | (not plane)), length, np.inf).min(axis=1, initial=np.inf)[of]
    edges, there = _edges(corners, size)
    ends, number, times = np.unique(edges[there], axis=0, return_inverse=True, return_counts=True)
    once = np.zeros(corners.shape, dtype=bool)
    once[there] = times[number.ravel()] == 1
    order, last = np.nonzero(there)[0][np.argsort(number.ravel(), kind="stable")], np.cumsum(times) - 1
    beside = np.stack([order[last - times + 1], order[last]], axis=1)
    border = {EDGE: once, VERTEX: np.isin(corners, edges[once])}
    nodes, around = np.unique(corners), np.full(len(surface.X), np.inf)
    np.minimum.at(around, corners, shortest[:, None])
    return _Side(surface, corners, size, of, shortest, border, ends, beside, nodes, around[nodes])


class Crossing:
    """The slave's and the master's surface of a contact, all of both on every rank.

    free (n, 3, 3): ways, by rows, that supports leave this rank's nodes of the slave, `skin.owned`; plane: the mesh is, and
    curves are strips; part: of the mesh, as of `walls_at`. The constructor and methods are collective.
    """

    def __init__(
        self, skin: MasterSurface, master: MasterSurface | ToolSurface, free: Floats, plane: bool, part: Ints64
    ) -> None:
        self.skin, self._plane, self._comm = skin, plane, skin.comm
        self._slave, self._master = _side(skin, plane), _side(master, plane)
        self._walls: dict[bool, list[Walls]] = {True: [], False: []}
        if isinstance(master, MasterSurface):
            sides = (skin, self._slave.corners), (master, self._master.corners)
            self._walls = {
                True: walls_at(self._slave.nodes, *sides, part),
                False: walls_at(self._master.nodes, *sides[::-1], part),
            }
        self._free = np.zeros((len(skin.moving), 3, 3))
        self._free[skin.mine] = free
        skin.comm.Allreduce(MPI.IN_PLACE, self._free)

    def facet_nodes(self) -> Ints64:
        """The slave's facets (nf, m) as numbers of its nodes."""
        return self.skin.facets[0] % max(len(self.skin.moving), 1)

    def found(self, state: State) -> Crossed:
        """What lies behind facets at a state, of this rank's part of all nodes and edges."""
        slave, master = self._slave, self._master
        xs, xm = slave.surface.positions(state), master.surface.positions(state)
        ours = [self._ours(self._nodes(slave, xs), xm, False)]
        theirs = [self._theirs(self._nodes(master, xm), xs, False)]
        if not self._plane:  # where all edges are parallel
            ours.append(self._ours(self._on_edges(slave, xs, master, xm), xm, True))
            theirs.append(self._theirs(self._on_edges(master, xm, slave, xs), xs, True))
        both = [np.concatenate(parts) for parts in zip(*theirs, *ours, strict=True)]
        if self._plane:
            both[2] = both[2] * [1.0, 1.0, 0.0]
        return Crossed(*both)

    def _theirs(self, asked: _Asked, xs: Floats, edges: bool) -> Crossed:
        """What of the master lies behind the slave's pieces at xs."""
        slave = self._slave
        _, piece, depth, out = self._behind(self._master, asked, slave, xs)
        no, X = np.zeros(len(piece), dtype=bool), self.skin.X[slave.corners[piece]].mean(axis=1)
        return Crossed(depth, slave.shortest[piece], X, out, no, no | edges, slave.of[piece], no)

    def _ours(self, asked: _Asked, xm: Floats, edges: bool) -> Crossed:
        """What of the slave lies behind the master's pieces at xm."""
        some, _, depth, out = self._behind(self._slave, asked, self._master, xm)
        at, kind = asked.at[some], np.full(len(some), edges)
        led = np.zeros(len(some), dtype=bool)
        if not edges:
            led = np.abs(np.einsum("nfc,nc->nf", self._free[at], out)).max(axis=1, initial=0.0) <= FIXED
        return Crossed(depth, asked.size[some], asked.X[some], -out, ~kind, kind, at, led)

    def _nodes(self, one: _Side, x: Floats) -> _Asked:
        """This rank's part of the nodes of one side at x (nx, 3)."""
        sums = np.zeros_like(x)
        np.add.at(sums, one.corners, area_vectors(x[one.corners])[:, None])
        mine = np.arange(self._comm.rank, len(one.nodes), self._comm.size)
        nodes = one.nodes[mine]
        at = nodes % max(len(self.skin.moving), 1)
        return _Asked(x[nodes], sums[nodes], one.surface.X[nodes], mine, one.around[mine], at)

    def _on_edges(self, one: _Side, x: Floats, other: _Side, y: Floats) -> _Asked:
        """Places on this rank's part of one side's edges, at x (nx, 3), where these pass through the other's pieces at y: in
        and out again, they have no node behind them. Only those on the border and those that stand out do so first."""
        mine = np.arange(self._comm.rank, len(one.edges), self._comm.size)
        edges, beside = one.edges[mine], one.beside[mine]
        normals, first = unit(area_vectors(x[one.corners])), x[edges[:, 0]]
        n, m = normals[beside[:, 0]], normals[beside[:, 1]]
        behind = np.einsum("nc,nc->n", x[one.corners[beside[:, 1]]].mean(axis=1) - first, n) < 0.0
        stands = behind & (np.linalg.norm(np.cross(n, m), axis=1) > BLUNT)
        some = np.flatnonzero(stands | (beside[:, 0] == beside[:, 1]))
        parts = _passages(x[edges[some]], (y, (other.corners, other.size)))
        some, parts = some[within := parts[:, 1] > parts[:, 0]], parts[within]
        t = (parts[:, :1] + (parts[:, 1:] - parts[:, :1]) * ALONG_EDGE).reshape(-1, 1)
        some = np.repeat(some, len(ALONG_EDGE))
        points, X = ((1.0 - t) * z[edges[some, 0]] + t * z[edges[some, 1]] for z in (x, one.surface.X))
        facets = beside[some]
        near, size = np.searchsorted(one.nodes, edges[some, 0]), one.shortest[facets].min(axis=1, initial=np.inf)
        return _Asked(points, n[some] + m[some], X, near, size, one.of[facets[:, 0]])

    def _behind(self, one: _Side, asked: _Asked, other: _Side, y: Floats) -> tuple[Ints64, Ints64, Floats, Floats]:
        """What is asked of one side that lies behind the other's pieces at y (ny, 3): which, behind which piece, how deep
        [length], and that piece's outward normals (n, 3) there."""
        points, normals = asked.points, asked.normals
        if self._plane:
            points, normals = points * [1.0, 1.0, 0.0], normals * [1.0, 1.0, 0.0]
        normals = unit(normals)
        n, search = len(points), REACH * float(np.max(other.around, initial=0.0))
        facet, kind, feature = (np.empty(n, dtype=np.int64) for _ in range(3))
        gap, out = np.empty(n), np.empty((n, 3))
        lists = candidates(points, y, other.corners, other.size, search)
        for walls in self._walls[one is self._slave]:
            lists = in_front(lists, asked.beside, walls, search)
        master, projection = (y, (other.corners, other.size)), (facet, kind, feature, np.empty((n, 2)), gap, out)
        closest_points(points, normals, master, lists, (search, FACING), projection)
        inside = gap < 0.0
        for what, border in other.border.items():
            inside &= (kind != what) | ~border[facet, feature]
        some = np.flatnonzero(inside)
        return some, facet[some], -gap[some], out[some]


def _passages(ends: Floats, surface: PlacedSurface) -> Floats:
    """`parts_within` of edges with ends (n, 2, 3); those of like lengths at once, as the longest says what is near."""
    out, half = np.zeros((len(ends), 2)), 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    scale = np.frexp(half)[1]
    for one in np.unique(scale):
        like = np.flatnonzero(scale == one)
        lists = candidates(ends[like].mean(axis=1), surface[0], *surface[1], float(half[like].max()))
        out[like] = parts_within(ends[like], lists, surface)
    return out
