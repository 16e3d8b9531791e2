"""Steps solved again with better multipliers, until no error is left that matters, or with greater penalties."""

from collections.abc import Callable
from typing import Generic, TypeVar

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import TOO_SOFT
from fenics_contact.assembly.system import System
from fenics_contact.solvers.report import StepperTo, StepReport
from fenics_contact.solvers.verdict import NO_HELP, StepFailed

Goal = TypeVar("Goal")  # where a step is to end: t, or an Arc
Report = TypeVar("Report", bound=StepReport)

Shares = tuple[tuple[float, float], ...]  # of pressure and friction

AUGMENTATIONS = 200  # of a step, at most: where points have to let go it takes tens
# Augmentations in a row of which none has left less than this part of the error before: what slides on against springs, or
# is held more often than it can follow, would take them all
STALLED, GAIN = 25, 0.99
BRIEF = 3  # so many where multipliers have come to that earlier in the same step

# Out-of-balance share above which penetrations are no measure of pressure: a point that closed in a single solve, 2 % of a
# cell deep, leaves 2 E times its area (100 E / h is the default penalty), the force of tens of points at a strain of a tenth
BALANCED = 1e-2

# Shares of pressure and friction that multipliers take over, tried one after the other where Newton does not get along: at
# the state at hand a point's friction grows by its share, and where that exceeds the limit the point slips at first
SHARES: Shares = ((1.0, 1.0), (0.5, 0.5), (0.25, 0.25), (0.125, 0.125), (0.5, 0.0), (0.125, 0.0))
PATIENCE = 3  # attempts at a step, cut back in between, after which it is taken with what multipliers have reached


class Augmented(Generic[Goal, Report]):
    """Uzawa's iteration of multipliers within each load step, outside of the stepper's own: an augmented Lagrangian.

    Each augmentation divides the error by about 1 + eps/k, where k is the stiffness of the bodies against the penalty eps:
    a hundred with the default penalty. Where more points are held than the facets can follow, multipliers that press on
    nothing grow until the needless points let go, which takes tens of augmentations. An augmentation that the stepper
    cannot solve is taken in part. Where that does not help in smaller steps either, and where the augmentations run out, the
    step ends in the balanced state with the smallest error, and says what that is. stepper: Newton, Snes, Incremental or
    ArcLength; limit: largest number of augmentations of a step. goal: where a step is to end, as the stepper takes it: t, or
    an Arc.
    """

    def __init__(self, stepper: StepperTo[Goal, Report], limit: int = AUGMENTATIONS) -> None:
        self.stepper, self.limit = stepper, limit
        self._failed = 0.0, 0  # t that attempts have started from, and their number
        self._spent = -1.0, -1.0  # t from and to which a step has been that multipliers do no more for

    def step(self, system: System, goal: Goal) -> Report:
        """Carry the system from its committed state to the goal; StepFailed if it does not get there."""
        report = self.stepper.step(system, goal)
        with system.foresight.holding_samples():  # or multipliers of the ones would never be those of the next
            return self._augment(system, goal, report)

    def settle(self, system: System, goal: Goal) -> Report:
        """Into balance at the goal from the present state, after penalties have changed."""
        report = self.stepper.settle(system, goal)
        with system.foresight.holding_samples():
            return self._augment(system, goal, report)

    def _augment(self, system: System, goal: Goal, report: Report) -> Report:
        best, tries = None, SHARES
        step = system.trail.last.t, system.state.t
        patience = BRIEF if step == self._spent else STALLED
        while True:
            report.misfits.append(misfit(system))
            if report.misfits[-1] <= 1.0:
                report.unkept |= {term.name: "" for term in system.augmented}
                return report
            balanced = report.residuals[-1] <= BALANCED
            if balanced and (best is None or report.misfits[-1] < best.misfit):
                best = _Place(system, report)
            if report.augmentations == self.limit or _stalled(report.misfits, patience):
                failure, self._spent = _exhausted(report), step
                if best is None:
                    raise failure
                return best.accept(system, report, failure)
            report.augmentations += 1
            try:
                if balanced:
                    tries = self._advance(system, goal, report, tries)
                else:
                    report.add(self.stepper.settle(system, goal))
            except StepFailed as failure:
                start, count = self._failed
                self._failed = system.trail.last.t, count + 1 if start == system.trail.last.t else 1
                if best is None or self._failed[1] < PATIENCE or failure.finding.kind in NO_HELP:
                    raise
                return best.accept(system, report, failure)

    def _advance(self, system: System, goal: Goal, report: Report, tries: Shares) -> Shares:
        """Augment and solve again; in part, from the same place, where that fails. Returns the shares to try next time: what
        has failed once is not tried again, some friction always is."""
        place = _Place(system, report)
        for i, (pressure, friction) in enumerate(tries):
            for contact in system.augmented:
                contact.take(contact.multipliers.augmented(system.state, pressure, friction))
            try:
                report.add(self.stepper.settle(system, goal))
                return tries[i:] if friction else tries
            except StepFailed as failure:
                if i == len(tries) - 1 or failure.finding.kind in NO_HELP:
                    raise
                place.take(system)
        raise ValueError("no share of the multipliers is to be tried")


class _Place:
    """A state within a step that is in balance, its multipliers and what it leaves of the error."""

    def __init__(self, system: System, report: StepReport) -> None:
        self.t, self.u, self.q = system.state.t, system.state.u.x.array.copy(), system.state.q.copy()
        self.multipliers = [(contact, contact.trial) for contact in system.augmented]
        self.misfit, self.residual = report.misfits[-1], report.residuals[-1]

    def take(self, system: System) -> None:
        system.foresight.release()
        system.begin_step(self.t)
        system.state.u.x.array[:], system.state.q[:] = self.u, self.q
        for contact, trial in self.multipliers:
            contact.take(trial)

    def accept(self, system: System, report: Report, failure: StepFailed) -> Report:
        """End the step here, and say how far it is from what was asked."""
        self.take(system)
        system.assemble_residual()
        report.misfits.append(self.misfit)
        report.residuals.append(self.residual)
        for term in system.augmented:
            worst = max(system.comm.allgather(term.multipliers.misfit(system.state)))
            if worst > 1.0:
                off, allowed = worst * term.penetration, term.penetration
                left = f"off by {off:.3g}, in depth or by slip in stick, and may be by {allowed:.3g}"
                remedy = "take fewer points= per facet, raise its penalty=, or allow more"
                report.unkept[term.name] = f"penetration= is not kept, a point is {left} ({failure}); {remedy}"
            else:
                report.unkept[term.name] = ""
        return report


def misfit(system: System) -> float:
    """Largest error of the contacts with multipliers over their tolerances. Collective."""
    return max(system.comm.allgather(max(contact.multipliers.misfit(system.state) for contact in system.augmented)))


def _stalled(misfits: list[float], patience: int) -> bool:
    """Whether so many augmentations in a row have not made the error smaller than any before."""
    return len(misfits) > patience and min(misfits[-patience:]) > GAIN * min(misfits[:-patience])


def _exhausted(report: StepReport) -> StepFailed:
    left, first = report.misfits[-1], report.misfits[0]
    text = f"{report.augmentations} augmentations left {left:.3g} times the penetration allowed, of {first:.3g} at first"
    remedy = "raise penalty= of the augmented contacts or leave it to the default, take fewer points= per facet"
    return StepFailed(text, TOO_SOFT, remedy=remedy)


class Adapted(Generic[Goal, Report]):
    """Default penalties that are raised, and the step solved again, where slave points sink in too far.

    Where a step cannot be solved with greater penalties it is taken with those there were. stepper: as in Augmented, or one.
    """

    def __init__(self, stepper: StepperTo[Goal, Report]) -> None:
        self.stepper = stepper

    def step(self, system: System, goal: Goal) -> Report:
        """Carry the system from its committed state to the goal; StepFailed if it does not get there."""
        return self._adapt(system, goal, self.stepper.step)

    def settle(self, system: System, goal: Goal) -> Report:
        """Into balance at the goal from the present state, which is near the committed one."""
        return self._adapt(system, goal, self.stepper.settle)

    def _adapt(
        self,
        system: System,
        goal: Goal,
        solve: Callable[[System, Goal], Report],
        forgone: tuple[ContactTerm, ...] = (),
    ) -> Report:
        """Solve, raise and solve again; forgone: the contacts whose penalties have been raised in vain in this step."""
        report = solve(system, goal)
        for contact in forgone:  # now, for a stepper that drops a try drops this with it
            contact.take(contact.penalties.held_back())
        while raised := raise_penalties(system, report, forgone):
            try:
                with system.foresight.holding_samples():
                    report.add(self.stepper.settle(system, goal))
            except StepFailed as failure:
                system.trail.rollback()
                report.notes.append(f"not solved with them ({failure}): penalties stay in this step")
                report.add(self._adapt(system, goal, solve, (*forgone, *raised)))
                return report
        return report


def raise_penalties(system: System, report: StepReport, forgone: tuple[ContactTerm, ...] = ()) -> list[ContactTerm]:
    """The terms that have raised their penalties at a state near balance, which is then to be solved again; those that have
    forgone it do not. Collective."""
    if report.residuals[-1] > BALANCED:
        return []
    found = {}
    for contact in system.contacts:
        if contact not in forgone and (raised := contact.penalties.raised(system.state)):
            trial, found[contact] = raised
            contact.take(trial)
    report.notes += found.values()
    report.raises += bool(found)
    return list(found)
