"""Inflated rubber sphere against its exact radial solution: the paper's first example, at 19 mm of displacement."""

from collections.abc import Callable
from pathlib import Path

from fenics_contact import compat
from fenics_contact.assembly.term import State
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import sphere_shell
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_paper
from fenics_contact.studies.charts import answer, hold_slope, medians, work_precision
from fenics_contact.studies.exact import A1, A2, Radial
from fenics_contact.studies.runner import Panels, Row, Run, Study, expand, metrics, of_curve, stepping

RADIUS, WALL, K = 95.0, 1.0, 5.0  # mm, mm, MPa
REACH = 19.0  # mm, at 87 % of the limit pressure

BASE: Run = {
    "cells": 9,
    "degree": 1,
    "element": "displacement",
    "method": "newton",
    "steps": 4,
    "linear": "direct",
    "processes": 1,
}
PANELS: Panels = {
    "mesh (cells per patch edge), degree and element": {
        "degree 1": {"cells": [3, 6, 9, 12, 15]},
        "degree 1, mixed": {"cells": [3, 6, 9, 12], "element": ["mixed"]},
        "degree 2": {"cells": [3, 6], "degree": [2]},
        "degree 2, mixed": {"cells": [3, 6], "degree": [2], "element": ["mixed"]},
    },
    "method (number of steps) on 9 cells of degree 1": {
        "Newton": {"steps": [2, 4, 8, 16]},
        "incremental": {"steps": [8, 16, 32, 64], "method": ["incremental"]},
        "SNES": {"steps": [4, 8, 16], "method": ["snes"]},
        "arc length": {"steps": [2, 4, 8], "method": ["arc_length"]},
    },
}
QUICK: Panels = {
    "all": {"degree 1": {"cells": [3, 6, 12]}, "incremental": {"steps": [16, 32, 64], "method": ["incremental"]}}
}
PLANS: dict[bool, tuple[Run, Panels]] = {False: (BASE, PANELS), True: (BASE | {"cells": 6}, QUICK)}  # by quick
TITLE = "Inflated sphere, exact solution; baseline: Newton, 4 steps, 9 × 9 × 3 cells of degree 1 in each of 3 patches"


def sphere(cells: int, degree: int, element: str, method: str, steps: int, linear: str, reach: float = REACH) -> Row:
    """Error of the mean radial displacement of the inner points under the pressure that belongs to `reach` [mm]."""
    mesh = read_gmsh(sphere_shell.build, inner=RADIUS, thickness=WALL, cells=cells, layers=max(1, cells // 3))
    scene = Scene(Body(mesh, "shell", mooney_paper(A1, A2, K)), degree=degree, element=element)
    for axis in "xyz":
        scene.fix(f"symmetry_{axis}", axis)
    scene.pressure("inner", Radial("sphere", K).solve((RADIUS, RADIUS + WALL), RADIUS + reach)[0])
    result = solve(scene, out=Output(progress=False), **stepping(method, steps, linear))
    moved = inner_radial(scene)(result.system.state)
    return metrics(result, error=abs(moved / reach - 1), value=moved)


def inner_radial(scene: Scene) -> Callable[[State], float]:
    """Function of the state: mean radial displacement [mm] of the inner points."""
    nodes = compat.locate_blocks(scene.space, scene.mesh.facets("inner"))
    nodes = nodes[nodes < scene.space.dofmap.index_map.size_local]
    outward = scene.space.tabulate_dof_coordinates()[nodes] / RADIUS
    comm = scene.mesh.comm
    count = comm.allreduce(len(nodes))
    return lambda state: comm.allreduce(float((state.u.x.array.reshape(-1, 3)[nodes] * outward).sum())) / count


def studies(quick: bool) -> list[Study]:
    return [Study("sphere", sphere, expand(*PLANS[quick]), repeats=1 if quick else 3)]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """Charts of the rows {study: rows}, and what they say; StudyError where theory is contradicted."""
    mine, keys, (base, panels) = rows["sphere"], list(BASE), PLANS[quick]
    work_precision(
        charts / "sphere.png", mine, base, panels, title=TITLE, parameters=keys, quantity="error of the displacement"
    )
    meshes = medians(of_curve(mine, base, {"cells": [3, 6, 12]}), keys)
    exact = of_curve(mine, base, {})[0]["value"]
    paths = medians(of_curve(mine, base, {"steps": [16, 32, 64], "method": ["incremental"]}), keys)
    return [
        # an integral of a smooth field on hexahedra of degree 1
        hold_slope("displacement over cell size", [1 / r["cells"] for r in meshes], [r["error"] for r in meshes], 2, 0.25),
        # one Newton iteration per step squares a distance of the order of the step: nothing piles up
        hold_slope(
            "incremental scheme over step size",
            [1 / r["steps"] for r in paths],
            [abs(r["value"] / exact - 1) for r in paths],
            2,
            0.35,
        ),
        answer(mine, base, panels, keys),
    ]
