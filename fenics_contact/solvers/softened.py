"""Steps that stiff penalties or friction keep Newton from solving: solved with softer ones first, or without friction where
bodies touch first, from where the full ones take few."""

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import UNKNOWN
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trials
from fenics_contact.solvers.newton import HOPE, Newton
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.touching import untouched
from fenics_contact.solvers.verdict import NO_HELP, StepFailed

SMOOTH = 1e-4  # of the force: out of balance without friction; left any farther friction sticks where nothing does
ROUGH = 1e-3  # of the force: out of balance with the softer penalties, which only find who is in contact


class Softened:
    """Newton, and after a step that failed and could be solved so: each step with softer penalties first, and without them
    where that fails: a body about to let go may do so under softer ones.

    What presses little on a structure that gives way, a strap on a drum, sinks into its contact by a millionth of the
    way that its points go within a step: they open and close, stick and slip at each iteration. Under a penalty that lets
    them sink by a hundredth of a cell they settle; the step is then solved from there with the penalties and the friction
    history that it started with: nothing of the softer ones stays in the result. stepper: Newton; helps: whether a step
    has been solved so.

    What touches first has no friction yet that could tell where it sticks, and may have to go far through its master on the
    way: where such a step goes astray it is tried without the friction of these contacts before, then with it from there.
    """

    def __init__(self, stepper: Newton) -> None:
        self.stepper, self.rough, self.helps = stepper, Newton(stepper.linear, ROUGH, stepper.limit), False
        self._smooth, self._in_vain = Newton(stepper.linear, SMOOTH, stepper.limit), -1.0

    def recall(self, helps: bool) -> None:
        """Go on as a run did that had come to this."""
        self.helps = helps

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        softer = {term: part for term in system.contact_terms if (part := term.penalties.softness(system.state)) < 1.0}
        if self.helps and softer:
            try:
                return self._step(system, t, softer)
            except StepFailed as failure:
                if failure.finding.kind in NO_HELP:
                    raise
            system.trail.rollback()
            return self.stepper.step(system, t)
        try:
            return self.stepper.step(system, t)
        except StepFailed as failure:
            if failure.finding.kind in NO_HELP:
                raise
            tried = failure
        system.trail.rollback()
        astray = tried.finding.kind == UNKNOWN and tried.left > HOPE
        if astray and (report := self._smoothly(system, t)):
            return report
        if not softer:
            raise tried
        report = self._step(system, t, softer)
        self.helps = True
        report.notes.append(
            f"a solve failed ({tried}); the step was then taken with softer penalties first, and from there with "
            "the contact's own ones, to which the result belongs; later steps begin so too"
        )
        return report

    def _smoothly(self, system: System, t: float) -> StepReport | None:
        """The report of a step that is solved without the friction of what touches first in it before; None, and the state
        the accepted one, where there is none, or that has failed from this state. Collective."""
        first = untouched(system)
        if not first or (start := system.trail.last.t) == self._in_vain:
            return None
        try:
            return self._after(system, t, self._smooth, {term: term.trial.with_friction(0.0) for term in first})
        except StepFailed:
            system.trail.rollback()
            self._in_vain = start
            return None

    def settle(self, system: System, t: float) -> StepReport:
        """Into balance at t from the present state, after multipliers or penalties have changed."""
        return self.stepper.settle(system, t)

    def settle_near(self, system: System, t: float) -> StepReport:
        """Into balance at t from one of which multipliers, or far ends of springs, alone have changed."""
        return self.stepper.settle_near(system, t)

    def _step(self, system: System, t: float, softer: dict[ContactTerm, float]) -> StepReport:
        eased = {term: term.penalties.softened(system.state, part) for term, part in softer.items()}
        return self._after(system, t, self.rough, eased)

    def _after(self, system: System, t: float, first: Newton, eased: Trials) -> StepReport:
        """The report of a step that `first` leads into balance with these trials, and `stepper` then without."""
        for term, trial in eased.items():
            term.take(trial)
        try:  # what an accepted state leaves for the first solve to carry, the points' pressures with it
            report = first.settle(system, t)
        finally:
            for term in eased:
                term.rollback()
        report.add(self.stepper.settle(system, t))
        report.raises += 1
        return report
