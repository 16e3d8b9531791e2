"""A whole ring about y, structured hexahedra: a tyre, a seal, a bush."""

import gmsh


def build(
    inner: float = 15.0,
    outer: float = 25.0,
    width: float = 10.0,
    cells: tuple[int, int, int] = (48, 3, 2),
    name: str = "ring",
) -> None:
    """Radii and width, from y = -width/2 on [length]; cells: around, a multiple of four, from inside to outside, across.

    Surfaces: inside, outside, and the ends left and right.
    """
    geo, around = gmsh.model.geo, cells[0] // 4
    places = ((1, 0), (0, 1), (-1, 0), (0, -1))
    centre = geo.addPoint(0, -width / 2, 0)
    a, b = ([geo.addPoint(r * x, -width / 2, r * z) for x, z in places] for r in (inner, outer))
    radial = [geo.addLine(*ends) for ends in zip(a, b, strict=True)]
    inside, outside = ([geo.addCircleArc(p[i], centre, p[(i + 1) % 4]) for i in range(4)] for p in (a, b))
    groups: dict[str, list[int]] = {"inside": [], "outside": [], "left": [], "right": []}
    volumes = []
    for i in range(4):
        sides = [radial[i], outside[i], -radial[(i + 1) % 4], -inside[i]]
        base = geo.addPlaneSurface([geo.addCurveLoop(sides)])
        for side, count in zip(sides, (cells[1], around, cells[1], around), strict=True):
            geo.mesh.setTransfiniteCurve(abs(side), count + 1)
        geo.mesh.setTransfiniteSurface(base)
        geo.mesh.setRecombine(2, base)
        (_, top), (_, volume), _, (_, out), _, (_, into) = geo.extrude([(2, base)], 0, width, 0, [cells[2]], recombine=True)
        volumes.append(volume)
        for group, face in zip(groups, (into, out, base, top), strict=True):
            groups[group].append(face)
    geo.synchronize()
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, volumes), name)
    for group, faces in groups.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), group)
    gmsh.model.mesh.generate(3)
