"""A block of structured hexahedra with its six faces named xmin, xmax, ymin, ymax, zmin, zmax."""

import gmsh


def build(
    size: tuple[float, float, float] = (1.0, 1.0, 1.0),
    cells: tuple[int, int, int] = (1, 1, 1),
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    name: str = "box",
) -> None:
    """Lengths `size`, `cells` per edge, lowest corner `origin` [all lengths in one unit]."""
    x, y, z = origin
    base = gmsh.model.occ.addRectangle(x, y, z, size[0], size[1])
    out = gmsh.model.occ.extrude([(2, base)], 0, 0, size[2], numElements=[cells[2]], recombine=True)
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getEntities(1):
        x0, _, z0, x1, _, z1 = gmsh.model.getBoundingBox(1, curve)
        if z1 - z0 < 0.5 * size[2]:
            along_x = x1 - x0 > 0.5 * size[0]
            gmsh.model.mesh.setTransfiniteCurve(curve, cells[0 if along_x else 1] + 1)
    gmsh.model.mesh.setTransfiniteSurface(base)
    gmsh.model.mesh.setRecombine(2, base)
    gmsh.model.mesh.generate(3)

    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for dim, tag in out if dim == 3]), name)
    for _, face in gmsh.model.getEntities(2):
        centre = gmsh.model.occ.getCenterOfMass(2, face)
        for axis, letter in enumerate("xyz"):
            for end, corner in (("min", origin[axis]), ("max", origin[axis] + size[axis])):
                if abs(centre[axis] - corner) < 1e-9 * size[axis]:
                    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), letter + end)
