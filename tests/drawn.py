"""Shapes of quadrilaterals in the plane that several tests draw, with gmsh."""

import math

import gmsh


def quadrilateral(name, corners, cells, sides):
    """Quadrilaterals between four corners (x, y), so many along the first and the second side, with a name for each side."""
    points = [gmsh.model.geo.addPoint(x, y, 0) for x, y in corners]
    lines = [gmsh.model.geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    for line, count in zip(lines, cells + cells, strict=True):
        gmsh.model.geo.mesh.setTransfiniteCurve(line, count + 1)
    _finish([surface], {name: (2, [surface])} | {side: (1, [line]) for line, side in zip(lines, sides, strict=True)})


def ring(name, middle, radii, cells, sides, turn=0.0, ends=None):
    """A whole ring about the height `middle` of the y axis; cells: through its wall and along each quarter, of which the
    first begins at the angle `turn`; sides: names of its inner and outer one; ends: of its half, that of both ends."""
    geo = gmsh.model.geo
    centre = geo.addPoint(0, middle, 0)
    c, s = math.cos(turn), math.sin(turn)
    ways, quarters = [(c, s), (-s, c), (-c, -s), (s, -c)][: 3 if ends else 4], range(2 if ends else 4)
    points = [[geo.addPoint(r * cos, middle + r * sin, 0) for cos, sin in ways] for r in radii]
    arcs = [[geo.addCircleArc(around[i], centre, around[(i + 1) % 4]) for i in quarters] for around in points]
    spokes = [geo.addLine(*ends) for ends in zip(*points, strict=True)]
    loops = [[spokes[i], arcs[1][i], -spokes[(i + 1) % 4], -arcs[0][i]] for i in quarters]
    faces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    for curves, count in zip((spokes, arcs[0] + arcs[1]), cells, strict=True):
        for curve in curves:
            geo.mesh.setTransfiniteCurve(curve, count + 1)
    groups = {name: (2, faces)} | {side: (1, around) for side, around in zip(sides, arcs, strict=True)}
    _finish(faces, groups | ({ends: (1, [spokes[0], spokes[2]])} if ends else {}))


def straight(name, start, end, cells):
    """A line of so many sides, named; a tool of it lies on the left on the way from start to end (x, y)."""
    line = gmsh.model.geo.addLine(*(gmsh.model.geo.addPoint(*place, 0) for place in (start, end)))
    gmsh.model.geo.mesh.setTransfiniteCurve(line, cells + 1)
    gmsh.model.geo.synchronize()
    gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [line]), name)
    gmsh.model.mesh.generate(1)


def _finish(faces, groups):
    """Fill what is drawn; groups: {name: (dimension, tags)}."""
    for face in faces:
        gmsh.model.geo.mesh.setTransfiniteSurface(face)
        gmsh.model.geo.mesh.setRecombine(2, face)
    gmsh.model.geo.synchronize()
    for name, (dim, tags) in groups.items():
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
    gmsh.model.mesh.generate(2)
