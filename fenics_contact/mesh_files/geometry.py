"""A geometry that gmsh reads and meshes with tetrahedra, or with triangles where it is plane."""

from pathlib import Path

import gmsh

GEOMETRIES = (".step", ".stp", ".brep", ".iges", ".igs", ".geo")
_KINDS = {3: "volume", 2: "surface", 1: "curve"}


def read_geometry(path: str, mesh_size: float | None = None) -> None:
    """Groups are those of the file, else each volume and surface by gmsh's number: volume_1, surface_1, surface_2, ..."""
    if mesh_size is None and Path(path).suffix.lower() != ".geo":  # that one may say it itself
        raise ValueError("it is a geometry without a mesh; state mesh_size=, the length of the cells' edges")
    gmsh.open(path)
    dim = 3 if gmsh.model.getEntities(3) else 2
    if not gmsh.model.getPhysicalGroups(dim):
        for d, entity in gmsh.model.getEntities():
            if d in (dim, dim - 1):
                gmsh.model.setPhysicalName(d, gmsh.model.addPhysicalGroup(d, [entity]), f"{_KINDS[d]}_{entity}")
    if mesh_size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMin", mesh_size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", mesh_size)
    for _, volume in gmsh.model.getEntities(3):
        gmsh.model.mesh.setOutwardOrientation(volume)  # of the facets, where it is a tool
    gmsh.model.mesh.generate(dim)
