"""By what all contacts judge their points within a step, beside the present gaps."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.term import State, Term
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Array, Floats

FEW = 0.1  # of the points in contact


class Foresight:
    """Contact pressures as unknowns that solves carry along, and sights that are held.

    contacts: those that foresee pressures; foretells: do all contacts foresee friction, too; settles: do both alone say who
    is in contact; linearised: {term: where its points were at the last tangent}.
    """

    def __init__(self, contacts: Sequence[ContactTerm]) -> None:
        self._all = contacts
        self.contacts = [contact for contact in contacts if contact.partner.foresees]
        self.foretells = bool(contacts) and all(contact.partner.foretells for contact in contacts)
        self.settles = self.foretells and all(contact.partner.settles for contact in contacts)
        self.linearised: dict[Term, Any] = {}
        self._statuses: dict[Term, Array] = {}  # of its points then
        self._told: dict[ContactTerm, Floats] = {}  # by what they had been before samples changed
        self._samples_held = False

    def learn(self, term: Term, at: Any) -> None:
        """A tangent has been taken where a term's points were `at`."""
        self.linearised[term], self._statuses[term] = at, term.statuses()

    def foresee(self, state: State) -> None:
        """Let contacts take what the last tangent foresees at the state as their own unknowns, until `release`."""
        for contact, gaps in (self._foreseen(state) or self._told).items():
            contact.take(contact.trial.judging(gaps))

    def _foreseen(self, state: State) -> dict[ContactTerm, Floats]:
        known = [contact for contact in self.contacts if contact in self.linearised]
        return {c: c.partner.foreseen(c.places.feet(state), self.linearised[c], c.trial) for c in known}

    def changes_little(self, state: State) -> bool:
        """Whether hardly a point has, by what the last tangent foresees at the state, another status than it had in that
        tangent. Leaves contacts judging by their gaps. Collective."""
        self.foresee(state)
        changed = in_contact = 0
        for contact in self.contacts:
            contact.response(state)
            then, now = self._statuses.get(contact, contact.statuses()), contact.statuses()
            changed += int(np.count_nonzero(now != then))
            in_contact += int(np.count_nonzero(now))
        self.release()
        changed, in_contact = state.comm.allreduce(np.array([changed, in_contact]))
        return bool(changed <= FEW * in_contact)

    def first_turns(self, state: State) -> tuple[float, float]:
        """After which share of the way from where the last tangent was taken the first of the points that slipped in it has
        slid back to its anchor, and after which share of the same way backwards; inf: none does. Where all contacts settle
        who is in contact by themselves, of those alone in which nothing stuck, else of those that do not. Collective."""
        counts = self._loose(state) if self.settles else [not contact.partner.settles for contact in self.contacts]
        known = [c for c, one in zip(self.contacts, counts, strict=True) if one and c in self.linearised]
        ahead = [c.partner.ahead(c.places.feet(state), self.linearised[c], c.trial) for c in known]
        start, end = np.concatenate([np.empty((0, 2)), *ahead]).T
        first = [(start[lost > 0.0] / lost[lost > 0.0]).min(initial=np.inf) for lost in (start - end, end - start)]
        onwards, back = np.min(state.comm.allgather(first), axis=0)
        return float(onwards), float(back)

    def _loose(self, state: State) -> list[bool]:
        """Of contacts, whether points of theirs slipped in the last tangent, and none stuck. Collective."""
        counts = np.zeros((len(self.contacts), 2), dtype=np.int64)
        for contact, row in zip(self.contacts, counts, strict=True):
            statuses, codes = self._statuses.get(contact, contact.statuses()), contact.parts.laws(frictionless=False)
            row[:] = [np.count_nonzero(statuses == codes[name]) for name in ("slip", "stick")]
        return [bool(slip and not stick) for slip, stick in state.comm.allreduce(counts)]

    def hold(self, share: float) -> None:
        """Let them take the pressures of the last accepted state, carried on by `share` of the last change, until then."""
        for contact in self.contacts:
            contact.take(contact.trial.judging(contact.partner.carried_on(contact.trial, share)))

    def release(self) -> None:
        """Let all contacts judge by their gaps again, those too that softer penalties have pressing as before."""
        for contact in self._all:
            contact.take(contact.trial.judging())

    @contextmanager
    def trying(self, trials: Trials) -> Iterator[None]:
        """Contacts, and all that goes by what they press with, are evaluated with these trials meanwhile."""
        own = {contact: contact.trial for contact in trials}
        try:
            for contact, trial in trials.items():
                contact.take(trial)
            yield
        finally:
            for contact, trial in own.items():
                contact.take(trial)

    def resample(self, state: State) -> bool:
        """Let averages take their samples where the surfaces lie at a state, until a rollback; the residual changes, and
        nothing is foreseen before the next tangent. False where there are none, or they are held. Collective."""
        if self._samples_held:
            return False
        changed = max((contact.resample(state) for contact in self._all), default=False)
        if changed:
            self.linearised.clear()
            self._told = {}
        return changed

    def follow(self, state: State) -> bool:
        """The same near balance, of which the contacts go on taking what they have: the gaps that new samples find differ
        from the old ones' by more than a soft part presses a penalty in. Collective."""
        if not any(contact.partner.settles for contact in self._all):  # averages do: others have no samples
            return False
        told = {contact: contact.partner.found(contact.places.feet(state), contact.trial) for contact in self.contacts}
        if changed := self.resample(state):
            self._told = told
        return changed

    @contextmanager
    def holding_samples(self) -> Iterator[None]:
        """Averages keep their samples meanwhile."""
        before, self._samples_held = self._samples_held, True
        try:
            yield
        finally:
            self._samples_held = before

    def hold_sights(self, state: State) -> bool:
        """Hold what facets all contacts see until a commit or rollback; False where that changes nothing. Collective."""
        return max((contact.hold_sights(state) for contact in self._all), default=False)

    @contextmanager
    def as_accepted(self) -> Iterator[None]:
        """All contacts see meanwhile what they saw when the last state was accepted."""
        with ExitStack() as stack:
            for contact in self._all:
                stack.enter_context(contact.places.as_accepted())
            yield
