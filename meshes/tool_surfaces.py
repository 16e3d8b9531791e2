"""Surfaces of rigid tools, without volumes: a ball's lower half and a square punch's rounded face, facets looking out."""

import math
from collections.abc import Callable

import gmsh


def ball(
    radius: float = 10.0,
    centre: tuple[float, float, float] = (0.0, 0.0, 10.0),
    mesh_size: float = 1.0,
    quadrilaterals: bool = False,
    reach: float = 0.5,
) -> None:
    """The part of a ball around its lowest point out to `reach` times its radius [lengths], facets of `mesh_size`."""
    occ = gmsh.model.occ
    solid = occ.addSphere(*centre, radius)
    floor = centre[2] - radius
    top = floor + radius * (1 - math.sqrt(1 - reach**2))
    box = occ.addBox(centre[0] - radius, centre[1] - radius, floor - radius, 2 * radius, 2 * radius, top - floor + radius)
    occ.intersect([(3, solid)], [(3, box)])
    _mesh_outwards(mesh_size, quadrilaterals)
    _name("ball", lambda x: x[2] < top - 1e-6 * radius)


def punch(
    half_width: float = 10.0,
    height: float = 10.0,
    face: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fillet: float = 2.0,
    mesh_size: float = 1.0,
    quadrilaterals: bool = False,
) -> None:
    """Square punch above `face`, the centre of its flat face, all edges rounded [lengths], facets of `mesh_size`."""
    occ = gmsh.model.occ
    x, y, z = face
    solid = occ.addBox(x - half_width, y - half_width, z, 2 * half_width, 2 * half_width, height)
    occ.synchronize()
    occ.fillet([solid], [tag for _, tag in gmsh.model.getEntities(1)], [fillet])
    _mesh_outwards(mesh_size, quadrilaterals)
    _name("punch", lambda x: True)


def _mesh_outwards(mesh_size: float, quadrilaterals: bool) -> None:
    gmsh.model.occ.synchronize()
    for _, volume in gmsh.model.getEntities(3):
        gmsh.model.mesh.setOutwardOrientation(volume)
    gmsh.option.setNumber("Mesh.MeshSizeMin", mesh_size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", mesh_size)
    if quadrilaterals:
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
    gmsh.model.mesh.generate(2)


def _name(name: str, chosen: Callable[[tuple[float, float, float]], bool]) -> None:
    """Group of the surfaces whose centre is chosen."""
    faces = [tag for _, tag in gmsh.model.getEntities(2) if chosen(gmsh.model.occ.getCenterOfMass(2, tag))]
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)
