"""Steppers from one load parameter to the next: full Newton, and the paper's incremental scheme."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trail import Accepted
from fenics_contact.solvers.corrections import SETTLING, Corrections
from fenics_contact.solvers.cycles import StatusWatch
from fenics_contact.solvers.gripping import first_solve
from fenics_contact.solvers.increment import solve_once
from fenics_contact.solvers.linear import LinearSolver, Solution
from fenics_contact.solvers.out_of_balance import (
    HELD,
    balanced,
    finite_residual,
    forcing,
    relative_residual,
    stalls,
    upright,
)
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.shortening import move, put_upright, shorten, to_turn
from fenics_contact.solvers.touching import untouched
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Floats

QUICK = 10  # solves within which a step from a start on the curve has to end; else it is taken from the last state
# Solves within which a step has to have left less than a share HOPE of the force out of balance once, where it began on the
# curve, and where it began at the last state and is no shorter than the last step. Nine of ten that have not go astray to
# the end, and a step cut back costs a few solves
AT_ONCE, EARLY, HOPE = 5, 8, 0.5
# Share of an increment before which a slipping point has turned where that is a flight: nothing sticks, nor resists as far.
# Next to balance, where points are judged by what they have, any share: all would slip to and fro
FLIGHT = 0.05


Driven = tuple[Floats, Floats]  # of supports' dofs and of the tools' coordinates


class Patience(NamedTuple):
    """Solves of a step: after the first `follow` samples of averages follow the surfaces, as they do in the end; `proof`:
    within which less than HOPE has to be left once; `limit`: the most."""

    follow: int
    limit: int
    proof: int

    def is_out(self, solve: int, residuals: list[float]) -> bool:
        """Whether the step is given up after so many solves, the last ones of these."""
        return solve == self.proof and min(residuals[-solve:]) > HOPE


class Taken(NamedTuple):
    """How an increment was taken: the out-of-balance share where it ended, the share of it that is left undone, since an
    element would turn inside out or it did not lower the force, and whether it was shortened for the latter."""

    size: float
    left: float = 0.0
    shortened: bool = False

    @property
    def whole(self) -> bool:
        """Was all of it taken?"""
        return self.left == 0.0 and not self.shortened


class Newton:
    """Newton's method within a load step.

    It starts on the curve through the last accepted states where the load path goes straight on; else the first solve
    is a predictor, in which the tangent of the last accepted state carries supports and tools to their new places. While
    the out-of-balance force is large, contact pressures are unknowns beside the displacement: a point is judged open or
    closed, stuck or slipping by the pressure that the last solve foresees and not by a gap that is still wrong
    (Foresight; the primal-dual active set of Hueeber & Wohlmuth 2005, doi:10.1016/j.cma.2004.08.006, with a penalty).
    tolerance: out-of-balance force over the largest force seen (1e-8: below it the penalty's own error rules by far); limit:
    largest number of tangents.
    """

    def __init__(self, linear: LinearSolver, tolerance: float = TOLERANCE, limit: int = 20) -> None:
        self.linear, self.tolerance, self.limit = linear, tolerance, limit

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        report = StepReport()
        du, dq = system.begin_step(t)
        if _extrapolate(system, du):
            system.foresight.resample(system.state)
            try:
                patience = Patience(SETTLING, min(QUICK, self.limit), AT_ONCE)
                return self._iterate(system, (np.zeros_like(du), dq), report, patience)
            except StepFailed:
                system.trail.rollback()
                du, dq = system.begin_step(t)
        early = bool(system.contact_terms) and (not _cut_back(system, t) or bool(untouched(system)))
        return self._iterate(system, (du, dq), report, Patience(SETTLING, self.limit, EARLY if early else self.limit))

    def settle(self, system: System, t: float) -> StepReport:
        """Into balance at t from the present state, after what has changed in it."""
        return self._iterate(system, system.begin_step(t), StepReport(), Patience(0, self.limit, self.limit))

    def settle_near(self, system: System, t: float) -> StepReport:
        """The same from balance, after multipliers, or far ends of springs, alone have changed: by corrections as far as
        these lead. What penalties or springs carried is then out of balance, and the tangent hardly changes: the state
        moves by penetrations only, or on as the springs let it."""
        report, owed = StepReport(), system.begin_step(t)
        if not system.condensed:
            size = Corrections(system, self.linear, self.tolerance, report).alone()
            if balanced(system, size, self.tolerance):  # and without what they hold
                system.foresight.release()
                size = finite_residual(system)
            if balanced(system, size, self.tolerance):
                report.residuals.append(size)
                return report
        return self._iterate(system, owed, report, Patience(0, self.limit, self.limit))

    def _iterate(self, system: System, motion: Driven, report: StepReport, patience: Patience) -> StepReport:
        """Solve until there is balance; motion: that of supports and tools, which the first solve carries as far as it is
        taken, and the next ones on."""
        watch, before, owed = StatusWatch(system, report.notes), np.inf, 1.0
        corrections = Corrections(system, self.linear, self.tolerance, report)
        system.assemble_residual()
        for solve in range(1, patience.limit + 1):
            advance = first_solve if solve == 1 else solve_once
            du, dq = (owed * part for part in motion)
            increment = advance(system, self.linear, du, dq, forcing(before, self.tolerance))
            report.iterations += 1
            system.foresight.release()
            taken = self._taken(system, increment, before, watch.cycling, solve <= SETTLING)
            before = size = corrections.after(increment, taken.whole, before, taken.size)
            if system.condensed:
                size = relative_residual(system)  # assembled last: the next right-hand side
            report.residuals.append(size)
            owed *= taken.left
            if owed == 0.0 and balanced(system, size, self.tolerance):
                return report
            watch.look(report.residuals)
            if patience.is_out(solve, report.residuals):
                break
            astray = size > HELD or stalls(report.residuals)
            _look_ahead(system, astray and not taken.shortened, corrections.samples.free and solve <= patience.follow)
        watch.blame()
        raise StepFailed(f"{solve} Newton iterations left {size:.1e} of the force out of balance", left=size)

    def _taken(self, system: System, increment: Solution, before: float, strict: bool, early: bool) -> Taken:
        """Keep as much of an increment, at whose end the state is, as leads on. before: the out-of-balance share where it
        began; strict: see shorten; early: whether it is one of the first, that go far.

        Where hardly a point is to open, close, stick or slip, what an early one from near balance leaves are penalties on
        ways that turn and bend, which the next solve takes away: shortened, it would end among gaps that are wrong by all
        that it left undone. Of a tool that is free to move this may be a motion that nothing resists. Where all settles by
        itself an increment is taken whole, but for a flight: of a slender part of which all slips.
        """
        foresight, size = system.foresight, finite_residual(system)
        far = FLIGHT if before > HELD else 1.0
        if size > before and foresight.settles and 0.0 < abs(turn := to_turn(system, increment)) < far:
            return Taken(upright(move(system, increment, 1.0, turn)), 1.0 - turn, shortened=True)
        if foresight.foretells and not np.isfinite(size):
            return Taken(*put_upright(system, increment))
        sure = early and not strict and foresight.foretells and before < HOPE and not system.tools.free.any()
        if size > before and not foresight.settles and not (sure and foresight.changes_little(system.state)):
            size, share = self.shorten(system, increment, before, size, strict)
            return Taken(size, 1.0 - share, shortened=True)
        return Taken(upright(size))

    shorten = staticmethod(shorten)  # its own name: studies take it away


def _look_ahead(system: System, foresees: bool, resamples: bool) -> None:
    """Before the next tangent: let contacts judge by the pressures that the last one foresees, and samples follow."""
    if foresees:
        system.foresight.foresee(system.state)
    if (resamples and system.foresight.resample(system.state)) or foresees:
        system.assemble_residual()


def _cut_back(system: System, t: float) -> bool:
    """Whether the step to t is shorter than the last one, or the first."""
    last = [state.t for state in system.trail.accepted[-2:]]
    return len(last) < 2 or t - last[1] < (1.0 - 1e-6) * (last[1] - last[0])


def _extrapolate(system: System, owed: Floats) -> bool:
    """Put the state, of parameter t, on the parabola or line through the last accepted ones, supports in their places.

    owed: supports' displacements still missing. False, and nothing moved, where the supports leave both curves, where an
    element would turn inside out, where no term foresees the kinks of a contact, or where one that settles them by itself
    would be out of balance by all the force there is. Collective.
    """
    foresight, accepted, state = system.foresight, system.trail.accepted, system.state
    if not foresight.contacts or system.condensed or len(system.tools):
        return False
    settles = any(contact.partner.settles for contact in foresight.contacts)
    u, _, t = system.trail.last
    for count in (3, 2):
        step = _onwards(accepted[-count:], state.t) if len(accepted) >= count else None
        if step is None or strays(system, system.supports.held(step) - owed, owed):
            continue
        system.supports.put(step, owed)
        state.u.x.array[:] = u + step
        foresight.hold((state.t - t) / (t - accepted[-2].t))
        size = system.assemble_residual()
        if np.isfinite(size) and (not settles or size < system.scales.balance):
            return True
        foresight.release()
        state.u.x.array[:] = u
    return False


def _onwards(states: Sequence[Accepted], t: float) -> Floats:
    """Displacement from the last of these states to t on the polynomial through all of them (Lagrange)."""
    times = np.array([state.t for state in states])
    step = -states[-1].u
    for i, state in enumerate(states):
        others = np.delete(times, i)
        step = step + np.prod((t - others) / (state.t - others)) * state.u
    return step


def strays(system: System, gap: Floats, owed: Floats) -> bool:
    """True where supports would end further from their places than half the way they go. Collective."""
    left, whole = system.comm.allreduce(np.array([np.sum(gap**2), np.sum(owed**2)]))
    return bool(left > 0.25 * whole)


class Incremental:
    """The paper's step equation: one linear solve per step, the out-of-balance force carried into the next.

    With multipliers each augmentation is one more of these solves, and so is a change of penalties: the step ends when no
    point lies too deep, in whatever balance it then is.
    """

    def __init__(self, linear: LinearSolver) -> None:
        self.linear = linear

    def step(self, system: System, t: float) -> StepReport:
        du, dq = system.begin_step(t)
        system.assemble_residual()
        solve_once(system, self.linear, du, dq)
        system.foresight.release()
        system.foresight.resample(system.state)
        return StepReport(1, [relative_residual(system)])

    settle = settle_near = step
