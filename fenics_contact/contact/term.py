"""Contact of a slave surface with its master as one term of a System: pure response and tangent, history when accepted."""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.finding import Finding
from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.system import ROUNDED
from fenics_contact.assembly.term import State
from fenics_contact.contact import findings
from fenics_contact.contact.friction import allowed, stated
from fenics_contact.contact.measures import contact_measures, stored_energy
from fenics_contact.contact.multipliers import Multipliers
from fenics_contact.contact.partner import Partner
from fenics_contact.contact.penalties import LARGEST, Penalties, Penalty
from fenics_contact.contact.trial import DRAWN, PRESENT, History, Law, Response, Trial
from fenics_contact.kernels.law import Friction
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.timing import Timers
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64

FIXED = 1e-6  # of a point's motion along its normal: what else its free nodes could give is rounding of the normal


class Contact:
    """Penalty contact with Coulomb friction between slave points and a master.

    partner: what the points of its surface meet; friction: Friction; penalty: as the user states it; tolerance: how deep a
    point may lie in the master and how far one that sticks may slip [length], None: as the penalty alone gives; supports:
    what leads nodes; state: the initial one, in which every point is anchored at its projection. Response and
    tangent depend on the state and a Trial alone: `accepted` is what the last accepted step left, `trial` what the present
    one is tried with. All methods that take a state are collective.
    """

    condensed = False

    def __init__(
        self,
        name: str,
        partner: Partner,
        friction: Friction,
        penalty: Penalty,
        tolerance: float | None,
        supports: Supports,
        state: State,
        timers: Timers,
    ) -> None:
        surface = partner.surface
        self.name, self.surface, self.partner, self.timers = name, surface, partner, timers
        self.tolerance = tolerance
        free = supports.free(surface.nodes)
        # (ne, k, 3, 3): directions, by rows, in which supports let the slave nodes go; None on all ranks where all do
        led = int((~free.any(axis=3)).any())
        comm = state.u.function_space.mesh.comm
        self._free = free if comm.allreduce(led) else None
        ways = free.any(axis=3).sum(axis=2)[:, 0]  # in which the first node of each element may go
        self._guided = ways < max(comm.allgather(int(ways.max(initial=0))))
        # whether slave nodes follow others: beyond a pair of faces the bodies go on, and contact does not
        self.paired = (
            comm.allreduce(int(supports.pairs is not None and np.isin(surface.nodes, supports.pairs.nodes).any())) > 0
        )
        law = Law(*penalty.values(surface.stiffness, friction), friction, self._round_off(state))
        self.penalties, self.multipliers = Penalties(self, law, penalty.adapts(tolerance)), Multipliers(self)
        ne, nq = surface.area.shape
        none = partner.no_anchors()
        far = np.full(ne * nq, min(partner.search, np.finfo(float).max))
        raised = np.tile([1.0, LARGEST], (ne, 1))
        zero = np.zeros((ne, nq))
        start = History(none, none, none, zero, zero, zero.astype(bool), (far, far), raised, None)
        first = partner.places(partner.first_feet(state), Trial(law, start, surface.area))
        start = replace(start, anchors=first, rests=first, before=first, feet=partner.feet(state))
        self.accepted = self.trial = Trial(law, start, surface.area)
        self.symmetric = not self.rough and partner.smooth
        self._last: tuple[Any, Trial, Response] | None = None  # feet, trial and response of the last evaluation
        self._close_drawn_gaps(state)

    def _round_off(self, state: State) -> float:
        """Gap [length] up to which a point counts as closed: what the last places of its coordinates make.

        One that is closed with a greater gap would pull, and its partners rub: what nothing holds would creep.
        """
        far = max(state.u.function_space.mesh.comm.allgather(np.abs(self.surface.X).max(initial=0.0)))
        return ROUNDED * (far + self.partner.reach)

    def _close_drawn_gaps(self, state: State) -> None:
        """Take the gaps that surfaces drawn in contact carry at the first state out of all gaps to come."""
        gap = self.response(state).gap
        shift = np.where((gap > 0.0) & (gap <= DRAWN * self.surface.cell_height), -gap, 0.0)
        self.accepted = self.trial = self.trial.remembering(shift=shift)
        self.response(state)

    # -- evaluation -----------------------------------------------------------------------------------------------
    def response(self, state: State, trial: Trial | None = None) -> Response:
        """What the points do at a state; trial: by default the present one."""
        return self._evaluated(state, trial)[1]

    def _evaluated(self, state: State, trial: Trial | None) -> tuple[Any, Response]:
        """The points' feet at a state and what they do there."""
        trial = trial or self.trial
        feet = self.partner.feet(state)
        last = self._last
        if last is None or last[0] is not feet or last[1] is not trial:
            with self.timers("contact kernel"):
                last = self._last = feet, trial, self.partner.response(feet, trial)
        return feet, last[2]

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trial: Trial | None = None) -> None:
        """Add a area T to the slave nodes' forces and its opposite to the master's, (14)."""
        feet, response = self._evaluated(state, trial)
        with self.timers("insertion"):
            self.partner.add_forces(feet, response, residual, tool_residual)

    def add_followed_residual(self, state: State, residual: Floats, tool_residual: Floats) -> None:
        """The residual: there are no condensed unknowns."""
        self.add_residual(state, residual, tool_residual)

    def couplings(self, state: State) -> Ints64 | None:
        """None, or keys of global blocks beyond those of the cells."""
        return self.partner.couplings(self.partner.feet(state), self.trial)

    def tangent(self, state: State, trial: Trial | None = None) -> Blocks:
        """The exact derivative of the residual."""
        feet = self.partner.feet(state)
        with self.timers("contact kernel"):
            return self.partner.tangent(feet, trial or self.trial)

    # -- Newton's own unknowns ------------------------------------------------------------------------------------
    @property
    def foresees(self) -> bool:
        """Whether pressures may be unknowns beside the displacement."""
        return self.partner.foresees

    @property
    def settles(self) -> bool:
        """Whether these pressures alone say who is in contact."""
        return self.partner.settles

    def foresee(self, state: State, at: Any) -> None:
        """Take the pressures that the tangent at the places `at` foresees at the state as unknowns until `release`."""
        gaps = self.partner.foreseen(self.partner.feet(state), at, self.trial)
        self.trial = self.trial.judging(gaps)

    def hold(self, share: float) -> None:
        """Take the pressures of the last accepted step, carried on by `share` of the change in it, as unknowns."""
        now, before = self.trial.history.gaps
        # a pressure doubles or halves at most: it stays one, and what was open before gives no slope
        gaps = np.where(now < 0.0, np.clip(now + share * (now - before), 2.0 * now, 0.5 * now), now)
        self.trial = self.trial.judging(gaps)

    def release(self) -> None:
        """Judge by the present gaps again."""
        if len(self.trial.judged):
            self.trial = self.trial.judging(PRESENT)

    # -- history --------------------------------------------------------------------------------------------------
    def commit(self, state: State) -> None:
        """Accept the state: the only place where history changes for good."""
        self.release()
        if self.partner.sights:
            self.partner.sights.free()
        partner, trial, response = self.partner, self.trial, self.response(state)
        feet, h = partner.feet(state), trial.history
        rests = h.rests
        if trial.rough or self.tolerance is not None:
            here, stuck = partner.resting(feet, trial), response.status == STICK
            rests = partner.chosen(stuck, rests, here)
        anchors, slid = partner.committed(feet, trial)
        gaps = (response.gap + h.shift).ravel(), h.gaps[0]
        met, path = h.met | (response.status != OPEN), h.slip_path + slid
        self.trial = self.accepted = trial.remembering(
            anchors=anchors, rests=rests, before=h.anchors, slip_path=path, met=met, gaps=gaps, feet=feet
        )

    def take(self, trial: Trial) -> None:
        """Go on with other penalties or multipliers, until the next rollback or commit."""
        self.trial = trial

    def hold_sights(self, state: State) -> bool:
        """Hold what looks towards the samples of averages until a commit or rollback; False where there are none, or it is
        held."""
        sights = self.partner.sights
        if sights is None or sights.held is not None:
            return False
        sights.hold(self.partner.feet(state))
        return True

    def rollback(self) -> None:
        """Back to the law and history of the last accepted step."""
        if self.partner.sights:
            self.partner.sights.free()
        self.trial = self.accepted

    def history(self) -> dict[str, Array]:
        """{name: array (ne, ...)} of what commit writes, for elements numbered by `key` (ne,) on any partition alike."""
        h, points = self.accepted.history, self.surface.area.shape
        out = self.partner.packed(h.anchors, "anchor") | self.partner.packed(h.rests, "rest")
        out |= {"slip_path": h.slip_path, "met": h.met, "raised": h.raised}
        if self.foresees:
            out["gaps"] = np.stack(h.gaps, axis=-1).reshape(*points, 2)
        return out if self.tolerance is None else out | {"shift": h.shift}

    def restore(self, values: dict[str, Array], state: State) -> None:
        """Take up what history gave for this rank's elements, at the accepted state."""
        values = {name: np.ascontiguousarray(values[name]) for name in self.history()}
        h = self.accepted.history
        anchors, rests = (self.partner.unpacked(values, name) for name in ("anchor", "rest"))
        gaps = tuple(np.ascontiguousarray(values["gaps"].reshape(-1, 2).T)) if self.foresees else h.gaps
        h = replace(h, anchors=anchors, rests=rests, before=anchors, slip_path=values["slip_path"], met=values["met"])
        h = replace(h, raised=values["raised"], shift=values.get("shift", h.shift), gaps=gaps, feet=self.partner.feet(state))
        self.trial = self.accepted = self.penalties.with_raised(Trial(self.accepted.law, h, self.surface.area))

    # -- what others ask ------------------------------------------------------------------------------------------
    @property
    def rough(self) -> bool:
        """Whether there is friction."""
        return self.trial.rough

    @property
    def friction_stated(self) -> float | dict[str, Any]:
        """Coulomb's mu, or the numbers of a friction law by name."""
        return stated(self.trial.law.friction)

    @property
    def key(self) -> Ints64:
        return self.surface.key

    @property
    def master_name(self) -> str:
        return self.partner.name

    def statuses(self) -> Ints:
        """Status codes (n,) of this rank's points at the state evaluated last."""
        return self._last[2].status.ravel() if self._last else np.empty(0, dtype=np.int32)

    def spots(self) -> Floats:
        """Reference positions (n, 3) of the points."""
        return np.einsum("eqk,ekc->eqc", self.surface.a, self.surface.X).reshape(-1, 3)

    def normals(self, state: State) -> Floats:
        """Unit normals (ne, nq, 3) along which pressure acts on the points; zero without a partner."""
        return self.partner.normals(self.partner.feet(state))

    def split_traction(self, state: State, trial: Trial | None = None) -> tuple[Floats, Floats]:
        """Contact pressure (ne, nq) and friction traction on the slave (ne, nq, 3) [pressure, per reference area]."""
        response = self.response(state, trial)
        if response.split is not None:
            return response.split
        traction, normal = response.traction, self.normals(state)
        pressure = -np.einsum("eqc,eqc->eq", traction, normal)
        return pressure, -traction - pressure[..., None] * normal

    def measures(self, state: State, trial: Trial | None = None) -> dict[str, Any]:
        """Sums over all ranks, see `contact_measures`."""
        return contact_measures(self, state, trial or self.trial)

    def resultants(self, state: State, trial: Trial | None = None) -> tuple[Floats, Floats]:
        """Force on the slave (3,), summed over all ranks, and contact pressure at this rank's points (n,)."""
        return self.measures(state, trial)["force"], self.split_traction(state, trial)[0].ravel()

    def limits(self, state: State) -> Floats:
        """Largest friction tractions (ne, nq) that the pressures allow [pressure, per reference area]."""
        return allowed(self.partner.friction(self.partner.feet(state), self.trial), *self.split_traction(state))

    def press(self, state: State, residual: Floats, tool_residual: Floats) -> float:
        """Add what the pressures alone give, friction apart; returns this rank's energy in their penalties."""
        alone = self.trial.with_friction(0.0)
        self.add_residual(state, residual, tool_residual, alone)
        return stored_energy(self, state, alone)

    def grip(self, state: State) -> tuple[float, float]:
        """(friction, what its law allows): sums of their sizes over this rank's points at a state [force]."""
        along, area = self.split_traction(state)[1], self.surface.area
        return float((np.linalg.norm(along, axis=2) * area).sum()), float((self.limits(state) * area).sum())

    def holding(self, state: State, least: float) -> set[str]:
        """Letters of the axes along which the contact holds a body at a state: none where it presses with no more than
        `least` [force] in all; with friction all, else those that the normals of closed points have a part in."""
        response = self.response(state)
        closed, pressing = response.status != OPEN, np.linalg.norm(response.traction, axis=2) * self.surface.area
        along = np.abs(self.normals(state)[closed]).max(axis=0, initial=0.0) > 1e-6
        along = along | (self.rough and bool(closed.any()))
        sums = state.u.function_space.mesh.comm.allreduce(np.append(along.astype(float), pressing.sum()))
        return {letter for letter, count in zip("xyz", sums, strict=False) if count and sums[3] > least}

    def fixed(self, state: State) -> Bools:
        """Which points (ne, nq) supports prescribe along the contact's normal."""
        s = self.surface
        if self._free is None:
            return np.zeros(s.area.shape, dtype=bool)
        moved = np.abs(np.einsum("eqk,eqc,ekfc->eqkf", s.a, self.partner.looks(state), self._free))
        return moved.max(axis=(2, 3), initial=0.0) <= FIXED

    def covered(self, state: State) -> Floats:
        """Shares (ne, nq) of the points' areas that lie over the master."""
        return 1.0 - self.partner.bare(self.partner.feet(state)).reshape(self.surface.area.shape)

    def led(self, state: State) -> Bools:
        """Which points (ne, nq) are fixed against a master that gives way no more than they do: a tool."""
        return self.fixed(state) if self.partner.grounded else np.zeros(self.surface.area.shape, dtype=bool)

    def depths(self, state: State, shift: Floats | float = 0.0) -> Floats:
        """Penetrations (ne, nq) [length] that the contact has to answer for, multipliers added as lengths if so asked."""
        response = self.response(state)
        held = (response.cover >= 1.0) & (response.status != OPEN) & ~self.led(state)
        return np.where(held, -(response.gap + shift), 0.0)

    def lean(self, state: State) -> Floats:
        """`Partner.lean` at a state, of this rank: ends that a support holds, as a plane of symmetry does, count as none.
        Collective."""
        return self.partner.lean(self.partner.feet(state), self.trial, self._guided)

    def held_axes(self, state: State) -> set[str]:
        """Axes along which the contact can hold a body that it touches."""
        return self.partner.held_axes(state, self.response(state).gap, self.rough)

    # -- parts of it, for the audit of the tangent ----------------------------------------------------------------
    def laws(self, frictionless: bool) -> dict[str, int]:
        """{name: status code} of the laws that can hold at a point."""
        return {"normal": CLOSED} if frictionless else {"stick": STICK, "slip": SLIP}

    def part(self, mask: Bools, frictionless: bool = False) -> Trial:
        """A trial in which the points (n,) of a mask alone exert forces, without friction if so asked."""
        trial = self.trial.only(mask)
        return trial.with_friction(0.0) if frictionless else trial

    def branches(self, state: State, trial: Trial | None = None) -> Ints:
        """Rows of codes (n, ...), the status first: where one changes the traction has a kink."""
        status = self.response(state, trial).status.reshape(-1, 1)
        return np.column_stack([status, self.partner.features(self.partner.feet(state))])

    # -- findings -------------------------------------------------------------------------------------------------
    def objection(self, state: State) -> Finding | None:
        return findings.objection(self, state)

    def trouble(self, state: State) -> Finding | None:
        return findings.trouble(self, state)

    def deep(self, state: State) -> Finding | None:
        return findings.deep(self, state)

    def drawn_inside(self, state: State) -> Finding | None:
        return findings.drawn_inside(self, state)

    def remarks(self, state: State, said: Collection[str]) -> dict[str, str]:
        return findings.remarks(self, state, said)

    def never_met(self, state: State) -> str | None:
        return findings.never_met(self, state)
