"""Contact of a slave surface with its master as one term of a System: pure response and tangent, history when accepted."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.scales import ROUNDED
from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import DRAWN, ContactLaw, History, Response, Trial, Trials
from fenics_contact.contact.findings import Findings
from fenics_contact.contact.forces import Forces
from fenics_contact.contact.friction import stated
from fenics_contact.contact.led import Led
from fenics_contact.contact.multipliers import Multipliers
from fenics_contact.contact.partner import Partner, Places
from fenics_contact.contact.parts import Parts
from fenics_contact.contact.penalties import LARGEST, STIFFEST, Penalties, Penalty
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.kernels.law import Friction
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.timing import Timers
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64


class Interface(NamedTuple):
    """What the user states of two surfaces that touch: friction; penalty, as it is stated; penetration: how deep a point may
    lie in the master and how far one that sticks may slip [length], None: as the penalty alone gives."""

    friction: Friction
    penalty: Penalty
    penetration: float | None


class Contact(ContactTerm):
    """Penalty contact with Coulomb friction between slave points and a master.

    partner: what the points of its surface meet; interface: what they do there; supports: what leads nodes; state: the
    initial one, in which every point is anchored at its projection. Response and tangent depend on the state and a Trial
    alone: `accepted` is what the last accepted step left, `trial` what the present one is tried with. All methods that take
    a state are collective, and so are those of what others ask by: forces, led, parts, findings, penalties, multipliers.
    """

    condensed = False
    surface: SlaveSurface
    partner: Partner
    places: Places
    penalties: Penalties
    multipliers: Multipliers
    forces: Forces
    findings: Findings
    led: Led
    parts: Parts

    def __init__(
        self,
        name: str,
        partner: Partner,
        interface: Interface,
        supports: Supports,
        state: State,
        timers: Timers,
    ) -> None:
        surface, (friction, penalty, penetration) = partner.surface, interface
        self.name, self.surface, self.timers = name, surface, timers
        self.key, self.friction_stated = surface.key, stated(friction)
        self.partner, self.places, self.master_name = partner, partner.places, partner.name
        self.penetration = penetration
        comm = state.comm
        self.led, self.forces = Led(self, supports, comm), Forces(self)
        self.parts, self.findings = Parts(self), Findings(self)
        law = ContactLaw(*penalty.values(surface.stiffness, friction), friction, self._round_off(state))
        self.penalties, self.multipliers = Penalties(self, law, penalty.adapts()), Multipliers(self)
        ne, nq = surface.area.shape
        none = partner.anchors.none()
        raised = np.tile([1.0, LARGEST if penetration is None else STIFFEST], (ne, 1))
        zero = np.zeros((ne, nq))
        start = History(none, none, none, zero, zero, zero.astype(bool), (zero.ravel(),) * 2, raised, None, zero)
        first = partner.anchors.here(self.places.first_feet(state), Trial(law, start, surface.area))
        start = replace(start, anchors=first, rests=first, before=first, feet=self.places.feet(state))
        self.accepted = self.trial = Trial(law, start, surface.area)
        self.symmetric = not self.rough and partner.smooth
        self._last: tuple[Any, Trial, Response] | None = None  # feet, trial and response of the last evaluation
        self._close_drawn_gaps(state)

    def _round_off(self, state: State) -> float:
        """Gap [length] up to which a point counts as closed: what the last places of its coordinates make.

        One that is closed with a greater gap would pull, and its partners rub: what nothing holds would creep.
        """
        far = max(state.comm.allgather(np.abs(self.surface.X).max(initial=0.0)))
        return ROUNDED * (far + self.places.reach)

    def _close_drawn_gaps(self, state: State) -> None:
        """Take the gaps that surfaces drawn in contact carry at the first state out of all gaps to come; remember these."""
        gap = self.response(state).gap
        shift = np.where((gap > 0.0) & (gap <= DRAWN * self.surface.cell_height), -gap, 0.0)
        gaps = (gap + shift).ravel()
        self.accepted = self.trial = self.trial.remembering(shift=shift, gaps=(gaps, gaps))
        self.response(state)

    # -- evaluation -----------------------------------------------------------------------------------------------
    def response(self, state: State, trial: Trial | None = None) -> Response:
        """What the points do at a state; trial: by default the present one."""
        return self._evaluated(state, trial)[1]

    def _evaluated(self, state: State, trial: Trial | None) -> tuple[Any, Response]:
        """The points' feet at a state and what they do there."""
        trial = trial or self.trial
        feet = self.places.feet(state)
        last = self._last
        if last is None or last[0] is not feet or last[1] is not trial:
            with self.timers("contact kernel"):
                last = self._last = feet, trial, self.partner.response(feet, trial)
        return feet, last[2]

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None:
        """Add a area T to the slave nodes' forces and its opposite to the master's, (14)."""
        feet, response = self._evaluated(state, (trials or {}).get(self))
        with self.timers("insertion"):
            self.partner.add_forces(feet, response, residual, tool_residual)

    def couplings(self, state: State, trials: Trials | None = None) -> Ints64 | None:
        return self.partner.couplings(self.places.feet(state), (trials or {}).get(self, self.trial))

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        """The exact derivative of the residual."""
        feet = self.places.feet(state)
        with self.timers("contact kernel"):
            return self.partner.tangent(feet, (trials or {}).get(self, self.trial))

    # -- history --------------------------------------------------------------------------------------------------
    def commit(self, state: State) -> None:
        """Accept the state: the only place where history changes for good."""
        self.trial = self.trial.judging()
        if self.places.sights:
            self.places.sights.commit()
        anchors, trial, response = self.partner.anchors, self.trial, self.response(state)
        feet, h = self.places.feet(state), trial.history
        rests = h.rests
        if trial.rough or self.penetration is not None:
            here, stuck = anchors.resting(feet, trial), response.status == STICK
            rests = anchors.chosen(stuck, rests, here)
        kept, slid = anchors.committed(feet, trial)
        # what has opened rubbed until then: on all of its way, in the mean of the friction before and none
        rubbed, slid = slid, np.where(response.status == SLIP, slid, 0.0)
        if self.penetration is not None:  # multipliers have moved the anchors since the step began; rests have stayed
            slid, rubbed = anchors.slid(feet, trial, response.status)
        gaps = (response.gap + h.shift).ravel(), h.gaps[0]
        met, path = h.met | (response.status != OPEN), h.slip_path + slid
        self.trial = self.accepted = trial.remembering(
            anchors=kept, rests=rests, before=h.anchors, slip_path=path, rubbed=h.rubbed + rubbed, met=met, gaps=gaps,
            feet=feet, faced=max(h.faced, self._facing(state, feet, met)),
        )  # fmt: skip

    def _facing(self, state: State, feet: Any, met: Bools) -> float:
        """Area [length^2] of the points that have been in contact which lies over the master. Collective."""
        over = self.surface.area.ravel() * (1.0 - self.places.bare(feet))
        return float(state.comm.allreduce(over[met.ravel()].sum()))

    def take(self, trial: Trial) -> None:
        """Go on with other penalties or multipliers, until the next rollback or commit."""
        self.trial = trial

    def hold_sights(self, state: State) -> bool:
        """Hold what looks towards the samples of averages until a commit or rollback; False where there are none, or it is
        held."""
        sights = self.places.sights
        if sights is None or sights.held is not None:
            return False
        sights.hold(self.places.feet(state), self.timers)
        return True

    def resample(self, state: State) -> bool:
        """Choose anew, until a rollback, points that lie where they do on the slave for the master's sake; False where there
        are none, or what looks towards them is held. Collective."""
        if self.places.sights is not None and self.places.sights.held is not None:
            return False
        before, self.trial = self.trial, self.partner.resampled(self.trial, self.places.feet(state))
        return self.trial is not before

    def rollback(self) -> None:
        """Back to the law and history of the last accepted step."""
        if self.places.sights:
            self.places.sights.free()
        self.trial = self.accepted
        self.partner.return_to(self.trial)

    def history(self) -> dict[str, Array]:
        h, points = self.accepted.history, self.surface.area.shape
        packed = self.partner.anchors.packed
        out = packed(h.anchors, h.feet, "anchor") | packed(h.rests, h.feet, "rest") | self.partner.sites(h.feet)
        gaps = np.stack(h.gaps, axis=-1).reshape(*points, 2)
        out |= {"slip_path": h.slip_path, "rubbed": h.rubbed, "met": h.met, "raised": h.raised, "gaps": gaps}
        return out if self.penetration is None else out | {"shift": h.shift}

    def restore(self, values: dict[str, Array], state: State) -> None:
        values = {name: np.ascontiguousarray(values[name]) for name in self.history()}
        h = self.accepted.history
        self.partner.put_sites(values, state)
        feet = self.places.feet(state)
        anchors, rests = (self.partner.anchors.unpacked(values, name) for name in ("anchor", "rest"))
        gaps = tuple(np.ascontiguousarray(values["gaps"].reshape(-1, 2).T))
        h = replace(h, anchors=anchors, rests=rests, before=anchors, slip_path=values["slip_path"], met=values["met"])
        h = replace(
            h, rubbed=values["rubbed"], raised=values["raised"], shift=values.get("shift", h.shift), gaps=gaps, feet=feet
        )
        h = replace(h, faced=self._facing(state, feet, h.met))
        self.trial = self.accepted = self.penalties.with_raised(Trial(self.accepted.law, h, self.surface.area))

    # -- what others ask ------------------------------------------------------------------------------------------
    @property
    def rough(self) -> bool:
        """Whether there is friction."""
        return self.trial.rough

    def statuses(self) -> Ints:
        return self._last[2].status.ravel() if self._last else np.empty(0, dtype=np.int32)

    def spots(self) -> Floats:
        return np.einsum("eqk,ekc->eqc", self.surface.a, self.surface.X).reshape(-1, 3)
