"""How each stage of a run is carried out: its method's stepper, what corrects that one's states, and where steps end."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.options import Method, arc_steps, load_times, within
from fenics_contact.scene.build import Built
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import ARC_LENGTH, Stage
from fenics_contact.scene.targets import Branch, distances
from fenics_contact.solvers.arc_length import ArcLength, depends_on_load
from fenics_contact.solvers.augmented import Adapted, Augmented
from fenics_contact.solvers.continuation import Path
from fenics_contact.solvers.control import OnStep, judge_balance, run
from fenics_contact.solvers.course import ArcSteps, Fork, Route
from fenics_contact.solvers.entering import Entering
from fenics_contact.solvers.held import Following, Held
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Incremental, Newton
from fenics_contact.solvers.pivots import PivotWatch
from fenics_contact.solvers.report import Stepper
from fenics_contact.solvers.snes import Snes
from fenics_contact.solvers.softened import Softened
from fenics_contact.solvers.verdict import Verdict
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, shown

BEYOND = 0.05  # of all its way: what a path goes beyond both ends of a step, and back, from which on that is said
ROUNDED = 1e-9  # of the bodies' size: a path that goes no farther is rounding
PARTS = 8  # of a step, in which its paths are looked at
STEADY = "load steps that end in balance, by method 'newton' or 'snes'"
STEPPERS = {"newton": Newton, "incremental": Incremental, "snes": Snes, ARC_LENGTH: ArcLength}


@dataclass(frozen=True)
class Plan:
    """How a stage is carried out: by a stepper to each of its shares s, or along a Path; solver: the stepper's; softened:
    Newton's stepper with softer penalties where these help, None of other methods; arcs: whether the scene may be followed
    by arc length too; notes: what its steps pass by."""

    stage: Stage
    shares: Floats
    solver: LinearSolver
    stepper: Any
    path: Path | None
    softened: Softened | None
    arcs: bool
    notes: list[str]


def schedule(stage: Stage) -> tuple[ArcSteps | None, Floats]:
    """ArcSteps of a stage by arc length, None of another; shares s at which its steps end, or is to be asked. Checked."""
    with within(stage):
        if stage.method not in list(STEPPERS):
            raise SceneError(f"method {shown(stage.method)} is not one of newton, incremental, snes, nor a Method")
        steps: Any = stage.steps
        arcs = arc_steps(steps) if isinstance(steps, ArcSteps) else None
        shares = np.array([0.5, 1.0]) if arcs else load_times(steps)
        if stage.name and shares[-1] != 1.0:
            raise SceneError(f"steps end at s = {shares[-1]:g}; a stage ends at s = 1: give shares of it, or a duration")
        return arcs, shares


def ends_early(stage: Stage, shares: Floats) -> list[str]:
    """A note where a run without stages is to end before its paths do."""
    if stage.name or shares[-1] > 1.0 - 1e-9:
        return []
    return [f"steps= go to t = {shares[-1]:g}; what is stated as a number is reached at t = 1"]


def plans_of(
    scene: Scene, built: Built, stated: Sequence[Stage], schedules: Sequence[tuple[ArcSteps | None, Floats]], method: Method,
) -> list[Plan]:  # fmt: skip
    """A plan for each stage; what the user's functions give at the t that it will visit is checked. Collective."""
    system = built.system
    solvers: dict[bool, LinearSolver] = {}
    steppers: dict[str, Any] = {}
    plans = []
    for i, (stage, (arcs, shares)) in enumerate(zip(stated, schedules, strict=True)):
        with within(stage), system.stages.foreseen(i):
            _refuse_nan(system, shares)
            if arcs and not depends_on_load(system):
                raise SceneError(
                    "arc length without a load to scale: nothing depends on t; state a load, or move or push a tool"
                )
            if bool(arcs) not in solvers:
                solvers[bool(arcs)] = LinearSolver(system, method.linear, afresh=bool(arcs))
            solver = solvers[bool(arcs)]
            if arcs or stage.method not in steppers:
                steppers[str(stage.method)] = _stepper(str(stage.method), solver, method.tolerance, built)
            plain, softened, stepper = steppers[str(stage.method)]
            path = None
            if isinstance(plain, ArcLength) and arcs:
                legs = [distances(end, scene, system) for end in (arcs.until, arcs.back) if end is not None]
                stations = distances(list(arcs.stations), scene, system)
                path = Path(system, plain, stepper, arcs, Route(legs, stations, _fork(arcs, scene, system)))
            notes = [] if arcs else [stage.says(note) for note in passed_by(system, shares)]
        plans.append(Plan(stage, shares, solver, stepper, path, softened, not _steady_alone(built), notes))
    system.set_loads(0.0)
    if system.damped and not any(isinstance(steppers[str(stage.method)][0], Newton | Snes) for stage in stated):
        raise SceneError(f"damping=True needs {STEADY}; leave it out, or choose such steps")
    return plans


def _fork(arcs: ArcSteps, scene: Scene, system: System) -> Fork | None:
    """Where a continuation is to leave its path, if anywhere."""
    branch = arcs.branch
    if branch is None:
        return None
    if not isinstance(branch, Branch):
        raise SceneError(f'ArcSteps: branch = {shown(branch)}: give Branch("group", "x")')
    return Fork(branch.dofs(scene, system), branch.towards, branch.number)


def carry(
    system: System,
    plans: Sequence[Plan],
    kept: OnStep,
    verdict: Verdict,
    smallest: float | None,
    ended: Callable[[Plan], None],
) -> None:
    """Go through the stages that are left, until one fails; the verdict says so. ended(plan): called where a stage has ended
    and another follows, on all ranks."""
    stages = system.stages
    watches = {id(plan.solver): PivotWatch(system, plan.solver, verdict, kept, plan.arcs) for plan in plans}
    for plan in plans[stages.index :]:
        if plan.stage is not plans[stages.index].stage:
            ended(plans[stages.index])
            system.trail.next_stage(system.ending())
            verdict.longest = math.inf
        if plan.path:
            plan.path.follow(kept, verdict)
            for watch in watches.values():
                watch.forget()
        else:
            run(system, plan.stepper, [stages.time(s) for s in plan.shares], watches[id(plan.solver)], smallest, verdict)
        if not verdict.converged:
            verdict.reason = plan.stage.says(verdict.reason)
            return
    judge_balance(verdict)


def passed_by(system: System, shares: Floats) -> list[str]:
    """A note for each tool and each support with a path that turns within a step of the stage that is on, and goes beyond
    both its ends, which no step sees. Collective."""
    ends = [system.stages.time(s) for s in (0.0, *shares)]
    times = np.concatenate([np.linspace(a, b, PARTS + 1) for a, b in zip(ends, ends[1:], strict=False)])
    tools = np.array([system.tools.prescribed(t) for t in times])
    paths = {f"tool '{name}'": tools[:, i] for i, name in enumerate(system.tools.names)}
    supports = [system.supports.entries.sampled([t]) for t in times]
    paths |= {name: np.array([at[name] for at in supports]) for name in (supports[0] if supports else ())}
    notes = []
    for name, path in paths.items():
        whole, x = np.ptp(path, axis=0), path.reshape(len(shares), PARTS + 1, -1)
        first, last = x[:, 0], x[:, -1]
        beyond = np.maximum(x - np.maximum(first, last)[:, None], np.minimum(first, last)[:, None] - x)
        part = np.divide(beyond, whole, out=np.zeros_like(beyond), where=whole > ROUNDED * system.extent)
        if not part.max(initial=0.0) > BEYOND:
            continue
        step, at, _ = np.unravel_index(part.argmax(), part.shape)
        turns = times[step * (PARTS + 1) + at]
        notes.append(
            f"{name}: its path turns about t = {turns:.3g}, within a step from t = {ends[step]:.6g} to "
            f"{ends[step + 1]:.6g}, and goes back by {part.max():.0%} of its way, which no step sees: let a step end where "
            "it turns"
        )
    return notes


def _refuse_nan(system: System, shares: Floats) -> None:
    """Paths, forces and supports given as functions check themselves: once at every t the stage that is on will visit."""
    for t in map(system.stages.time, shares):
        system.tools.prescribed(t), system.tools.forces(t), system.set_loads(t), system.supports.values(t)


def _steady_alone(built: Built) -> list[str]:
    """What a scene asks for that needs steps which end in balance, of methods "newton" and "snes": why another one, {}, is
    refused."""
    steady = f"{STEADY} and not by '{{}}'"
    asked = {
        f"stabilise=True needs {steady}; leave it out, or choose such steps": built.system.stabilised,
        f'pressure with where="open" needs {steady}; choose such steps, or leave where= out': built.system.fluids,
    }
    return [why for why, there in asked.items() if there]


def _stepper(
    method: str, solver: LinearSolver, tolerance: float | None, built: Built
) -> tuple[ArcLength | Stepper, Softened | None, Any]:
    """The method's stepper, Newton's with softer penalties where these help, and all that with what corrects its states."""
    system = built.system
    options = {} if tolerance is None or method == "incremental" else {"tolerance": tolerance}
    plain = STEPPERS[method](solver, **options)
    steady = not isinstance(plain, ArcLength | Incremental)
    if (unfit := _steady_alone(built)) and not steady:
        raise SceneError(unfit[0].format(method))
    softened = Softened(plain) if isinstance(plain, Newton) else None
    stepper = softened or plain
    stepper = Augmented(stepper) if system.augmented else stepper
    stepper = Entering(stepper) if system.fluids else stepper
    springs = system.grounding if steady else None
    return plain, softened, Held(Adapted(Following(stepper), solver)) if springs else Adapted(stepper, solver)
