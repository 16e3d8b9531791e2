"""solve(scene, ...): run a scene along its load path and keep what it gave."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from os import PathLike
from typing import Any

import numpy as np
from tqdm import tqdm

from fenics_contact import compat
from fenics_contact.agreement import ends_together
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import ERROR, Finding
from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.contact.tools import RigidTool, Tool
from fenics_contact.costs import UNKNOWN, Costs, errors, greatest
from fenics_contact.options import Method, Output, Steps, stated_method, stated_output, stated_stages
from fenics_contact.output.between_nodes import friction_notes, friction_summary
from fenics_contact.output.carrying import Carriers, sparse_notes, unresolved_notes
from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.history import (
    Summary,
    chord_notes,
    chord_summary,
    energy_line,
    energy_notes,
    energy_summary,
    limit_points,
    node_notes,
    node_summary,
    penalty_lines,
    penalty_notes,
    penalty_summary,
    stages_line,
    stages_summary,
    widest_turn,
)
from fenics_contact.output.names import energy_unit
from fenics_contact.plans import Plan, carry, ends_early, plans_of, schedule
from fenics_contact.recording import Recorded, Recorder, columns_of
from fenics_contact.restart import Keeper, last_state, results_folder
from fenics_contact.result import Result
from fenics_contact.scene.build import Built, build
from fenics_contact.scene.drives import turning
from fenics_contact.scene.fingerprint import refuse_unlike, stages_told, statement
from fenics_contact.scene.functions import Drive
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import Moves, Stage
from fenics_contact.scene.start import Start, drives_left
from fenics_contact.scene.stated import parts_of
from fenics_contact.solvers.augmented import ASTRAY, misfits
from fenics_contact.solvers.strained import strained
from fenics_contact.solvers.verdict import Verdict
from fenics_contact.timing import Timers
from fenics_contact.units import Units
from fenics_contact.values import SceneError, shown

FAINT = 1e-6  # of the greatest load of all contacts: one that never carries more has what Newton's method leaves


@ends_together
def solve(
    scene: Scene,
    *,
    move: Moves | None = None,
    push: Mapping[Tool, Drive] | None = None,
    steps: Steps = 10,
    stages: Sequence[Stage] | None = None,
    start: Result | str | PathLike[str] | None = None,
    method: str | Method = "newton",
    out: str | PathLike[str] | Output | None = None,
    record: Recorded | None = None,
) -> Result:
    """Carry a scene from t = 0 to t = 1, through stages, or by continuation until a target is reached.

    move: {tool: travel (3,) at t = 1 [length], or a function of t, or a Motion with rotations and loads}; push: {tool: force
    (3,) at t = 1 [force], or a function of t}; steps: number of equal load steps, or the increasing list of their t, or
    ArcSteps, which follow the path through its limit points to a target; method: "newton", "incremental" (one solve per
    step, the paper's), "snes", or a Method with its numbers; out: folder of the results, or an Output, which says what is
    kept there and shown; record: {name: function of a View -> number}, columns added to the history, called on all ranks,
    which must agree on it; or a Film, which draws every step.

    stages: list of Stage, gone through one after another, each from where the one before has ended, over a t of its own
    `duration`; they state move and push in the place of the run, and steps and method where these differ.

    start: a result, or the folder of a run with checkpoints, on the same mesh: its last state, with displacements, places
    of tools, the forces on them and histories of contacts of the same name, is where this run begins, as a stage after it.
    Pushed tools stay so until a stage names them. Loads and supports that the scene states as that run's did stay as they
    were there; others are reached in the first stage.

    Raises SceneError on all ranks before any solve where the statement is wrong. A step that fails is cut back; a run that
    cannot go on returns with result.converged False and the reason in result.verdict.reason.
    """
    timers = Timers()
    numerics, output = stated_method(method), stated_output(out)
    stated = stated_stages(scene, stages, (move, push), steps, numerics)
    refuse_unlike(scene.mesh.comm, stages_told(stated))  # all that follows goes through them on all ranks together
    schedules = [schedule(stage) for stage in stated]
    begun = _started(start, scene)
    extra = {} if record is None else record
    columns = columns_of(extra, scene, turning(stated, begun.tools if begun else {}))
    if output.folder is not None:
        folder = results_folder(output.folder, scene.mesh.comm, output.overwrite, output.resume)
        output = replace(output, folder=folder)
    built = build(scene, stated, timers, numerics.stabilise, numerics.damping, begun)
    system = built.system
    plans = plans_of(scene, built, stated, schedules, numerics)
    told = partial(statement, scene, built, stated, extra)
    left = partial(drives_left, system, built.driven, scene, cache(partial(parts_of, scene, system)))
    refuse_unlike(system.comm, told([1.0] * len(stated)))
    steppers = [(plan.path, plan.softened) for plan in plans]
    keeper = Keeper(output, system, steppers, told, left) if output.checkpoint else None
    kept = Recorder(scene, built, output, keeper, (columns, extra), any(plan.path for plan in plans))
    setup = timers.table()["total"]
    kept.remark([*scene.notes, *built.notes, *(note for plan in plans for note in plan.notes)])
    costs = Costs(scene, system, kept)
    _carried(scene, system, plans, costs, numerics.smallest_step)
    if keeper:
        keeper.keep_last()
    summary = _concluded(scene, built, plans, costs, timers)
    summary["seconds_before_first_step"], summary["seconds"] = setup, timers.table()
    if kept.writer:
        kept.writer.finish(summary)
    if output.progress and system.comm.rank == 0:
        tqdm.write("\n".join(_told(scene, kept, summary)), file=sys.stderr)
    return Result(kept.history, kept.verdict, system, summary, scene, kept.results, [*columns.all(), *extra], left())


def _concluded(scene: Scene, built: Built, plans: Sequence[Plan], costs: Costs, timers: Timers) -> Summary:
    """What summary.json says of a run that has ended, but for its seconds, remarked too. Collective."""
    kept, system, noise = costs.kept, built.system, built.system.scales.noise
    verdict = kept.verdict
    travel, loads = greatest(scene, system, kept.history)
    kept.remark(verdict.last_notes())
    if verdict.converged:
        unmet = _unmet(built, loads)
        kept.remark([*unmet.values()])
        loads = {name: load for name, load in loads.items() if name not in unmet}
        kept.remark(ends_early(plans[-1].stage, plans[-1].shares))
        least = max(noise, FAINT * max(loads.values(), default=0.0))
        loaded = [c for c in system.contact_terms if loads.get(c.name, 0.0) > least]
        carried = {c.name: _carried_by(c, scene, system) for c in loaded}
        kept.remark(sparse_notes(kept.history, carried, scene.units))
        within = {name: share for name, (_, share) in kept.results.within_facets.items() if name in carried}
        kept.remark(unresolved_notes(within))
        energies = [row[f"strain_energy_{energy_unit(scene.units)}"] for row in kept.history]
        words = strained(system, energies[-1], max(energies)) if energies else None
        kept.remark([words] if words else [])
    summary = _summary(scene, system, plans, verdict, kept.history)
    with timers("penalty error"):
        solver = plans[system.stages.index].solver
        error, chords, nodes, friction = (
            errors(system, solver, scene.section, kept.results) if verdict.converged else UNKNOWN
        )
    summary["penalty_error"] = penalty_summary(error, list(travel), scene.units)
    summary["chord_error"] = chord_summary(chords, scene.units)
    summary["node_error"] = node_summary(nodes, scene.units)
    summary["friction_error"] = friction_summary(friction)
    left = misfits(system) if verdict.converged else {}
    astray = {term.name: term.penalties.remedy for term, error in left.items() if error > ASTRAY}
    if not any(
        contact.findings.misstated(system.state) for contact in system.contact_terms
    ):  # of which first order tells nothing
        kept.remark(penalty_notes(summary["penalty_error"], travel, scene.units, loads, astray))
    kept.remark(chord_notes(summary["chord_error"], scene.units) + node_notes(summary["node_error"], scene.units))
    kept.remark(friction_notes(summary["friction_error"]))
    if verdict.converged:
        costs.stiff(plans[system.stages.index])
    summary["energy"] = energy_summary(
        kept.history, scene.units, _along(scene), kept.results.balance.growth, system.scales.noise_energy
    )
    kept.remark(kept.results.notes())
    taken = len(kept.history)
    # what the forces that balance leaves may do [force length]
    unknown = taken * TOLERANCE * system.scales.balance * system.scales.farthest + system.scales.noise_energy
    missing = abs(summary["energy"].get(f"greatest_error_{energy_unit(scene.units)}", 0.0))
    if missing > unknown:  # a body that moves without strain has no other work
        until = kept.history[: summary["energy"]["greatest_error_step"]]
        turned = widest_turn(until, scene.units, dict(zip(travel, built.beginning.angles, strict=True)))
        has = ["damping"] * system.damped + ["penetration"] * (len(system.augmented) == len(system.contact_terms))
        has += ["jump"] * built.beginning.jumps
        kept.remark(energy_notes(summary["energy"], scene.units, built.beginning.overlaps, turned, has))
    verdict.order()
    return summary


def _along(scene: Scene) -> dict[str, str]:
    """By contact what its pressures act along, as ALONG of output/history.py names it, where that is no gradient of gaps; of
    distances to other analytic tools their normals are."""
    tools = {contact.name: contact.master for contact in scene.contacts if isinstance(contact.master, RigidTool)}
    slaves = [contact.name for contact in scene.contacts if contact.name not in tools and contact.points != "nodes"]
    return dict.fromkeys(slaves, "slave") | {name: "face" for name, tool in tools.items() if tool.sharp}


def _told(scene: Scene, kept: Recorder, summary: Summary) -> list[str]:
    """The last lines that a run shows."""
    lines = penalty_lines(summary["penalty_error"], scene.units)
    lines += [energy_line(kept.results.balance.now, summary["energy"], scene.units), stages_line(summary["seconds"])]
    if kept.verdict.residuals:
        falls = " ".join(f"{residual:.0e}" for residual in kept.verdict.residuals[-1])
        lines.insert(0, f"out of balance in the last step, after each tangent: {falls} of the force")
    return lines


def _carried(scene: Scene, system: System, plans: Sequence[Plan], costs: Costs, smallest_step: float | None) -> None:
    """The run's steps. Where a function of the user's raises, what was accepted stays readable and summary.json says why."""
    kept = costs.kept
    try:
        carry(system, plans, kept, kept.verdict, smallest_step, costs.stage_ended)
    except SceneError as error:
        kept.verdict.stop(Finding(ERROR, str(error)), system.state.t, len(kept.history) + 1)
        if kept.writer:
            kept.writer.close(_summary(scene, system, plans, kept.verdict, kept.history))
        raise
    finally:
        kept.bar.close()


def _unmet(built: Built, loads: Mapping[str, float]) -> dict[str, str]:
    """{contact: what is to be said} of those that have met their master by no more than rounding; loads: the greatest of
    each in a step [force]. Collective."""
    system, drawn = built.system, built.beginning.as_drawn
    unknown = system.scales.unknown
    found = {c.name: c.findings.never_met(system.state, loads[c.name], unknown, drawn) for c in system.contact_terms}
    return {name: note for name, note in found.items() if note}


def _carried_by(contact: ContactTerm, scene: Scene, system: System) -> Carriers:
    """How few points carry a contact roughly: nodes of a facet or two, fewer Gauss points than a facet has. Collective."""
    s, few = contact.surface, 3 if scene.section else 4
    area = system.comm.allreduce(float(s.area.sum()))
    if s.at_nodes:
        return Carriers(area, few)
    return Carriers(area, s.area.shape[1] - 1, "Gauss point")


def _started(start: object, scene: Scene) -> Start | None:
    """The state that a run begins with, None at rest. Collective."""
    if start is None or isinstance(start, Result):
        return start.state() if start else None
    if not isinstance(start, str | PathLike):
        raise SceneError(f"start = {shown(start)}: give the result of another run, or the folder of one with checkpoints")
    return last_state(start, scene.mesh.comm)


def _summary(scene: Scene, system: System, plans: Sequence[Plan], verdict: Verdict, history: list[HistoryRow]) -> Summary:
    domain, groups = scene.mesh.domain, dict.fromkeys("+".join(support.group) for support in scene.supports)
    solver, solvers = plans[system.stages.index].solver, list({id(plan.solver): plan.solver for plan in plans}.values())
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
            "cut_back_causes": verdict.causes,
            "smallest_step": verdict.smallest,
            "notes": verdict.notes,
        },
        "scene": {
            "units": vars(scene.units),
            "degree": scene.degree,
            "element": scene.element,
            "materials": {body.group: body.material.name for body in scene.bodies},
            "contacts": [_contact_summary(c, system, scene.units) for c in system.contact_terms],
            "reactions": [{"name": name, "moment_about": "the present centroid of the group"} for name in groups],
        },
        "sizes": {
            "cells": compat.cell_map(domain).size_global,
            "unknowns": system.vector.getSize(),
            "supported_unknowns": system.comm.allreduce(len(system.supports.owned)),
        },
        "method": {
            "stepper": ", ".join(dict.fromkeys(str(plan.stage.method) for plan in plans)),
            "linear_solver": solver.method,
            "seconds_per_digit": solver.rates,
            "solver_changes": [words for one in solvers for words in one.stalls.words],
            "tangents": sum(one.tangents for one in solvers),
            "factorisations": sum(one.builds for one in solvers),
            "krylov_iterations": sum(one.iterations for one in solvers),
            "matrix_patterns": system.couplings.patterns,
            "symmetric": system.symmetric,
        },
        "limit_points": limit_points(history),
        "stages": stages_summary(history),
        "stabilisation": _stabilisation(system, scene.units),
        "damping": _damping(system, scene.units),
        "resumed_after_steps": verdict.resumed,
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
    comm, eps = system.comm, contact.trial.law.eps_n
    low, high = min(comm.allgather(eps.min(initial=np.inf))), max(comm.allgather(eps.max(initial=0.0)))
    return {
        "name": contact.name,
        "master": contact.master_name,
        "tool_edge": contact.partner.edge_kind,
        "moment_about": "the slave surface's present centroid"
        if contact.places.point(system.state) is None
        else "the tool's reference point",
        "friction": contact.friction_stated,
        "slave_points": comm.allreduce(contact.surface.count),
        f"penalty_{units.pressure}_per_{units.length}": [low, high],
        "penalty_raised": contact.penalties.raise_factor(system.state),
        f"penetration_allowed_{units.length}": contact.penetration,
    }


def _damping(system: System, units: Units) -> dict[str, float]:
    """Number of jumps, the greatest energy that one has let go, and share of it and the strain energy left; or {}."""
    if system.damping is None or not (system.damped or system.damping.most["jumps"]):
        return {}
    most = system.damping.most
    work = {f"work_{units.force}{units.length}": most["work"], "work_share": most["work_share"]}
    return {"jumps": int(most["jumps"])} | work
