"""The stages of a run: which one is on, where it began, and what share of it a load parameter t stands for."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from fenics_contact.types import Floats


@dataclass(frozen=True)
class End:
    """Where a stage ended and the next one began: t; coordinates q [length] of the tools, and forces and, over the lever,
    moments on them [force], both (tools, 6)."""

    t: float
    q: Floats
    forces: Floats


class Stages:
    """Stages one after another, each of a duration [t]; ends: of those that are behind, after which one is on now.

    names: "" of the only stage of a run that states none; tools: their number. ahead: whether a stage is looked at before
    the run comes to it.
    """

    def __init__(self, names: Sequence[str], durations: Sequence[float], tools: int) -> None:
        self.names, self.durations = tuple(names), tuple(durations)
        self.origin = End(0.0, np.zeros((tools, 6)), np.zeros((tools, 6)))
        self.ends: list[End] = []
        self.ahead = False

    def begin(self, origin: End) -> None:
        """The first stage begins where another run ended."""
        self.origin = origin

    def leave(self, *ends: End) -> None:
        """Stages from the one that is on have ended so."""
        self.ends += ends

    def __len__(self) -> int:
        return len(self.names)

    @property
    def index(self) -> int:
        """Number, from 0, of the stage that is on."""
        return len(self.ends)

    @property
    def name(self) -> str:
        return self.names[self.index]

    @property
    def duration(self) -> float:
        return self.durations[self.index]

    @property
    def start(self) -> End:
        """Where the stage that is on began."""
        return self.ends[-1] if self.ends else self.origin

    @property
    def passed(self) -> tuple[float, ...]:
        """The t at which the stages behind have ended."""
        return tuple(end.t for end in self.ends)

    def share(self, t: float, passed: tuple[float, ...] | None = None) -> float:
        """Share of a stage at t: of the one on, or of that after the ends `passed`. 1 at its full length, arcs may go on."""
        passed = self.passed if passed is None else passed
        return (t - (passed[-1] if passed else self.origin.t)) / self.durations[len(passed)]

    def time(self, share: float) -> float:
        """The t at a share of the stage that is on."""
        return self.start.t + share * self.duration

    @contextmanager
    def foreseen(self, index: int) -> Iterator[None]:
        """As if stage `index` were on, each before it having gone its full length with the tools in their first places."""
        behind, self.ends, self.ahead = self.ends, [], True
        for duration in self.durations[:index]:
            self.ends.append(End(self.start.t + duration, self.origin.q, self.origin.forces))
        try:
            yield
        finally:
            self.ends, self.ahead = behind, False
