"""The options of a run: steps, shares, checkpoints, and what only a continuation takes; checked, or a SceneError."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.solvers.continuation import ArcSteps
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, count, finite, is_number, positive, shown

Steps = int | float | Sequence[float] | Floats | ArcSteps


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
