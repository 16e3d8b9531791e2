"""An Abaqus input file's sets as groups: bodies of its sections, sides of its surfaces, node sets on facets or as points."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fenics_contact.mesh_files import keywords
from fenics_contact.mesh_files.parts import (
    CURVED,
    SUPPORTED,
    TYPES,
    CellBlock,
    MeshParts,
    chosen,
    joined,
    nodes_of,
    outer,
    put,
)
from fenics_contact.types import Ints64

SOLIDS = "for a body have its solid elements written (C3D8, C3D4 or C3D10)"

_PLANE = ("CPE", "CPS", "CAX", "CGAX")  # types of elements that are cells of a plane mesh; others without a volume are sides


def read_inp(path: str, bodies: str | Sequence[str] | None = None, tool: bool = False) -> None:
    """Bodies: the element sets of this name, else those with a *SOLID SECTION, else all with cells, each cell in one.

    Shells and membranes alone are a `tool`, and a plane mesh where `bodies` names them.
    """
    model = keywords.read(Path(path))
    if not model.elements:
        raise ValueError("it has no *ELEMENT with a mesh")
    number = np.concatenate([np.empty(0, dtype=np.int64), *model.number])
    if not len(number):
        raise ValueError("it has no *NODE; have the nodes written")
    _refuse_lost("*NSET", model.nsets, number)
    _refuse_lost("*ELSET", model.elsets, np.concatenate([*(one.number for one in model.elements), *model.passed]))
    dim = max(block.dim for block in model.elements)
    if dim < 2:
        raise ValueError(f"it holds {_held(model.elements)}, and no cells of bodies; {SOLIDS}")
    cells, facets = ([_block(one, number) for one in model.elements if one.dim == d] for d in (dim, dim - 1))
    if dim < 3 and not (bodies or tool):
        _refuse_sides(model.elements)
    parts = MeshParts(dim, np.concatenate(model.places), _bodies(model, cells, bodies))
    for name, numbers in model.elsets.found.items():
        if (side := chosen(facets, numbers)) and name not in model.elsets.internal:
            parts.sides[name] = side
    for name, rows in model.surfaces.items():
        parts.sides[name] = joined([one for row in rows for one in _faces(model, cells, facets, *row)])
    for name in model.combined:
        parts.sides[name] = _combined(model, name, parts.sides)
    _add_node_sets(parts, model, cells, number)
    put(parts)


def _held(blocks: list[keywords.Elements]) -> str:
    """How many of each type, and the number of the first."""
    kinds = dict.fromkeys(one.kind for one in blocks)
    numbers = {kind: np.concatenate([one.number for one in blocks if one.kind == kind]) for kind in kinds}
    return ", ".join(f"{len(some)} of type {kind} (the first is element {some[0]})" for kind, some in numbers.items())


def _refuse_sides(blocks: list[keywords.Elements]) -> None:
    """Shells in the place of cells: whether a body or a plane mesh is meant nobody knows."""
    if sides := [one for one in blocks if one.dim == 2 and not one.kind.startswith(_PLANE)]:
        raise ValueError(
            f"it holds no solid elements, but {_held(sides)}: shells, membranes and rigid facets are no bodies; {SOLIDS}; "
            "rigid_surface(path) makes a tool of them; where they are a plane mesh, in z = 0, write them as CPE4, CPE3 or "
            "CPE6, or name their element set in bodies=(...)"
        )


def _block(elements: keywords.Elements, number: Ints64) -> CellBlock:
    """The elements of a keyword, with rows of the nodes in the place of their numbers."""
    kind = TYPES.get((elements.dim, elements.nodes.shape[1]))
    if kind is None:
        raise ValueError(
            f"*ELEMENT: not supported are {_held([elements])}; {SUPPORTED}. Where they are quadratic, write their corners "
            "alone (C3D8 for C3D20): Scene(..., degree=2) has quadratic displacements on any mesh"
        )
    order = np.argsort(number)
    at = order[np.minimum(np.searchsorted(number, elements.nodes, sorter=order), len(number) - 1)]
    if (absent := number[at] != elements.nodes).any():
        row, column = np.argwhere(absent)[0]
        raise ValueError(
            f"*ELEMENT: {absent.sum()} nodes of elements of type {elements.kind} are not in the file, the first is node "
            f"{elements.nodes[row, column]} of element {elements.number[row]}; have all nodes written"
        )
    return CellBlock(kind, elements.number, at)


def _refuse_lost(keyword: str, sets: keywords.Sets, known: Ints64) -> None:
    """Nodes or elements that a set names one by one, and that are not there."""
    for name, named in sets.named.items():
        if len(lost := np.setdiff1d(named, known)):
            one = sets.what.removesuffix(" set")
            raise ValueError(
                f"{keyword} '{name}': {len(lost)} of its {one}s are not in the file, the first is {one} {lost[0]}; have all "
                f"{one}s written, or take these out of the set"
            )


def _bodies(model: keywords.Model, cells: list[CellBlock], asked: str | Sequence[str] | None) -> dict[str, list[CellBlock]]:
    """{name: its cells}, each cell in one."""
    names = [asked] if isinstance(asked, str) else list(asked or model.sections)
    names = names or [name for name in model.elsets.found if name not in model.elsets.internal]
    found: dict[str, list[CellBlock]] = {}
    owner: dict[int, str] = {}
    for name in dict.fromkeys(model.elsets.sought(name) for name in names):
        if not (own := chosen(cells, model.elsets.get(name))):
            continue
        found[name] = own
        for element in (int(one) for block in own for one in block.number):
            if element in owner:
                raise ValueError(
                    f"element {element} is in two bodies, '{owner[element]}' and '{name}'; name the sets that are bodies, "
                    "bodies=(...): a cell is in one"
                )
            owner[element] = name
    if left := sum(map(len, cells)) - len(owner):
        sets = [name for name in model.elsets.found if name not in (*model.elsets.internal, *found)]
        named = f", or name theirs in bodies=(...), of {', '.join(sets)}" if sets else ""
        bodies = f". The bodies are: {', '.join(found)}" if found else ""
        raise ValueError(f"{left} cells are in no body; give them an element set with a *SOLID SECTION{named}{bodies}")
    return found


def _faces(model: keywords.Model, cells: list[CellBlock], facets: list[CellBlock], name: str, face: str) -> list[CellBlock]:
    """Facets of a line of *SURFACE, of an element or a set: one face of each, all outer ones, or the facets of the set."""
    numbers = np.array([name], dtype=np.int64) if name.isdigit() else model.elsets.get(name)
    own, sides = chosen(cells, numbers), chosen(facets, numbers)
    if face in ("", "SPOS", "SNEG"):
        found = ([] if face else outer(cells, numbers)) + ([one.turned() for one in sides] if face == "SNEG" else sides)
        if found or own:  # shells alone are cells, and have no such sides
            return found
    faces = [{f"S{i}": one for i, one in enumerate(block.faces(), start=1)} for block in own]
    if not own or any(face not in some for some in faces):
        known = f"they have {', '.join(faces[0])}" if own else "there are no such cells"
        raise ValueError(f"*SURFACE: elements of '{name}' have no face {face or 'of their own'}; {known}")
    return [some[face] for some in faces]


def _combined(model: keywords.Model, name: str, sides: dict[str, list[CellBlock]]) -> list[CellBlock]:
    """Facets of several surfaces, those that two have in common, or those of one without another's."""
    how, names = model.combined[name]
    line = f"*SURFACE '{name}' in {model.line(model.stated[name.upper()])}"
    if how not in ("UNION", "INTERSECTION", "DIFFERENCE") or (how != "UNION" and len(names) != 2):
        raise ValueError(
            f"{line}: COMBINE={how} of {len(names)} surfaces is not known; UNION takes several, INTERSECTION and "
            "DIFFERENCE two"
        )
    known = {one.upper(): one for one in (*model.surfaces, *model.combined) if one in sides}
    if absent := [one for one in names if one.rpartition(".")[2].upper() not in known]:
        raise ValueError(f"{line}: before it there is no surface '{absent[0]}' of elements, but {', '.join(known.values())}")
    first, *others = (sides[known[one.rpartition(".")[2].upper()]] for one in names)
    if how == "UNION":
        return joined([*first, *(block for other in others for block in other)])
    keys = np.concatenate([np.empty(0, dtype=np.uint64), *(block.keys() for block in others[0])])
    return [block.only(block.number[np.isin(block.keys(), keys) == (how == "INTERSECTION")]) for block in joined(first)]


def _add_node_sets(parts: MeshParts, model: keywords.Model, cells: list[CellBlock], number: Ints64) -> None:
    """Sets that are all nodes of some outer facets are these facets, others points (those of curved cells are left out)."""
    faces, of_cells = joined(outer(cells)), nodes_of(cells)
    curved = any(block.kind in CURVED for block in cells)
    spelled = {name.upper(): name for name in parts.sides}
    for name, numbers in model.nsets.found.items():
        nodes = np.intersect1d(np.flatnonzero(np.isin(number, numbers)), of_cells)
        covered = [face.only(face.number[np.isin(face.nodes, nodes).all(axis=1)]) for face in faces]
        if twin := spelled.get(name.upper()):
            if not np.array_equal(nodes_of(parts.sides[twin]), nodes):
                raise ValueError(f"node set '{name}' and surface '{twin}' have different nodes; give one another name")
        elif name in model.nsets.internal or not len(nodes):
            continue
        elif np.array_equal(nodes_of(covered), nodes):
            parts.sides[name] = [face for face in covered if len(face)]
        elif not curved:
            parts.points[name] = nodes
