"""The options of a run: its method, steps and output, and what a continuation takes; checked, or a SceneError."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np

from fenics_contact.contact.tools import Tool
from fenics_contact.scene.functions import Drive
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import ARC_LENGTH, Moves, Only, Stage
from fenics_contact.solvers.course import ArcSteps
from fenics_contact.solvers.linear import LINEAR
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, count, finite, flag, is_number, positive, shown

SHORTEST = 1e-9  # of all stages' duration: parts of a stage are known to 1e-7 at least
Steps = int | float | Sequence[float] | Floats | ArcSteps


@dataclass(frozen=True)
class Method:
    """How the states of a run are found: solve(..., method=Method(...)), or the first word alone, method="snes".

    name: what ends a load step: "newton", "incremental" (one solve per step, the paper's) or "snes" (PETSc's); linear:
    "auto", "direct" or "iterative"; tolerance: out-of-balance share at which a step counts as converged (1e-8), as it does
    wherever rounding is all that is left; smallest_step: share of the load below which a load step is not cut (1e-4 of
    the schedule's shortest step); of ArcSteps it is their `smallest`.

    stabilise: hold bodies and pushed tools that nothing holds yet by soft springs, which let go before a step is accepted.

    damping: where shorter steps do not help the load path jumps (a snap, a contact that lets go): loads and drives are held
    and viscous forces carry the bodies to rest; their work is in the history's damping_work and in the verdict's notes.
    Unasked so where contact points with friction find no state, by less than a cell.
    """

    name: str = "newton"
    linear: str = "auto"
    tolerance: float | None = None
    smallest_step: float | None = None
    stabilise: bool = False
    damping: bool = False


@dataclass(frozen=True)
class Output:
    """What a run leaves behind and shows: solve(..., out=Output("folder", ...)), or the folder's path alone.

    folder: of history.csv, summary.json, results.pvd and body.png; None for no files. checkpoint: keep every accepted step
    (True), or every n-th (n) and the last one, there, complete whenever the run is killed; resume: go on from the last
    checkpoint there, where there is one, on any number of ranks. A continuation's holds, beside the state and the history of
    its contacts, the last increment, the path's direction, the arc that is due and the leg. A checkpoint of another
    statement is refused, as are damaged ones. overwrite: replace the results of an earlier run there, which otherwise is
    refused. progress: show how far the run is, and what it remarks.
    """

    folder: str | PathLike[str] | None = None
    checkpoint: bool | int = False
    resume: bool = False
    overwrite: bool = False
    progress: bool = True


def stated_method(method: str | Method) -> Method:
    """The numbers of a run's method, checked."""
    stated = method if isinstance(method, Method) else Method(method)
    flag(stated.stabilise, "stabilise"), flag(stated.damping, "damping")
    if stated.linear not in list(LINEAR):
        raise SceneError(f"linear solver {shown(stated.linear)} is not one of {', '.join(LINEAR)}")
    if stated.smallest_step is not None:
        positive(stated.smallest_step, "smallest_step", most=1.0, more=", a share of the load")
    if stated.tolerance is not None:
        positive(stated.tolerance, "tolerance", most=1.0, more=", a share of the force out of balance")
    return stated


def stated_output(out: str | PathLike[str] | Output | None) -> Output:
    """Where a run's results go, checked; checkpoint: after how many accepted steps one is due, 0 for never."""
    stated = out if isinstance(out, Output) else Output(out)
    if stated.folder is not None and not isinstance(stated.folder, str | PathLike):
        raise SceneError(f"out = {shown(stated.folder)} must be the path of a folder, or an Output")
    flag(stated.resume, "resume"), flag(stated.overwrite, "overwrite"), flag(stated.progress, "progress")
    every = stated.checkpoint
    if isinstance(every, bool):
        every = int(every or stated.resume)
    every = count(every, "checkpoint", 0, "; give True, or the number of accepted steps from one to the next")
    if every and stated.folder is None:
        raise SceneError('checkpoint and resume need a folder: out=Output("folder", ...)')
    return replace(stated, checkpoint=every)


def stated_stages(
    scene: Scene, stages: Sequence[Stage] | None, drives: tuple[Moves | None, Mapping[Tool, Drive] | None], steps: Steps,
    method: Method,
) -> list[Stage]:  # fmt: skip
    """The stages of a run, each with its steps and method; the only one where none are stated. drives: move, push, which
    without stages are the run's own."""
    move, push = drives
    if stages is None:
        return _all_decided([Only(move=move or {}, push=push or {})], steps, method)
    if any(one is not None for one in drives):
        raise SceneError("stages= beside move or push: each stage states its own, Stage(..., move=...)")
    if not isinstance(stages, list | tuple) or not stages or not all(isinstance(stage, Stage) for stage in stages):
        raise SceneError(f'stages = {shown(stages)}: give a list of Stage("name", ...)')
    names = [stage.name for stage in stages]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SceneError(f"two stages are named '{twice[0]}'; give each a name of its own")
    shortest, whole = min(stages, key=lambda stage: stage.duration), sum(stage.duration for stage in stages)
    if shortest.duration < SHORTEST * whole:
        raise SceneError(
            f"{shortest}: duration = {shortest.duration:g} is lost in rounding beside the {whole:g} of all stages; give "
            "durations that differ by less"
        )
    first, *later = stages
    supports, pairs = [one for one in scene.supports if one.value != 0.0], [pair for pair in scene.pairs if pair.driven]
    given = [*scene.loads, *supports, *pairs]
    if idle := [stage for stage in ([] if given else [first]) + later if stage.idle]:
        raise SceneError(f"{idle[0]} has nothing to do: state what is moved, pushed or loaded in it, or leave it out")
    return _all_decided(stages, steps, method)


def _all_decided(stages: Sequence[Stage], steps: Steps, method: Method) -> list[Stage]:
    decided = [_decided(stage, steps, method) for stage in stages]
    if method.smallest_step is not None and all(stage.method == ARC_LENGTH for stage in decided):
        raise SceneError("smallest_step= is of load steps, and here all go by arc length: give ArcSteps(smallest=...)")
    return decided


def _decided(stage: Stage, steps: Steps, method: Method) -> Stage:
    """The stage with the run's steps and method where it has none of its own; ArcSteps are a method themselves."""
    own = stage.steps if stage.steps is not None else steps
    with within(stage):
        if isinstance(stage.method, Method):
            raise SceneError("a stage's method is a name, such as method=\"snes\"; a Method is the whole run's")
        name = stage.method or method.name
        if name == ARC_LENGTH:
            raise SceneError(f"method '{name}': give steps=ArcSteps(until=...), which go by arc length to that target")
        if isinstance(own, ArcSteps):
            if stage.method or (stage.steps is None and name != "newton"):
                raise SceneError(f"steps=ArcSteps(...) go by arc length, not by method '{name}'; leave one of them out")
            return replace(stage, steps=own, method=ARC_LENGTH)
        if name == "incremental" and method.tolerance is not None:
            raise SceneError('tolerance= is not for method "incremental", which takes one solve per step; take more steps')
    return replace(stage, steps=own, method=name)


@contextmanager
def within(stage: Stage) -> Iterator[None]:
    """What is wrong in a stage is said with its name."""
    try:
        yield
    except SceneError as error:
        raise SceneError(stage.says(str(error))) from None


def arc_steps(steps: ArcSteps) -> ArcSteps:
    """ArcSteps of a continuation, checked."""
    if steps.until is None:
        raise SceneError("ArcSteps needs until: a Load, a Displacement or a Travel at which the run ends")
    lengths = {"first": steps.first, "largest": steps.largest, "smallest": steps.smallest, "turn": steps.turn}
    counts = {"most": steps.most, "iterations": steps.iterations}
    for name, value in lengths.items():
        if not (is_number(value) and value > 0.0):  # largest may be endless
            raise SceneError(f"ArcSteps: {name} = {shown(value)} must be positive")
    for name, value in counts.items():
        count(value, f"ArcSteps: {name}")
    return steps


def load_times(steps: Steps) -> Floats:
    """Load parameters (n,) at which the steps end."""
    if not isinstance(steps, list | tuple | np.ndarray) or is_number(steps):
        steps = count(steps, "steps", remedy=", or the increasing list of t")
        return np.arange(1, steps + 1) / steps
    times = finite(steps, "steps, an increasing list of t, each of them", (len(steps),))
    if times.size == 0 or np.any(np.diff(times, prepend=0.0) <= 0.0):
        raise SceneError("steps must be a non-empty, increasing list of load parameters above 0")
    return times
