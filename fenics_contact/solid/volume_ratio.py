"""J = det F over a mesh: its smallest value, and the cells that turned inside out, wholly or at a corner, or are folded."""

from collections.abc import Sequence
from functools import cached_property

import basix
import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.finding import CRUSHING, INVERTED, Finding, Foremost, Remark, foremost, spot
from fenics_contact.assembly.section import Section
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.body import Body, NamedCells
from fenics_contact.solid.elements import quadrature_degree
from fenics_contact.types import Bools, Floats, Function

# Jacobian at a corner as drawn, over the cell's mean, up to which strains of a tenth, of which rubber thinks nothing, turn
# it over: sides all but in line, as where quadrilaterals meet a circle. J is next to 0 / 0 there and tells of the drawing
FLAT = 0.1
Shape = tuple[int, ...]
NEAR = 1e-6  # of a cell: how far from its corners J is asked there, for on the axis the strain around it is 0 / 0


class VolumeRatio:
    """J of the displacement u in the quadrature points of all cells. mesh: NamedMesh; bodies: with their groups."""

    def __init__(
        self, mesh: NamedCells, bodies: Sequence[Body], degree: int, u: Function, section: Section | None = None
    ) -> None:
        cell = getattr(basix.CellType, compat.cell_name(mesh.domain))
        points, _ = basix.make_quadrature(cell, quadrature_degree(degree))
        self._mesh, self._bodies, self._turns = mesh, bodies, section is not None and section.axisymmetric
        corners = basix.geometry(cell)
        near = (1.0 - NEAR) * corners + NEAR * corners.mean(axis=0)
        F, self._inner = vp.deformation_gradient(u, section), len(points)
        self._points = np.concatenate([points, near])
        self._evaluate = compat.cell_evaluator(mesh.domain, ufl.det(F), self._points)
        dim = corners.shape[1]
        self._part: Shape = len(near) + 1, dim, dim  # what turns: in the plane that part of F
        self._bends = degree > 1  # straight sides do not roll up
        if self._bends:
            inplane = ufl.as_tensor([[F[i, j] for j in range(dim)] for i in range(dim)])
            middle = corners.mean(axis=0, keepdims=True)
            self._gradients = compat.cell_evaluator(mesh.domain, inplane, np.concatenate([near, middle]))

    def check(self, least: float = 0.0) -> Finding | None:
        """None, or the Finding that names the cell with the smallest J where that is at most `least`. Collective."""
        J = self._evaluate()[:, : self._inner].min(axis=1, initial=np.inf)
        J[np.isnan(J)] = -np.inf
        found = self._worst(J, least)
        if found is None:
            return None
        smallest = -found.value
        remedy = "take smaller steps there, mesh the place more finely, or round the corner that presses on it"
        what = "turned inside out" if smallest <= 0.0 else "nearly turned inside out"
        if smallest == 0.0 and self._turns:
            what = "goes through the axis"
        if 0.0 < smallest <= CRUSHING:
            what = "is squeezed to nothing"
            remedy = f"end the path before what presses on it leaves it no room; where that is one place alone, {remedy}"
        return Finding(INVERTED, f"an element {what} (J = {smallest:.3g})", self._place(found), remedy)

    def look(self) -> tuple[float, dict[str, Remark]]:
        """Smallest J over all ranks; and what is to be said of the cell with the smallest J at a corner, if that is inside
        out there, though it may not be in its quadrature points, of which alone the stress asks. Collective."""
        values, remark = self._evaluate(), self.folded()
        folded = {"folded": remark} if remark else {}
        smallest = self._mesh.comm.allreduce(float(values[:, : self._inner].min(initial=np.inf)), op=MPI.MIN)
        corners = values[:, self._inner :]
        if not self._mesh.comm.allreduce(not (corners > 0.0).all(), op=MPI.LOR):
            return smallest, folded
        found = self._worst(np.where(self._flat, 1.0, corners).min(axis=1, initial=np.inf))
        if found is None:
            return smallest, folded
        text = (
            f"{self._place(found)}: a cell is turned inside out at a corner (J = {-found.value:.3g}), which its quadrature "
            "points do not feel: it may stay so and hold what is around it where no body could be; take smaller steps "
            "before, finer cells there, or round the edges that meet there"
        )
        return smallest, folded | {"corner": Remark(found.value, text)}

    def folded(self) -> Remark | None:
        """What is to be said of a cell of degree 2 that has turned at a corner, against its middle, by more than 90 degrees,
        in space 120: J may be above zero all over it. Collective."""
        if not self._bends:
            return None
        F = self._gradients().reshape(-1, *self._part)
        found = self._worst(np.einsum("cpij,cij->cp", F[:, :-1], F[:, -1]).min(axis=1, initial=np.inf))
        if found is None:
            return None
        text = (
            f"{self._place(found)}: a cell is folded: at a corner it has turned against its middle by more than "
            f"{90 if self._part[1] == 2 else 120} degrees, as no body can within so few cells, and what a long step has "
            "folded may stay so in balance; take smaller steps before, or finer cells there"
        )
        return Remark(found.value, text)

    @cached_property
    def _flat(self) -> Bools:
        """Which corners (cells, corners) tell nothing by J: those all but flat as drawn, or inside out, for below zero these
        have come upright. Few runs ask. Collective."""
        drawn = compat.cell_evaluator(self._mesh.domain, ufl.JacobianDeterminant(self._mesh.domain), self._points)()
        return np.asarray(drawn[:, self._inner :] <= FLAT * drawn[:, : self._inner].mean(axis=1, keepdims=True))

    def _worst(self, J: Floats, least: float = 0.0) -> Foremost | None:
        """-J and cell where J (cells,) is the smallest of all ranks, if that is at most `least`. Collective."""
        smallest = self._mesh.comm.allreduce(float(J.min(initial=np.inf)), op=MPI.MIN)
        if not smallest <= least:
            return None
        centres = self._mesh.domain.geometry.x[compat.geometry_dofmap(self._mesh.domain)[: len(J)]].mean(axis=1)
        return foremost(self._mesh.comm, -J, centres)

    def _place(self, found: Foremost) -> str:
        """The body and the middle of a cell, on all ranks. Collective."""
        body = self._mesh.comm.bcast(self._body(found.item), root=found.rank)
        return f"body '{body}' at {spot(found.place)}"

    def _body(self, cell: int) -> str:
        """Name of the body that a local cell is of, if any."""
        tags = self._mesh.cell_tags
        tag = tags.values[tags.indices == cell]
        return next((body.group for body in self._bodies if self._mesh.volume_tag(body.group) in tag), "")
