"""What plane scenes cost beside one layer of cells in space, of the same digits: `python3 docs/plane_cost.py`.

CPU seconds within solve(), medians of runs by turns after one that compiles, and their ratio: the figures of docs/plane.md.
"""

import statistics
import time
from collections.abc import Callable
from typing import Any

from fenics_contact import Body, Scene, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box, rectangles
from fenics_contact.studies import cylinder, tubes

RUNS = 3
STEPS = 20


def strip(mesh: str) -> None:
    """A strip of 60 x 15 cells, held below, under a rough lid."""
    if mesh == "plane":
        drawn = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (40.0, 10.0), (60, 15))})
        scene, bottom, top, up = Scene(Body(drawn, "box", neo_hooke(0.5, 5.0)), plane="strain"), "box_ymin", "box_ymax", 1
    else:
        drawn = read_gmsh(box.build, size=(40.0, 1.0, 10.0), cells=(60, 1, 15))
        scene, bottom, top, up = Scene(Body(drawn, "box", neo_hooke(0.5, 5.0))), "zmin", "zmax", 2
        scene.fix("ymin", "y"), scene.fix("ymax", "y")
    scene.fix(bottom)
    place, normal, travel = ([x if axis == up else 0.0 for axis in range(3)] for x in (10.0, -1.0, -2.0))
    travel[0] = 0.2
    lid = rigid_plane(tuple(place), normal=tuple(normal))
    scene.contact(top, lid, friction=0.3)
    timed(scene, move={lid: tuple(travel)}, steps=STEPS, progress=False)


def studied(study: Callable[..., Any], base: dict[str, Any], **changes: Any) -> Callable[[str], Any]:
    """A case of a study, as a function of the mesh."""
    case = {key: value for key, value in base.items() if key != "processes"} | changes
    return lambda mesh: study(**case | {"mesh": mesh})


CASES: dict[str, Callable[[str], Any]] = {"strip, 60 x 15 cells under a rough lid": strip}
CASES |= {f"tubes, {n} cells": studied(tubes.tubes, tubes.BASE, cells=n, points="averages") for n in (12, 24, 48)}
CASES |= {f"cylinder, {n} cells": studied(cylinder.cylinder, cylinder.BASE, cells=n) for n in (4, 8, 16)}
CASES["cylinder, 8 cells, mixed"] = studied(cylinder.cylinder, cylinder.BASE, cells=8, element="mixed", rubber="stiff")
CASES["cylinder, 8 cells, degree 2"] = studied(cylinder.cylinder, cylinder.BASE, cells=8, degree=2)
spent: list[float] = []


def timed(*arguments: Any, **options: Any) -> Any:
    """solve(), its CPU seconds kept."""
    start = time.process_time()
    try:
        return solve(*arguments, **options)
    finally:
        spent.append(time.process_time() - start)


if __name__ == "__main__":
    cylinder.solve = tubes.solve = timed  # type: ignore[assignment]
    for name, case in CASES.items():
        seconds: dict[str, list[float]] = {"plane": [], "layer": []}
        for run in range(RUNS + 1):
            for mesh, taken in seconds.items():
                case(mesh)
                if run:
                    taken.append(spent[-1])
        plane, layer = (statistics.median(taken) for taken in seconds.values())
        print(f"{name}: {plane:.2f} s of {layer:.2f} s: {plane / layer:.2f}", flush=True)
