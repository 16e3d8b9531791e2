"""Sharp square punch on a rubber plate with friction: force at 2 mm against the finest run of the same sweep."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import RigidTool, rigid_punch
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import punch_plate
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_rivlin
from fenics_contact.studies.charts import answer, work_precision
from fenics_contact.studies.runner import Panels, Row, Run, Study, expand, metrics, stepping

BASE: Run = {"cells": 10, "degree": 1, "element": "displacement", "friction": 0.3, "points": "nodes", "factor": 100.0,
        "share": 0.1, "penetration": 0.0, "method": "newton", "steps": 5, "linear": "direct", "processes": 1}  # fmt: skip
# as fine as a minute allows, with a penalty whose compliance no longer counts
FINEST: Run = BASE | {"cells": 8, "degree": 2, "factor": 1000.0}
PANELS: Panels = {
    "mesh (cells under the punch), degree and element": {
        "degree 1": {"cells": [4, 6, 8, 10, 14]},
        "degree 1, mixed": {"cells": [4, 6, 10], "element": ["mixed"]},
        "degree 2": {"cells": [3, 4, 6], "degree": [2]},
    },
    "method (number of steps) on 10 cells": {
        "Newton": {"steps": [1, 2, 5, 10]},
        "incremental": {"steps": [10, 20, 40], "method": ["incremental"]},
        "SNES": {"steps": [5], "method": ["snes"]},
        "arc length": {"steps": [5], "method": ["arc_length"]},
    },
    "penalty (factor on E/h) and contact points": {
        "nodes, εT = 0.1 εN": {"factor": [1.0, 10.0, 100.0, 1000.0]},
        "nodes, εT = εN": {"factor": [10.0, 100.0], "share": [1.0]},
        "3 × 3 Gauss points": {"factor": [10.0, 100.0], "points": [3]},
        "nodes, augmented to 1e-4 mm": {"factor": [1.0, 10.0, 100.0], "penetration": [1e-4]},
    },
    "linear solver and processes (cells)": {
        "direct": {"cells": [10, 14]},
        "direct, 2 processes": {"cells": [10], "processes": [2]},
        "iterative": {"cells": [10, 14], "linear": ["iterative"]},
        "iterative, 2 processes": {"cells": [10, 14], "linear": ["iterative"], "processes": [2]},
    },
}
QUICK: Panels = {"all": {"mesh": {"cells": [4, 6]}, "penalty": {"factor": [1.0, 10.0, 100.0], "cells": [4]}}}
PLANS: dict[bool, tuple[Run, Panels]] = {False: (BASE, PANELS), True: (BASE | {"cells": 6}, QUICK)}  # by quick
STATED = Penalty(factor=100.0, share=0.1)
TITLE = "Sharp punch, friction 0.3; baseline: 10 cells of degree 1 under the punch, nodes, penalty 100 E/h, 5 Newton steps"


def punch(
    cells: int,
    degree: int,
    element: str,
    friction: float,
    points: int | str,
    factor: float,
    share: float,
    penetration: float,
    method: str,
    steps: int,
    linear: str,
    fillet: float = 0.0,
) -> Row:
    """Force [N] on a quarter of the plate at 2 mm; the error is taken against the finest run when charts are drawn.

    penetration: largest one [mm] left by multipliers, 0 for the plain penalty.
    """
    numbers = {"points": points, "penalty": Penalty(factor=factor, share=share), "penetration": penetration or None}
    scene, tool = punched_plate(cells, friction, fillet, {"degree": degree, "element": element}, **numbers)
    result = solve(scene, move={tool: (0, 0, -2.0)}, out=Output(progress=False), **stepping(method, steps, linear))
    return metrics(result, value=-result.history[-1]["top_force_z_N"] if result.history else float("nan"))


def punched_plate(
    cells: int,
    friction: float,
    fillet: float = 0.0,
    options: Mapping[str, Any] | None = None,
    **numbers: Any,
) -> tuple[Scene, RigidTool]:
    """Scene of the plate, 40 x 40 x 10 mm on a frictionless floor it cannot leave, and the punch above it. options: of the
    Scene; numbers: words of its contact, by default slave nodes and penalties of 100 E/h and a tenth of that."""
    sizes: dict[str, Any] = {
        "inside": cells,
        "outside": max(2, round(0.8 * cells)),
        "layers": max(2, cells // 2),
        "ratio": 1.1,
    }
    mesh = read_gmsh(punch_plate.build, **sizes)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), **(options or {}))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("bottom", "z")
    tool = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10), fillet=fillet)
    scene.contact("top", tool, friction, name="top", **{"points": "nodes", "penalty": STATED, **numbers})
    return scene, tool


def studies(quick: bool) -> list[Study]:
    runs = expand(*PLANS[quick])
    finest = BASE | {"cells": 8} if quick else FINEST
    fine = [finest | {"cells": finest["cells"] - 2}, finest]
    return [Study("punch", punch, runs, repeats=1 if quick else 3), Study("punch_finest", punch, fine)]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """Charts of the rows {study: rows}, and what they say; StudyError where theory is contradicted."""
    coarser, finest = sorted(rows["punch_finest"], key=lambda row: row["cells"])
    keys, (base, panels) = list(BASE), PLANS[quick]
    mine = [row | {"error": abs(row["value"] / finest["value"] - 1)} for row in rows["punch"]]
    work_precision(charts / "punch.png", mine, base, panels, title=TITLE, parameters=keys, quantity="error of the force")
    apart = abs(coarser["value"] / finest["value"] - 1)
    known = (
        f"reference: {finest['value']:.3f} N with {finest['unknowns']} unknowns; {coarser['unknowns']} give {apart:.2%} else"
    )
    return [f"{known}: a sharp edge is not known better", answer(mine, base, panels, keys)]
