"""A rectangle in the plane z = 0, its quadrilaterals small about a place of its top, from where they grow to all sides."""

import gmsh


def build(
    width: float = 8.0,
    height: float = 8.0,
    mesh_size: float = 0.125,
    at: float = 0.0,
    fine: float = 0.0,
    growth: float = 1.3,
    order: int = 1,
    name: str = "block",
) -> None:
    """0 <= x <= width, -height <= y <= 0; sides NAME_xmin, _xmax, _ymin, _ymax.

    at: where on the top the cells are small, `mesh_size` up to the distance `fine` from there [lengths]; growth: size of
    each cell beyond over that of its neighbour; order 2: with nodes on the middle of the sides.
    """
    if not min(width, height, mesh_size) > 0.0:
        raise ValueError(f"width = {width}, height = {height}, mesh_size = {mesh_size}: give lengths greater than 0")
    ways = {length: _ways(length, mesh_size, fine, growth) for length in (at, width - at, height) if length > 0.0}
    across = [at - way for way in reversed(ways.get(at, []))] + [at] + [at + way for way in ways[width - at]]
    points = [gmsh.model.geo.addPoint(x, 0.0, 0.0) for x in across]
    top = [gmsh.model.geo.addLine(a, b) for a, b in zip(points, points[1:], strict=False)]
    for line in top:
        gmsh.model.geo.mesh.setTransfiniteCurve(line, 2)
    downs = [way / height for way in ways[height]]
    swept = gmsh.model.geo.extrude([(1, t) for t in top], 0.0, -height, 0.0, [1] * len(downs), downs, recombine=True)
    gmsh.model.geo.synchronize()
    cells = [tag for dim, tag in swept if dim == 2]
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, cells), name)
    places = {"xmin": (0, 0.0), "xmax": (0, width), "ymin": (1, -height), "ymax": (1, 0.0)}
    for side, (axis, place) in places.items():
        lines = [tag for _, tag in gmsh.model.getBoundary([(2, tag) for tag in cells], oriented=False)]
        ends = {tag: gmsh.model.getBoundingBox(1, tag) for tag in lines}
        tags = [tag for tag, box in ends.items() if abs(box[axis] - place) + abs(box[axis + 3] - place) < 1e-3 * mesh_size]
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, tags), f"{name}_{side}")
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(order)


def _ways(length: float, mesh_size: float, fine: float, growth: float) -> list[float]:
    """Distances of the nodes from where the cells are small up to `length`, which is the last: beyond `fine` the cells are
    stretched a little to meet it."""
    ways, step = [0.0], mesh_size
    while ways[-1] < length:
        step *= growth if ways[-1] > fine - 0.5 * mesh_size else 1.0
        ways.append(ways[-1] + step)
    fine = min(fine, length)
    return [w if w <= fine * (1 + 1e-9) else fine + (w - fine) * (length - fine) / (ways[-1] - fine) for w in ways[1:]]
