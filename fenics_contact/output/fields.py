"""Fields of a solution on the mesh: displacement, Cauchy stress, J and the contact fields at the nodes."""

import numpy as np
import ufl

from fenics_contact import compat
from fenics_contact.assembly.system import System
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.output.solved import Solved
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.body import Body
from fenics_contact.types import Floats, Function, Ints

# How much a point is held, by its status code: the order in which a node's points of different status are averaged.
_RANK_OF_STATUS = np.empty(4)
_RANK_OF_STATUS[[OPEN, CLOSED, SLIP, STICK]] = 0, 1, 2, 3


class Fields:
    """Functions of a scene's solution, refreshed by `update`; all are of degree 1 or constant per cell.

    displacement [length]; cauchy_stress, J per cell [pressure, 1]; contact_pressure, friction_traction [pressure, on the
    current area]; gap [length], status (0 open, 1 closed, 2 stick, 3 slip) at the nodes of slave surfaces.
    """

    def __init__(self, scene: Solved, system: System) -> None:
        mesh = scene.mesh.domain
        self.scene, self.system = scene, system
        flat = compat.lagrange_space(mesh, 1)
        vector = compat.lagrange_space(mesh, 1, (3,))
        self.displacement = compat.Function(vector, name="displacement")
        self.cauchy_stress = compat.Function(compat.constant_space(mesh, (3, 3)), name="cauchy_stress")
        self.J = compat.Function(compat.constant_space(mesh), name="J")
        self.contact_pressure = compat.Function(flat, name="contact_pressure")
        self.friction_traction = compat.Function(vector, name="friction_traction")
        self.gap = compat.Function(flat, name="gap")
        self.status = compat.Function(flat, name="contact_status")
        self._nodal = compat.lagrange_space(mesh, scene.degree)
        self._prepare_stress()
        self._prepare_area()

    @property
    def all(self) -> list[Function]:
        return [self.displacement, self.cauchy_stress, self.J, *self._contact_fields()]

    def _contact_fields(self) -> list[Function]:
        if not self.system.contacts:
            return []
        return [self.contact_pressure, self.friction_traction, self.gap, self.status]

    def _prepare_stress(self) -> None:
        scene, u = self.scene, self.system.state.u
        centre = {"hexahedron": [0.5, 0.5, 0.5], "tetrahedron": [0.25, 0.25, 0.25]}[compat.cell_name(scene.mesh.domain)]
        self._centre_J = compat.cell_evaluator(scene.mesh.domain, ufl.det(vp.deformation_gradient(u)), centre)
        self._centre_stress = [
            (self._cells(body), compat.cell_evaluator(scene.mesh.domain, vp.cauchy_stress(law, u), centre))
            for body, law in zip(scene.bodies, self.system.terms[0].laws, strict=True)
        ]

    def _cells(self, body: Body) -> Ints:
        tags = self.scene.mesh.cell_tags
        cells = tags.indices[tags.values == self.scene.mesh.volume_tag(body.group)]
        return cells[cells < self.scene.mesh.domain.topology.index_map(3).size_local]

    def _prepare_area(self) -> None:
        groups = sorted({name for contact in self.scene.contacts for name in contact.slave})
        if not groups:
            return
        v = ufl.TestFunction(self._nodal)
        self._slave_groups = groups
        form = vp.current_area(self.system.state.u, v, self.scene.mesh.domain, self.scene.ds(groups))
        self._area_form = compat.compile_form(form)

    def update(self) -> None:
        """Evaluate all fields at the system's state."""
        u = self.system.state.u
        if self.scene.degree == 1:
            self.displacement.x.array[:] = u.x.array
        else:
            self.displacement.interpolate(u)
        self._per_cell(self.J, self._centre_J(), slice(None))
        for cells, evaluate in self._centre_stress:
            self._per_cell(self.cauchy_stress, evaluate(), cells)
        if self.system.contacts:
            self._update_contact()

    def _per_cell(self, function: Function, values: Floats, cells: Ints | slice) -> None:
        width = values.shape[1]
        owned = function.x.array[: values.size].reshape(-1, width)  # one block per cell, numbered like the cells
        owned[cells] = values[cells]
        compat.copy_to_ghosts(function)

    def _update_contact(self) -> None:
        """Means over the slave points of each node, and tractions per current area."""
        area, weight, normal, gap, rank, *tangential = (compat.Function(self._nodal) for _ in range(8))
        compat.assemble_vector(area.x.array, self._area_form)
        for contact in self.system.contacts:
            s = contact.surface
            share = s.area[..., None] * s.a
            pressure, friction = contact.split_traction(self.system.state)
            response = contact.response(self.system.state)
            sums = [(weight, np.ones_like(pressure)), (normal, pressure), (gap, response.gap)]
            sums += [(rank, _RANK_OF_STATUS[response.status]), *zip(tangential, np.moveaxis(friction, 2, 0), strict=True)]
            for target, values in sums:
                np.add.at(target.x.array, s.nodes, np.einsum("eqk,eq->ek", share, values))
        for function in (area, weight, normal, gap, rank, *tangential):
            compat.sum_to_owners(function)

        touched = weight.x.array > 0
        mean = np.where(touched, 1.0 / np.where(touched, weight.x.array, 1.0), 0.0)
        per_area = np.where(touched, 1.0 / np.where(touched, area.x.array, 1.0), 0.0)
        self._publish(self.contact_pressure, normal.x.array * per_area)
        self._publish(self.gap, gap.x.array * mean)
        nearest = np.clip(np.rint(rank.x.array * mean), 0, 3).astype(int)
        self._publish(self.status, np.argsort(_RANK_OF_STATUS)[nearest].astype(float))
        scalar = compat.Function(self.contact_pressure.function_space)
        for axis, component in enumerate(tangential):
            self._publish(scalar, component.x.array * per_area)
            self.friction_traction.x.array[axis::3] = scalar.x.array

    def _publish(self, function: Function, values: Floats) -> None:
        source = compat.Function(self._nodal)
        source.x.array[:] = values
        compat.copy_to_ghosts(source)
        if self.scene.degree == 1:
            function.x.array[:] = source.x.array
        else:
            function.interpolate(source)


def exterior_surface(scene: Solved, u: Function, values: Floats | None = None) -> tuple[Floats, Floats] | tuple[None, None]:
    """Deformed boundary on rank 0 for pictures: corners (facets, 3 or 4, 3) [length] and the field at them.

    values: (nodes,) array over the local nodes of the scene's space, e.g. u.x.array[2::3]. Other ranks get (None, None).
    """
    mesh = scene.mesh.domain
    cells, local = compat.cells_of_exterior_facets(mesh)
    x = scene.space.tabulate_dof_coordinates() + u.x.array.reshape(-1, 3)
    values = np.zeros(len(x)) if values is None else values
    ring = [0, 1, 3, 2] if compat.cell_name(mesh) == "hexahedron" else [0, 1, 2]
    corners, colours = [], []
    for facet in range(6 if len(ring) == 4 else 4):
        dofs = compat.cell_dofs(scene.space)[cells[local == facet]][:, compat.facet_closure_dofs(scene.space, facet)[ring]]
        corners.append(x[dofs])
        colours.append(values[dofs])
    parts = mesh.comm.gather((np.concatenate(corners), np.concatenate(colours)))
    if parts is None:
        return None, None
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
