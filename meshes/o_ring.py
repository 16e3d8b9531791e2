"""Upper half of an O-ring's cross-section in the plane z = 0: quadrilaterals in six blocks."""

import math

import gmsh


def build(radius: float = 1.5, centre: float = 0.0, cells: int = 8) -> None:
    """Half disc y >= 0 of `radius` about (centre, 0) [lengths]; cells: along each side of the six blocks.

    Curves: symmetry_y (y = 0), rim, and of the rim `wet`, the part x < centre below 45 degrees.
    """
    geo, half, inner = gmsh.model.geo, radius * math.sqrt(0.5), 0.42 * radius
    middle, top, crown = (geo.addPoint(centre, y, 0) for y in (0.0, 0.5 * radius, radius))
    spine, spoke = geo.addLine(middle, top), geo.addLine(top, crown)
    curves, loops = [spine, spoke], []
    groups: dict[str, list[int]] = {"symmetry_y": [], "rim": [], "wet": []}
    for side in (1, -1):
        spots = ((0.5 * radius, 0), (inner, inner), (radius, 0), (half, half))
        a, b, e, f = (geo.addPoint(centre + side * x, y, 0) for x, y in spots)
        base, up, over, low, slant = (geo.addLine(*ends) for ends in ((middle, a), (a, b), (b, top), (a, e), (b, f)))
        arcs = geo.addCircleArc(e, middle, f), geo.addCircleArc(f, middle, crown)
        loops += [[base, up, over, -spine], [low, arcs[0], -slant, -up], [slant, arcs[1], -spoke, -over]]
        curves += [base, up, over, low, slant, *arcs]
        groups["symmetry_y"] += [base, low]
        groups["rim"] += arcs
    groups["wet"] = [arcs[0]]  # of the left side
    faces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    for curve in curves:
        geo.mesh.setTransfiniteCurve(curve, cells + 1)
    for face in faces:
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    geo.synchronize()
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), "ring")
    for name, tags in groups.items():
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, tags), name)
    gmsh.model.mesh.generate(2)
