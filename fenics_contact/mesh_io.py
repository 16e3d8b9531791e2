"""gmsh script or .msh file -> distributed mesh whose volumes and surfaces are known by name."""

from dataclasses import dataclass

import gmsh
import numpy as np
from mpi4py import MPI

from fenics_contact import compat

_CELLS = ("hexahedron", "tetrahedron")


@dataclass
class NamedMesh:
    """A dolfinx mesh with gmsh's physical groups by name: `volumes` and `surfaces` map a name to its tag."""

    domain: object
    cell_tags: object
    facet_tags: object
    volumes: dict
    surfaces: dict

    @property
    def comm(self):
        return self.domain.comm

    def facets(self, *names):
        """Local facets of the named surfaces (int32, sorted, possibly empty on this rank)."""
        tags = self.surface_tags(*names)
        return np.sort(self.facet_tags.indices[np.isin(self.facet_tags.values, tags)])

    def surface_tags(self, *names):
        return tuple(self.surfaces[_known(name, self.surfaces, "surface")] for name in names)

    def volume_tag(self, name):
        return self.volumes[_known(name, self.volumes, "volume")]


def _known(name, groups, kind):
    if name not in groups:
        known = ", ".join(sorted(groups)) or "none"
        raise ValueError(f"there is no {kind} group '{name}' in the mesh; its {kind} groups are: {known}")
    return name


def read_gmsh(source, comm=MPI.COMM_WORLD, **parameters):
    """Mesh from a script or a file, the same on any number of ranks.

    source: a function that draws and meshes the current gmsh model (called with `parameters`), or a .msh path. Volume and
    surface groups need names. Raises ValueError, on all ranks, for a failing script, unnamed groups, cells that are not
    hexahedra or tetrahedra, and inverted cells.
    """
    volumes, surfaces, failure = {}, {}, None
    if comm.rank == 0:
        try:
            gmsh.initialize()
            gmsh.option.setNumber("General.Terminal", 0)
            if callable(source):
                source(**parameters)
            else:
                gmsh.open(str(source))
            volumes, surfaces = _group_names(3), _group_names(2)
            _check_model(volumes)
        except Exception as error:
            failure = f"the gmsh mesh '{getattr(source, '__module__', source)}' cannot be made: {error}"
    failure, volumes, surfaces = comm.bcast((failure, volumes, surfaces))
    try:
        if failure:
            raise ValueError(failure)
        domain, cell_tags, facet_tags = compat.mesh_from_gmsh(gmsh.model, comm, 0)
    finally:
        if comm.rank == 0:
            gmsh.finalize()
    domain.topology.create_connectivity(2, 3)
    domain.topology.create_connectivity(3, 2)
    return NamedMesh(domain, cell_tags, facet_tags, volumes, surfaces)


def _group_names(dim):
    groups = {gmsh.model.getPhysicalName(dim, tag): tag for _, tag in gmsh.model.getPhysicalGroups(dim)}
    if "" in groups:
        raise ValueError(f"physical group {groups['']} of dimension {dim} has no name; call gmsh.model.setPhysicalName")
    return groups


def _check_model(volumes):
    if not volumes:
        raise ValueError("it has no physical volume; add one with gmsh.model.addPhysicalGroup(3, ...) and name it")
    for _, tag in gmsh.model.getPhysicalGroups(2):
        faces = gmsh.model.getEntitiesForPhysicalGroup(2, tag)
        if not any(len(gmsh.model.mesh.getElementTypes(2, face)) for face in faces):
            name = gmsh.model.getPhysicalName(2, tag)
            raise ValueError(f"surface group '{name}' has no facets; give it surfaces of a meshed volume or remove it")
    for _, tag in gmsh.model.getPhysicalGroups(3):
        for entity in gmsh.model.getEntitiesForPhysicalGroup(3, tag):
            for cell_type in gmsh.model.mesh.getElementTypes(3, entity):
                name = gmsh.model.mesh.getElementProperties(cell_type)[0]
                if not name.lower().startswith(_CELLS):
                    raise ValueError(f"cells of type '{name}' are not supported; use hexahedra or tetrahedra")
                tags, _ = gmsh.model.mesh.getElementsByType(cell_type, entity)
                _check_jacobians(cell_type, entity, tags)


def _check_jacobians(cell_type, entity, tags):
    points, _ = gmsh.model.mesh.getIntegrationPoints(cell_type, "Gauss2")
    _, determinants, _ = gmsh.model.mesh.getJacobians(cell_type, points, entity)
    worst = np.asarray(determinants).reshape(len(tags), -1).min(axis=1)
    bad = np.flatnonzero(~(worst > 0.0))
    if bad.size:
        raise ValueError(
            f"{bad.size} inverted or flat elements, the first is element {tags[bad[0]]} with Jacobian {worst[bad[0]]:.3g}; "
            "mesh the volume again or reverse its orientation"
        )
