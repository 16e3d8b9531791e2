"""Nodes of one body that lie inside another one, where no contact between the two holds them."""

from itertools import permutations

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.finding import spot, tidied
from fenics_contact.assembly.system import System
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.types import Bools, Floats, Ints64

DEEP = 0.05  # of a cell's size: what lies less deep may be what straight cells cut off
ROUNDED = 1e-9  # of a simplex: a point so near to its border is in it
SOME = 200  # nodes at most whose depth is looked for


def overlaps(system: System) -> list[str]:
    """A note on the node that lies deepest in another body, but for those on surfaces of a contact with it. Collective."""
    if len(system.bodies) < 2:
        return []
    body_of = np.full(len(system.state.u.x.array) // 3, -1)
    for i, (_, nodes) in enumerate(system.bodies):
        body_of[nodes] = i
    places = system.space.tabulate_dof_coordinates() + system.state.u.x.array.reshape(-1, 3)
    X, x, body, held = _skin_nodes(system, body_of, places)
    cells = _cells(system)
    node, other, size = _inside(x, held, places, cells, body_of, system.space.mesh.topology.dim)
    found = [pair for part in system.comm.allgather(list(zip(node, other, size, strict=True))) for pair in part]
    pairs = {(n, b): h for n, b, h in sorted(found)[:: max(len(found) // SOME, 1)]}
    depths = _depths(system, [(x[n], b) for n, b in pairs], places, body_of)
    shares = depths / np.array([*pairs.values()])
    if not (shares > DEEP).any():
        return []
    worst = int(shares.argmax())
    (n, b), h = list(pairs.items())[worst]
    one, two, place = system.bodies[body[n]][0], system.bodies[b][0], spot(tidied(X, np.abs(X).max())[n])
    return [
        f"a node of body '{one}', {place}, lies {depths[worst]:.3g} inside body '{two}', where a cell is {h:.3g} wide: "
        "it is on no surface of a contact of these two, so nothing keeps it out; name the surface that it lies on among the "
        "slaves, or state a contact"
    ]


def _skin_nodes(system: System, body_of: Ints64, places: Floats) -> tuple[Floats, Floats, Ints64, Bools]:
    """Of all nodes on the bodies' boundaries, of all processes: reference and present places (n, 3), body (n,), and which
    bodies (n, bodies) they have a contact with that keeps them out. Collective."""
    space = system.space
    outer = np.unique(compat.locate_blocks(space, compat.exterior_facets(space.mesh)))
    outer = outer[outer < space.dofmap.index_map.size_local]
    held = np.zeros((len(outer), len(system.bodies)), dtype=bool)
    for contact in system.contacts:
        met = np.array([contact in system.holds.contacts_of(i) for i in range(len(system.bodies))])
        held[np.ix_(np.isin(outer, contact.partner.nodes), met)] = True
    parts = system.comm.allgather((space.tabulate_dof_coordinates()[outer], places[outer], body_of[outer], held))
    X, x, body, barred = (np.concatenate(part) for part in zip(*parts, strict=True))
    barred[np.arange(len(body)), body] = True
    return X, x, body, barred


def _cells(system: System) -> Ints64:
    """The corners (nc, 2^d or d + 1) of this process's cells, local nodes."""
    mesh = system.space.mesh
    corners = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}[compat.cell_name(mesh)]
    owned = compat.cell_map(mesh).size_local
    return compat.cell_dofs(system.space)[:owned, :corners].astype(np.int64)


def _simplices(corners: int, dim: int) -> Ints64:
    """Into which a cell with so many corners falls, (n, dim + 1); along the axes in every order, corners as bits."""
    if corners == dim + 1:
        return np.arange(dim + 1)[None]
    ways = [np.cumsum([0, *(1 << axis for axis in order)]) for order in permutations(range(dim))]
    return np.array(ways)


def _inside(
    x: Floats, held: Bools, places: Floats, cells: Ints64, body_of: Ints64, dim: int
) -> tuple[list[int], list[int], list[float]]:
    """Of nodes at x (n, 3) inside this process's cells, of dimension dim, of another body that nothing keeps them out of:
    which, which body, and the cell's size [length]."""
    starts, listed = candidates(x, places, cells, np.full(len(cells), cells.shape[1]), 0.0)
    node = np.repeat(np.arange(len(x)), np.diff(starts))
    other = body_of[cells[listed, 0]]
    free = ~held[node, other]
    node, listed, other = node[free], listed[free], other[free]
    corners = places[cells[listed]]
    within = np.zeros(len(node), dtype=bool)
    for simplex in _simplices(cells.shape[1], dim):
        first, *rest = (corners[:, i, :dim] for i in simplex)
        edges = np.stack([one - first for one in rest], axis=-1)
        volume = np.linalg.det(edges)
        sound = volume != 0.0
        share = np.linalg.solve(edges[sound], (x[node[sound], :dim] - first[sound])[..., None])[..., 0]
        low = np.minimum(share.min(axis=1), 1.0 - share.sum(axis=1))
        within[sound] |= low > -ROUNDED
    size = np.ptp(corners[within][:, :, :dim], axis=1).min(axis=1)
    return node[within].tolist(), other[within].tolist(), size.tolist()


def _depths(system: System, wanted: list[tuple[Floats, int]], places: Floats, body_of: Ints64) -> Floats:
    """How far [length] each of the places wanted is from the boundary of a body, by its corners. Collective."""
    space, dim = system.space, system.space.mesh.topology.dim
    cells, number = compat.cells_of_exterior_facets(space.mesh)
    dofs, corners = compat.cell_dofs(space), _cells(system).shape[1]
    out = np.full(len(wanted), np.inf)
    for facet in np.unique(number):
        local = compat.facet_closure_dofs(space, int(facet))
        local = local[local < corners]
        nodes = dofs[cells[number == facet]][:, local]
        parts = [nodes] if nodes.shape[1] == dim else [nodes[:, :3], nodes[:, 1:]]  # a quadrilateral as two triangles
        for part in parts:
            owner, points = body_of[part[:, 0]], places[part]
            for i, (place, body) in enumerate(wanted):
                out[i] = min(out[i], _distance(place, points[owner == body]))
    return np.min([out, *system.comm.allgather(out)], axis=0)


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
