"""What plane scenes cost beside one layer of cells in space, of the same digits: `python3 docs/plane_cost.py [scene ...]`.

CPU seconds within solve(), medians of runs by turns after one that compiles, and their ratio, then the shares that the
stages of the plane runs have of their time: the figures of docs/plane.md. `tests/test_plane_layers.py` holds the same
scenes to the same digits.
"""

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import gmsh
import numpy as np

from fenics_contact import Body, Output, Scene, from_elastic, mooney_rivlin, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box, cook, ironing, two_cylinders
from fenics_contact.solid import materials
from fenics_contact.studies import cylinder, tubes

RUNS = 5
ENDS = "zmin", "zmax"  # of a box
ALONG_Y = ("ends",)  # of layers whose height is drawn as z
# Mean length of the indenter's sides: a layer as deep as that has as many samples, and surfaces that see one another as far
IRONED = (16 * 1.5 * np.sin(np.arcsin(0.8) / 16) + 12 * 0.15) / 28


def section(
    mesh: str,
    build: Callable[..., None],
    laws: dict[str, Any],
    ends: tuple[str, ...],
    thickness: float,
    element: str = "displacement",
    **sizes: Any,
) -> Scene:
    """Of a "layer" that `build` draws with `sizes`, its `ends` held, or of the "plane" mesh that is its end at z = 0; height
    is y in both. laws: {body: material}; thickness: the layer's [mm]."""

    def draw() -> None:
        build(**sizes)
        if ends == ALONG_Y:
            tags, places, _ = gmsh.model.mesh.getNodes()
            for tag, (x, y, z) in zip(tags, places.reshape(-1, 3), strict=True):
                gmsh.model.mesh.setNode(tag, [x, z, -y], [])
        if mesh == "plane":
            cut()

    drawn = read_gmsh(draw)
    bodies = [Body(drawn, name, law) for name, law in laws.items()]
    if mesh == "plane":
        return Scene(*bodies, element=element, plane="strain", thickness=thickness)
    scene = Scene(*bodies, element=element)
    scene.fix(ends, "z")
    return scene


def cut() -> None:
    """Of the layer in the current model its end at z = 0 is left: faces for bodies, curves for their sides."""
    model = gmsh.model

    def in_plane(dim: int, tag: int) -> bool:
        return bool(np.abs(model.mesh.getNodes(dim, tag, includeBoundary=True)[1][2::3]).max() < 1e-12)

    groups = [
        (dim, model.getPhysicalName(dim, tag), model.getEntitiesForPhysicalGroup(dim, tag))
        for dim, tag in model.getPhysicalGroups()
    ]
    model.removePhysicalGroups()
    for dim, name, tags in groups:
        sides = model.getBoundary([(dim, tag) for tag in tags], combined=False, oriented=False)
        flat = [tag for _, tag in sides if in_plane(dim - 1, tag)]
        if dim == 3 or not any(in_plane(dim, tag) for tag in tags):
            model.setPhysicalName(dim - 1, model.addPhysicalGroup(dim - 1, flat), name)
    model.removeEntities([(3, tag) for _, tag in model.getEntities(3)])
    model.removeEntities([(2, tag) for _, tag in model.getEntities(2) if not in_plane(2, tag)])


def strip(mesh: str, **options: Any) -> Any:
    """A strip of 60 x 15 cells, held below, under a rough lid."""
    law = {"box": neo_hooke(0.5, 5.0)}
    scene = section(mesh, box.build, law, ENDS, 1.0, size=(40.0, 10.0, 1.0), cells=(60, 15, 1))
    scene.fix("ymin")
    lid = rigid_plane((0.0, 10.0, 0.0), normal=(0.0, -1.0, 0.0))
    scene.contact("ymax", lid, friction=0.3)
    return timed(scene, move={lid: (0.2, -2.0, 0.0)}, steps=20, **options)


def membrane(mesh: str, **options: Any) -> Any:
    """Cook's, of 32 x 32 mixed cells."""
    law = {"membrane": neo_hooke(0.4225, 0.91542, volumetric=materials.barrier)}
    scene = section(mesh, cook.build, law, ("front", "back"), 1.0, "mixed", cells=32)
    scene.fix("left")
    scene.traction("right", (0.0, 0.0625, 0.0))
    return timed(scene, steps=1, **options)


def block(mesh: str, **options: Any) -> Any:
    """A quarter of a block between two rough plates."""
    law = {"box": mooney_rivlin(0.1863, 0.0098, 5.0)}
    scene = section(mesh, box.build, law, ENDS, 0.25, size=(10.0, 5.0, 0.25), cells=(40, 20, 1))
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    plate = rigid_plane((0.0, 5.0, 0.0), (0.0, -1.0, 0.0))
    scene.contact("ymax", plate, 0.1)
    return timed(scene, move={plate: (0.0, -0.25, 0.0)}, steps=4, **options)


def greco(mesh: str, **options: Any) -> Any:
    """A plate pressed on a rough floor and pushed from the side: it sticks, slips and lifts."""
    law, deep = {"box": from_elastic(1.3e5, 0.2)}, 40.0 / 48
    scene = section(mesh, box.build, law, ENDS, deep, size=(40.0, 40.0, deep), cells=(48, 48, 1))
    scene.fix("xmax", "x")
    scene.traction("ymax", (0.0, -50.0, 0.0))
    scene.traction("xmin", (150.0, 0.0, 0.0))
    scene.contact("ymin", rigid_plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), friction=1.0)
    return timed(scene, steps=4, **options)


def cattaneo(mesh: str, **options: Any) -> Any:
    """Two cylinders, pressed and then drawn: they slip in part."""
    laws = dict.fromkeys(("lower", "upper"), from_elastic(200.0, 0.3))
    scene = section(mesh, two_cylinders.build, laws, ALONG_Y, 0.1, radius=8.0, fine=0.16, cells=36, depth=0.1)
    scene.fix("lower_axis", "xy")
    scene.prescribe("upper_axis", "x", lambda X, t: np.full(len(X), 0.0011 * max(2 * t - 1, 0.0)))
    scene.prescribe("upper_axis", "y", lambda X, t: np.full(len(X), -0.0074 * min(2 * t, 1.0)))
    scene.contact("upper_rim", "lower_rim", 0.2)
    return timed(scene, steps=4, **options)


def ironed(mesh: str, **options: Any) -> Any:
    """A stiff indenter pressed into a block and drawn over it."""
    laws = {"foundation": from_elastic(689.6, 0.32), "indenter": from_elastic(6896.0, 0.32)}
    scene = section(mesh, ironing.build, laws, ALONG_Y, IRONED, depth=IRONED, foundation=(96, 8))
    scene.fix("foundation_bottom", "xy")
    scene.prescribe("indenter_top", "x", lambda X, t: np.full(len(X), 0.5 * max(2 * t - 1, 0.0)))
    scene.prescribe("indenter_top", "y", lambda X, t: np.full(len(X), -min(2 * t, 1.0)))
    scene.contact("foundation_top", ("indenter_under", "indenter_flanks"), 0.3)
    return timed(scene, steps=20, **options)


def studied(study: Callable[..., Any], base: dict[str, Any], **changes: Any) -> Callable[[str], Any]:
    """A case of a study, as a function of the mesh."""
    case = {key: value for key, value in base.items() if key != "processes"} | changes
    return lambda mesh: study(**case | {"mesh": mesh})


CASES: dict[str, Callable[..., Any]] = {
    "strip, 60 x 15 cells under a rough lid": strip,
    "Cook's membrane, 32 cells, mixed": membrane,
    "block between rough plates, 40 x 20 cells": block,
    "GRECO plate, 48 x 48 cells": greco,
    "Cattaneo's cylinders": cattaneo,
    "ironing": ironed,
}
CASES |= {f"tubes, {n} cells": studied(tubes.tubes, tubes.BASE, cells=n, points="averages") for n in (12, 24, 48)}
CASES |= {f"cylinder, {n} cells": studied(cylinder.cylinder, cylinder.BASE, cells=n) for n in (4, 8, 16)}
CASES["cylinder, 8 cells, mixed"] = studied(cylinder.cylinder, cylinder.BASE, cells=8, element="mixed", rubber="stiff")
CASES["cylinder, 8 cells, degree 2"] = studied(cylinder.cylinder, cylinder.BASE, cells=8, degree=2)
# What summary.json tells apart, put together
STAGES = {
    "linear solves": ("factorisation", "solve"),
    "bulk tangent": ("bulk tangent",),
    "residual": ("residual",),
    "contact": ("search", "projection", "contact kernel", "insertion"),
    "measures": ("output", "cells", "penalty error"),
    "forms": ("compile",),
}
spent: list[float] = []
told: list[dict[str, float]] = []  # seconds by stage


def timed(*arguments: Any, **options: Any) -> Any:
    """solve(), its CPU seconds kept."""
    start = time.process_time()
    result = solve(*arguments, **{"out": Output(progress=False)} | options)
    spent.append(time.process_time() - start)
    told.append(result.summary["seconds"])
    return result


def main(chosen: list[str]) -> None:
    cylinder.solve = tubes.solve = timed  # type: ignore[assignment]
    for name, case in CASES.items():
        if chosen and not any(word in name for word in chosen):
            continue
        seconds: dict[str, list[float]] = {"plane": [], "layer": []}
        shares: list[list[float]] = []
        for run in range(RUNS + 1):
            for mesh, taken in seconds.items():
                case(mesh)
                if run:
                    taken.append(spent[-1])
                if run and mesh == "plane":
                    shares.append([sum(told[-1][stage] for stage in of) / told[-1]["total"] for of in STAGES.values()])
        plane, layer = (statistics.median(taken) for taken in seconds.values())
        print(f"{name}: {plane:.2f} s of {layer:.2f} s: {plane / layer:.2f}", flush=True)
        parts = zip(STAGES, (statistics.median(of) for of in zip(*shares, strict=True)), strict=True)
        print("   ", ", ".join(f"{stage} {share:.0%}" for stage, share in parts), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
