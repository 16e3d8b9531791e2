"""Steppers from one load parameter to the next: full Newton, and the paper's incremental scheme."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trail import Accepted
from fenics_contact.solvers.cycles import StatusWatch
from fenics_contact.solvers.gripping import first_solve
from fenics_contact.solvers.increment import flies, solve_once
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.reuse import TIGHTEST
from fenics_contact.solvers.secants import Secants
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Floats, Vec

SHORTEST = 1 / 64  # of a Newton step; shorter ones stall rather than converge
# Out-of-balance share below which foreseen pressures and those of the gaps agree to what Newton leaves anyway, and samples
# of averages lie where they will at last.
HELD = 1e-3
FOLLOWED = 2  # times that samples follow the surfaces then
NEARLY = 1e-4  # of that share, where corrections began above it or following raised it: a tangent lands far below by itself
UPRIGHT = 6  # halvings of an increment that turns an element inside out, where nothing else shortens it
LOOSEST = 1e-3  # relative residual of an iterative solve far from balance
# From which share of force out of balance on a solve with the factorisation at hand is tried, while each leaves less than
# what share of it, by what it is: by multigrid a new tangent costs little more than a solve, of a small matrix no more than
# two residuals. Averages lead samples after the surfaces between two tangents, which they need the sooner the stiffer
# penalties are, and where friction is foreseen what sticks and slips is right sooner: there a substitution is tried early,
# elsewhere as iterations are
CORRECTED = {
    "substitution": (30 * HELD, 0.7), "iterations": (10 * HELD, 0.5), "cycles": (HELD, 0.3), "little": (0.1 * HELD, 0.1),
}  # fmt: skip
# Relative residual of such a solve by multigrid, a tenth of what it has to gain: the tangent is no longer the state's
# own, so farther is no gain. Over a factorisation iterations are few
LOOSER = 0.1 * CORRECTED["cycles"][1]
BELOW = 0.1  # of the tolerance: where corrections end; the last solve with a tangent of its own lands far below it as well
QUICK = 10  # solves within which a step from a start on the curve has to end; else it is taken from the last state
# Solves within which a step has to have left less than a share HOPE of the force out of balance once, where it began on the
# curve, and where it began at the last state and is no shorter than the last step. Nine of ten that have not go astray to
# the end, and a step cut back costs a few solves
AT_ONCE, EARLY, HOPE = 5, 8, 0.5
SETTLING = 3  # first solves after which samples of averages follow the surfaces


class Patience(NamedTuple):
    """Solves of a step: after the first `follow` samples of averages follow the surfaces, as they do in the end; `proof`:
    within which less than HOPE has to be left once; `limit`: the most."""

    follow: int
    limit: int
    proof: int


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
        self._secants = Secants(linear.system)

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        report = StepReport()
        du, dq = system.begin_step(t)
        if _extrapolate(system, du):
            system.foresight.resample(system.state)
            try:
                patience = Patience(SETTLING, min(QUICK, self.limit), AT_ONCE)
                return self._iterate(system, np.zeros_like(du), dq, report, patience)
            except StepFailed:
                system.trail.rollback()
                du, dq = system.begin_step(t)
        early = bool(system.contacts) and not _cut_back(system, t)
        return self._iterate(system, du, dq, report, Patience(SETTLING, self.limit, EARLY if early else self.limit))

    def settle(self, system: System, t: float) -> StepReport:
        """Into balance at t from the present state, after what has changed in it."""
        du, dq = system.begin_step(t)
        return self._iterate(system, du, dq, StepReport(), Patience(0, self.limit, self.limit))

    def settle_near(self, system: System, t: float) -> StepReport:
        """The same from balance, after multipliers, or far ends of springs, alone have changed: by corrections as far as
        these lead. What penalties or springs carried is then out of balance, and the tangent hardly changes: the state
        moves by penetrations only, or on as the springs let it."""
        report, (du, dq) = StepReport(), system.begin_step(t)
        if not system.condensed:
            self._secants.forget()
            gain, before, size = self._corrected(foretold=True)[1], np.inf, _finite_residual(system)
            while BELOW * self.tolerance < size < gain * before:
                before, size = size, self._correct(system, du, dq, size, report)
            if balanced(system, size, self.tolerance):  # and without what they hold
                system.foresight.release()
                size = _finite_residual(system)
            if balanced(system, size, self.tolerance):
                report.residuals.append(size)
                return report
        return self._iterate(system, du, dq, report, Patience(0, self.limit, self.limit))

    def _iterate(self, system: System, du: Floats, dq: Floats, report: StepReport, patience: Patience) -> StepReport:
        # the first solve may carry supports and tools, and is taken whole
        foresight, corrects = system.foresight, bool(system.contacts) and not system.condensed
        watch, before, left, resample, late = StatusWatch(system, report.notes), np.inf, 0.0, True, True
        owed = du.copy(), dq.copy()
        system.assemble_residual()
        for solve in range(1, patience.limit + 1):
            advance = first_solve if solve == 1 else solve_once
            du, dq = advance(system, self.linear, du, dq, _forcing(before, self.tolerance))
            report.iterations += 1
            self._secants.begin(du, dq)
            foresight.release()
            size = _finite_residual(system)
            left = 0.0
            if foresight.foretells and not np.isfinite(size):
                size, left = self._upright(system, du, dq)
            if solve == 1:
                upright(size)
            shorten = size > before and left == 0.0 and not foresight.settles
            if shorten or left > 0.0:
                self._secants.forget()
            if shorten:
                size = self._shorten(system, du, dq, before, size, watch.cycling)
            goal = self.tolerance if size <= self.tolerance else BELOW * self.tolerance
            follows, reach = (FOLLOWED, HELD) if resample else (int(late), NEARLY * HELD)
            worth, gain = self._corrected(foresight.foretells)
            while True:  # samples follow the surfaces, the factorisation at hand solves once more; then they are held
                if follows and size < reach and (size > self.tolerance or follows == FOLLOWED):
                    size, before, follows, late = self._resampled(system, size), np.inf, follows - 1, late and resample
                    reach = HELD if size < HELD else NEARLY * HELD
                    resample = size >= HELD and solve <= 2 * SETTLING
                if not (corrects and goal < size < min(worth, gain * before)):
                    break
                before, size = size, self._correct(system, du, dq, size, report)
                reach = NEARLY * HELD if follows == FOLLOWED else reach
            before = size
            if system.condensed:
                size = relative_residual(system)  # assembled last: the next right-hand side
            report.residuals.append(size)
            if left == 0.0 and balanced(system, size, self.tolerance):
                return report
            watch.look(report.residuals)
            if solve == patience.proof and min(report.residuals[-solve:]) > HOPE:
                break
            foreseen = size > HELD and not shorten
            if foreseen:
                foresight.foresee(system.state)
            anew = resample and solve <= patience.follow and foresight.resample(system.state)
            if foreseen or anew:
                system.assemble_residual()
            owed = left * owed[0], left * owed[1]
            du, dq = owed
        watch.blame()
        raise StepFailed(f"{solve} Newton iterations left {size:.1e} of the force out of balance")

    def _corrected(self, foretold: bool) -> tuple[float, float]:
        """Force out of balance from which on corrections are tried, and the share of it that each has to leave at most."""
        again = self.linear.again
        if foretold:
            return CORRECTED["substitution" if again == "little" else again]
        return CORRECTED["iterations" if again == "substitution" else again]

    def _correct(self, system: System, du: Vec, dq: Floats, size: float, report: StepReport) -> float:
        """One more solve with the factorisation at hand, taken back if it does not lower the out-of-balance force; far from
        balance, where the next increment is shortened unless it lowers it further, if it does not lower it much.

        Where Newton converges the tangent has hardly changed, and this costs far less than a new one (Shamanskii 1967), also
        with an iterative solver: no assembly, and a preconditioner that fits. What has changed each such solve learns from
        those before it, see Secants.
        """
        try:
            loosest = LOOSER if self.linear.method == "iterative" else 0.0
            du, dq = self.linear.solve(*system.still(), max(_forcing(size, self.tolerance), loosest), again=True)
        except LinearFailure:
            return size
        self._secants.improve(du, dq)
        if flies(system, (du, dq)):  # a tangent next to singular
            return size
        report.corrections += 1
        system.update(du, dq)
        corrected = _finite_residual(system)
        shortens = size >= HELD and not system.foresight.settles
        most = CORRECTED["iterations"][1] * size if shortens else size
        return corrected if corrected < most else _move(system, du, dq, 1.0, 0.0)

    def _resampled(self, system: System, size: float) -> float:
        """Out-of-balance share with samples of averages where the surfaces lie; size: as it is."""
        if not system.foresight.follow(system.state):
            return size
        self._secants.forget()
        return _finite_residual(system)

    def _upright(self, system: System, du: Vec, dq: Floats) -> tuple[float, float]:
        """Halve an increment until no element is inside out; returns the out-of-balance force and the share left undone."""
        share, size = 1.0, np.inf
        for _ in range(UPRIGHT):
            size, share = _move(system, du, dq, share, 0.5 * share), 0.5 * share
            if np.isfinite(size):
                return size, 1.0 - share
        raise StepFailed("an element turned inside out")

    def _shorten(self, system: System, du: Vec, dq: Floats, before: float, size: float, strict: bool) -> float:
        """Where a full step does not lower the out-of-balance force, halve it while that helps; returns the share left.

        Where no part lowers it, as of nearly incompressible cells carried far, and there is no contact, all of it is taken.
        Condensed unknowns follow the tangent here. strict: halve it until it does lower it. A residual costs about a
        hundredth of a tangent solve. Where points that slip turn on its way it ends where the first one does.
        """
        if not strict and (turn := self._to_turn(system, du, dq)) != 0.0:
            return upright(_move(system, du, dq, 1.0, turn))
        share, whole = 1.0, size
        while size > before and share > (SHORTEST / 16 if strict else SHORTEST):
            shorter = _move(system, du, dq, share, 0.5 * share)
            if shorter >= size and np.isfinite(size) and not strict:
                _move(system, du, dq, 0.5 * share, share)
                break
            share, size = 0.5 * share, shorter
        else:
            # no part lowers it, and the shortest ones would creep; kinks of contacts a whole step may pass the wrong way
            if size > before and np.isfinite(whole) and not system.contacts:
                size = _move(system, du, dq, share, 1.0)
        return upright(size)

    def _to_turn(self, system: System, du: Vec, dq: Floats) -> float:
        """The share of an increment after which the first point has slid back to where it sticks; 0: none has.

        The tangent holds the direction in which a point slips. Where all slip, nothing but the body's own stiffness may hold
        it, which may be all but zero: far along such an increment many points have turned at once, and no half of it lowers
        the out-of-balance force. The first one to turn sticks in the next tangent and holds the body. Where the stiffness is
        below zero the increment leads against the force, and the body goes the other way until friction holds it.
        """
        onwards, back = system.foresight.first_turns(system.state)
        if min(onwards, back) >= 1.0:
            return 0.0
        _move(system, du, dq, 1.0, 0.0)
        free = system.tools.free
        gained = du.dot(system.residual_vector) + np.vdot(system.tool_residual[free], dq[free])
        _move(system, du, dq, 0.0, 1.0)
        turn = onwards if gained < 0.0 else -back
        return turn if abs(turn) < 1.0 else 0.0


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


def _move(system: System, du: Vec, dq: Floats, start: float, end: float) -> float:
    """Move from one share of an increment to another; returns the out-of-balance share there."""
    step = du.copy()
    step.scale(end - start)
    system.update(step, (end - start) * dq, end)
    return _finite_residual(system)


def _finite_residual(system: System) -> float:
    """Out-of-balance share, infinite where an element is inside out."""
    try:
        return relative_residual(system, followed=True)
    except StepFailed:
        return np.inf


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


def _forcing(residual: float, tolerance: float) -> float:
    """How far an iterative solve must go: a tenth of what Newton's quadratic convergence can gain from this residual, nor
    farther than a tenth of what it is to reach.

    (Dembo, Eisenstat & Steihaug 1982, doi:10.1137/0719025.) The predictor, which has no residual yet, gets 1e-5, for
    its right-hand side may hold a penalty times the travel of a tool, many times the forces.
    """
    if residual == np.inf:
        return 1e-5
    wanted = max(0.1 * residual, 0.1 * tolerance / max(residual, tolerance))
    return float(np.clip(wanted, TIGHTEST, LOOSEST))


def upright(size: float) -> float:
    """An out-of-balance norm as it is; StepFailed where it is no number, or endless."""
    if not np.isfinite(size):
        raise StepFailed("an element turned inside out")
    return size


def relative_residual(system: System, followed: bool = False) -> float:
    """Out-of-balance norm over its scale; StepFailed where it is not a number."""
    size, scale = upright(system.assemble_residual(followed)), system.scales.balance
    return size / scale if scale > 0.0 else size


def balanced(system: System, size: float, tolerance: float) -> bool:
    """Whether an out-of-balance share meets the tolerance, or is all rounding."""
    return size <= tolerance or size * system.scales.balance <= system.scales.noise
