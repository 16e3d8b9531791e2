"""The user's vocabulary: bodies, supports, loads and contacts, each checked as it is stated."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fenics_contact import compat
from fenics_contact.assembly.system import System
from fenics_contact.contact.friction import Friction
from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import Tool
from fenics_contact.scene.build import build, master_name
from fenics_contact.scene.checks import (
    AXES,
    default_points,
    refuse_apart,
    refuse_chords,
    refuse_namesake,
    refuse_numbers,
    refuse_on_plane,
    refuse_pair,
    refuse_twice,
    refuse_volumes,
    section_of,
    sides,
)
from fenics_contact.scene.directions import Group, chosen, normals, unit, unsigned
from fenics_contact.scene.field_loads import Spring, spin_of, springs_of, swelling_of
from fenics_contact.scene.functions import Drive, Place, load_path, ramp
from fenics_contact.scene.groups import Groups
from fenics_contact.scene.loads import force_path, place_path
from fenics_contact.scene.pairs import paired
from fenics_contact.scene.stage import Moves, Only
from fenics_contact.scene.statements import (
    Body,
    ContactStatement,
    FacePair,
    Loading,
    MomentLoad,
    Spin,
    StatedFluid,
    StatedLoad,
    Support,
    Tie,
)
from fenics_contact.solid.elements import locking_notes, refuse_element
from fenics_contact.solid.volume_ratio import VolumeRatio
from fenics_contact.timing import Timers
from fenics_contact.types import Floats, Function
from fenics_contact.units import Units
from fenics_contact.values import SceneError, axis_letters, finite, function, group_names, is_number, quoted, shown

Value = float | Callable[[Floats, float], Any]  # of a prescribed displacement


class Scene:
    """Bodies of one mesh with their supports, loads and contacts.

    degree: polynomial degree of the displacement, 1 (the paper's 8-node hexahedra) or 2; element: "displacement", or
    "mixed" for nearly incompressible rubber, see `elements`; accept_locking: compute even where the element is known to
    lock; units: names for the output.

    plane: what a mesh of surfaces stands for: "strain", bodies of a `thickness` [length] that cannot move along z, or
    "axisymmetric", bodies all the way round the axis y, of which x = R >= 0 is drawn. Forces are those of the whole
    thickness, or of the full turn.
    """

    def __init__(
        self,
        *bodies: Body,
        degree: int = 1,
        element: str = "displacement",
        accept_locking: bool = False,
        plane: str | None = None,
        thickness: float = 1.0,
        units: Units = Units(),  # noqa: B008 - frozen
    ) -> None:
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
        self.section = section_of(self.mesh, plane, thickness)
        simplices = {"tetrahedron": "tetrahedra", "triangle": "triangles"}.get(compat.cell_name(self.mesh.domain), "")
        laws = {body.group: body.material for body in bodies}
        refuse_element(element, degree, simplices, laws, accept_locking)
        self.notes = locking_notes(element, degree, simplices, laws)
        self.bodies, self.degree, self.element, self.units = bodies, degree, element, units
        self.space = compat.lagrange_space(self.mesh.domain, degree, (3,))
        self.groups = Groups(self.mesh, self.space, degree, self.section)
        # may nodes have no tributary area: corners of quadratic tetrahedra, nodes of degree 2 on an axis?
        axisymmetric = self.section is not None and self.section.axisymmetric
        self._bare_corners = degree == 2 and (axisymmetric or simplices == "tetrahedra")
        self.contacts: list[ContactStatement] = []
        self.supports: list[Support] = []
        self.ties: list[Tie] = []
        self.pairs: list[FacePair] = []
        self.loads: list[Loading] = []
        self.springs: list[Spring] = []

    # -- statements -----------------------------------------------------------------------------------------------
    def fix(
        self, group: Group, axis: str | None = None, *, direction: Sequence[float] | None = None, normal: bool = False
    ) -> None:
        """No displacement of a group along the axes named, by default all, e.g. axis="x" for a symmetry plane.

        direction (3,) or normal=True, as in `prescribe`: along one direction alone, e.g. of an inclined symmetry plane.
        """
        what = f"fix {quoted(group)}"
        chosen(axis, direction, normal, what)
        if direction is not None or normal:
            self._support(group, None, 0.0, direction, normal, what)
            return
        for letter in axis_letters(("xyz" if self.section is None else "xy") if axis is None else axis, what):
            self._support(group, letter, 0.0, None, False, what)

    def prescribe(
        self,
        group: Group,
        axis: str | None = None,
        value: Value | None = None,
        *,
        direction: Sequence[float] | None = None,
        normal: bool = False,
    ) -> None:
        """Displacement of a group along one axis [length]: a number reached at t = 1, or a function value(X, t) -> (n,).

        group: names of surfaces, edges or points. The function may give one number for all; X (n, 3): reference positions of
        all nodes of the group, on every rank. In the place of the axis: direction (3,), of any length, or normal=True, along
        the outward normals of flat surfaces at the start. The nodes stay free across the direction, which does not turn.
        """
        what = f"prescribe {quoted(group)}"
        chosen(axis, direction, normal, what)
        if direction is None and not normal:
            axis_letters(axis, what, most=1)
        along = axis if axis is not None else "its normal" if normal else shown(direction)
        what = f"prescribed displacement of {quoted(group)} along {along}"
        value = function(value, what, "value(X, t)") if callable(value) else float(finite(value, what))
        self._support(group, axis, value, direction, normal, what)

    def _support(
        self, group: Group, axis: str | None, value: Value, direction: Sequence[float] | None, normal: bool, what: str
    ) -> None:
        names = group_names(group)
        try:
            count = len(self.mesh.nodes(self.space, *names))
        except ValueError as error:
            raise SceneError(str(error)) from None
        if self.mesh.comm.allreduce(count) == 0:
            raise SceneError(f"group {quoted(group)} has no facets, lines or points on a body; draw it on one")
        if normal:
            ways = normals(self.mesh, self.space, group, what)
        else:
            ways = [(names, unit(direction, what) if axis is None else tuple(float(axis == letter) for letter in AXES))]
        if self.section is not None and any(along[2] != 0.0 for _, along in ways):
            raise SceneError(f"{what}: nothing moves along z, out of a plane mesh; leave that out")
        for of, along in ways:
            self.supports.append(Support(of, unsigned(along) if value == 0.0 else along, value))

    def tie(self, group: str | tuple[str, ...], hub: Tool) -> None:
        """Let a surface move as a part of a rigid body: of a hub, `rigid_hub(name, point)`, or of any tool.

        It is moved, pushed or free as `solve(move={hub: Motion(...)})` says; what is not said stays. Supports may hold some
        of the same nodes where they never hinder it, as planes of symmetry do.
        """
        if not isinstance(hub, Tool):
            raise SceneError(f"tie {quoted(group)}: {shown(hub)} is no rigid body; give rigid_hub(name, point), or a tool")
        self.groups.facets(group)
        refuse_namesake(hub, self.tools)
        self.ties.append(Tie(group_names(group), hub))

    def periodic(self, first: Group, second: Group, relative: Drive = (0.0, 0.0, 0.0)) -> None:
        """Let the second surface, of a mesh that repeats, move as the first one does, node by node, and further by
        `relative`, the stretch or shear of the whole cell [length]: (3,) at t = 1 or a function of t of the first stage."""
        self.pairs.append(paired(self, first, second, relative))

    def cyclic(
        self, first: Group, second: Group, axis: Sequence[float] = (0.0, 0.0, 1.0), point: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> None:
        """Let the second surface, which is the first one turned about the axis through `point`, move as that does, turned as
        well: of a sector of what repeats all the way round."""
        self.pairs.append(paired(self, first, second, (0.0, 0.0, 0.0), axis, point))

    def traction(self, group: str | tuple[str, ...], vector: Drive | Place) -> None:
        """Dead traction per reference area on a surface [pressure], fixed in direction: (3,) at t = 1, or a function of t or
        of (X, t), as of `pressure`, that gives (n, 3)."""
        facets, what = self.groups.facets(group), f"traction on {quoted(group)}"
        self.mesh.refuse_inside(facets, what)
        path = place_path(self, facets, vector, what, (3,))
        self.loads.append(StatedLoad("tractions", group_names(group), *path))

    def pressure(self, group: Group, value: Drive | Place, *, where: str = "all", from_: Group | None = None) -> None:
        """Pressure on the deformed surface that follows its normal and pushes into the body [pressure per current area].

        value: reached at t = 1, a function of t, or a function value(X, t) -> (n,) of reference positions X (n, 3) of all
        nodes of the surface, on every rank; between nodes it is interpolated.
        where: "open": where no contact presses, and where one presses by less what is missing, so that the greater of both
        pressures acts (`contact.fluid`); `from_`: names of surfaces, from whose common nodes with this one the fluid comes
        in, through facets that contact presses by less than the fluid's pressure. That must not be negative then.
        """
        facets, what = self.groups.facets(group), f"pressure on {quoted(group)}"
        self.mesh.refuse_inside(facets, what)
        if where not in ("all", "open"):
            raise SceneError(f'{what}: where = {shown(where)} must be "all" or "open", where no contact presses')
        if where == "all" and from_ is not None:
            raise SceneError(f'{what}: from_= says where a fluid comes in; it belongs to where="open"')
        path, nodes = load_path(self.space, facets, value, what, ())
        if where == "all":
            self.loads.append(StatedLoad("pressures", group_names(group), path, nodes))
            return
        if self._bare_corners:
            raise SceneError(
                f'{what}: where="open" needs degree=1 on tetrahedra and in axisymmetric scenes: at degree 2 corners of '
                "tetrahedra, and nodes on an axis, have no area of their own"
            )
        if from_ is not None:
            refuse_apart(self.mesh, self.space, facets, self.groups.facets(from_), f"{what}: from_ = {quoted(from_)}")
        self.loads.append(StatedFluid(group_names(group), path, nodes, None if from_ is None else group_names(from_)))

    def body_force(self, vector: Drive | Place) -> None:
        """Force per reference volume on all bodies [force/length^3]: (3,) at t = 1, or a function of t or of (X, t), as of
        `pressure`, that gives (n, 3)."""
        path = place_path(self, None, vector, "body force", (3,))
        self.loads.append(StatedLoad("body_force", None, *path))

    def force(self, group: str | tuple[str, ...], vector: Drive) -> None:
        """Dead force on a surface [force], in all, fixed in direction and spread evenly over its area at the start: (3,) at
        t = 1 or function of t."""
        what = f"force on {quoted(group)}"
        self.mesh.refuse_inside(self.groups.facets(group), what)
        names, path = group_names(group), force_path(self, vector, what)
        self.loads.append(StatedLoad("forces", names, path, over=self.area(names)))

    def moment(self, group: str | tuple[str, ...], vector: Drive) -> None:
        """Moment on a surface [force length], fixed in space while it turns, by forces about its present centroid that have
        no resultant and grow with the distance from there: (3,) at t = 1 or function of t."""
        what = f"moment on {quoted(group)}"
        if self.section is not None:
            turned = 'tie the curve to a hub, scene.tie(group, hub), and turn that, Motion(moment=(0, 0, M), free="x y rz")'
            instead = "state a traction(X, t)" if self.section.axisymmetric else turned
            raise SceneError(f"{what}: moments are known on surfaces in space; in a plane scene {instead}")
        self.mesh.refuse_inside(self.groups.facets(group), what)
        self.loads.append(MomentLoad(group_names(group), ramp(self.mesh.comm, vector, what)))

    def spin(
        self,
        speed: Drive,
        density: float | Mapping[str, float],
        axis: Sequence[float] = (0.0, 0.0, 1.0),
        point: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Centrifugal forces on all bodies, as seen from axes that turn with them: density speed^2 times the present
        distance from the axis through `point`, per reference volume.

        speed: reached at t = 1, or a function of t [angle/time]; density: of the bodies at the start, a number or {volume:
        number} [mass/length^3], in units in which density speed^2 length is a force per volume.
        """
        if any(isinstance(load, Spin) for load in self.loads):
            raise SceneError("spin is stated twice; bodies turn about one axis, at a speed that may be a function of t")
        self.loads.append(spin_of(self, speed, density, axis, point))

    def swell(self, body: Body | str, ratio: Drive | Place) -> None:
        """A body's volume without stress over that at the start, J_s, by temperature or swelling: F = J_s^(1/3) F_e.

        ratio: reached at t = 1 from 1, or a function of t or of (X, t), as of `pressure`, of the body's nodes; of a heated
        body (1 + alpha T)^3. An interference fit is a ring drawn without interference that shrinks, or a hub that swells;
        where its length is held, as in plane strain, the radius goes (1 + nu) times as far as the ratio's cubic root says.
        """
        self.loads.append(swelling_of(self, body, ratio))

    def spring(
        self, group: Group, stiffness: float, *, direction: Sequence[float] | None = None, normal: bool = False
    ) -> None:
        """Springs from a surface to the ground, `stiffness` in all [force/length], spread evenly over its area at the start.

        They pull back in all directions or, with direction (3,) or normal=True as in `prescribe`, along that one alone.
        """
        self.mesh.refuse_inside(self.groups.facets(group), f"spring on {quoted(group)}")
        self.springs += springs_of(self, group, stiffness, direction, normal)

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
        points: "averages", one pressure per slave node from means over samples of the facets around it, on facets: smooth
        pressures and few iterations; Gauss points per direction of each facet, which look along its normal; "corners" of
        the facets, which look so too; or "nodes", which look for the closest point on the master (the paper): right on
        tools, which have one normal at a place, and on a body where it is smooth, for the force jumps at the edges of its
        facets. By default nodes on an analytic tool (3 where quadratic tetrahedra meet it), averages on a body or a meshed
        tool: linear pressures at any degree.
        penetration: how deep [length] a point may lie in the master, and how far one that sticks may slip, or one that slips
        may do so aside of its friction, at the end of a step: multipliers take over from the penalty until that holds
        (augmented Lagrangian), and a default penalty is raised where they gain too little; of Gauss points on facets take
        one, of degree 2 two, for a facet cannot follow another surface in more. By default the penalty alone.
        name: of its columns, by default of slave and master.
        """
        slave, master = sides(slave, master)
        if points is None:
            points = default_points(master, self._bare_corners)
        name = f"{'+'.join(slave)} on {master_name(master)}" if name is None else name
        friction, penalty = refuse_numbers(name, friction, penalty, penetration, points)
        contact = ContactStatement(name, slave, master, friction, penalty, points, penetration)
        refuse_pair(contact, self.contacts, self.degree, self._bare_corners)
        refuse_chords(name, self.mesh.domain, self.degree)
        refuse_on_plane(contact, self.section, self.degree)
        if isinstance(master, Tool):
            refuse_namesake(master, self.tools)
        for side in (slave, master):
            if not isinstance(side, Tool):
                self.mesh.refuse_inside(self.groups.facets(side), f"contact '{name}', surface '{'+'.join(side)}'")
        refuse_twice(self.mesh, contact, self.contacts)
        self.contacts.append(contact)

    @property
    def tools(self) -> list[Tool]:
        """The rigid tools of all contacts, then of all ties, each once, in order of appearance."""
        bodies = [*(contact.master for contact in self.contacts), *(tie.hub for tie in self.ties)]
        return list(dict.fromkeys(body for body in bodies if isinstance(body, Tool)))

    # -- construction ---------------------------------------------------------------------------------------------
    def system(
        self,
        move: Moves | None = None,
        push: Mapping[Tool, Drive] | None = None,
        timers: Timers | None = None,
        stabilise: bool = False,
        damping: bool = False,
    ) -> System:
        """The System of this scene with tools moved {tool: (3,) at t = 1 or function of t} or pushed alike, see `build`."""
        return build(self, [Only(move=move or {}, push=push or {})], timers, stabilise, damping).system

    def area(self, group: str | Sequence[str]) -> float:
        """Area of an outer surface at the start, of a plane mesh as deep as its bodies [length^2]. Collective."""
        return self.groups.area(group)

    def volume_ratio(self, u: Function) -> VolumeRatio:
        """J = det F of a displacement."""
        return VolumeRatio(self.mesh, self.bodies, self.degree, u, self.section)
