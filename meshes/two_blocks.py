"""Two separate blocks of structured hexahedra; faces named lower_top, upper_bottom, lower_xmin, upper_ymax, ..."""

import gmsh


def build(
    lower: tuple[float, float, float] = (40.0, 40.0, 10.0),
    lower_cells: tuple[int, int, int] = (16, 16, 4),
    lower_origin: tuple[float, float, float] = (0.0, 0.0, -10.0),
    upper: tuple[float, float, float] = (20.0, 20.0, 10.0),
    upper_cells: tuple[int, int, int] = (10, 10, 4),
    upper_origin: tuple[float, float, float] = (5.0, 10.0, 0.0),
) -> None:
    """Lengths, cells per edge and lowest corner of each block [all lengths in one unit]."""
    # gmsh lets a face inherit the mesh of another in the same place: mesh the blocks apart, then bring them together
    apart = 2.0 * (lower[2] + upper[2])
    _block("lower", lower, lower_cells, lower_origin)
    drawn = set(gmsh.model.getEntities())
    x, y, z = upper_origin
    _block("upper", upper, upper_cells, (x, y, z + apart))
    gmsh.model.mesh.generate(3)
    for entity in gmsh.model.getEntities():
        if entity not in drawn:
            tags, places, _ = gmsh.model.mesh.getNodes(*entity)
            for tag, place in zip(tags, places.reshape(-1, 3), strict=True):
                gmsh.model.mesh.setNode(tag, place - [0.0, 0.0, apart], [])


def _block(
    name: str, size: tuple[float, float, float], cells: tuple[int, int, int], origin: tuple[float, float, float]
) -> None:
    base = gmsh.model.occ.addRectangle(*origin, size[0], size[1])
    out = gmsh.model.occ.extrude([(2, base)], 0, 0, size[2], numElements=[cells[2]], recombine=True)
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getBoundary([(2, base)], oriented=False):
        x0, _, _, x1, _, _ = gmsh.model.getBoundingBox(1, curve)
        gmsh.model.mesh.setTransfiniteCurve(curve, cells[0 if x1 - x0 > 0.5 * size[0] else 1] + 1)
    gmsh.model.mesh.setTransfiniteSurface(base)
    gmsh.model.mesh.setRecombine(2, base)
    (_, top), (_, volume), *sides = out  # what extrude returns: the top, the volume, and the sides
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
    names = {base: "bottom", top: "top"}
    for _, side in sides:
        centre = gmsh.model.occ.getCenterOfMass(2, side)
        axis = 0 if abs(abs(centre[0] - origin[0] - size[0] / 2) - size[0] / 2) < 1e-9 * size[0] else 1
        names[side] = "xy"[axis] + ("min" if centre[axis] < origin[axis] + size[axis] / 2 else "max")
    for face, label in names.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), f"{name}_{label}")
