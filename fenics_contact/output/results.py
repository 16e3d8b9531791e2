"""What a run gives at every accepted step: contacts, reactions, energies; measured once, for the history and for users."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import Term
from fenics_contact.output.energies import Energies, EnergyBalance
from fenics_contact.output.fields import surfaces_of
from fenics_contact.output.reactions import Reaction, Reactions
from fenics_contact.output.slave_nodes import SlaveNodes
from fenics_contact.scene.scene import Scene
from fenics_contact.types import Floats, Ints64


@dataclass(frozen=True)
class ContactResult:
    """A contact at one step; forces act on the slave body.

    force (3,), its part from friction (3,), moment (3,) about point (3,): the tool's reference point, or the slave surface's
    present centroid; load: pressure integrated over the surface; peak_pressure of a node, at peak_at (3,), its present
    place; area: current one in contact; width (3,): its extents along x, y, z; slip, mean_slip: greatest way slid, and its
    mean over what has been in contact; friction_work since the start; normal_work_error: part of the energies' error, work
    against its pressures that their penalties do not store; active, sticking: how many of the slave points; penetration: of
    the deepest. [force, length, pressure and their products]
    """

    force: Floats
    friction: Floats
    moment: Floats
    point: Floats
    load: float
    peak_pressure: float
    peak_at: Floats
    area: float
    width: Floats
    slip: float
    mean_slip: float
    friction_work: float
    normal_work_error: float
    active: int
    sticking: int
    points: int
    penetration: float


@dataclass(frozen=True)
class StepResult:
    """contacts, reactions; of the tools travel (3,) [length], angles, rotation vectors (3,) [radians], and drives, what acts
    on each from outside the scene to move it so, about its reference point; pairs: forces (3,) on the second faces of paired
    ones: all by name; energies."""

    contacts: dict[str, ContactResult]
    reactions: dict[str, Reaction]
    travel: dict[str, Floats]
    angles: dict[str, Floats]
    drives: dict[str, Reaction]
    energies: Energies
    pairs: dict[str, Floats]


class Results:
    """Measures a scene's System. loads: terms of dead loads and pressures alone; so_far: Energies of a resumed run; watched:
    names of contacts; as_drawn: see EnergyBalance.

    balance: of energies, up to the last accepted step; within_facets: of each of these its greatest load so far [force], and
    what of its pressure varied within facets of the master then, see `measures.within_facets`.
    """

    def __init__(
        self,
        scene: Scene,
        system: System,
        loads: Sequence[Term],
        so_far: Energies | None = None,
        watched: Sequence[str] = (),
        as_drawn: bool = False,
    ) -> None:
        self.system = system
        self.surfaces = surfaces_of(scene, system)
        self.reactions = Reactions(scene, system)
        self.within_facets = dict.fromkeys(watched, (0.0, 0.0))
        self.balance = EnergyBalance(system, loads, so_far, scene.section, as_drawn)
        self.begin_stage()

    def begin_stage(self) -> None:
        """What is kept of the stage before ends: of a stage the most strain energy, and dofs (local) where bodies had it."""
        self.most_strained: tuple[float, Floats] = 0.0, self.system.state.u.x.array.copy()

    def of_step(self, jumped: bool) -> StepResult:
        """Of the state just accepted; jumped: damped motion has led there. Call once per step. Collective."""
        energies, state = self.balance.advance(jumped), self.system.state
        if energies.strain > self.most_strained[0]:
            self.most_strained = float(energies.strain), state.u.x.array.copy()
        contacts = {surface.contact.name: self._contact(surface, energies) for surface in self.surfaces}
        travel, angles = (
            dict(zip(self.system.tools.names, of_tools.copy(), strict=True)) for of_tools in (state.travel, state.angles)
        )
        reactions = self.reactions.at_state()
        return StepResult(contacts, reactions, travel, angles, self._drives(), energies, self.reactions.of_pairs())

    def pressures(self, contact: ContactTerm) -> Floats:
        """Of a contact at all local nodes (n,), whose greatest is its peak_pressure. Collective."""
        (surface,) = (one for one in self.surfaces if one.contact is contact)
        return surface.at_state().pressure

    def memory(self) -> tuple[dict[str, tuple[Ints64, Floats]], dict[str, Any]]:
        """What a checkpoint keeps of the steps behind: {name: (keys, rows)}, and plain values. Collective."""
        rows, numbers = self.balance.memory()
        keys = self.balance.keys
        kept = {"work": numbers, "within": self.within_facets, "most_strained": self.most_strained[0]}
        return {name: (keys[name], row) for name, row in rows.items()}, kept

    def recall(self, rows_of: Callable[[Mapping[str, Ints64]], dict[str, Floats]], numbers: dict[str, Any]) -> None:
        """Go on from what `memory` gave; rows_of: gives the rows of keys by name. Collective."""
        self.within_facets |= {name: (greatest[0], greatest[1]) for name, greatest in numbers["within"].items()}
        if numbers["work"]:
            self.balance.recall(rows_of(self.balance.keys), numbers["work"])

    def recall_most_strained(self, energy: float, u: Floats) -> None:
        """Go on from the most strain energy of the stage so far, and the dofs (local) where bodies had it."""
        self.most_strained = energy, u

    def notes(self) -> list[str]:
        """What is to be said of the contacts at the state assembled last. Collective."""
        return [note for surface in self.surfaces if (note := surface.area_note())]

    def _drives(self) -> dict[str, Reaction]:
        """Of the state assembled last."""
        tools, state = self.system.tools, self.system.state
        wrenches = self.system.tool_residual + tools.forces(state.t)
        parts = zip(tools.names, wrenches, state.tools, strict=True)
        return {name: Reaction(wrench[:3], pose.lever * wrench[3:], pose.place) for name, wrench, pose in parts}

    def _contact(self, surface: SlaveNodes, energies: Energies) -> ContactResult:
        m, zone = surface.contact.forces.measures(self.system.state), surface.zone(surface.at_state())
        names = ("force", "friction", "moment", "point", "load", "active", "sticking", "points", "penetration")
        (slip, mean_slip), contact = m["slip"], surface.contact.name
        work, error = energies.friction.get(contact, 0.0), energies.pressures[contact]
        here = {name: m[name] for name in names} | vars(zone)
        if contact in self.within_facets and m["load"] > self.within_facets[contact][0]:
            self.within_facets[contact] = m["load"], surface.contact.forces.within_facets(self.system.state)
        return ContactResult(**here, slip=slip, mean_slip=mean_slip, friction_work=work, normal_work_error=error)
