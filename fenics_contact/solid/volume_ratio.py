"""J = det F over a mesh: its smallest value, and the cell that turned inside out."""

from collections.abc import Sequence

import basix
import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.finding import CRUSHING, INVERTED, Finding, foremost, spot
from fenics_contact.assembly.section import Section
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.body import Body, NamedCells
from fenics_contact.types import Function


class VolumeRatio:
    """J of the displacement u in the quadrature points of all cells. mesh: NamedMesh; bodies: with their groups."""

    def __init__(
        self, mesh: NamedCells, bodies: Sequence[Body], degree: int, u: Function, section: Section | None = None
    ) -> None:
        cell = getattr(basix.CellType, compat.cell_name(mesh.domain))
        points, _ = basix.make_quadrature(cell, 2 * degree + 1)
        self._mesh, self._bodies, self._turns = mesh, bodies, section is not None and section.axisymmetric
        self._evaluate = compat.cell_evaluator(mesh.domain, ufl.det(vp.deformation_gradient(u, section)), points)

    def smallest(self) -> float:
        """Smallest J over all ranks."""
        return self._mesh.comm.allreduce(float(np.min(self._evaluate(), initial=np.inf)), op=MPI.MIN)

    def check(self, least: float = 0.0) -> Finding | None:
        """None, or the Finding that names the cell with the smallest J where that is at most `least`. Collective."""
        J = self._evaluate().min(axis=1, initial=np.inf)
        J[np.isnan(J)] = -np.inf
        smallest = self._mesh.comm.allreduce(J.min(initial=np.inf), op=MPI.MIN)
        if smallest > least:
            return None
        centres = self._mesh.domain.geometry.x[compat.geometry_dofmap(self._mesh.domain)[: len(J)]].mean(axis=1)
        found = foremost(self._mesh.comm, -J, centres)
        if found is None:
            return None
        body = self._mesh.comm.bcast(self._body(found.item), root=found.rank)
        place = spot(found.place)
        remedy = "take smaller steps there, mesh the place more finely, or round the corner that presses on it"
        what = "turned inside out" if smallest <= 0.0 else "nearly turned inside out"
        if smallest == 0.0 and self._turns:
            what = "goes through the axis"
        if 0.0 < smallest <= CRUSHING:
            what = "is squeezed to nothing"
            remedy = f"end the path before what presses on it leaves it no room; where that is one place alone, {remedy}"
        return Finding(INVERTED, f"an element {what} (J = {smallest:.3g})", f"body '{body}' at {place}", remedy)

    def _body(self, cell: int) -> str:
        """Name of the body that a local cell is of, if any."""
        tags = self._mesh.cell_tags
        tag = tags.values[tags.indices == cell]
        return next((body.group for body in self._bodies if self._mesh.volume_tag(body.group) in tag), "")
