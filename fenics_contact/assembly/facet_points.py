"""Points on the exterior facets of a group: shape functions, their gradients and areas; and the skin made of them."""

from dataclasses import dataclass

import basix
import numpy as np

from fenics_contact import compat
from fenics_contact.types import Floats, Ints, Mesh, Space


@dataclass(frozen=True)
class Skin:
    """Exterior facets of owned cells, and Gauss points on them.

    cells (ne,): the local cells behind them; nodes (ne, k) local node numbers; corners (ne, 3 or 4): those of the corners,
    as a ring; N (ne, nq, k) shape functions in the points; slopes (ne, nq, 2, k): their derivatives along two tangents
    t1 x t2 that point outwards; area (ne, nq) reference areas of the points; X (ne, k, 3) reference positions [length].
    """

    cells: Ints
    nodes: Ints
    corners: Ints
    N: Floats
    slopes: Floats
    area: Floats
    X: Floats

    def current_area(self, x: Floats) -> Floats:
        """Areas (ne, nq) of the points where the nodes (ne, k, 3) are at x [length]."""
        return self.area * self._stretched(x) / self._stretched(self.X)

    def _stretched(self, x: Floats) -> Floats:
        first, second = np.einsum("eqtk,ekc->teqc", self.slopes, x)
        return np.linalg.norm(np.cross(first, second), axis=-1)


def skin_of(space: Space, facets: Ints) -> Skin:
    """The Skin of a vector Lagrange space's mesh on local facets."""
    mesh, degree = space.mesh, compat.degree(space)
    cell = compat.cell_name(mesh)
    cells, local = compat.cells_of_exterior_facets(mesh, facets)
    of_cell = [cells[local == f] for f in range(facets_per_cell(cell))]
    N, slopes, area = facet_points(mesh, cell, degree, of_cell, degree + 1)
    dofs, ring = compat.cell_dofs(space), [0, 1, 3, 2] if cell == "hexahedron" else [0, 1, 2]
    closures = [compat.facet_closure_dofs(space, f) for f in range(len(of_cell))]
    nodes = np.concatenate([dofs[mine][:, closure] for mine, closure in zip(of_cell, closures, strict=True)])
    corners = nodes[:, ring]  # a facet's corners come first, numbered like a grid
    return Skin(np.concatenate(of_cell), nodes, corners, N, slopes, area, space.tabulate_dof_coordinates()[nodes])


def facets_per_cell(cell: str) -> int:
    return {"hexahedron": 6, "tetrahedron": 4}[cell]


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


def geometry_degree(mesh: Mesh) -> int:
    count = compat.geometry_dofmap(mesh).shape[1]
    return 1 if count in (4, 8) else 2
