"""Upper half of an O-ring's cross-section, a slice one layer deep along y: hexahedra in six blocks."""

import math

import gmsh


def build(radius: float = 1.5, depth: float = 0.1, cells: int = 8) -> None:
    """Half disc z >= 0 of `radius`, 0 <= y <= depth [lengths]; cells: along each side of the six blocks.

    Surfaces: symmetry_z (z = 0), ends (y = 0, depth), rim, and of the rim `wet`, the part x < 0 below 45 degrees.
    """
    geo, half, inner = gmsh.model.geo, radius * math.sqrt(0.5), 0.42 * radius
    middle, top, crown = (geo.addPoint(0, 0, z) for z in (0.0, 0.5 * radius, radius))
    spine, spoke = geo.addLine(middle, top), geo.addLine(top, crown)
    faces, curves = [], [spine, spoke]
    for side in (1, -1):
        spots = ((0.5 * radius, 0), (inner, inner), (radius, 0), (half, half))
        a, b, e, f = (geo.addPoint(side * x, 0, z) for x, z in spots)
        base, up, over, low, slant = (geo.addLine(*ends) for ends in ((middle, a), (a, b), (b, top), (a, e), (b, f)))
        arcs = geo.addCircleArc(e, middle, f), geo.addCircleArc(f, middle, crown)
        loops = [[base, up, over, -spine], [low, arcs[0], -slant, -up], [slant, arcs[1], -spoke, -over]]
        faces += [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
        curves += [base, up, over, low, slant, *arcs]
    for curve in curves:
        geo.mesh.setTransfiniteCurve(curve, cells + 1)
    for face in faces:
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    out = geo.extrude([(2, face) for face in faces], 0, depth, 0, [1], recombine=True)
    geo.synchronize()
    gmsh.model.mesh.generate(3)

    volumes = [tag for dim, tag in out if dim == 3]
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, volumes), "ring")
    groups: dict[str, list[int]] = {"symmetry_z": [], "ends": [], "rim": [], "wet": []}
    for dim, face in gmsh.model.getBoundary([(3, v) for v in volumes], oriented=False):
        x0, y0, z0, x1, y1, z1 = gmsh.model.getBoundingBox(dim, face)
        if z1 - z0 < 0.01 * radius:
            groups["symmetry_z"].append(face)
        elif y1 - y0 < 0.5 * depth:
            groups["ends"].append(face)
        else:
            groups["rim"].append(face)
            if z0 < 0.5 * half and x1 < 0.0:
                groups["wet"].append(face)
    for name, tags in groups.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, tags), name)
