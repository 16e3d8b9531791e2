"""Quarter of a cylinder lying along y, hexahedra in three blocks, one layer deep unless asked otherwise; or a plane mesh."""

import math

import gmsh


def build(radius: float = 20.0, depth: float | None = 1.0, cells: int = 8, layers: int = 1) -> None:
    """Quarter disc x, z >= 0 of `radius`, 0 <= y <= depth [length]; cells: along each side of the three blocks.

    Surfaces: symmetry_x (x = 0), symmetry_z (z = 0), front, back (y = 0, depth) and rim. depth None: the quarter x, y >= 0
    of the plane z = 0 alone, its curves symmetry_x, symmetry_y (y = 0) and rim.
    """
    geo, half, inner = gmsh.model.geo, radius * math.sqrt(0.5), 0.42 * radius
    spots = [(0, 0), (0.5 * radius, 0), (inner, inner), (0, 0.5 * radius), (radius, 0), (half, half), (0, radius)]
    o, a, b, c, e, f, g = (geo.addPoint(x, 0, z) if depth else geo.addPoint(x, z, 0) for x, z in spots)
    square = [geo.addLine(*ends) for ends in ((o, a), (a, b), (b, c), (c, o))]
    spokes = [geo.addLine(*ends) for ends in ((a, e), (b, f), (c, g))]
    arcs = [geo.addCircleArc(e, o, f), geo.addCircleArc(f, o, g)]
    loops = [
        square,
        [spokes[0], arcs[0], -spokes[1], -square[1]],
        [spokes[1], arcs[1], -spokes[2], -square[2]],
    ]
    faces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    for curve in (*square, *spokes, *arcs):
        geo.mesh.setTransfiniteCurve(curve, cells + 1)
    for face in faces:
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    parts = [(2, face) for face in faces]
    if depth:
        parts = [p for p in geo.extrude(parts, 0, depth, 0, [layers], recombine=True) if p[0] == 3]
    dim = parts[0][0]
    geo.synchronize()
    gmsh.model.mesh.generate(dim)

    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag for _, tag in parts]), "disc")
    places = {"symmetry_x": (0, 0.0), "symmetry_y": (1, 0.0)}
    if depth:
        places = {"symmetry_x": (0, 0.0), "symmetry_z": (2, 0.0), "front": (1, 0.0), "back": (1, depth)}
    groups: dict[str, list[int]] = {name: [] for name in (*places, "rim")}
    for _, side in gmsh.model.getBoundary(parts, oriented=False):
        box = gmsh.model.getBoundingBox(dim - 1, side)
        flat = [n for n, (axis, at) in places.items() if max(abs(box[axis] - at), abs(box[axis + 3] - at)) < 1e-4 * radius]
        groups[flat[0] if flat else "rim"].append(side)
    for name, tags in groups.items():
        gmsh.model.setPhysicalName(dim - 1, gmsh.model.addPhysicalGroup(dim - 1, tags), name)
