"""An indenter with a round underside above a long block: one layer of structured hexahedra (plane strain, y across)."""

import math

import gmsh


def build(
    length: float = 12.0,
    height: float = 4.0,
    foundation: tuple[int, int] = (48, 8),
    width: float = 1.2,
    left: float = 0.2,
    sides: float = 0.9,
    radius: float = 0.75,
    gap: float = 0.2,
    indenter: tuple[int, int] = (16, 6),
    depth: float = 0.125,
    growth: float = 1.1,
) -> None:
    """Lengths; foundation, indenter: cells along x and z; growth: of the foundation's cells from its top downwards.

    Volumes foundation (top at z = 0, x from 0) and indenter (x from `left`, underside an arc of `radius` whose lowest
    point is `gap` above z = 0). Surfaces: foundation_top, foundation_bottom, indenter_under, indenter_flanks, indenter_top
    and, of both, ends (y = 0, depth).
    """
    geo = gmsh.model.geo
    slab = [(0.0, -height), (length, -height), (length, 0.0), (0.0, 0.0)]
    volume, (bottom, _, top, _), ends = _swept(slab, foundation, depth, growth=growth)
    rise = radius - math.sqrt(radius**2 - width**2 / 4)
    low, right, middle = gap + rise, left + width, left + width / 2
    block = [(left, low), (right, low), (right, low + sides), (left, low + sides)]
    centre = geo.addPoint(middle, 0.0, gap + radius)
    other, (under, *flanks), more = _swept(block, indenter, depth, centre=centre)
    groups = {
        "foundation_top": [top],
        "foundation_bottom": [bottom],
        "indenter_under": [under],
        "indenter_flanks": flanks[::2],
        "indenter_top": [flanks[1]],
        "ends": ends + more,
    }
    for name, tag in (("foundation", volume), ("indenter", other)):
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), name)
    for name, tags in groups.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, tags), name)
    gmsh.model.mesh.generate(3)


def _swept(
    corners: list[tuple[float, float]], cells: tuple[int, int], depth: float, centre: int | None = None, growth: float = 1.0
) -> tuple[int, list[int], list[int]]:
    """Quadrilateral in the x-z plane swept along y: volume, the faces of its four sides, and its two ends.

    centre: of the arc that replaces the first side; growth: of the cells from the third side to the first.
    """
    geo = gmsh.model.geo
    a, b, c, d = (geo.addPoint(x, 0.0, z) for x, z in corners)
    first = geo.addLine(a, b) if centre is None else geo.addCircleArc(a, centre, b)
    lines = [first, geo.addLine(b, c), geo.addLine(c, d), geo.addLine(d, a)]
    for line, count, ratio in zip(lines, cells * 2, (1.0, 1 / growth, 1.0, growth), strict=True):
        geo.mesh.setTransfiniteCurve(line, count + 1, "Progression", ratio)
    base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(base)
    geo.mesh.setRecombine(2, base)
    (_, end), (_, volume), *sides = geo.extrude([(2, base)], 0, depth, 0, [1], recombine=True)
    geo.synchronize()
    return volume, [tag for _, tag in sides], [base, end]
