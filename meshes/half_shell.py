"""Half a thick spherical shell of hexahedra over a block: five patches of which none collapses at the pole."""

import math
from typing import Any

import gmsh
import numpy as np

# directions of the corners of the patch about the pole, which looks down, and of the equator's
SQUARE = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
POLAR = 55.0  # degrees from the pole to the corners of its patch: cells of one size all over the shell


def build(
    inner: float = 2.0 / 3.0,
    outer: float = 1.0,
    cells: tuple[int, int] = (6, 2),
    block: tuple[float, float, float] = (2.0, 2.0, 2.0),
    block_cells: tuple[int, int, int] = (10, 10, 8),
) -> None:
    """Radii of the shell, whose pole touches the middle of the block's top at the origin, the shell above [length].

    cells: along each patch's sides, and through the wall; block: its size [length], block_cells: along its edges. Surfaces:
    outer, inner and rim (the flat end of the wall) of "shell"; top, bottom and sides of "block".
    """
    middle = _shell(inner, outer, *cells)
    _block(block, block_cells, below=4.0 * outer)
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.clear([(0, middle)])  # belongs to no cell
    gmsh.model.mesh.renumberNodes()
    thickness = (outer - inner) / cells[1]
    tags, places, _ = gmsh.model.mesh.getNodes()
    for tag, place in zip(tags, places.reshape(-1, 3), strict=True):
        if place[2] < -2.0 * outer:
            gmsh.model.mesh.setNode(tag, place + [0.0, 0.0, 4.0 * outer], [])
            continue
        # interpolation between the patches leaves nodes a little off: put each onto its layer's sphere
        radius = np.linalg.norm(place)
        layer = round((radius - inner) / thickness)
        gmsh.model.mesh.setNode(tag, place * (inner + thickness * layer) / radius + [0.0, 0.0, outer], [])


def _shell(inner: float, outer: float, cells: int, layers: int) -> int:
    """Draw the shell about the origin; the number of the point there."""
    geo, low, flat = gmsh.model.geo, math.cos(math.radians(POLAR)), math.sin(math.radians(POLAR)) * math.sqrt(0.5)
    directions = [(flat * x, flat * y, -low) for x, y in SQUARE] + [
        (math.sqrt(0.5) * x, math.sqrt(0.5) * y, 0.0) for x, y in SQUARE
    ]
    patches: list[tuple[int, ...]] = [(0, 3, 2, 1), *((i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4) for i in range(4))]
    middle = geo.addPoint(0, 0, 0)
    walls = [_sphere(geo, radius, middle, directions, patches, cells) for radius in (inner, outer)]
    posts = [geo.addLine(a, b) for a, b in zip(walls[0]["points"], walls[1]["points"], strict=True)]
    for post in posts:
        geo.mesh.setTransfiniteCurve(post, layers + 1)
    sides: dict[tuple[int, int], int] = {}
    for (a, b), curve in walls[0]["curves"].items():
        loop = [curve, posts[b], -walls[1]["curves"][a, b], -posts[a]]
        sides[a, b] = geo.addSurfaceFilling([geo.addCurveLoop(loop)])
    volumes = []
    for near, far, corners in zip(walls[0]["faces"], walls[1]["faces"], patches, strict=True):
        ends = zip(corners, (*corners[1:], corners[0]), strict=True)
        around = [sides[a, b] if (a, b) in sides else sides[b, a] for a, b in ends]
        volumes.append(geo.addVolume([geo.addSurfaceLoop([near, *around, far])]))
    for face in (*walls[0]["faces"], *walls[1]["faces"], *sides.values()):
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    for volume in volumes:
        geo.mesh.setTransfiniteVolume(volume)
    geo.synchronize()
    _name(3, volumes, "shell")
    rim = [face for (a, b), face in sides.items() if min(a, b) > 3]
    for faces, name in ((walls[0]["faces"], "inner"), (walls[1]["faces"], "outer"), (rim, "rim")):
        _name(2, faces, name)
    return middle


def _sphere(
    geo: Any,
    radius: float,
    middle: int,
    directions: list[tuple[float, float, float]],
    patches: list[tuple[int, ...]],
    cells: int,
) -> dict[str, Any]:
    """Points, arcs by the numbers of their ends, and faces of the patches on one sphere."""
    points = [geo.addPoint(*(radius * c for c in direction)) for direction in directions]
    curves: dict[tuple[int, int], int] = {}
    faces: list[int] = []
    for corners in patches:
        loop = []
        for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
            if (b, a) in curves:
                loop.append(-curves[b, a])
                continue
            curves[a, b] = geo.addCircleArc(points[a], middle, points[b])
            geo.mesh.setTransfiniteCurve(curves[a, b], cells + 1)
            loop.append(curves[a, b])
        faces.append(geo.addSurfaceFilling([geo.addCurveLoop(loop)], sphereCenterTag=middle))
    return {"points": points, "curves": curves, "faces": faces}


def _block(size: tuple[float, float, float], cells: tuple[int, int, int], below: float) -> None:
    geo, (x, y, z) = gmsh.model.geo, size
    corners = [geo.addPoint(0.5 * x * i, 0.5 * y * j, -z - below) for i, j in SQUARE]
    lines = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    for i, line in enumerate(lines):
        geo.mesh.setTransfiniteCurve(line, cells[i % 2] + 1)
    base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(base)
    geo.mesh.setRecombine(2, base)
    (_, top), (_, volume), *sides = geo.extrude([(2, base)], 0, 0, z, numElements=[cells[2]], recombine=True)
    geo.synchronize()
    _name(3, [volume], "block")
    for faces, name in (([base], "bottom"), ([top], "top"), ([face for _, face in sides], "sides")):
        _name(2, faces, name)


def _name(dim: int, entities: list[int], name: str) -> None:
    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, entities), name)
