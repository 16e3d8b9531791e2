"""Steps solved again with better multipliers, until no error is left that matters, or with greater penalties."""

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import MEMORY, TOO_SOFT
from fenics_contact.assembly.system import System
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.penalty_error import penalty_costs
from fenics_contact.solvers.report import UNKEPT, Corrected, Goal, NearTo, Report, StepReport
from fenics_contact.solvers.verdict import NO_HELP, StepFailed

Shares = tuple[tuple[float, float], ...]  # of pressure and friction

AUGMENTATIONS = 200  # of a step, at most: where points have to let go it takes tens
# Augmentations in a row of which none has left less than this part of the error before: what slides on against springs, or
# is held more often than it can follow, would take them all
STALLED, GAIN = 25, 0.99
# An augmentation after which a contact needs more than so many such meets a body stiffer than the penalty, which is raised:
# augmented Lagrangian methods raise it where an augmentation leaves a quarter (Bertsekas 1982, Constrained Optimization,
# section 2.2), but a stiffer penalty costs Newton's method more than some solves from a state at hand
MANY = 10
# Out-of-balance share up to which an error is what multipliers leave: far above what Newton's method leaves, and below the
# force of one point in thousands. The incremental scheme's errors are those of its solves
SETTLED = 1e-5
ASTRAY = 10.0  # times what is allowed: an error that is no matter of the last augmentation any more
BRIEF = 3  # so many where multipliers have come to that earlier in the same step

# Out-of-balance share above which penetrations are no measure of pressure: a point that closed in a single solve, 2 % of a
# cell deep, leaves 2 E times its area (100 E / h is the default penalty), the force of tens of points at a strain of a tenth
BALANCED = 1e-2

# Shares of pressure and friction that multipliers take over, tried one after the other where Newton does not get along
SHARES: Shares = ((1.0, 1.0), (0.5, 0.5), (0.25, 0.25), (0.125, 0.125), (0.5, 0.0), (0.125, 0.0))
PATIENCE = 3  # attempts at a step, cut back in between, after which it is taken with what multipliers have reached


class Augmented(Corrected[Goal, Report]):
    """Uzawa's iteration of multipliers within each load step, outside of the stepper's own: an augmented Lagrangian.

    Each augmentation divides the error by about 1 + eps/k, where k is the stiffness of the bodies against the penalty eps:
    a hundred with the default penalty. Rubber that cannot escape is as stiff as its bulk modulus makes it: there an
    augmentation gains little, and under dead multipliers on soft penalties the body turns aside; the default penalty is
    raised beneath them, unless that cannot be solved. Where more points are held than the facets can follow, multipliers
    that press on nothing grow until the needless points let go, which takes tens of augmentations. An augmentation that the
    stepper cannot solve is taken in part. Where that does not help in smaller steps either, and where the augmentations run
    out, the step ends in the balanced state with the smallest error, and says what that is. stepper: Newton, Snes,
    Incremental or ArcLength; limit: largest number of augmentations of a step. goal: where a step is to end, as the stepper
    takes it: t, or an Arc.
    """

    def __init__(self, stepper: NearTo[Goal, Report], limit: int = AUGMENTATIONS) -> None:
        super().__init__(stepper)
        self.limit = limit
        self._failed = 0.0, 0  # t that attempts have started from, and their number
        self._spent = -1.0, -1.0  # t from and to which a step has been that multipliers do no more for

    def _corrected(self, system: System, goal: Goal, solve: Callable[[System, Goal], Report]) -> Report:
        report = solve(system, goal)
        with system.foresight.holding_samples():  # or multipliers of the ones would never be those of the next
            return self._augment(system, goal, report)

    def _augment(self, system: System, goal: Goal, report: Report) -> Report:
        best, tries, raising = None, SHARES, _Raising()
        step = system.trail.last.t, system.state.t
        patience = BRIEF if step == self._spent else STALLED
        while True:
            due = raising.due(system, left := misfits(system), report.residuals[-1])
            report.misfits.append(max(left.values()))
            if report.misfits[-1] <= 1.0:
                report.unkept |= {term.name: (0.0, "") for term in system.augmented}
                return report
            balanced = report.residuals[-1] <= BALANCED
            if balanced and (best is None or report.misfits[-1] < best.misfit):
                best = _Place(system, report)
            if report.augmentations == self.limit or _stalled(report.misfits, patience):
                failure, self._spent = _exhausted(system, report), step
                if best is None:
                    raise failure
                return best.accept(system, report, failure)
            report.augmentations += 1
            try:
                if balanced:
                    stiffer = due and self._stiffened(system, goal, report, tries[0], due)
                    raising.forgone |= set() if stiffer else set(due)
                    tries = tries if stiffer else self._advance(system, goal, report, tries)
                else:
                    report.add(self.stepper.settle(system, goal))
            except StepFailed as failure:
                start, count = self._failed
                self._failed = system.trail.last.t, count + 1 if start == system.trail.last.t else 1
                if best is None or self._failed[1] < PATIENCE or failure.finding.kind in NO_HELP:
                    raise
                return best.accept(system, report, failure)

    def _stiffened(
        self, system: System, goal: Goal, report: Report, shares: tuple[float, float], due: list[ContactTerm]
    ) -> bool:
        """Augment and solve again with greater penalties of those due. False, and back in the same place, where that
        fails."""
        place = _Place(system, report)
        _take_over(system, shares, due)
        try:
            report.add(self.stepper.settle(system, goal))
        except StepFailed as failure:
            if failure.finding.kind == MEMORY:
                raise
            place.take(system)
            for contact in due:
                contact.take(contact.penalties.held_back())
            return False
        report.raised |= {contact.name: _told(system, contact) for contact in due}
        return True

    def _advance(self, system: System, goal: Goal, report: Report, tries: Shares) -> Shares:
        """Augment and solve again; in part, from the same place, where that fails. Returns the shares to try next time: what
        has failed once is not tried again, some friction always is."""
        place = _Place(system, report)
        for i, (pressure, friction) in enumerate(tries):
            _take_over(system, (pressure, friction))
            try:
                report.add(self.stepper.settle_near(system, goal))
                return tries[i:] if friction else tries
            except StepFailed as failure:
                if i == len(tries) - 1 or failure.finding.kind in NO_HELP:
                    raise
                place.take(system)
        raise ValueError("no share of the multipliers is to be tried")


class _Raising:
    """Which contacts' penalties are to be raised in a step; forgone: those for which that has failed in it."""

    def __init__(self) -> None:
        self.forgone: set[ContactTerm] = set()
        self._seen: list[dict[ContactTerm, float]] = []  # errors in a row under the same penalties

    def due(self, system: System, left: dict[ContactTerm, float], residual: float) -> list[ContactTerm]:
        """Those that may be raised, if one of them needs more than MANY augmentations like the last two, of which one may
        have changed what is open or slips: where two contacts meet they share a load by their penalties, which are raised
        alike. left: their errors over what is allowed now, at this share of the force out of balance. Collective."""
        self._seen = [*self._seen, left] if residual <= SETTLED else []
        if len(self._seen) < 3:
            return []
        before, open_to = self._seen[-3], [c for c in left if c not in self.forgone and c.penalties.room(system.state) > 1.0]
        # MANY more leave error * (error / before) ** (MANY / 2)
        if not any(left[c] > 1.0 and left[c] ** (1 + 2 / MANY) > before[c] for c in open_to):
            return []
        self._seen = []
        return open_to


def _take_over(system: System, shares: tuple[float, float], due: Sequence[ContactTerm] = ()) -> None:
    """Multipliers take over shares of the pressure and the friction that the penalties carry, which grow for those due; what
    sticks does so in the next solve. Collective."""
    for contact in system.augmented:
        before = contact.trial
        contact.take(contact.multipliers.augmented(system.state, *shares))
        if contact in due:
            contact.take(contact.penalties.under_multipliers(system.state))
        contact.take(contact.multipliers.held(system.state, contact.trial, before))


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
        report.raised = {term.name: _told(system, term) for term in system.augmented if term.name in report.raised}
        system.assemble_residual()
        report.misfits.append(self.misfit)
        report.residuals.append(self.residual)
        for term, worst in misfits(system).items():
            if worst > 1.0 and term.penetration is not None:
                off, allowed = worst * term.penetration, term.penetration
                left = f"off by {off:.3g}, in depth or by slip, in stick or not along friction, and may be by {allowed:.3g}"
                remedy = f"{term.penalties.remedy}, take fewer points= per facet, or allow more"
                report.unkept[term.name] = off, f"{UNKEPT}, a point is {left} ({failure}); {remedy}"
            else:
                report.unkept[term.name] = 0.0, ""
        return report


def _told(system: System, contact: ContactTerm) -> str:
    """What is to be said of a contact's penalties raised beneath multipliers; "" of those that are not. Collective."""
    factor = contact.penalties.raise_factor(system.state)
    return f"multipliers gained too little: penalties raised to {factor:.3g} times the default" if factor > 1.0 else ""


def misfits(system: System) -> dict[ContactTerm, float]:
    """Largest errors of the contacts with multipliers over their tolerances. Collective."""
    if not system.augmented:
        return {}
    here = [contact.multipliers.misfit(system.state) for contact in system.augmented]
    return dict(zip(system.augmented, np.max(system.comm.allgather(here), axis=0).tolist(), strict=True))


def misfit(system: System) -> float:
    """The largest of `misfits`. Collective."""
    return max(misfits(system).values())


def _stalled(misfits: list[float], patience: int) -> bool:
    """Whether so many augmentations in a row have not made the error smaller than any before."""
    return len(misfits) > patience and min(misfits[-patience:]) > GAIN * min(misfits[:-patience])


def _exhausted(system: System, report: StepReport) -> StepFailed:
    left, first = report.misfits[-1], report.misfits[0]
    text = f"{report.augmentations} augmentations left {left:.3g} times the penetration allowed, of {first:.3g} at first"
    ways = dict.fromkeys(contact.penalties.remedy for contact in system.augmented)
    return StepFailed(text, TOO_SOFT, remedy=", or ".join([*ways, "take fewer points= per facet"]))


class Adapted(Corrected[Goal, Report]):
    """Default penalties that are raised, and the step solved again, where slave points sink in too far.

    Where a step cannot be solved with greater penalties it is taken with those there were. stepper: as in Augmented, or one;
    linear: solves for what penalties cost, where what else strains the bodies hides it.
    """

    def __init__(self, stepper: NearTo[Goal, Report], linear: LinearSolver) -> None:
        super().__init__(stepper)
        self._linear = linear

    def _corrected(
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
        while raised := raise_penalties(system, self._linear, report, forgone):
            try:
                with system.foresight.holding_samples():
                    report.add(self.stepper.settle(system, goal))
            except StepFailed as failure:
                system.trail.rollback()
                report.notes.append(
                    f"not solved with them ({failure}): penalties stay in this step; penetration= does without"
                )
                report.add(self._corrected(system, goal, solve, (*forgone, *raised)))
                return report
        return report


def raise_penalties(
    system: System, linear: LinearSolver, report: StepReport, forgone: tuple[ContactTerm, ...] = ()
) -> list[ContactTerm]:
    """The terms that have raised their penalties at a state near balance, which is then to be solved again; those that have
    forgone it do not. Collective."""
    if report.residuals[-1] > BALANCED:
        return []
    # few contacts ask for these
    found, strain, costs = {}, cache(system.strain_energy), cache(partial(penalty_costs, system, linear))
    stored, noise = (
        {contact: contact.penalties.stored(system.state) for contact in system.contact_terms},
        system.scales.noise_energy,
    )
    for contact, own in stored.items():
        if contact in forgone:
            continue
        both, cost = (own, sum(stored.values())), lambda name=contact.name: costs().get(name, 0.0)
        if raised := contact.penalties.raised(system.state, strain, cost, both, noise):
            trial, found[contact] = raised
            contact.take(trial)
    report.notes += found.values()
    report.raises += bool(found)
    return list(found)
