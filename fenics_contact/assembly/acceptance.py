"""What must be so before a state in balance is accepted."""

from collections.abc import Sequence
from typing import Protocol

from fenics_contact.assembly.finding import CRUSHED, RIGID_MOTION, Finding, Remark
from fenics_contact.assembly.grounding import Grounding
from fenics_contact.assembly.holds import ALLOWED, Holds
from fenics_contact.assembly.scales import TOLERANCE, Scales
from fenics_contact.assembly.term import State, Term


class Cells(Protocol):
    """The bodies' cells, by J = det F and how they turn. Collective."""

    def check(self, least: float = 0.0) -> Finding | None:
        """None, or the Finding that names the cell with the smallest J where that is at most `least`."""

    def look(self) -> tuple[float, dict[str, Remark]]:
        """The smallest J; and what is to be said of cells, by kind."""

    def folded(self) -> Remark | None:
        """What is to be said of a cell that has turned at a corner, against its middle, farther than a body can."""


class Acceptance:
    """Asks the cells, the terms, and what holds the bodies. cells, holds, grounding: as System has them."""

    def __init__(
        self, state: State, terms: Sequence[Term], cells: Cells, holds: Holds, scales: Scales,
        grounding: Grounding | None,
    ) -> None:  # fmt: skip
        self._state, self._terms, self._cells = state, terms, cells
        self._holds, self._scales, self._grounding = holds, scales, grounding

    def objection(self) -> Finding | None:
        """None, or the Finding why a state in balance must not be accepted. Collective."""
        found = self._cells.check(CRUSHED)
        for term in self._terms:
            found = found or term.findings.objection(self._state)
        return found or self.adrift()

    def loose(self) -> dict[int, str]:
        """{number of a body: letters of the axes along which neither supports nor contacts that press in this state hold
        it}, where there are such. Collective."""
        if not self._holds.reliant:
            return {}
        # a force that an unbalanced one may be as large as holds nothing
        least = max(ALLOWED * self._scales.largest, TOLERANCE * self._scales.balance)
        return self._holds.loose(lambda contact: contact.forces.holding(self._state, least))

    def adrift(self) -> Finding | None:
        """None, or the Finding that a body has lost what holds it: then any place is in balance, and none is the answer.
        Collective."""
        if self._grounding is None or self._grounding.engaged or not (loose := self.loose()):
            return None
        names = ", ".join(self._holds.bodies[i][0] for i in sorted(loose))
        along = " and ".join(sorted(set("".join(loose.values()))))
        remedy = "solve(..., method=Method(stabilise=True)), fix a surface, or end the path before"
        return Finding(RIGID_MOTION, f"no contact that could hold it along {along} presses", f"body '{names}'", remedy)
