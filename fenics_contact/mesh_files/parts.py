"""What a mesh file holds once it is read: cells of bodies, their facets and points by name; handed over to gmsh."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import gmsh
import numpy as np

from fenics_contact.meetings import key
from fenics_contact.types import Floats, Ints64

# gmsh's number of a type of elements, by its dimension and its number of nodes
TYPES = {(3, 4): 4, (3, 8): 5, (3, 10): 11, (2, 3): 2, (2, 4): 3, (2, 6): 9, (1, 2): 1, (1, 3): 8}
CURVED = (9, 11)
SUPPORTED = "write hexahedra of 8 nodes, tetrahedra of 4 or 10, in a plane quadrilaterals of 4 or triangles of 3 or 6"
_CORNERS = {4: 4, 5: 8, 11: 4, 2: 3, 3: 4, 9: 3, 1: 2, 8: 2}
_POINT = 15
# Faces that Abaqus calls S1, S2, ..., by gmsh's type of the cell: rows of its nodes, counter-clockwise seen from outside,
# and after them the nodes of its edges
_FACES: dict[int, list[tuple[int, ...]]] = {
    4: [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
    11: [(0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9)],
    5: [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
    2: [(0, 1), (1, 2), (2, 0)],
    3: [(0, 1), (1, 2), (2, 3), (3, 0)],
    9: [(0, 1, 3), (1, 2, 4), (2, 0, 5)],
}
# the nodes of a facet that looks the other way
_TURNED = {2: [0, 2, 1], 3: [0, 3, 2, 1], 9: [0, 2, 1, 5, 4, 3], 1: [1, 0], 8: [1, 0, 2]}
_GMSH_ORDER = {11: [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]}  # elsewhere the last two nodes are the other way round


@dataclass(frozen=True)
class CellBlock:
    """Elements of one type: kind, gmsh's number of it; number (n,) in the file; nodes (n, k), rows of X, in the order of
    Abaqus and VTK."""

    kind: int
    number: Ints64
    nodes: Ints64

    def only(self, numbers: Ints64) -> "CellBlock":
        chosen = np.isin(self.number, numbers)
        return CellBlock(self.kind, self.number[chosen], self.nodes[chosen])

    def faces(self) -> list["CellBlock"]:
        """The first face of each, the second, ..."""
        dim = next(dim for (dim, _), kind in TYPES.items() if kind == self.kind)
        return [CellBlock(TYPES[dim - 1, len(face)], self.number, self.nodes[:, list(face)]) for face in _FACES[self.kind]]

    def turned(self) -> "CellBlock":
        """Facets that look the other way."""
        return CellBlock(self.kind, self.number, self.nodes[:, _TURNED[self.kind]])

    def keys(self) -> Ints64:
        """A number for each element, the same for the same corners."""
        return key(self.nodes[:, : _CORNERS[self.kind]])

    def __len__(self) -> int:
        return len(self.number)


@dataclass
class MeshParts:
    """dim: of the cells; X (n, 3); by name: blocks of cells of the bodies, of facets, and nodes (n,)."""

    dim: int
    X: Floats
    bodies: dict[str, list[CellBlock]] = field(default_factory=dict)
    sides: dict[str, list[CellBlock]] = field(default_factory=dict)
    points: dict[str, Ints64] = field(default_factory=dict)


def put(parts: MeshParts) -> None:
    """Discrete entities in gmsh, one for each body, each side and each set of points; cells keep the file's numbers."""
    model, dim = gmsh.model, parts.dim
    gathered = [(dim, name, blocks) for name, blocks in parts.bodies.items()]
    gathered += [(dim - 1, name, blocks) for name, blocks in parts.sides.items()]
    gathered += [(0, name, [CellBlock(_POINT, nodes, nodes[:, None])]) for name, nodes in parts.points.items()]
    for at, (d, name, blocks) in enumerate(gathered):
        entity = model.addDiscreteEntity(d)
        if at == 0:
            model.mesh.addNodes(d, entity, np.arange(1, len(parts.X) + 1), parts.X.ravel())
        for block in blocks:
            nodes = block.nodes[:, _GMSH_ORDER.get(block.kind, slice(None))] + 1
            model.mesh.addElementsByType(entity, block.kind, block.number if d == dim else [], nodes.ravel())
        model.setPhysicalName(d, model.addPhysicalGroup(d, [entity]), name)


def nodes_of(blocks: Iterable[CellBlock]) -> Ints64:
    """Nodes (n,) of blocks, each once."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(block.nodes.ravel() for block in blocks)]))


def chosen(blocks: Iterable[CellBlock], numbers: Ints64) -> list[CellBlock]:
    """The elements with these numbers, without blocks that have none."""
    return [some for block in blocks if len(some := block.only(numbers))]


def outer(cells: list[CellBlock], numbers: Ints64 | None = None) -> list[CellBlock]:
    """Faces that one cell alone has; of the cells with these numbers."""
    faces = [face for block in cells for face in block.faces()]
    known, count = np.unique(np.concatenate([face.keys() for face in faces]), return_counts=True)
    alone = [face.only(face.number[np.isin(face.keys(), known[count == 1])]) for face in faces]
    return alone if numbers is None else chosen(alone, numbers)


def joined(blocks: list[CellBlock]) -> list[CellBlock]:
    """Blocks of a type as one, each facet once."""
    found = []
    for kind in dict.fromkeys(block.kind for block in blocks):
        nodes = np.concatenate([block.nodes for block in blocks if block.kind == kind])
        whole = CellBlock(kind, np.arange(len(nodes)), nodes)
        found.append(whole.only(np.unique(whole.keys(), return_index=True)[1]))
    return found
