"""A scene's mesh as one VTK grid on rank 0, in an order that no partition changes, and what Functions are at its nodes."""

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.numbering import gather, node_keys
from fenics_contact.output.vtu import (
    HEXAHEDRON,
    HEXAHEDRON_27,
    QUADRILATERAL,
    QUADRILATERAL_9,
    TETRAHEDRON,
    TETRAHEDRON_10,
    TRIANGLE,
    TRIANGLE_6,
    GridFile,
)
from fenics_contact.scene.scene import Scene
from fenics_contact.types import Array, Floats, Function, Ints64, Space

TYPES = {
    "hexahedron": (HEXAHEDRON, HEXAHEDRON_27),
    "tetrahedron": (TETRAHEDRON, TETRAHEDRON_10),
    "quadrilateral": (QUADRILATERAL, QUADRILATERAL_9),
    "triangle": (TRIANGLE, TRIANGLE_6),
}
# Corners of VTK's cells, and of every further node of degree 2 the corners it lies between: of an edge, a face, the cell
CORNERS = {
    "hexahedron": "000 100 110 010 001 101 111 011",
    "tetrahedron": "000 100 010 001",
    "quadrilateral": "00 10 11 01",
    "triangle": "00 10 01",
}
BETWEEN = {
    "hexahedron": "01 12 23 03 45 56 67 47 04 15 26 37 0347 1256 0145 2367 0123 4567 01234567",
    "tetrahedron": "01 12 02 03 13 23",
    "quadrilateral": "01 12 23 03 0123",
    "triangle": "01 12 02",
}


class Grid:
    """All nodes of the displacement and all cells, in the order of the gmsh model's cells.

    On rank 0: points (n, 3) [length], reference places of the nodes; body (cells,), number of the body in its scene, -1 of
    none; file, with which data at the grid are written. None elsewhere.
    """

    def __init__(self, scene: Scene) -> None:
        """Collective."""
        mesh, space = scene.mesh.domain, scene.space
        self._comm, self._cell = mesh.comm, compat.cell_name(mesh)
        own = compat.original_cells(mesh)[: compat.cell_map(mesh).size_local]
        self._keys = {1: own}  # what orders the owned rows of a space, by its number of dofs in a cell
        corners = self._nodes_of_cells(compat.lagrange_space(mesh, 1, (3,)), 1)
        cells = corners if scene.degree == 1 else self._nodes_of_cells(space, scene.degree)
        self._nodal = _dofs(space)
        self.body = self._gathered(1, bodies_of_cells(scene))
        self.points = self._gathered(self._nodal, space.tabulate_dof_coordinates())
        self.file: GridFile | None = None
        self._between: list[tuple[Ints64, Ints64]] = []  # of degree 2: (nodes, corners they lie between), corners too
        if self.points is not None and cells is not None and corners is not None:
            types = np.full(len(cells), TYPES[self._cell][scene.degree - 1])
            self.file = GridFile(self.points, cells.ravel(), cells.shape[1] * np.arange(1, len(cells) + 1), types)
            for place, between in enumerate(_corners_of_nodes(self._cell, scene.degree) if scene.degree > 1 else []):
                nodes, first = np.unique(cells[:, place], return_index=True)
                self._between.append((nodes, corners[first][:, between]))

    def _gathered(self, dofs: int, values: Array) -> Array | None:
        """Rows of all ranks' owned nodes or cells on rank 0."""
        keys = self._keys[dofs]
        rows = gather(self._comm, keys, values[: len(keys)])
        return None if rows is None else rows[1]

    def _nodes_of_cells(self, space: Space, degree: int) -> Ints64 | None:
        """(cells, nodes) on rank 0, a cell's nodes as VTK orders them; a node's number is the place of its key."""
        keys, dofs = node_keys(space), compat.cell_dofs(space)
        self._keys[dofs.shape[1]] = keys[: space.dofmap.index_map.size_local]
        of_cells = self._gathered(1, keys[dofs])
        if of_cells is None:
            return None
        return np.unique(of_cells, return_inverse=True)[1].reshape(of_cells.shape)[:, _order(self._cell, degree)]

    def values(self, function: Function) -> Floats | None:
        """A Function at the nodes, or in the cells where it is constant there: (rows, components) on rank 0. Collective.

        Of degree 1 on cells of degree 2: a node between corners has their mean, which is NaN where one of them is.
        """
        dofs = _dofs(function.function_space)
        rows = self._gathered(dofs, function.x.array.reshape(-1, function.function_space.dofmap.index_map_bs))
        if rows is None or self.points is None or dofs in (1, self._nodal):
            return rows
        out = np.empty((len(self.points), rows.shape[1]))
        for nodes, corners in self._between:
            out[nodes] = rows[corners].mean(axis=1)
        return out


def per_cell(function: Function) -> bool:
    """Whether a Function has one value in every cell."""
    return _dofs(function.function_space) == 1


def _dofs(space: Space) -> int:
    """Nodes that a space has in a cell."""
    return compat.cell_dofs(space).shape[1]


def _corners_of_nodes(cell: str, degree: int) -> list[Ints64]:
    """Of every node of VTK's cell the corners between which it lies."""
    corners = [str(corner) for corner in range(len(CORNERS[cell].split()))]
    between = BETWEEN[cell].split() if degree == 2 else []
    return [np.array(list(map(int, node))) for node in [*corners, *between]]


def _order(cell: str, degree: int) -> Ints64:
    """Which node of dolfinx's cell each of VTK's is: that at the same place of the reference cell."""
    corners = np.array([list(map(float, corner)) for corner in CORNERS[cell].split()])
    places = np.array([corners[nodes].mean(axis=0) for nodes in _corners_of_nodes(cell, degree)])
    of_dofs = compat.basix_element(cell, degree).points
    return np.argmin(np.linalg.norm(places[:, None] - of_dofs, axis=2), axis=1)


def bodies_of_cells(scene: Scene) -> Ints64:
    """Number of its body for every local cell, -1 where it has none."""
    tags, index_map = scene.mesh.cell_tags, compat.cell_map(scene.mesh.domain)
    out = np.full(index_map.size_local + index_map.num_ghosts, -1, dtype=np.int64)
    for number, body in enumerate(scene.bodies):
        out[tags.indices[tags.values == scene.mesh.volume_tag(body.group)]] = number
    return out
