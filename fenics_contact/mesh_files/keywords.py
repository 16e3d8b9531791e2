"""An Abaqus input file: its nodes, elements, sets and surfaces, in order and as they are numbered there.

*NODE, *ELEMENT, *NSET, *ELSET, *SURFACE, *SOLID SECTION, *INCLUDE, one *PART with one *INSTANCE. What says nothing of the
mesh is passed over, what would place or make nodes is refused. Names are the same in capitals and in small letters.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.types import Floats, Ints64

# elements with as many nodes as the number in their name; an S at the front is a shell's
_NAMED = re.compile(r"(C3D|CPE|CPEG|CPS|CAX|CGAX|STRI|SFM3D|M3D|R3D|DS|S|T2D|T3D|R2D|RAX)(\d+)")
_LINES = {"B21": 2, "B31": 2, "B22": 3, "B32": 3}
_DIMENSION = {"C3D": 3} | dict.fromkeys(("T2D", "T3D", "R2D", "RAX"), 1)  # 2 for all others
# springs, masses and the like, which have no mesh
_PASSED = ("MASS", "ROTARYI", "SPRING", "DASHPOT", "CONN", "GAP", "DCOUP", "RNODE", "HEATCAP", "B33", "B23", "PIPE", "FRAME")
_PLACED = {"NGEN", "NCOPY", "NFILL", "NMAP", "ELGEN", "ELCOPY", "SYSTEM"}  # make or move nodes and elements
_FORTRAN = re.compile(r"[-+.\d]+[dD][-+]?\d+")  # a number with D for its exponent
_COMMA = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')  # one that parts entries: none within quotes
_LOOSE = {"ASSEMBLY": True, "INSTANCE": False, "END INSTANCE": True, "END ASSEMBLY": False}


_FILE = 1 << 32  # lines that a file may have


class Line(NamedTuple):
    """What stands there; at: the file, by the order in which they are read, times _FILE, plus the line's number."""

    text: str
    at: int


@dataclass(frozen=True)
class Elements:
    """Of one keyword: dim, type as in the file, numbers (n,), nodes' numbers (n, k) and the Line.at (n,) of each."""

    dim: int
    kind: str
    number: Ints64
    nodes: Ints64
    at: Ints64


@dataclass
class Sets:
    """{name: numbers (n,), each once and rising}; a name may be written in small letters or in capitals."""

    what: str
    found: dict[str, Ints64] = field(default_factory=dict)
    internal: set[str] = field(default_factory=set)  # written by Abaqus/CAE for itself
    named: dict[str, Ints64] = field(default_factory=dict)  # of each set the numbers that stand in the file one by one
    of_part: dict[str, str] = field(default_factory=dict)  # a part's set: its name once the assembly has one of this name

    def spelled(self, name: str) -> str:
        """The name as it was first written."""
        return next((known for known in self.found if known.upper() == name.upper()), name)

    def sought(self, name: str) -> str:
        """As it was first written, of a name that may have its instance's before it; ValueError: there is no such set."""
        for asked in (self.spelled(name), self.spelled(name.rpartition(".")[2])):
            if asked in self.found:
                return asked
        raise ValueError(f"there is no {self.what} '{name}'; the file has: {', '.join(self.found) or 'none'}")

    def get(self, name: str) -> Ints64:
        return self.found[self.sought(name)]

    def add(self, name: str, numbers: Ints64, named: Ints64 | None = None) -> None:
        """A set is one more time what it was and these; the assembly's is none of the part's."""
        name = self.spelled(name)
        if other := self.of_part.pop(name, None):
            for known in (self.found, self.named):
                if name in known:
                    known[other] = known.pop(name)
            if name in self.internal:
                self.internal = self.internal - {name} | {other}
        self.found[name] = np.union1d(self.found.get(name, numbers), numbers)
        if named is not None:
            self.named[name] = np.union1d(named, self.named.get(name, named))


@dataclass
class Model:
    """number (n,), places (n, 3) and Line.at (n,) of nodes, an array for each keyword; surfaces: {name: rows of (set
    or element, face)}; node_surfaces: {name: numbers}; combined: {name: (how, names of surfaces)}; stated: {surface's name
    in capitals: Line.at}; sections: names of the element sets with a *SOLID SECTION."""

    number: list[Ints64] = field(default_factory=list)
    places: list[Floats] = field(default_factory=list)
    at: list[Ints64] = field(default_factory=list)
    elements: list[Elements] = field(default_factory=list)
    passed: list[Ints64] = field(default_factory=list)  # numbers of elements that have no mesh
    nsets: Sets = field(default_factory=lambda: Sets("node set"))
    elsets: Sets = field(default_factory=lambda: Sets("element set"))
    surfaces: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    node_surfaces: dict[str, Ints64] = field(default_factory=dict)
    combined: dict[str, tuple[str, list[str]]] = field(default_factory=dict)
    stated: dict[str, int] = field(default_factory=dict)
    sections: list[str] = field(default_factory=list)
    parts: int = 0
    instances: int = 0
    instance: str = ""  # name of the last
    files: list[str] = field(default_factory=list)  # names, in the order in which they are read
    loose: bool = False  # the assembly's own nodes and elements are at hand: reference points, numbered for themselves

    def line(self, at: int) -> str:
        """A Line.at as an error says it."""
        return f"line {at % _FILE} of {self.files[at // _FILE]}"


def read(path: Path) -> Model:
    """The file's Model. Raises ValueError that names the keyword, and OSError where a file that it includes is missing."""
    model = Model()
    for keyword, parameters, at, data in _keywords(model, path):
        try:
            if keyword == "SURFACE":
                _surface(model, parameters, at, data)
            else:
                _take(model, keyword, parameters, data)
        except (KeyError, IndexError, ValueError) as error:
            said = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"*{keyword} in {model.line(at)}: {said}") from error
    for name, numbers in model.node_surfaces.items():
        if (twin := model.nsets.spelled(name)) in model.nsets.found and not np.array_equal(model.nsets.found[twin], numbers):
            raise ValueError(f"node set '{twin}' and surface '{name}' have different nodes; give one another name")
        model.nsets.found[twin] = numbers
    _refuse_twice(model, "*NODE", model.number, model.at)
    _refuse_twice(model, "*ELEMENT", [one.number for one in model.elements], [one.at for one in model.elements])
    return model


def _refuse_twice(model: Model, keyword: str, numbers: list[Ints64], at: list[Ints64]) -> None:
    """A number (n,) that two lines give."""
    number, line = (np.concatenate([np.empty(0, dtype=np.int64), *some]) for some in (numbers, at))
    order = np.argsort(number, kind="stable")
    again = np.flatnonzero(np.diff(number[order]) == 0)
    if len(again):
        twin = order[again[0] : again[0] + 2]
        first, second = (model.line(int(one)) for one in line[twin])
        raise ValueError(
            f"{keyword}: {len(again)} numbers are given twice, the first is {number[twin[0]]}, in {first} and in {second}; "
            "number each once"
        )


def _numbers(model: Model, entries: list[str], at: Ints64) -> Ints64:
    """Whole numbers (n,) of entries in the lines `at` (n,)."""
    try:
        return np.array(entries, dtype=np.int64)
    except (ValueError, OverflowError):
        _refuse_first(model, entries, at, np.int64, "no whole number")
        raise


def _refuse_first(model: Model, entries: list[str], at: Ints64, kind: Callable[[str], Any], wanted: str) -> None:
    """The first of the entries that is not of its kind."""
    for entry, line in zip(entries, at, strict=True):
        try:
            kind(entry)
        except (ValueError, OverflowError) as error:
            raise ValueError(f"'{entry.strip()}' in {model.line(int(line))} is {wanted}; write it again") from error


def _lines(model: Model, path: Path, within: tuple[Path, ...] = ()) -> Iterator[Line]:
    """Lines without comments and blank ones; another file's in the place where that is included, by the files `within`."""
    if path.resolve() in within:
        raise ValueError(f"*INCLUDE: {path.name} includes itself; take that line out")
    written = path.read_bytes()
    try:
        text = written.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = written.decode("latin-1")  # of older programs: names of sets with letters beyond ASCII
    model.files.append(path.name)
    first = (len(model.files) - 1) * _FILE + 1
    for at, line in enumerate((raw.strip() for raw in text.splitlines()), start=first):
        if line.startswith("**") or not line:
            continue
        other = re.search(r",\s*INPUT\s*=\s*\"?([^,\"]+)", line, re.IGNORECASE) if line.startswith("*") else None
        if not (other and line.upper().startswith("*INCLUDE")):
            yield Line(line, at)
        if other:
            yield from _lines(model, path.parent / other[1].strip(), (*within, path.resolve()))


def _entries(text: str) -> list[str]:
    """What commas part; names in quotes may have some of their own."""
    return [part.strip().strip('"') for part in (_COMMA.split(text) if '"' in text else text.split(","))]


def _keywords(model: Model, path: Path) -> Iterator[tuple[str, dict[str, str], int, list[Line]]]:
    """(keyword in capitals, {parameter in capitals: value}, its Line.at, lines of data)."""
    head, began = "", 0
    data: list[Line] = []
    for line in [*_lines(model, path), Line("*END", 0)]:
        if not line.text.startswith("*"):
            if head.endswith(",") and not data:
                head += line.text
            else:
                data.append(line)
            continue
        if head:
            keyword, *parameters = _entries(head[1:])
            pairs = (part.partition("=") for part in parameters if part)
            named = {k.strip().upper(): v.strip().strip('"') for k, _, v in pairs}
            yield " ".join(keyword.upper().split()), named, began, data
        (head, began), data = line, []


def _take(model: Model, keyword: str, parameters: dict[str, str], data: list[Line]) -> None:
    """What one keyword adds to the model."""
    if keyword in _PLACED:
        raise ValueError("nodes and elements that a keyword makes or moves are not read; have them written out")
    if keyword in _LOOSE:
        model.loose = _LOOSE[keyword]
    if model.loose and keyword in ("NODE", "ELEMENT"):
        return
    if keyword == "NODE":
        _nodes(model, parameters, data)
    elif keyword == "ELEMENT":
        _elements(model, parameters, data)
    elif keyword in ("NSET", "ELSET"):
        _set(model, keyword, parameters, data)
    elif keyword == "SOLID SECTION":
        model.sections.append(parameters["ELSET"])
    elif keyword == "END INSTANCE":
        _part_is_read(model)
    elif keyword in ("PART", "INSTANCE"):
        model.parts += keyword == "PART"
        model.instances += keyword == "INSTANCE"
        model.instance = parameters.get("NAME", "")
        if max(model.parts, model.instances) > 1 or (keyword == "INSTANCE" and data):
            raise ValueError(
                "several parts, or one that is moved, are not read; have the file written without parts "
                "(Abaqus/CAE: Model > Edit Attributes > Do not use parts and assemblies in input files)"
            )


def _part_is_read(model: Model) -> None:
    """What follows is the assembly's, whose sets may have the names of the part's; what the part said stays with its own."""
    for sets in (model.nsets, model.elsets):
        sets.of_part = {name: f"{model.instance}.{name}" for name in sets.found}
    model.sections = [f"{model.instance}.{name}" for name in model.sections]
    for name, rows in model.surfaces.items():
        model.surfaces[name] = [(own if own.isdigit() else f"{model.instance}.{own}", face) for own, face in rows]


def _nodes(model: Model, parameters: dict[str, str], data: list[Line]) -> None:
    if parameters.get("SYSTEM", "R").upper() != "R":
        raise ValueError("only Cartesian coordinates are read")
    rows = [(line.text + ",,,").split(",") for line in data]
    at = np.array([line.at for line in data], dtype=np.int64)
    numbers = _numbers(model, [row[0] for row in rows], at)
    X, lines = [part.strip() or "0" for row in rows for part in row[1:4]], np.repeat(at, 3)
    try:
        places = np.array(X, dtype=np.float64)
    except ValueError:
        X = [part.upper().replace("D", "E") if _FORTRAN.fullmatch(part) else part for part in X]
        _refuse_first(model, X, lines, np.float64, "no coordinate")
        places = np.array(X, dtype=np.float64)
    if len(wrong := np.flatnonzero(~np.isfinite(places))):
        raise ValueError(
            f"node {numbers[wrong[0] // 3]} in {model.line(int(lines[wrong[0]]))} has a coordinate that is no finite "
            "number; write it again"
        )
    model.number.append(numbers)
    model.places.append(places.reshape(-1, 3))
    model.at.append(at)
    if "NSET" in parameters:
        model.nsets.add(parameters["NSET"], numbers)


def _shape(kind: str) -> tuple[int, int]:
    """(dimension, number of nodes) of a type; (0, 0): it has no mesh."""
    if kind in _LINES:
        return 1, _LINES[kind]
    named = _NAMED.match(kind)
    if named is None and kind.startswith(_PASSED):
        return 0, 0
    if named is None:
        raise ValueError(
            f"elements of type {kind} are not known; have their bodies written with other elements, or take these lines out"
        )
    count = 6 if kind == "STRI65" else int(named[2])
    return _DIMENSION.get(named[1], 2), count


def _elements(model: Model, parameters: dict[str, str], data: list[Line]) -> None:
    kind = parameters["TYPE"].upper()
    dim, count = _shape(kind)
    if dim == 0:
        at = np.array([line.at for line in data], dtype=np.int64)
        model.passed.append(_numbers(model, [line.text.split(",")[0] for line in data], at))
        return
    parts = [[part for part in line.text.split(",") if part.strip()] for line in data]
    at = np.repeat(np.array([line.at for line in data], dtype=np.int64), [len(row) for row in parts])
    numbers = _numbers(model, [part for row in parts for part in row], at)
    if len(numbers) % (count + 1):
        raise ValueError(f"{len(numbers)} entries are not elements of type {kind}, a number and {count} nodes each")
    rows = numbers.reshape(-1, count + 1)
    model.elements.append(Elements(dim, kind, rows[:, 0], rows[:, 1:], at[:: count + 1]))
    if "ELSET" in parameters:
        model.elsets.add(parameters["ELSET"], rows[:, 0])


def _set(model: Model, keyword: str, parameters: dict[str, str], data: list[Line]) -> None:
    """*NSET and *ELSET: numbers, other sets, ranges; the nodes of an element set."""
    sets, name = (model.nsets if keyword == "NSET" else model.elsets), parameters[keyword]
    rows = [[part for part in _entries(line.text) if part] for line in data]
    if model.loose and "INSTANCE" not in parameters and any(part.isdigit() for row in rows for part in row):
        return
    found: list[Ints64] = [np.empty(0, dtype=np.int64)]
    named: Ints64 | None = None
    within = f"{parameters['INSTANCE']}." if "INSTANCE" in parameters else ""
    if "GENERATE" in parameters:
        for line, row in zip(data, rows, strict=True):
            if len(row) not in (2, 3):
                raise ValueError(f"'{name}', {model.line(line.at)}: GENERATE takes first, last and step, not '{line.text}'")
            first, last, by = (int(one) for one in _numbers(model, [*row, "1"][:3], np.full(3, line.at)))
            if by < 1 or last < first:
                raise ValueError(
                    f"'{name}', {model.line(line.at)}: GENERATE from {first} to {last} by {by} is no range; it rises, by 1 "
                    "or more"
                )
            found.append(np.arange(first, last + 1, by))
    else:
        parts = [part for row in rows for part in row]
        named = np.array([part for part in parts if part.isdigit()], dtype=np.int64)
        found.append(named)
        found += [sets.get(within + part) for part in parts if not part.isdigit()]
    if keyword == "NSET" and "ELSET" in parameters:
        of = model.elsets.get(within + parameters["ELSET"])
        found += [block.nodes[np.isin(block.number, of)].ravel() for block in model.elements]
    sets.add(name, np.unique(np.concatenate(found)), named)
    if "INTERNAL" in parameters:
        sets.internal.add(sets.spelled(name))


def _surface(model: Model, parameters: dict[str, str], at: int, data: list[Line]) -> None:
    """*SURFACE of faces of elements, of nodes or of other surfaces; those of other types are drawn, not meshed."""
    if "INTERNAL" in parameters:
        return
    kind, name = parameters.get("TYPE", "ELEMENT").upper(), parameters["NAME"]
    if (first := model.stated.setdefault(name.upper(), at)) != at:
        raise ValueError(f"there is a surface '{name}' already, in {model.line(first)}; give one another name")
    rows = [_entries(line.text) for line in data]
    if "CROP" in parameters:
        raise ValueError(f"'{name}': a surface that is cropped by a box is not read; have its faces written")
    if "COMBINE" in parameters:
        model.combined[name] = parameters["COMBINE"].upper(), [part for row in rows for part in row if part]
    elif kind == "ELEMENT":
        model.surfaces[name] = [(row[0], row[1].upper() if len(row) > 1 else "") for row in rows]
    elif kind == "NODE":
        found = [np.array([row[0]], dtype=np.int64) if row[0].isdigit() else model.nsets.get(row[0]) for row in rows]
        model.node_surfaces[name] = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *found]))
