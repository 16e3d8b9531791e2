"""What a step is to those who ask for it: a Stepper takes it, and its StepReport says what that took."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from fenics_contact.assembly.system import System

UNKEPT = "penetration= is not kept"  # words of the note


@dataclass
class StepReport:
    """What a step took: tangents, the out-of-balance norm over the force scale after each tangent and the correction that
    followed it, the number of corrections, solved with the factorisation at hand, and what was resolved on the way; of
    augmented contacts the number of augmentations, and before each and at the end the error over what is allowed; raises:
    how often the step was solved again with other penalties; jumped: damped motion has carried it there, by `way` [length];
    unkept: of augmented contacts' errors, by name, the greatest [length] and what is to be said, "" where nothing is that
    matters; raised: by name what is to be said of penalties raised beneath multipliers."""

    iterations: int = 0
    residuals: list[float] = field(default_factory=list)
    corrections: int = 0
    notes: list[str] = field(default_factory=list)
    augmentations: int = 0
    misfits: list[float] = field(default_factory=list)
    raises: int = 0
    jumped: bool = False
    way: float = 0.0
    unkept: dict[str, tuple[float, str]] = field(default_factory=dict)
    raised: dict[str, str] = field(default_factory=dict)

    @property
    def said(self) -> list[str]:
        """The notes, those on what is left of errors last."""
        return [*self.done, *self.left]

    @property
    def done(self) -> list[str]:
        """Those on what the step did."""
        return self.notes + [f"contact '{name}': {words}" for name, words in self.raised.items() if words]

    @property
    def left(self) -> dict[str, tuple[str, float]]:
        """{a note on what is left of errors: its kind, and the greatest [length]}."""
        of = ((f"contact '{name}': ", off, words) for name, (off, words) in self.unkept.items() if words)
        return {f"{whose}{words}": (f"{whose}{UNKEPT}", off) for whose, off, words in of}

    def add(self, more: "StepReport") -> None:
        """What solving the step once more took; corrections alone belong to the last tangent before them."""
        if not more.iterations and more.residuals:
            self.residuals = self.residuals[:-1]
        for name in ("iterations", "residuals", "corrections", "notes", "augmentations", "misfits", "raises"):
            setattr(self, name, getattr(self, name) + getattr(more, name))
        self.unkept |= more.unkept
        self.raised |= more.raised


GoalOf = TypeVar("GoalOf", contravariant=True)
ReportOf = TypeVar("ReportOf", bound=StepReport, covariant=True)


class StepperTo(Protocol[GoalOf, ReportOf]):
    """What carries a System from its committed state to a goal, t or an arc; StepFailed if it does not get there."""

    def step(self, system: System, goal: GoalOf, /) -> ReportOf: ...

    def settle(self, system: System, goal: GoalOf, /) -> ReportOf:
        """Into balance at the goal from the present state, after its multipliers or penalties have changed."""
        ...


class NearTo(StepperTo[GoalOf, ReportOf], Protocol[GoalOf, ReportOf]):
    """One that knows what hardly changes the tangent."""

    def settle_near(self, system: System, goal: GoalOf, /) -> ReportOf:
        """Into balance at the goal from a balance of which multipliers, or far ends of springs, alone have changed."""
        ...


Stepper = StepperTo[float, StepReport]
Goal = TypeVar("Goal")  # where a step is to end: t, or an Arc
Report = TypeVar("Report", bound=StepReport)


class Corrected(Generic[Goal, Report]):
    """A stepper, and what corrects the states that it has solved for, alike after a step and where it only settles."""

    def __init__(self, stepper: NearTo[Goal, Report]) -> None:
        self.stepper = stepper

    def step(self, system: System, goal: Goal) -> Report:
        """Carry the system from its committed state to the goal; StepFailed if it does not get there."""
        return self._corrected(system, goal, self.stepper.step)

    def settle(self, system: System, goal: Goal) -> Report:
        """Into balance at the goal from the present state, after multipliers or penalties have changed."""
        return self._corrected(system, goal, self.stepper.settle)

    def settle_near(self, system: System, goal: Goal) -> Report:
        """The same from a balance of which multipliers, or far ends of springs, alone have changed."""
        return self._corrected(system, goal, self.stepper.settle_near)

    def _corrected(self, system: System, goal: Goal, solve: Callable[[System, Goal], Report]) -> Report:
        """What solve(system, goal) has found, corrected."""
        raise NotImplementedError
