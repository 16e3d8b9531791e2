"""A file by its ending: into the current gmsh model."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from fenics_contact.mesh_files import abaqus, nastran
from fenics_contact.mesh_files.abaqus import read_inp
from fenics_contact.mesh_files.geometry import GEOMETRIES, read_geometry
from fenics_contact.mesh_files.nastran import read_bdf
from fenics_contact.mesh_files.stl import read_stl
from fenics_contact.mesh_files.vtu import read_vtu


def read_msh(path: str) -> None:
    """A mesh that gmsh has written; what is none, gmsh would take for a script of its own."""
    with open(path, "rb") as file:
        begins = file.read(200).lstrip()
    if not begins.startswith(b"$"):
        raise ValueError("it is no mesh that gmsh has written, for it does not begin with $MeshFormat; write it again")
    gmsh.open(path)


READERS: dict[str, Callable[..., Any]] = {
    ".msh": read_msh,
    ".inp": read_inp,
    ".bdf": read_bdf,
    ".nas": read_bdf,
    ".vtu": read_vtu,
    **dict.fromkeys(GEOMETRIES, read_geometry),
    ".stl": read_stl,
}
_SOLID = "for a body export a solid, a closed volume, and not its surfaces alone"
_REMEDY = {
    ".inp": abaqus.SOLIDS,
    **dict.fromkeys((".bdf", ".nas"), nastran.SOLIDS),
    ".vtu": "for a body write its tetrahedra or hexahedra, too",
    ".msh": "for a body mesh its volume with gmsh.model.mesh.generate(3) and write it in a named physical group",
    **dict.fromkeys((*GEOMETRIES, ".stl"), _SOLID),
}
_FLAT = 1e-9  # of a model's size: what is in the plane z = 0
TAKES = {"mesh_size": GEOMETRIES, "bodies": (".inp", ".vtu")}


def load(path: str, mesh_size: float | None = None, bodies: str | Sequence[str] | None = None, tool: bool = False) -> None:
    """A mesh file, or a geometry meshed with cells of `mesh_size` [length]; bodies: as read_inp and read_vtu take it; tool:
    facets or lines are enough.

    Raises ValueError for an ending that is not known, for what the file lacks, and for what its kind does not take.
    """
    suffix, stated = Path(path).suffix.lower(), {"mesh_size": mesh_size, "bodies": bodies}
    stated = {name: value for name, value in stated.items() if value is not None}
    if Path(path).is_dir():
        raise ValueError("it is a folder; give the path of a file")
    if not Path(path).is_file():
        raise ValueError("the file does not exist")
    if suffix not in READERS:
        known = ", ".join(one for one in READERS if one != ".stl")
        raise ValueError(f"files that end with '{suffix}' are not read; those that are: {known}, and .stl for a tool")
    for name in stated:
        if suffix not in TAKES[name]:
            raise ValueError(f"{name}= is for files that end with {', '.join(TAKES[name])}; leave it out")
    if mesh_size is not None and not mesh_size > 0.0:
        raise ValueError(f"mesh_size = {mesh_size} is no length of a cell's edges")
    if not Path(path).stat().st_size:
        raise ValueError("the file is empty; write it again")
    if suffix == ".inp":
        stated["tool"] = tool
    READERS[suffix](path, **stated)


def refuse_without_cells(path: str) -> None:
    """Of what was loaded for a body: there are cells of a volume, or of a plane mesh. ValueError says what there is."""
    suffix = Path(path).suffix.lower()
    dim = max((d for d in range(4) if len(gmsh.model.mesh.getElements(d)[0])), default=0)
    if dim == 3:
        return
    held = _held(suffix in GEOMETRIES)
    if dim < 2:
        raise ValueError(f"it holds {held or 'nothing that gmsh can read'}, and no cells; {_REMEDY[suffix]}")
    X = np.concatenate([gmsh.model.mesh.getNodes(2, entity, True)[1] for _, entity in gmsh.model.getEntities(2)])
    X = X.reshape(-1, 3)
    off = np.abs(X[:, 2]).max()
    if off > _FLAT * np.ptp(X, axis=0).max():
        raise ValueError(
            f"it holds {held}, and no cells of a volume; {_REMEDY[suffix]}; rigid_surface(path) makes a tool of surfaces; a "
            f"plane mesh lies in the plane z = 0, and a node of this has z = {off:.3g}"
        )


def _held(geometry: bool) -> str:
    """What the model holds: its volumes, surfaces, curves and points, or its elements by type."""
    if geometry:
        names = {3: "volumes", 2: "surfaces", 1: "curves", 0: "points"}
        return ", ".join(f"{len(found)} {name}" for d, name in names.items() if (found := gmsh.model.getEntities(d)))
    kinds, tags, _ = gmsh.model.mesh.getElements()
    names = {kind: gmsh.model.mesh.getElementProperties(kind)[0] for kind in kinds}
    return ", ".join(f"{len(some)} elements of type '{names[kind]}'" for kind, some in zip(kinds, tags, strict=True))
