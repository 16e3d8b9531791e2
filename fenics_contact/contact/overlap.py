"""Nodes of a body that lie inside another one, or inside itself, where no contact holds them."""

from itertools import permutations

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Remark, spot, tidied
from fenics_contact.assembly.pairs import Image
from fenics_contact.assembly.system import System
from fenics_contact.contact.on_facets import PlacesOnFacets
from fenics_contact.contact.rigid_places import pressed
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.types import Bools, Floats, Ints, Ints64

DEEP = 0.05  # of a cell's size: what lies less deep may be what straight cells cut off
ROUNDED = 1e-9  # of a simplex: a point so near to its border is in it
BESIDE = 0.5  # of a cell's extents: a node of its own body that was so near to it at rest is its own, or a neighbour's
ON_THE_WAY = (0.1, 0.3, 0.5, 0.7, 0.9)  # out of a body: shares where it is asked whether that is still there
SOME = 200  # nodes at most whose depth is looked for
ITSELF = (
    "it is on no surface of a contact of the body with itself, so nothing keeps it out; state one of the surfaces that meet "
    "there"
)
OTHER = (
    "it is on no surface of a contact of these two, so nothing keeps it out; name the surface that it lies on among the "
    "slaves, or state a contact"
)
NEIGHBOUR = (
    "contact ends at a pair's faces, so nothing keeps it out; state the plane between neighbours as a tool where they meet "
    "alike, or several cells as one, with a contact of the body with itself"
)


class Overlaps:
    """Nodes on the bodies' boundaries, the places where no contact holds them out, and what they may have come into there.

    Construction is collective.
    """

    def __init__(self, system: System) -> None:
        self._system, space, mesh = system, system.space, system.space.mesh
        self._X, self._dim = space.tabulate_dof_coordinates(), mesh.topology.dim
        self._body = _body_of(system)
        self._cells = _cells(system)
        self._facets = self._parts_of_boundary()
        self._outer = _outer(system)
        # of all processes: where they lie at rest, in which body, and which bodies (n, bodies) keep them out
        parts = system.comm.allgather((self._X[self._outer], self._body[self._outer], self._held()))
        self._nodes, self._own, self._barred = (np.concatenate(part) for part in zip(*parts, strict=True))
        images, self._count = self._images(0.0), len(self._nodes)  # which follow the nodes; contacts end at pairs of faces
        self._own = np.tile(self._own, 1 + len(images))
        self._barred = np.concatenate([self._barred, *(np.zeros_like(self._barred) for _ in images)])
        self._nodes = np.concatenate([self._nodes, *(image.of(self._nodes) for image in images)])

    def remarks(self) -> dict[str, Remark]:
        """{which bodies: what is to be said of the node that lies deepest in one}; {} if none does. Collective."""
        system = self._system
        places = self._X + system.state.u.x.array.reshape(-1, 3)
        x = np.concatenate(system.comm.allgather(places[self._outer]))
        x = np.concatenate([x, *(image.of(x) for image in self._images(system.state.t))])
        node, other, size = self._inside(x, places, self._pressed())
        found = [pair for part in system.comm.allgather(list(zip(node, other, size, strict=True))) for pair in part]
        if not found:
            return {}
        pairs = {(n, b): h for n, b, h in sorted(found)[:: max(len(found) // SOME, 1)]}
        depths = self._depths(list(pairs), x, places)
        shares = depths / np.array([*pairs.values()])
        remarks: dict[str, tuple[float, Remark]] = {}
        for share, depth, (pair, h) in zip(shares, depths, pairs.items(), strict=True):
            key, remark = self._remark(pair, float(depth), h)
            if share > remarks.get(key, (DEEP, None))[0]:
                remarks[key] = float(share), remark
        return {key: remark for key, (_, remark) in remarks.items()}

    def _remark(self, pair: tuple[int, int], depth: float, h: float) -> tuple[str, Remark]:
        """Of a node that lies so deep in a body, where a cell is h wide [length]: both bodies, and what is to be said."""
        (n, b), bodies, at = pair, self._system.bodies, self._nodes[: self._count]
        one, two = bodies[self._own[n]][0], bodies[b][0]
        where = spot(tidied(at, np.abs(at).max())[n % self._count])
        if n >= self._count:
            where += ", where a pair of faces puts its neighbour"
        what = "another part of itself" if one == two else f"body '{two}'"
        text = f"a node of body '{one}', {where}, lies {depth:.3g} inside {what}, where a cell is {h:.3g} wide"
        why = (ITSELF if one == two else OTHER) if n < self._count else NEIGHBOUR
        return str(sorted([one, two])), Remark(depth, f"{text}: {why}")

    def _images(self, t: float) -> list[Image]:
        """Where pairs of faces put the bodies' neighbours at t. Collective."""
        pairs = self._system.supports.pairs
        return [] if pairs is None else pairs.images(t)

    def _held(self) -> Bools:
        """Which bodies (n, bodies) this process's nodes have a contact with that keeps them out. Collective."""
        system, numbers = self._system, range(len(self._system.bodies))
        mine, held = self._body[self._outer], np.zeros((len(self._outer), len(numbers)), dtype=bool)
        for contact in system.contact_terms:
            touched = [i for i in numbers if contact in system.holds.contacts_of(i)]
            slaves = system.comm.allgather(np.isin(touched, self._body[contact.surface.nodes]))
            # one whose bodies all have slaves can hold one of them out of itself
            folds = not contact.partner.grounded and bool(np.any(slaves, axis=0).all())
            here = np.isin(self._outer, contact.partner.nodes)
            for i in touched:
                held[here & ((mine != i) | folds), i] = True
        return held

    def _parts_of_boundary(self) -> list[Ints64]:
        """The boundary of this process's cells, by its corners: segments (n, 2) or triangles (n, 3) of nodes."""
        space, out = self._system.space, list[Ints64]()
        cells, number = compat.cells_of_exterior_facets(space.mesh)
        for facet in np.unique(number):
            local = compat.facet_closure_dofs(space, int(facet))
            nodes = compat.cell_dofs(space)[cells[number == facet]][:, local[local < self._cells.shape[1]]]
            out += [nodes] if nodes.shape[1] == self._dim else [nodes[:, :3], nodes[:, 1:]]  # a quadrilateral: two triangles
        return out

    def _pressed(self) -> Bools:
        """Which of all nodes (n,), and of their images, are images of what a tool presses: of a plane between neighbours two
        bodies stand off by what the penalties leave. Collective."""
        system, images = self._system, len(self._nodes) - self._count
        if not images:
            return np.zeros(self._count, dtype=bool)
        tools = [contact for contact in system.contact_terms if contact.partner.grounded]
        held = np.concatenate(system.comm.allgather(pressed(system.space, tools)[self._outer]))
        return np.append(np.zeros_like(held), np.tile(held, images // self._count))

    def _inside(self, x: Floats, places: Floats, held: Bools) -> tuple[list[int], list[int], list[float]]:
        """Of nodes at x (n, 3) inside this process's cells, of a body that nothing keeps them out of, but held (n,) ones:
        which, which body, and the cell's size [length]."""
        node, cell = _nearby(x, places, self._cells)
        other = self._body[self._cells[cell, 0]]
        free = ~(self._barred[node, other] | held[node])
        own = np.flatnonzero(free & (other == self._own[node]))
        free[own] = ~_beside(self._nodes[node[own]], self._X[self._cells[cell[own]]])
        node, cell = _within(x, places, self._cells, self._dim, (node[free], cell[free]))
        corners = places[self._cells[cell]]
        i, j = np.triu_indices(corners.shape[1], 1)
        size = np.linalg.norm(corners[:, i] - corners[:, j], axis=2).min(
            axis=1
        )  # of its shortest side, however it is turned
        return node.tolist(), self._body[self._cells[cell, 0]].tolist(), size.tolist()

    def _depths(self, pairs: list[tuple[int, int]], x: Floats, places: Floats) -> Floats:
        """How far [length] each node at x (n, 3) is from the boundary of a body, in pairs; from that of its own one, where
        it was not beside it at rest. Collective."""
        out = np.full(len(pairs), np.inf)
        for part in self._facets:
            owner, points, rest = self._body[part[:, 0]], places[part], self._X[part]
            for i, (n, body) in enumerate(pairs):
                there = owner == body
                if body == self._own[n]:
                    there &= ~_beside(self._nodes[n], rest)
                out[i] = min(out[i], _distance(x[n], points[there]))
        return np.asarray(np.min([out, *self._system.comm.allgather(out)], axis=0))


def deepest_start(system: System, contact: ContactTerm, least: float) -> tuple[float, float] | None:
    """Depth [length] of the deepest slave point deeper than `least` in the master before anything has moved, zero if there
    is none: all the way out it has to lie in one body. A ray that leaves the slave's own body before it meets a surface
    from behind has found another one; how far behind, of those that a step would find, too. None where that is not asked.
    Collective.
    """
    if contact.partner.grounded or not isinstance(contact.places, PlacesOnFacets):
        return None
    ways = contact.places.ways_inside(system.state, least)
    depth, start, end = (np.concatenate(part) for part in zip(*system.comm.allgather(ways), strict=True))
    x = np.concatenate([start + share * (end - start) for share in ON_THE_WAY])
    cells, body = _cells(system), _body_of(system)
    places = system.space.tabulate_dof_coordinates() + system.state.u.x.array.reshape(-1, 3)
    point, cell = _within(x, places, cells, system.space.mesh.topology.dim, _nearby(x, places, cells))
    here = np.zeros((len(x), len(system.bodies)), dtype=bool)
    here[point, body[cells[cell, 0]]] = True
    there = np.any(system.comm.allgather(here), axis=0).reshape(len(ON_THE_WAY), len(depth), len(system.bodies))
    inside = there.all(axis=0).any(axis=1)
    met = ~inside & (depth <= contact.places.search)
    return float(depth[inside].max(initial=0.0)), float(depth[met].max(initial=0.0))


def drawn_through(system: System) -> tuple[str, str] | None:
    """A body that some contact is to keep out of itself, and a place where it was drawn through itself, by more than DEEP of
    a cell: what then lies behind a slave's facet cannot be told from the other side of a wall. Collective."""
    if not any(
        isinstance(contact.places, PlacesOnFacets) and contact.places.meets_itself for contact in system.contact_terms
    ):
        return None
    space, body, cells, blocks = system.space, _body_of(system), _cells(system), compat.global_blocks(system.space)
    X, outer = space.tabulate_dof_coordinates(), _outer(system)
    parts = system.comm.allgather((X[outer], body[outer], blocks[outer]))
    x, own, numbers = (np.concatenate(part) for part in zip(*parts, strict=True))
    node, cell = _within(x, X, cells, space.mesh.topology.dim, _nearby(x, X, cells), DEEP)
    # a node of a curved side lies within the straight cell of its own corners where the side is hollow
    its = (blocks[compat.cell_dofs(space)[cell]] == numbers[node][:, None]).any(axis=1)
    here = [int(n) for n in node[(own[node] == body[cells[cell, 0]]) & ~its]]
    found = sorted(n for part in system.comm.allgather(here) for n in part)
    return (system.bodies[own[found[0]]][0], spot(tidied(x[found[:1]], np.abs(x).max())[0])) if found else None


def _outer(system: System) -> Ints:
    """This process's nodes on the boundary."""
    nodes = np.unique(compat.locate_blocks(system.space, compat.exterior_facets(system.space.mesh)))
    return np.asarray(nodes[nodes < system.space.dofmap.index_map.size_local])


def _body_of(system: System) -> Ints64:
    """The number of the body of each local node."""
    out = np.full(len(system.state.u.x.array) // 3, -1)
    for i, (_, nodes) in enumerate(system.bodies):
        out[nodes] = i
    return out


def _cells(system: System) -> Ints64:
    """The corners (nc, 2^d or d + 1) of this process's cells, local nodes."""
    mesh = system.space.mesh
    corners = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}[compat.cell_name(mesh)]
    return compat.cell_dofs(system.space)[: compat.cell_map(mesh).size_local, :corners].astype(np.int64)


def _nearby(x: Floats, places: Floats, cells: Ints64) -> tuple[Ints64, Ints64]:
    """Points x (n, 3) and the cells, corners (nc, k) at places (nx, 3), in whose boxes they lie."""
    starts, listed = candidates(x, places, cells, np.full(len(cells), cells.shape[1]), 0.0)
    return np.repeat(np.arange(len(x)), np.diff(starts)), listed


def _within(
    x: Floats, places: Floats, cells: Ints64, dim: int, pairs: tuple[Ints64, Ints64], least: float = -ROUNDED
) -> tuple[Ints64, Ints64]:
    """Of pairs of `_nearby` those of which the point lies in the cell, by more than a share of one of its simplices."""
    point, cell = pairs
    corners, within = places[cells[cell]][..., :dim], np.zeros(len(point), dtype=bool)
    for simplex in _simplices(cells.shape[1], dim):
        first, *rest = (corners[:, i] for i in simplex)
        edges = np.stack([one - first for one in rest], axis=-1)
        sound = np.linalg.det(edges) != 0.0
        share = np.linalg.solve(edges[sound], (x[point[sound], :dim] - first[sound])[..., None])[..., 0]
        low = np.minimum(share.min(axis=1), 1.0 - share.sum(axis=1))
        within[sound] |= low > least
    return point[within], cell[within]


def _simplices(corners: int, dim: int) -> Ints64:
    """Into which a cell with so many corners falls, (n, dim + 1); along the axes in every order, corners as bits."""
    if corners == dim + 1:
        return np.arange(dim + 1)[None]
    ways = [np.cumsum([0, *(1 << axis for axis in order)]) for order in permutations(range(dim))]
    return np.array(ways)


def _beside(X: Floats, corners: Floats) -> Bools:
    """Which places (n, 3) lie in the box around corners (n, k, 3), BESIDE of its extents away, or nearer."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    return np.asarray((np.abs(2.0 * X - low - high) <= (1.0 + 2.0 * BESIDE) * (high - low)).all(axis=1))


def _distance(place: Floats, corners: Floats) -> float:
    """Of a place (3,) from the nearest of segments (n, 2, 3) or triangles (n, 3, 3)."""
    if corners.shape[1] == 3:
        a, b, c = corners.transpose(1, 0, 2)
        one, two, way = b - a, c - a, place - a
        normal = np.cross(one, two)
        square = np.maximum((normal**2).sum(axis=1), 1e-300)
        s = np.einsum("nc,nc->n", np.cross(way, two), normal) / square
        t = np.einsum("nc,nc->n", np.cross(one, way), normal) / square
        above = np.abs(np.einsum("nc,nc->n", way, normal)) / np.sqrt(square)
        least = above[(s >= 0.0) & (t >= 0.0) & (s + t <= 1.0)].min(initial=np.inf)
        return min(least, *(_distance(place, np.stack(edge, axis=1)) for edge in ((a, b), (b, c), (c, a))))
    a, along = corners[:, 0], corners[:, 1] - corners[:, 0]
    share = np.einsum("nc,nc->n", place - a, along) / np.maximum((along**2).sum(axis=1), 1e-300)
    foot = a + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.linalg.norm(place - foot, axis=1).min(initial=np.inf))
