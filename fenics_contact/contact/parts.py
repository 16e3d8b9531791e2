"""Parts of a contact, for the audit of its tangent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Trial
from fenics_contact.kernels.status import CLOSED, SLIP, STICK
from fenics_contact.types import Bools, Ints

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact


class Parts:
    """The laws that can hold at a contact's points, and trials in which some points act alone."""

    def __init__(self, contact: Contact) -> None:
        self._contact = contact

    def laws(self, frictionless: bool) -> dict[str, int]:
        """{name: status code} of the laws that can hold at a point."""
        return {"normal": CLOSED} if frictionless else {"stick": STICK, "slip": SLIP}

    def part(self, mask: Bools, frictionless: bool = False) -> Trial:
        """A trial in which the points (n,) of a mask alone exert forces, without friction if so asked."""
        trial = self._contact.trial.only(mask)
        return trial.with_friction(0.0) if frictionless else trial

    def branches(self, state: State, trial: Trial | None = None) -> Ints:
        """Rows of codes (n, ...), the status first: where one changes the traction has a kink."""
        status = self._contact.response(state, trial).status.reshape(-1, 1)
        return np.column_stack([status, self._contact.places.features(self._contact.places.feet(state))])
