"""What a load or a prescribed displacement is over the stages of a run: each one's part, from where the last one ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.assembly.stages import Stages
from fenics_contact.scene.functions import Path, Ramp, Spread, sample, thinned, whole
from fenics_contact.types import Array, Floats

SAME = 1e-9  # of the largest value: nodes moved between ranks are rounded by 1e-16


@dataclass(frozen=True)
class Part:
    """What a stage does to a value: way, of its s; by: whether that counts from the value where the stage begins."""

    way: Path
    by: bool = False

    def value(self, start: Floats, share: float, everywhere: bool = False) -> Floats:
        """At this rank's places, as `start` has them, or everywhere."""
        if isinstance(self.way, Ramp) and not self.by:
            return start + share * (self.way.end - start)
        value = whole(self.way, share) if everywhere else self.way(share)
        return start + value if self.by else value


class Course(Spread):
    """A value as a function of t over the stages.

    own: what the scene states of it, its way in the first stage; named: {number of a stage: its Part}; it stays in those
    that have none. origin: its value before the first. mine (n,): which of the values, of all places, are those of this
    rank's nodes; None: there is one value.
    """

    of_all_ranks = True

    def __init__(
        self, stages: Stages, own: Path, named: Mapping[int, Part], origin: Floats, mine: Array | None = None
    ) -> None:
        self._stages, self._own, self._named, self._mine = stages, own, named, mine
        self._parts = {0: Part(own)} | dict(named)
        self._starts: dict[tuple[float, ...], Floats] = {(): origin}  # by the ends of the stages behind

    def begin(self, origin: Floats, before: Sequence[float]) -> None:
        """Start from another run's last value; before: what its scene said, which is not said again if it is the same."""
        self._starts = {(): np.broadcast_to(origin, self.shape)}
        said = self.said()
        if len(before) == len(said) and np.allclose(before, said, rtol=0.0, atol=SAME * np.abs(said).max(initial=0.0)):
            self._parts = dict(self._named)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the values, of all places."""
        return self._starts[()].shape

    def said(self) -> list[float]:
        """What the scene states, sampled. Collective."""
        return [float(x) for s in (0.5, 1.0) for x in np.ravel(sample(self._own, s))]

    def __call__(self, t: float) -> Floats:
        value = self.everywhere(t)
        return value if self._mine is None else value[self._mine]

    def everywhere(self, t: float) -> Floats:
        return self._value(self._stages.passed, t)

    def few(self, t: float) -> Floats:
        return self.everywhere(t) if self._mine is None else thinned(self.everywhere(t))

    def jump(self) -> float:
        """The largest step that it makes at the very start of the stage that is on. Collective."""
        passed = self._stages.passed
        return float(np.abs(self._value(passed, self._stages.start.t) - self._start(passed)).max(initial=0.0))

    def _value(self, passed: tuple[float, ...], t: float) -> Floats:
        start = self._start(passed)
        part = self._parts.get(len(passed))
        if part is None:
            return start
        value = part.value(start, self._stages.share(t, passed), self.of_all_ranks)
        return np.broadcast_to(value, start.shape)

    def _start(self, passed: tuple[float, ...]) -> Floats:
        if passed not in self._starts:
            self._starts[passed] = self._value(passed[:-1], passed[-1])
        return self._starts[passed]


class SupportCourse(Course):
    """The same of the displacement of a support's nodes (n,) [length], those of this rank."""

    of_all_ranks = False

    def led(self) -> bool:
        """Whether a stage moves them. Collective."""
        return any(np.any(sample(part.way, s)) for part in self._named.values() for s in (0.25, 0.5, 1.0))

    def few(self, t: float) -> Floats:
        """What the stage that is on states: a number's share at t, a function's values at a few nodes. Collective."""
        part = self._parts.get(self._stages.index)
        return np.zeros(1) if part is None else np.atleast_1d(sample(part.way, self._stages.share(t)))
