"""Quarters of concentric tubes along z of structured hexahedra, or in a plane mesh."""

import gmsh


def build(tubes: dict[str, tuple[float, float, int, int]] | None = None, depth: float | None = 5.0, layers: int = 1) -> None:
    """tubes: {name: (inner radius, outer radius, cells around, cells through)}; radii and depth [length]; layers: cells
    along the depth.

    Volumes: the names. Surfaces: symmetry_x (x = 0), symmetry_y (y = 0) and ends (z = 0, depth) of all tubes, and of each
    its name_inside and name_outside. depth None: the plane z = 0 alone, surfaces and curves of the same names.
    """
    tubes = tubes or {"inner": (80.0, 90.0, 24, 3), "outer": (100.0, 110.0, 16, 3)}
    groups: dict[str, list[int]] = {name: [] for name in ("symmetry_x", "symmetry_y", *["ends"] * bool(depth))}
    dim = 3 if depth else 2
    for name, sizes in tubes.items():
        body, sides = _quarter(*sizes, depth, layers)
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [body]), name)
        for place, tags in sides.items():
            groups.setdefault(place if place in groups else f"{name}_{place}", []).extend(tags)
    for name, tags in groups.items():
        gmsh.model.setPhysicalName(dim - 1, gmsh.model.addPhysicalGroup(dim - 1, tags), name)
    gmsh.model.mesh.generate(dim)


def _quarter(
    inner: float, outer: float, around: int, through: int, depth: float | None, layers: int
) -> tuple[int, dict[str, list[int]]]:
    """Volume and {place: faces} of a quarter tube, or its cut and {place: curves}."""
    geo = gmsh.model.geo
    o, a, b, c, d = (geo.addPoint(x, y, 0) for x, y in ((0, 0), (inner, 0), (outer, 0), (0, outer), (0, inner)))
    sides = [geo.addLine(a, b), geo.addCircleArc(b, o, c), geo.addLine(c, d), geo.addCircleArc(d, o, a)]
    base = geo.addPlaneSurface([geo.addCurveLoop(sides)])
    for side, cells in zip(sides, (through, around, through, around), strict=True):
        geo.mesh.setTransfiniteCurve(side, cells + 1)
    geo.mesh.setTransfiniteSurface(base)
    geo.mesh.setRecombine(2, base)
    if not depth:
        geo.synchronize()
        return base, {
            place: [side] for place, side in zip(("symmetry_y", "outside", "symmetry_x", "inside"), sides, strict=True)
        }
    out = geo.extrude([(2, base)], 0, 0, depth, [layers], recombine=True)
    geo.synchronize()
    (_, top), (_, volume), *swept = out  # what extrude returns: the top, the volume, and a face for each side
    low, outside, left, inside = ([tag] for _, tag in swept)
    return volume, {"symmetry_y": low, "symmetry_x": left, "inside": inside, "outside": outside, "ends": [base, top]}
