"""A gmsh session: the script's model, what must hold of it, and the plain copy of it that dolfinx reads."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from fenics_contact.curved import reaching, refuse_ambiguous
from fenics_contact.folded import Folded, folded
from fenics_contact.meetings import Mismatch, joined_by_nodes, key, meetings, place_of
from fenics_contact.mesh_files.load import load, refuse_without_cells
from fenics_contact.types import Array, Floats, Ints64

# gmsh's numbering of a cell's faces by its corners, counter-clockwise where these are edges
_FACES = {
    "Quadrilateral": np.array([[0, 1], [1, 2], [2, 3], [3, 0]]),
    "Triangle": np.array([[0, 1], [1, 2], [2, 0]]),
    "Hexahedron": np.array([[0, 1, 2, 3], [0, 1, 5, 4], [0, 3, 7, 4], [1, 2, 6, 5], [2, 3, 7, 6], [4, 5, 6, 7]]),
    "Tetrahedron": np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]),
}
# what dolfinx reads, order 1 and 2, by the dimension of the mesh, and what their faces are
_CELLS = {
    3: {
        "Hexahedron 8": "Quadrilateral 4",
        "Hexahedron 27": "Quadrilateral 9",
        "Tetrahedron 4": "Triangle 3",
        "Tetrahedron 10": "Triangle 6",
    },
    2: {"Quadrilateral 4": "Line 2", "Quadrilateral 9": "Line 3", "Triangle 3": "Line 2", "Triangle 6": "Line 3"},
}
# how other programs call them
_WRITTEN = {
    "Triangle 6": " (Nastran: CTRIA6, Abaqus: STRI65)",
    "Triangle 3": " (Nastran: CTRIA3, Abaqus: S3)",
    "Line 3": " (Nastran: CBEAM3)",
}
_ADVICE = {3: "use hexahedra or tetrahedra, of order 1 or 2", 2: "use quadrilaterals or triangles, of order 1 or 2"}
_BODY, _SIDE = {3: "volume", 2: "surface"}, {3: "surface", 2: "curve"}  # what a body is, and what bounds it
# the nodes of a cell that runs clockwise, the other way round
_TURNED = {
    "Quadrilateral 4": [0, 3, 2, 1],
    "Quadrilateral 9": [0, 3, 2, 1, 7, 6, 5, 4, 8],
    "Triangle 3": [0, 2, 1],
    "Triangle 6": [0, 2, 1, 5, 4, 3],
}
_FLAT = 1e-9  # of a model's size: what is in the plane z = 0
_LONGEST_LOG = 5  # lines

Source = Callable[..., Any] | str | Path  # a script that draws and meshes the current model, or a path


@dataclass(frozen=True)
class ModelGroups:
    """dim: of the cells; `volumes`: name -> tag of its cells; `surfaces`: name -> tags of its facets; in a plane mesh of its
    surfaces and its curves; `edges` and `points`: name -> ends (n, 2) of its lines, nodes (n, 1), numbered as the cells'
    nodes are handed over; `cells`: name -> how many; `doubled` and `touching`: Meetings of faces with other cells' faces,
    and of parts with each other, that share no nodes; `folded`: cells that are inside out at a node.

    A facet has one tag: every combination of surface groups that meet in a facet has a tag of its own.
    """

    dim: int
    volumes: dict[str, int]
    surfaces: dict[str, tuple[int, ...]]
    edges: dict[str, Ints64]
    points: dict[str, Ints64]
    cells: dict[str, int]
    doubled: tuple[Mismatch, ...]
    touching: tuple[Mismatch, ...]
    folded: tuple[Folded, ...]


# -- session ----------------------------------------------------------------------------------------------------------
def draw(source: Source, parameters: dict[str, Any], tool: bool = False) -> None:
    """Run a script in a new gmsh session, or read a file into it; tool: of which facets or lines are enough."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.logger.start()
    if callable(source):
        with _script_in_our_session():
            source(**parameters)
        return
    if not isinstance(source, str | Path):
        raise TypeError("give a function that draws it, or a file's path; the points of a curve go to rigid_extrusion")
    with _errors_gathered():
        load(str(source), tool=tool, **parameters)
    if not tool:
        refuse_without_cells(str(source))


def close() -> None:
    """End the session."""
    gmsh.logger.stop()  # the next session starts a log of its own
    gmsh.finalize()


def log(known: str = "") -> str:
    """The errors that gmsh has written, but for those that `known` says already."""
    return "; ".join([line for line in _errors() if line not in known][-_LONGEST_LOG:])


def _errors(since: int = 0) -> list[str]:
    """The errors in gmsh's log after its first `since` lines, each once."""
    lines = [line.removeprefix("Error: ").strip() for line in gmsh.logger.get()[since:] if line.startswith("Error")]
    return list(dict.fromkeys(lines))


@contextmanager
def _errors_gathered() -> Iterator[None]:
    """gmsh throws its errors even out of a parallel region, which ends the process: let it note them, and raise after."""
    before, as_set = len(gmsh.logger.get()), gmsh.option.getNumber("General.AbortOnError")
    gmsh.option.setNumber("General.AbortOnError", 1)
    try:
        yield
    finally:
        gmsh.option.setNumber("General.AbortOnError", as_set)
    if errors := _errors(before):
        raise RuntimeError("; ".join(errors[-_LONGEST_LOG:]))


@contextmanager
def _script_in_our_session() -> Iterator[None]:
    """A script's own gmsh.finalize() does not end the session, and its generate() raises the errors it has gathered."""
    generate, finalize = gmsh.model.mesh.generate, gmsh.finalize

    def gathered(*arguments: Any, **named: Any) -> None:
        with _errors_gathered():
            generate(*arguments, **named)

    gmsh.model.mesh.generate, gmsh.finalize = gathered, lambda: None
    try:
        yield
    finally:
        gmsh.model.mesh.generate, gmsh.finalize = staticmethod(generate), finalize


# -- reading ----------------------------------------------------------------------------------------------------------
def group_entities(dim: int) -> dict[str, tuple[int, list[int]]]:
    """{name: (lowest tag, entities)} of the physical groups of a dimension; groups of one name are one."""
    groups: dict[str, tuple[int, list[int]]] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        name = gmsh.model.getPhysicalName(dim, tag)
        if not name:
            raise ValueError(
                f"physical group {tag} of dimension {dim} has no name of its own; give it one by gmsh.model.setPhysicalName "
                "(of two groups of one name a .msh file of format 2 keeps that of the first alone)"
            )
        first, entities = groups.get(name, (tag, []))
        found = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
        groups[name] = min(first, tag), [*entities, *(e for e in found if e not in entities)]
    return groups


def elements(dim: int, entity: int) -> Iterator[tuple[int, str, Array, Ints64]]:
    """(type's number, name, element tags, nodes (n, k)) of every element type of an entity, nodes as gmsh numbers them."""
    for kind, tags, nodes in zip(*gmsh.model.mesh.getElements(dim, entity), strict=True):
        name = gmsh.model.mesh.getElementProperties(kind)[0]
        yield kind, name, tags, np.asarray(nodes, dtype=np.int64).reshape(len(tags), -1)


def places(tags: Ints64) -> Floats:
    """Coordinates (n, 3) of nodes."""
    known, X, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(known)
    return np.asarray(X).reshape(-1, 3)[order[np.searchsorted(known, tags, sorter=order)]]


# -- handing over -----------------------------------------------------------------------------------------------------
def hand_over(processes: int = 1) -> ModelGroups:
    """Check the model and put in its place what dolfinx is sure to read: cells of one type in disjoint volume groups, facets
    in disjoint surface groups, no other node or element. Returns its ModelGroups.

    A model without volumes whose surfaces are in groups is a plane mesh: of its surfaces, with curves for their sides.
    processes: of more than one ValueError where parts of the mesh have nodes in common, but no face.
    """
    dim = 2 if not gmsh.model.getEntities(3) and gmsh.model.getPhysicalGroups(2) else 3
    volumes, surfaces = group_entities(dim), group_entities(dim - 1)
    kind, label, cells, owner, tags = _cells(dim, volumes)
    used = np.unique(cells)
    X = places(used)
    rows = np.searchsorted(used, cells)
    refuse_ambiguous(kind, rows, X)
    drawn = X[rows]
    bent = folded(kind, tags, drawn, np.array([*volumes])[owner])
    shape = label.split()[0]
    faces = cells[:, _FACES[shape]]
    owner_of_face = np.repeat(owner, faces.shape[1])
    faces = faces.reshape(-1, faces.shape[2])
    face_keys = key(faces)
    facets = _facets(dim, surfaces, face_keys, label)
    names = list(volumes)

    def groups_of(face: int) -> tuple[str, tuple[str, ...]]:
        return names[owner_of_face[face]], facets.names_of(face_keys[face])

    def reaches(those: Ints64, others: Ints64) -> Array:
        own, side = np.divmod(those, len(_FACES[shape]))
        return reaching(kind, drawn[own], _FACES[shape][side], drawn[others])

    corners = rows[:, : _FACES[shape].max() + 1]
    if processes > 1 and len(nodes := joined_by_nodes(corners, face_keys, len(used))):
        raise ValueError(
            f"parts of the mesh have {len(nodes)} nodes in common, but no side of cells, the first at "
            f"{place_of(X[nodes[0]])}: dolfinx may wait for ever for what several processes share there; run it on one, "
            "give each part nodes of its own, or mesh both sides of the seam alike"
        )
    doubled, touching = meetings(X, corners, _FACES[shape], face_keys, groups_of, reaches)
    volume_tags = {name: number for number, name in enumerate(volumes, 1)}  # not the script's: forms are compiled by them
    counts = [int(count) for count in np.bincount(owner, minlength=len(names))]
    edges, points = {} if dim == 2 else _ends(1, used), _ends(0, used)
    bodies = [(name, tag, cells[owner == i]) for i, (name, tag) in enumerate(volume_tags.items())]
    _replace(dim, used, X, kind, bodies, facets)
    sizes = dict(zip(names, counts, strict=True))
    return ModelGroups(dim, volume_tags, facets.tags, edges, points, sizes, doubled, touching, bent)


def _cells(dim: int, volumes: dict[str, tuple[int, list[int]]]) -> tuple[int, str, Ints64, Ints64, Array]:
    """Type's number and name, nodes (n, k), index of the volume (n,) and tags (n,) of all cells, in the order of the groups'
    tags."""
    if not volumes:
        raise ValueError("it has no physical volume; add one with gmsh.model.addPhysicalGroup(3, ...) and name it")
    group_of: dict[int, str] = {}
    kinds: dict[int, str] = {}
    rows, owner, numbers = [], [], []
    for index, (name, (_, entities)) in enumerate(volumes.items()):
        for entity in entities:
            if group_of.setdefault(entity, name) != name:
                raise ValueError(
                    f"{_BODY[dim]} {entity} is in two groups, '{group_of[entity]}' and '{name}': a cell has one material"
                )
            for kind, label, tags, nodes in elements(dim, entity):
                if label not in _CELLS[dim]:
                    raise ValueError(f"cells of type '{label}' are not supported; {_ADVICE[dim]}")
                kinds[kind] = label
                rows.append(nodes if dim == 3 else counter_clockwise(label, nodes, tags))
                numbers.append(tags)
                owner.append(np.full(len(nodes), index))
        if index not in [o[0] for o in owner if len(o)]:
            raise ValueError(f"{_BODY[dim]} group '{name}' has no cells; mesh it with gmsh.model.mesh.generate({dim})")
    for _, entity in gmsh.model.getEntities(dim):
        count = sum(len(tags) for _, _, tags, _ in elements(dim, entity))
        if count and entity not in group_of:
            raise ValueError(
                f"{_BODY[dim]} {entity} has {count} cells but is in no group; give it a named group with "
                f"gmsh.model.addPhysicalGroup({dim}, ...), or remove its mesh with gmsh.model.mesh.clear"
            )
    if len(kinds) > 1:
        raise ValueError(f"it mixes cells of types {' and '.join(kinds.values())}; mesh all {_BODY[dim]}s with one of them")
    cells = np.concatenate(rows)
    _, copies = np.unique(key(cells), return_counts=True)
    if twice := int((copies > 1).sum()):
        raise ValueError(f"{twice} cells are there twice, with the same nodes; draw and mesh each {_BODY[dim]} once")
    ((kind, label),) = kinds.items()
    return kind, label, cells, np.concatenate(owner), np.concatenate(numbers)


def counter_clockwise(label: str, nodes: Ints64, tags: Array) -> Ints64:
    """Nodes of plane cells, turned where they run clockwise; ValueError off the plane z = 0 and for cells folded or flat."""
    corners = len(_FACES[label.split()[0]])
    X = places(nodes.ravel()).reshape(*nodes.shape, 3)
    size = float(np.ptp(X[..., :2].reshape(-1, 2), axis=0).max()) if X.size else 0.0
    off = np.abs(X[..., 2]).max(initial=0.0)
    if off > _FLAT * size:
        raise ValueError(
            f"a mesh of surfaces alone lies in the plane z = 0, and a node of it has z = {off:.3g}; draw it there, or draw "
            "and mesh volumes"
        )
    x = X[:, :corners, :2]
    ahead, behind = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    turn = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]  # of each corner
    clockwise = turn.sum(axis=1) < 0.0
    bad = np.flatnonzero(~(np.where(clockwise[:, None], -turn, turn) > 0.0).all(axis=1))
    if bad.size:
        remedy = "give the surface a width and a height" if np.ptp(x, axis=(0, 1)).min() == 0.0 else "mesh the surface again"
        raise ValueError(f"{bad.size} folded or flat elements, the first is element {tags[bad[0]]}; {remedy}")
    return np.where(clockwise[:, None], nodes[:, _TURNED[label]], nodes)


def _ends(dim: int, used: Ints64) -> dict[str, Ints64]:
    """{name: corner nodes (n, dim + 1), as places in `used`} of the named groups of lines or points on the cells."""
    found: dict[str, Ints64] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        if not (name := gmsh.model.getPhysicalName(dim, tag)):
            continue  # what has no name nobody can state
        entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
        rows = [nodes[:, : dim + 1] for entity in entities for _, _, _, nodes in elements(dim, entity)]
        ends = np.sort(np.concatenate([np.empty((0, dim + 1), dtype=np.int64), *rows]), axis=1)
        on_cells = np.isin(ends, used).all(axis=1)
        if 0 < on_cells.sum() < len(ends):
            kind = "edge" if dim else "point"
            raise ValueError(f"{kind} group '{name}': {(~on_cells).sum()} of its {len(ends)} are on no cell of a volume")
        found[name] = np.concatenate([found.get(name, ends[:0]), np.searchsorted(used, ends[on_cells])])
    return found


@dataclass(frozen=True)
class _Facets:
    """Facets of cells in surface groups: type, nodes (n, k), keys (n,) in rising order, tag (n,) of their combination of
    groups, and by group's name the tags of its combinations."""

    kind: int
    nodes: Ints64
    keys: Array
    tag: Ints64
    tags: dict[str, tuple[int, ...]]

    def names_of(self, face_key: int) -> tuple[str, ...]:
        """Surface groups of the facet with this key, sorted."""
        at = np.searchsorted(self.keys, face_key)
        if at == len(self.keys) or self.keys[at] != face_key:
            return ()
        return tuple(sorted(name for name, tags in self.tags.items() if self.tag[at] in tags))


def _facets(dim: int, surfaces: dict[str, tuple[int, list[int]]], face_keys: Array, cell: str) -> _Facets:
    """_Facets of the groups that are faces of cells of this type; a group on no cell, as a tool drawn beside, has none."""
    corners = {"Triangle": 3, "Quadrilateral": 4, "Line": 2}
    rows, keys, of_cells = [], {}, np.unique(face_keys)
    facet: int | None = None
    for name, (_, entities) in surfaces.items():
        found, on_cells = 0, [np.empty(0, dtype=np.uint64)]
        for kind, label, _, nodes in (one for entity in entities for one in elements(dim - 1, entity)):
            own = key(nodes[:, : corners[label.split()[0]]])
            on_cell = of_cells[np.minimum(np.searchsorted(of_cells, own), len(of_cells) - 1)] == own
            found += len(own)
            if on_cell.any():
                if label != _CELLS[dim][cell]:
                    wanted = _CELLS[dim][cell]
                    raise ValueError(
                        f"{_SIDE[dim]} group '{name}': {on_cell.sum()} of its facets are of type '{label}' and lie on "
                        f"cells of type '{cell}'; write both with one order, these as '{wanted}'{_WRITTEN.get(wanted, '')}"
                    )
                facet = kind
                rows.append((own[on_cell], nodes[on_cell]))
                on_cells.append(own[on_cell])
        if not found:
            raise ValueError(
                f"{_SIDE[dim]} group '{name}' has no facets; give it {_SIDE[dim]}s of a meshed {_BODY[dim]} or remove it"
            )
        keys[name] = np.concatenate(on_cells)
        if 0 < len(keys[name]) < found:
            raise ValueError(
                f"{_SIDE[dim]} group '{name}': {found - len(keys[name])} of its {found} facets are on no cell of a "
                f"{_BODY[dim]}; give them a group of their own, or mesh the {_BODY[dim]} after its {_SIDE[dim]}s so that "
                "both have the same nodes"
            )
    if facet is None:
        none = np.empty(0, dtype=np.int64)
        return _Facets(0, none.reshape(0, 4), none.astype(np.uint64), none, dict.fromkeys(surfaces, ()))
    known, first = np.unique(np.concatenate([own for own, _ in rows]), return_index=True)
    combination: Ints64 = np.zeros(len(known), dtype=np.int64)
    members = {name: np.isin(known, own) for name, own in keys.items()}
    for member in members.values():
        _, combination = np.unique(2 * combination + member, return_inverse=True)
    tag = combination + 1
    tags = {name: tuple(int(one) for one in np.unique(tag[member])) for name, member in members.items()}
    return _Facets(facet, np.concatenate([nodes for _, nodes in rows])[first], known, tag, tags)


def _replace(dim: int, used: Ints64, X: Floats, kind: int, volumes: list[tuple[str, int, Ints64]], facets: _Facets) -> None:
    """Put a model in the place of the current one that holds these nodes, cells and facets, each once, and nothing else."""
    gmsh.model.remove()
    gmsh.model.add("for dolfinx")
    _, tag, _ = volumes[0]
    for _, entity, _ in volumes:
        gmsh.model.addDiscreteEntity(dim, entity)
    gmsh.model.mesh.addNodes(dim, tag, np.arange(1, len(used) + 1), X.ravel())
    for name, entity, cells in volumes:
        _add(dim, entity, name, kind, np.searchsorted(used, cells) + 1)
    for entity in (int(one) for one in np.unique(facets.tag)):
        gmsh.model.addDiscreteEntity(dim - 1, entity)
        rows = facets.nodes[facets.tag == entity]
        _add(dim - 1, entity, f"combination {entity}", facets.kind, np.searchsorted(used, rows) + 1)


def _add(dim: int, entity: int, name: str, kind: int, nodes: Ints64) -> None:
    gmsh.model.mesh.addElementsByType(entity, kind, [], nodes.ravel())
    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [entity], entity), name)
