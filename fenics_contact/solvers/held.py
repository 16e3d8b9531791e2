"""Steps in which a body that contact alone holds loses it: soft springs keep it in its place, where no load moves it."""

from collections.abc import Callable

import numpy as np

from fenics_contact.assembly.grounding import CLOSER, Grounding
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.system import System
from fenics_contact.solvers.holding import sliding
from fenics_contact.solvers.newton import strays
from fenics_contact.solvers.penalty_error import least_load
from fenics_contact.solvers.report import Corrected, Stepper, StepReport
from fenics_contact.solvers.verdict import NO_HELP, SPRUNG, StepFailed

LONGEST = 200  # solves of a step in which the springs' far ends follow; a gap of ten sizes of a body takes tens


class Following(Corrected[float, StepReport]):
    """A stepper, and with springs in, its solves repeated while their far ends follow, until they pull no more.

    Where the user asked for springs and contacts hold all bodies these pull, as a step begins, to where the path goes on: to
    the last place they would pull at what a gripper carries away, and friction would have to take that over.
    """

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        accepted = system.trail.accepted[-2:]
        if system.stabilised and len(accepted) == 2 and not system.acceptance.loose():
            du, dq = system.begin_step(t)
            before, last = accepted
            share = (t - last.t) / (last.t - before.t)
            step, turn = share * (last.u - before.u), share * (last.q - before.q)
            turns = np.abs(turn - dq)[~system.tools.free] > 0.5 * np.abs(dq)[~system.tools.free]
            if not strays(system, system.supports.held(step) - du, du) and not turns.any():
                _springs(system).begin(last.u + step, last.q + turn)
        return super().step(system, t)

    def _corrected(self, system: System, t: float, solve: Callable[[System, float], StepReport]) -> StepReport:
        report, springs = solve(system, t), _springs(system)
        while springs.engaged and (pull := springs.pull(system.state, least_load(system))) > 1.0:
            if report.augmentations + springs.ahead(system.state) >= LONGEST:
                text = f"the springs of the stabilisation still pull {pull * ALLOWED:.2g} of the largest force"
                # a load on what contact alone holds, and more of it than friction can take
                slides = sliding(system) if _loaded(system) else None
                raise StepFailed.of(slides) if slides else StepFailed(text, remedy=CLOSER)
            springs.follow(system.state)
            report.augmentations += 1
            with system.foresight.holding_samples():  # no tangent knows that they follow: they would undo balances
                report.add(self._solved(system, t))
        return report

    def _solved(self, system: System, t: float) -> StepReport:
        """The report of balance with the springs' far ends where the state is: with stiffer ones if soft ones fail."""
        springs, place = _springs(system), (system.state.u.x.array.copy(), system.state.q.copy())
        try:
            return self.stepper.settle_near(system, t)
        except StepFailed as failure:
            if failure.finding.kind in NO_HELP or not springs.stiffen():
                raise
        system.foresight.release()
        system.state.u.x.array[:], system.state.q[:] = place
        return self.stepper.settle(system, t)


class Held:
    """A stepper, and where a body has lost all that held it the same with the springs of `Grounding`.

    Such a body may stay wherever it touches nothing, and Newton's method takes it anywhere. The springs choose the place
    next to the last one, and let go before the step is accepted: what is left is a state in balance by itself. A body with
    a load on it has no such state: it flies, and the user must say what is to hold it. For a System with springs; stepper:
    one that augments.
    """

    def __init__(self, stepper: Stepper) -> None:
        self.stepper, self._said = stepper, False

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        if system.stabilised:
            return self.stepper.step(system, t)
        springs = _springs(system)
        springs.engage(False)
        system.begin_step(t)
        loaded = _loaded(system)
        resting, when, wrong = system.acceptance.loose(), " as the step began", None
        loose = {} if resting.keys() & loaded else resting
        if not loose or system.trail.last.t == 0.0:  # before that nothing presses yet, and the first step may change that
            try:
                report = self.stepper.step(system, t)
                wrong = system.acceptance.adrift()
                if not wrong:
                    self._said = False
                    return report
                failure = StepFailed.of(wrong)
            except StepFailed as tried:
                failure = tried
            loose = system.acceptance.loose() | resting
            if failure.finding.kind in NO_HELP or not loose or loose.keys() & loaded:
                raise failure
            # what an iterate has let go, balance may hold
            when = f" ({failure})" if wrong or resting else f" on the way to balance, which was not found ({failure})"
        system.trail.rollback()
        springs.engage(True)
        report = self.stepper.step(system, t)
        if not self._said:
            names = " and ".join(f"body '{system.bodies[i][0]}' along {', '.join(loose[i])}" for i in sorted(loose))
            how = f"{SPRUNG}, which pull no more, as in the steps after it until contacts do"
            report.notes.append(f"nothing held {names}{when}: {how}")
        self._said = True
        return report

    def settle(self, system: System, t: float) -> StepReport:
        """Into balance at t from the present state, after multipliers or penalties have changed."""
        return self.stepper.settle(system, t)


def _springs(system: System) -> Grounding:
    """The stabilisation, without which no step is taken here."""
    if system.grounding is None:
        raise ValueError("this System has no stabilisation")
    return system.grounding


def _loaded(system: System) -> set[int]:
    """Numbers of the reliant bodies on which the loads have a resultant along what supports leave free. Collective."""
    if system.scales.stiffness == 0.0:  # no tangent yet, which tells what is round-off
        system.assemble_tangent()
    forces, tools, sizes = np.zeros_like(system.state.u.x.array.reshape(-1, 3)), np.zeros_like(system.tool_residual), 0.0
    for term in system.terms:
        if term not in system.contact_terms and term is not system.grounding:
            mine = np.zeros_like(system.state.u.x.array)
            term.add_residual(system.state, mine, tools)
            forces += mine.reshape(-1, 3)  # nodes on a rank's border have a part on each, as sums over ranks take them
            sizes += float(np.abs(mine).sum())  # term by term, for without contacts they balance
    largest = system.comm.allreduce(sizes)
    found = set()
    for i in system.holds.reliant:
        load = system.comm.allreduce(forces[system.bodies[i][1]].sum(axis=0))
        if np.abs(load[system.holds.free(i)]).max() > max(ALLOWED * largest, system.scales.noise):
            found.add(i)
    return found
