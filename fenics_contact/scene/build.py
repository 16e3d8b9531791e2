"""From a scene's statements to the System that steppers solve: checked, complete when it is returned."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.agreement import collect_together
from fenics_contact.assembly.cell_forms import is_symmetric
from fenics_contact.assembly.condensed import CondensedPressure
from fenics_contact.assembly.damping import Damping
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.assembly.grounding import Grounding
from fenics_contact.assembly.holds import Holds
from fenics_contact.assembly.parts import connected_parts
from fenics_contact.assembly.spring_term import SpringTerm
from fenics_contact.assembly.stages import Stages
from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import FormTerm, State, Term
from fenics_contact.assembly.tool_motion import ToolMotion
from fenics_contact.contact.crossing import Crossing
from fenics_contact.contact.facets import FacetPartner
from fenics_contact.contact.fluid import Fluid, patches_of
from fenics_contact.contact.master import MasterSurface, ToolSurface, oriented_facets
from fenics_contact.contact.meshed_tool import MeshedToolAverages, MeshedToolPartner
from fenics_contact.contact.mortar import MortarPartner
from fenics_contact.contact.node_places import NodePlaces
from fenics_contact.contact.partner import Partner
from fenics_contact.contact.point_places import PointPlaces
from fenics_contact.contact.quadratic import QuadraticPartner
from fenics_contact.contact.quadratic_places import QuadraticPlaces
from fenics_contact.contact.rigid import RigidPartner
from fenics_contact.contact.surface import SlaveSurface, slave_surface
from fenics_contact.contact.term import Contact, Interface
from fenics_contact.contact.tools import MeshedTool, RigidTool, Tool
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.scene.checks import (
    bonded_bodies,
    refuse_across,
    refuse_behind,
    refuse_deep_start,
    refuse_doubled,
    refuse_held,
    refuse_loose,
    refuse_moments_of_rings,
    refuse_turning,
)
from fenics_contact.scene.doubts import doubts
from fenics_contact.scene.drives import motion_of, supports_of
from fenics_contact.scene.field_loads import field_loads
from fenics_contact.scene.functions import Path, row_of, whole
from fenics_contact.scene.gaps import refuse_gaps, refuse_jumps
from fenics_contact.scene.loads import loads_of
from fenics_contact.scene.pairs import ways_of
from fenics_contact.scene.stage import Only, Stage
from fenics_contact.scene.start import Start, begin, let_go
from fenics_contact.scene.statements import ContactStatement, StatedFluid, StatedLoad, called
from fenics_contact.scene.symmetry import Halves
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.elements import solid_term
from fenics_contact.solid.materials import Material, young
from fenics_contact.solid.springs import springs
from fenics_contact.timing import Timers
from fenics_contact.types import Constant, Expr, Floats, Form, Function, Ints, Ints64
from fenics_contact.values import SceneError

if TYPE_CHECKING:  # which asks for its System here
    from fenics_contact.scene.scene import Scene

Loads = Sequence[tuple[Constant | Function, StatedLoad]]  # a form's coefficient, and what it follows
Held = tuple[Supports, Ints64, Halves]  # by what nodes are held, the parts of all local ones, and planes of symmetry

HARDER = 3.0  # times Young's modulus of the master: slaves as stiff as that, or less, give way to its facets
ROUNDED = 1e-12  # of a fluid's largest pressure: a function of nodes' places is rounded as these are


class Beginning(NamedTuple):
    """How a run begins: overlaps: names of the contacts that overlap at rest; jumps: whether it starts from another run's
    state, out of balance; angles (tools, 3): of the tools [radians]; as_drawn: whether it starts from none."""

    overlaps: list[str]
    jumps: bool
    angles: Floats
    as_drawn: bool


@dataclass(frozen=True)
class Built:
    """A System, what is to be said of its start, terms of its loads alone, fluids too; all loads by name as functions of t,
    the size of the displacement to begin with, and how it begins else; harder: names of the
    contacts whose slave is HARDER times as stiff as the body that is its master, or more."""

    system: System
    notes: list[str]
    loads: list[FormTerm]
    driven: list[tuple[str, Path]]
    start: list[float]
    beginning: Beginning
    harder: list[str]


def build(
    scene: "Scene",
    stated: Sequence[Stage] = (Only(),),
    timers: Timers | None = None,
    stabilise: bool = False,
    damping: bool = False,
    start: Start | None = None,
) -> Built:
    """What a Scene and the stages of a run state, Built; a pushed tool is free to travel along the axes in which its force
    acts; start: the state of another run to begin with. SceneError on all ranks for what cannot be. Collective."""
    comm, timers = scene.mesh.comm, timers or Timers()
    collect_together(comm)
    refuse_doubled(scene)
    refuse_moments_of_rings(scene)
    stages = Stages([stage.name for stage in stated], [float(stage.duration) for stage in stated], len(scene.tools))
    motion = motion_of(scene, stated, stages, start.tools if start else {})
    u = compat.Function(scene.space, name="displacement")
    state = State(u, np.zeros((len(scene.tools), 6)), motion.poses())
    followed = loads_of(scene, stated, stages)
    plain = [load for load in followed if isinstance(load, StatedLoad)]
    loads = [(_coefficient(scene, load, 3), load) for load in plain if load.shape]
    pressures = [(_coefficient(scene, load, 1), load) for load in plain if not load.shape]
    ways = ways_of(scene, stated, stages)
    supports, refuse_hindered, refuse_apart = supports_of(scene, stated, motion, [way for _, way in ways])
    with timers("compile"):
        fields = field_loads(scene, u, followed)
        solid = _solid(scene, u, loads, fields.materials)
        follower = [_pressure(scene, u, pressures, supports)] if pressures else []
        dead = [FormTerm("dead loads", -_loads_power(scene, loads, ufl.TestFunction(scene.space)))] if loads else []
        cells = scene.volume_ratio(u)
    with timers("compile"):  # the first call of a kernel loads or compiles it
        modulus = _modulus_by_cell(scene)
        parts = connected_parts(scene.space)
        contacts = _contacts(scene, modulus, (supports, parts[0], Halves(scene, supports)), state, timers)
        entering = [load for load in followed if isinstance(load, StatedFluid)]
        fluids = [_fluid(scene, i, load, contacts) for i, load in enumerate(entering)]
    if scene.section is not None:
        refuse_across(contacts, state)
    bodies = bonded_bodies(scene, supports, parts)
    holds = Holds(comm, bodies, supports, contacts, [*fields.grounds, *_round_the_axis(scene)])
    refuse_loose(holds, state, comm)
    refuse_turning(scene, holds)

    def set_loads(t: float) -> None:
        refuse_apart(state, t)
        for coefficient, load in [*loads, *pressures]:
            _set(coefficient, load, t)
        for fluid in fluids:
            fluid.set_time(t)
        fields.set(t)

    held = _held(scene, state, motion, (stabilise, damping), lambda: system.strain_energy(), holds)
    others: list[Term] = [*follower, *fluids, *fields.terms, *held, *contacts]
    system = System(state, (solid, *others), holds, (motion, set_loads), cells, timers)
    driven = [(called(load.word, load.group), load.path) for load in followed] + ways
    notes, beginning = _start(scene, system, stated, driven, start, plain)
    refuse_hindered(state)
    driven += [(f"push of '{name}'", row_of(motion.forces, i)) for i, name in enumerate(motion.names)]
    notes += [] if start else refuse_jumps(scene, system, driven)
    of_loads = [*dead, *follower, *fluids, *fields.terms]
    return Built(system, notes, of_loads, driven, [_size(system)], beginning, _harder(scene, modulus))


def _start(
    scene: "Scene",
    system: System,
    stated: Sequence[Stage],
    driven: list[tuple[str, Path]],
    start: Start | None,
    loads: Sequence[StatedLoad],
) -> tuple[list[str], Beginning]:
    """Check how a run begins, and each of its stages; start: another run's state to take up; loads: but fluids that contact
    keeps out. Returns what is to be said, and the Beginning. Collective."""
    refuse_behind(system)
    refuse_held(scene, system)
    deep, overlaps = refuse_deep_start(scene, system)
    notes, jump = doubts(scene, system, stated, loads) + deep, None
    if start:
        notes, overlaps = notes + begin(system, driven, start, scene), []
        jump = let_go(system, start, scene)
    refuse_gaps(system, stated, driven, start is not None)
    return notes + ([jump] if jump else []), Beginning(overlaps, bool(jump), system.state.angles.copy(), start is None)


def _round_the_axis(scene: "Scene") -> list[tuple[Ints, Floats]]:
    """Bodies of revolution cannot move along x without strain, as if springs held all of their nodes."""
    if scene.section is None or not scene.section.axisymmetric:
        return []
    return [(np.arange(len(scene.space.tabulate_dof_coordinates()), dtype=np.int32), np.diag([1.0, 0.0, 0.0]))]


def _size(system: System) -> float:
    """Of the displacement [length]; not by PETSc, which would take its norm for known. Collective."""
    owned = system.state.u.x.array[: system.vector.getLocalSize()]
    return float(np.sqrt(system.comm.allreduce(float(owned @ owned))))


# -- solid ------------------------------------------------------------------------------------------------------------
def _solid(scene: "Scene", u: Function, loads: Loads, materials: Mapping[str, Material]) -> CondensedPressure | FormTerm:
    """The solid's term of these materials by volume, with the dead loads."""
    parts = [(materials[body.group], partial(scene.groups.dx, body)) for body in scene.bodies]
    return solid_term(scene.element, u, parts, partial(_loads_power, scene, loads), scene.degree, scene.section)


def _loads_power(scene: "Scene", loads: Loads, v: Expr) -> Form:
    inside = [(constant, body) for constant, load in loads if load.group is None for body in scene.bodies]
    outside = [(constant, load.group) for constant, load in loads if load.group is not None]
    power = sum(vp.body_force_power(constant, v, scene.groups.dx(body)) for constant, body in inside)
    return power + sum(vp.dead_traction_power(constant, v, scene.groups.ds(group)) for constant, group in outside)


def _pressure(scene: "Scene", u: Function, pressures: Loads, supports: Supports) -> FormTerm:
    """Follower pressure as one term; symmetric where the edges of its surface stay in planes, as in closed shells."""
    v, du = ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space)
    on = [(-p, scene.groups.ds(load.group or ())) for p, load in pressures]
    power = sum(vp.follower_pressure_power(p, u, v, ds, scene.section) for p, ds in on)
    rate = sum(vp.follower_pressure_power_rate(p, u, du, v, ds, scene.section) for p, ds in on)
    for p, load in pressures:
        _coefficient_of(p, load)[...] = 1.0
    return FormTerm("pressure", power, rate, is_symmetric(compat.compile_form(rate), u, supports))


def _coefficient(scene: "Scene", load: StatedLoad, size: int) -> Constant | Function:
    """What stands for a load in the forms: a constant, or a function of places, of one number or three."""
    if load.nodes is None:
        return compat.Constant(scene.mesh.domain, np.zeros(3) if size == 3 else 0.0)
    space = scene.space if size == 3 else compat.lagrange_space(scene.mesh.domain, scene.degree)
    return compat.Function(space)


def _coefficient_of(coefficient: Constant | Function, load: StatedLoad) -> Floats:
    """The numbers of a load's coefficient: (), (3,), or a row for each local node."""
    if load.nodes is None:
        return coefficient.value
    size = coefficient.function_space.dofmap.index_map_bs
    return coefficient.x.array.reshape(-1, size) if size > 1 else coefficient.x.array


def _set(coefficient: Constant | Function, load: StatedLoad, t: float) -> None:
    _coefficient_of(coefficient, load)[... if load.nodes is None else load.nodes] = load.path(t) / load.over


def _fluid(scene: "Scene", number: int, stated: StatedFluid, contacts: list[Contact]) -> Fluid:
    """The term of a fluid that acts where contact does not; number: of the scene's fluids. Collective."""
    mesh, space, name = scene.mesh, scene.space, "+".join(stated.group)
    facets, touching = mesh.facets(*stated.group), [_touching(mesh, contact) for contact in scene.contacts]
    patches = patches_of(space, facets, touching, scene.section)
    if not any(patch.contacts for patch in patches):
        raise SceneError(
            f"pressure on '{name}': where=\"open\" asks for contact, and no facet of it is in one; leave where= out"
        )
    count = len(space.tabulate_dof_coordinates())

    def path(t: float) -> Floats:
        everywhere = whole(stated.path, t)
        if not (low := everywhere.min()) >= -ROUNDED * np.abs(everywhere).max():
            raise SceneError(f"pressure on '{name}' is {low:.3g} at t = {t:g}: with where=\"open\" it must not be negative")
        values = np.maximum(stated.path(t), 0.0)
        if stated.nodes is None:
            return values
        everywhere = np.zeros(count)
        everywhere[stated.nodes] = values
        return everywhere

    source = None
    if stated.source is not None:
        source, on = np.zeros((2, count), dtype=bool)
        source[compat.locate_blocks(space, mesh.facets(*stated.source))] = True
        on[compat.locate_blocks(space, facets)] = True
        source &= on
    among = {i for patch in patches for i in patch.contacts}
    met = {i: (contacts[i], skin_of(space, touching[i], scene.section)) for i in sorted(among)}
    return Fluid(f"fluid {number} on {name}", space, patches, met, path, source)


def _touching(mesh: NamedMesh, contact: ContactStatement) -> Ints:
    """Local facets of a contact's bodies."""
    sides = [side for side in (contact.slave, contact.master) if not isinstance(side, Tool)]
    return np.unique(np.concatenate([mesh.facets(*side) for side in sides]))


def _modulus_by_cell(scene: "Scene") -> Floats:
    """Young's modulus at rest (cells,) of owned and ghost cells [pressure]."""
    cells, tags = compat.cell_map(scene.mesh.domain), scene.mesh.cell_tags
    modulus = np.zeros(cells.size_local + cells.num_ghosts)
    for body in scene.bodies:
        modulus[tags.indices[tags.values == scene.mesh.volume_tag(body.group)]] = young(body.material)
    return modulus


def _held(
    scene: "Scene", state: State, motion: ToolMotion, asked: tuple[bool, bool], strain: Callable[[], float], holds: Holds
) -> list[SpringTerm]:
    """Springs and viscous forces on all bodies, and on free tools where the user asked for them, with stabilise= and with
    damping=; springs may be needed at bodies that contacts alone hold, as damping may be where contacts have friction."""
    (stabilise, damping), found = asked, list[SpringTerm]()
    stated = partial(springs, scene.space, scene.bodies, scene.groups.dx, state.u)
    if stabilise or (holds.reliant and holds.contacts):
        free = (lambda: motion.free) if stabilise else (lambda: np.zeros_like(motion.free))
        found.append(Grounding(stated(), free, stabilise, (strain, holds.contacts), state))
    if damping or any(contact.friction.mu > 0.0 for contact in scene.contacts):
        found.append(Damping(stated(), lambda: motion.free, damping))
    return found


# -- contact ----------------------------------------------------------------------------------------------------------
def _contacts(scene: "Scene", modulus: Floats, held: Held, state: State, timers: Timers) -> list[Contact]:
    """The terms of all stated contacts; modulus (cells,): Young's; held: by what. Collective."""
    found = []
    for stated in scene.contacts:
        points = stated.points if isinstance(stated.points, str) else int(stated.points)
        softer = np.minimum(modulus, _hardest(scene, stated.master, modulus))
        surface = slave_surface(scene.space, scene.mesh.facets(*stated.slave), softer, points, scene.section)
        partner = _partner(scene, stated, surface, timers, held)
        interface = Interface(stated.friction, stated.penalty, stated.penetration)
        contact = Contact(stated.name, partner, interface, held[0], state, timers)
        touch = contact.trial.law.touch
        if stated.penetration is not None and stated.penetration < touch:
            raise SceneError(
                f"contact '{stated.name}': penetration = {stated.penetration:.3g} is below what last places of coordinates "
                f"tell of a gap, {touch:.2g}; give a greater one"
            )
        found.append(contact)
    return found


def _harder(scene: "Scene", modulus: Floats) -> list[str]:
    """See `Built`. Collective."""
    stiffness = [[_hardest(scene, of, modulus) for of in (stated.slave, stated.master)] for stated in scene.contacts]
    return [c.name for c, (slave, master) in zip(scene.contacts, stiffness, strict=True) if slave >= HARDER * master]


def _hardest(scene: "Scene", master: Tool | tuple[str, ...], modulus: Floats) -> float:
    """Young's modulus beneath surfaces, or a tool's [pressure]: of two bodies pressed together the softer one gives way,
    whichever is the slave. Collective."""
    if isinstance(master, Tool):
        return np.inf
    cells, _ = compat.cells_of_exterior_facets(scene.mesh.domain, scene.mesh.facets(*master))
    return float(scene.mesh.comm.allreduce(modulus[cells].max(initial=0.0), op=MPI.MAX))


def _partner(scene: "Scene", stated: ContactStatement, surface: SlaveSurface, timers: Timers, held: Held) -> Partner:
    """Whom the slave points of a stated contact meet; held: by what. Collective."""
    master, (supports, part, halves) = stated.master, held
    if isinstance(master, RigidTool):
        return RigidPartner(surface, master, scene.tools.index(master))
    met: MasterSurface | ToolSurface
    if isinstance(master, MeshedTool):
        met = ToolSurface(master, scene.tools.index(master))
    elif isinstance(master, Tool):
        raise TypeError(f"no partner is known for a {type(master).__name__}")
    else:
        met = _master_surface(scene, stated, master, surface)
    slave, name, tool = scene.mesh.facets(*stated.slave), master_name(master), isinstance(met, ToolSurface)
    skin = MasterSurface(scene.space, slave, scene.section, scene.degree == 2)
    other = met  # points of degree 2 meet curves of a plane as such; else these are strips
    if not isinstance(master, Tool) and stated.points != "averages" and scene.section is not None and scene.degree == 2:
        other = MasterSurface(scene.space, scene.mesh.facets(*master), scene.section, True)
    crossing = Crossing(skin, other, supports.free(skin.owned), scene.section is not None, part)
    if stated.points == "averages":
        ways = supports.free(surface.nodes)[:, 0], halves.of(skin, met)
        return (MeshedToolAverages if tool else MortarPartner)(name, NodePlaces(surface, met, crossing, timers, ways, part))
    where = surface, oriented_facets(scene.space, slave), met, crossing, scene.space, timers
    if scene.degree == 2 and not tool:
        return QuadraticPartner(name, QuadraticPlaces(*where))
    return (MeshedToolPartner if tool else FacetPartner)(name, PointPlaces(*where))


def _master_surface(
    scene: "Scene", stated: ContactStatement, names: tuple[str, ...], surface: SlaveSurface
) -> MasterSurface:
    """The master of a contact of bodies, checked. Collective."""
    strips = scene.section if scene.degree == 1 or stated.points == "averages" else None
    master = MasterSurface(scene.space, scene.mesh.facets(*names), strips, scene.degree == 2)
    if len(flat := master.degenerate()):
        raise SceneError(
            f"contact '{stated.name}': {len(flat)} facets of the master have no area, the first at {flat[0]}; mesh that "
            "surface again"
        )
    if stated.points == "averages":
        return master  # a sample lies off the edge along which walls meet, and none looks at its own wall
    shared = np.isin(master.blocks, compat.global_blocks(scene.space)[surface.nodes])
    if scene.mesh.comm.allreduce(bool(shared.any()), op=MPI.LOR):
        raise SceneError(
            f"contact '{stated.name}': slave and master share nodes, as walls do that meet or where the gmsh script glued "
            "two bodies (fragment): leave points= at its default, averages, or draw the bodies as separate volumes"
        )
    return master


def master_name(master: Tool | tuple[str, ...]) -> str:
    """Of a tool, or of the surfaces of a body."""
    return master.name if isinstance(master, Tool) else "+".join(master)
