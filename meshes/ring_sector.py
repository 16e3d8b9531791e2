"""A quarter of a ring in the plane z = 0, x and y >= 0, its curves named inner, outer, xmin (x = 0) and ymin (y = 0)."""

import gmsh


def build(
    radii: tuple[float, float] = (1.0, 2.0),
    cells: tuple[int, int] = (4, 8),
    order: int = 1,
    triangles: bool = False,
    name: str = "ring",
    prefix: str = "",
) -> None:
    """radii: inner and outer [length]; cells: through the wall and around; order 2: with curved sides; prefix: of the names
    of its curves."""
    arc, line = gmsh.model.geo.addCircleArc, gmsh.model.geo.addLine
    centre = gmsh.model.geo.addPoint(0.0, 0.0, 0.0)
    right = [gmsh.model.geo.addPoint(r, 0.0, 0.0) for r in radii]
    top = [gmsh.model.geo.addPoint(0.0, r, 0.0) for r in radii]
    curves = {
        "ymin": line(right[0], right[1]),
        "outer": arc(right[1], centre, top[1]),
        "xmin": line(top[1], top[0]),
        "inner": arc(top[0], centre, right[0]),
    }
    surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(list(curves.values()))])
    for side, curve in curves.items():
        gmsh.model.geo.mesh.setTransfiniteCurve(curve, cells[0 if side.endswith("min") else 1] + 1)
    gmsh.model.geo.mesh.setTransfiniteSurface(surface)
    if not triangles:
        gmsh.model.geo.mesh.setRecombine(2, surface)
    gmsh.model.geo.synchronize()
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [surface]), name)
    for side, curve in curves.items():
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [curve]), f"{prefix}{side}")
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(order)
