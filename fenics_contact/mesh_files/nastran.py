"""A Nastran bulk data file: bodies and their sides are named by their properties, pid_1, pid_2, ..."""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenics_contact.mesh_files.parts import SUPPORTED, TYPES, CellBlock, MeshParts, put
from fenics_contact.types import Floats

SOLIDS = "for a body have its solid elements written (CHEXA or CTETRA)"
# dimension, and how many nodes there may be
_ELEMENTS = {
    **{"CTETRA": (3, 10), "CHEXA": (3, 20), "CPENTA": (3, 15), "CPYRAM": (3, 13), "CPYRA": (3, 13)},
    **{"CTRIA3": (2, 3), "CTRIAR": (2, 3), "CTRIA6": (2, 6), "CQUAD4": (2, 4), "CQUADR": (2, 4), "CQUAD8": (2, 8)},
    **{"CBAR": (1, 2), "CBEAM": (1, 2), "CROD": (1, 2), "CBEAM3": (1, 3)},
}
_UNKNOWN = re.compile(r"C(I|IF)?(TET|HEX|PEN|PYR|TR|Q|PLST)\w*")  # of solids and shells those that are not above
_ENTRY = re.compile(r"(?!CEND|CORD)C[A-Z]{2,}\d?\w*|GRID|RBE\d|PLOTEL")  # nodes and elements of any kind
_REAL = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))(?:(?:[ED]|(?=[-+]))([-+]?\d+))?")  # 1.5-3 is 0.0015


class Card(NamedTuple):
    """What stands in a line and in those that continue it; at: the first line's number."""

    at: int
    name: str
    fields: list[str]


def read_bdf(path: str) -> None:
    """GRID and elements in fields of 8, of 16 or with commas. What is not understood of the mesh is refused."""
    entries = list(_entries(Path(path).read_text("utf-8-sig", errors="replace")))
    row, X = _nodes(entries)
    elements: dict[tuple[int, int, int], list[list[int]]] = {}  # by dimension, property and number of nodes
    lines: dict[int, int] = {}
    for one in entries:
        if one.name not in _ELEMENTS and _UNKNOWN.fullmatch(one.name):
            raise ValueError(f"{one.name} in line {one.at} is not understood; write CHEXA, CTETRA, CQUAD4, CTRIA3 or CTRIA6")
        if one.name in _ELEMENTS:
            number, pid, *nodes = _element(one)
            if (first := lines.setdefault(number, one.at)) != one.at:
                raise ValueError(f"element {number} is given twice, in line {first} and in line {one.at}; number each once")
            elements.setdefault((_ELEMENTS[one.name][0], pid, len(nodes)), []).append([number, *nodes])
    dim = max((d for d, _, _ in elements), default=0)
    if dim < 2:
        held = ", ".join(f"{n} {name}" for name, n in Counter(one.name for one in entries).items() if _ENTRY.fullmatch(name))
        raise ValueError(
            f"it holds {held or 'nothing of a mesh'}, and no cells; {SOLIDS}, for a tool its facets (CQUAD4, CTRIA3)"
        )
    parts = MeshParts(dim, X)
    for (d, pid, count), rows in sorted(elements.items()):
        if d < dim - 1:
            continue
        numbers = np.array(rows, dtype=np.int64)
        if absent := next(((one[0], n) for one in rows for n in one[1:] if n not in row), None):
            raise ValueError(f"element {absent[0]} in line {lines[absent[0]]}: there is no GRID {absent[1]}; write it")
        places = np.array([[row[n] for n in one[1:]] for one in rows], dtype=np.int64)
        groups = parts.bodies if d == dim else parts.sides
        groups.setdefault(f"pid_{pid}", []).append(CellBlock(TYPES[d, count], numbers[:, 0], places))
    put(parts)


def _entries(text: str) -> Iterator[Card]:
    """Of the bulk data, or of all lines where nothing says that these begin, each with all its fields."""
    lines = [line.partition("$")[0].expandtabs().upper().rstrip() for line in text.splitlines()]  # without comments
    begin = next((at for at, line in enumerate(lines) if line.split()[:2] == ["BEGIN", "BULK"]), -1)
    entry, mark = Card(0, "", []), ""
    for at, line in enumerate(lines[begin + 1 :], start=begin + 2):
        if not line:
            continue
        head, fields, following = _fields(line)
        name, *more = head.removesuffix("*").split() or [""]
        if head[:1] in ("", "+", "*"):
            if entry.name in _ELEMENTS and head[1:] and mark.lstrip("+*") not in ("", head[1:]):
                raise ValueError(
                    f"line {at} continues '{mark}' of {entry.name} in line {entry.at} with '{head}'; write continuations in "
                    "the lines after their entries"
                )
            entry.fields.extend(fields)
        else:
            yield entry
            entry = Card(at, name, fields)
            if name == "ENDDATA":
                return
            if name == "INCLUDE" or (more and (name in _ELEMENTS or name == "GRID")):
                remedy = "have all written in one file" if name == "INCLUDE" else "write fields of 8 or 16, or with commas"
                raise ValueError(f"line {at}, '{line.strip()}', is not read; {remedy}")
        mark = following
    yield entry


def _fields(line: str) -> tuple[str, list[str], str]:
    """The first field; the data, 8 or, in a line with a star, 4 of them, with commas maybe more; the mark at the end."""
    large = "*" in line.split(",")[0][:8]
    count, width = (4, 16) if large else (8, 8)
    if "," not in line:
        return line[:8].strip(), [line[i : i + width].strip() for i in range(8, 72, width)], line[72:].strip()
    head, *data = (part.strip() for part in line.split(","))
    mark = ""
    if len(data) > count and (len(data) == count + 1 or data[count][:1] in ("", "+", "*")):
        mark, data = data[count], data[:count]
    return head, data + [""] * (-len(data) % count), mark


def _element(entry: Card) -> list[int]:
    """Its number, its property's, which by default is the same, and its nodes'."""
    dim, most = _ELEMENTS[entry.name]
    number, pid, *nodes = (entry.fields + [""] * (2 + most))[: 2 + most]
    while nodes and not nodes[-1]:
        nodes.pop()
    fields = [number, pid or number, *nodes]
    count = sum(map(bool, nodes))
    if (dim, count) not in TYPES:
        raise ValueError(
            f"{entry.name} {number} in line {entry.at} has {count} nodes; {SUPPORTED}. Where it is quadratic, its corners "
            "alone will do: Scene(..., degree=2) has quadratic displacements on any mesh"
        )
    if wrong := [part for part in fields if not part.isdecimal()]:
        raise ValueError(f"{entry.name} in line {entry.at}: '{wrong[0]}' is no number of an element, a property or a node")
    return [int(part) for part in fields]


def _nodes(entries: list[Card]) -> tuple[dict[int, int], Floats]:
    """The row of each node by its number, and the places (n, 3)."""
    known: dict[int, tuple[int, list[float]]] = {}  # by number: the line and the place
    for at, name, (number, system, *X) in ((one.at, one.name, (one.fields + [""] * 5)[:5]) for one in entries):
        if name not in ("GRID", "GRDSET"):
            continue
        if system not in ("", "0"):
            raise ValueError(f"{name}: places are read in the basic coordinate system alone, not in {system}")
        if name == "GRDSET":
            continue
        if not number.isdecimal():
            raise ValueError(f"GRID in line {at}: '{number}' is no number of a node; write it again")
        if wrong := [part for part in X if part and not _REAL.fullmatch(part)]:
            raise ValueError(f"GRID {number} in line {at}: '{wrong[0]}' is no coordinate; write it again")
        place = [float("E".join(filter(None, one.groups()))) if (one := _REAL.match(part)) else 0.0 for part in X]
        first, before = known.setdefault(int(number), (at, place))
        if before != place:
            raise ValueError(f"GRID {number} is given twice, in line {first} and in line {at}; number each node once")
    places = np.array([place for _, place in known.values()], dtype=np.float64).reshape(-1, 3)
    return {number: at for at, number in enumerate(known)}, places
