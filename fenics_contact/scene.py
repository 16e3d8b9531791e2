"""The user's vocabulary: bodies, supports, loads and contacts; checks them and builds the System."""

from dataclasses import dataclass

import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact import virtual_power as vp
from fenics_contact.agreement import collect_together
from fenics_contact.assembly.cell_forms import is_symmetric
from fenics_contact.assembly.damping import Damping
from fenics_contact.assembly.grounding import Grounding
from fenics_contact.assembly.holds import Holds
from fenics_contact.assembly.supports import ToolMotion
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import FormTerm, State
from fenics_contact.checks import (
    AXES,
    bonded_bodies,
    refuse_behind,
    refuse_deep_start,
    refuse_doubled,
    refuse_held,
    refuse_inside,
    refuse_jumps,
    refuse_loose,
    refuse_numbers,
    refuse_pair,
    refuse_twice,
    refuse_volumes,
    sides,
)
from fenics_contact.contact.facets import FacetPartner, MeshedToolPartner
from fenics_contact.contact.friction import Friction
from fenics_contact.contact.master import MasterSurface, oriented_facets
from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.rigid import RigidPartner
from fenics_contact.contact.surface import slave_surface
from fenics_contact.contact.term import Contact
from fenics_contact.contact.tools import MeshedTool, RigidTool, Tool
from fenics_contact.drives import supports_of
from fenics_contact.elements import locking_notes, quadrature_degree, refuse_element, solid_term
from fenics_contact.functions import ramp
from fenics_contact.materials import Hyperelastic, Isotropic, young
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.output.units import Units
from fenics_contact.springs import springs
from fenics_contact.timing import Timers
from fenics_contact.values import SceneError, axis_letters, finite, function, group_names, is_number, shown, text
from fenics_contact.volume_ratio import VolumeRatio


@dataclass(frozen=True)
class Body:
    """A named volume of a mesh and the strain energy of its material."""

    mesh: NamedMesh
    group: str
    material: Isotropic | Hyperelastic

    def __post_init__(self):
        text(self.group, "body: its volume group")
        if not isinstance(self.mesh, NamedMesh):
            raise SceneError(f"body '{self.group}': its mesh must be one that read_gmsh gave, not {shown(self.mesh)}")
        if not isinstance(self.material, Isotropic | Hyperelastic):
            raise SceneError(
                f"body '{self.group}': its material must be a law with its moduli, e.g. neo_hooke(mu, K), not "
                f"{shown(self.material)}"
            )


@dataclass(frozen=True)
class ContactStatement:
    """A contact as stated: master is a tool, or the surfaces of a body."""

    name: str
    slave: tuple[str, ...]
    master: Tool | tuple[str, ...]
    friction: Friction
    penalty: Penalty
    points: int | str
    penetration: float | None


class Scene:
    """Bodies of one mesh with their supports, loads and contacts.

    degree: polynomial degree of the displacement, 1 (the paper's 8-node hexahedra) or 2; element: "displacement", or
    "mixed" for nearly incompressible rubber, see `elements`; accept_locking: compute even where the element is known to
    lock; units: names for the output.
    """

    def __init__(self, *bodies, degree=1, element="displacement", accept_locking=False, units=Units()):  # noqa: B008 - frozen
        if not bodies or not all(isinstance(body, Body) for body in bodies):
            raise SceneError(f"a scene needs at least one Body, Scene(Body(...), Body(...)), not {shown(bodies)}")
        if not is_number(degree) or degree not in (1, 2):
            raise SceneError(f"degree = {shown(degree)}: displacements of degree 1 and 2 are supported")
        if not isinstance(units, Units):
            raise SceneError(f'units = {shown(units)}: give Units("mm", "N", "MPa") with names of your own')
        self.mesh = bodies[0].mesh
        if any(body.mesh is not self.mesh for body in bodies):
            raise SceneError("all bodies of a scene live in one mesh: give them as named volumes of one gmsh model")
        refuse_volumes(self.mesh, [body.group for body in bodies])
        tetrahedra = compat.cell_name(self.mesh.domain) == "tetrahedron"
        laws = {body.group: body.material for body in bodies}
        refuse_element(element, degree, tetrahedra, laws, accept_locking)
        self.notes = locking_notes(degree, tetrahedra, laws)
        self.bodies, self.degree, self.element, self.units = bodies, degree, element, units
        self.space = compat.lagrange_space(self.mesh.domain, degree, (3,))
        self.contacts, self.loads, self.pressures, self._supports = [], [], [], []

    # -- statements -----------------------------------------------------------------------------------------------
    def fix(self, group, axis="xyz"):
        """No displacement of a surface along the axes named, e.g. axis="x" for a symmetry plane."""
        for letter in axis_letters(axis, f"fix '{group}'"):
            self.prescribe(group, letter, 0.0)

    def prescribe(self, group, axis, value):
        """Displacement of a surface along one axis [length]: a number reached at t = 1, or a function value(X, t) -> (n,).

        The function may give one number for all; X (n, 3): reference positions of all nodes of the surface, on every rank.
        """
        axis_letters(axis, f"prescribe '{group}'", most=1)
        what = f"prescribed displacement of '{group}' along {axis}"
        value = function(value, what, "value(X, t)") if callable(value) else float(finite(value, what))
        self._facets(group)
        self._supports.append((group_names(group), AXES[axis], value))

    def traction(self, group, vector):
        """Dead traction per reference area on a surface [pressure], fixed in direction: (3,) at t = 1 or function of t."""
        refuse_inside(self.mesh, self._facets(group), f"traction on '{group}'")
        self.loads.append((group_names(group), ramp(self.mesh.comm, vector, f"traction on '{group}'")))

    def pressure(self, group, value):
        """Pressure on the deformed surface that follows its normal and pushes into the body [pressure per current area].

        value: reached at t = 1, or a function of t.
        """
        refuse_inside(self.mesh, self._facets(group), f"pressure on '{group}'")
        self.pressures.append((group_names(group), ramp(self.mesh.comm, value, f"pressure on '{group}'", ())))

    def body_force(self, vector):
        """Force per reference volume on all bodies [force/length^3]: (3,) at t = 1 or function of t."""
        self.loads.append((None, ramp(self.mesh.comm, vector, "body force")))

    def contact(
        self,
        slave: str | tuple[str, ...],
        master: Tool | str | tuple[str, ...],
        friction: float | Friction = 0.0,
        *,
        penalty: float | Penalty | None = None,
        points: int | str | None = None,
        penetration: float | None = None,
        name: str | None = None,
    ) -> None:
        """Contact of a surface (or a tuple of surfaces) with a rigid tool, or with the surface (or surfaces) of a body.

        Of two bodies make the softer or finer meshed one the slave: its points are held out of the master's facets.
        friction: Coulomb's mu, or `coulomb(...)` for one that depends on the pressure, or for a shear limit.
        penalty: a number [pressure/length] or a `Penalty`; by default from the stiffness beneath each slave point, raised
        where points sink in too far.
        points: Gauss points per direction of each facet, which look along its normal; "corners" of the facets, which look so
        too; or "nodes", which look for the closest point on the master (the paper): right on tools, which have one normal at
        a place, and on a body where it is smooth, for the force jumps at the edges of its facets. By default nodes on an
        analytic tool, 3 on a body or a meshed tool.
        penetration: how deep [length] a point may lie in the master, and how far one that sticks may slip, at the end of a
        step: multipliers take over from the penalty until that holds (augmented Lagrangian); on a body or a meshed tool with
        one point per facet by default, for a facet cannot follow another surface in more. By default the penalty alone.
        name: of its columns, by default of slave and master.
        """
        slave, master = sides(slave, master)
        tetrahedra = compat.cell_name(self.mesh.domain) == "tetrahedron"
        if points is None:
            nodes = isinstance(master, RigidTool) and not (tetrahedra and self.degree == 2)
            points = "nodes" if nodes else (3 if penetration is None or isinstance(master, RigidTool) else 1)
        name = f"{'+'.join(slave)} on {_master_name(master)}" if name is None else name
        friction, penalty = refuse_numbers(name, friction, penalty, penetration, points)
        contact = ContactStatement(name, slave, master, friction, penalty, points, penetration)
        refuse_pair(contact, self.contacts, self.degree, tetrahedra)
        for side in (slave, master):
            if not isinstance(side, Tool):
                refuse_inside(self.mesh, self._facets(side), f"contact '{name}', surface '{'+'.join(side)}'")
        refuse_twice(self.mesh, contact, self.contacts)
        self.contacts.append(contact)

    @property
    def tools(self):
        """The rigid tools of all contacts, each once, in order of appearance."""
        masters = [contact.master for contact in self.contacts]
        return list(dict.fromkeys(master for master in masters if isinstance(master, Tool)))

    def _facets(self, group):
        try:
            facets = self.mesh.facets(*group_names(group))
        except ValueError as error:
            raise SceneError(str(error)) from None
        if self.mesh.comm.allreduce(len(facets)) == 0:
            raise SceneError(f"surface '{group}' has no facets; give it some in the gmsh script")
        return facets

    # -- construction ---------------------------------------------------------------------------------------------
    def system(self, move=None, push=None, timers=None, stabilise=False, damping=False):
        """The System of this scene. move: {tool: (3,) travel at t = 1 or function of t}; push: {tool: (3,) force at t = 1
        or function of t}; a pushed tool is free to travel along the axes in which its force acts."""
        collect_together(self.mesh.comm)
        refuse_doubled(self)
        motion = self._motion(move or {}, push or {})
        u = compat.Function(self.space, name="displacement")
        state = State(u, np.zeros((len(self.tools), 3)))
        loads = [(compat.Constant(self.mesh.domain, np.zeros(3)), group, path) for group, path in self.loads]
        pressures = [(compat.Constant(self.mesh.domain, 0.0), group, path) for group, path in self.pressures]
        supports = supports_of(self.mesh, self.space, self._supports)
        timers = timers or Timers()
        with timers("compile"):
            solid, stress_laws = self._solid(u, loads)
            terms = [solid] + ([self._pressure(u, pressures, supports)] if pressures else [])
            check = self.volume_ratio(u).check
        modulus = self._modulus_by_cell()
        with timers("compile"):  # the first call of a kernel loads or compiles it
            contacts = [self._contact_term(contact, modulus, state, timers) for contact in self.contacts]
        bodies = bonded_bodies(self)
        holds = Holds(self.mesh.comm, bodies, supports, contacts)
        refuse_loose(holds, state, self.mesh.comm)
        grounding = damped = None
        if stabilise or (holds.reliant and contacts):
            free = motion.free if stabilise else np.zeros_like(motion.free)
            grounding = Grounding(springs(self.space, self.bodies, self.dx, u), free, stabilise)
        if damping:
            damped = Damping(springs(self.space, self.bodies, self.dx, u), motion.free)
        terms += [term for term in (grounding, damped) if term]

        def set_loads(t):
            for constant, _, path in [*loads, *pressures]:
                constant.value[...] = path(t)

        system = System(state, [*terms, *contacts], supports, motion, set_loads, check, bodies, contacts, timers)
        system.units, system.stress_laws = self.units, stress_laws
        system.grounding, system.holds, system.damping = grounding, holds, damped
        if grounding:
            grounding.bind(system)
        refuse_behind(system)
        system.reach = max([system.extent, *(tool.reach for tool in self.tools)])
        system.bulk_over_shear = max(body.material.bulk_modulus / body.material.shear_modulus for body in self.bodies)
        refuse_held(self, system)
        system.notes = refuse_deep_start(self, system) + refuse_jumps(self, system)
        return system

    def dx(self, body, degree=None):
        """Integral over a body, exact to `degree` (by default the element's full integration)."""
        degree = quadrature_degree(self.degree) if degree is None else degree
        measure = ufl.Measure(
            "dx", domain=self.mesh.domain, subdomain_data=self.mesh.cell_tags, metadata={"quadrature_degree": degree}
        )
        return measure(self.mesh.volume_tag(body.group))

    def ds(self, group):
        measure = ufl.Measure(
            "ds",
            domain=self.mesh.domain,
            subdomain_data=self.mesh.facet_tags,
            metadata={"quadrature_degree": quadrature_degree(self.degree)},
        )
        return measure(self.mesh.surface_tags(*group_names(group)))

    def _solid(self, u, loads):
        """The solid's term with the dead loads, and the laws of its Cauchy stress by body."""

        def loads_power(v):
            inside = [(constant, body) for constant, group, _ in loads if group is None for body in self.bodies]
            outside = [(constant, group) for constant, group, _ in loads if group is not None]
            power = sum(vp.body_force_power(constant, v, self.dx(body)) for constant, body in inside)
            return power + sum(vp.dead_traction_power(constant, v, self.ds(group)) for constant, group in outside)

        parts = [(body.material, lambda degree, body=body: self.dx(body, degree)) for body in self.bodies]
        return solid_term(self.element, u, parts, loads_power, self.degree)

    def _pressure(self, u, pressures, supports):
        """Follower pressure as one term; symmetric where the edges of its surface stay in planes, as in closed shells."""
        domain, v, du = self.mesh.domain, ufl.TestFunction(self.space), ufl.TrialFunction(self.space)
        power = sum(-vp.follower_pressure_power(p, u, v, domain, self.ds(group)) for p, group, _ in pressures)
        rate = sum(-vp.follower_pressure_power_rate(p, u, du, v, domain, self.ds(group)) for p, group, _ in pressures)
        for p, _, _ in pressures:
            p.value = 1.0
        term = FormTerm("pressure", power, rate)
        term.symmetric = is_symmetric(term.tangent_form, u, supports)
        return term

    def _motion(self, move, push):
        for what, drive in (("move", move), ("push", push)):
            if not isinstance(drive, dict) or not all(isinstance(tool, Tool) for tool in drive):
                raise SceneError(f"{what} = {shown(drive)}: give {{tool: (x, y, z)}}, the tool itself being the key")
        for tool in [*move, *push]:
            if tool not in self.tools:
                raise SceneError(f"tool '{tool.name}' is moved or pushed but is in no contact")
        paths, forces, free = [], [], []
        for tool in self.tools:
            if tool in move and tool in push:
                raise SceneError(f"tool '{tool.name}' is both moved and pushed; choose one")
            paths.append(ramp(self.mesh.comm, move.get(tool, (0.0, 0.0, 0.0)), f"move of '{tool.name}'"))
            forces.append(ramp(self.mesh.comm, push.get(tool, (0.0, 0.0, 0.0)), f"push of '{tool.name}'"))
            free.append(np.any([forces[-1](t) != 0.0 for t in (0.5, 1.0)], axis=0) if tool in push else np.zeros(3, bool))
            if tool in push and not free[-1].any():
                raise SceneError(f"push of '{tool.name}' has no force in any direction")
        return ToolMotion(paths, forces, free, [tool.name for tool in self.tools])

    def _modulus_by_cell(self):
        cells = self.mesh.domain.topology.index_map(3)
        modulus = np.zeros(cells.size_local + cells.num_ghosts)
        for body in self.bodies:
            mine = self.mesh.cell_tags.indices[self.mesh.cell_tags.values == self.mesh.volume_tag(body.group)]
            modulus[mine] = young(body.material)
        return modulus

    def _contact_term(self, contact, modulus, state, timers):
        points = contact.points if isinstance(contact.points, str) else int(contact.points)
        surface = slave_surface(self.space, self.mesh.facets(*contact.slave), modulus, points)
        partner = self._partner(contact, surface, timers)
        values = contact.penalty.values(surface.stiffness, contact.friction)
        adapts = contact.penalty.adapts(contact.penetration)
        return Contact(contact.name, surface, partner, contact.friction, values, adapts, contact.penetration, state, timers)

    def _partner(self, contact, surface, timers):
        """Whom the slave points of a stated contact meet. Collective."""
        master = contact.master
        if isinstance(master, RigidTool):
            return RigidPartner(surface, master, self.tools.index(master))
        facets = oriented_facets(self.space, self.mesh.facets(*contact.slave))
        if isinstance(master, MeshedTool):
            return MeshedToolPartner(surface, facets, master, self.tools.index(master), self.space, timers)
        master = self._master_surface(contact, surface)
        return FacetPartner(_master_name(contact.master), surface, facets, master, self.space, timers)

    def _master_surface(self, contact, surface):
        """The master of a contact, checked. Collective."""
        master = MasterSurface(self.space, self.mesh.facets(*contact.master))
        if len(flat := master.degenerate()):
            raise SceneError(
                f"contact '{contact.name}': {len(flat)} facets of the master have no area, the first at {flat[0]}; mesh "
                "that surface again"
            )
        shared = np.isin(master.blocks, compat.global_blocks(self.space)[surface.nodes])
        if self.mesh.comm.allreduce(bool(shared.any()), op=MPI.LOR):
            raise SceneError(
                f"contact '{contact.name}': slave and master share nodes: they belong to one body, or the gmsh script glued "
                "two (fragment); draw the bodies as separate volumes"
            )
        return master

    def volume_ratio(self, u):
        """J = det F of a displacement."""
        return VolumeRatio(self.mesh, self.bodies, self.degree, u)


def _master_name(master):
    return master.name if isinstance(master, Tool) else "+".join(master)
