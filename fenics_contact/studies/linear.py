"""Which linear solver a run takes by itself: 24 scenes by `auto`, by factorisations and by multigrid alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fenics_contact.contact.tools import rigid_plane, rigid_punch
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import box, graded_rectangle, two_blocks
from fenics_contact.options import Method, Output
from fenics_contact.result import Result
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import Isotropic, mooney_rivlin
from fenics_contact.studies.charts import medians
from fenics_contact.studies.runner import Row, Run, Study, metrics
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH

LINEAR = ("auto", "direct", "iterative")
BOUND = 1.2  # of the better one's time: what `auto` may take
STEPS = 3
SCENES: list[Run] = [
    {"scene": scene, "cells": cells, "degree": degree, "ratio": ratio, "processes": processes}
    for scene, degree, ratio, processes, sizes in (
        ("punch", 1, 10, 1, (12, 24, 40)),  # 2 028 ... 55 473 unknowns
        ("punch", 1, 500, 1, (12, 24)),
        ("punch", 2, 10, 1, (8, 16)),
        ("punch", 2, 500, 1, (8, 16)),
        ("stuck cube", 1, 10, 1, (10, 20)),
        ("stuck cube", 2, 10, 1, (6, 10)),
        ("stuck cube", 2, 500, 1, (6,)),
        ("blocks", 1, 10, 1, (2, 3, 4)),
        ("blocks", 2, 10, 1, (1, 2)),
        ("plane", 1, 10, 1, (64,)),
        ("plane", 2, 500, 1, (32,)),
        ("punch", 1, 10, 2, (24, 40)),
        ("blocks", 1, 10, 2, (4,)),
    )
    for cells in sizes
]  # fmt: skip
QUICK: list[Run] = [SCENES[0] | {"cells": 4}]


def linear(scene: str, cells: int, degree: int, ratio: float, solver: str) -> Row:
    """Time of three steps; ratio: K/mu, by mixed elements above 100; value: the contact's force [N]."""
    rubber, element = mooney_rivlin(a1=0.1863, a2=0.0098, K=0.3922 * ratio), "mixed" if ratio > 100 else "displacement"
    case, least = CASES[scene]
    case(least, {"degree": degree, "element": element}, rubber, "auto")  # loads, or compiles, what such scenes need
    result = case(cells, {"degree": degree, "element": element}, rubber, solver)
    last = result.history[-1] if result.history else {}
    forces = [last.get(f"c_force_{axis}_N", 0.0) for axis in "xyz"]
    return metrics(result, value=float(np.linalg.norm(forces)))


def punch(cells: int, cell: Run, rubber: Isotropic, solver: str) -> Result:
    """A quarter of a plate under a rough punch, which slides on its top."""
    mesh = read_gmsh(box.build, size=(40.0, 40.0, 10.0), cells=(cells, cells, cells // 4), origin=(0.0, 0.0, -10.0))
    scene = Scene(Body(mesh, "box", rubber), **cell)
    for side, axes in (("xmin", "x"), ("ymin", "y"), ("zmin", "xyz")):
        scene.fix(side, axes)
    tool = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 0), fillet=5.0)
    scene.contact("zmax", tool, 0.3, name="c")
    return solve(
        scene, move={tool: (0, 0, -0.2 * STEPS)}, steps=STEPS, method=Method(linear=solver), out=Output(progress=False)
    )


def cube(cells: int, cell: Run, rubber: Isotropic, solver: str) -> Result:
    """A cube pressed between a bonded plate and one so rough that it sticks."""
    mesh = read_gmsh(box.build, size=(20.0, 20.0, 20.0), cells=(cells, cells, cells), origin=(0.0, 0.0, -20.0))
    scene = Scene(Body(mesh, "box", rubber), **cell)
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 0), (0, 0, -1), name="plate")
    scene.contact("zmax", plate, 1.5, name="c")
    return solve(scene, move={plate: (1.0, 0, -2.0)}, steps=STEPS, method=Method(linear=solver), out=Output(progress=False))


def blocks(cells: int, cell: Run, rubber: Isotropic, solver: str) -> Result:
    """A block pressed on another one and dragged along it."""
    lower, upper = (8 * cells, 8 * cells, 2 * cells), (5 * cells, 5 * cells, 2 * cells)
    mesh = read_gmsh(two_blocks.build, lower_cells=lower, upper_cells=upper)
    scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber), **cell)
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "x", 1.5)
    scene.prescribe("upper_top", "z", -1.5)
    scene.contact("upper_bottom", "lower_top", 0.3, name="c")
    return solve(scene, steps=STEPS, method=Method(linear=solver), out=Output(progress=False))


def plane(cells: int, cell: Run, rubber: Isotropic, solver: str) -> Result:
    """A strip of the plane under a rough punch."""
    mesh = read_gmsh(
        graded_rectangle.build, width=40.0, height=20.0, mesh_size=40.0 / (2 * cells), at=20.0, fine=40.0, growth=1.0
    )
    scene = Scene(Body(mesh, "block", rubber), plane="strain", **cell)
    scene.fix("block_ymin")
    tool = rigid_punch(half_width=8.0, height=10.0, face=(20, 0, 0), direction=(0, -1, 0), fillet=3.0)
    scene.contact("block_ymax", tool, 0.3, name="c")
    return solve(scene, move={tool: (1.0, -2.0, 0)}, steps=STEPS, method=Method(linear=solver), out=Output(progress=False))


CASES: dict[str, tuple[Callable[[int, Run, Isotropic, str], Result], int]] = {  # and the fewest cells
    "punch": (punch, 4),
    "stuck cube": (cube, 2),
    "blocks": (blocks, 1),
    "plane": (plane, 8),
}


def studies(quick: bool) -> list[Study]:
    runs = [run | {"solver": solver} for run in (QUICK if quick else SCENES) for solver in LINEAR]
    return [Study("linear", linear, runs, limit=150.0)]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """The chart: the time of each scene by either and by `auto` over that of the better one; and what it says."""
    found = medians(rows["linear"], [*SCENES[0], "solver"])
    scenes = QUICK if quick else SCENES
    figure = Figure(figsize=(WIDTH, 1.2 + 0.27 * len(scenes)), layout="constrained")
    axis = figure.add_subplot(xscale="log")
    labels, over = [], {}
    for place, run in enumerate(reversed(scenes)):
        own = {row["solver"]: row for row in found if all(row[key] == run[key] for key in run)}
        seconds = {name: row["seconds"] if row["converged"] is True else np.inf for name, row in own.items()}
        best = min(seconds["direct"], seconds["iterative"])
        kind, size = f"{run['scene']}, degree {run['degree']}, K/μ {run['ratio']}", own["auto"].get("unknowns", "?")
        labels.append(f"{kind}, {size} unknowns" + ", 2 processes" * (run["processes"] > 1))
        over[labels[-1]] = seconds["auto"] / best if np.isfinite(best) else np.nan  # none of them ended
        for name, mark, colour in (("direct", "s", "C0"), ("iterative", "o", "C2"), ("auto", "D", "C1")):
            if np.isfinite(seconds[name]):
                axis.plot(seconds[name] / best, place, mark, color=colour, markersize=4, label=name if place == 0 else None)
    axis.axvline(BOUND, color="grey", linewidth=0.8, linestyle=":")
    axis.set_yticks(range(len(labels)), labels, fontsize=LETTERS - 1)
    axis.set_xlabel("time over the better one's", fontsize=LETTERS)
    axis.tick_params(axis="x", labelsize=LETTERS)
    axis.legend(fontsize=LETTERS, loc="lower right")
    figure.savefig(charts / "linear.png", dpi=DOTS)
    kept = sum(ratio <= BOUND for ratio in over.values())
    words = f"auto within {BOUND:g} times the better one's time in {kept} of {len(over)} scenes"
    worst = max(over, key=lambda label: np.nan_to_num(over[label], nan=np.inf))
    return [f"{words}; at most {over[worst]:.2f} times: {worst}"]
