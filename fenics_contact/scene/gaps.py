"""Stages begin where the ones before ended, the first one at rest: what does not is refused, or said."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.scene.courses import Course
from fenics_contact.scene.functions import Path, whole
from fenics_contact.scene.stage import Stage
from fenics_contact.values import SceneError

if TYPE_CHECKING:  # which asks them
    from fenics_contact.scene.scene import Scene

STILL = 1e-9  # of the bodies' size or of the largest load: a start that small is at rest


def refuse_gaps(system: System, stated: Sequence[Stage], loads: Sequence[tuple[str, Path]], started: bool) -> None:
    """Every stage must begin where the one before ended: loads (name, function of t), supports and tools; started: the first
    begins with the state of another run, else rest is a matter of its own. Collective."""
    stages, tools, still = system.stages, system.tools, STILL * system.extent
    for i, stage in enumerate(stated):
        if i == 0 and not started:
            continue
        with stages.foreseen(i):
            start, end = stages.start, stages.time(1.0)
            gaps = [
                (what, path.jump(), STILL * max(np.abs(path.everywhere(t)).max() for t in (start.t, end)))
                for what, path in loads
                if isinstance(path, Course)
            ]
            gaps += [(f"prescribed displacement of {name}", gap, still) for name, gap in system.supports.entries.jumps()]
            moves = np.abs(tools.prescribed(start.t) - np.where(tools.free, 0.0, start.q))
            pushes = np.abs(tools.forces(start.t) - np.where(tools.free, start.forces, 0.0)) * (i == 0)  # else not yet known
            allowed = STILL * np.abs(tools.forces(end)).max(initial=0.0)
            for k, name in enumerate(tools.names):
                gaps += [(f"move of '{name}'", moves[k, :3].max(), still), (f"push of '{name}'", pushes[k].max(), allowed)]
                gaps += [(f"rotation of '{name}'", moves[k, 3:].max() / tools.lever, STILL)]
        for what, gap, most in gaps:
            if (gap := max(system.comm.allgather(float(gap)))) > most:
                raise SceneError(
                    stage.says(f"{what} starts {gap:.3g} away from where the stage before ends; let its function of s ")
                    + "start there, a motion's from 0 and a load's from the value reached, or give a number"
                )


def refuse_jumps(scene: "Scene", system: System, loads: Sequence[tuple[str, Path]]) -> list[str]:
    """Supports and tools must start from rest; returns what is to be said of loads (name, function of t) that do not.
    Collective."""
    still, comm = STILL * system.extent, scene.mesh.comm
    for name, size in system.supports.entries.largest(0.0):
        if (size := max(comm.allgather(size))) > still:
            raise SceneError(
                f"prescribed displacement of {name} is {size:.3g} at t = 0, where all is at rest; let its function start "
                "from 0, e.g. multiply it by t"
            )
    for tool, q in zip(scene.tools, system.tools.prescribed(0.0), strict=True):
        if np.abs(q).max() > still:
            way = q[:3] if np.abs(q[:3]).max() > still else q[3:] / system.tools.lever
            raise SceneError(
                f"move of '{tool.name}' is {way} at t = 0, where all is at rest; let its function start from 0, and "
                "state the tool in the place where it starts"
            )
    notes = []
    for what, path in loads:
        first = path.jump() if isinstance(path, Course) else float(np.abs(path(0.0)).max())
        if first > STILL * max(float(np.abs(whole(path, t)).max()) for t in (0.5, 1.0)):
            notes.append(
                f"{what} is {first:.3g} at t = 0 already: the first step takes it at once; let its function start from 0"
            )
    return notes
