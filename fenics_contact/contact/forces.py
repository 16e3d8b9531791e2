"""What a contact's points exert at a state: pressure and friction, their sums, and how far they hold a body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.friction import allowed
from fenics_contact.contact.measures import contact_measures, stored_energy, within_facets
from fenics_contact.kernels.status import OPEN
from fenics_contact.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

ROUNDINGS = 1e3  # of a gap, see ContactLaw: points that rest without load lie within so many, which solves leave


class Forces:
    """Of the points of a contact."""

    def __init__(self, contact: Contact) -> None:
        self._contact = contact
        self._last: tuple[Response, tuple[Floats, Floats]] | None = None  # split last: what measures a state asks often

    def normals(self, state: State) -> Floats:
        """Unit normals (ne, nq, 3) along which pressure acts on the points; zero without a partner."""
        return self._contact.places.normals(self._contact.places.feet(state))

    def split_traction(self, state: State, trial: Trial | None = None) -> tuple[Floats, Floats]:
        """Contact pressure (ne, nq) and friction traction on the slave (ne, nq, 3) [pressure, per reference area], between
        which the law of friction holds; trial: by default the present one."""
        response = self._contact.response(state, trial)
        if response.split is not None:
            return response.split
        if self._last is None or self._last[0] is not response:
            traction, normal = response.traction, self.normals(state)
            pressure = -np.einsum("eqc,eqc->eq", traction, normal)
            self._last = response, (pressure, -traction - pressure[..., None] * normal)
        return self._last[1]

    def acting(self, state: State) -> tuple[Floats, Floats]:
        """The same as results show them: the sizes (ne, nq) of what acts normal to what is pressed, and the vectors (ne, nq,
        3) along it, which add up to the force. Where they lean at ends and creases, or slide on a round side, averages press
        by more than the law's pressure."""
        acting = self._contact.response(state).acting
        return self.split_traction(state) if acting is None else acting

    def pressing(self, state: State) -> Floats:
        """What pressure alone exerts on the slave (ne, nq, 3) [pressure, per reference area]."""
        return -self._contact.response(state).traction - self.acting(state)[1]

    def round_off(self) -> Floats:
        """Pressures (ne, 1) up to which points touch by round-off alone: of gaps that the coordinates do not resolve."""
        law = self._contact.trial.law
        return law.eps_n[:, None] * law.touch

    def idle(self, state: State) -> tuple[Bools, Bools]:
        """Which points (n,) of this rank touch and carry no more than what solves leave of round-off, and which more."""
        closed = self._contact.response(state).status != OPEN
        # judged by what was foreseen, closed points may pull meanwhile
        loaded = closed & (np.abs(self.split_traction(state)[0]) > ROUNDINGS * self.round_off())
        return (closed & ~loaded).ravel(), loaded.ravel()

    def pressed(self, state: State, points: Bools, slight: float) -> bool:
        """Whether one of these points (n,) lies deeper than `slight` [length], and than what is round-off. Collective."""
        trial = self._contact.trial
        depth = -(self._contact.response(state).gap + trial.history.shift).ravel()[points]
        deepest = max(state.comm.allgather(depth.max(initial=-np.inf)))
        return bool(deepest > max(slight, ROUNDINGS * trial.law.touch))

    def status(self, state: State) -> Ints:
        """Codes (ne, nq) of kernels/status.py for results: open, too, is what presses by no more than round-off, as a node
        does that a support holds on a tool."""
        return np.where(self.split_traction(state)[0] > self.round_off(), self._contact.response(state).status, OPEN)

    def measures(self, state: State) -> dict[str, Any]:
        """Sums over all ranks, see `contact_measures`."""
        return contact_measures(self._contact, state)

    def within_facets(self, state: State) -> float:
        """See `measures.within_facets`. Collective."""
        return within_facets(self._contact, state)

    def resultants(self, state: State) -> tuple[Floats, Floats]:
        """Force on the slave (3,), summed over all ranks, and contact pressure at this rank's points (n,)."""
        return self.measures(state)["force"], self.acting(state)[0].ravel()

    def limits(self, state: State) -> Floats:
        """Largest friction tractions (ne, nq) that the pressures allow [pressure, per reference area]."""
        limits, shares = _allowed(self._contact, state)
        return limits * shares

    def rubs(self, state: State) -> tuple[Floats, Floats]:
        """Limits (ne, nq) of friction, times what it does more on ways in other planes than those of the slave's facets, and
        the shares (ne, nq) of them that it may have in its directions [pressure, per reference area; 1]."""
        power, (limits, shares) = self._contact.response(state).power, _allowed(self._contact, state)
        return limits * (1.0 if power is None else power), shares

    def press(self, state: State, residual: Floats, tool_residual: Floats) -> float:
        """Add what the pressures alone give, friction apart; returns this rank's energy in their penalties."""
        alone = self._contact.trial.with_friction(0.0)
        self._contact.add_residual(state, residual, tool_residual, {self._contact: alone})
        return stored_energy(self._contact, state, alone)

    def stored(self, state: State) -> float:
        """Energy [force x length] in the penalties at this rank's points."""
        return stored_energy(self._contact, state, self._contact.trial)

    def grip(self, state: State) -> tuple[float, float]:
        """(friction, what its law allows): sums of their sizes over this rank's points at a state [force]."""
        along, area = self.split_traction(state)[1], self._contact.surface.area
        return float((np.linalg.norm(along, axis=2) * area).sum()), float((self.limits(state) * area).sum())

    def holding(self, state: State, least: float) -> set[str]:
        """Letters of the axes along which the contact holds a body at a state: none where it presses with no more than
        `least` [force] in all; with friction all, else those that the normals of closed points have a part in."""
        response = self._contact.response(state)
        closed, pressing = response.status != OPEN, np.linalg.norm(response.traction, axis=2) * self._contact.surface.area
        along = np.abs(self.normals(state)[closed]).max(axis=0, initial=0.0) > 1e-6
        along = along | (self._contact.rough and bool(closed.any()))
        sums = state.comm.allreduce(np.append(along.astype(float), pressing.sum()))
        return {letter for letter, count in zip("xyz", sums, strict=False) if count and sums[3] > least}

    def could_hold(self, state: State) -> set[str]:
        """Letters of the axes along which the contact can hold a body that it touches."""
        return self._contact.partner.held_axes(state, self._contact.response(state).gap, self._contact.rough)

    def covered(self, state: State) -> Floats:
        """Shares (ne, nq) of the points' areas that lie over the master."""
        return 1.0 - self._contact.places.bare(self._contact.places.feet(state)).reshape(self._contact.surface.area.shape)


def _allowed(contact: Contact, state: State) -> tuple[Floats, Floats]:
    """See `friction.allowed`, at a contact's points (ne, nq)."""
    law = contact.partner.friction(contact.places.feet(state), contact.trial)
    return allowed(law, *contact.forces.split_traction(state))
