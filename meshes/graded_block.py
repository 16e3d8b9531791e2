"""Block of structured hexahedra, fine near the origin at the middle of its top and growing towards its far faces."""

import gmsh


def build(fine: float = 1.5, cells: int = 12, far: float = 8.0, growth: float = 1.3, depth: float | None = None) -> None:
    """Quarter block 0 <= x, y <= far, -far <= z <= 0 [length], faces xmin, xmax, ymin, ymax, zmin, zmax.

    cells: number of equal cells from the origin to the distance `fine`; growth: size of each cell beyond over that of its
    neighbour; depth: a slice 0 <= y <= depth with one layer of cells instead (plane strain).
    """
    size = fine / cells
    places = [i * size for i in range(cells + 1)]
    while places[-1] < far:
        places.append(places[-1] + size * growth ** (len(places) - cells))
    places = [p if p <= fine * (1 + 1e-9) else fine + (p - fine) * (far - fine) / (places[-1] - fine) for p in places]
    line = _grid_line([(0, 0, -p) for p in reversed(places)])
    face = _sweep(line, (1, 0, 0), places)
    volumes = _sweep(face, (0, 1, 0), [0.0, depth] if depth else places)
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(3)

    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for _, tag in volumes]), "block")
    ends = {"x": (0, 0.0, far), "y": (1, 0.0, depth or far), "z": (2, -far, 0.0)}
    for letter, (axis, *places) in ends.items():
        for end, place in zip(("min", "max"), places, strict=True):
            faces = [f for _, f in gmsh.model.getEntities(2) if _lies_at(f, axis, place)]
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), letter + end)


def _grid_line(points: list[tuple[float, float, float]]) -> list[tuple[int, int]]:
    """Chain of one-cell lines through points; returns their (dimension, tag)."""
    tags = [gmsh.model.geo.addPoint(*p) for p in points]
    lines = [gmsh.model.geo.addLine(a, b) for a, b in zip(tags, tags[1:], strict=False)]
    for line in lines:
        gmsh.model.geo.mesh.setTransfiniteCurve(line, 2)
    return [(1, line) for line in lines]


def _sweep(entities: list[tuple[int, int]], direction: tuple[int, int, int], places: list[float]) -> list[tuple[int, int]]:
    """Extrude entities along a direction in one layer of cells per interval of places."""
    length = places[-1]
    heights = [p / length for p in places[1:]]
    out = gmsh.model.geo.extrude(entities, *(length * d for d in direction), [1] * len(heights), heights, recombine=True)
    return [e for e in out if e[0] == entities[0][0] + 1]


def _lies_at(face: int, axis: int, place: float) -> bool:
    box = gmsh.model.getBoundingBox(2, face)
    return all(abs(box[axis + 3 * i] - place) < 1e-6 * max(1.0, abs(place)) for i in (0, 1))
