"""The states that a run has accepted, and the way back to the last one."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from fenics_contact.assembly.scales import Scales
from fenics_contact.assembly.stages import End, Stages
from fenics_contact.assembly.term import State, Term
from fenics_contact.types import Array, Floats


class Accepted(NamedTuple):
    """Displacement (local array) and tools' coordinates (tools, 6) [length] of an accepted state, and its t."""

    u: Floats
    q: Floats
    t: float


class Trail:
    """Goes on to the state at hand, or back to the last one accepted; who then wants its forces has to assemble them.

    terms, scales: what remembers beside the state; set_loads(t): puts the loads of t into the forms. last: the last accepted
    state; accepted: the last three, as far as they lie on one smooth path; returns: how often a step was taken back.
    """

    def __init__(
        self, state: State, terms: Sequence[Term], scales: Scales, stages: Stages, set_loads: Callable[[float], None]
    ) -> None:
        self._state, self._terms, self._scales, self._stages, self._set_loads = state, terms, scales, stages, set_loads
        self.last = self._here()
        self.accepted = [self.last]
        self.returns = 0

    def _here(self) -> Accepted:
        return Accepted(self._state.u.x.array.copy(), self._state.q.copy(), self._state.t)

    def commit(self) -> None:
        """Accept the state at hand. Collective."""
        for term in self._terms:
            term.commit(self._state)
        self._state.poses.accept(self._state.q)
        self._scales.commit()
        self.last = self._here()
        self.accepted = [*self.accepted[-2:], self.last]

    def rollback(self) -> None:
        """Return to the last accepted state."""
        self.returns += 1
        for term in self._terms:
            term.rollback()
        self._scales.rollback()
        self._state.u.x.array[:], self._state.q[:], self._state.t = self.last
        self._set_loads(self._state.t)

    def resume(self, q: Floats, t: float, histories: Sequence[dict[str, Array]], before: Sequence[Accepted] = ()) -> None:
        """Declare the displacement in the state, with these tools' coordinates and t, the accepted one, after those of
        `before`, like `accepted`; histories: of each term, what its `history` gave there. Collective."""
        self._state.q[:] = q
        self._state.t = t
        self._set_loads(t)
        self.last = self._here()
        for term, values in zip(self._terms, histories, strict=True):
            term.restore(values, self._state)
        self.accepted = [*before, self.last]

    def next_stage(self, end: End) -> None:
        """The stage that is on ends at the last state, like `end`, and the next one begins there, rotations too; steps are
        not extrapolated over the corner."""
        self._stages.leave(end)
        self._state.poses.begin(self._state.q)
        self._set_loads(self._state.t)
        self.accepted = [self.last]
