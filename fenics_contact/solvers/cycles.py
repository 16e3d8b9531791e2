"""Cycles of contact status within a Newton iteration: the same sets of open, sticking and slipping points over and over."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import CYCLING, Finding, spot, tidied
from fenics_contact.assembly.system import System
from fenics_contact.solvers.verdict import SHORTENED, StepFailed
from fenics_contact.types import Array

LONGEST = 4  # period looked for
TURNS = 2  # repetitions that make a cycle; one may be chance


class StatusWatch:
    """Sees after each Newton iteration whether the statuses of all terms' points repeat. Collective throughout."""

    def __init__(self, system: System, notes: list[str]) -> None:
        self.system, self.notes = system, notes
        self._seen: list[Array] = []
        self._finding: Finding | None = None

    @property
    def cycling(self) -> bool:
        """Has a cycle been seen in this step?"""
        return self._finding is not None

    def look(self, residuals: list[float]) -> None:
        """Take down the statuses of now: do they repeat while the residuals do not fall? StepFailed where that goes on.

        Nor do the residuals fall where statuses stay and a facet comes into sight and goes out of it again.
        """
        period, changes = self._period()
        if period and residuals[-1] > 0.5 * residuals[-1 - TURNS * period]:
            if self.system.foresight.hold_sights(self.system.state):
                self._seen.clear()
                return
            if not changes:
                return
            self.blame()
            self._finding = self._cycle(period)
            shortened = "" if self.system.foresight.settles else f": {SHORTENED}"
            self.notes.append(f"{self._finding.reason} ({self._finding.place}){shortened}")
            self._seen.clear()

    def blame(self) -> None:
        """StepFailed, if a cycle was seen in this step: shorter increments have not helped."""
        if self._finding:
            raise StepFailed.of(self._finding)

    def _period(self) -> tuple[int, bool]:
        """0, or the period in which the statuses have been repeating, and whether any has changed: where none has, that of
        facets that come into sight and go out of it."""
        self._seen.append(np.concatenate([term.statuses() for term in self.system.terms]))
        repeats = np.min(self.system.comm.allgather([self._repeats(p) for p in range(1, LONGEST + 1)]), axis=0)
        if repeats[0]:  # what repeats with every period does not change at all
            return 2 * bool(repeats[1]), False
        return next((p for p, found in enumerate(repeats, 1) if found), 0), True

    def _repeats(self, period: int) -> bool:
        recent = self._seen[-(TURNS * period + 1) :]
        return len(recent) == TURNS * period + 1 and all(
            np.array_equal(a, b) for a, b in zip(recent, recent[period:], strict=False)
        )

    def _cycle(self, period: int) -> Finding:
        recent = np.array(self._seen[-period:])
        moving = (recent != recent[0]).any(axis=0)
        every = np.concatenate([term.spots() for term in self.system.terms])
        spots = tidied(every[moving], max(self.system.comm.allgather(np.abs(every).max(initial=0.0))))
        names = [name for term in self.system.terms for name in [term.name] * len(term.statuses())]
        here = [(names[i], *spots[j]) for j, i in enumerate(np.flatnonzero(moving))]
        points = sorted(point for part in self.system.comm.allgather(here) for point in part)
        place = ", ".join(f"contact '{point[0]}' at {spot(point[1:])}" for point in points[:3])
        text = f"the status of {len(points)} point{'s' * (len(points) > 1)} repeats every {period} iterations"
        ours = {point[0] for point in points}
        return Finding(CYCLING, text, place, _calmer([term for term in self.system.contact_terms if term.name in ours]))


def _calmer(contacts: Sequence[ContactTerm]) -> str:
    """What may end the cycle of points of these contacts."""
    ways = ["take more steps"]
    if any(contact.rough for contact in contacts):
        ways.append("lower Penalty(share=...)")
    if any(contact.partner.settles and not contact.partner.grounded for contact in contacts):
        ways.append("let slave and master change places")
    if any(contact.surface.at_nodes and not contact.partner.settles for contact in contacts):
        ways.append("use points=3 (Gauss points)")
    return ", or ".join(filter(None, (", ".join(ways[:-1]), ways[-1])))
