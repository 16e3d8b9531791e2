"""Planes that supports make planes of symmetry, and what does not go with them: bodies that grow through them, tools on them
that move aside."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Remark, foremost, spot
from fenics_contact.assembly.size import extremes
from fenics_contact.assembly.system import System
from fenics_contact.contact.rigid_places import pressed
from fenics_contact.types import Bools, Floats, Ints

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene

FLAT = 1e-6  # of the bodies' size: how far from a plane its nodes may lie
BEYOND = 0.05  # of a cell's extent: what lies less deep may be what penalties leave on a tool in that plane
ASIDE = 0.01  # of a tool's way: less is what balance leaves
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


def planes_of(scene: "Scene") -> list[Plane]:
    """The planes of symmetry that a scene's supports state. Collective."""
    held: dict[tuple[str, ...], set[int | None]] = {}
    for support in scene.supports:
        held.setdefault(support.group, set()).add(support.axis)
    X, comm, found = scene.space.tabulate_dof_coordinates(), scene.mesh.comm, []
    low, high = extremes(comm, X)
    near = FLAT * float(np.max(high - low))
    for s in scene.supports:
        axis, zero = s.axis, isinstance(s.value, float) and s.value == 0.0
        if not zero or held[s.group] != {axis} or axis is None or not set(s.group) <= set(scene.mesh.surfaces):
            continue
        nodes = compat.locate_blocks(scene.space, scene.mesh.facets(*s.group))
        least, most = extremes(comm, X[nodes])
        place = float(least[axis])
        ends = [inward for inward, end in ((1, low), (-1, high)) if abs(place - end[axis]) < near]
        if most[axis] - least[axis] < near and ends:
            found.append(Plane("+".join(s.group), axis, place, ends[0], nodes))
    return found


class Symmetry:
    """What is to be said of accepted states of a scene that stands for more than it models. Construction is collective."""

    def __init__(self, scene: "Scene", system: System) -> None:
        self._system, self._planes = system, planes_of(scene)
        self._X = system.space.tabulate_dof_coordinates()
        corners = compat.cell_dofs(system.space)[: compat.cell_map(scene.mesh.domain).size_local]
        extents = np.ptp(self._X[corners], axis=1)
        sums = system.comm.allreduce(np.array([*extents.sum(axis=0), len(extents)]))
        self._extents = sums[:3] / max(sums[3], 1.0)

    def remarks(self) -> dict[str, Remark]:
        """{what: its Remark} of the state accepted last. Collective."""
        found, system, x = dict[str, Remark](), self._system, self._X + self._system.state.u.x.array.reshape(-1, 3)
        for plane in self._planes:
            if remark := self._beyond(plane, x):
                found[f"beyond {plane.name}"] = remark
        for contact in system.contacts if self._planes else ():
            if not contact.partner.grounded:
                continue
            # how far (n, 3) what the tool has at the nodes has come from where it was at the start
            gone = x - system.state.pose(system.tools.names.index(contact.master_name)).before(x)
            held = pressed(system.space, [contact])
            if remark := self._aside(contact, gone, held):
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
            if most > ASIDE * size:
                return Remark(
                    most,
                    f"tool '{contact.master_name}' has gone {most:.3g} along {letter} on nodes of '{plane.name}', which is "
                    f"held along {letter}: where that is a plane of symmetry, the other half's goes the other way, and the "
                    f"whole would not; hold the tool along {letter}, and let it turn about {letter} alone",
                )
        return None
