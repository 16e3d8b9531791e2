"""Two separate blocks of structured hexahedra; faces named like lower_top, upper_bottom, upper_sides."""

import gmsh


def build(
    lower=(40.0, 40.0, 10.0),
    lower_cells=(16, 16, 4),
    lower_origin=(0.0, 0.0, -10.0),
    upper=(20.0, 20.0, 10.0),
    upper_cells=(10, 10, 4),
    upper_origin=(5.0, 10.0, 0.0),
):
    """Lengths, cells per edge and lowest corner of each block [all lengths in one unit]."""
    _block("lower", lower, lower_cells, lower_origin)
    _block("upper", upper, upper_cells, upper_origin)
    gmsh.model.mesh.generate(3)


def _block(name, size, cells, origin):
    base = gmsh.model.occ.addRectangle(*origin, size[0], size[1])
    out = gmsh.model.occ.extrude([(2, base)], 0, 0, size[2], numElements=[cells[2]], recombine=True)
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getBoundary([(2, base)], oriented=False):
        x0, _, _, x1, _, _ = gmsh.model.getBoundingBox(1, curve)
        gmsh.model.mesh.setTransfiniteCurve(curve, cells[0 if x1 - x0 > 0.5 * size[0] else 1] + 1)
    gmsh.model.mesh.setTransfiniteSurface(base)
    gmsh.model.mesh.setRecombine(2, base)
    # extrude gives the top, the volume, and the sides
    (_, top), (_, volume), *sides = out
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
    for face, tags in (("bottom", [base]), ("top", [top]), ("sides", [tag for _, tag in sides])):
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, tags), f"{name}_{face}")
