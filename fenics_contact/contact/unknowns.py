"""Contact pressures as unknowns of Newton's method beside the displacement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fenics_contact.assembly.term import State
from fenics_contact.contact.trial import PRESENT

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact


class Unknowns:
    """Pressures by which a contact's points are judged, open or closed, stuck or slipping, instead of their present gaps."""

    def __init__(self, contact: Contact) -> None:
        self._contact = contact

    @property
    def foresees(self) -> bool:
        """Whether pressures may be unknowns beside the displacement."""
        return self._contact.partner.foresees

    @property
    def settles(self) -> bool:
        """Whether these pressures alone say who is in contact."""
        return self._contact.partner.settles

    def foresee(self, state: State, at: Any) -> None:
        """Take the pressures that the tangent at the places `at` foresees at the state as unknowns until `release`."""
        gaps = self._contact.partner.foreseen(self._contact.places.feet(state), at, self._contact.trial)
        self._contact.take(self._contact.trial.judging(gaps))

    def hold(self, share: float) -> None:
        """Take the pressures of the last accepted step, carried on by `share` of the change in it, as unknowns."""
        trial = self._contact.trial
        self._contact.take(trial.judging(self._contact.partner.carried_on(trial, share)))

    def release(self) -> None:
        """Judge by the present gaps again."""
        if len(self._contact.trial.judged):
            self._contact.take(self._contact.trial.judging(PRESENT))
