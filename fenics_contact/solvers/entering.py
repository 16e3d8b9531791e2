"""Steps solved again while a fluid comes in where contact has let go, until it goes no further."""

from collections.abc import Callable, Sequence
from typing import Protocol

from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import State
from fenics_contact.solvers.report import Stepper, StepReport


class Fluid(Protocol):
    """What is asked of one: to go, in a balanced state, to where it is connected to its edge; has it moved?"""

    def advance(self, state: State, back: bool) -> bool: ...


class Entering:
    """A stepper, and its solves repeated while fluids come further in.

    The first look at a balanced state may also take a fluid back from what contact has cut off; after it the fluid only goes
    on, by a node at least each time: so this ends. Where it reaches is what is connected to its edge in the state that the
    step ends with, or, where it has opened the way itself, was so in one of these.
    """

    def __init__(self, stepper: Stepper, fluids: Sequence[Fluid]) -> None:
        self.stepper, self.fluids = stepper, fluids

    def step(self, system: System, t: float) -> StepReport:
        """Carry the system from its committed state to t; StepFailed if it does not get there."""
        return self._enter(system, t, self.stepper.step)

    def settle(self, system: System, t: float) -> StepReport:
        """Into balance at t from the present state, after penalties have changed."""
        return self._enter(system, t, self.stepper.settle)

    def _enter(self, system: System, t: float, solve: Callable[[System, float], StepReport]) -> StepReport:
        report, back = solve(system, t), True
        while sum(fluid.advance(system.state, back) for fluid in self.fluids):  # all of them, which an `any` would not ask
            report.add(self.stepper.settle(system, t))
            report.raises, back = report.raises + 1, False
        return report
