"""One eighth of a thick spherical shell of hexahedra: three patches that meet at (1, 1, 1), none of them collapsed."""

import math
from typing import Any

import gmsh
import numpy as np


def build(inner: float = 95.0, thickness: float = 1.0, cells: int = 9, layers: int = 4) -> None:
    """Octant x, y, z >= 0 between radii `inner` and `inner` + `thickness` [length].

    cells: per edge of each patch, so 3 cells^2 facets on each sphere (9 makes 243, about 16 x 16); layers: of cells through
    the wall. Every node lies on a sphere. Surfaces: inner, outer, symmetry_x, symmetry_y, symmetry_z (x, y, z = 0).
    """
    geo = gmsh.model.geo
    middle = geo.addPoint(0, 0, 0)
    walls = [_sphere(geo, radius, middle, cells) for radius in (inner, inner + thickness)]
    posts = [geo.addLine(a, b) for a, b in zip(walls[0]["points"], walls[1]["points"], strict=True)]
    for post in posts:
        geo.mesh.setTransfiniteCurve(post, layers + 1)
    sides = {}
    for (a, b), low in walls[0]["curves"].items():
        loop = [low, posts[b], -walls[1]["curves"][a, b], -posts[a]]
        sides[a, b] = geo.addPlaneSurface([geo.addCurveLoop(loop)])
    volumes = []
    for low, high, corners in zip(walls[0]["faces"], walls[1]["faces"], PATCHES, strict=True):
        around = [sides[a, b] if (a, b) in sides else sides[b, a] for a, b in zip(corners, _turned(corners), strict=True)]
        volumes.append(geo.addVolume([geo.addSurfaceLoop([low, *around, high])]))
    for face in (*walls[0]["faces"], *walls[1]["faces"], *sides.values()):
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
    for volume in volumes:
        geo.mesh.setTransfiniteVolume(volume)
    geo.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.clear([(0, middle)])  # belongs to no cell
    gmsh.model.mesh.renumberNodes()
    _onto_spheres(inner, thickness, layers)

    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, volumes), "shell")
    groups = {"inner": walls[0]["faces"], "outer": walls[1]["faces"]}
    for axis, letter in enumerate("xyz"):  # both ends of the side's curve lie in the plane
        groups[f"symmetry_{letter}"] = [s for (a, b), s in sides.items() if CORNERS[a][axis] == CORNERS[b][axis] == 0]
    for name, faces in groups.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)


# directions of an octant's corners, edge middles and centre, and the three patches between them
CORNERS = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1), (1, 1, 1)]
PATCHES = [(0, 3, 6, 5), (1, 4, 6, 3), (2, 5, 6, 4)]


def _turned(corners: tuple[int, ...]) -> tuple[int, ...]:
    return (*corners[1:], corners[0])


def _sphere(geo: Any, radius: float, middle: int, cells: int) -> dict[str, Any]:
    """Points, arcs by the numbers of their ends, and faces of the three patches on one sphere."""
    points = [geo.addPoint(*(radius * c / math.sqrt(sum(direction)) for c in direction)) for direction in CORNERS]
    curves: dict[tuple[int, int], int] = {}
    faces: list[int] = []
    for corners in PATCHES:
        loop = []
        for a, b in zip(corners, _turned(corners), strict=True):
            if (b, a) in curves:
                loop.append(-curves[b, a])
                continue
            curves[a, b] = geo.addCircleArc(points[a], middle, points[b])
            geo.mesh.setTransfiniteCurve(curves[a, b], cells + 1)
            loop.append(curves[a, b])
        faces.append(geo.addSurfaceFilling([geo.addCurveLoop(loop)], sphereCenterTag=middle))
    return {"points": points, "curves": curves, "faces": faces}


def _onto_spheres(inner: float, thickness: float, layers: int) -> None:
    """Interpolation between the patches leaves nodes a little off: put each onto its layer's sphere."""
    tags, x, _ = gmsh.model.mesh.getNodes()
    for tag, place in zip(tags, x.reshape(-1, 3), strict=True):
        radius = np.linalg.norm(place)
        layer = round((radius - inner) / thickness * layers)
        gmsh.model.mesh.setNode(tag, place * (inner + thickness * layer / layers) / radius, [])
