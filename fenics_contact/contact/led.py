"""What supports do to a contact's slave points: they may prescribe them along the contact's normal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.term import State
from fenics_contact.kernels.status import OPEN
from fenics_contact.types import Bools, Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

FIXED = 1e-6  # of a point's motion along its normal: what else its free nodes could give is rounding of the normal
LED = 0.01  # of a contact's force: what more of it acts on prescribed points is worth a note


class Led:
    """Of a contact's points those that supports lead, and what the others answer for. Collective."""

    def __init__(self, contact: Contact, supports: Supports, comm: MPI.Comm) -> None:
        self._contact = contact
        free = supports.free(contact.surface.nodes)
        # (ne, k, 3, 3): directions, by rows, in which supports let the slave nodes go; None on all ranks where all do
        led = int((~free.any(axis=3)).any())
        self._free = free if comm.allreduce(led) else None
        self._last: tuple[Any, Bools] | None = None  # feet, and which points are fixed there

    def fixed(self, state: State) -> Bools:
        """Which points (ne, nq) supports prescribe along the contact's normal."""
        s = self._contact.surface
        if self._free is None:
            return np.zeros(s.area.shape, dtype=bool)
        feet = self._contact.places.feet(state)
        if self._last is None or self._last[0] is not feet:
            moved = np.abs(np.einsum("eqk,eqc,ekfc->eqkf", s.a, self._contact.places.looks(state), self._free))
            self._last = feet, moved.max(axis=(2, 3), initial=0.0) <= FIXED
        return self._last[1]

    def points(self, state: State) -> Bools:
        """Which points (ne, nq) are fixed against a master that gives way no more than they do: a tool."""
        if self._contact.partner.grounded:
            return self.fixed(state)
        return np.zeros(self._contact.surface.area.shape, dtype=bool)

    def depths(self, state: State, shift: Floats | float = 0.0) -> Floats:
        """Penetrations (ne, nq) [length] that the contact has to answer for, multipliers added as lengths if so asked."""
        response = self._contact.response(state)
        held = (response.cover >= 1.0) & (response.status != OPEN) & ~self.points(state)
        return np.where(held, -(response.gap + shift), 0.0)

    def lean(self, state: State) -> Floats:
        """`Partner.lean` at a state, of this rank."""
        contact = self._contact
        return contact.partner.lean(contact.places.feet(state), contact.trial)
