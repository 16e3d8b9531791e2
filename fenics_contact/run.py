"""solve(scene, ...): run a scene along its load path and keep what it gave."""

import time
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from fenics_contact import compat
from fenics_contact.checks import SceneError
from fenics_contact.output.history import history_row
from fenics_contact.output.writer import Writer, prepare_folder
from fenics_contact.solvers.arc_length import ArcLength, depends_on_load
from fenics_contact.solvers.continuation import ArcSteps, follow
from fenics_contact.solvers.control import run
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Incremental, Newton
from fenics_contact.solvers.snes import Snes
from fenics_contact.targets import distances

STEPPERS = {"newton": Newton, "incremental": Incremental, "snes": Snes, "arc_length": ArcLength}


@dataclass
class Result:
    """history: one dict per accepted step (units in the names); verdict: how the run ended; system: the final state;
    summary: what summary.json holds. `result.u` is the displacement Function."""

    history: list
    verdict: object
    system: object
    summary: dict

    @property
    def u(self):
        return self.system.state.u

    @property
    def converged(self):
        return self.verdict.converged

    def column(self, name):
        """A history column at all accepted steps; KeyError lists the columns."""
        if self.history and name not in self.history[0]:
            raise KeyError(f"no column '{name}' in the history; it has: {', '.join(self.history[0])}")
        return np.array([row[name] for row in self.history])


def solve(
    scene,
    move=None,
    push=None,
    steps=10,
    out=None,
    method="newton",
    linear="auto",
    tolerance=None,
    progress=True,
    until=None,
    back=None,
    record=None,
):
    """Carry a scene from t = 0 to t = 1, or by continuation until a target is reached.

    move: {tool: travel (3,) at t = 1 [length], or a function of t}; push: {tool: force (3,) at t = 1 [force], or a function
    of t}; steps: number of equal load steps, or the increasing list of their t; out: folder for history.csv, summary.json,
    results.xdmf and body.png; method: "newton", "incremental" (one solve per step, the paper's), "snes" or "arc_length";
    linear: "auto", "direct" or "iterative"; tolerance: out-of-balance share at which a step counts as converged (1e-8);
    record: {name: function of the state -> number}, columns added to the history, called on all ranks.

    method="arc_length" follows the equilibrium path through its limit points, t being an unknown that may pass 1 or fall.
    until: where it ends, the last step landing there: Load(t), Displacement(surface, axis, value), Travel(tool, axis,
    value), a function of the state that changes its sign there, or a list of these, of which the first reached counts;
    back: the same for a way back along the path, with friction another one; steps: ArcSteps, or a number whose inverse is
    the first step's load increment.

    Raises SceneError on all ranks before any solve where the statement is wrong. A step that fails is cut back; a run that
    cannot go on returns with result.converged False and the reason in result.verdict.reason.
    """
    start = time.perf_counter()
    if method not in STEPPERS:
        raise SceneError(f"method '{method}' is not one of {', '.join(STEPPERS)}")
    continuation = method == "arc_length"
    times = np.array([0.5, 1.0]) if continuation else _times(steps)
    arcs = _arc_steps(steps, until, back, continuation)
    folder = prepare_folder(out, scene.mesh.comm) if out is not None else None
    system = scene.system(move, push)
    _refuse_nan(system, times)
    legs = [distances(end, scene, system) for end in (until, back) if end is not None]
    if continuation and not depends_on_load(system):
        raise SceneError("arc length without a load to scale: nothing depends on t; state a load, or move or push a tool")
    solver = LinearSolver(system, linear)
    stepper = _stepper(method, solver, tolerance)
    smallest_J = scene.volume_ratio(system.state.u)
    history = []
    with system.timers("output"):
        clock = (lambda: len(history)) if continuation else (lambda: system.state.t)
        writer = Writer(folder, scene, system, clock) if folder else None
    setup = time.perf_counter() - start
    bar = tqdm(total=1.0, disable=not progress or system.comm.rank != 0, bar_format="{l_bar}{bar}| {elapsed} {postfix}")

    def on_step(report, seconds, on_schedule):
        with system.timers("output"):
            state = system.state
            travel = {tool.name: state.travel[i] for i, tool in enumerate(scene.tools)}
            measures = {contact.name: contact.measures(state, system.comm) for contact in system.contacts}
            row = history_row(len(history) + 1, state.t, report, seconds, smallest_J(), travel, measures, scene.units)
            row |= {name: float(value(state)) for name, value in (record or {}).items()}
            if continuation:
                row["limit_point"] = report.limit_point
            history.append(row)
            if writer:
                writer.step(row, on_schedule)
        bar.set_postfix_str(f"step {len(history)}, {report.iterations} iterations", refresh=False)
        bar.update(state.t - bar.n)

    if continuation:
        verdict = follow(system, stepper, arcs, legs, on_step)
    else:
        verdict = run(system, stepper, times, on_step)
    bar.close()
    summary = _summary(scene, system, solver, method, verdict, history)
    summary["seconds"] = {"set-up": setup, "total": time.perf_counter() - start, **system.timers.seconds}
    if writer:
        writer.finish(summary)
    return Result(history, verdict, system, summary)


def _arc_steps(steps, until, back, continuation):
    """ArcSteps of a continuation, checked; None for the other methods."""
    if not continuation:
        if until is not None or isinstance(steps, ArcSteps):
            raise SceneError(
                'until and ArcSteps belong to method="arc_length"; the other methods end at the last t of steps'
            )
        return None
    if until is None:
        raise SceneError('method="arc_length" needs until: a Load, a Displacement or a Travel at which the run ends')
    if not isinstance(steps, ArcSteps):
        if np.ndim(steps) != 0:
            raise SceneError('method="arc_length" chooses its own t; give steps as ArcSteps or as one number')
        steps = ArcSteps(first=1.0 / len(_times(steps)))
    lengths = {"first": steps.first, "largest": steps.largest, "smallest": steps.smallest}
    counts = {"most": steps.most, "iterations": steps.iterations}
    for name, value in lengths.items():
        if not value > 0.0:
            raise SceneError(f"ArcSteps: {name} = {value} must be positive")
    for name, value in counts.items():
        if value != int(value) or value < 1:
            raise SceneError(f"ArcSteps: {name} = {value} must be a whole number of at least one")
    return steps


def _times(steps):
    if np.ndim(steps) == 0:
        if not np.isfinite(steps) or steps != int(steps) or steps < 1:
            raise SceneError(f"steps = {steps}: give a whole number of at least one, or the increasing list of t")
        return np.arange(1, int(steps) + 1) / int(steps)
    times = np.asarray(steps, dtype=float)
    if times.size == 0 or not np.all(np.isfinite(times)) or np.any(np.diff(np.concatenate([[0.0], times])) <= 0.0):
        raise SceneError("steps must be a non-empty, increasing list of load parameters above 0")
    return times


def _refuse_nan(system, times):
    """Paths, forces and supports given as functions must be finite at every t the run will visit."""
    for t in times:
        system.tools.prescribed(t), system.tools.forces(t), system.set_loads(t)  # they check themselves
        if bad := [name for name in system.comm.allgather(system.supports.not_finite(t)) if name]:
            raise SceneError(f"prescribed displacement of {bad[0]} is not finite at t = {t:g}; mend its function")
    system.set_loads(0.0)


def _stepper(method, solver, tolerance):
    options = {} if tolerance is None or method == "incremental" else {"tolerance": tolerance}
    return STEPPERS[method](solver, **options)


def _summary(scene, system, solver, method, verdict, history):
    domain = scene.mesh.domain
    return {
        "verdict": {
            "converged": verdict.converged,
            "t": verdict.t,
            "reason": verdict.reason,
            "cut_backs": verdict.cuts,
        },
        "scene": {
            "units": vars(scene.units),
            "degree": scene.degree,
            "element": scene.element,
            "materials": {body.group: body.material.name for body in scene.bodies},
            "contacts": [_contact_summary(c, system) for c in system.contacts],
        },
        "sizes": {
            "cells": domain.topology.index_map(3).size_global,
            "unknowns": system.vector.getSize(),
            "supported_unknowns": system.comm.allreduce(len(system.supports.owned)),
        },
        "method": {
            "stepper": method,
            "linear_solver": solver.method,
            "solver_changes": solver.fallbacks,
            "symmetric": system.symmetric,
        },
        "limit_points": limit_points(history),
        "iterations": verdict.iterations,
        "residuals_per_step": verdict.residuals,
        "last_step": history[-1] if history else {},
        "ranks": system.comm.size,
        "versions": compat.versions(),
    }


def limit_points(history):
    """Step, t and kind of the limit points among a continuation's accepted steps."""
    kinds = {1: "maximum of the load", -1: "minimum of the load"}
    found = [row for row in history if row.get("limit_point")]
    return [{"step": row["step"], "t": row["t"], "kind": kinds[row["limit_point"]]} for row in found]


def _contact_summary(contact, system):
    """What a reader must know of a contact: its edge, its penalties and its points. Collective."""
    comm, units = system.comm, system.units
    low, high = (
        choose(comm.allgather(choose(contact.normal_penalty, default=start)))
        for choose, start in ((min, np.inf), (max, 0.0))
    )
    return {
        "name": contact.name,
        "master": contact.master_name,
        "tool_edge": contact.edge,
        "friction": contact.friction,
        "slave_points": comm.allreduce(contact.surface.points),
        f"penalty_{units.pressure}_per_{units.length}": [low, high],
    }
