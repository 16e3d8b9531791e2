"""Half of a round roller in the plane z = 0, x >= 0, its quadrilaterals small about its lowest point, the origin."""

import math

import gmsh


def build(radius: float = 50.0, mesh_size: float = 0.1, growth: float = 1.1, name: str = "roller") -> None:
    """Half disc about (0, radius); mesh_size: of the cells at the origin [lengths]; growth: size of each cell along the rim,
    and its square through the thickness, over that of its neighbour.

    Curves: NAME_rim, an eighth of the circle from the origin on, NAME_crown, its upper quarter, and NAME_axis (x = 0).
    """
    geo, half, inner = gmsh.model.geo, radius * math.sqrt(0.5), 0.42 * radius
    steep, line = growth**2, geo.addLine
    around, inwards = (_count(way, mesh_size, q) for way, q in ((radius * math.pi / 4, growth), (0.5 * radius, steep)))
    middle, a, e = (geo.addPoint(x, radius, 0) for x in (0.0, 0.5 * radius, radius))
    base, low = line(middle, a), line(a, e)
    cuts = [(base, around, growth), (low, inwards, 1 / steep)]  # curves, their cells, and the ratio of these
    faces, axis, arcs = [], [], []
    for up in (-1, 1):
        spots = (inner, up * inner), (0.0, up * 0.5 * radius), (half, up * half), (0.0, up * radius)
        b, c, f, end = (geo.addPoint(x, radius + y, 0) for x, y in spots)
        ab, bc, cm, bf, ce = (line(*ends) for ends in ((a, b), (b, c), (c, middle), (b, f), (c, end)))
        arcs += [(geo.addCircleArc(e, middle, f), geo.addCircleArc(f, middle, end))]
        loops = [base, ab, bc, cm], [low, arcs[-1][0], -bf, -ab], [bf, arcs[-1][1], -ce, -bc]
        faces += [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
        cuts += [(curve, around, 1 / growth if up < 0 else 1.0) for curve in (arcs[-1][1], bc)]
        cuts += [(curve, inwards, 1 / steep) for curve in (bf, ce)] + [(curve, 6, 1.0) for curve in (ab, cm, arcs[-1][0])]
        axis += [cm, ce]
    for curve, count, ratio in cuts:
        geo.mesh.setTransfiniteCurve(curve, count + 1, "Progression", ratio)
    for face in faces:
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    geo.synchronize()
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)
    for side, tags in {"rim": [arcs[0][1]], "crown": [*arcs[1]], "axis": axis}.items():
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, tags), f"{name}_{side}")
    gmsh.model.mesh.clear()
    gmsh.model.mesh.generate(2)


def _count(way: float, mesh_size: float, ratio: float) -> int:
    """Cells along a way [length] that begin with `mesh_size` and grow by a ratio."""
    return math.ceil(math.log(1 + way * (ratio - 1) / mesh_size) / math.log(ratio))
