"""Nodes of a body that lie inside another one, or inside itself, where no contact holds them."""

from itertools import permutations

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import spot, tidied
from fenics_contact.assembly.system import System
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.types import Bools, Floats, Ints64

DEEP = 0.05  # of a cell's size: what lies less deep may be what straight cells cut off
ROUNDED = 1e-9  # of a simplex: a point so near to its border is in it
BESIDE = 0.5  # of a cell's extents: a node of its own body that was so near to it at rest is its own, or a neighbour's
SOME = 200  # nodes at most whose depth is looked for
ITSELF = (
    "it is on no surface of a contact of the body with itself, so nothing keeps it out; state one of the surfaces that meet "
    "there"
)
OTHER = (
    "it is on no surface of a contact of these two, so nothing keeps it out; name the surface that it lies on among the "
    "slaves, or state a contact"
)


class Overlaps:
    """Nodes on the bodies' boundaries, the places where no contact holds them out, and what they may have come into there.

    Construction is collective.
    """

    def __init__(self, system: System) -> None:
        self._system, space, mesh = system, system.space, system.space.mesh
        self._X, self._dim = space.tabulate_dof_coordinates(), mesh.topology.dim
        self._body = np.full(len(self._X), -1)
        for i, (_, nodes) in enumerate(system.bodies):
            self._body[nodes] = i
        corners = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}[compat.cell_name(mesh)]
        self._cells = compat.cell_dofs(space)[: compat.cell_map(mesh).size_local, :corners].astype(np.int64)
        self._sizes = np.full(len(self._cells), corners)
        self._facets = self._parts_of_boundary()
        outer = np.unique(compat.locate_blocks(space, compat.exterior_facets(mesh)))
        self._outer = outer[outer < space.dofmap.index_map.size_local]
        # of all processes: where they lie at rest, in which body, and which bodies (n, bodies) keep them out
        parts = system.comm.allgather((self._X[self._outer], self._body[self._outer], self._held()))
        self._nodes, self._own, self._barred = (np.concatenate(part) for part in zip(*parts, strict=True))

    def deepest(self) -> dict[str, tuple[str, str]]:
        """{which bodies: which node lies deepest in one, and why with a remedy}; {} if none does. Collective."""
        system = self._system
        places = self._X + system.state.u.x.array.reshape(-1, 3)
        x = np.concatenate(system.comm.allgather(places[self._outer]))
        node, other, size = self._inside(x, places)
        found = [pair for part in system.comm.allgather(list(zip(node, other, size, strict=True))) for pair in part]
        if not found:
            return {}
        pairs = {(n, b): h for n, b, h in sorted(found)[:: max(len(found) // SOME, 1)]}
        depths = self._depths(list(pairs), x, places)
        shares = depths / np.array([*pairs.values()])
        if not (shares > DEEP).any():
            return {}
        worst = int(shares.argmax())
        (n, b), h = list(pairs.items())[worst]
        one, two = system.bodies[self._own[n]][0], system.bodies[b][0]
        where = spot(tidied(self._nodes, np.abs(self._nodes).max())[n])
        what = "another part of itself" if one == two else f"body '{two}'"
        text = f"a node of body '{one}', {where}, lies {depths[worst]:.3g} inside {what}, where a cell is {h:.3g} wide"
        return {f"in one another: {sorted([one, two])}": (text, ITSELF if one == two else OTHER)}

    def _held(self) -> Bools:
        """Which bodies (n, bodies) this process's nodes have a contact with that keeps them out. Collective."""
        mine, held = self._body[self._outer], np.zeros((len(self._outer), len(self._system.bodies)), dtype=bool)
        for contact in self._system.contacts:
            touched, folds = _bodies_of(self._system, contact, self._body)
            here = np.isin(self._outer, contact.partner.nodes)
            for i in np.flatnonzero(touched):
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

    def _inside(self, x: Floats, places: Floats) -> tuple[list[int], list[int], list[float]]:
        """Of nodes at x (n, 3) inside this process's cells, of a body that nothing keeps them out of: which, which body, and
        the cell's size [length]."""
        starts, listed = candidates(x, places, self._cells, self._sizes, 0.0)
        node = np.repeat(np.arange(len(x)), np.diff(starts))
        other = self._body[self._cells[listed, 0]]
        free = ~self._barred[node, other]
        own = np.flatnonzero(free & (other == self._own[node]))
        free[own] = ~_beside(self._nodes[node[own]], self._X[self._cells[listed[own]]])
        node, listed, other = node[free], listed[free], other[free]
        corners = places[self._cells[listed]][..., : self._dim]
        within = np.zeros(len(node), dtype=bool)
        for simplex in _simplices(corners.shape[1], self._dim):
            first, *rest = (corners[:, i] for i in simplex)
            edges = np.stack([one - first for one in rest], axis=-1)
            sound = np.linalg.det(edges) != 0.0
            share = np.linalg.solve(edges[sound], (x[node[sound], : self._dim] - first[sound])[..., None])[..., 0]
            low = np.minimum(share.min(axis=1), 1.0 - share.sum(axis=1))
            within[sound] |= low > -ROUNDED
        size = np.ptp(corners[within], axis=1).min(axis=1)
        return node[within].tolist(), other[within].tolist(), size.tolist()

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


def _bodies_of(system: System, contact: ContactTerm, body_of: Ints64) -> tuple[Bools, bool]:
    """Which bodies a contact touches, and whether it can hold one of them out of itself: all have slaves. Collective."""
    numbers = np.arange(len(system.bodies))
    here = np.array([np.isin(numbers, body_of[nodes]) for nodes in (contact.partner.nodes, contact.surface.nodes)])
    touched, slave = np.any(system.comm.allgather(here), axis=0)
    return touched, not contact.partner.grounded and bool((touched == slave).all())


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
