"""What a scene must fulfil before work starts: refusals that name the thing and the remedy, the same on all ranks."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.facet_points import geometry_degree
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.holds import Holds
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import State
from fenics_contact.contact.friction import Friction, friction_of
from fenics_contact.contact.overlap import deepest_start, drawn_through
from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.rigid_places import BEHIND
from fenics_contact.contact.tools import Hub, MeshedTool, RigidTool, Tool
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.scene.statements import ContactStatement, MomentLoad
from fenics_contact.types import Ints, Ints64, Mesh, Space
from fenics_contact.values import SceneError, count, group_names, positive, quoted, shown, text

if TYPE_CHECKING:  # which asks them
    from fenics_contact.scene.scene import Scene

AXES = {"x": 0, "y": 1, "z": 2}

# Of a cell's height: what may overlap at the start. A rough ball that starts 0.1, 0.3, 0.5, 0.95 deep in place of coming
# down by as much gives a force that is 0, 5, 6, 11 % too small, for friction has no history of the way; flat tools and two
# bodies lose less than 0.1 %. Nodes behind the slave surface that lie in a tool are held by nothing: see BEHIND.
REMARKABLE, DEEPEST = 0.05, 0.5
OVERLAP = 1e-3  # of a cell's height: an overlap from which on it has an energy to speak of; round-off and facets stay below
INTERFERENCE = "an interference that is wanted comes about by swell() of one of them, or by moving one in"
LEANING = 1e-9  # part along z of a normal that lies in the plane


def sides(slave: object, master: object) -> tuple[tuple[str, ...], Tool | tuple[str, ...]]:
    """Slave and master of a contact: names of surfaces, or for the master a tool."""
    if isinstance(slave, Tool):
        raise SceneError(
            f"contact: the slave is the tool '{slave.name}'; slave= is the surface of a body that meets it, and the tool is "
            "the master="
        )
    slave = group_names(slave, "contact: slave")
    if isinstance(master, Hub):
        raise SceneError(
            f"contact: the hub '{master.name}' has no surface to meet; tie surfaces to it, or give a rigid tool"
        )
    if isinstance(master, Tool):
        return slave, master
    if not isinstance(master, str | tuple | list):
        raise SceneError(f"contact: master must be a rigid tool, e.g. rigid_plane(...), or a surface, not {shown(master)}")
    return slave, group_names(master, "contact: master")


def refuse_numbers(
    name: object, friction: float | Friction, penalty: float | Penalty | None, penetration: float | None, points: int | str
) -> tuple[Friction, Penalty]:
    """The name and the numbers of a contact must be such; returns its Friction and its Penalty."""
    text(name, "contact: name")
    what = f"contact '{name}'"
    law = friction_of(friction, f"{what}: friction")
    if not isinstance(penalty, Penalty):
        if penalty is not None:
            positive(penalty, f"{what}: penalty", more=" [pressure/length], or a Penalty(...)")
        penalty = Penalty(penalty)
    for label, value in [*vars(penalty).items(), ("penetration", penetration)]:
        if value is not None:
            positive(value, f"{what}: {label}" if label == "penetration" else f"{what}: Penalty({label}=)")
    if penalty.normal and penalty.factor or penalty.tangential and penalty.share:
        raise SceneError(f"{what}: {penalty} states a penalty twice: give normal or factor, and tangential or share")
    if points not in ("nodes", "corners", "averages"):
        count(points, f"{what}: points", remedy=", a count of Gauss points, or 'nodes', 'corners' or 'averages'")
    return law, penalty


def default_points(master: Tool | tuple[str, ...], bare_corners: bool) -> int | str:
    """What a contact meets its master with if nothing is said."""
    if isinstance(master, RigidTool):
        return 3 if bare_corners else "nodes"
    return "averages"


def refuse_pair(contact: ContactStatement, others: Sequence[ContactStatement], degree: int, bare_corners: bool) -> None:
    """A contact's sides and points must go together, with the degree, and with the `others` stated before.

    bare_corners: whether corner nodes have no tributary area, as on facets of quadratic tetrahedra.
    """
    what, points, master = f"contact '{contact.name}'", contact.points, contact.master
    if not isinstance(master, Tool):
        if common := set(master) & set(contact.slave):
            both = common.pop()
            raise SceneError(f"{what}: slave and master are both '{both}'; name two surfaces, or two walls of one body")
        if degree != 1 and points in ("nodes", "corners"):
            raise SceneError(
                f'{what}: points="{points}" on a body need degree=1; use averages, or Gauss points, e.g. points=3'
            )
        if degree != 1 and points == 1:
            raise SceneError(f"{what}: one point does not hold a facet of degree 2, which has more nodes; use points=2 or 3")
    if isinstance(master, MeshedTool) and master.is_curve and points != "averages":
        raise SceneError(f'{what}: a tool of curves is met by points="averages"')
    if isinstance(master, RigidTool) and points == "averages":
        raise SceneError(f"{what}: averages meet facets; an analytic tool is met by nodes or Gauss points")
    if isinstance(master, RigidTool) and points == "corners":
        raise SceneError(f'{what}: an analytic tool has a normal of its own: use points="nodes" or Gauss points')
    if bare_corners and points in ("nodes", "corners"):
        raise SceneError(
            f'{what}: points="{points}" needs degree=1 on tetrahedra and in axisymmetric scenes: at degree 2 corners of '
            "tetrahedra, and nodes on an axis, have no area of their own; use Gauss points, points=3, the default there"
        )
    if isinstance(master, MeshedTool) and degree != 1 and points in ("nodes", "corners"):
        raise SceneError(f"{what}: {points} on a meshed tool need degree=1; use averages, or Gauss points, points=3")
    meets_facets = points in ("nodes", "corners") and not isinstance(master, RigidTool)
    if contact.penetration is not None and meets_facets:
        raise SceneError(
            f'{what}: penetration= with points="{points}" needs an analytic tool: flat facets cannot follow multipliers at '
            "every node, and a closest point without penetration has no normal at an edge between them; use Gauss points, "
            "e.g. points=1"
        )
    for other in others:
        if contact.name == other.name:
            raise SceneError(f"two contacts are named '{contact.name}'; give one of them name=...")


def refuse_namesake(tool: Tool, others: Sequence[Tool]) -> None:
    """Tools differ in their names."""
    if any(tool is not other and tool.name == other.name for other in others):
        raise SceneError(f"two tools are named '{tool.name}'; give one of them name=..., for the columns of each")


def section_of(mesh: NamedMesh, plane: object, thickness: object) -> Section | None:
    """What a plane mesh stands for, None of volumes. Collective."""
    if not mesh.plane:
        if plane is not None:
            raise SceneError(f"plane = {shown(plane)}: the mesh is one of volumes; a plane mesh has none")
        return None
    if plane not in ("strain", "axisymmetric"):
        raise SceneError(
            f'plane = {shown(plane)}: the mesh is one of surfaces; say plane="strain", with a thickness, or '
            'plane="axisymmetric", about the axis y'
        )
    section = Section(plane == "axisymmetric", float(positive(thickness, "thickness", more=", a length")))
    x, comm = mesh.domain.geometry.x, mesh.comm
    least, size = min(comm.allgather(x[:, 0].min(initial=np.inf))), max(comm.allgather(np.abs(x).max(initial=0.0)))
    if section.axisymmetric and least < -ON_AXIS * size:
        raise SceneError(f"axisymmetric about the axis y: a node lies at x = {least:.3g}; draw all bodies at x >= 0")
    if section.axisymmetric and section.thickness != 1.0:
        raise SceneError("thickness: an axisymmetric scene is that of the full turn; leave it out")
    return section


def refuse_chords(name: str, mesh: Mesh, degree: int) -> None:
    """Points of displacements of degree 1 lie on the chords of cells with curved sides."""
    if degree == 1 and geometry_degree(mesh) > 1:
        raise SceneError(
            f"contact '{name}': the mesh is of order 2, and nodes of degree 1 do not know its curved sides; give "
            "Scene(..., degree=2), or mesh with order 1"
        )


def refuse_on_plane(contact: ContactStatement, section: Section | None, degree: int) -> None:
    """Curves of a plane mesh meet curves by averages or, of degree 2, by Gauss points; tools of curves belong there alone,
    and those of facets to space."""
    if section is None and isinstance(contact.master, MeshedTool) and contact.master.is_curve:
        raise SceneError(
            f"contact '{contact.name}': rigid_curve '{contact.master.name}' belongs to plane scenes; in space give "
            "rigid_surface or rigid_extrusion"
        )
    if section is not None and isinstance(contact.master, MeshedTool) and not contact.master.is_curve:
        raise SceneError(
            f"contact '{contact.name}': rigid_surface '{contact.master.name}' belongs to scenes in space; in a plane one "
            "give rigid_curve or rigid_extrusion"
        )
    if section is None or isinstance(contact.master, RigidTool) or contact.points == "averages":
        return
    if degree == 1:
        raise SceneError(f"contact '{contact.name}': in a plane scene curves of degree 1 are met by points=\"averages\"")


def refuse_across(contacts: Sequence[ContactTerm], state: State) -> None:
    """What meets a plane mesh must be the same on both sides of its plane. Collective."""
    for contact in contacts:
        leaning = float(np.abs(contact.places.looks(state)[..., 2]).max(initial=0.0))
        if max(state.comm.allgather(leaning)) > LEANING:
            raise SceneError(
                f"contact '{contact.name}': '{contact.master_name}' is not the same on both sides of the plane z = 0 of the "
                "mesh; centre it there, lay a cylinder along z, turn into the plane: the normal of a plane, direction= of a "
                "punch, along= and up= of a profile"
            )


def refuse_volumes(mesh: NamedMesh, groups: list[str]) -> None:
    """Every volume has one body. groups: the bodies' volumes."""
    for group in groups:
        mesh.volume_tag(group)
        if groups.count(group) > 1:
            raise SceneError(
                f"volume '{group}' is in {groups.count(group)} bodies: its cells have one material; give one Body"
            )
    if left := set(mesh.volumes) - set(groups):
        raise SceneError(f"volumes without a material: {', '.join(sorted(left))}; add a Body for each")


def refuse_twice(mesh: NamedMesh, contact: ContactStatement, others: Sequence[ContactStatement]) -> None:
    """No facet may meet the same master in two contacts, which would press twice as hard. Collective."""
    for other in others:
        same = contact.master is other.master
        if not isinstance(contact.master, Tool) and not isinstance(other.master, Tool):
            same = _share(mesh, contact.master, other.master)
        if same and _share(mesh, contact.slave, other.slave):
            raise SceneError(
                f"contacts '{other.name}' and '{contact.name}' state the same: facets of one slave surface against one "
                "master; leave one of them out"
            )


def _share(mesh: NamedMesh, groups: Sequence[str], others: Sequence[str]) -> bool:
    return mesh.comm.allreduce(len(np.intersect1d(mesh.facets(*groups), mesh.facets(*others)))) > 0


def refuse_apart(mesh: NamedMesh, space: Space, facets: Ints, others: Ints, what: str) -> None:
    """Surfaces, by local facets, must have nodes in common. Collective."""
    common = np.intersect1d(compat.locate_blocks(space, facets), compat.locate_blocks(space, others))
    if not mesh.comm.allreduce(len(common)):
        raise SceneError(f"{what} has no node of that surface; name one at its border, or a part of it")


def refuse_doubled(scene: "Scene") -> None:
    """Faces of cells that lie on one another without sharing nodes are joined by a contact, or were meant to be bonded."""
    stated = [(set(one.slave), set(one.master)) for one in scene.contacts if isinstance(one.master, tuple)]

    def joined(a: set[str], b: set[str]) -> bool:
        return any((slave & a and master & b) or (slave & b and master & a) for slave, master in stated)

    left = [found for found in scene.mesh.doubled if not joined(*map(set, found.surfaces))]
    if left:
        names = " and ".join(f"'{name}'" for name in dict.fromkeys(left[0].volumes))
        raise SceneError(
            f"{sum(found.count for found in left)} faces of cells lie on other ones with nodes of their own, the first at "
            f"{spot(np.array(left[0].place))} in body {names}: they come apart or pass through each other. Bond them with "
            "gmsh.model.occ.fragment before meshing or gmsh.model.mesh.removeDuplicateNodes() after it, state a contact "
            "between their surfaces, or draw them with a gap"
        )


def refuse_loose(holds: Holds, state: State, comm: MPI.Comm) -> None:
    """Nothing may be free to translate that neither a support nor a contact holds; bodies sharing nodes are bonded."""
    for i, axes in holds.loose(lambda contact: contact.forces.could_hold(state)).items():
        raise SceneError(
            f"nothing holds body '{holds.bodies[i][0]}' along {', '.join(axes)}: fix a surface, use a symmetry plane, or "
            "add a contact that holds it; bodies that hold only each other are loose together"
        )


def refuse_turning(scene: "Scene", holds: Holds) -> None:
    """Sectors may not be free to turn about the axis of their pair, where no load that it allows holds them. Collective."""
    X = scene.space.tabulate_dof_coordinates()
    for pair in scene.pairs:
        if pair.axis is None or pair.point is None:
            continue
        for i in holds.turning(pair.axis, pair.point, X):
            raise SceneError(
                f"nothing keeps body '{holds.bodies[i][0]}' from turning about the axis of the {pair.what}: fix a "
                "surface, or add a contact that holds it"
            )


def refuse_moments_of_rings(scene: "Scene") -> None:
    """A moment's forces grow from the middle of its surface, which is no middle where the surface goes on behind a pair of
    faces. Collective."""
    for load in scene.loads:
        if not isinstance(load, MomentLoad):
            continue
        nodes = scene.mesh.nodes(scene.space, *load.group)
        for pair in scene.pairs:
            reached = [
                bool(np.isin(nodes, scene.mesh.nodes(scene.space, *face)).any()) for face in (pair.first, pair.second)
            ]
            if np.any(scene.mesh.comm.allgather(reached), axis=0).all():
                raise SceneError(
                    f"moment on {quoted(load.group)}: the surface reaches both faces of the {pair.what} and goes on behind "
                    "them, while a moment turns it about its own middle; tie it to a hub, scene.tie(group, hub), and turn "
                    "that, Motion(moment=...)"
                )


def bonded_bodies(scene: "Scene", supports: Supports, parts: tuple[Ints64, int]) -> list[tuple[str, Ints64]]:
    """What moves as one: parts of the mesh that hang together (`connected_parts`), several bodies where they share nodes or
    are paired. Collective.

    Returns (name, local nodes) of each; a piece of a body that lies in several is named by its middle too.
    """
    space, comm = scene.space, scene.mesh.comm
    part, count = parts
    if supports.pairs is not None:
        part, count = supports.pairs.joined(part, count)
    tags, first_node = scene.mesh.cell_tags, compat.cell_dofs(space)[:, 0]
    holds = np.zeros((count, len(scene.bodies)), dtype=bool)
    for j, body in enumerate(scene.bodies):
        cells = tags.indices[tags.values == scene.mesh.volume_tag(body.group)]
        holds[part[first_node[cells]], j] = True
    holds = np.any(comm.allgather(holds), axis=0)
    owned = space.dofmap.index_map.size_local
    X = np.column_stack([np.ones(owned), space.tabulate_dof_coordinates()[:owned]])
    sums = sum(comm.allgather(np.stack([np.bincount(part[:owned], x, minlength=count) for x in X.T], axis=1)))
    groups = []
    for i in range(count):
        name = ", ".join(body.group for body, inside in zip(scene.bodies, holds[i], strict=True) if inside)
        if holds[:, holds[i]].sum(axis=0).max() > 1:
            name = f"{name}, the piece around {spot(sums[i, 1:] / sums[i, 0])}"
        groups.append((name, np.flatnonzero(part == i)))
    return groups


def refuse_behind(system: System) -> None:
    """The slave surface must lie on the outer side of a meshed tool, by the majority of its points. Collective."""
    for contact in system.contact_terms:
        share = contact.places.back_share(system.state)
        if share > 0.5:
            way = "its facets must be counter-clockwise seen from the body: use rigid_surface(..., flip=True)"
            if system.space.mesh.topology.dim == 2:
                way = "the tool must lie on the left of its curve: use rigid_curve(..., flip=True)"
            raise SceneError(
                f"contact '{contact.name}': the normals of '{contact.master_name}' point away from the slave surface, whose "
                f"points see its back ({share:.0%} of them); {way}"
            )


def refuse_deep_start(scene: "Scene", system: System) -> tuple[list[str], list[str]]:
    """Nothing may overlap by more than half a cell at the start, nor a tool reach nodes behind its slave surface, of bodies
    that it meets: others may lie within a wall, or outside of a bore.

    Returns what is to be said of smaller overlaps, and the names of all contacts that overlap. Collective.
    """
    if through := drawn_through(system):
        raise SceneError(
            f"body '{through[0]}' is drawn through itself at {through[1]}: what a contact of a body with itself keeps apart "
            "must not overlap at the start; draw it apart"
        )
    X, remarks, overlaps = scene.space.tabulate_dof_coordinates(), list[str](), list[str]()
    for contact, statement in zip(system.contact_terms, scene.contacts, strict=True):
        slave = np.zeros(len(X), dtype=bool)
        slave[compat.locate_blocks(scene.space, scene.mesh.facets(*statement.slave))] = True
        depths = np.array(contact.places.overlap(system.state, X, slave, [nodes for _, nodes in system.bodies]))
        (at_surface, behind), height, across = depths.max(axis=1).tolist(), contact.surface.cell_height, 0.0
        within = [body[0] for body, deep in zip(system.bodies, depths.max(axis=0), strict=True) if deep == depths.max()]
        if at_surface > DEEPEST * height and (deepest := deepest_start(system, contact, DEEPEST * height)) is not None:
            at_surface, across = deepest
        depth = max(at_surface, behind)
        where = f"contact '{contact.name}': the master '{contact.master_name}' starts {depth:.3g} inside body "
        where += f"{' or '.join(map(repr, within))}, where a cell is {height:.3g} high"
        if at_surface > DEEPEST * height or behind > BEHIND * height:
            tool, more = statement.master, f"; {INTERFERENCE}" if isinstance(statement.master, tuple) else ""
            if isinstance(tool, RigidTool) and tool.profiled:
                more = ", or state its points the other way round: a profile is the tool on their right"
            if isinstance(tool, RigidTool) and tool.flat and behind > at_surface:
                more = ", or turn its normal round: it points out of the tool, towards the body"
            if isinstance(tool, RigidTool) and tool.solid:
                more = ", or state hollow=True where the body lies within it"
            raise SceneError(f"{where}; move its starting place outwards, or name all surfaces it meets as slaves{more}")
        if across:
            raise SceneError(
                f"contact '{contact.name}': the slave's normals lead back through its body to facets of "
                f"'{contact.master_name}', {across:.3g} behind it, as if these had come in there: leave what does not meet "
                "them out of the slave and the master, or let the other side be the slave"
            )
        if at_surface > REMARKABLE * height:
            missed = ", and friction misses the way" if contact.rough else ""
            remedy = f"draw them apart; {INTERFERENCE}" if isinstance(statement.master, tuple) else "start it outside"
            remarks.append(f"{where}: the first step presses it out{missed}; {remedy}")
        if at_surface > OVERLAP * height:
            overlaps.append(contact.name)
    return remarks, overlaps


def refuse_held(scene: "Scene", system: System) -> None:
    """A contact must be able to move something along its normals: its slave, or a master that is a body. Collective."""
    comm, held = scene.mesh.comm, system.supports.dofs
    for contact, statement in zip(system.contact_terms, scene.contacts, strict=True):
        gives = not contact.led.fixed(system.state).all()
        gives |= contact.partner.gives(held)
        if not comm.allreduce(int(gives)):
            raise SceneError(
                f"contact '{contact.name}': every node of '{'+'.join(statement.slave)}' is prescribed along the contact's "
                "normal, so that contact can move nothing; leave that direction free, or leave out the contact"
            )
