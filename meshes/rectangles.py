"""Rectangles in the plane z = 0, each a surface of its own name with its sides named NAME_xmin, _xmax, _ymin, _ymax."""

from collections.abc import Mapping

import gmsh

# name -> (lowest corner x, y, size x, y [length], cells along x, y)
Rectangle = tuple[tuple[float, float], tuple[float, float], tuple[int, int]]


def build(rectangles: Mapping[str, Rectangle], triangles: bool = False, order: int = 1) -> None:
    """Structured quadrilaterals, or triangles, of order 1 or 2; rectangles that touch do not share nodes.

    rectangles: {name: ((x, y) of the lowest corner, (width, height) [length], (cells along x, along y))}.
    """
    for name, ((x, y), (width, height), (across, up)) in rectangles.items():
        points = [
            gmsh.model.geo.addPoint(*p, 0.0) for p in ((x, y), (x + width, y), (x + width, y + height), (x, y + height))
        ]
        sides = [gmsh.model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(sides)])
        for side, cells in zip(sides, (across, up, across, up), strict=True):
            gmsh.model.geo.mesh.setTransfiniteCurve(side, cells + 1)
        gmsh.model.geo.mesh.setTransfiniteSurface(surface)
        if not triangles:
            gmsh.model.geo.mesh.setRecombine(2, surface)
        gmsh.model.geo.synchronize()
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [surface]), name)
        for side, end in zip(sides, ("ymin", "xmax", "ymax", "xmin"), strict=True):
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [side]), f"{name}_{end}")
    gmsh.model.mesh.generate(2)
    if order > 1:
        gmsh.model.mesh.setOrder(order)
