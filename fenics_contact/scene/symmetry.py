"""Planes that supports make planes of symmetry, and what does not go with them: bodies that grow through them, tools on them
that move aside, or that reach across and are not symmetric."""

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Remark, foremost, spot
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.size import bodies_size, extremes
from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.system import System
from fenics_contact.assembly.turned import ONE
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.mirrors import Mirrors
from fenics_contact.contact.rigid_places import RigidPlaces, distances_to, pressed
from fenics_contact.scene.drives import AXIS
from fenics_contact.scene.statements import Support
from fenics_contact.types import Bools, Floats, Ints, Ints64

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene

FLAT = 1e-6  # of the bodies' size: how far from a plane its nodes may lie
BEYOND = 0.05  # of a cell's extent: what lies less deep may be what penalties leave on a tool in that plane
ASIDE = 0.01  # of a tool's way: less is what balance leaves
UNLIKE = 0.01  # of how far from a plane a tool presses: by so much its mirror image may be off
ENDS = 0.9  # distance to a tool over what one goes away from a plane: more is the side of one that ends there
SYMMETRY = "symmetry"  # by which a run remembers what it has said of it


@dataclass(frozen=True)
class Plane:
    """A flat end of the bodies, held along its normal alone: the surface's name, the axis of its normal, where it is
    [length], 1 or -1: on which side the bodies are, and its local nodes."""

    name: str
    axis: int
    place: float
    inward: int
    nodes: Ints

    def mirrored(self, x: Floats) -> Floats:
        """Mirror images of places x (n, 3)."""
        out = x.copy()
        out[:, self.axis] = 2.0 * self.place - x[:, self.axis]
        return out


def planes_of(scene: "Scene", supports: Supports) -> list[Plane]:
    """The planes of symmetry that a scene's supports, which no stage moves, make. Collective."""
    # the scene's own entries come first
    led = {s.name for s, entry in zip(scene.supports, supports.entries.all, strict=False) if entry.value.led()}
    return [
        Plane("+".join(s.group), s.axis, place, inward, nodes)
        for s, place, inward, nodes in _flat_ends(scene)
        if s.axis is not None and s.name not in led
    ]


def _flat_ends(scene: "Scene") -> list[tuple[Support, float, int, Ints]]:
    """Supports that hold a flat end of the bodies along its normal alone, as they stand in the scene, where along that it
    is, on which side the bodies are, and its local nodes. Collective."""
    held: dict[tuple[str, ...], set[tuple[float, ...]]] = {}
    for support in scene.supports:
        held.setdefault(support.group, set()).add(support.direction)
    X, comm, found = scene.space.tabulate_dof_coordinates(), scene.mesh.comm, []
    near = FLAT * bodies_size(scene.space)
    for s in scene.supports:
        zero = isinstance(s.value, float) and s.value == 0.0
        if not zero or len(held[s.group]) > 1 or not set(s.group) <= set(scene.mesh.surfaces):
            continue
        nodes, along = compat.locate_blocks(scene.space, scene.mesh.facets(*s.group)), X @ np.array(s.direction)
        ((least,), (most,)), ((low,), (high,)) = (extremes(comm, part[:, None]) for part in (along[nodes], along))
        ends = [inward for inward, end in ((1, low), (-1, high)) if abs(least - end) < near]
        if most - least < near and ends:
            found.append((s, float(least), ends[0], nodes))
    return found


@dataclass
class _Held:
    """A plane of symmetry: its normal (3,), which points to the bodies, where along that it is [length], and the numbers,
    over all ranks, of the nodes that are held on it."""

    normal: Floats
    place: float
    blocks: Ints64

    def on(self, X: Floats, near: float) -> Bools:
        """Which of the places (n, 3) lie on it, none where some lie beyond: what reaches across has no end here."""
        ahead = X @ self.normal - self.place
        return (np.abs(ahead) < near) & bool(ahead.min(initial=0.0) > -near)

    def goes_on(self, surface: ToolSurface, near: float) -> bool:
        """Whether a surface ends here or goes on as its mirror image, by the normals of the facets that meet the plane."""
        nodes, _ = surface.corners
        ahead, normals = (surface.X @ self.normal - self.place)[nodes], area_vectors(surface.X[nodes])
        here = (ahead.min(axis=1) < near) & (ahead.max(axis=1) > -near)
        across = bool((ahead < -near).any())
        leans = abs(float((normals[here] @ self.normal).sum()))
        return not across or leans <= UNLIKE * float(np.linalg.norm(normals[here], axis=1).sum())


class Halves:
    """Planes of symmetry on which contacts go on as their mirror images. Construction is collective."""

    def __init__(self, scene: "Scene", supports: Supports) -> None:
        self._near, self._planes = FLAT * bodies_size(scene.space), list[_Held]()
        section, comm = scene.section, scene.mesh.comm
        turned, blocks = section is not None and section.axisymmetric, compat.global_blocks(scene.space)
        for s, place, inward, nodes in _flat_ends(scene):
            if turned and s.direction != (0.0, 1.0, 0.0):  # else it is a cylinder, or a cone
                continue
            self._join(float(inward) * np.array(s.direction), inward * place, np.concatenate(comm.allgather(blocks[nodes])))
        if turned:
            on_axis = supports.entries.parted[supports.entries.names.index(AXIS)]
            self._join(np.eye(3)[0], 0.0, np.concatenate(comm.allgather(blocks[on_axis])))

    def _join(self, normal: Floats, place: float, blocks: Ints64) -> None:
        """Take nodes held on a plane to those of the same one, or to a new one."""
        for one in self._planes:
            if np.linalg.norm(one.normal - normal) < ONE and abs(one.place - place) < self._near:
                one.blocks = np.union1d(one.blocks, blocks)
                return
        self._planes.append(_Held(normal, place, np.unique(blocks)))

    def of(self, slave: MasterSurface, master: MasterSurface | ToolSurface) -> Mirrors:
        """Those of a contact's surfaces. A body that does not end on a plane of the slave's, held there, is no mirror image
        of itself: then the slave slides over the plane. So it is with tools that go across inclined, have gone across, or
        turned out of it."""
        out = Mirrors([], [], [], self._near)
        for plane in self._planes:
            ours, theirs = plane.on(slave.X, self._near), plane.on(master.X, self._near)
            if tool := isinstance(master, ToolSurface):
                met = plane.goes_on(master, self._near)
            else:
                met = bool(theirs.any() and np.isin(master.blocks[theirs], plane.blocks).all())
            if met and (ours := ours & np.isin(slave.blocks, plane.blocks)).any():
                out.slave.append((plane.normal, ours))
                out.master.append((plane.normal, theirs))
                out.still.append(np.concatenate([ours, np.ones_like(theirs) if tool else theirs]))
        return out


def tilting(scene: "Scene", system: System, stages: int) -> list[str]:
    """What is to be said of tools on planes of symmetry that may turn about axes in these, in any of so many stages.
    Collective."""
    found, comm = dict[str, None](), system.comm
    for contact, plane in product(system.contact_terms, planes_of(scene, system.supports)):
        if not contact.partner.grounded:
            continue
        on = bool(np.isin(plane.nodes, contact.surface.nodes).any())
        if not any(comm.allgather(on)):
            continue
        tool = system.tools.names.index(contact.master_name)
        for i in range(stages):
            with system.stages.foreseen(i):
                about = [axis for axis in range(3) if axis != plane.axis and system.tools.free[tool, 3 + axis]]
            if about:
                letter, axes = "xyz"[plane.axis], " and ".join("xyz"[axis] for axis in about)
                found[
                    f"tool '{contact.master_name}' may turn about {axes} on nodes of '{plane.name}', which is held along "
                    f"{letter}: where that is a plane of symmetry, the other half keeps it from turning so, and nothing "
                    f'does here; let it turn about {letter} alone, free="r{letter}"'
                ] = None
    return list(found)


class Symmetry:
    """What is to be said of accepted states of a scene that stands for more than it models. Construction is collective."""

    def __init__(self, scene: "Scene", system: System) -> None:
        self._system, self._planes = system, planes_of(scene, system.supports)
        self._X = system.space.tabulate_dof_coordinates()
        corners = compat.cell_dofs(system.space)[: compat.cell_map(scene.mesh.domain).size_local]
        extents = np.ptp(self._X[corners], axis=1)
        sums = system.comm.allreduce(np.array([*extents.sum(axis=0), len(extents)]))
        self._extents = sums[:3] / max(sums[3], 1.0)
        turned = scene.section is not None and scene.section.axisymmetric  # an axis is no plane of what goes round it
        self._mirrors = [plane for plane in self._planes if not (turned and plane.axis == 0)]
        self._alike = self._symmetric()

    def _symmetric(self) -> dict[tuple[str, str], bool]:
        """By contact and plane, whether an analytic tool is symmetric about it before anything has moved. Collective."""
        system, out = self._system, dict[tuple[str, str], bool]()
        rest, poses = np.zeros_like(system.state.q), system.tools.poses()
        for contact, plane in product(system.contact_terms, self._mirrors):
            if isinstance(places := contact.places, RigidPlaces):
                pose = poses.at(places.index, rest[places.index])
                off = max(system.comm.allgather(_unlike(plane, self._X[contact.surface.nodes.ravel()], places, pose)))
                out[contact.name, plane.name] = off <= FLAT * system.extent
        return out

    def remarks(self) -> dict[str, Remark]:
        """{what: its Remark} of the state accepted last. Collective."""
        found, system, x = dict[str, Remark](), self._system, self._X + self._system.state.u.x.array.reshape(-1, 3)
        for plane in self._planes:
            if remark := self._beyond(plane, x):
                found[f"beyond {plane.name}"] = remark
        for contact in system.contact_terms if self._planes else ():
            if not contact.partner.grounded:
                continue
            # how far (n, 3) what the tool has at the nodes has come from where it was at the start
            gone = x - system.state.pose(system.tools.names.index(contact.master_name)).before(x)
            held = pressed(system.space, [contact])
            if remark := self._aside(contact, gone, held) or self._askew(contact, x, held):
                found[f"tool {contact.master_name}"] = remark
        return found

    def _beyond(self, plane: Plane, x: Floats) -> Remark | None:
        """None, or that a body, whose nodes are at x (n, 3), has grown through a plane. Collective."""
        system, axis = self._system, plane.axis
        owned = slice(system.space.dofmap.index_map.size_local)
        worst = foremost(system.comm, plane.inward * (plane.place - x[owned, axis]), self._X[owned])
        if worst is None or not worst.value > BEYOND * self._extents[axis]:
            return None
        return Remark(
            worst.value,
            f"a node of the bodies, {spot(worst.place)}, lies {worst.value:.3g} beyond the plane of '{plane.name}', which "
            f"is held along {'xyz'[axis]}: where that is a plane of symmetry, the other half is there, and nothing keeps "
            "the two apart; state the plane as a tool that this side meets (a guide that ends there needs nothing)",
        )

    def _aside(self, contact: ContactTerm, gone: Floats, held: Bools) -> Remark | None:
        """None, or that a tool, which has gone (n, 3) at the local nodes, has gone across a plane, on nodes of which it
        presses, held (n,) ones. Collective."""
        comm = self._system.comm
        size = max(comm.allgather(np.linalg.norm(gone, axis=1).max(initial=0.0)))
        for plane in self._planes:
            along = np.abs(gone[plane.nodes, plane.axis]) * held[plane.nodes]
            most, letter = max(comm.allgather(along.max(initial=0.0))), "xyz"[plane.axis]
            if most > max(ASIDE * size, FLAT * self._system.extent):
                return Remark(
                    most,
                    f"tool '{contact.master_name}' has gone {most:.3g} along {letter} on nodes of '{plane.name}', which is "
                    f"held along {letter}: where that is a plane of symmetry, the other half's goes the other way, and the "
                    f"whole would not; hold the tool along {letter}, and let it turn about {letter} alone",
                )
        return None

    def _askew(self, contact: ContactTerm, x: Floats, held: Bools) -> Remark | None:
        """None, or that an analytic tool reaches across a plane, on nodes of which, held (n,) ones at x (n, 3), it presses,
        and is not symmetric about it. Collective."""
        places, system, step = contact.places, self._system, BEYOND * contact.surface.cell_height
        if not isinstance(places, RigidPlaces):
            return None
        pose = system.state.pose(places.index)
        for plane in self._mirrors:
            at = x[plane.nodes[held[plane.nodes]]]
            here = distances_to(places, at, pose)
            beside = distances_to(places, at - plane.inward * step * np.eye(3)[plane.axis], pose)
            reaches = bool(((here < step) & (beside - here < ENDS * step)).any())
            width = np.abs(x[held, plane.axis] - plane.place).max(initial=0.0)
            reaches, off, width = np.max(
                system.comm.allgather((reaches, _unlike(plane, x[held], places, pose), width)), axis=0
            )
            meant = places.tool.whole or self._alike[contact.name, plane.name]
            if reaches and meant and off > UNLIKE * width:
                return Remark(
                    off,
                    f"tool '{contact.master_name}' presses on nodes of '{plane.name}', which is held along "
                    f"{'xyz'[plane.axis]}, reaches across that plane, and is not symmetric about it: its mirror image is up "
                    f"to {off:.3g} off, {off / width:.0%} of how far from the plane it presses; where that is a plane of "
                    "symmetry, the whole would have both, one in the other: centre the tool on it, or model the whole",
                )
        return None


def _unlike(plane: Plane, x: Floats, places: RigidPlaces, pose: Pose) -> float:
    """By how much places x (n, 3) and their mirror images differ in their distances to a tool in a pose [length]."""
    return float(np.abs(distances_to(places, x, pose) - distances_to(places, plane.mirrored(x), pose)).max(initial=0.0))
