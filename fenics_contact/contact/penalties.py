"""Penalties of a contact: from the stiffness beneath its slave points, raised where these sink in too far all the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import ContactLaw, Trial
from fenics_contact.contact.foremost import worst
from fenics_contact.contact.friction import Friction
from fenics_contact.kernels.status import OPEN, STICK
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from fenics_contact.contact.term import Contact

# Default penalty over (Young's modulus at rest / distance of nodes below each other): the force it costs is in
# docs/evidence.md.
PENALTY_FACTOR = 100.0
# Default tangential over normal penalty: ten times more elastic slip, for far fewer iterations, as long as a point on the
# Coulomb cone has slipped elastically no further than SLIPS times its penetration, mu / share: beyond a friction of 0.3 the
# share grows with it, or the elastic slip would cost several percent of the force (docs/choices.md).
TANGENTIAL_SHARE = 0.1
SLIPS = 3.0
# Of the height of the cell beneath: a deeper point raises a default penalty. The default gets there where the pressure is
# twice Young's modulus (degree 2: four times): strains of order one, a corner, or rubber that cannot escape.
DEEPEST = 0.02
AIM = 0.5  # of that depth: where a raised penalty puts the deepest point under the same pressure
# Of the bodies' energy what the default penalties of all contacts may hold: more raises them, until each holds KEPT of it.
# That is rubber that cannot escape, K/E times as stiff as the default knows
YIELDS, KEPT = 0.05, 0.004
# Likewise where other strains hide that: from which share of the bodies' energy on a solve tells what penalties cost. More
# than YIELDS of a load raises them, until it is twice KEPT, as energy goes with the square
DOUBTED = 0.01
BEYOND = 0.5  # over which what slips from where it rests has a greater trial traction
LARGEST = 10.0  # times the default; Newton's method fails the more often the stiffer it gets beyond (studies, map_penalty)
# Under multipliers, for rubber that cannot escape is K/E stiffer than the default knows: times the default at most, and at
# once. With K/E of 1e5 a thousand times it is still no stiffer than the body.
STIFFEST, GROWTH = 1000.0, 10.0
# Penalties on the way to a step's solution, where the penalties themselves are too stiff for it: at first so soft that the
# deepest point of the last accepted state would lie as deep as under a raised penalty, down to this part of them
SOFTEST = 0.01
WORTH = 0.5  # a greater part of the penalties is no help


Raised = tuple[Trial, str]


@dataclass(frozen=True)
class Penalty:
    """Penalties as the user states them; what is stated is never changed by a run.

    normal, tangential: the penalties [pressure/length]; factor: in the place of a normal one, on E/h at each slave point (E:
    modulus of the softer body, h: height of the slave's cell), 100 by default; share: in the place of a tangential one,
    tangential over normal, 0.1 by default, more at high friction.
    """

    normal: float | None = None
    tangential: float | None = None
    factor: float | None = None
    share: float | None = None

    def values(self, stiffness: Floats, friction: Friction) -> tuple[Floats, Floats]:
        """Normal and tangential penalties (ne,) [pressure/length] over bodies of a stiffness (ne,)."""
        normal = np.full_like(stiffness, self.normal) if self.normal else (self.factor or PENALTY_FACTOR) * stiffness
        share = self.share or max(TANGENTIAL_SHARE, max(friction.mu, friction.mu / friction.ratio) / SLIPS)
        return normal, np.full_like(normal, self.tangential) if self.tangential else share * normal

    def adapts(self) -> tuple[bool, bool]:
        """Which of both a run may raise: numbers that the user has given stay what they are."""
        own = not (self.normal or self.factor)
        return own, own and not self.tangential


class Penalties:
    """How the penalties of a contact may change: raised for good, softer on the way to a solution, or stiffer for once.

    law: with those at first; adapts: which of both, normal and tangential, a run may raise.
    """

    def __init__(self, contact: Contact, law: ContactLaw, adapts: tuple[bool, bool]) -> None:
        self._contact, self._first, self._adapts = contact, law, adapts

    @property
    def remedy(self) -> str:
        """What to state where multipliers do not get to their penetration= with these."""
        if self._adapts[0]:
            return f"state a Penalty(factor={100 * PENALTY_FACTOR:g}), a hundred times the default, beside penetration="
        out = "leave its penalty= out, which is then raised as multipliers need it"
        return f"{out}, or state a Penalty(factor=...) a hundred times as great beside penetration="

    def stated(self, comm: MPI.Comm) -> tuple[float, float]:
        """Least and greatest of stated normal penalties over E/h; the default's of those that are not. Collective."""
        if self._adapts[0]:
            return PENALTY_FACTOR, PENALTY_FACTOR
        over = self._first.eps_n / self._contact.surface.stiffness
        ends = comm.allgather((-over.min(initial=np.inf), over.max(initial=0.0)))
        least, most = np.max(ends, axis=0)
        return -float(least), float(most)

    # -- raised where points lie too deep -------------------------------------------------------------------------
    def with_raised(self, trial: Trial) -> Trial:
        """The penalties that its history says."""
        factor = trial.history.raised[:, 0]
        eps_t = self._first.eps_t * factor if self._adapts[1] else self._first.eps_t
        law = ContactLaw(self._first.eps_n * factor, eps_t, trial.law.friction, trial.law.touch)
        return trial.under(law)

    def stored(self, state: State) -> float:
        """Energy in normal penalties that may be raised [force length]. Collective."""
        if self._contact.penetration is not None or not self._adapts[0]:
            return 0.0
        contact = self._contact
        squares = contact.trial.law.eps_n[:, None] * contact.led.depths(state) ** 2
        return state.comm.allreduce(float((0.5 * squares * contact.surface.area).sum()))

    def raised(
        self,
        state: State,
        strain: Callable[[], float],
        cost: Callable[[], float],
        stored: tuple[float, float],
        noise: float,
    ) -> Raised | None:
        """None; or, where a point lies deeper than DEEPEST allows, or penalties hold more energy or cost more of the load
        than YIELDS allows, a trial with greater penalties, and words. Multipliers hold points out of there.

        strain(): energy in the bodies; cost(): part of the load, see `penalty_costs`; stored: in these penalties, and in
        those of all contacts; noise: what of it is rounding [force length]. Collective.
        """
        if self._contact.penetration is not None or not self._adapts[0]:
            return None
        own, of_all = stored
        contact, trial = self._contact, self._contact.trial
        raised, depths = trial.history.raised, contact.led.depths(state)
        depth, place = self._depth(depths, state.comm)
        if depth > DEEPEST and (room := self.room(state)) > 1.0:
            factor, why = min(depth / (AIM * DEEPEST), room), f"{place} lies {depth:.1%} of a cell deep"
        elif own > noise and of_all > DOUBTED * (held := strain()) and own > KEPT * held:
            # what has been raised in vain before stays where it is
            room = self.room(state, np.where(raised[:, 1] < LARGEST, raised[:, 0], STIFFEST))
            if room == 1.0:
                return None
            part, least, of = own / max(held, noise), KEPT, "hold {:.0%} of the bodies' energy"
            if of_all <= YIELDS * held:
                part, least, of = cost(), 2.0 * KEPT, "change its force by about {:.0%} of the load"
                if part <= YIELDS:
                    return None
            factor, why = min(part / least, room), f"contact '{contact.name}': its penalties {of.format(part)}"
        else:
            return None
        if self._adapts[1]:
            trial = self.friction_kept(trial, factor)
        trial = self.with_raised(trial.remembering(raised=raised * [factor, 1.0]))
        most = max(state.comm.allgather(trial.history.raised[:, 0].max(initial=1.0)))
        return trial, f"{why}: penalties raised to {most:.3g} times the default"

    def room(self, state: State, most: Floats | None = None) -> float:
        """By how much the penalties may still be raised, 1 where not at all; most (ne,): times the default that they may
        become, by default what the history says. Collective."""
        raised, bound = self._contact.trial.history.raised.T
        room = min(state.comm.allgather(((bound if most is None else most) / raised).min(initial=np.inf)))
        # round-off of a factor that has reached its bound
        return room if self._adapts[0] and room > 1.0 + 1e-9 else 1.0

    def under_multipliers(self, state: State) -> Trial:
        """Penalties GROWTH times greater, if there is room, beneath multipliers that stay: what these have taken over is
        carried as before, what they have not is held by so much more. Collective."""
        contact, trial = self._contact, self._contact.trial
        factor, h, feet = min(GROWTH, self.room(state)), trial.history, contact.places.feet(state)
        anchors = h.anchors
        if trial.rough and self._adapts[1]:
            anchors = contact.partner.anchors.stiffened(feet, trial, h.rests, factor)
        gaps = h.gaps[0] / factor, h.gaps[1] / factor  # they stand for pressures, as shifts do
        trial = trial.remembering(anchors=anchors, shift=h.shift / factor, gaps=gaps)
        return self.with_raised(trial.remembering(raised=h.raised * [factor, 1.0]))

    def held_back(self) -> Trial:
        """Penalties have been raised in vain in this step: later ones may be raised half as far, under multipliers once
        less."""
        trial, part = self._contact.trial, 0.5 if self._contact.penetration is None else 1.0 / GROWTH
        factor, bound = trial.history.raised.T
        return trial.remembering(raised=np.stack([factor, np.maximum(factor, part * bound)], axis=1))

    def raise_factor(self, state: State) -> float:
        """By how much the penalties are greater than at first, on all ranks. Collective."""
        raised = self._contact.trial.history.raised
        return max(state.comm.allgather(raised[:, 0].max(initial=1.0)))

    def _depth(self, depths: Floats, comm: MPI.Comm) -> tuple[float, str]:
        """(deepest point [of a cell's height], its place). Collective."""
        return worst(self._contact, comm, (depths / self._contact.surface.height[:, None]).ravel())

    def friction_kept(self, trial: Trial, factor: float) -> Trial:
        """Points feel their accepted friction traction again under tangential penalties greater by a factor."""
        partner, feet = self._contact.partner, trial.history.feet
        rests = partner.anchors.here(feet, trial)
        return trial.remembering(anchors=partner.anchors.stiffened(feet, trial, rests, factor))

    # -- softer on the way to a solution --------------------------------------------------------------------------
    def softness(self, state: State) -> float:
        """The part of the penalties under which the accepted pressures sink AIM * DEEPEST of a cell, or 1. Collective.

        Not under a sharp edge, where other points then hold (19 cut-backs instead of 7 on a punch with 1000 E/h); with
        facets as a master it has not been tried.
        """
        if not self._contact.partner.softens:
            return 1.0
        depths = self._contact.led.depths(state, self._contact.trial.history.shift)
        depth = self._depth(depths, state.comm)[0]
        part = max(depth / (AIM * DEEPEST), SOFTEST)
        return part if part < WORTH else 1.0

    def softened(self, state: State, part: float) -> Trial:
        """A part of the penalties at an accepted state; until `release` points press as they did. Friction goes on from
        the traction it had."""
        contact = self._contact
        before, feet = contact.trial, contact.places.feet(state)
        gaps = np.divide(contact.response(state).gap + before.history.shift, part)
        trial = self.friction_kept(before, part)
        trial = trial.remembering(shift=before.history.shift / part).under(before.law.times(part))
        return trial.judging(contact.partner.deciding(feet, before, trial, gaps, np.ones_like(gaps)))

    def holding_up(self, state: State) -> Trial:
        """Penalties so great that the deepest point of an accepted state would lie AIM * DEEPEST deep; points press and rub
        as they do all the same. Collective."""
        contact, trial = self._contact, self._contact.trial
        depth, _ = self._depth(contact.led.depths(state), state.comm)
        factor, shift, response = max(depth / (AIM * DEEPEST), 1.0), trial.history.shift, contact.response(state)
        gap = np.where(response.status != OPEN, response.gap, 0.0)
        trial = self.friction_kept(trial, factor).remembering(shift=(gap + shift) / factor - gap)
        return trial.under(trial.law.times(factor))

    # -- varied to see what they cost -----------------------------------------------------------------------------
    def stiffened(self, state: State, factor: float) -> Trial:
        """Penalties greater by a factor at a state just accepted: forces are those that they would give.

        Multipliers stay; what sticks has rested at the same place under the same traction, and slips on from there by as
        much; what slipped in the last step slips, with a trial traction well beyond its limit: where it has come to a halt
        it is on the limit, and would stick or slip by round-off. Collective.
        """
        contact, h = self._contact, self._contact.trial.history
        trial, of = contact.trial.remembering(anchors=h.before), contact.partner.anchors
        feet, sticks = contact.places.feet(state), contact.response(state, trial).status == STICK
        new, beyond = (of.stiffened(feet, trial, h.rests, grown) for grown in (factor, BEYOND))
        trial = trial.remembering(anchors=of.chosen(sticks, new, beyond), shift=h.shift / factor)
        return trial.under(trial.law.times(factor))
