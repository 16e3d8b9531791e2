"""No more than a scene needs: what symmetry, rigid tools, plane strain and a symmetric solver save, and what they cost."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from petsc4py import PETSc

from fenics_contact.contact.tools import Tool, rigid_punch
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import box, two_blocks
from fenics_contact.options import Method, Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.scene.tool_mesh import rigid_surface
from fenics_contact.solid.materials import from_elastic, mooney_rivlin
from fenics_contact.studies import cylinder as cylinders
from fenics_contact.studies.charts import savings
from fenics_contact.studies.runner import Row, Run, Study, metrics

# a rubber plate bonded to the ground, of which a quarter is 40 x 40 x 10 mm, under a punch of 40 x 40 mm
BASE: Run = {"model": "quarter", "tool": "analytic", "slave": "top", "friction": 0.3, "points": 3, "fillet": 0.0,
        "solver": "lu", "cells": 16}  # fmt: skip
SMOOTH: Run = BASE | {"friction": 0.0, "fillet": 5.0}  # two cells: its tangent is symmetric
SLAB: Run = cylinders.BASE | {"layers": 8, "length": 20.0, "free_end": False}
LAYER: Run = SLAB | {"layers": 1, "length": 2.5}
PLANE: Run = LAYER | {"mesh": "plane"}
FREE: Run = SLAB | {"layers": 12, "length": 40.0, "free_end": True}
PAIRS: dict[str, tuple[Run, Run]] = {
    "a quarter instead of the whole plate": (BASE | {"model": "whole"}, BASE),
    "analytic punch instead of a meshed rigid one": (BASE | {"tool": "meshed"}, BASE),
    "analytic punch instead of a stiff body": (BASE | {"tool": "stiff body"}, BASE),
    "contact on the top only, not on all free faces": (BASE | {"slave": "all"}, BASE),
    "slave nodes instead of 3 × 3 Gauss points": (BASE, BASE | {"points": "nodes"}),
    "symmetric instead of unsymmetric factorisation (μ = 0)": (SMOOTH, SMOOTH | {"solver": "auto"}),
    "plane strain layer instead of a held slab, 8 layers": (SLAB, LAYER),
    "plane strain layer instead of a free cylinder, L = 4R": (FREE, LAYER),
    "plane mesh instead of a plane strain layer": (LAYER, PLANE),
}
STIFFER = 1000.0  # times the rubber's Young's modulus: a body that stands for a rigid one


def plate(
    model: str, tool: str, slave: str, friction: float, points: int | str, fillet: float, solver: str, cells: int
) -> Row:
    """Force [N] on a quarter at 2 mm of travel in five steps."""
    rubber = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
    size = 80.0 if model == "whole" else 40.0
    across = (cells * round(size / 40.0),) * 2 + (max(2, cells // 4),)
    master: str | Tool
    surfaces: dict[str, str | tuple[str, ...]]
    move: dict[Tool, tuple[float, float, float]] = {}
    if tool == "stiff body":
        half = (cells // 2,) * 2 + (cells // 4,)
        mesh = read_gmsh(two_blocks.build, lower_cells=across, upper=(20.0, 20.0, 10.0), upper_cells=half,
                         upper_origin=(0.0, 0.0, 0.0))  # fmt: skip
        stiff = from_elastic(STIFFER * 3 * rubber.shear_modulus, 0.3)
        scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", stiff))
        _hold(scene, "lower_", "bottom")
        _hold(scene, "upper_", None)
        scene.fix("upper_top", "xy")
        scene.prescribe("upper_top", "z", -2.0)
        master, surfaces = "upper_bottom", {"top": "lower_top"}
    else:
        corner = -size / 2 if model == "whole" else 0.0
        mesh = read_gmsh(box.build, size=(size, size, 10.0), cells=across, origin=(corner, corner, -10.0))
        scene = Scene(Body(mesh, "box", rubber))
        _hold(scene, "", "zmin", symmetric=model == "quarter")
        if tool == "meshed":
            face: dict[str, Any] = {"size": (20.0, 20.0, 10.0), "cells": (cells // 2, cells // 2, 1)}
            rigid: Tool = rigid_surface(box.build, "zmin", name="punch", flip=True, **face)
        else:
            rigid = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 0), fillet=fillet)
        sides = ("xmax", "ymax") if model == "quarter" else ("xmin", "xmax", "ymin", "ymax")
        master, move[rigid] = rigid, (0, 0, -2.0)
        surfaces = {"top": "zmax", "all": ("zmax", *sides)}
    scene.contact(surfaces[slave], master, friction, points=points, name="top")
    options = PETSc.Options()
    if solver != "auto":
        options["fc_pc_type"] = solver
    try:
        result = solve(scene, move=move, steps=5, method=Method(linear="direct"), out=Output(progress=False))
    finally:
        options.delValue("fc_pc_type")
    force = abs(result.history[-1]["top_force_z_N"]) if result.history else float("nan")
    return metrics(result, value=force / (4.0 if model == "whole" else 1.0))


def _hold(scene: Scene, name: str, bottom: str | None, symmetric: bool = True) -> None:
    """Symmetry planes of a quarter, and a bonded bottom."""
    for axis in "xy" * symmetric:
        scene.fix(f"{name}{axis}min", axis)
    if bottom:
        scene.fix(f"{name}{bottom}")


def studies(quick: bool) -> list[Study]:
    runs = [run for pair in PAIRS.values() for run in pair]
    plates = [run | ({"cells": 4} if quick else {}) for run in runs if "model" in run]
    slabs = [run | ({"cells": 4} if quick else {}) for run in runs if "rubber" in run]
    unique = [[run for i, run in enumerate(group) if run not in group[:i]] for group in (plates, slabs)]
    functions: list[Callable[..., Row]] = [plate, cylinders.cylinder]
    cases = zip(("economy_plate", "economy_cylinder"), functions, unique, strict=True)
    return [Study(name, case, group, repeats=1 if quick else 3) for name, case, group in cases]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """Charts of the rows {study: rows}, and what they say."""
    mine = [row for study in rows.values() for row in study]
    pairs = {words: tuple(run | ({"cells": 4} if quick else {}) for run in pair) for words, pair in PAIRS.items()}
    keys = list(dict.fromkeys([*BASE, *SLAB]))
    return savings(charts / "economy.png", mine, pairs, keys, "What each economy saves and costs")
