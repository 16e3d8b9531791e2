"""A .vtu file, read by meshio: whole-numbered cell data say of what body a cell is, and a facet of what side."""

import numpy as np

from fenics_contact import packages
from fenics_contact.mesh_files.parts import SUPPORTED, TYPES, CellBlock, MeshParts, put

_DIMENSION = {"tetra": 3, "hexahedron": 3, "tetra10": 3, "triangle": 2, "quad": 2, "triangle6": 2, "line": 1, "line3": 1}


def read_vtu(path: str, bodies: str | None = None) -> None:
    """bodies: the cell data's name, by default the only whole-numbered ones; value 3 of `part` is called part_3."""
    meshio = packages.module("meshio")
    try:
        mesh = meshio.read(path)
    except SystemExit as error:  # meshio's way to say that it cannot read a file
        raise ValueError(
            "meshio cannot read it as a .vtu file; is it complete? Write it again, as an unstructured grid"
        ) from error
    known = [name for name, data in mesh.cell_data.items() if all(one.dtype.kind in "iu" and one.ndim == 1 for one in data)]
    if bodies not in known and (bodies is not None or len(known) != 1):
        raise ValueError(
            "name the whole-numbered cell data that say of what body a cell is, bodies='...'; it has: "
            f"{', '.join(known) or 'none'}"
        )
    name = bodies or known[0]
    for block in mesh.cells:
        if block.type not in (*_DIMENSION, "vertex"):
            raise ValueError(f"cells of type '{block.type}' are not supported; {SUPPORTED}")
    dim = max((_DIMENSION.get(block.type, 0) for block in mesh.cells), default=0)
    parts = MeshParts(dim, np.column_stack([mesh.points, np.zeros((len(mesh.points), 3 - mesh.points.shape[1]))]))
    first = 1
    for block, data in zip(mesh.cells, mesh.cell_data[name], strict=True):
        number, nodes = np.arange(first, first + len(data)), np.asarray(block.data, dtype=np.int64)
        first += len(data)
        if (own := _DIMENSION.get(block.type, 0)) >= max(dim - 1, 1):
            groups = parts.bodies if own == dim else parts.sides
            for value in np.unique(data):
                rows = CellBlock(TYPES[own, nodes.shape[1]], number, nodes).only(number[data == value])
                groups.setdefault(f"{name}_{value}", []).append(rows)
    put(parts)
