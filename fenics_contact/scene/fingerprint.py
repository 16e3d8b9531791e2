"""What a scene and its drive state, as plain values by name: a state means the same only where all of them are the same."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.agreement import agreed
from fenics_contact.scene.build import Built
from fenics_contact.scene.functions import row_of, sample
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import Stage
from fenics_contact.scene.stated import Statement, first_difference, parts_of, plain
from fenics_contact.values import SceneError, is_number, shown

TIMES = (0.0, 0.3, 0.5, 0.7, 1.0)  # shares at which a stage is sampled, and as many between 1 and the largest reached


def statement(
    scene: Scene, built: Built, stated: Sequence[Stage], recorded: Iterable[str], reached: Sequence[float] = (1.0,)
) -> Statement:
    """{name: text, number or list of these}; reached: of each stage begun, the largest share so far, 1 at least. Collective:
    the user's functions are asked on all ranks, beyond s = 1 nowhere that the run has not been: there they need not be
    defined. Of stages that have not begun nothing is said: they may still be changed."""
    system, comm = built.system, built.system.comm
    out: Statement = {
        "degree": scene.degree,
        "element": scene.element,
        "units": list(vars(scene.units).values()),
        "cells": compat.cell_map(scene.mesh.domain).size_global,
        "section": list(vars(scene.section).values()) if scene.section else "none",
        "stabilise": system.stabilised,
        "damping": system.damped,
        "record": sorted(recorded),
        "supported unknowns": comm.allreduce(len(system.supports.owned)),
        "start": built.start,
    }
    for i, (stage, largest) in enumerate(zip(stated, reached, strict=False)):
        with system.stages.foreseen(i):
            driven = {"method": stage.method, "duration": float(stage.duration)} | _driven(built, largest)
        out |= {stage.says(name): value for name, value in driven.items()} | {f"stage {i + 1}": stage.name}
    return out | parts_of(scene, system)


def stages_told(stated: Sequence[Stage]) -> Statement:
    """How many stages there are, and how each is called and goes on."""
    out: Statement = {"the number of stages": len(stated)}
    for i, stage in enumerate(stated):
        out |= {f"stage {i + 1}": stage.name, f"method of stage {i + 1}": str(stage.method)}
        if is_number(stage.steps) or isinstance(stage.steps, list | tuple | np.ndarray):
            out[f"steps of stage {i + 1}"] = shown(stage.steps)
    return out


def _driven(built: Built, reached: float) -> Statement:
    """What the stage that is on states of supports, loads and tools, sampled. Collective."""
    system, stages = built.system, built.system.stages
    shares = TIMES + tuple(1.0 + s * (reached - 1.0) for s in TIMES[1:] if reached > 1.0)
    times = [stages.time(s) for s in shares]

    def sampled(path: Callable[[float], Any]) -> list[float]:
        return np.ravel([sample(path, t) for t in times]).astype(float).tolist()

    out: Statement = {f"support of {name}": samples for name, samples in system.supports.entries.sampled(times).items()}
    for name, path in built.driven:
        out[name] = out.get(name, []) + sampled(path)
    for i, name in enumerate(system.tools.names):
        out[f"move of '{name}'"] = sampled(row_of(system.tools.prescribed, i))
        out[f"free components of '{name}'"] = plain(system.tools.free[i])
    return out


def refuse_unlike(comm: MPI.Comm, here: Statement) -> None:
    """Every rank states the same. SceneError, on all ranks, where one does not. Collective."""
    there = comm.bcast(here)
    with agreed(comm, "what a rank states", SceneError):
        if found := first_difference(there, here):
            name, first, mine = found
            raise SceneError(
                f"{name} is {first} on rank 0 and {mine} on rank {comm.rank}: all ranks must state the same scene; take no "
                "number from the part of the mesh that a rank holds"
            )
