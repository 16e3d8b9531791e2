"""gmsh script or mesh file -> distributed mesh whose volumes and surfaces are known by name, or the facets of a tool."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import gmsh
import numpy as np
from mpi4py import MPI

from fenics_contact import compat, gmsh_model
from fenics_contact.agreement import collect_together
from fenics_contact.folded import Folded
from fenics_contact.gmsh_model import Source
from fenics_contact.meetings import Mismatch, key
from fenics_contact.types import Floats, Ints, Ints64, Mesh, Space, Tags
from fenics_contact.values import SceneError, shown

Taken = TypeVar("Taken")


class GroupNodes(dict[str, Ints64]):
    """Nodes of groups by name (n, ...); printed as how many there are, for a group may hold all of a mesh."""

    def __repr__(self) -> str:
        return "{" + ", ".join(f"{name!r}: {len(nodes)} of them" for name, nodes in self.items()) + "}"


@dataclass(repr=False)
class NamedMesh:
    """A dolfinx mesh with gmsh's physical groups by name. A plane mesh has surfaces in the place of volumes, and curves in
    that of surfaces.

    volumes: name -> tag in cell_tags; surfaces: name -> tags in facet_tags, one for every combination with other groups, so
    that groups may overlap; edges, points: name -> ends (n, 2) of lines, nodes (n, 1), by gmsh's order; doubled: faces of
    cells that lie on one another with nodes of their own; touching: parts that touch or overlap otherwise, see meetings;
    folded: cells that are inside out at a node as drawn.
    """

    domain: Mesh
    cell_tags: Tags
    facet_tags: Tags
    volumes: dict[str, int]
    surfaces: dict[str, tuple[int, ...]]
    edges: dict[str, Ints64]
    points: dict[str, Ints64]
    doubled: tuple[Mismatch, ...] = ()
    touching: tuple[Mismatch, ...] = ()
    folded: tuple[Folded, ...] = ()

    def __repr__(self) -> str:
        cells_are, facets_are = ("surfaces", "curves") if self.plane else ("volumes", "surfaces")
        named = (cells_are, self.volumes), (facets_are, self.surfaces), ("edges", self.edges), ("points", self.points)
        cells = self.domain.topology.index_map(self.domain.topology.dim).size_global
        groups = (f"{kind}: {', '.join(names)}" for kind, names in named if names)
        return f"NamedMesh({cells} cells; {'; '.join(groups)})"

    @property
    def comm(self) -> MPI.Comm:
        return self.domain.comm

    @property
    def plane(self) -> bool:
        """Whether the mesh is one of surfaces in the plane z = 0."""
        return self.domain.topology.dim == 2

    def facets(self, *names: str) -> Ints:
        """Local facets of the named surfaces (int32, sorted, possibly empty on this rank)."""
        tags = self.surface_tags(*names)
        return np.sort(self.facet_tags.indices[np.isin(self.facet_tags.values, tags)])

    def refuse_inside(self, facets: Ints, what: str) -> None:
        """SceneError, naming `what`, where any of these local facets has a body on both sides: what acts on a surface or is
        measured over it needs one. Collective."""
        mine = facets[facets < self.domain.topology.index_map(self.domain.topology.dim - 1).size_local]
        inside = self.comm.allreduce(int((~np.isin(mine, compat.exterior_facets(self.domain))).sum()))
        if inside:
            raise SceneError(
                f"{what}: {inside} of its facets lie inside the material; name an outer surface, or draw the "
                "bodies on both sides as separate volumes"
            )

    def surface_tags(self, *names: str) -> tuple[int, ...]:
        """Tags in facet_tags of all facets in any of the named surfaces, each once."""
        kind = "curve" if self.plane else "surface"
        return tuple(sorted({tag for name in names for tag in self.surfaces[_known(name, self.surfaces, kind)]}))

    def nodes(self, space: Space, *names: str) -> Ints:
        """Local nodes of a space (rising, ghosts included) of the named surfaces, edges and points. Collective."""
        kinds = self.surfaces, self.edges, self.points
        for name in names:
            if sum(name in groups for groups in kinds) > 1:
                raise SceneError(
                    f"there is more than one group '{name}', of surfaces, edges or points; give one another name"
                )
            if all(name not in groups for groups in kinds):
                _known(name, {**self.surfaces, **self.edges, **self.points}, "surface, edge or point")
        surfaces, edges, points = ([name for name in names if name in groups] for groups in kinds)
        found = [compat.locate_blocks(space, self.facets(*surfaces))]
        if edges or points:
            vertices = compat.source_vertices(self.domain)
            ends = np.sort(vertices[compat.edge_vertices(self.domain)], axis=1)
            for groups, names_there, rows, dim in (
                (self.edges, edges, ends, 1),
                (self.points, points, vertices[:, None], 0),
            ):
                wanted = np.concatenate([np.empty((0, dim + 1), dtype=np.int64), *(groups[name] for name in names_there)])
                found.append(compat.locate_blocks(space, np.flatnonzero(np.isin(_code(rows), _code(wanted))), dim))
        return np.unique(np.concatenate(found)).astype(np.int32)

    def volume_tag(self, name: str) -> int:
        return self.volumes[_known(name, self.volumes, "surface" if self.plane else "volume")]


def _code(rows: Ints64) -> Ints64:
    """One number for each row (n, 1) or (n, 2) of numbers."""
    return rows[:, 0] if rows.shape[1] == 1 else rows[:, 0] << 32 | rows[:, 1]


def read_gmsh(
    source: Source, comm: MPI.Comm = MPI.COMM_WORLD, ranks: dict[str, int] | None = None, **parameters: Any
) -> NamedMesh:
    """Mesh from a script or a file, the same on any number of ranks. Of a model without volumes: a plane mesh, of its
    surfaces, which lie in z = 0, with its curves for their sides.

    source: a function that draws and meshes the current gmsh model (called with `parameters`), or a file's path. Volume and
    surface groups need names; a surface may be in several. ranks: {volume: rank that holds all of it}, of bodies that share
    no node, where dolfinx is not to choose. Raises SceneError, on all ranks, for what gmsh or the script fails at, unnamed
    groups, cells that are not hexahedra or tetrahedra, of two types, in two groups or in none, and inverted cells.
    """
    groups, failure = None, None
    owners: Ints64 | None = None if ranks is None else np.empty(0, dtype=np.int64)
    collect_together(comm)
    if comm.rank == 0:
        try:
            gmsh_model.draw(source, parameters)
            groups = gmsh_model.hand_over(comm.size)
            if ranks is not None:
                owners = _owners(groups.cells, ranks, comm.size)
        except (Exception, SystemExit) as error:
            failure = _refusal(source, error)
    failure, groups = comm.bcast((failure, groups))
    try:
        if failure:
            raise SceneError(failure)
        domain, cell_tags, facet_tags = compat.mesh_from_gmsh(gmsh.model, comm, 0, groups.dim, owners)
    finally:
        if comm.rank == 0:
            gmsh_model.close()
    domain.topology.create_connectivity(groups.dim - 1, groups.dim)
    domain.topology.create_connectivity(groups.dim, groups.dim - 1)
    return NamedMesh(
        domain, cell_tags, facet_tags, groups.volumes, groups.surfaces, GroupNodes(groups.edges), GroupNodes(groups.points),
        groups.doubled,
        groups.touching,
        groups.folded,
    )  # fmt: skip


def read_mesh(
    path: str | Path,
    mesh_size: float | None = None,
    bodies: str | Sequence[str] | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    ranks: dict[str, int] | None = None,
) -> NamedMesh:
    """Mesh from a file by its ending, the same on any number of ranks; `docs/meshes.md` says what becomes of its sets.

    .msh; .inp (Abaqus, CalculiX); .bdf, .nas (Nastran); .vtu, with meshio; .step, .stp, .brep, .iges, .igs, .geo, meshed
    with tetrahedra of `mesh_size` [length]. bodies: the element sets (.inp) that are bodies, the cell data (.vtu) that
    say which.
    Raises SceneError, on all ranks, as read_gmsh does, and for another ending and what is not understood.
    """
    if Path(path).suffix.lower() == ".stl":
        raise SceneError(
            f"the mesh '{path}' cannot be made: an .stl file has no volume; read it as a tool, rigid_surface(path)"
        )
    asked = {name: value for name, value in (("mesh_size", mesh_size), ("bodies", bodies)) if value is not None}
    return read_gmsh(path, comm, ranks, **asked)


def read_surface(
    source: Source, group: str | None = None, comm: MPI.Comm = MPI.COMM_WORLD, **parameters: Any
) -> tuple[Ints64, Ints64, Floats]:
    """Facets of a surface group, or of all surfaces, in full on every rank: nodes (nf, 4), size (nf,) and X (nm, 3).

    source as for read_gmsh, no volume is needed; a triangle repeats its third node. Raises SceneError, on all ranks, for a
    failing script, an unknown group, a surface without facets, and facets with nodes on their edges.
    """
    return _drawn(source, parameters, comm, lambda: _facets(group))


def read_curve(
    source: Source, group: str | None = None, comm: MPI.Comm = MPI.COMM_WORLD, **parameters: Any
) -> tuple[Ints64, Floats]:
    """Sides of a curve group in the plane z = 0, or of all curves, in full on every rank: nodes (ns, 2) and X (nm, 3).

    source as for read_gmsh; of a curve around a surface the surface lies on the left. Raises SceneError, on all ranks, for a
    failing script, an unknown group, a curve without sides, sides of order 2 and places off the plane.
    """
    return _drawn(source, parameters, comm, lambda: _sides(group))


def _drawn(source: Source, parameters: dict[str, Any], comm: MPI.Comm, take: Callable[[], Taken]) -> Taken:
    """What `take` gives of the model that rank 0 draws, on every rank; SceneError, on all ranks, where either fails."""
    found, failure = None, None
    if comm.rank == 0:
        try:
            gmsh_model.draw(source, parameters, tool=True)
            found = take()
        except (Exception, SystemExit) as error:
            failure = _refusal(source, error)
        finally:
            gmsh_model.close()
    failure, found = comm.bcast((failure, found))
    if failure:
        raise SceneError(failure)
    return found


def _sides(group: str | None) -> tuple[Ints64, Floats]:
    sides, tags, X = _tool_elements(1, group, "curve", "sides", {"Line 2": [0, 1]})
    if np.abs(X[:, 2]).max() > 1e-9 * np.ptp(X, axis=0).max():
        raise ValueError("a curve that is a tool of a plane scene lies in z = 0; draw it there")
    return _leaving_on_the_left(sides, tags), X


def _leaving_on_the_left(sides: Ints64, tags: Ints64) -> Ints64:
    """Sides turned so that a cell of the model's surfaces which they bound lies on their left."""
    ways: set[tuple[int, int]] = set()
    for _, surface in gmsh.model.getEntities(2):
        for _, name, elements, nodes in gmsh_model.elements(2, surface):
            corners = gmsh_model.counter_clockwise(name, nodes, elements)[:, : 4 if name.startswith("Quad") else 3]
            ways |= set(zip(corners.ravel().tolist(), np.roll(corners, -1, axis=1).ravel().tolist(), strict=True))
    turned = np.array([(int(b), int(a)) in ways and (int(a), int(b)) not in ways for a, b in tags[sides]], dtype=bool)
    return np.where(turned[:, None], sides[:, ::-1], sides)


def _refusal(source: Source, error: BaseException) -> str:
    """Why there is no mesh, with what gmsh wrote in its log."""
    reason = str(error) or type(error).__name__
    said = gmsh_model.log(reason)
    said = f" (gmsh: {said})" if said else ""
    name = f"{source.__module__}.{source.__name__}" if isinstance(source, FunctionType) else source
    name = name if isinstance(name, str | Path) else shown(name)
    return f"the mesh '{name}' cannot be made: {reason}{said}"


def _facets(group: str | None) -> tuple[Ints64, Ints64, Floats]:
    rings = {"Triangle 3": [0, 1, 2, 2], "Quadrilateral 4": [0, 1, 2, 3]}
    nodes, _, X = _tool_elements(2, group, "surface", "facets", rings)
    return nodes, np.where(nodes[:, 2] == nodes[:, 3], 3, 4).astype(np.int64), X


def _tool_elements(
    dim: int, group: str | None, of: str, what: str, rings: dict[str, list[int]]
) -> tuple[Ints64, Ints64, Floats]:
    """Elements of a group, or all, as rows of numbers, by what `rings` take of their nodes; these nodes' tags and places
    X (nm, 3). ValueError where there are none, or others, and where a place is none: of bodies their Jacobians say it."""
    entities = [tag for _, tag in gmsh.model.getEntities(dim)]
    if group is not None:
        groups = gmsh_model.group_entities(dim)
        _, entities = groups[_known(group, groups, of)]
    rows: list[Ints64] = [np.empty((0, len(next(iter(rings.values())))), dtype=np.int64)]
    for _, name, _, nodes in (one for entity in entities for one in gmsh_model.elements(dim, entity)):
        if name not in rings:
            raise ValueError(f"{what} of type '{name}' are not supported for a tool; mesh its {of} with order 1")
        rows.append(nodes[:, rings[name]])
    found = np.concatenate(rows)
    _, first = np.unique(key(found), return_index=True)  # a file may hold a facet once for each of its groups
    tags, numbers = np.unique(found[np.sort(first)], return_inverse=True)
    if not len(tags):
        whose = f"{of} group '{group}'" if group else "it"
        raise ValueError(f"{whose} has no {what}; mesh a {of} with gmsh.model.mesh.generate({dim})")
    X = np.ascontiguousarray(gmsh_model.places(tags))
    if wrong := int((~np.isfinite(X)).any(axis=1).sum()):
        raise ValueError(f"{wrong} of its {len(X)} nodes have a coordinate that is no finite number; mesh it again")
    return np.ascontiguousarray(numbers.reshape(-1, found.shape[1]), dtype=np.int64), tags, X


def _owners(cells: dict[str, int], ranks: dict[str, int], size: int) -> Ints64:
    """Rank of each cell in the order in which dolfinx reads them, from {volume: number of cells}."""
    if set(ranks) != set(cells) or not all(0 <= rank < size for rank in ranks.values()):
        raise ValueError(f"ranks = {ranks}: give each of the volumes {', '.join(sorted(cells))} a rank below {size}")
    return np.concatenate([np.full(count, ranks[name]) for name, count in cells.items()])


def _known(name: str, groups: Mapping[str, object], kind: str) -> str:
    """The name itself, where there is such a group; SceneError that lists those there are."""
    if name not in groups:
        known = ", ".join(sorted(groups)) or "none"
        raise SceneError(f"there is no {kind} group '{name}' in the mesh; its {kind} groups are: {known}")
    return name
