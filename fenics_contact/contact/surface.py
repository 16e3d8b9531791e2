"""Slave points of a boundary group: nodes with tributary areas, corners or Gauss points of its facets."""

from dataclasses import dataclass
from typing import NamedTuple

import basix
import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.facet_points import ACROSS, RINGS, facet_points, geometry_degree
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.section import Section
from fenics_contact.contact.master import MasterSurface, area_vectors
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64, Mesh, Space

# Share of the normals around a node that is of one direction, whatever its sign: two facets at 60 degrees have 0.75
ALIKE = 0.75
DENSE = 9  # places per direction of a facet, which are no farther apart than a sixth of it

Means = tuple[Floats, Floats, Floats]  # of a facet, or over those around a node: stiffness, height, spacing


class Beside(NamedTuple):
    """Nodes off a slave surface: local numbers (n,), reference positions X (n, 3) [length], and which lie within their body
    and were outside the tool before anything moved: these no tool can reach but through the surface."""

    nodes: Ints64
    X: Floats
    inner: Bools


class Between(NamedTuple):
    """What lies between slave points that are nodes: facets' local nodes (nf, k), their reference positions X (nf, k, 3)
    [length], weights a (nf, nq, k) and gradients in places on them, as of SlaveSurface, and their shortest sides over the
    degree, spacing (nf,) [length]."""

    nodes: Ints
    X: Floats
    a: Floats
    gradients: Floats
    spacing: Floats

    def on_edges(self, slaves: Ints) -> Bools:
        """Which of the slave nodes (n,) have facets that stand across one another, by this rank's facets."""
        ways = np.einsum("ftk,fkc->ftc", self.gradients.mean(axis=1), self.X)
        normals = np.cross(ways[:, 0], ways[:, 1] if ways.shape[1] == 2 else np.array([0.0, 0.0, 1.0]))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        count = np.zeros(max(self.nodes.max(initial=-1), slaves.max(initial=-1)) + 1)
        spread = np.zeros((len(count), 3, 3))
        np.add.at(spread, self.nodes, np.einsum("fa,fb->fab", normals, normals)[:, None])
        np.add.at(count, self.nodes, 1.0)
        return np.linalg.eigvalsh(spread[slaves] / np.maximum(count[slaves], 1.0)[:, None, None])[:, -1] < ALIKE


class Dense(NamedTuple):
    """Close places on the facets of a slave surface: the facets' local nodes (nf, k), their reference positions X (nf, k, 3)
    [length], and kind (nf,): which of the m sets of places they have, with weights a (m, nq, k) and gradients as of
    SlaveSurface; spacing (nf,): of the slave points on them [length]."""

    nodes: Ints
    X: Floats
    kind: Ints64
    a: Floats
    gradients: Floats
    spacing: Floats


@dataclass
class SlaveSurface:
    """Slave points this rank evaluates, grouped into elements whose points move with the same nodes.

    nodes (ne, k) local node numbers; a (ne, nq, k) weights of the nodes in a point; area (ne, nq) tributary reference
    area [length^2]; X (ne, k, 3) reference positions [length]; stiffness (ne,): modulus of the body over the distance of
    nodes below each other [pressure/length]; height (ne,): of the cell beneath, that distance times the degree [length];
    spacing (ne,): shortest side of its facets over the points along it [length]; cell_height: largest height [length] over
    all ranks; key (ne,): the element's number on any number of ranks;
    cut_off (ne, nq): how far [length] a round surface that straight facets stand for lies outside the points, see `chords`.
    gradients (ne, nq, 2, k): derivatives of the facet's shape functions in the points, tangents t1 x t2 pointing out of
    the body; None for points that are nodes. corners: the points are corners of their facets; linear: they are the nodes at
    corners, between which pressures are linear at any degree; between: for points="nodes"; dense: places on its facets, much
    closer than the points.
    """

    nodes: Ints
    a: Floats
    area: Floats
    X: Floats
    stiffness: Floats
    height: Floats
    spacing: Floats
    cell_height: float
    key: Ints64
    cut_off: Floats
    dense: Dense
    gradients: Floats | None = None
    corners: bool = False
    linear: bool = False
    between: Between | None = None

    @property
    def at_nodes(self) -> bool:
        """Whether points are nodes, or the corners that nodes are in; else they are Gauss points."""
        return self.gradients is None or self.corners

    @property
    def count(self) -> int:
        """Number of slave points on this rank."""
        return self.area.size

    def points_at(self, u: Floats) -> Floats:
        """Where the points are (ne, nq, 3) with a displacement, a local array [length]."""
        return np.einsum("eqk,ekc->eqc", self.a, self.X + u.reshape(-1, 3)[self.nodes])


def slave_surface(
    space: Space, facets: Ints, modulus: Floats, points: int | str = "nodes", section: Section | None = None
) -> SlaveSurface:
    """Slave points on the exterior facets of a group.

    space: vector Lagrange space; facets: local facet numbers; modulus (cells,) [pressure]; points: "nodes"; "averages": the
    nodes at corners; "corners" of facets of degree 1: the nodes, each as often as facets meet there, with what these give to
    its tributary area; or the number of Gauss points per direction of a facet; section: what a plane mesh stands for.
    ValueError where nodes have no tributary area (quadratic triangles).
    """
    mesh = space.mesh
    cell = compat.cell_name(mesh)
    degree = compat.degree(space)
    cells, local = compat.cells_of_exterior_facets(mesh, facets)
    where = mesh, cell, degree, [cells[local == f] for f in range(compat.FACETS[cell])]
    nodes = np.concatenate(
        [compat.cell_dofs(space)[mine][:, compat.facet_closure_dofs(space, f)] for f, mine in enumerate(where[3])]
    )
    X = space.tabulate_dof_coordinates()
    order = 2 * degree if isinstance(points, str) else points
    a, gradients, area = facet_points(*where, order)
    of_facets = nodes
    if points == "averages" and degree > 1:
        a = facet_points(mesh, cell, 1, where[3], order)[0]
        nodes = nodes[:, : a.shape[2]]  # corners come first
    sides = area.sum(axis=1)
    if section is not None:
        area = area * section.depth(np.einsum("eqk,ekc->eqc", a, X[nodes]))
    if points == "corners":
        area = np.einsum("eq,eqk->ek", area, a)
        a, gradients, _ = facet_points(*where, None)
    owner = np.concatenate(where[3])
    key = compat.original_cells(mesh)[owner].astype(np.int64) * 6 + np.sort(local)
    # a sheared cell that widens away from its facet has more volume over it than the cell is high
    height = np.minimum(_cell_volumes(mesh)[owner] / np.maximum(sides, 1e-300), _opposite(mesh, cell, where[3]))
    stiffness = modulus[owner] * degree / height  # of the layer that a node moves: an element of degree 2 has two
    tallest = mesh.comm.allreduce(height.max(initial=0.0), op=MPI.MAX)
    spacing = _shortest_sides(mesh, cell, cells, local) / (degree if isinstance(points, str) else points)
    tangents: Floats | None = gradients
    means: Means = stiffness, height, spacing
    dense, between = _dense(where, of_facets, X, spacing), None
    if points == "nodes":  # an odd number has one in the middle
        between = Between(nodes, X[nodes], *facet_points(*where, 2 * degree + 1)[:2], spacing)
    if points in ("nodes", "averages"):
        tangents = None
        nodes, a, area, means = _gather_to_nodes(space, nodes, a, area, means)
        key = node_keys(space)[nodes[:, 0]]
    exact = degree == 1 and points in ("nodes", "corners")  # corners lie on the round surface
    cut_off = np.zeros(area.shape) if exact else _cut_off(space, facets, section, nodes, a, points != "averages")
    nodes = np.ascontiguousarray(nodes, dtype=np.int32)
    return SlaveSurface(
        nodes, np.ascontiguousarray(a), area, X[nodes], *means, tallest, key, cut_off, dense, tangents, points == "corners",
        points == "averages", between,
    )  # fmt: skip


def _dense(where: tuple[Mesh, str, int, list[Ints]], nodes: Ints, X: Floats, spacing: Floats) -> Dense:
    """Places on the facets that `facet_points` takes with `where`, of nodes (nf, k); X: positions of all nodes."""
    mesh, cell, degree, of_cell = where
    a, gradients, _ = facet_points(mesh, cell, degree, [mine[:1] for mine in of_cell], DENSE)
    numbers = [mine for mine in of_cell if len(mine)]
    kind = np.repeat(np.arange(len(numbers)), [len(mine) for mine in numbers])
    return Dense(nodes, X[nodes], kind, a, gradients, spacing)


def _cut_off(space: Space, facets: Ints, section: Section | None, nodes: Array, a: Floats, local: bool) -> Floats:
    """What facets cut off at points of weights a (ne, nq, k) of the nodes (ne, k): of degree 2 there if `local`, else means
    over the facets around the nodes. Collective."""
    skin = MasterSurface(space, facets, section, compat.degree(space) == 2)
    at = np.searchsorted(skin.moving, compat.global_blocks(space)[nodes])
    if local and skin.whole:
        return np.einsum("eqk,ek->eq", a, skin.arches[at])
    sums, count = np.zeros((2, len(skin.X)))
    np.add.at(sums, skin.facets[0], skin.cut_off[:, None])
    np.add.at(count, skin.facets[0], 1.0)
    return np.einsum("eqk,ek->eq", a, (sums / np.maximum(count, 1.0))[at])


def _shortest_sides(mesh: Mesh, cell: str, cells: Ints, local: Ints64) -> Floats:
    """Shortest side of each facet, facets in the order of their number in the cell."""
    dofs = compat.geometry_dofmap(mesh)
    sides = []
    for f, corners in enumerate(basix.topology(getattr(basix.CellType, cell))[mesh.topology.dim - 1]):
        ring = [corners[i] for i in RINGS[cell]]
        x = mesh.geometry.x[dofs[cells[local == f]]][:, ring]
        sides.append(np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).min(axis=1, initial=np.inf))
    return np.concatenate(sides)


def _opposite(mesh: Mesh, cell: str, cells: list[Ints]) -> Floats:
    """Distance of the corners that are not on a facet from its plane, their mean, facets as in `facet_points`."""
    dofs, kind, out = compat.geometry_dofmap(mesh), getattr(basix.CellType, cell), []
    for mine, corners in zip(cells, basix.topology(kind)[mesh.topology.dim - 1], strict=True):
        x = mesh.geometry.x[dofs[mine][:, : len(basix.geometry(kind))]]
        ring = x[:, [corners[i] for i in RINGS[cell]]]
        plane = mesh.topology.dim == 2
        normal = np.cross(ring[:, 1] - ring[:, 0], ACROSS) if plane else area_vectors(ring[:, [0, 1, 2, -1]])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        beyond = np.delete(x, corners, axis=1).mean(axis=1) - ring.mean(axis=1)
        out.append(np.abs(np.einsum("fc,fc->f", beyond, normal)))
    return np.concatenate(out)


def _cell_volumes(mesh: Mesh) -> Floats:
    """Volume of each local cell (owned and ghost)."""
    cell = compat.cell_name(mesh)
    s, w = basix.make_quadrature(getattr(basix.CellType, cell), 4)
    gradients = compat.tabulate(compat.basix_element(cell, geometry_degree(mesh)), 1, s)[1:]
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    return np.abs(np.linalg.det(np.einsum("rqd,cdx->cqrx", gradients, x[..., : mesh.topology.dim]))) @ w


def _gather_to_nodes(
    space: Space, nodes: Ints, a: Floats, area: Floats, means: Means
) -> tuple[Ints64, Floats, Floats, Means]:
    """Tributary areas of the owned nodes and area-weighted means of facet values, summed over the facets of all ranks."""
    share = np.einsum("eq,eqk->ek", area, a)
    facets = np.broadcast_to(area.sum(axis=1, keepdims=True), share.shape)
    tributary, around = _sum_at_nodes(space, nodes, share), _sum_at_nodes(space, nodes, facets)
    mine = np.flatnonzero(around > 0)
    tributary = tributary[mine]
    vanishing = bool(np.any(tributary < 1e-6 * around[mine]))
    if space.mesh.comm.allreduce(vanishing, op=MPI.MAX):
        raise ValueError(
            "corner nodes of quadratic triangles have no tributary area: use points=3 (Gauss points) for this contact"
        )
    first, second, third = (_sum_at_nodes(space, nodes, share * mean[:, None])[mine] / tributary for mean in means)
    return mine[:, None], np.ones((len(mine), 1, 1)), tributary[:, None], (first, second, third)


def _sum_at_nodes(space: Space, nodes: Ints, values: Floats) -> Floats:
    """Sum of values (ne, k) at the owned nodes over the elements of all ranks."""
    sums = compat.node_values(space)
    np.add.at(sums.array, nodes, values)
    compat.sum_to_owners(sums)
    return sums.array[: space.dofmap.index_map.size_local].copy()
