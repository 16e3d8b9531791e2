"""Load path: from t = 0 to 1 in steps, cutting a step back when it fails and letting it grow again."""

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from fenics_contact.assembly.finding import CONVERGED, CYCLING, MEMORY, TOO_STIFF, UNKNOWN, Finding, Remark
from fenics_contact.assembly.system import System
from fenics_contact.solvers.damped import jump
from fenics_contact.solvers.diagnosis import diagnose, in_corner
from fenics_contact.solvers.entering import Leaks
from fenics_contact.solvers.folding import FOLDS, SHORTEST, folds
from fenics_contact.solvers.holding import thrown
from fenics_contact.solvers.report import Stepper, StepReport
from fenics_contact.solvers.snaps import snapped, wandered
from fenics_contact.solvers.touching import FEWEST, TOUCHES, FirstTouch
from fenics_contact.solvers.undecided import undecided
from fenics_contact.solvers.verdict import StepFailed, Verdict
from fenics_contact.types import Floats

SMALLEST = 1e-4  # of the schedule's shortest step: thirteen halvings; what they do not cure is no matter of the step
HOPELESS = (MEMORY, TOO_STIFF)  # no smaller step helps
# Cut-backs in a row for a point that jumps between the walls of an inner corner, after which none is tried: where the last
# state has it there, it lies there however short the step. Bodies on their way into one got through after as many
CORNERED = 4
UNBALANCED = 0.1  # of the force; the incremental scheme carries into the next step what is left, but this is no state
BALANCE = 'take more steps, or method="newton"'
ARRIVED = 1e-9  # of the bodies' size: how far supports and tools may be from their places
SOONER = 0.1  # of the schedule's shortest step: with damping, where a step so short fails, loads and drives are held
WIDEST = math.pi / 4 * (1.0 + 1e-9)  # [rad] by which one step may turn a tool
# Likewise what carries tied nodes, where there is contact: a first solve takes bodies along the tangents of their circles,
# which stretches them by half the turn's square, 3 % here. At 12 % a bush may be crushed on its shaft, and Newton's method
# ends in a balance with a fold
CARRYING = math.pi / 12 * (1.0 + 1e-9)
TURNS = "turns of tools"  # by which a run remembers what it has said of these
JUMPS = (
    3  # jumps that come to no rest, from as many places of a scheduled step, after which none is tried in it: they cost most
)
SAME = 1e-3  # of a step's way: a balance as near to the one that the step has led to is that one
EASY = 8  # iterations up to which a step was easy: the next one may be twice as large

OnStep = Callable[[StepReport, float, bool], None]  # a step's report, its seconds, whether it is on the schedule


def smallest_step(times: Sequence[float] | Floats, start: float = 0.0) -> float:
    """Smallest step [t] that the steps of a schedule from `start` on may be cut to."""
    return SMALLEST * min(1.0, *(b - a for a, b in zip([start, *times], times, strict=False)))


def run(
    system: System,
    stepper: Stepper,
    times: Sequence[float] | Floats,
    on_step: OnStep,
    smallest: float | None = None,
    verdict: Verdict | None = None,
) -> Verdict:
    """Visit every t of `times`, of the stage that is on, beyond the committed one, in steps that shrink where they fail and
    grow where they are easy.

    A failing step is halved, or ends where bodies first touch, down to `smallest` [t], then the run ends with its reason;
    after easy steps the size doubles, up to the schedule's own. on_step(report, seconds, on_schedule): called after each
    accepted step, on all ranks; verdict: that of the steps before, where a run is resumed. Returns the Verdict.
    """
    verdict = verdict or Verdict()
    shortest = smallest_step(times, system.stages.start.t)
    verdict.smallest = smallest or shortest
    sooner = max(SOONER / SMALLEST * shortest, 2.0 * verdict.smallest if system.damped else 0.0) if system.damping else 0.0
    within = sooner  # greatest step that damping carries: after a jump over one of this length it may be twice as long
    leaks, turned, touch = Leaks(system), dict[str, Remark](), FirstTouch(system)
    for begin, target in zip([system.stages.start.t, *times], times, strict=False):
        restless, cornered, why, least = 0, 0, "", _least(system, begin, target)
        while target - system.trail.last.t > 1e-12:
            start = time.perf_counter()
            goal, turn = _turned(system, target, verdict.longest)
            turned = turn or turned  # said with what is accepted: such a step may be cut back farther
            size = goal - system.trail.last.t
            report: StepReport | None
            try:
                smoother = size / 2 >= verdict.smallest and size > SHORTEST * (target - begin) * (1.0 + 1e-9)
                report = _attempt(system, stepper, goal, touch, max(verdict.smallest, least), smoother)
            except StepFailed as failure:
                report = None
                cornered = cornered + 1 if in_corner(system, failure) else 0
                if size <= within * (1.0 + 1e-9) and restless < JUMPS and _carried(system, failure):
                    report, why = _jumped(system, stepper, goal, failure)
                    restless = 0 if report else restless + 1
                    within = max(sooner, 2.0 * size) if report else sooner
                hopeless = failure.finding.kind in HOPELESS or cornered > CORNERED
                if report is None and (size / 2 < verdict.smallest or hopeless):
                    found = _astray(system, verdict, failure) or diagnose(system, failure, goal)
                    verdict.stop(found._replace(reason=f"{found.reason}; {why}") if why else found, goal)
                    return verdict
                if report is None:
                    system.trail.rollback()
                    verdict.cut(failure, f"step to t = {goal:.6g}")
                    verdict.longest = size * (touch.part if failure.finding.kind == TOUCHES else 0.5)
                    continue
            else:
                within = sooner
            cornered = 0
            system.trail.commit()
            rubbed = touch.accepted()
            if report.jumped:
                verdict.longest = within
            elif report.iterations <= EASY * (1 + report.augmentations + report.raises):
                verdict.longest *= 2.0
            verdict.accept(report, system)
            for name, remarks in rubbed.items():
                verdict.remark_on(name, remarks)
            verdict.remark_on(TURNS, turned)
            turned.clear()
            verdict.remark(undecided(system, verdict.remarked) | leaks.found(verdict.remarked))
            on_step(report, time.perf_counter() - start, goal == target)
    verdict.reason = CONVERGED  # in the place of the targets that arcs have reached before
    return verdict


def _attempt(system: System, stepper: Stepper, goal: float, touch: FirstTouch, least: float, smoother: bool) -> StepReport:
    """The report of a step to a state that may be accepted; StepFailed. least: the shortest that is taken for a first touch
    [t]; smoother: whether a shorter one is to be taken where it folds cells."""
    report = stepper.step(system, goal)
    if not _arrived(system, goal):
        raise StepFailed("supports or tools have not come all the way to where they are to be")
    wrong = system.acceptance.objection() or thrown(system) or (folds(system) if smoother else None)
    if wrong := wrong or touch.objection(least):
        raise StepFailed.of(wrong)
    if wandered(system, report):
        u, q = system.state.u.x.array.copy(), system.state.q.copy()
        words = snapped(system, goal, report.raises > 0)
        _back(system, stepper, goal, (u, q))
        report.notes += [words] if words else []
    return report


def _arrived(system: System, goal: float) -> bool:
    """Whether supports and tools are where they are at t = goal: short of it there is balance, too. Collective."""
    owed = np.concatenate([part.ravel() for part in system.begin_step(goal)])
    far = max(system.comm.allgather(float(np.abs(owed).max(initial=0.0))))
    return far <= ARRIVED * (system.extent + float(np.abs(system.state.q).max(initial=0.0)))


def _back(system: System, stepper: Stepper, goal: float, place: tuple[Floats, Floats]) -> None:
    """From the accepted state to the one in balance at t = goal that a step from it has led to: displacement (local array)
    and tools' coordinates (tools, 6) [length]. Collective."""
    way = system.state.way_from(*place)
    system.state.u.x.array[:], system.state.q[:] = place
    try:
        stepper.settle(system, goal)
        if system.state.way_from(*place) <= SAME * way:
            return
    except StepFailed:
        pass
    system.trail.rollback()
    stepper.step(system, goal)  # a step tried and dropped leaves no trace: this is the same one again


def _carried(system: System, failure: StepFailed) -> bool:
    """Whether damped motion is to be tried where a step has failed so.

    Nobody needs to ask for it where statuses cycle: a point may be in balance neither open nor closed, for its friction
    lifts it off when it touches.
    """
    kind = failure.finding.kind
    return system.damping is not None and kind not in (*HOPELESS, TOUCHES, FOLDS) and (system.damped or kind == CYCLING)


def _jumped(system: System, stepper: Stepper, goal: float, failure: StepFailed) -> tuple[StepReport | None, str]:
    """The report of damped motion to the next state of rest, or None, and where it was asked for, why; not asked for, it may
    go by less than a cell, as a point does that jumps to where it sticks. Collective."""
    known, asked = failure.finding, system.damped
    farthest = math.inf if asked else max(contact.surface.cell_height for contact in system.contact_terms)
    try:
        report = jump(system, goal, stepper, farthest)
    except StepFailed as restless:
        return None, restless.finding.reason if asked else ""
    if not asked:
        report.notes = [f"{known.reason} ({known.place}), in short steps too; {report.notes[0]}"]
    return report, ""


def _astray(system: System, verdict: Verdict, failure: StepFailed) -> Finding | None:
    """The finding that the last accepted step has ended so far out of balance that what ails the state is that alone; the
    system is rolled back then."""
    left = verdict.residuals[-1][-1] if verdict.residuals else 0.0
    if left <= UNBALANCED:
        return None
    system.trail.rollback()
    reason = f"the last step has left {left:.0%} of the force out of balance, and from there: {failure.finding.reason}"
    return Finding(UNKNOWN, reason, failure.finding.place, BALANCE)


def judge_balance(verdict: Verdict) -> None:
    """Say where steps have ended far out of balance, and that the run has failed where the last one did."""
    left = [residuals[-1] for residuals in verdict.residuals]
    if rough := sum(share > UNBALANCED for share in left):
        verdict.notes.append(f"{rough} of {len(left)} steps end with more than {UNBALANCED:.0%} of the force out of balance")
        if left[-1] > UNBALANCED:
            reason = f"it leaves {left[-1]:.0%} of the force out of balance"
            verdict.stop(Finding(UNKNOWN, reason, remedy=BALANCE), verdict.t, len(left))


def _turned(system: System, target: float, size: float) -> tuple[float, dict[str, Remark]]:
    """End of the next step, in which no path turns a tool by more than WIDEST, nor what carries nodes by CARRYING; what is
    to be said where that is shorter than a size it may have. A state is in balance a whole turn on, too, and a step so long
    would not be seen. Collective."""
    t = system.trail.last.t
    goal = _goal(t, target, size)
    turns, wide = system.tools.turns(t, goal), _widest(system)
    shares = turns / wide
    if not shares.max(initial=0.0) > 1.0:
        return goal, {}
    widest = int(shares.argmax())
    most, why = 45, "what it touches may go the shorter way round"
    if wide[widest] == CARRYING:
        most, why = 15, "what it carries is stretched on the way"
    words = (
        f"a step would turn '{system.tools.names[widest]}' by {np.degrees(turns[widest]):.0f} degrees, where {why}: steps "
        f"of {most} degrees at most are taken; friction along the way is right to the steps' length, so take more where it "
        "counts"
    )
    return _goal(t, target, (goal - t) / shares[widest]), {"turn": Remark(float(turns[widest]), words)}


def _widest(system: System) -> Floats:
    """By how much (tools,) one step may turn each tool [rad]. Collective."""
    ties, tools = system.supports.ties, range(len(system.tools))
    carries = system.comm.allreduce(np.array([len(ties.of(i)) for i in tools], dtype=np.int64)) > 0
    return np.where(carries & bool(system.contact_terms), CARRYING, WIDEST)


def _least(system: System, begin: float, target: float) -> float:
    """The shortest step [t] taken for a first touch where this one is on the schedule, which may turn tools by more than one
    may and be divided. Collective."""
    return FEWEST * (target - begin) / max([1.0, *(system.tools.turns(begin, target) / _widest(system))])


def _goal(t: float, target: float, size: float) -> float:
    """End of the next step: equal steps of at most `size` up to the target, and exactly the target in the last one."""
    left = math.ceil((target - t) / size * (1.0 - 1e-9)) if size > 0.0 else 1
    return target if left <= 1 else t + (target - t) / left
