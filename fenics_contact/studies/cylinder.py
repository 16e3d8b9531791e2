"""Rubber cylinder squeezed between frictionless plates, plane strain: force per depth against independent references."""

from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import rigid_plane
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import disc
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_rivlin
from fenics_contact.studies.charts import answer, work_precision
from fenics_contact.studies.runner import Panels, Row, Run, Study, expand, metrics, stepping

# (radius mm, a1, a2, K MPa, squeeze in all mm, force N/mm): classical Mooney-Rivlin, references of other codes
RUBBERS = {"soft": (20.0, 0.1863, 0.0098, 5.0, 6.4, 4.5622), "stiff": (200.0, 0.293, 0.177, 1423.93, 40.0, 60.15)}

BASE: Run = {"cells": 8, "degree": 1, "element": "displacement", "rubber": "soft", "points": "nodes", "factor": 100.0,
        "penetration": 0.0, "method": "newton", "steps": 8, "linear": "direct", "mesh": "layer",
        "processes": 1}  # fmt: skip
STIFF = {"rubber": ["stiff"]}
PANELS: Panels = {
    "mesh (cells per block), degree and element": {
        "degree 1": {"cells": [4, 8, 16, 32]},
        "degree 1, mixed": {"cells": [4, 8, 16], "element": ["mixed"]},
        "degree 2": {"cells": [4, 8], "degree": [2]},
        "degree 1, plane mesh": {"cells": [4, 8, 16, 32], "mesh": ["plane"]},
    },
    "the same for rubber of K/μ = 1515": {
        "degree 1": {"cells": [4, 8, 16], "element": ["locking"], **STIFF},
        "degree 1, mixed": {"cells": [4, 8, 16], "element": ["mixed"], **STIFF},
        "degree 1, mixed, plane mesh": {"cells": [4, 8, 16], "element": ["mixed"], "mesh": ["plane"], **STIFF},
        "degree 2": {"cells": [4, 8], "degree": [2], **STIFF},
        "degree 2, mixed": {"cells": [4, 8], "degree": [2], "element": ["mixed"], **STIFF},
    },
    "method (number of steps) on 8 cells": {
        "Newton": {"steps": [1, 2, 4, 8, 16]},
        "incremental": {"steps": [8, 16, 32], "method": ["incremental"]},
        "SNES": {"steps": [8], "method": ["snes"]},
        "arc length": {"steps": [8], "method": ["arc_length"]},
    },
    "penalty (factor on E/h), contact points, on 16 cells": {
        "nodes": {"factor": [1.0, 10.0, 100.0, 1000.0, 10000.0], "cells": [16]},
        "2 × 2 Gauss points": {"factor": [10.0, 100.0], "points": [2], "cells": [16]},
        "3 × 3 Gauss points": {"factor": [10.0, 100.0, 1000.0], "points": [3], "cells": [16]},
        "nodes, augmented to 1e-4 mm": {"factor": [1.0, 10.0, 100.0], "penetration": [1e-4], "cells": [16]},
    },
}
QUICK: Panels = {"all": {"mesh": {"cells": [4, 8, 16], "points": [3]}, "penalty": {"factor": [10.0, 100.0, 1000.0]}}}
PLANS: dict[bool, tuple[Run, Panels]] = {False: (BASE, PANELS), True: (BASE | {"cells": 6}, QUICK)}  # by quick
TITLE = "Rubber cylinder between plates; baseline: 3 blocks of 8 × 8 cells, nodes, penalty 100 E/h, 8 Newton steps"


def cylinder(
    cells: int,
    degree: int,
    element: str,
    rubber: str,
    points: int | str,
    factor: float,
    penetration: float,
    method: str,
    steps: int,
    linear: str,
    mesh: str = "layer",
    layers: int = 1,
    length: float = 1.0,
    free_end: bool = False,
) -> Row:
    """Error of the force per depth on a quarter of the cylinder. element "locking": plain displacement, though it locks;
    mesh: a "layer" of cells in space, or a "plane" one.

    layers, length, free_end: a 3-D cylinder of that length [mm] between symmetry planes, or with one end free.
    """
    radius, a1, a2, K, squeeze, reference = RUBBERS[rubber]
    locking, element = element == "locking", "displacement" if element == "locking" else element
    plane = mesh == "plane"
    drawn = read_gmsh(disc.build, radius=radius, depth=None if plane else length, cells=cells, layers=layers)
    body, up = Body(drawn, "disc", mooney_rivlin(a1, a2, K)), "y" if plane else "z"
    section: dict[str, Any] = {"plane": "strain", "thickness": length} if plane else {}
    scene = Scene(body, degree=degree, element=element, accept_locking=locking, **section)
    scene.fix("symmetry_x", "x")
    scene.fix(f"symmetry_{up}", up)
    if not plane:
        scene.fix(("front",) if free_end else ("front", "back"), "y")
    upwards = np.array([float(axis == up) for axis in "xyz"])
    plate = rigid_plane(radius * upwards, -upwards)
    scene.contact("rim", plate, points=points, penalty=Penalty(factor=factor), penetration=penetration or None, name="rim")
    result = solve(
        scene, move={plate: tuple(-squeeze / 2 * upwards)}, out=Output(progress=False), **stepping(method, steps, linear)
    )
    force = -2 * result.history[-1][f"rim_force_{up}_N"] / length if result.history else float("nan")
    return metrics(result, error=abs(force / reference - 1), value=force)


def studies(quick: bool) -> list[Study]:
    return [Study("cylinder", cylinder, expand(*PLANS[quick]), repeats=1 if quick else 3, shared=True)]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """Charts of the rows {study: rows}, and what they say; StudyError where theory is contradicted."""
    mine, keys, (base, panels) = rows["cylinder"], list(BASE), PLANS[quick]
    work_precision(charts / "cylinder.png", mine, base, panels, title=TITLE, parameters=keys, quantity="error of the force")
    return [answer(mine, base, panels, keys)]
