"""How deep nodes of two meshed surfaces in contact lie behind each other's facets, between the points that hold them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.term import State
from fenics_contact.contact.led import FIXED
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.walls import walls_at
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.closest_point import EDGE, VERTEX, closest_points
from fenics_contact.kernels.coverage import Walls, in_front
from fenics_contact.kernels.facets import MAX_NODES
from fenics_contact.kernels.quadratic import QUADRILATERAL, STRIP, TRIANGLE
from fenics_contact.types import Bools, Floats, Ints64

# Cosine of outward normals above which a facet does not look towards a node: sides of a body pass along each other
FACING = -0.25
REACH = 2.0  # times the longest piece of the other surface: what lies deeper has been let in by steps before
# Flat pieces of facets of degree 2, which have each node for a corner
PIECES = {
    QUADRILATERAL: np.array([[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]]),
    TRIANGLE: np.array([[0, 3, 5, 5], [3, 1, 4, 4], [5, 4, 2, 2], [3, 4, 5, 5]]),
    STRIP: np.array([[0, 4, 5, 3], [4, 1, 2, 5]]),
}
ALONG = np.array([True, False, True, False])  # sides of a strip that lie along its curve


class Crossed(NamedTuple):
    """Nodes of either surface that lie behind the other's facets: n of them, of this rank.

    depth (n,) [length]; size (n,): shortest side of the slave's facet there [length]; X (n, 3): a place on the slave in the
    reference; normals (n, 3): out of the slave; slaves (n,): which are nodes of the slave; at (n,): their numbers on it,
    else those of the slave's facets that the others lie behind; led (n,): supports hold the slave's node along the normal.
    """

    depth: Floats
    size: Floats
    X: Floats
    normals: Floats
    slaves: Bools
    at: Ints64
    led: Bools


@dataclass(frozen=True)
class _Side:
    """A surface in flat pieces, corners (m, 4) and how many (m,), of its facets `of` (m,): these facets' shortest
    sides (m,) [length]; which sides and corners of the pieces lie on the surface's border (m, 4); nodes (n,), each once, and
    the shortest side of a facet around each (n,) [length]."""

    surface: MasterSurface | ToolSurface
    corners: Ints64
    size: Ints64
    of: Ints64
    shortest: Floats
    border: dict[int, Bools]
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
    _, number, times = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    once = (times[number.ravel()] == 1).reshape(corners.shape) & there
    border = {EDGE: once, VERTEX: np.isin(corners, edges[once])}
    nodes, around = np.unique(corners), np.full(len(surface.X), np.inf)
    np.minimum.at(around, corners, shortest[:, None])
    return _Side(surface, corners, size, of, shortest, border, nodes, around[nodes])


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
        """What lies behind facets at a state, of this rank's part of all nodes."""
        slave, master = self._slave, self._master
        xs, xm = slave.surface.positions(state), master.surface.positions(state)
        nodes, piece, depth, out = self._behind(master, xm, slave, xs)
        theirs = Crossed(
            depth, slave.shortest[piece], self.skin.X[slave.corners[piece]].mean(axis=1), out, np.zeros(len(nodes), bool),
            slave.of[piece], np.zeros(len(nodes), bool),
        )  # fmt: skip
        nodes, piece, depth, out = self._behind(slave, xs, master, xm)
        at = slave.nodes[nodes] % max(len(self.skin.moving), 1)
        led = np.abs(np.einsum("nfc,nc->nf", self._free[at], out)).max(axis=1, initial=0.0) <= FIXED
        ours = Crossed(depth, slave.around[nodes], self.skin.X[slave.nodes[nodes]], -out, np.ones(len(nodes), bool), at, led)
        both = [np.concatenate(pair) for pair in zip(theirs, ours, strict=True)]
        if self._plane:
            both[2] = both[2] * [1.0, 1.0, 0.0]
        return Crossed(*both)

    def _behind(self, one: _Side, x: Floats, other: _Side, y: Floats) -> tuple[Ints64, Ints64, Floats, Floats]:
        """Of this rank's part of the nodes of one side at x (nx, 3) that lie behind the other's pieces at y (ny, 3): which,
        behind which piece, how deep [length], and that piece's outward normals (n, 3) there."""
        sums = np.zeros_like(x)
        np.add.at(sums, one.corners, area_vectors(x[one.corners])[:, None])
        mine = np.arange(self._comm.rank, len(one.nodes), self._comm.size)
        points, normals = x[one.nodes[mine]], sums[one.nodes[mine]]
        if self._plane:
            points, normals = points * [1.0, 1.0, 0.0], normals * [1.0, 1.0, 0.0]
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        n, search = len(points), REACH * float(np.max(other.around, initial=0.0))
        facet, kind, feature = (np.empty(n, dtype=np.int64) for _ in range(3))
        gap, out = np.empty(n), np.empty((n, 3))
        lists = candidates(points, y, other.corners, other.size, search)
        for walls in self._walls[one is self._slave]:
            lists = in_front(lists, mine, walls, search)
        master, projection = (y, (other.corners, other.size)), (facet, kind, feature, np.empty((n, 2)), gap, out)
        closest_points(points, normals, master, lists, (search, FACING), projection)
        inside = gap < 0.0
        for what, border in other.border.items():
            inside &= (kind != what) | ~border[facet, feature]
        some = np.flatnonzero(inside)
        return mine[some], facet[some], -gap[some], out[some]
