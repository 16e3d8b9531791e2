"""What a function of `record=` sees of a run at a step: places, surfaces, supports and contacts, alike on any ranks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from fenics_contact.assembly.facet_points import skin_of_means
from fenics_contact.assembly.system import System
from fenics_contact.output.energies import Energies
from fenics_contact.output.fields import CellValues
from fenics_contact.output.places import Place, interpolated, locate
from fenics_contact.output.reactions import Reaction
from fenics_contact.output.results import ContactResult, StepResult
from fenics_contact.scene.scene import Scene
from fenics_contact.types import Floats, Function

T = TypeVar("T")


@dataclass(frozen=True)
class Sample:
    """At a point, or on average over a surface: displacement (3,) [length]; F (3, 3), its J, and principal stretches (3,),
    falling; cauchy_stress (3, 3) and pressure, minus a third of its trace [pressure], of the cell at its centre."""

    displacement: Floats
    F: Floats
    J: float
    stretches: Floats
    cauchy_stress: Floats
    pressure: float


class View:
    """A run at the step just accepted, for functions of `record=`, which all ranks call alike.

    u: displacement Function; t; travel (tools, 3) [length] and angles (tools, 3) [radians] of the tools, in the order of
    `scene.tools`; energies: Energies.
    """

    def __init__(self, scene: Scene, system: System) -> None:
        self._scene, self._system = scene, system
        self._cells: CellValues | None = None
        self._places: dict[tuple[float, ...], Place] = {}
        self._result: StepResult | None = None

    def show(self, result: StepResult) -> "View":
        """Take up what was measured at a step."""
        self._result = result
        return self

    @property
    def u(self) -> Function:
        return self._system.state.u

    @property
    def t(self) -> float:
        return self._system.state.t

    @property
    def travel(self) -> Floats:
        return self._system.state.travel

    @property
    def angles(self) -> Floats:
        return self._system.state.angles

    @property
    def energies(self) -> Energies:
        return self._measured.energies

    @property
    def _measured(self) -> StepResult:
        if self._result is None:
            raise ValueError("no step has been accepted yet")
        return self._result

    @property
    def contacts(self) -> dict[str, ContactResult]:
        """All contacts by name."""
        return self._measured.contacts

    def contact(self, name: str) -> ContactResult:
        """A contact by its name; KeyError lists the names."""
        return _named(self._measured.contacts, name, "contact")

    def reaction(self, group: str) -> Reaction:
        """Force and moment of a support by the name of its group; KeyError lists the names."""
        return _named(self._measured.reactions, group, "support")

    def drive(self, tool: str) -> Reaction:
        """Force, and moment about its reference point, by which a tool is driven, by its name; KeyError lists the names."""
        return _named(self._measured.drives, tool, "tool")

    def at(self, place: str | Sequence[float] | Floats) -> Sample:
        """At a point (3,) of the undeformed bodies [length], or on average over an outer surface by its name. Collective.

        ValueError, on all ranks, where there is no body, or no outer surface of that name.
        """
        if isinstance(place, str):
            return self._over(place)
        point = np.asarray(place, dtype=float)
        if point.shape != (3,):
            raise ValueError(f"at({place!r}): give a point (x, y, z) or the name of a surface")
        return self._at_point(point)

    def _at_point(self, point: Floats) -> Sample:
        comm, key = self._system.comm, tuple(point)
        if key not in self._places:
            self._places[key] = locate(comm, self._scene.mesh.domain, point)
        rank, cell, local = self._places[key]
        cells = np.array([cell] if comm.rank == rank else [], dtype=np.int32)
        stress = self._cell_values.stress(cells)
        values = None
        if comm.rank == rank:
            u, gradient = interpolated(self.u, cell, local, self._scene.section)
            values = u, np.eye(3) + gradient, stress[0]
        return _sample(*comm.bcast(values, root=rank))

    def _over(self, group: str) -> Sample:
        scene = self._scene
        facets = scene.mesh.facets(group)
        scene.mesh.refuse_inside(facets, f"at('{group}')")
        skin = skin_of_means(scene.space, facets, scene.section)
        area, u = skin.area.sum(axis=1), self.u.x.array.reshape(-1, 3)[skin.nodes]
        moved = np.einsum("eq,eqk,ekc->c", skin.area, skin.N, u)
        cells, back = np.unique(skin.cells, return_inverse=True)
        F, stress = (values(cells.astype(np.int32))[back] for values in (self._cell_values.F, self._cell_values.stress))
        sums = np.concatenate([moved, area @ F.reshape(-1, 9), area @ stress.reshape(-1, 9), [area.sum()]])
        means = (sums := self._system.comm.allreduce(sums))[:-1] / sums[-1]
        return _sample(means[:3], means[3:12].reshape(3, 3), means[12:].reshape(3, 3))

    @property
    def _cell_values(self) -> CellValues:
        if self._cells is None:
            self._cells = CellValues(self._scene, self._system)
        return self._cells


def _named(found: Mapping[str, T], name: str, what: str) -> T:
    if name not in found:
        raise KeyError(f"no {what} '{name}'; there is: {', '.join(found) or 'none'}")
    return found[name]


def _sample(u: Floats, F: Floats, stress: Floats) -> Sample:
    stretches = np.linalg.svd(F, compute_uv=False)
    return Sample(u, F, float(np.linalg.det(F)), stretches, stress, float(-np.trace(stress) / 3.0))
