"""A run's energy balance: work of supports, loads and tools, against what bodies, penalties, friction and damping took."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.exchange import sum_to_owners
from fenics_contact.assembly.section import Section, adding_up
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import State, Term
from fenics_contact.types import Floats


@dataclass(frozen=True)
class Energies:
    """Since the start [force x length]: external_work of supports, loads, tools and swelling, and what it went into: strain,
    in the bodies; penalty, what is stored in the penalties; friction, by contact; damping. pressures: by contact the part of
    the error that its pressures leave, which act along the slave's normals. balance: size of the sum of all outer forces,
    zero in equilibrium [force]. done: the work, in or out, of each step by supports, tools and each kind of load."""

    external_work: float = 0.0
    strain: float = 0.0
    penalty: float = 0.0
    friction: Mapping[str, float] = field(default_factory=dict)
    damping: float = 0.0
    balance: float = 0.0
    pressures: Mapping[str, float] = field(default_factory=dict)
    done: float = 0.0

    @property
    def error(self) -> float:
        """What is left of the external work: an error of the steps, third order in the length of each."""
        return self.external_work - self.strain - self.penalty - sum(self.friction.values()) - self.damping


@dataclass(frozen=True)
class _Rubbing:
    """Of a contact's points (ne, nq): friction tractions that do the work at most; ways on which they have; areas."""

    limit: Floats
    way: Floats
    area: Floats

    @classmethod
    def of(cls, contact: ContactTerm, state: State) -> "_Rubbing":
        return cls(contact.forces.rubs(state), contact.trial.history.rubbed, contact.surface.area)

    def work(self, last: "_Rubbing") -> float:
        """Of friction since the last state: what slides does so at the limit."""
        return float((0.5 * (self.limit + last.limit) * (self.way - last.way) * self.area).sum())


@dataclass(frozen=True)
class _Pressing:
    """What a contact's pressures ask of this rank: forces on local dofs and wrenches on the tools (tools, 6) that hold
    against them; stored: energy in their penalties."""

    on_dofs: Floats
    wrenches: Floats
    stored: float

    @classmethod
    def of(cls, contact: ContactTerm, system: System) -> "_Pressing":
        on_dofs, wrenches = np.zeros_like(system.state.u.x.array), np.zeros_like(system.tool_residual)
        stored = contact.forces.press(system.state, on_dofs, wrenches)
        return cls(on_dofs, wrenches, stored)


@dataclass(frozen=True)
class _Forces:
    """At an accepted state: displacement (local array) and tools' coordinates (tools, 6); outer forces on the owned dofs,
    of each term of loads and of all supports, (parts, dofs), and wrenches on the tools; ratios by which bodies swell and the
    rates of this rank's energy with them; energies of the bodies and stored in all penalties; by contact its Rubbing and
    Pressing."""

    u: Floats
    q: Floats
    on_dofs: Floats
    wrenches: Floats
    ratios: Floats
    on_ratios: Floats
    strain: float
    stored: float
    rubbing: dict[str, _Rubbing]
    pressing: dict[str, _Pressing]


class EnergyBalance:
    """Work between accepted states by the trapezoidal rule. loads: the terms of dead loads and pressures; so_far: Energies
    of a run that is resumed; section: what a plane mesh stands for; let_go: what the last step has let go in a jump, which
    has gone into damping where that was asked for [force length]."""

    def __init__(
        self, system: System, loads: Sequence[Term], so_far: Energies | None = None, section: Section | None = None
    ) -> None:
        self._system, self._loads = system, loads
        self._adds_up = adding_up(section)
        system.assemble_residual()
        self.now, self.let_go, self._resumed = so_far or self._at_start(), 0.0, so_far is not None
        self._last = self._forces()
        self._before: tuple[_Forces, Floats] | None = None  # the state before, and what was left from it to the last
        # of what pressures left, by contact, and of the error, over all pairs of steps: in the two; in one as long
        self._of_pairs = np.zeros((2, len(system.contacts) + 1))

    def _at_start(self) -> Energies:
        """What bodies and penalties hold already counts as work done on them."""
        rough = [contact.name for contact in self._system.contacts if contact.rough]
        strain, stored = self._system.strain_energy(), self._stored()
        pressures = {contact.name: 0.0 for contact in self._system.contacts}
        done = strain + stored
        return Energies(done, strain, stored, dict.fromkeys(rough, 0.0), pressures=pressures, done=done)

    def _stored(self) -> float:
        """Energy in all penalties. Collective."""
        system = self._system
        return float(system.comm.allreduce(sum(contact.forces.stored(system.state) for contact in system.contacts)))

    @property
    def growth(self) -> dict[str, float]:
        """By contact how many times as much of the work its pressures would leave with steps twice as long, and by "" how
        many times the error, damping in it: 4 where steps of a smooth path are its cause, 1 where the model is. Of pairs of
        steps: there are none without one, nor of a run that is resumed, which knows the last of them alone."""
        if self._resumed:
            return {}
        in_two, in_one = self._of_pairs
        rates = zip([*self._last.pressing, ""], in_one, in_two, strict=True)
        return {name: float(one / two) for name, one, two in rates if two != 0.0}

    def advance(self, jumped: bool) -> Energies:
        """The Energies at the state just accepted; jumped: damped motion has led there. Collective."""
        system, last, here = self._system, self._last, self._forces()
        works, rubbed = self._works(last, here)
        friction = {name: self.now.friction[name] + more for name, more in zip(here.rubbing, rubbed, strict=True)}
        left = self._left(last, here)
        pressures = {name: self.now.pressures[name] + more for name, more in zip(here.pressing, left, strict=False)}
        if self._before:
            self._of_pairs += [self._before[1] + left, self._left(self._before[0], here)]
        self._before = last, left
        outer = system.comm.allreduce(here.on_dofs.sum(axis=0).reshape(-1, 3).sum(axis=0))
        balance = float(np.linalg.norm((outer + here.wrenches[:, :3].sum(axis=0))[self._adds_up]))
        before, now = self.now, Energies(
            self.now.external_work + float(works.sum()), here.strain, here.stored, friction,
            self.now.damping, balance, pressures, self.now.done + float(np.abs(works).sum()),
        )  # fmt: skip
        # What a jump lets go is what is left of all else: the work of viscous forces has in it what they add to the way
        self.let_go = max(now.error - before.error, 0.0) if jumped else 0.0
        if system.damped:
            now = replace(now, damping=now.damping + self.let_go)
        self._last, self.now = here, now
        return now

    def _works(self, start: _Forces, end: _Forces) -> tuple[Floats, Floats]:
        """Work between two states, of each part of the outer forces, swelling and tools, (parts + 2,), and of friction, by
        rough contact. Collective."""
        parts, owned = end.on_dofs.shape
        outer = 0.5 * (start.on_dofs + end.on_dofs) @ (end.u - start.u)[:owned]
        swelling = 0.5 * (start.on_ratios + end.on_ratios) @ (end.ratios - start.ratios)
        rubbed = [rubbing.work(start.rubbing[name]) for name, rubbing in end.rubbing.items()]
        sums = self._system.comm.allreduce(np.array([*outer, swelling, *rubbed]))
        tools = self._work_on_tools(start.wrenches, end.wrenches, start, end)
        return np.append(sums[: parts + 1], tools), sums[parts + 1 :]

    def _left(self, start: _Forces, end: _Forces) -> Floats:
        """By contact the work against its pressures less what their penalties took of it, and, last, all of the work less
        what bodies, penalties and friction took, (contacts + 1,). Collective."""
        works, rubbed = self._works(start, end)
        taken = end.strain + end.stored - start.strain - start.stored
        return np.append(self._left_by_pressures(start, end), works.sum() - rubbed.sum() - taken)

    def _left_by_pressures(self, start: _Forces, end: _Forces) -> Floats:
        """By contact the work against its pressures less what their penalties took of it, (contacts,). Collective."""
        left = np.zeros(len(end.pressing))
        for i, (name, second) in enumerate(end.pressing.items()):
            first = start.pressing[name]
            work = 0.5 * (first.on_dofs + second.on_dofs) @ (end.u - start.u)
            work += self._work_on_tools(first.wrenches, second.wrenches, start, end)
            left[i] = work - (second.stored - first.stored)
        return np.asarray(self._system.comm.allreduce(left))

    def _work_on_tools(self, first: Floats, second: Floats, start: _Forces, end: _Forces) -> float:
        """Of wrenches (tools, 6) at two states. Rotations are counted as they are now, since the beginning of a stage or the
        last step: at both ends alike."""
        ends = ((start.q, first), (end.q, second))
        forces = np.sum([self._per_coordinate(q, wrenches) for q, wrenches in ends], axis=0)
        return float(0.5 * (forces * (end.q - start.q)).sum())

    def _per_coordinate(self, q: Floats, wrenches: Floats) -> Floats:
        """Forces (tools, 6) whose products with the coordinates q are the work of wrenches there."""
        poses, pairs = self._system.state.poses, zip(q, wrenches, strict=True)
        rows = [poses.at(i, own).per_coordinate(wrench) for i, (own, wrench) in enumerate(pairs)]
        return np.array(rows).reshape(-1, 6)

    def _forces(self) -> _Forces:
        system, state = self._system, self._system.state
        vector, ignored = system.new_vector(), np.zeros_like(system.tool_residual)
        forces = np.zeros((len(self._loads) + 1, len(vector.array)))
        for term, mine in zip(self._loads, forces, strict=False):
            with vector.localForm() as local:
                local.set(0.0)
                term.add_residual(state, local.array_w, ignored)
            sum_to_owners(vector)
            mine[:] = -vector.array
        vector.destroy()
        # what tools hold is their work
        system.supports.put_forces(forces[-1], np.where(system.supports.tied, 0.0, system.reactions))
        loads = system.tools.forces(state.t)  # all that acts on free components, springs that let go apart
        wrenches = np.where(system.tools.free, loads, system.tool_residual + loads)
        return _Forces(
            state.u.x.array.copy(),
            state.q.copy(),
            forces,
            wrenches,
            *system.terms[0].swelling(),
            system.strain_energy(),
            self._stored(),
            {contact.name: _Rubbing.of(contact, state) for contact in system.contacts if contact.rough},
            {contact.name: _Pressing.of(contact, system) for contact in system.contacts},
        )
