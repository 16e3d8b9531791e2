"""The options of a run: steps, shares, checkpoints, and what only a continuation takes; checked, or a SceneError."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from fenics_contact.contact.tools import Tool
from fenics_contact.scene.functions import Drive
from fenics_contact.scene.loads import loads_stated
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import Moves, Only, Stage
from fenics_contact.solvers.continuation import ArcSteps
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, count, finite, is_number, positive, shown

Steps = int | float | Sequence[float] | Floats | ArcSteps


def stated_stages(
    scene: Scene, stages: Sequence[Stage] | None, drives: tuple[Moves | None, Mapping[Tool, Drive] | None],
    ends: Sequence[object], steps: Steps, method: str,
) -> list[Stage]:  # fmt: skip
    """The stages of a run, each with its steps and method; the only one where none are stated. drives: move, push; ends:
    until, back, which without stages are the run's own."""
    move, push = drives
    if stages is None:
        until, back = ends
        return [Only(move=move or {}, push=push or {}, steps=steps, method=method, until=until, back=back)]
    if any(one is not None for one in (*drives, *ends)):
        raise SceneError("stages= beside move, push, until or back: each stage states its own, Stage(..., move=...)")
    if not isinstance(stages, list | tuple) or not stages or not all(isinstance(stage, Stage) for stage in stages):
        raise SceneError(f'stages = {shown(stages)}: give a list of Stage("name", ...)')
    names = [stage.name for stage in stages]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SceneError(f"two stages are named '{twice[0]}'; give each a name of its own")
    first, *later = stages
    supports, pairs = [one for one in scene.supports if one.value != 0.0], [pair for pair in scene.pairs if pair.driven]
    given = [*loads_stated(scene), *supports, *pairs]
    if idle := [stage for stage in ([] if given else [first]) + later if stage.idle]:
        raise SceneError(f"{idle[0]} has nothing to do: state what is moved, pushed or loaded in it, or leave it out")
    return [
        replace(stage, steps=steps if stage.steps is None else stage.steps, method=stage.method or method)
        for stage in stages
    ]


@contextmanager
def within(stage: Stage) -> Iterator[None]:
    """What is wrong in a stage is said with its name."""
    try:
        yield
    except SceneError as error:
        raise SceneError(stage.says(str(error))) from None


def refuse_shares(method: str, tolerance: float | None, smallest_step: float | None) -> None:
    """Both are shares where they are given, and the first goes with steps that iterate."""
    if smallest_step is not None:
        positive(smallest_step, "smallest_step", most=1.0, more=", a share of the load")
    if tolerance is not None:
        positive(tolerance, "tolerance", most=1.0, more=", a share of the force out of balance")
        if method == "incremental":
            raise SceneError('tolerance= is not for method="incremental", which takes one solve per step; take more steps')


def checkpoint_steps(checkpoint: bool | int, resume: bool, out: object) -> int:
    """After how many accepted steps a checkpoint is due, 0 for never."""
    if isinstance(checkpoint, bool):
        checkpoint = int(checkpoint or resume)
    checkpoint = count(checkpoint, "checkpoint", 0, "; give True, or the number of accepted steps from one to the next")
    if checkpoint and out is None:
        raise SceneError("checkpoint and resume need a folder: give out=...")
    return checkpoint


def arc_steps(steps: Steps, until: object, back: object, continuation: bool) -> ArcSteps | None:
    """ArcSteps of a continuation, checked; None for the other methods."""
    if not continuation:
        if until is not None or back is not None or isinstance(steps, ArcSteps):
            raise SceneError(
                'until, back and ArcSteps belong to method="arc_length"; the other methods end at the last t of steps'
            )
        return None
    if until is None:
        raise SceneError('method="arc_length" needs until: a Load, a Displacement or a Travel at which the run ends')
    if not isinstance(steps, ArcSteps):
        if np.ndim(steps) != 0:
            raise SceneError('method="arc_length" chooses its own t; give steps as ArcSteps or as one number')
        steps = ArcSteps(first=1.0 / len(load_times(steps)))
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
