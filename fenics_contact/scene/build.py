"""From a scene's statements to the System that steppers solve: checked, complete when it is returned."""

from dataclasses import dataclass

import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.agreement import collect_together
from fenics_contact.assembly.cell_forms import is_symmetric
from fenics_contact.assembly.damping import Damping
from fenics_contact.assembly.grounding import Grounding
from fenics_contact.assembly.holds import Holds
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import FormTerm, State
from fenics_contact.contact.facets import FacetPartner
from fenics_contact.contact.master import MasterSurface, oriented_facets
from fenics_contact.contact.meshed_tool import MeshedToolPartner
from fenics_contact.contact.rigid import RigidPartner
from fenics_contact.contact.surface import slave_surface
from fenics_contact.contact.term import Contact
from fenics_contact.contact.tools import MeshedTool, RigidTool, Tool
from fenics_contact.scene.checks import (
    bonded_bodies,
    refuse_behind,
    refuse_deep_start,
    refuse_doubled,
    refuse_held,
    refuse_jumps,
    refuse_loose,
    unmet_notes,
)
from fenics_contact.scene.drives import motion_of, supports_of
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.elements import solid_term
from fenics_contact.solid.materials import young
from fenics_contact.solid.springs import springs
from fenics_contact.timing import Timers
from fenics_contact.values import SceneError


@dataclass(frozen=True)
class Built:
    """A System, and what is to be said of its start."""

    system: System
    notes: list[str]


def build(scene, move=None, push=None, timers=None, stabilise=False, damping=False):
    """What a Scene states, Built. move: {tool: (3,) travel at t = 1 or function of t}; push: {tool: (3,) force at t = 1 or
    function of t}; a pushed tool is free to travel along the axes in which its force acts. SceneError on all ranks for what
    cannot be. Collective."""
    comm, domain, timers = scene.mesh.comm, scene.mesh.domain, timers or Timers()
    collect_together(comm)
    refuse_doubled(scene)
    motion = motion_of(comm, scene.tools, move or {}, push or {})
    u = compat.Function(scene.space, name="displacement")
    state = State(u, np.zeros((len(scene.tools), 3)))
    loads = [(compat.Constant(domain, np.zeros(3)), load) for load in scene.loads]
    pressures = [(compat.Constant(domain, 0.0), load) for load in scene.pressures]
    supports = supports_of(scene.mesh, scene.space, scene.supports)
    with timers("compile"):
        terms = [_solid(scene, u, loads)] + ([_pressure(scene, u, pressures, supports)] if pressures else [])
        check = scene.volume_ratio(u).check
    modulus = _modulus_by_cell(scene)
    with timers("compile"):  # the first call of a kernel loads or compiles it
        contacts = [_contact(scene, stated, modulus, supports, state, timers) for stated in scene.contacts]
    bodies = bonded_bodies(scene)
    holds = Holds(comm, bodies, supports, contacts)
    refuse_loose(holds, state, comm)
    grounding = damped = None
    if stabilise or (holds.reliant and contacts):
        free = motion.free if stabilise else np.zeros_like(motion.free)
        grounding = Grounding(springs(scene.space, scene.bodies, scene.dx, u), free, stabilise)
    if damping:
        damped = Damping(springs(scene.space, scene.bodies, scene.dx, u), motion.free)
    terms += [term for term in (grounding, damped) if term]

    def set_loads(t):
        for constant, load in [*loads, *pressures]:
            constant.value[...] = load.path(t)

    system = System(
        state, [*terms, *contacts], supports, motion, set_loads, check, timers=timers, contacts=contacts, holds=holds,
        grounding=grounding, damping=damped, reach=max((tool.reach for tool in scene.tools), default=0.0),
        bulk_over_shear=max(body.material.bulk_modulus / body.material.shear_modulus for body in scene.bodies),
    )  # fmt: skip
    refuse_behind(system)
    refuse_held(scene, system)
    return Built(system, unmet_notes(scene) + refuse_deep_start(scene, system) + refuse_jumps(scene, system))


# -- solid ------------------------------------------------------------------------------------------------------------
def _solid(scene, u, loads):
    """The solid's term, with the dead loads."""

    def loads_power(v):
        inside = [(constant, body) for constant, load in loads if load.group is None for body in scene.bodies]
        outside = [(constant, load.group) for constant, load in loads if load.group is not None]
        power = sum(vp.body_force_power(constant, v, scene.dx(body)) for constant, body in inside)
        return power + sum(vp.dead_traction_power(constant, v, scene.ds(group)) for constant, group in outside)

    parts = [(body.material, lambda degree, body=body: scene.dx(body, degree)) for body in scene.bodies]
    return solid_term(scene.element, u, parts, loads_power, scene.degree)


def _pressure(scene, u, pressures, supports):
    """Follower pressure as one term; symmetric where the edges of its surface stay in planes, as in closed shells."""
    domain, v, du = scene.mesh.domain, ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space)
    power = sum(-vp.follower_pressure_power(p, u, v, domain, scene.ds(load.group)) for p, load in pressures)
    rate = sum(-vp.follower_pressure_power_rate(p, u, du, v, domain, scene.ds(load.group)) for p, load in pressures)
    for p, _ in pressures:
        p.value = 1.0
    return FormTerm("pressure", power, rate, is_symmetric(compat.compile_form(rate), u, supports))


def _modulus_by_cell(scene):
    """Young's modulus at rest (cells,) of owned and ghost cells [pressure]."""
    cells, tags = scene.mesh.domain.topology.index_map(3), scene.mesh.cell_tags
    modulus = np.zeros(cells.size_local + cells.num_ghosts)
    for body in scene.bodies:
        modulus[tags.indices[tags.values == scene.mesh.volume_tag(body.group)]] = young(body.material)
    return modulus


# -- contact ----------------------------------------------------------------------------------------------------------
def _contact(scene, stated, modulus, supports, state, timers):
    """The term of a stated contact. Collective."""
    points = stated.points if isinstance(stated.points, str) else int(stated.points)
    surface = slave_surface(scene.space, scene.mesh.facets(*stated.slave), modulus, points)
    partner = _partner(scene, stated, surface, timers)
    values, adapts = stated.penalty.values(surface.stiffness, stated.friction), stated.penalty.adapts(stated.penetration)
    return Contact(
        stated.name, surface, partner, stated.friction, values, adapts, stated.penetration, supports.dofs, state, timers
    )


def _partner(scene, stated, surface, timers):
    """Whom the slave points of a stated contact meet. Collective."""
    master = stated.master
    if isinstance(master, RigidTool):
        return RigidPartner(surface, master, scene.tools.index(master))
    facets = oriented_facets(scene.space, scene.mesh.facets(*stated.slave))
    if isinstance(master, MeshedTool):
        return MeshedToolPartner(surface, facets, master, scene.tools.index(master), scene.space, timers)
    return FacetPartner(master_name(master), surface, facets, _master_surface(scene, stated, surface), scene.space, timers)


def _master_surface(scene, stated, surface):
    """The master of a contact of bodies, checked. Collective."""
    master = MasterSurface(scene.space, scene.mesh.facets(*stated.master))
    if len(flat := master.degenerate()):
        raise SceneError(
            f"contact '{stated.name}': {len(flat)} facets of the master have no area, the first at {flat[0]}; mesh that "
            "surface again"
        )
    shared = np.isin(master.blocks, compat.global_blocks(scene.space)[surface.nodes])
    if scene.mesh.comm.allreduce(bool(shared.any()), op=MPI.LOR):
        raise SceneError(
            f"contact '{stated.name}': slave and master share nodes: they belong to one body, or the gmsh script glued two "
            "(fragment); draw the bodies as separate volumes"
        )
    return master


def master_name(master):
    """Of a tool, or of the surfaces of a body."""
    return master.name if isinstance(master, Tool) else "+".join(master)
