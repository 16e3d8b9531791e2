"""A whole cylinder along z: hexahedra in a core and four blocks around it, its ends named bottom and top."""

import math

import gmsh


def build(radius: float = 10.0, height: float = 4.0, cells: int = 4, layers: int = 4) -> None:
    """Cylinder of `radius`, 0 <= z <= height [length]; cells: along each side of the five blocks, layers: along z."""
    geo = gmsh.model.geo
    centre = geo.addPoint(0, 0, 0)
    inner, outer = (
        [geo.addPoint(r * math.cos(a), r * math.sin(a), 0) for a in (math.pi / 4 * (2 * i + 1) for i in range(4))]
        for r in (0.5 * radius, radius)
    )
    core = [geo.addLine(inner[i], inner[(i + 1) % 4]) for i in range(4)]
    spokes = [geo.addLine(inner[i], outer[i]) for i in range(4)]
    arcs = [geo.addCircleArc(outer[i], centre, outer[(i + 1) % 4]) for i in range(4)]
    loops = [core, *([spokes[i], arcs[i], -spokes[(i + 1) % 4], -core[i]] for i in range(4))]
    faces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    for curve in (*core, *spokes, *arcs):
        geo.mesh.setTransfiniteCurve(curve, cells + 1)
    for face in faces:
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    out = geo.extrude([(2, face) for face in faces], 0, 0, height, [layers], recombine=True)
    geo.synchronize()
    ends = {p for _, curve in gmsh.model.getEntities(1) for _, p in gmsh.model.getBoundary([(1, curve)], oriented=False)}
    # the arcs' centres would be nodes of no cell
    gmsh.model.removeEntities([(0, p) for _, p in gmsh.model.getEntities(0) if p not in ends])
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for dim, tag in out if dim == 3]), "rod")
    for name, z in (("bottom", 0.0), ("top", height)):
        boxes = {face: gmsh.model.getBoundingBox(2, face) for _, face in gmsh.model.getEntities(2)}
        flat = [face for face, box in boxes.items() if max(abs(box[2] - z), abs(box[5] - z)) < 1e-4 * radius]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, flat), name)
