"""An indenter with a round underside above a long block: plane, or one layer of hexahedra (plane strain, y across)."""

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
    depth: float = 0.0,
    growth: float = 1.1,
) -> None:
    """Lengths; foundation, indenter: cells along and up; growth: of the foundation's cells from its top downwards.

    Bodies foundation (top at height 0, x from 0) and indenter (x from `left`, underside an arc of `radius` whose lowest
    point is `gap` above it). Their sides: foundation_top, foundation_bottom, indenter_under, indenter_flanks, indenter_top.
    depth: of a layer in space, whose height is z, and whose surfaces at y = 0 and depth are `ends`; 0: plane, in x and y.
    """
    slab = [(0.0, -height), (length, -height), (length, 0.0), (0.0, 0.0)]
    volume, (bottom, _, top, _), ends = _swept(slab, foundation, depth, growth=growth)
    rise = radius - math.sqrt(radius**2 - width**2 / 4)
    low, right, middle = gap + rise, left + width, left + width / 2
    block = [(left, low), (right, low), (right, low + sides), (left, low + sides)]
    centre = _point(middle, gap + radius, depth)
    other, (under, *flanks), more = _swept(block, indenter, depth, centre=centre)
    groups = {
        "foundation_top": [top],
        "foundation_bottom": [bottom],
        "indenter_under": [under],
        "indenter_flanks": flanks[::2],
        "indenter_top": [flanks[1]],
    }
    dim = 3 if depth else 2
    if depth:
        groups["ends"] = ends + more
    for name, tag in (("foundation", volume), ("indenter", other)):
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
    for name, tags in groups.items():
        gmsh.model.setPhysicalName(dim - 1, gmsh.model.addPhysicalGroup(dim - 1, tags), name)
    gmsh.model.mesh.generate(dim)


def _point(x: float, height: float, depth: float) -> int:
    return int(gmsh.model.geo.addPoint(x, *((0.0, height) if depth else (height, 0.0))))


def _swept(
    corners: list[tuple[float, float]], cells: tuple[int, int], depth: float, centre: int | None = None, growth: float = 1.0
) -> tuple[int, list[int], list[int]]:
    """Quadrilateral swept along y: volume, the faces of its four sides, and its two ends; without depth the quadrilateral,
    its sides, and no ends.

    centre: of the arc that replaces the first side; growth: of the cells from the third side to the first.
    """
    geo = gmsh.model.geo
    a, b, c, d = (_point(x, height, depth) for x, height in corners)
    first = geo.addLine(a, b) if centre is None else geo.addCircleArc(a, centre, b)
    lines = [first, geo.addLine(b, c), geo.addLine(c, d), geo.addLine(d, a)]
    for line, count, ratio in zip(lines, cells * 2, (1.0, 1 / growth, 1.0, growth), strict=True):
        geo.mesh.setTransfiniteCurve(line, count + 1, "Progression", ratio)
    base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(base)
    geo.mesh.setRecombine(2, base)
    if not depth:
        geo.synchronize()
        return base, lines, []
    (_, end), (_, volume), *sides = geo.extrude([(2, base)], 0, depth, 0, [1], recombine=True)
    geo.synchronize()
    return volume, [tag for _, tag in sides], [base, end]
