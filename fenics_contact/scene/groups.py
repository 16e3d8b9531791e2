"""The named bodies and surfaces of a scene: their facets, areas, and integrals over them."""

from collections.abc import Sequence

import ufl

from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.assembly.section import Section
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.scene.statements import Body
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.elements import quadrature_degree
from fenics_contact.types import Ints, Measure, Space
from fenics_contact.values import SceneError, group_names, quoted


class Groups:
    """Of a mesh with names, and displacements of a degree on it; section: what a plane mesh stands for."""

    def __init__(self, mesh: NamedMesh, space: Space, degree: int, section: Section | None) -> None:
        self._mesh, self._space, self._section, self._full = mesh, space, section, quadrature_degree(degree)

    def facets(self, group: str | tuple[str, ...]) -> Ints:
        """Local facets of surfaces, of which there must be some. Collective."""
        try:
            facets = self._mesh.facets(*group_names(group))
        except ValueError as error:
            raise SceneError(str(error)) from None
        if self._mesh.comm.allreduce(len(facets)) == 0:
            kind = "curve" if self._mesh.plane else "surface"
            raise SceneError(f"{kind} group {quoted(group)} has no facets on a body; draw it on one")
        return facets

    def dx(self, body: Body, degree: int | None = None) -> Measure:
        """Integral over a body, exact to `degree` (by default the element's full integration)."""
        measure = ufl.Measure(
            "dx",
            domain=self._mesh.domain,
            subdomain_data=self._mesh.cell_tags,
            metadata={"quadrature_degree": self._full if degree is None else degree},
        )
        return vp.integral(measure(self._mesh.volume_tag(body.group)), self._section)

    def ds(self, group: str | Sequence[str]) -> Measure:
        """Integral over a surface at the start, by the element's full integration."""
        measure = ufl.Measure(
            "ds",
            domain=self._mesh.domain,
            subdomain_data=self._mesh.facet_tags,
            metadata={"quadrature_degree": self._full},
        )
        return vp.integral(measure(self._mesh.surface_tags(*group_names(group))), self._section)

    def area(self, group: str | Sequence[str]) -> float:
        """Area of an outer surface at the start, of a plane mesh as deep as its bodies [length^2]. Collective."""
        facets = self._mesh.facets(*group_names(group))
        self._mesh.refuse_inside(facets, f"area of {quoted(group)}")
        skin = skin_of(self._space, facets, self._section)
        return self._mesh.comm.allreduce(float(skin.area.sum()))
