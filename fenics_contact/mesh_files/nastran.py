"""A Nastran bulk data file, read by gmsh: volumes and surfaces are named by their properties, pid_1, pid_2, ..."""

import re
from collections import Counter
from pathlib import Path

import gmsh

SOLIDS = "for a body have its solid elements written (CHEXA or CTETRA)"
_ELEMENT = re.compile(r"CTETRA|CHEXA|CPENTA|CPYRAM?|C(TRI|TRA|QUAD)\w*")
_ENTRY = re.compile(r"(?!CEND|CORD)C[A-Z]{2,}\d?\w*|GRID|RBE\d|PLOTEL")  # nodes and elements of any kind
_REAL = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))(?:(?:[ED]|(?=[-+]))([-+]?\d+))?")  # 1.5-3 is 0.0015


def read_bdf(path: str) -> None:
    """What gmsh would pass over in silence is refused: other coordinate systems, elements that it does not know, text in
    the place of a coordinate, and a node that is given twice."""
    lines = [line.partition("$")[0] for line in Path(path).read_text(errors="replace").splitlines()]  # without comments
    names = [(line.split(",")[0] if "," in line else line[:8]).strip().upper() for line in lines]
    _check_nodes(lines, names)
    cards = Counter(name.removesuffix("*") for name in names)
    wanted = sum(count for name, count in cards.items() if _ELEMENT.fullmatch(name))
    if not wanted:
        held = ", ".join(f"{count} {name}" for name, count in cards.items() if _ENTRY.fullmatch(name))
        raise ValueError(
            f"it holds {held or 'nothing of a mesh'}, and no cells; {SOLIDS}, for a tool its facets (CQUAD4, CTRIA3)"
        )
    gmsh.open(path)
    found = sum(len(tags) for dim in (3, 2) for tags in gmsh.model.mesh.getElements(dim)[1])
    if found != wanted:
        raise ValueError(f"gmsh understands {found} of its {wanted} elements; write CHEXA, CTETRA, CQUAD4 and CTRIA3")
    dim = 3 if gmsh.model.getEntities(3) else 2
    for d, entity in gmsh.model.getEntities():
        if d in (dim, dim - 1):
            gmsh.model.setPhysicalName(d, gmsh.model.addPhysicalGroup(d, [entity]), f"pid_{entity}")


def _check_nodes(lines: list[str], names: list[str]) -> None:
    known: dict[str, tuple[int, list[float]]] = {}  # by number: the line and the place
    for at, (line, name) in enumerate(zip(lines, names, strict=True), start=1):
        if name not in ("GRID", "GRID*", "GRDSET", "GRDSET*"):
            continue
        number, system, *X = _fields(line, lines[at] if at < len(lines) else "", name.endswith("*"))
        if system not in ("", "0"):
            raise ValueError(f"{name}: places are read in the basic coordinate system alone, not in {system}")
        if name.startswith("GRDSET"):
            continue
        if wrong := [part for part in X if part and not _REAL.fullmatch(part)]:
            raise ValueError(f"GRID {number} in line {at}: '{wrong[0]}' is no coordinate; write it again")
        place = [float("E".join(filter(None, one.groups()))) if (one := _REAL.match(part)) else 0.0 for part in X]
        first, before = known.setdefault(number, (at, place))
        if before != place:
            raise ValueError(f"GRID {number} is given twice, in line {first} and in line {at}; number each node once")


def _fields(line: str, more: str, large: bool) -> list[str]:
    """The first five of a node: number, system, three coordinates; more: the line after a large one, with the last."""
    if "," in line:
        first, second = (one.split(",") for one in (line, more))
        fields = first[1:5] + second[1:2] if large else first[1:6]
    elif large:
        fields = [line[i : i + 16] for i in range(8, 72, 16)] + [more[8:24]]
    else:
        fields = [line[i : i + 8] for i in range(8, 48, 8)]
    return [field.strip().upper() for field in (fields + [""] * 5)[:5]]
