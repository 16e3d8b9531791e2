"""Two cylinders along y whose rims touch at the origin, cut off at their axes: one layer of structured hexahedra."""

from typing import Any

import gmsh
import numpy as np

from fenics_contact.types import Floats


def build(
    radius: float = 8.0,
    fine: float = 1.0,
    cells: int = 30,
    outside: int = 9,
    through: int = 16,
    depth: float = 0.1,
    reach: float = 1.0,
) -> None:
    """radius; fine: half the width of the zone of even cells around the contact, `cells` of them across it; outside: growing
    cells on either side of it; through: growing ones from rim to axis plane; depth: of the slice [lengths]; reach: angle
    [radians] of the rim on either side of the contact, beyond which the flanks are vertical.

    Volumes lower (z < 0) and upper. Surfaces lower_rim, upper_rim, lower_axis, upper_axis, and ends (y = 0, depth) of both.
    """
    columns = _graded(cells, outside, fine / radius, reach)
    height = _rising(through, 2.0 * fine / cells / radius)
    # of two boxes between rim and axis plane, meshed apart, only the topology counts: their nodes are moved to their places
    ends, drawn = [], []
    for sign, name in ((-1, "lower"), (1, "upper")):
        faces, entities = _box(name, 2.0 * sign, (len(columns) - 1, 1, through))
        ends += faces.pop("ends")
        drawn.append((sign, entities))
        for label, face in faces.items():
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), f"{name}_{label}")
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, ends), "ends")
    gmsh.model.mesh.generate(3)
    for sign, entities in drawn:
        _move(entities, sign, columns, height, radius, depth)


def _box(name: str, rim: float, cells: tuple[int, int, int]) -> tuple[dict[str, Any], list[tuple[int, int]]]:
    """Unit box of structured cells from z = rim away from z = 0: faces by name, and all entities."""
    before = set(gmsh.model.getEntities())
    geo, axis = gmsh.model.geo, rim + (1.0 if rim > 0 else -1.0)
    corners = [geo.addPoint(a, 0, c) for a, c in ((0, rim), (1, rim), (1, axis), (0, axis))]
    lines = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    for line, count in zip(lines, (cells[0], cells[2]) * 2, strict=True):
        geo.mesh.setTransfiniteCurve(line, count + 1)
    base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(base)
    geo.mesh.setRecombine(2, base)
    (_, end), (_, volume), (_, low), _, (_, high), _ = geo.extrude([(2, base)], 0, 1, 0, [1], recombine=True)
    geo.synchronize()
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
    entities = [entity for entity in gmsh.model.getEntities() if entity not in before]
    return {"rim": low, "axis": high, "ends": [base, end]}, entities


def _move(entities: list[tuple[int, int]], sign: int, columns: Floats, height: Floats, radius: float, depth: float) -> None:
    """Nodes of the unit box to their places on the cylinder."""
    for entity in entities:
        tags, places, _ = gmsh.model.mesh.getNodes(*entity)
        for tag, (x, y, z) in zip(tags, places.reshape(-1, 3), strict=True):
            angle = columns[round(x * (len(columns) - 1))]
            share = height[round((abs(z) - 2.0) * (len(height) - 1))]
            rim = radius * np.array([np.sin(angle), 1.0 - np.cos(angle)])
            across, up = (1.0 - share) * rim + share * np.array([rim[0], radius])
            gmsh.model.mesh.setNode(tag, [across, depth * y, sign * up], [])


def _graded(cells: int, outside: int, fine: float, reach: float) -> Floats:
    """Angles from -reach to reach: even cells within `fine`, growing ones beyond."""
    inner = np.linspace(-fine, fine, cells + 1)
    beyond = fine + (reach - fine) * _rising(outside, (inner[1] - inner[0]) / (reach - fine))[1:]
    return np.concatenate([-beyond[::-1], inner, beyond])


def _rising(count: int, first: float) -> Floats:
    """Places from 0 to 1 in `count` cells that grow by a constant ratio, the first one `first` long."""
    low, high = 1.0, 10.0
    for _ in range(60):
        ratio = 0.5 * (low + high)
        total = first * np.sum(ratio ** np.arange(count))
        low, high = (ratio, high) if total < 1.0 else (low, ratio)
    places = np.concatenate([[0.0], np.cumsum(ratio ** np.arange(count))])
    return places / places[-1]
