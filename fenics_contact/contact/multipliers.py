"""Multipliers of a contact: what they take over from the penalty until no error is left that matters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import ENDLESS, Trial
from fenics_contact.contact.friction import allowed
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.types import Floats

CLEAR = 2.0  # times the friction of points that are held: what they could hold

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact


class Multipliers:
    """Those of a contact with a largest penetration [length]: the penalty carries only what they do not yet carry.

    Between accepted steps they grow by Uzawa's rule (Simo & Laursen 1992, doi:10.1016/0045-7949(92)90540-G): lambda <-
    min(lambda + eps_N g, 0) and lambda_T <- lambda_T + eps_T times a point's slip since it came to rest, brought back to the
    limit of friction, which is kept in the place of its anchor. What slips needs that, too: a limit that falls leaves a
    greater lambda_T of old that goes on pushing where it did, whatever way the point is led. A point half out under a sharp
    edge keeps the body's spring that acts there in series with the penalty (cover = its share of eps_N): lambda <- cover
    (lambda + eps_N g) leaves that spring alone.
    """

    def __init__(self, contact: Contact) -> None:
        self._contact = contact

    def misfit(self, state: State) -> float:
        """Largest error of this rank's points over what is allowed: penetration, pressure across a gap, slip in stick
        or not along friction."""
        contact, trial = self._contact, self._contact.trial
        feet, status = contact.places.feet(state), contact.response(state).status
        slips = contact.partner.anchors.slips(feet, trial, status).max(initial=0.0)
        return max(np.abs(self._grown(state) - trial.history.shift).max(initial=0.0), slips) / contact.penetration

    def _grown(self, state: State) -> Floats:
        """Multipliers that take over what the penalty carries; a point that supports lead no force can hold out."""
        response, shift = self._contact.response(state), self._contact.trial.history.shift
        return np.where(self._contact.led.points(state), shift, np.minimum(response.cover * (response.gap + shift), 0.0))

    def held(self, state: State, trial: Trial, before: Trial, slipping: float = 1.0) -> Trial:
        """A trial judged, until `release`, so that what presses and sticks under the trial `before` does so; slipping: times
        the limit of friction of points that slip, which they are on: what less of it lets slip, too.

        At the state at hand what multipliers have just taken over acts twice, until the next solve takes it off the penalty:
        there a point may be past its limit of friction, or pull, that is neither in the balance to come; and where all slip
        nothing holds a body.
        """
        contact = self._contact
        feet, found = contact.places.feet(state), contact.response(state, before)
        pressed = (before.law.eps_n / trial.law.eps_n)[:, None] * (found.gap + before.history.shift)
        gaps, wide = np.where(found.status != OPEN, pressed, found.gap + trial.history.shift), np.ones_like(pressed)
        trial = trial.judging(contact.partner.deciding(feet, before, trial, gaps, wide))
        if not trial.rough:
            return trial
        pull = contact.forces.split_traction(state, trial.with_friction(ENDLESS))[1]
        pressure = contact.forces.split_traction(state, before)[0]
        limits, shares = allowed(contact.partner.friction(feet, trial), pressure, pull)
        pull, most = np.linalg.norm(pull, axis=2), limits * shares
        np.divide(CLEAR * pull, most, out=wide, where=(found.status == STICK) & (most > 0.0))
        wide = np.where(found.status == SLIP, slipping, np.maximum(wide, 1.0))
        return trial.judging(contact.partner.deciding(feet, before, trial, gaps, wide))

    def augmented(self, state: State, pressure: float = 1.0, friction: float = 1.0) -> Trial:
        """Multipliers have taken over shares of the pressure and of the friction that the penalty carries."""
        contact, trial = self._contact, self._contact.trial
        grown, shift = self._grown(state), trial.history.shift
        if pressure != 1.0:
            grown = shift + pressure * (grown - shift)
        if friction == 0.0:
            return trial.remembering(shift=grown)
        feet, status = contact.places.feet(state), contact.response(state).status
        return trial.remembering(shift=grown, anchors=contact.partner.anchors.augmented(feet, trial, status, friction))
