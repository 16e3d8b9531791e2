"""Steps solved again while a fluid comes in where contact has let go, until it goes no further."""

from collections.abc import Callable, Collection

from fenics_contact.assembly.finding import COMES_IN, MEMORY, NO_LAW, TOO_STIFF, Finding
from fenics_contact.assembly.system import System
from fenics_contact.solvers.report import Corrected, StepReport
from fenics_contact.solvers.verdict import StepFailed

KNOWN = (MEMORY, NO_LAW, TOO_STIFF)  # failures that have nothing to do with where the fluid is
ALL_BUT = 0.01  # of its pressure: contact that presses more by less holds a fluid no more when it next changes
LESS = "press the surfaces together more, or end the path before"


class Entering(Corrected[float, StepReport]):
    """A stepper, and its solves repeated while fluids come further in.

    The first look at a balanced state may also take a fluid back from what contact has cut off, but not while bodies are in
    damped motion, in which it would come and go; after it the fluid only goes on, by a node at least each time: so this
    ends. Where it reaches is what is connected to its source in the state that the step ends with, or, where it has opened
    the way itself, was so in one of these.
    """

    def _corrected(self, system: System, t: float, solve: Callable[[System, float], StepReport]) -> StepReport:
        report, back = solve(system, t), not (system.damping and system.damping.fluids_stay)
        while sum(fluid.advance(system.state, back) for fluid in system.fluids):  # all of them, which an `any` would not ask
            try:
                report.add(self.stepper.settle(system, t))
            except StepFailed as failure:
                raise _come_through(system, failure) from failure
            report.raises, back = report.raises + 1, False
        return report


def _come_through(system: System, failure: StepFailed) -> StepFailed:
    """A failure of the solve after fluids have come further in, said as such. Collective."""
    gains = [(fluid.name, gain) for fluid in system.fluids if (gain := fluid.gained())]
    if failure.finding.kind in KNOWN or not gains:
        return failure
    name, gain = gains[0]
    reason = (
        f"the fluid opens its way on under the contact: it has come to {_nodes(*gain)}, and Newton's method finds no "
        "balance near the one before"
    )
    return StepFailed(reason, COMES_IN, name, LESS)


def all_but_open(system: System, failure: Finding) -> Finding | None:
    """The finding that a little more pressure lets a fluid in under the contact of the accepted state, where nothing else
    explains a failure. Collective."""
    for fluid in system.fluids:
        if gain := fluid.opening(system.state, ALL_BUT):
            reason = (
                f"the fluid all but opens its way on under the contact: with {ALL_BUT:.0%} more pressure it comes to "
                f"{_nodes(*gain)}; {failure.reason}"
            )
            return Finding(COMES_IN, reason, fluid.name, LESS)
    return None


class Leaks:
    """Tells of accepted states in which a fluid, as its pressure grew, has opened all that kept it out."""

    def __init__(self, system: System) -> None:
        self._system, self._last = system, [fluid.kept_out(system.state) for fluid in system.fluids]

    def found(self, told: Collection[str]) -> dict[str, str]:
        """{place: a note} of fluids that have done so in the step accepted last; told: places that have had theirs. To be
        asked in every step. Collective."""
        system, before = self._system, self._last
        self._last, notes = [fluid.kept_out(system.state) for fluid in system.fluids], dict[str, str]()
        for fluid, (kept, lower), (keeping, pressure) in zip(system.fluids, before, self._last, strict=True):
            names = " and ".join(f"'{name}'" for name in kept)
            place = f"{fluid.name} through {names}"
            if kept and not keeping and pressure > lower and place not in told:
                found = sorted(system.acceptance.loose().items())
                loose = [f"body '{system.bodies[i][0]}' along {', '.join(axes)}" for i, axes in found]
                held = f"nothing but the fluid holds {' and '.join(loose)} now, whose place is nobody's choice"
                words = f"{fluid.name} has come through: what {names} kept it out of, the step before, is open to it"
                notes[place] = "; ".join([words, *([held] if loose else []), LESS])
        return notes


def _nodes(count: int, first: str, last: str) -> str:
    return f"{count} more nodes, from {first} to {last}" if count > 1 else f"one more node, {first}"
