"""What follows a solve next to balance: samples go where the surfaces lie, and its factorisation serves again."""

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.solvers.increment import flies
from fenics_contact.solvers.linear import LinearFailure, LinearSolver, Solution
from fenics_contact.solvers.out_of_balance import HELD, finite_residual, forcing
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.secants import Secants
from fenics_contact.solvers.shortening import move

FOLLOWED = 2  # times that samples follow the surfaces after a solve
NEARLY = 1e-4  # of HELD, where corrections began above it or following raised it: a tangent lands far below by itself
SETTLING = 3  # first solves after which samples of averages follow the surfaces
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


class Resampling:
    """When samples of averages follow the surfaces after a solve: a few times while they are free, once more, next to
    balance, when they are held. They are held as soon as they have followed a state that balance is near, or late."""

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self.free, self._once_more, self._solves = True, True, 0
        self._left, self._reach = 0, HELD  # times that they may still follow after this solve, and below which share

    def solved(self) -> None:
        """The next tangent has been solved with."""
        self._solves += 1
        self._left, self._reach = (FOLLOWED, HELD) if self.free else (int(self._once_more), NEARLY * HELD)

    def corrected(self) -> None:
        """A correction began above the share at which they would have followed."""
        if self._left == FOLLOWED:
            self._reach = NEARLY * HELD

    def due(self, size: float) -> bool:
        """Whether they follow a state out of balance by this share."""
        return self._left > 0 and size < self._reach and (size > self._tolerance or self._left == FOLLOWED)

    def followed(self, size: float) -> None:
        """They have done so; size: the out-of-balance share then."""
        self._left, self._once_more = self._left - 1, self._once_more and self.free
        self._reach = HELD if size < HELD else NEARLY * HELD
        self.free = size >= HELD and self._solves <= 2 * SETTLING


class Corrections:
    """What each solve of a step with a tangent of its own is followed by; report: of that step, which counts them."""

    def __init__(self, system: System, linear: LinearSolver, tolerance: float, report: StepReport) -> None:
        self._system, self._linear, self._tolerance, self._report = system, linear, tolerance, report
        self._secants, self.samples = Secants(system), Resampling(tolerance)

    def after(self, increment: Solution, whole: bool, before: float, size: float) -> float:
        """Go on from a state that a solve has led to, by its increment, taken whole or not; returns the out-of-balance share
        then. before, size: that share where the increment began, and at the state. Collective."""
        self.samples.solved()
        self._secants.begin(*increment)
        if not whole:
            self._secants.forget()
        worth, gain = self._worth(self._system.foresight.foretells)
        if not self._system.contact_terms or self._system.condensed:
            worth = 0.0
        goal = self._tolerance if size <= self._tolerance else BELOW * self._tolerance
        return self._go_on(before, size, goal, worth, gain)

    def alone(self) -> float:
        """Go on from a balance that has changed a little, by the last tangent of all; returns the out-of-balance share then.
        Collective."""
        gain = self._worth(foretold=True)[1]
        return self._go_on(np.inf, finite_residual(self._system), BELOW * self._tolerance, np.inf, gain)

    def _go_on(self, before: float, size: float, goal: float, worth: float, gain: float) -> float:
        """Samples follow, then a correction is tried, as long as the share is no more than `worth`, nor than `gain` of the
        one before, and has not come to the goal; returns it then."""
        while True:
            if self.samples.due(size):
                size, before = self._follow(size), np.inf
            if not goal < size < min(worth, gain * before):
                return size
            before, size = size, self._correct(size)
            self.samples.corrected()

    def _worth(self, foretold: bool) -> tuple[float, float]:
        """Force out of balance from which on corrections are tried, and the share of it that each has to leave at most."""
        again = self._linear.again
        if foretold:
            return CORRECTED["substitution" if again == "little" else again]
        return CORRECTED["iterations" if again == "substitution" else again]

    def _follow(self, size: float) -> float:
        """Have samples lie where the surfaces do; size, returned: the out-of-balance share as it is, and then."""
        if self._system.foresight.follow(self._system.state):
            self._secants.forget()
            size = finite_residual(self._system)
        self.samples.followed(size)
        return size

    def _correct(self, size: float) -> float:
        """One more solve with the factorisation at hand, taken back if it does not lower the out-of-balance share; far from
        balance, where the next increment is shortened unless it lowers it further, if it does not lower it much.

        Where Newton converges the tangent has hardly changed, and this costs far less than a new one (Shamanskii 1967), also
        with an iterative solver: no assembly, and a preconditioner that fits. What has changed each such solve learns from
        those before it, see Secants.
        """
        system, linear = self._system, self._linear
        loosest = LOOSER if linear.method == "iterative" else 0.0
        try:
            increment = linear.solve(*system.still(), max(forcing(size, self._tolerance), loosest), again=True)
        except LinearFailure:
            return size
        self._secants.improve(*increment)
        if flies(system, increment):  # a tangent next to singular
            return size
        self._report.corrections += 1
        system.update(*increment)
        corrected = finite_residual(system)
        shortens = size >= HELD and not system.foresight.settles
        most = CORRECTED["iterations"][1] * size if shortens else size
        return corrected if corrected < most else move(system, increment, 1.0, 0.0)
