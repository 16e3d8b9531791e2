"""gmsh script or .msh file -> distributed mesh whose volumes and surfaces are known by name, or the facets of a tool."""

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


def read_gmsh(source, comm=MPI.COMM_WORLD, ranks=None, **parameters):
    """Mesh from a script or a file, the same on any number of ranks.

    source: a function that draws and meshes the current gmsh model (called with `parameters`), or a .msh path. Volume and
    surface groups need names. ranks: {volume: rank that holds all of it}, of bodies that share no node, where dolfinx is not
    to choose. Raises ValueError, on all ranks, for a failing script, unnamed groups, cells that are not
    hexahedra or tetrahedra, and inverted cells.
    """
    volumes, surfaces, failure = {}, {}, None
    owners = None if ranks is None else []
    if comm.rank == 0:
        try:
            _draw(source, parameters)
            volumes, surfaces = _group_names(3), _group_names(2)
            _check_model(volumes)
            _drop_loose_points()
            if ranks is not None:
                owners = _owners(volumes, ranks, comm.size)
        except Exception as error:
            failure = _refusal(source, error)
    failure, volumes, surfaces = comm.bcast((failure, volumes, surfaces))
    try:
        if failure:
            raise ValueError(failure)
        domain, cell_tags, facet_tags = compat.mesh_from_gmsh(gmsh.model, comm, 0, owners)
    finally:
        if comm.rank == 0:
            gmsh.finalize()
    domain.topology.create_connectivity(2, 3)
    domain.topology.create_connectivity(3, 2)
    return NamedMesh(domain, cell_tags, facet_tags, volumes, surfaces)


def read_surface(source, group=None, comm=MPI.COMM_WORLD, **parameters):
    """Facets of a surface group, or of all surfaces, in full on every rank: nodes (nf, 4), size (nf,) and X (nm, 3).

    source as for read_gmsh, no volume is needed; a triangle repeats its third node. Raises ValueError, on all ranks, for a
    failing script, an unknown group, a surface without facets, and facets with nodes on their edges.
    """
    found, failure = None, None
    if comm.rank == 0:
        try:
            _draw(source, parameters)
            found = _facets(group)
        except Exception as error:
            failure = _refusal(source, error)
        finally:
            gmsh.finalize()
    failure, found = comm.bcast((failure, found))
    if failure:
        raise ValueError(failure)
    return found


def _draw(source, parameters):
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    if callable(source):
        source(**parameters)
    else:
        gmsh.open(str(source))


def _refusal(source, error):
    return f"the gmsh mesh '{getattr(source, '__module__', source)}' cannot be made: {error}"


def _facets(group):
    entities = [tag for _, tag in gmsh.model.getEntities(2)]
    if group is not None:
        groups = _group_names(2)
        entities = gmsh.model.getEntitiesForPhysicalGroup(2, groups[_known(group, groups, "surface")])
    corners = {"Triangle 3": 3, "Quadrilateral 4": 4}
    rows = [np.empty((0, 4), dtype=np.int64)]
    for entity in entities:
        for kind, _, tags in zip(*gmsh.model.mesh.getElements(2, entity), strict=True):
            name = gmsh.model.mesh.getElementProperties(kind)[0]
            if name not in corners:
                raise ValueError(f"facets of type '{name}' are not supported for a tool; mesh its surface with order 1")
            tags = np.asarray(tags, dtype=np.int64).reshape(-1, corners[name])
            rows.append(tags if corners[name] == 4 else tags[:, [0, 1, 2, 2]])
    tags, nodes = np.unique(np.concatenate(rows), return_inverse=True)
    if not len(tags):
        what = f"surface group '{group}'" if group else "it"
        raise ValueError(f"{what} has no facets; mesh a surface with gmsh.model.mesh.generate(2)")
    known, places, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(known)
    X = np.asarray(places).reshape(-1, 3)[order[np.searchsorted(known, tags, sorter=order)]]
    nodes = np.ascontiguousarray(nodes.reshape(-1, 4), dtype=np.int64)
    return nodes, np.where(nodes[:, 2] == nodes[:, 3], 3, 4).astype(np.int64), np.ascontiguousarray(X)


def _group_names(dim):
    groups = {gmsh.model.getPhysicalName(dim, tag): tag for _, tag in gmsh.model.getPhysicalGroups(dim)}
    if "" in groups:
        raise ValueError(f"physical group {groups['']} of dimension {dim} has no name; call gmsh.model.setPhysicalName")
    return groups


def _owners(volumes, ranks, size):
    """Rank of each cell in the order in which dolfinx reads them: groups by tag, their entities, their cells."""
    if set(ranks) != set(volumes) or not all(0 <= rank < size for rank in ranks.values()):
        raise ValueError(f"ranks = {ranks}: give each of the volumes {', '.join(sorted(volumes))} a rank below {size}")
    owners = []
    for name, tag in sorted(volumes.items(), key=lambda item: item[1]):
        for entity in gmsh.model.getEntitiesForPhysicalGroup(3, tag):
            cells = sum(len(tags) for tags in gmsh.model.mesh.getElements(3, entity)[1])
            owners.append(np.full(cells, ranks[name]))
    return np.concatenate(owners)


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


def _drop_loose_points():
    """Nodes of points that no cell knows, such as the centres of arcs: dolfinx takes the number of nodes for the mesh's."""
    used = np.unique(np.concatenate(gmsh.model.mesh.getElements(3)[2]))
    points = gmsh.model.getEntities(0)
    loose = [point for point in points if not np.isin(gmsh.model.mesh.getNodes(*point)[0], used).all()]
    if loose:
        gmsh.model.mesh.clear(loose)
        gmsh.model.mesh.renumberNodes()


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
