"""A Nastran bulk data file, read by gmsh: volumes and surfaces are named by their properties, pid_1, pid_2, ..."""

import re
from collections import Counter
from pathlib import Path

import gmsh

SOLIDS = "for a body have its solid elements written (CHEXA or CTETRA)"
_ELEMENT = re.compile(r"CTETRA|CHEXA|CPENTA|CPYRAM?|C(TRI|TRA|QUAD)\w*")


_ENTRY = re.compile(r"(?!CEND|CORD)C[A-Z]{2,}\d?\w*|GRID|RBE\d|PLOTEL")  # nodes and elements of any kind


def read_bdf(path: str) -> None:
    """What gmsh would pass over in silence is refused: other coordinate systems, elements that it does not know."""
    cards: Counter[str] = Counter()
    for line in Path(path).read_text(errors="replace").splitlines():
        card = (line.split(",")[0] if "," in line else line[:8]).strip().upper()
        name, large = card.removesuffix("*"), card.endswith("*")
        if name in ("GRID", "GRDSET"):
            system = line.split(",")[2:3] if "," in line else [line[24:40] if large else line[16:24]]
            if system and system[0].strip() not in ("", "0"):
                raise ValueError(f"{name}: places are read in the basic coordinate system alone, not in {system[0].strip()}")
        cards[name] += 1
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
