"""A run's energy balance: work of supports, loads and tools, against what bodies, penalties, friction and damping took."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.section import Section, adding_up
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import State, Term
from fenics_contact.types import Floats, Ints64


@dataclass(frozen=True)
class Energies:
    """Since the start [force x length]: external_work of supports, loads, tools and swelling, and what it went into: strain,
    in the bodies; penalty, what is stored in the penalties; friction, by contact; damping. pressures: by contact the part of
    the error that its pressures leave, which act along the slave's normals. balance: size of the sum of all outer forces,
    zero in equilibrium [force]. done: the work, in or out, of each step by supports, tools and each kind of load, and, the
    work of nothing, drawn: what the first balance keeps of the energy of bodies drawn overlapping."""

    external_work: float = 0.0
    strain: float = 0.0
    penalty: float = 0.0
    friction: Mapping[str, float] = field(default_factory=dict)
    damping: float = 0.0
    balance: float = 0.0
    pressures: Mapping[str, float] = field(default_factory=dict)
    done: float = 0.0
    drawn: float = 0.0

    @property
    def error(self) -> float:
        """What is left of the external work: an error of the steps, third order in the length of each."""
        return self.external_work - self.strain - self.penalty - sum(self.friction.values()) - self.damping


@dataclass(frozen=True)
class _Rubbing:
    """Of a contact's points (ne, nq): limits of friction, and the shares of them that it may have in its directions; ways on
    which it has done work; areas."""

    limit: Floats
    share: Floats
    way: Floats
    area: Floats

    @classmethod
    def of(cls, contact: ContactTerm, state: State) -> "_Rubbing":
        return cls(*contact.forces.rubs(state), contact.trial.history.rubbed, contact.surface.area)

    def work(self, last: "_Rubbing") -> float:
        """Of friction since the last state: what slides does so at the limit in the direction in which it ends. That of
        friction which stuck before was another. What opens does so in the mean of its limit and none on all of its way, as
        the outer forces do the work of it: when it opened its ends do not tell, and where others come in as it goes what one
        has too much the next has too little."""
        share = np.where(self.limit > 0.0, self.share, last.share)
        return float((0.5 * (self.limit + last.limit) * share * (self.way - last.way) * self.area).sum())


@dataclass(frozen=True)
class _Pressing:
    """What a contact's pressures ask: forces on owned dofs and, of this rank, wrenches on the tools (tools, 6) that hold
    against them; stored: energy in their penalties; load: of those beyond round-off [force]."""

    on_dofs: Floats
    wrenches: Floats
    stored: float
    load: float

    @classmethod
    def of(cls, contact: ContactTerm, system: System) -> "_Pressing":
        local, wrenches = np.zeros_like(system.state.u.x.array), np.zeros_like(system.tool_residual)
        stored = contact.forces.press(system.state, local, wrenches)
        pressure = contact.forces.split_traction(system.state)[0]
        pressing = np.where(pressure > contact.forces.round_off(), pressure, 0.0)
        return cls(_summed(system, local), wrenches, stored, float((pressing * contact.surface.area).sum()))

    def scaled(self, share: float) -> "_Pressing":
        """What penalties give way by a share of it exert."""
        return _Pressing(share * self.on_dofs, share * self.wrenches, share**2 * self.stored, share * self.load)


@dataclass(frozen=True)
class _Forces:
    """At an accepted state: displacement of the owned dofs and tools' coordinates (tools, 6); outer forces on these dofs,
    of each term of loads and of all supports, (parts, dofs), and wrenches on the tools; ratios by which bodies swell and the
    rates of this rank's energy with them, and those of fields at owned nodes, (fields, nodes); energies of the bodies and
    stored in all penalties; by contact its Rubbing and Pressing."""

    u: Floats
    q: Floats
    on_dofs: Floats
    wrenches: Floats
    ratios: Floats
    on_ratios: Floats
    fields: Floats
    on_fields: Floats
    strain: float
    stored: float
    rubbing: dict[str, _Rubbing]
    pressing: dict[str, _Pressing]


class EnergyBalance:
    """Work between accepted states by the trapezoidal rule. loads: the terms of dead loads and pressures; so_far: Energies
    of a run that is resumed; section: what a plane mesh stands for; as_drawn: whether the run starts where bodies are drawn,
    which may overlap there and has never been in balance; let_go: what the last step has let go in a jump, which
    has gone into damping where that was asked for [force length]."""

    def __init__(
        self,
        system: System,
        loads: Sequence[Term],
        so_far: Energies | None = None,
        section: Section | None = None,
        as_drawn: bool = False,
    ) -> None:
        self._system, self._loads, self._as_drawn = system, loads, as_drawn and so_far is None
        self._adds_up = adding_up(section)
        system.assemble_residual()
        self.now, self.let_go, self._resumed = so_far or self._at_start(), 0.0, so_far is not None
        self._last = self._forces()
        self._before: tuple[_Forces, Floats] | None = None  # the state before, and what was left from it to the last
        self._keys: dict[str, Ints64] = {}
        # of what pressures left, by contact, and of the error, over all pairs of steps: in the two; in one as long
        self._of_pairs = np.zeros((2, len(system.contact_terms) + 1))

    def _at_start(self) -> Energies:
        """What bodies and penalties hold already counts as work done on them, but that of bodies drawn overlapping."""
        rough = [contact.name for contact in self._system.contact_terms if contact.rough]
        strain, stored = self._system.strain_energy(), 0.0 if self._as_drawn else self._stored()
        pressures = {contact.name: 0.0 for contact in self._system.contact_terms}
        done = strain + stored
        return Energies(done, strain, stored, dict.fromkeys(rough, 0.0), pressures=pressures, done=done)

    def _stored(self) -> float:
        """Energy in all penalties. Collective."""
        system = self._system
        return float(system.comm.allreduce(sum(contact.forces.stored(system.state) for contact in system.contact_terms)))

    @property
    def growth(self) -> dict[str, float]:
        """By contact how many times as much of the work its pressures would leave with steps twice as long, and by "" how
        many times the error, damping in it: 4 where steps of a smooth path are its cause, 1 where the model is. Of pairs of
        steps: there are none without one, nor where a checkpoint does not hold those before it."""
        if self._resumed:
            return {}
        in_two, in_one = self._of_pairs
        rates = zip([*self._last.pressing, ""], in_one, in_two, strict=True)
        return {name: float(one / two) for name, one, two in rates if two != 0.0}

    def advance(self, jumped: bool) -> Energies:
        """The Energies at the state just accepted; jumped: damped motion has led there. Collective."""
        system, here = self._system, self._forces()
        last, drawn = self._from_drawn(self._last, here) if self._as_drawn else (self._last, 0.0)
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
            self.now.damping, balance, pressures, self.now.done + drawn + float(np.abs(works).sum()), self.now.drawn + drawn,
        )  # fmt: skip
        # What a jump lets go is what is left of all else: the work of viscous forces has in it what they add to the way
        self.let_go = max(now.error - before.error, 0.0) if jumped else 0.0
        if system.damped:
            now = replace(now, damping=now.damping + self.let_go)
        self._last, self.now, self._as_drawn = here, now, False
        return now

    def _from_drawn(self, start: _Forces, end: _Forces) -> tuple[_Forces, float]:
        """What the first step begins with, and the energy that its end keeps of what overlaps as drawn. Collective.

        Penalties times overlaps balance nothing there, and may be many times the forces that come with the first balance. In
        their place stand shares of those of the step's end. Forces F that grow evenly with the depth, from the share s, do
        the work (1 - s^2) E on a way on which F alone do 2 (1 - s) E, where E is what bodies and penalties hold in the end:
        that gives s, which is none without overlap, and one where all of E comes of it. Of an overlap bodies keep what no
        work explains, and no more than its penalties hold, which they give way to.
        """
        comm = self._system.comm
        first, second = comm.allreduce(np.array([[one.load for one in at.pressing.values()] for at in (start, end)]))
        if not first.any():
            return start, 0.0
        most = np.minimum(np.divide(first, second, out=np.zeros_like(first), where=second > 0.0), 1.0)
        works, rubbed = self._works(self._begun(start, end, np.ones_like(most)), end)
        held, work = end.strain + end.stored - start.strain, float(works.sum() - rubbed.sum())
        share = float(np.clip(1.0 - 0.5 * work / held, 0.0, 1.0)) if held > 0.0 else 0.0
        begun = self._begun(start, end, np.minimum(most, share))
        drawn = float(np.clip(-self._left(begun, end)[-1], 0.0, start.stored))
        return replace(begun, stored=drawn), drawn

    def _begun(self, start: _Forces, end: _Forces, shares: Floats) -> _Forces:
        """A start with shares, by contact, of the forces at the end but for loads, which are what they are stated."""
        of, most = dict(zip(end.pressing, (float(one) for one in shares), strict=True)), float(shares.max())
        return replace(
            start,
            on_dofs=np.concatenate([start.on_dofs[:-1], most * end.on_dofs[-1:]]),
            wrenches=np.where(self._system.tools.free, start.wrenches, most * end.wrenches),
            stored=0.0,
            rubbing={name: replace(one, limit=of[name] * end.rubbing[name].limit) for name, one in start.rubbing.items()},
            pressing={name: one.scaled(of[name]) for name, one in end.pressing.items()},
        )

    def _works(self, start: _Forces, end: _Forces) -> tuple[Floats, Floats]:
        """Work between two states, of each part of the outer forces, swelling and tools, (parts + 2,), and of friction, by
        rough contact. Collective."""
        parts = len(end.on_dofs)
        outer = 0.5 * (start.on_dofs + end.on_dofs) @ (end.u - start.u)
        swelling = 0.5 * (start.on_ratios + end.on_ratios) @ (end.ratios - start.ratios)
        swelling += float((0.5 * (start.on_fields + end.on_fields) * (end.fields - start.fields)).sum())
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
        forces = np.zeros((len(self._loads) + 1, system.vector.getLocalSize()))
        for term, mine in zip(self._loads, forces, strict=False):
            local = np.zeros_like(state.u.x.array)
            term.add_residual(state, local, np.zeros_like(system.tool_residual))
            mine[:] = -_summed(system, local)
        # what tools hold is their work
        system.supports.put_forces(forces[-1], np.where(system.supports.tied, 0.0, system.reactions))
        loads = system.tools.forces(state.t)  # all that acts on free components, springs that let go apart
        wrenches = np.where(system.tools.free, loads, system.tool_residual + loads)
        return _Forces(
            state.u.x.array[: forces.shape[1]].copy(),
            state.q.copy(),
            forces,
            wrenches,
            *self._swelling(),
            system.strain_energy(),
            self._stored(),
            {contact.name: _Rubbing.of(contact, state) for contact in system.contact_terms if contact.rough},
            {contact.name: _Pressing.of(contact, system) for contact in system.contact_terms},
        )

    def _swelling(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Ratios that are one number, the rates of this rank's energy with them, and those of fields at owned nodes."""
        numbers, fields = self._system.terms[0].swelling()
        nodes = self._system.vector.getLocalSize() // 3
        ratios, rates = np.zeros((2, len(fields), nodes))
        for k, (at_nodes, on_nodes) in enumerate(fields):
            local = np.zeros((len(on_nodes), 3))
            local[:, 0] = on_nodes
            ratios[k], rates[k] = at_nodes[:nodes], _summed(self._system, local.ravel())[::3]
        return *numbers, ratios, rates

    # -- over the end of a run -----------------------------------------------------------------------------------------
    @property
    def keys(self) -> dict[str, Ints64]:
        """Of all that `memory` keeps in rows, the numbers of these that no partition changes. Collective."""
        if not self._keys:
            last, nodes = self._last, node_keys(self._system.space)[: len(self._last.u) // 3]
            self._keys = dict.fromkeys(
                ["u", "forces", "ratios", "rates", *(f"presses {name}" for name in last.pressing)], nodes
            )
            points = {contact.name: contact.key for contact in self._system.contact_terms}
            self._keys |= {f"{what} {name}": points[name] for name in last.rubbing for what in ("limit", "share", "way")}
        return self._keys

    def memory(self) -> tuple[dict[str, Floats], dict[str, Any]]:
        """What a checkpoint keeps for the pair of steps that goes on from here: rows of `keys`, and plain values, alike on
        all ranks; ({}, {}) before the first step. Collective."""
        if self._before is None:
            return {}, {}
        (before, left), allreduce = self._before, self._system.comm.allreduce
        rows = {"u": before.u.reshape(-1, 3), "forces": before.on_dofs.sum(axis=0).reshape(-1, 3)}
        rows |= {"ratios": before.fields.T, "rates": before.on_fields.T}
        rows |= {f"presses {name}": one.on_dofs.reshape(-1, 3) for name, one in before.pressing.items()}
        for name, one in before.rubbing.items():
            rows |= {f"limit {name}": one.limit, f"share {name}": one.share, f"way {name}": one.way}
        numbers = {
            "pairs": self._of_pairs,
            "left": left,
            "q": before.q,
            "wrenches": before.wrenches,
            "ratios": before.ratios,
        }
        numbers |= {"rates": allreduce(before.on_ratios), "held": np.array([before.strain, before.stored, self.now.drawn])}
        numbers |= {f"presses {name}": allreduce(one.wrenches) for name, one in before.pressing.items()}
        numbers["stored"] = allreduce(np.array([one.stored for one in before.pressing.values()]))
        return rows, {name: value.tolist() for name, value in numbers.items()}

    def recall(self, rows: Mapping[str, Floats], numbers: Mapping[str, Any]) -> None:
        """Go on from what `memory` gave, now rows of this rank, as if the run had never ended."""
        last, tools = self._last, self._last.q.shape
        mine = float(self._system.comm.rank == 0)  # sums over the ranks
        strain, stored, drawn = numbers["held"]
        outer = np.zeros_like(last.on_dofs)
        outer[-1] = rows["forces"].ravel()
        parts = ("limit", "share", "way")
        rubbing = {name: replace(one, **{at: rows[f"{at} {name}"] for at in parts}) for name, one in last.rubbing.items()}
        pressing = {
            name: _Pressing(
                rows[f"presses {name}"].ravel(), mine * np.array(numbers[f"presses {name}"]).reshape(tools), mine * held, 0.0
            )
            for name, held in zip(last.pressing, numbers["stored"], strict=True)
        }
        before = _Forces(
            rows["u"].ravel(),
            np.array(numbers["q"]).reshape(tools),
            outer,
            np.array(numbers["wrenches"]).reshape(tools),
            np.array(numbers["ratios"]),
            mine * np.array(numbers["rates"]),
            rows["ratios"].T,
            rows["rates"].T,
            strain,
            stored,
            rubbing,
            pressing,
        )
        self._before, self._of_pairs = (before, np.array(numbers["left"])), np.array(numbers["pairs"])
        self.now, self._resumed = replace(self.now, drawn=drawn), False


def _summed(system: System, local: Floats) -> Floats:
    """At the owned dofs the sums of what ranks have in a local array. Collective."""
    vector = system.border_vector(local)
    sums = vector.array.copy()
    vector.destroy()
    return sums
