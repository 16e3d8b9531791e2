"""A file by its ending: into the current gmsh model."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gmsh

from fenics_contact.mesh_files.abaqus import read_inp
from fenics_contact.mesh_files.geometry import GEOMETRIES, read_geometry
from fenics_contact.mesh_files.nastran import read_bdf
from fenics_contact.mesh_files.vtu import read_vtu

READERS: dict[str, Callable[..., Any]] = {
    ".msh": gmsh.open,
    ".inp": read_inp,
    ".bdf": read_bdf,
    ".nas": read_bdf,
    ".vtu": read_vtu,
    **dict.fromkeys(GEOMETRIES, read_geometry),
    ".stl": gmsh.open,
}
TAKES = {"size": GEOMETRIES, "bodies": (".inp", ".vtu")}


def load(path: str, size: float | None = None, bodies: str | Sequence[str] | None = None) -> None:
    """A mesh file, or a geometry meshed with cells of `size` [length]; bodies: as read_inp and read_vtu take it.

    Raises ValueError for an ending that is not known, for what the file lacks, and for what its kind does not take.
    """
    suffix, stated = Path(path).suffix.lower(), {"size": size, "bodies": bodies}
    stated = {name: value for name, value in stated.items() if value is not None}
    if not Path(path).is_file():
        raise ValueError("the file does not exist")
    if suffix not in READERS:
        raise ValueError(f"files that end with '{suffix}' are not read; those that are: {', '.join(READERS)}")
    for name in stated:
        if suffix not in TAKES[name]:
            raise ValueError(f"{name}= is for files that end with {', '.join(TAKES[name])}; leave it out")
    if size is not None and not size > 0.0:
        raise ValueError(f"size = {size} is no length of a cell's edges")
    if not Path(path).stat().st_size:
        raise ValueError("the file is empty; write it again")
    READERS[suffix](path, **stated)
