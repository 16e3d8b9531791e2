"""Fields of a solution on the mesh: displacement, Cauchy stress, J and the contact fields at the nodes."""

from collections.abc import Sequence

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.facet_points import geometry_degree
from fenics_contact.assembly.system import System
from fenics_contact.kernels.status import OPEN
from fenics_contact.output.names import plain_name
from fenics_contact.output.places import centre_of, inner_points
from fenics_contact.output.recovery import Patches
from fenics_contact.output.slave_nodes import RANK_OF_STATUS, STATUS_OF_RANK, NodalContact, SlaveNodes
from fenics_contact.scene.scene import Scene
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.body import Body
from fenics_contact.types import Floats, Function, Ints, Ints64, Space
from fenics_contact.units import Units


class CellValues:
    """F (n, 3, 3) and Cauchy stress (n, 3, 3) [pressure] of local cells at their centres; stress at the bodies' corners."""

    def __init__(self, scene: Scene, system: System) -> None:
        domain, u = scene.mesh.domain, system.state.u
        self._scene, cell = scene, compat.cell_name(domain)
        # Of degree 1 strains are most accurate at the centre
        self._points = np.array([centre_of(cell), *(inner_points(cell) if scene.degree > 1 else [])])
        self._inner = slice(1 if scene.degree > 1 else 0, None)  # those that patches take
        self._gradient = compat.cell_evaluator(domain, vp.deformation_gradient(u, scene.section), self._points[:1])
        self._stresses = [
            (self._cells(body), compat.cell_evaluator(domain, vp.cauchy_stress(law, u, scene.section), self._points))
            for body, law in zip(scene.bodies, system.terms[0].laws, strict=True)
        ]
        self.owned = np.arange(compat.cell_map(domain).size_local, dtype=np.int32)
        self._patches: list[tuple[Ints, Patches]] = []

    def _cells(self, body: Body) -> Ints:
        tags = self._scene.mesh.cell_tags
        return tags.indices[tags.values == self._scene.mesh.volume_tag(body.group)]

    def F(self, cells: Ints) -> Floats:
        return self._gradient(cells).reshape(-1, 3, 3)

    def stress(self, cells: Ints) -> Floats:
        values = np.zeros((len(cells), 9))
        for of_body, evaluate in self._stresses:
            mine = np.isin(cells, of_body)
            values[mine] = evaluate(cells[mine])[:, :9]
        return values.reshape(-1, 3, 3)

    def corner_stresses(self) -> list[tuple[Ints64, Floats]]:
        """Of each body its corners, local nodes of a space of degree 1, and their stresses (n, 3, 3), see `recovery`.
        Collective."""
        if not self._patches:
            mesh = self._scene.mesh.domain
            flat, element = (
                compat.lagrange_space(mesh, 1),
                compat.basix_element(compat.cell_name(mesh), geometry_degree(mesh)),
            )
            table = compat.tabulate(element, 0, self._points[self._inner])[0]
            for of_body, _ in self._stresses:
                own = of_body[of_body < len(self.owned)]
                places = np.einsum("kn,cnx->ckx", table, mesh.geometry.x[compat.geometry_dofmap(mesh)[own]])
                self._patches.append((own, Patches(flat, own, places)))
        out = []
        for (_, evaluate), (own, patches) in zip(self._stresses, self._patches, strict=True):
            found = evaluate(own).reshape(len(own), len(self._points), 9)[:, self._inner]
            out.append((patches.nodes, patches.fitted(found).reshape(-1, 3, 3)))
        return out


class ContactFields:
    """Functions of one contact, or of all, at the nodes of the displacement; NaN at those that are no slaves.

    pressure, friction [pressure, on the current area], gap, slip [length], status (0 open, 1 closed, 2 stick, 3 slip).
    """

    def __init__(self, system: System, name: str, units: Units) -> None:
        mesh = system.space.mesh
        flat, vector = (compat.lagrange_space(mesh, compat.degree(system.space), shape) for shape in ((), (3,)))
        self.pressure = compat.Function(flat, name=f"{name}contact_pressure_{units.pressure}")
        self.friction = compat.Function(vector, name=f"{name}friction_traction_{units.pressure}")
        self.gap = compat.Function(flat, name=f"{name}gap_{units.length}")
        self.slip = compat.Function(flat, name=f"{name}slip_{units.length}")
        self.status = compat.Function(flat, name=f"{name}contact_status")
        self._nodes = _nodes(flat, system.space)

    @property
    def all(self) -> list[Function]:
        return [self.pressure, self.friction, self.gap, self.slip, self.status]

    def put(self, at: NodalContact) -> None:
        """Fill the Functions."""
        status = at.status.astype(float)
        for function, values in zip(self.all, (at.pressure, at.friction, at.gap, at.slip, status), strict=True):
            on = at.on if values.ndim == 1 else at.on[:, None]
            function.x.array[:] = np.where(on, values, np.nan)[self._nodes].ravel()


def _nodes(flat: Space, space: Space) -> Ints64:
    """The node of `space` at each local node of the space `flat`, of the same degree."""
    found = np.empty(compat.cell_dofs(flat).max(initial=-1) + 1, dtype=np.int64)
    found[compat.cell_dofs(flat)] = compat.cell_dofs(space)
    return found


class Fields:
    """Functions of a scene's solution, units in their names, refreshed by `update`; of degree 1, contact fields of the
    displacement's, or constant per cell.

    displacement [length]; cauchy_stress, J per cell [pressure, 1]; corner_stress [pressure], at nodes of several bodies the
    mean of theirs, which by_body has apart; the ContactFields of all contacts, where a node of two
    shows the one that presses more, with the least gap and the status that holds it most, and, of several, `each` by name.
    """

    def __init__(self, scene: Scene, system: System, surfaces: Sequence[SlaveNodes] | None = None) -> None:
        mesh = scene.mesh.domain
        self.scene, self.system = scene, system
        self.displacement = compat.Function(compat.lagrange_space(mesh, 1, (3,)), name=f"displacement_{scene.units.length}")
        self.cauchy_stress = compat.Function(
            compat.constant_space(mesh, (3, 3)), name=f"cauchy_stress_{scene.units.pressure}"
        )
        self.corner_stress = compat.Function(
            compat.lagrange_space(mesh, 1, (3, 3)), name=f"nodal_cauchy_stress_{scene.units.pressure}"
        )
        self.by_body: list[tuple[Ints64, Floats]] = []
        self.J = compat.Function(compat.constant_space(mesh), name="J")
        self._cells = CellValues(scene, system)
        self._surfaces = surfaces_of(scene, system) if surfaces is None else surfaces
        self._contact = ContactFields(system, "", scene.units)
        several = self._surfaces if len(self._surfaces) > 1 else []
        self.each = {s.contact.name: ContactFields(system, f"{plain_name(s.contact.name)}_", scene.units) for s in several}

    def of(self, contact: str) -> ContactFields:
        """Those of one contact by its name, or with "" those of all."""
        return self.each.get(contact, self._contact)

    def least_pressure(self) -> float:
        """Pressure up to which it is round-off, of all contacts [pressure]. Collective."""
        return max((surface.least_pressure() for surface in self._surfaces), default=0.0)

    @property
    def all(self) -> list[Function]:
        contact = [self._contact, *self.each.values()] if self._surfaces else []
        return [
            self.displacement,
            self.corner_stress,
            self.cauchy_stress,
            self.J,
            *(f for fields in contact for f in fields.all),
        ]

    def update(self) -> None:
        """Evaluate all fields at the system's state. Collective."""
        u = self.system.state.u
        if self.scene.degree == 1:
            self.displacement.x.array[:] = u.x.array
        else:
            self.displacement.interpolate(u)
        owned = self._cells.owned
        self._per_cell(self.J, np.linalg.det(self._cells.F(owned)))
        self._per_cell(self.cauchy_stress, self._cells.stress(owned))
        self._put_corner_stress()
        if self._surfaces:
            found = [surface.whole(surface.at_state()) for surface in self._surfaces]
            self._contact.put(_joined(found))
            for fields, at in zip(self.each.values(), found, strict=False):
                fields.put(at)

    def _put_corner_stress(self) -> None:
        self.by_body = self._cells.corner_stresses()
        nodes = np.concatenate([nodes for nodes, _ in self.by_body])
        values = np.concatenate([values for _, values in self.by_body]).reshape(-1, 9)
        out = self.corner_stress.x.array.reshape(-1, 9)
        sums = np.stack([np.bincount(nodes, column, len(out)) for column in values.T], axis=1)
        out[:] = sums / np.maximum(np.bincount(nodes, minlength=len(out)), 1)[:, None]

    def _per_cell(self, function: Function, values: Floats) -> None:
        function.x.array[: values.size] = values.ravel()  # one block per cell, numbered like the cells
        compat.copy_to_ghosts(function)


def surfaces_of(scene: Scene, system: System) -> list[SlaveNodes]:
    """The slave surfaces of a scene's contacts."""
    slaves = [scene.mesh.facets(*stated.slave) for stated in scene.contacts]
    pairs = zip(system.contact_terms, slaves, strict=True)
    return [SlaveNodes(system, contact, facets, scene.section) for contact, facets in pairs]


def _joined(found: Sequence[NodalContact]) -> NodalContact:
    """Of each node the contact that presses most; the least gap and the status that holds it most of all."""
    here = np.arange(len(found[0].on))
    most = np.argmax([np.where(at.on, at.pressure, -np.inf) for at in found], axis=0)
    gap = np.min([np.where(at.on, at.gap, np.inf) for at in found], axis=0)
    rank = np.max([RANK_OF_STATUS[np.where(at.on, at.status, OPEN)] for at in found], axis=0)

    def pick(name: str) -> Floats:
        return np.asarray(np.stack([getattr(at, name) for at in found])[most, here])

    return NodalContact(
        np.any([at.on for at in found], axis=0), pick("area"), pick("pressure"), pick("friction"), gap, pick("slip"),
        STATUS_OF_RANK[rank.astype(int)], pick("closed"), pick("covered"), pick("stretch"),
    )  # fmt: skip
