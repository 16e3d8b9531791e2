"""Points on the exterior facets of a group: shape functions, their gradients and areas; and the skin made of them."""

from dataclasses import dataclass
from functools import cached_property

import basix
import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.types import Floats, Ints, Mesh, Space

# a facet's corners one after the other around it; dolfinx numbers quadrilaterals like a grid
RINGS = {"hexahedron": [0, 1, 3, 2], "tetrahedron": [0, 1, 2], "quadrilateral": [0, 1], "triangle": [0, 1]}
MIDDLES = [4, 6, 7, 5]  # of the sides of a hexahedron's ring, at degree 2: sides are numbered like a grid, too
ACROSS = np.array([0.0, 0.0, 1.0])  # a plane mesh


@dataclass(frozen=True)
class Skin:
    """Exterior facets of owned cells, and Gauss points on them.

    cells (ne,): the local cells behind them; nodes (ne, k) local node numbers; corners (ne, 2, 3 or 4): those of the
    corners, as a ring; N (ne, nq, k) shape functions in the points, linear (ne, nq, c) those of corners, the first nodes, of
    degree 1; slopes (ne, nq, 2, k): their derivatives along two
    tangents t1 x t2 that point outwards; area (ne, nq) reference areas of the points; X (ne, k, 3) reference positions
    [length]; section: what the sides of a plane mesh, with one tangent, stand for.
    """

    cells: Ints
    nodes: Ints
    corners: Ints
    N: Floats
    linear: Floats
    slopes: Floats
    area: Floats
    X: Floats
    section: Section | None = None

    def current_area(self, x: Floats) -> Floats:
        """Areas (ne, nq) of the points where the nodes (ne, k, 3) are at x [length]."""
        return self.weights * np.linalg.norm(np.cross(*self.tangents(x)), axis=-1)

    @cached_property
    def weights(self) -> Floats:
        """(ne, nq): quadrature weights of the cross product of the tangents."""
        return self.area / np.linalg.norm(np.cross(*self.tangents(self.X)), axis=-1)

    def tangents(self, x: Floats) -> tuple[Floats, Floats]:
        """Tangents (ne, nq, 3) in the points where the nodes (ne, k, 3) are at x; the second one across a plane, as long as
        the bodies are deep."""
        if self.section is None:
            first, second = np.einsum("eqtk,ekc->teqc", self.slopes, x)
            return first, second
        depth = self.section.depth(np.einsum("eqk,ekc->eqc", self.N, x))
        return np.einsum("eqk,ekc->eqc", self.slopes[:, :, 0], x), depth[..., None] * ACROSS


def skin_of(space: Space, facets: Ints, section: Section | None = None) -> Skin:
    """The Skin of a vector Lagrange space's mesh on local facets; section: what a plane mesh stands for."""
    mesh, degree = space.mesh, compat.degree(space)
    cell = compat.cell_name(mesh)
    cells, local = compat.cells_of_exterior_facets(mesh, facets)
    of_cell = [cells[local == f] for f in range(compat.FACETS[cell])]
    N, slopes, area = facet_points(mesh, cell, degree, of_cell, degree + 1)
    linear = facet_points(mesh, cell, 1, of_cell, degree + 1)[0]
    dofs, ring = compat.cell_dofs(space), RINGS[cell]
    closures = [compat.facet_closure_dofs(space, f) for f in range(len(of_cell))]
    nodes = np.concatenate([dofs[mine][:, closure] for mine, closure in zip(of_cell, closures, strict=True)])
    corners = nodes[:, ring]  # a facet's corners come first, numbered like a grid
    X = space.tabulate_dof_coordinates()[nodes]
    area = area if section is None else area * section.depth(np.einsum("eqk,ekc->eqc", N, X))
    return Skin(np.concatenate(of_cell), nodes, corners, N, linear, slopes, area, X, section)


def skin_of_means(space: Space, facets: Ints, section: Section | None = None) -> Skin:
    """The Skin over whose area means are taken; on the axis of turning, where it has none, over lengths. Collective."""
    skin = skin_of(space, facets, section)
    if section is None or not section.axisymmetric:
        return skin
    here = np.abs(skin.X[..., 0]).max(initial=0.0), np.abs(space.mesh.geometry.x).max(initial=0.0)
    farthest, size = np.max(space.mesh.comm.allgather(here), axis=0)
    return skin_of(space, facets) if farthest <= ON_AXIS * size else skin


def facet_points(mesh: Mesh, cell: str, degree: int, cells: list[Ints], order: int | None) -> tuple[Floats, Floats, Floats]:
    """Weights (ne, nq, k) of the facets' nodes in their points, gradients (ne, nq, 2, k), areas (ne, nq) [length^2].

    cells: for each number of a facet in its cell, the cells whose facet has it; order as in _facet_quadrature.
    """
    found = [_facet_quadrature(mesh, cell, degree, order, mine, f) for f, mine in enumerate(cells)]
    a, gradients = (
        np.concatenate([np.broadcast_to(part[i], (len(part[2]), *part[i].shape)) for part in found]) for i in (0, 1)
    )
    return a, gradients, np.concatenate([area for _, _, area in found])


def _facet_quadrature(
    mesh: Mesh, cell: str, degree: int, order: int | None, cells: Ints, facet: int
) -> tuple[Floats, Floats, Floats]:
    """Weights of the facet's nodes in its points (nq, k), their gradients (nq, 2, k) along two tangents whose cross
    product points outwards, and the points' reference areas (ncells, nq).

    order: Gauss points per direction, or None for the facet's corners, in the order of its nodes and with weight 1.
    """
    kind = getattr(basix.CellType, cell)
    if mesh.topology.dim == 2:
        return _side_quadrature(mesh, cell, degree, order, cells, facet)
    corners = basix.geometry(kind)[basix.topology(kind)[2][facet]]
    flat = basix.CellType.quadrilateral if len(corners) == 4 else basix.CellType.triangle
    s, w = (basix.geometry(flat), 1.0) if order is None else basix.make_quadrature(flat, 2 * order - 1)
    edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]])
    if np.cross(*edges) @ (corners.mean(axis=0) - basix.geometry(kind).mean(axis=0)) < 0.0:
        edges, s = edges[::-1], s[:, ::-1]
    reference = corners[0] + s @ edges

    element = compat.basix_element(cell, degree)
    closure = element.entity_closure_dofs[2][facet]
    table = compat.tabulate(element, 1, reference)[..., closure]
    slopes = np.einsum("tr,rqk->qtk", edges, table[1:])

    coordinate = compat.basix_element(cell, geometry_degree(mesh))
    gradients = compat.tabulate(coordinate, 1, reference)[1:]
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)[cells]]
    tangents = np.einsum("tr,rqd,cdx->tcqx", edges, gradients, x)
    return table[0], slopes, np.linalg.norm(np.cross(tangents[0], tangents[1]), axis=-1) * w


def _side_quadrature(
    mesh: Mesh, cell: str, degree: int, order: int | None, cells: Ints, facet: int
) -> tuple[Floats, Floats, Floats]:
    """The same of a side of plane cells, with lengths in the place of areas, and one tangent (nq, 1, k) that has the outside
    on its right."""
    kind = getattr(basix.CellType, cell)
    ends = basix.geometry(kind)[basix.topology(kind)[1][facet]]
    s, w = (
        (np.array([[0.0], [1.0]]), 1.0) if order is None else basix.make_quadrature(basix.CellType.interval, 2 * order - 1)
    )
    side, out = ends[1] - ends[0], ends.mean(axis=0) - basix.geometry(kind).mean(axis=0)
    reference = ends[0] + s * side
    element = compat.basix_element(cell, degree)
    table = compat.tabulate(element, 1, reference)[..., element.entity_closure_dofs[1][facet]]
    gradients = compat.tabulate(compat.basix_element(cell, geometry_degree(mesh)), 1, reference)[1:]
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)[cells]]
    tangents = np.einsum("r,rqd,cdx->cqx", side, gradients, x)
    way = side if side[1] * out[0] - side[0] * out[1] > 0.0 else -side  # the body is on its left
    return table[0], np.einsum("r,rqk->qk", way, table[1:])[:, None], np.linalg.norm(tangents, axis=-1) * w


def geometry_degree(mesh: Mesh) -> int:
    corners = len(basix.geometry(getattr(basix.CellType, compat.cell_name(mesh))))
    return 1 if compat.geometry_dofmap(mesh).shape[1] == corners else 2
