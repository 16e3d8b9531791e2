"""Bodies that touch within a step while they move aside: where nothing did before, the step ends about where they touch,
and of what comes in beside others a note says what friction it may have of its way through the air."""

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm, Leads
from fenics_contact.assembly.finding import Finding, Remark
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.system import System
from fenics_contact.types import Floats

TOUCHES = "first touch of what moves aside"  # the kind of failure
SLIGHT = 0.02  # of the load: friction that is not looked at
LEAST = 0.002  # of the largest force: friction that matters to nothing yet, as of a strap that comes to lie on its drum
# Of the step on the schedule, or of as much of it as may turn tools at once: the shortest in which bodies touch. Of the last
# step tried it would be ever less: where they touch as the step ends, all that are accepted before end short of it
FEWEST = 0.01


def untouched(system: System) -> list[ContactTerm]:
    """Contacts with friction that carry nothing at the state; none where all settle by themselves, as averages do: of these
    nine of ten do not go astray where no part of an increment is better than the whole one. Collective."""
    rough = [] if system.foresight.settles else [contact for contact in system.contact_terms if contact.rough]
    if not rough:
        return []
    carry = [bool(contact.forces.idle(system.state)[1].any()) for contact in rough]
    any_carry = np.any(system.comm.allgather(carry), axis=0)
    return [contact for contact, carries in zip(rough, any_carry, strict=True) if not carries]


class FirstTouch:
    """Looks for friction that a step's state has of a way through the air.

    part: after what part of the step that was refused last bodies touch: as they have come nearer in the step before, or
    else half of it. Loads are the greatest of the steps tried from the accepted state: in a shorter one that has just
    touched friction is its share of hardly any.
    """

    def __init__(self, system: System) -> None:
        self._system, self._contacts = system, [contact for contact in system.contact_terms if contact.rough]
        self._loads: dict[ContactTerm, float] = {}
        self.part = 0.5
        self._remarks: dict[str, dict[str, Remark]] = {}

    def objection(self, least: float) -> Finding | None:
        """Why the step to the present state is too long; least: the shortest one that may take its place [t]. Collective."""
        system = self._system
        size = system.state.t - system.trail.last.t
        self._remarks = {}
        if not self._contacts:
            return None
        leads = self._leads()
        for contact in self._contacts:
            come = contact.findings.first_touch(system.state, leads)
            most = self._loads[contact] = max(self._loads.get(contact, 0.0), come.load)
            matters = max(SLIGHT * most, LEAST * system.scales.balance)
            free = come.friction < come.free and come.free > matters and self._driven_otherwise()
            come = come._replace(friction=come.free) if free else come
            if come.friction > matters and size / 2 >= least:
                self.part = max(self._touched(come.gaps, size), least / size)
                reason = "what touches first within the step has friction of its way through the air"
                return Finding(TOUCHES, reason, f"contact '{contact.name}'", "take more steps there")
            if (aside := max(come.friction, come.beside)) > matters:
                self._remarks[contact.name] = {TOUCHES: _came_in(contact, aside / come.load)}
        return None

    def _leads(self) -> Leads:
        """Of supports and tools in this step: of the ways that nodes are led those that are greatest along an axis.
        Collective."""
        system, led = self._system, self._led()
        ends = led[np.unique(np.abs(led).argmax(axis=0))] if len(led) else led
        moved = system.state.q - system.trail.last.q
        ways = np.concatenate([*system.comm.allgather(ends), moved[:, :3]])
        return Leads(ways, float(np.abs(moved[:, 3:]).max(initial=0.0)))

    def _led(self) -> Floats:
        """By how much supports lead nodes (n, 3) in this step [length]."""
        system, last = self._system, self._system.trail.last
        led = np.zeros_like(last.u)
        system.supports.put(led, system.supports.held(system.state.u.x.array - last.u))
        return led.reshape(-1, 3)

    def _driven_otherwise(self) -> bool:
        """Whether soft springs carry bodies or fluids press, or some body does not simply go where supports lead its nodes.

        Carried along without strain from where the step began, it is out of balance then without contacts: under loads that
        change, on springs, where contacts press, or where its supports bend it. Collective.
        """
        system = self._system
        if system.fluids or (system.grounding is not None and system.grounding.engaged):
            return True
        u, ways = system.state.u.x.array, self._led()
        here, carried = u.copy(), system.trail.last.u.reshape(-1, 3).copy()
        for _, nodes in system.bodies:
            most = [ways[nodes].min(axis=0, initial=0.0), ways[nodes].max(axis=0, initial=0.0)]
            everywhere = np.concatenate(system.comm.allgather(most))
            carried[nodes] += everywhere[np.abs(everywhere).argmax(axis=0), np.arange(3)]
        u[:] = carried.ravel()
        system.supports.put(u, system.supports.held(here))
        forces, on_tools = np.zeros_like(u), np.zeros_like(system.tool_residual)
        for term in system.terms:
            if term not in (*system.contact_terms, *system.springs):
                term.add_residual(system.state, forces, on_tools)
        u[:] = here
        left = system.border_vector(forces)
        with left.localForm() as local:
            system.supports.put_forces(local.array_w, 0.0)
        return not left.norm() <= max(ALLOWED * system.scales.balance, system.scales.noise)  # nor do cells inside out rest

    def _touched(self, gaps: tuple[float, float], size: float) -> float:
        """After what part of a step of this size [t] bodies touch that had these gaps as it and the last one began."""
        before, (now, then) = self._system.trail.accepted[-2:], gaps
        if len(before) < 2 or now >= then:
            return 0.5
        rate = (then - now) / (before[1].t - before[0].t)
        return float(min(now / (rate * size), 0.5))

    def accepted(self) -> dict[str, dict[str, Remark]]:
        """The next step begins: what is to be said of the last one, by contact."""
        self._loads.clear()
        said, self._remarks = self._remarks, {}
        return said


def _came_in(contact: ContactTerm, share: float) -> Remark:
    """share: of the load."""
    return Remark(
        share,
        f"contact '{contact.name}': what came to touch within the step rubs with {share:.2g} of the load by then, and "
        "has moved aside before it touched as well: its tangential force may be off by so much, and by more where that adds "
        "up, as where things roll; take more steps",
    )
