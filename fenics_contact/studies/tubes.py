"""Nested rubber tubes, two deformable bodies in contact, against the exact solution: at an inner radius of 120 mm."""

from pathlib import Path

import numpy as np

from fenics_contact import compat
from fenics_contact.contact.penalties import Penalty
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import tubes as tube_mesh
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_paper
from fenics_contact.studies.charts import answer, hold_slope, work_precision
from fenics_contact.studies.exact import A1, A2, Radial
from fenics_contact.studies.runner import Panels, Row, Run, Study, expand, metrics, of_curve, stepping
from fenics_contact.types import Function

INNER, OUTER, K = (80.0, 90.0), (100.0, 110.0), 5.0  # mm, mm, MPa
REACH = 120.0  # mm, inner radius under the largest pressure

BASE: Run = {"cells": 24, "points": 3, "factor": 100.0, "penetration": 0.0, "element": "displacement", "method": "newton",
        "steps": 6, "linear": "direct", "mesh": "layer", "processes": 1}  # fmt: skip
PANELS: Panels = {
    "mesh (cells around a quarter)": {
        "3 × 3 Gauss points": {"cells": [12, 24, 48, 96]},
        "2 × 2 Gauss points": {"cells": [12, 24, 48], "points": [2]},
        "facet corners": {"cells": [12, 24, 48], "points": ["corners"]},
        "averages": {"cells": [12, 24, 48, 96], "points": ["averages"]},
        "averages, plane mesh": {"cells": [12, 24, 48, 96], "points": ["averages"], "mesh": ["plane"]},
        "3 × 3, mixed element": {"cells": [12, 24, 48], "element": ["mixed"]},
    },
    "method (number of steps)": {
        "Newton": {"steps": [3, 6, 12]},
        "incremental": {"steps": [12, 24, 48], "method": ["incremental"]},
        "SNES": {"steps": [6], "method": ["snes"]},
        "arc length": {"steps": [6], "method": ["arc_length"]},
    },
    "penalty (factor on E/h)": {
        "on 24 cells": {"factor": [1.0, 10.0, 100.0, 1000.0, 10000.0]},
        "on 48 cells": {"factor": [1.0, 10.0, 100.0, 1000.0], "cells": [48]},
        "on 48 cells, one point a facet": {"factor": [1.0, 10.0, 100.0], "points": [1], "cells": [48]},
        "augmented to 1e-4 mm": {"factor": [1.0, 10.0, 100.0], "penetration": [1e-4], "points": [1], "cells": [48]},
    },
}
HARD = 1e4  # factor whose penetration no longer counts
QUICK: Panels = {"all": {"penalty": {"factor": [10.0, 100.0, 1000.0, HARD]}, "mesh": {"cells": [12, 24]},
                         "plane": {"mesh": ["plane"], "points": ["averages"]}}}  # fmt: skip
PLANS: dict[bool, tuple[Run, Panels]] = {False: (BASE, PANELS), True: (BASE | {"cells": 24}, QUICK)}  # by quick
TITLE = "Nested tubes, exact solution; baseline: 24 and 18 cells around, 3 × 3 Gauss points, penalty 100 E/h, 6 Newton steps"


def tubes(
    cells: int,
    points: int | str,
    factor: float,
    penetration: float,
    element: str,
    method: str,
    steps: int,
    linear: str,
    mesh: str = "layer",
) -> Row:
    """The larger of the errors of contact pressure and inner displacement, under the pressure that belongs to REACH.

    penetration: largest one [mm] left by multipliers, 0 for the plain penalty; mesh: a "layer" of cells in space, or a
    "plane" one; value: contact pressure [MPa].
    """
    exact = Radial("tube", K)

    def outer(radius: float) -> float:
        return exact.solve(OUTER, radius)[0] if radius > OUTER[0] else 0.0

    pressure, interface = exact.solve(INNER, REACH, outer)
    depth = 100.0 / cells if mesh == "layer" else None
    around = {"inner": (*INNER, cells, max(2, cells // 8)), "outer": (*OUTER, 3 * cells // 4, max(2, cells // 10))}
    drawn = read_gmsh(tube_mesh.build, tubes=around, depth=depth)
    rubber = mooney_paper(A1, A2, K)
    section = None if depth else "strain"
    scene = Scene(Body(drawn, "inner", rubber), Body(drawn, "outer", rubber), element=element, plane=section)
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    if depth:
        scene.fix("ends", "z")
    scene.pressure("inner_inside", pressure)
    scene.contact("inner_outside", "outer_inside", points=points, name="interface",
                  penalty=Penalty(factor=factor), penetration=penetration or None)  # fmt: skip
    result = solve(scene, out=Output(progress=False), **stepping(method, steps, linear))
    # the interface's pressure on a quarter of its length is balanced by radius times pressure on a symmetry plane
    found = -result.history[-1]["interface_force_x_N"] / mean_radius(scene, "outer_inside", result.u) / (depth or 1.0)
    moved = mean_radius(scene, "inner_inside", result.u) - INNER[0]
    errors = abs(found / outer(interface) - 1), abs(moved / (REACH - INNER[0]) - 1)
    row = metrics(result, error=max(errors), value=found)
    if result.converged and found <= 0.0:  # no contact where there must be: not an answer, whatever the solver says
        row |= {"converged": False, "verdict": "passed through unnoticed", "error": float("nan")}
    return row


def mean_radius(scene: Scene, group: str, u: Function) -> float:
    """Mean distance of a surface's nodes from the axis [mm]. Collective."""
    space, comm = scene.space, scene.mesh.comm
    nodes = compat.locate_blocks(space, scene.mesh.facets(group))
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    x = space.tabulate_dof_coordinates()[nodes] + u.x.array.reshape(-1, 3)[nodes]
    total, count = comm.allreduce(np.array([np.hypot(x[:, 0], x[:, 1]).sum(), len(x)]))
    return total / count


def studies(quick: bool) -> list[Study]:
    return [Study("tubes", tubes, expand(*PLANS[quick]), repeats=1 if quick else 3, shared=True)]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """Charts of the rows {study: rows}, and what they say; StudyError where theory is contradicted."""
    mine, keys, (base, panels) = rows["tubes"], list(BASE), PLANS[quick]
    work_precision(
        charts / "tubes.png",
        mine,
        base,
        panels,
        title=TITLE,
        parameters=keys,
        quantity="error of contact pressure or displacement",
    )
    hard = of_curve(mine, base | {"factor": HARD}, {})[0]["value"]
    softer = [of_curve(mine, base | {"factor": f}, {})[0] for f in (10.0, 100.0, 1000.0)]
    slope = hold_slope(
        "pressure lost to penetration, over 1 / penalty",
        [1 / row["factor"] for row in softer],
        [abs(row["value"] / hard - 1) for row in softer],
        1,
        0.1,
    )
    return [slope, answer(mine, base, panels, keys)]
