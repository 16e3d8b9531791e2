"""solve(scene, ...): run a scene along its load path and keep what it gave."""

import sys
from collections.abc import Mapping
from functools import partial
from os import PathLike
from typing import Any

import numpy as np
from tqdm import tqdm

from fenics_contact import compat
from fenics_contact.agreement import ends_together
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import ContactTerm
from fenics_contact.contact.tools import Tool
from fenics_contact.options import Steps, arc_steps, checkpoint_steps, load_times, refuse_shares
from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.history import (
    Summary,
    energy_line,
    energy_notes,
    energy_summary,
    limit_points,
    penalty_lines,
    penalty_notes,
    penalty_summary,
    stages_line,
)
from fenics_contact.output.units import Units
from fenics_contact.recording import Recorded, Recorder, columns_of
from fenics_contact.restart import Keeper, results_folder
from fenics_contact.result import Result
from fenics_contact.scene.build import Built, build
from fenics_contact.scene.drives import Moves, turning
from fenics_contact.scene.fingerprint import statement
from fenics_contact.scene.functions import Drive
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.targets import distances
from fenics_contact.solvers.arc_length import ArcLength, depends_on_load
from fenics_contact.solvers.augmented import Adapted, Augmented
from fenics_contact.solvers.continuation import Path
from fenics_contact.solvers.control import run
from fenics_contact.solvers.entering import Entering
from fenics_contact.solvers.held import Following, Held
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Incremental, Newton
from fenics_contact.solvers.penalty_error import penalty_error
from fenics_contact.solvers.report import Stepper
from fenics_contact.solvers.snes import Snes
from fenics_contact.solvers.softened import Softened
from fenics_contact.solvers.verdict import Verdict
from fenics_contact.timing import Timers
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, shown

STEPPERS = {"newton": Newton, "incremental": Incremental, "snes": Snes, "arc_length": ArcLength}


@ends_together
def solve(
    scene: Scene,
    move: Moves | None = None,
    push: Mapping[Tool, Drive] | None = None,
    steps: Steps = 10,
    out: str | PathLike[str] | None = None,
    method: str = "newton",
    linear: str = "auto",
    tolerance: float | None = None,
    progress: bool = True,
    checkpoint: bool | int = False,
    resume: bool = False,
    overwrite: bool = False,
    smallest_step: float | None = None,
    until: object = None,
    back: object = None,
    record: Recorded | None = None,
    stabilise: bool = False,
    damping: bool = False,
) -> Result:
    """Carry a scene from t = 0 to t = 1, or by continuation until a target is reached.

    move: {tool: travel (3,) at t = 1 [length], or a function of t, or a Motion with rotations and loads}; push: {tool: force
    (3,) at t = 1 [force], or a function of t}; steps: number of equal load steps, or the increasing list of their t; out:
    folder for history.csv, summary.json, results.pvd and body.png; method: "newton", "incremental" (one solve per step, the
    paper's), "snes" or "arc_length"; linear: "auto", "direct" or "iterative"; tolerance: out-of-balance share at which a
    step counts as converged (1e-8); smallest_step: share of the load below which a step is not cut (1e-4 of the schedule's
    shortest step); record: {name: function of a View -> number}, columns added to the history, called on all ranks, which
    must agree on it; or a Film, which draws every step.

    stabilise: hold bodies and pushed tools that nothing holds yet by soft springs, which let go before a step is accepted.

    damping: where shorter steps do not help the load path jumps (a snap, a contact that lets go): loads and drives are held
    and viscous forces carry the bodies to rest; their work is in the history's damping_work and in the verdict's notes.

    checkpoint: keep every accepted step (True) or every n-th (n) in `out`, complete whenever the run is killed; resume: go
    on from the last checkpoint in `out`, where there is one, on any number of ranks. A continuation's holds, beside the
    state and the history of its contacts, the last increment, the path's direction, the arc that is due and the leg. A
    checkpoint of another statement is refused, as are damaged ones. overwrite: replace the results of an earlier run in
    `out`, which otherwise is refused.

    method="arc_length" follows the equilibrium path through its limit points, t being an unknown that may pass 1 or fall.
    until: where it ends, the last step landing there: Load(t), Displacement(surface, axis, value), Travel(tool, axis,
    value), a function of the state that changes its sign there, or a list of these, of which the first reached counts;
    back: the same for a way back along the path, with friction another one; steps: ArcSteps, or a number whose inverse is
    the first step's load increment.

    Raises SceneError on all ranks before any solve where the statement is wrong. A step that fails is cut back; a run that
    cannot go on returns with result.converged False and the reason in result.verdict.reason.
    """
    timers = Timers()
    if method not in list(STEPPERS):
        raise SceneError(f"method {shown(method)} is not one of {', '.join(STEPPERS)}")
    continuation = method == "arc_length"
    arcs = arc_steps(steps, until, back, continuation)
    every = checkpoint_steps(checkpoint, resume, out)
    refuse_shares(method, tolerance, smallest_step)
    times = np.array([0.5, 1.0]) if continuation else load_times(steps)
    columns = columns_of(record or {}, scene, turning(move))
    extra = record or {}
    if out is not None and not isinstance(out, str | PathLike):
        raise SceneError(f"out = {shown(out)} must be the path of a folder")
    folder = results_folder(out, scene.mesh.comm, overwrite, resume) if out is not None else None
    built = build(scene, move, push, timers, stabilise, damping)
    system = built.system
    _refuse_nan(system, times)
    legs = [distances(end, scene, system) for end in (until, back) if end is not None]
    if continuation and not depends_on_load(system):
        raise SceneError("arc length without a load to scale: nothing depends on t; state a load, or move or push a tool")
    solver = LinearSolver(system, linear, afresh=continuation)
    plain, softened, stepper = _stepper(method, solver, tolerance, built)
    path = None
    if isinstance(plain, ArcLength) and arcs:
        path = Path(system, plain, stepper, arcs, legs, distances(list(arcs.stations), scene, system))
    stated = partial(statement, scene, system, method, extra)
    keeper = Keeper(folder, system, path, softened, stated, every, resume) if every and folder else None
    kept = Recorder(scene, built, folder, keeper, (columns, extra), continuation, progress)
    setup = timers.table()["total"]
    verdict = kept.verdict
    kept.remark([*scene.notes, *built.notes])
    if path:
        path.follow(kept, verdict)
    else:
        run(system, stepper, times, kept, smallest_step, verdict)
    kept.bar.close()
    if verdict.converged:
        kept.remark([note for contact in system.contacts if (note := contact.never_met(system.state))])
    summary = _summary(scene, system, solver, method, verdict, kept.history)
    with timers("penalty error"):
        error = penalty_error(system, solver) if verdict.converged else None
    travel = {tool.name: system.state.travel[i] for i, tool in enumerate(scene.tools)}
    summary["penalty_error"] = penalty_summary(error, list(travel), scene.units)
    kept.remark(penalty_notes(summary["penalty_error"], travel, scene.units))
    summary["energy"] = energy_summary(kept.history, scene.units)
    kept.remark(energy_notes(summary["energy"], len(kept.history), scene.units) if verdict.converged else [])
    summary["seconds_before_first_step"], summary["seconds"] = setup, timers.table()
    if kept.writer:
        kept.writer.finish(summary)
    if progress and system.comm.rank == 0:
        lines = penalty_lines(summary["penalty_error"], scene.units)
        lines += [energy_line(kept.results.energies, scene.units), stages_line(summary["seconds"])]
        if verdict.residuals:
            falls = " ".join(f"{residual:.0e}" for residual in verdict.residuals[-1])
            lines.insert(0, f"out of balance in the last step, after each tangent: {falls} of the force")
        tqdm.write("\n".join(lines), file=sys.stderr)
    return Result(kept.history, verdict, system, summary, scene, kept.results, [*columns.all(), *extra])


def _refuse_nan(system: System, times: Floats) -> None:
    """Paths, forces and supports given as functions check themselves: once at every t the run will visit."""
    for t in times:
        system.tools.prescribed(t), system.tools.forces(t), system.set_loads(t), system.supports.values(t)
    system.set_loads(0.0)


def _stepper(
    method: str, solver: LinearSolver, tolerance: float | None, built: Built
) -> tuple[ArcLength | Stepper, Softened | None, Any]:
    """The method's stepper, Newton's with softer penalties where these help, and all that with what corrects its states."""
    system = built.system
    options = {} if tolerance is None or method == "incremental" else {"tolerance": tolerance}
    plain = STEPPERS[method](solver, **options)
    steady = not isinstance(plain, ArcLength | Incremental)
    if system.stabilised and not steady:
        raise SceneError(
            f"stabilise= needs steps that end in balance, method 'newton' or 'snes', not '{method}'; leave it out, or "
            "choose one of these"
        )
    if system.damping and not steady:
        raise SceneError(
            f"damping= belongs to methods 'newton' and 'snes', not '{method}'; leave it out, or choose one of these"
        )
    if built.fluids and not steady:
        raise SceneError(
            f"pressure with where=\"open\" needs steps that end in balance, method 'newton' or 'snes', not '{method}'; "
            "choose one of these, or leave where= out"
        )
    softened = Softened(plain) if isinstance(plain, Newton) else None
    stepper = softened or plain
    stepper = Augmented(stepper) if system.augmented else stepper
    stepper = Entering(stepper, built.fluids) if built.fluids else stepper
    springs = system.grounding if steady else None
    return plain, softened, Held(Adapted(Following(stepper))) if springs else Adapted(stepper)


def _summary(
    scene: Scene, system: System, solver: LinearSolver, method: str, verdict: Verdict, history: list[HistoryRow]
) -> Summary:
    domain, groups = scene.mesh.domain, dict.fromkeys("+".join(support.group) for support in scene.supports)
    return {
        "verdict": {
            "converged": verdict.converged,
            "kind": verdict.kind,
            "reason": verdict.reason,
            "place": verdict.place,
            "step": verdict.step,
            "t": verdict.t,
            "remedy": verdict.remedy,
            "cut_backs": verdict.cuts,
            "smallest_step": verdict.smallest,
            "notes": verdict.notes,
        },
        "scene": {
            "units": vars(scene.units),
            "degree": scene.degree,
            "element": scene.element,
            "materials": {body.group: body.material.name for body in scene.bodies},
            "contacts": [_contact_summary(c, system, scene.units) for c in system.contacts],
            "reactions": [{"name": name, "moment_about": "the present centroid of the group"} for name in groups],
        },
        "sizes": {
            "cells": compat.cell_map(domain).size_global,
            "unknowns": system.vector.getSize(),
            "supported_unknowns": system.comm.allreduce(len(system.supports.owned)),
        },
        "method": {
            "stepper": method,
            "linear_solver": solver.method,
            "seconds_per_digit": solver.rates,
            "solver_changes": solver.fallbacks,
            "factorisations": solver.builds,
            "krylov_iterations": solver.iterations,
            "matrix_patterns": system.patterns,
            "symmetric": system.symmetric,
        },
        "limit_points": limit_points(history),
        "stabilisation": _stabilisation(system, scene.units),
        "damping": _damping(system, scene.units),
        "iterations": verdict.iterations,
        "corrections": verdict.corrections,
        "augmentations": verdict.augmentations,
        "residuals_per_step": verdict.residuals,
        "last_step": history[-1] if history else {},
        "ranks": system.comm.size,
        "versions": compat.versions(),
    }


def _stabilisation(system: System, units: Units) -> dict[str, float]:
    """Largest energy left in the springs at the end of a step, also over the strain energy; {} where none were needed."""
    if system.grounding is None or not system.grounding.most["steps"]:
        return {}
    most = system.grounding.most
    return {f"energy_{units.force}{units.length}": most["energy"], "energy_share": most["energy_share"]}


def _contact_summary(contact: ContactTerm, system: System, units: Units) -> dict[str, Any]:
    """What a reader must know of a contact: its edge, its penalties and its points. Collective."""
    comm = system.comm
    low, high = (
        choose(comm.allgather(choose(contact.trial.law.eps_n, default=start)))
        for choose, start in ((min, np.inf), (max, 0.0))
    )
    return {
        "name": contact.name,
        "master": contact.master_name,
        "tool_edge": contact.partner.edge,
        "moment_about": "the slave surface's present centroid"
        if contact.partner.point(system.state) is None
        else "the tool's reference point",
        "friction": contact.friction_stated,
        "slave_points": comm.allreduce(contact.surface.points),
        f"penalty_{units.pressure}_per_{units.length}": [low, high],
        "penalty_raised": contact.penalties.raise_factor(system.state),
        f"penetration_allowed_{units.length}": contact.tolerance,
    }


def _damping(system: System, units: Units) -> dict[str, float]:
    """Number of jumps, the greatest work that damping took in one, and share of it and the strain energy left; or {}."""
    if system.damping is None:
        return {}
    most = system.damping.most
    work = {f"work_{units.force}{units.length}": most["work"], "work_share": most["work_share"]}
    return {"jumps": int(most["jumps"])} | work
