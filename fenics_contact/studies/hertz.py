"""A rigid sphere, cylinder (Hertz) or cone (Sneddon) on a half-space, at small strain: the force against the closed form.

The half-space is a block whose far faces are led along the displacement under the exact pressure, which is Boussinesq's
(point load) or Flamant's (line load) folded with it.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import RigidTool, rigid_cone, rigid_cylinder, rigid_sphere
from fenics_contact.mesh_io import NamedMesh, read_gmsh
from fenics_contact.meshes import graded_block, graded_rectangle
from fenics_contact.options import Output
from fenics_contact.result import Result
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import from_elastic
from fenics_contact.studies.charts import answer, work_precision
from fenics_contact.studies.exact import Field, boussinesq, flamant, under_cone, under_hertz
from fenics_contact.studies.runner import Panels, Row, Run, Study, expand, metrics, stepping
from fenics_contact.types import Floats

E, NU = 1000.0, 0.3  # MPa
STAR = E / (1 - NU**2)
R, A = 300.0, 1.0  # tool radius and half-width of the contact [mm]: strains of A / R = 0.3 %
FAR, DEPTH = 8.0, 0.1  # [mm]: far faces, thickness of the slice under the cylinder

BASE: Run = {"tool": "cylinder", "cells": 12, "degree": 1, "points": "nodes", "factor": 100.0, "method": "newton",
        "steps": 2, "linear": "direct", "mesh": "space", "processes": 1}  # fmt: skip
MESHES = [4, 6, 8, 12, 24]
SPHERE = {"tool": ["sphere"]}
PANELS: Panels = {
    "cylinder: mesh (cells per 1.5 contact widths)": {
        "nodes": {"cells": MESHES},
        "2 × 2 Gauss points": {"cells": [4, 8, 12], "points": [2]},
        "3 × 3 Gauss points": {"cells": [4, 8, 12], "points": [3]},
        "nodes, plane mesh": {"cells": MESHES, "mesh": ["plane"]},
        "degree 2, nodes, plane mesh": {"cells": [4, 6, 8, 12], "degree": [2], "mesh": ["plane"]},
        "degree 2, nodes": {"cells": [4, 6, 8], "degree": [2]},
        "degree 2, 3 × 3": {"cells": [4, 6], "degree": [2], "points": [3]},
    },
    "sphere: mesh, linear solver, processes": {
        "direct": {"cells": [4, 6, 8], **SPHERE},
        "direct, 2 processes": {"cells": [6, 8], "processes": [2], **SPHERE},
        "iterative": {"cells": [4, 8], "linear": ["iterative"], **SPHERE},
        "iterative, 2 processes": {"cells": [8, 10, 12], "linear": ["iterative"], "processes": [2], **SPHERE},
        "3 × 3 Gauss points": {"cells": [4, 6], "points": [3], **SPHERE},
    },
    "cylinder: method (number of steps)": {
        "Newton": {"steps": [1, 2, 4]},
        "incremental": {"steps": [8, 16, 32], "method": ["incremental"]},
        "SNES": {"steps": [1, 2, 4], "method": ["snes"]},
    },
    "cylinder: penalty (factor on E/h)": {
        "12 cells": {"factor": [1.0, 10.0, 100.0, 1000.0, 10000.0]},
        "24 cells": {"factor": [10.0, 100.0, 1000.0], "cells": [24]},
    },
}
QUICK: Panels = {"all": {"mesh": {"cells": [4, 6, 12]}, "method": {"steps": [1, 2]}, "plane": {"mesh": ["plane"]}}}
PLANS: dict[bool, tuple[Run, Panels]] = {False: (BASE, PANELS), True: (BASE | {"cells": 6}, QUICK)}  # by quick
TITLE = "Hertz; baseline: cylinder, 12 cells of degree 1, nodes, penalty 100 E/h, 2 Newton steps"

DIRECT = stepping("newton", 2, "direct")

Problem = tuple[RigidTool, float, Field, float, NamedMesh]  # what `sphere` and `cylinder` return


def hertz(
    tool: str,
    cells: int,
    degree: int,
    points: int | str,
    factor: float,
    method: str,
    steps: int,
    linear: str,
    mesh: str = "space",
) -> Row:
    """Relative error of the force of the tool; mesh: of cells in "space", or "plane", under a cylinder."""
    if mesh == "plane":
        result, exact = indented_plane(cells, degree, points, factor, stepping(method, steps, linear))
    else:
        result, exact = indented(tool, cells, degree, points, factor, stepping(method, steps, linear))
    force = -result.history[-1][f"top_force_{'y' if mesh == 'plane' else 'z'}_N"] if result.history else float("nan")
    return metrics(result, error=abs(force / exact - 1), value=force)


def indented(
    tool: str,
    cells: int,
    degree: int = 1,
    points: int | str = "nodes",
    factor: float = 100.0,
    way: Mapping[str, Any] = DIRECT,
) -> tuple[Result, float]:
    """Result of pressing a tool, "sphere", "cone" or "cylinder", into the block, and the exact force [N]; way: words of
    solve for how, see `stepping`."""
    shape, depth, field, exact, mesh = {"sphere": sphere, "cone": cone, "cylinder": cylinder}[tool](cells)
    scene = Scene(Body(mesh, "block", from_elastic(E, NU)), degree=degree)
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    for face in ("xmax", "ymax", "zmin"):
        for axis, letter in enumerate("xyz"):
            if tool != "cylinder" or (letter != "y" and face != "ymax"):
                scene.prescribe(face, letter, _along(field, axis))
    if tool == "cylinder":
        scene.fix("ymax", "y")
    scene.contact("zmax", shape, points=points, penalty=Penalty(factor=factor), name="top")
    return solve(scene, move={shape: (0, 0, -depth)}, out=Output(progress=False), **way), exact


def indented_plane(
    cells: int, degree: int, points: int | str, factor: float, way: Mapping[str, Any]
) -> tuple[Result, float]:
    """The same of the cylinder in plane strain on a mesh of the plane z = 0, whose cells are a cut through the slice's."""
    P, depth, field = _line_contact()
    growth = 1.2 ** (12 / cells)
    mesh = read_gmsh(graded_rectangle.build, width=FAR, height=FAR, mesh_size=1.5 * A / cells, fine=1.5 * A, growth=growth)
    scene = Scene(Body(mesh, "block", from_elastic(E, NU)), degree=degree, plane="strain", thickness=DEPTH)
    scene.fix("block_xmin", "x")
    for side in ("block_xmax", "block_ymin"):
        for letter, axis in (("x", 0), ("y", 2)):
            scene.prescribe(side, letter, lambda X, t, axis=axis: t * field(X[:, [0, 2, 1]])[:, axis])
    shape = rigid_cylinder(R, (0, R, 0), axis=(0, 0, 1))
    scene.contact("block_ymax", shape, points=points, penalty=Penalty(factor=factor), name="top")
    result = solve(scene, move={shape: (0, -depth, 0)}, out=Output(progress=False), **way)
    return result, DEPTH * P / 2


def _along(field: Field, axis: int) -> Callable[[Floats, float], Floats]:
    """A component of the far field, which grows with t."""
    return lambda X, t: t * field(X)[:, axis]


def sphere(cells: int) -> Problem:
    """Tool, its travel [mm], the far field, the exact force [N] on a quarter, and the mesh."""
    depth = A**2 / R
    force = 4 / 3 * STAR * np.sqrt(R) * depth**1.5
    return rigid_sphere(R, (0, 0, R)), depth, under_hertz(boussinesq(force, E, NU), A), force / 4, quarter(cells)


def cone(cells: int) -> Problem:
    """The same of a cone whose contact has the radius A: F = 2/pi E* d^2 tan(half-angle), A = 2/pi d tan(half-angle)."""
    half_angle = np.arctan2(R, A)
    depth = np.pi / 2 * A / np.tan(half_angle)
    force = 2 / np.pi * STAR * depth**2 * np.tan(half_angle)
    field = under_cone(boussinesq(force, E, NU), A)
    return rigid_cone(half_angle, (0, 0, 0)), depth, field, force / 4, quarter(cells)


def quarter(cells: int) -> NamedMesh:
    return read_gmsh(graded_block.build, fine=1.5 * A, cells=cells, far=FAR, growth=1.35 ** (8 / cells))


def cylinder(cells: int) -> Problem:
    """The same for half of a slice under a cylinder."""
    P, depth, field = _line_contact()
    mesh = read_gmsh(graded_block.build, fine=1.5 * A, cells=cells, far=FAR, growth=1.2 ** (12 / cells), depth=DEPTH)
    return rigid_cylinder(R, (0, 0, R)), depth, field, DEPTH * P / 2, mesh


def _line_contact() -> tuple[float, float, Field]:
    """The cylinder's force per length [N/mm], its travel [mm] against the far field, and that."""
    P = np.pi * STAR * A**2 / (4 * R)  # a = 2 sqrt(P R / (pi E*))
    # Hertz's pressure folded with Flamant's surface displacement
    depth = 2 * P / (np.pi * STAR) * (0.5 - np.log(A / 2)) - P * (1 + NU) / (np.pi * E)
    return P, depth, under_hertz(flamant(P, E, NU), A, line=True)


def studies(quick: bool) -> list[Study]:
    return [Study("hertz", hertz, expand(*PLANS[quick]), repeats=1 if quick else 3, shared=True)]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """Charts of the rows {study: rows}, and what they say; StudyError where theory is contradicted."""
    mine, keys, (base, panels) = rows["hertz"], list(BASE), PLANS[quick]
    work_precision(charts / "hertz.png", mine, base, panels, title=TITLE, parameters=keys, quantity="error of the force")
    bases = {"cylinder": base} | ({} if quick else {"sphere": base | {"tool": "sphere", "cells": 8}})
    return [
        f"{tool}: {answer([row for row in mine if row['tool'] == tool], star, panels, keys)}" for tool, star in bases.items()
    ]
