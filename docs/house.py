"""Draws docs/pictures/house.svg, the rooms of the package and what each imports: `python3 docs/house.py`.

The arrows are those of the table in tests/test_architecture.py, less those that others imply, and those to the lowest row,
which all rooms may know; that test holds the table, and tests/test_documents.py the picture.
"""

import importlib.util
from pathlib import Path

DOCS = Path(__file__).parent
PICTURE = DOCS / "pictures" / "house.svg"
WIDTH, ROW, HIGH, GAP = 940, 86, 46, 14
GROUND = ["compat", "values", "units", "agreement", "timing", "types", "packages"]
# What is written beneath a name, lines of some 20 letters
KNOWS = {
    "__init__": "what users import",
    "__main__": "the check, the demos",
    "studies": "sweeps, charts, fits",
    "run": "solve()",
    "plans": "steppers of stages",
    "recording": "what each step leaves",
    "costs": "what cells, penalties cost",
    "result": "what a run gives",
    "restart": "checkpoints",
    "options": "the words of solve()",
    "scene": "the user's statements",
    "output": "columns, files, pictures",
    "mesh_io": "distributed meshes",
    "gmsh_model": "groups by name",
    "mesh_files": "Abaqus, Nastran, .vtu, STL",
    "solid": "energies, elements",
    "contact": "surfaces, partners, law",
    "solvers": "Newton, arc, verdicts",
    "assembly": "terms, System, supports",
    "meetings": "what lies on what",
    "folded": "cells inside out as drawn",
    "curved": "curved cells in one another",
    "kernels": "Numba: law, feet",
    "form_files": "what FFCx compiled",
    "compat": "dolfinx' versions",
    "values": "checked input",
    "units": "names of units",
    "agreement": "errors on all ranks",
    "uncaught": "how errors are printed",
    "timing": "seconds by stage",
    "types": "names of types",
    "packages": "what is missing",
}


def rooms():
    """{room: rooms that it may import} of the architecture test."""
    spec = importlib.util.spec_from_file_location("rooms", DOCS.parent / "tests" / "test_architecture.py")
    test = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(test)
    return {room: {other for other in may if other in test.TABLE} - set(GROUND) for room, may in test.TABLE.items()}


def beneath(table, room):
    """All that a room knows, through others too."""
    return table[room].union(*(beneath(table, other) for other in table[room]))


def storeys(table):
    """The rooms by storeys, from the ground up: each stands on the highest that it imports."""
    height = dict.fromkeys(GROUND, -1)

    def of(room):
        if room not in height:
            height[room] = 1 + max((of(other) for other in table[room]), default=-1)
        return height[room]

    top = max(map(of, table))
    return [[room for room in table if height[room] == storey] for storey in range(-1, top + 1)]


def picture():
    """The picture as a text."""
    table = rooms()
    floors = storeys(table)
    tall = ROW * len(floors)
    places = {}
    for storey, row in enumerate(floors):
        wide = min(170, (WIDTH - GAP) / len(row) - GAP)
        start = (WIDTH - len(row) * (wide + GAP) + GAP) / 2
        for i, room in enumerate(row):
            places[room] = (start + i * (wide + GAP), tall - (storey + 1) * ROW + (ROW - HIGH) / 2, wide)
    lines, boxes = [], []
    for room, (x, y, wide) in places.items():
        for other in sorted(table[room]):
            if any(other in beneath(table, third) for third in table[room] - {other}):
                continue
            x2, y2, wide2 = places[other]
            lines.append(
                f'<line x1="{x + wide / 2:.0f}" y1="{y + HIGH:.0f}" x2="{x2 + wide2 / 2:.0f}" y2="{y2 - 3:.0f}" '
                'stroke="#8a93a0" stroke-width="1.3" marker-end="url(#tip)"/>'
            )
        middle, knows = x + wide / 2, KNOWS.get(room, "")
        boxes.append(
            f'<rect x="{x:.0f}" y="{y:.0f}" width="{wide:.0f}" height="{HIGH}" rx="5" fill="#eef2f7" stroke="#4a6078"/>'
            f'<text x="{middle:.0f}" y="{y + 19:.0f}" font-size="14" font-weight="bold">{room}</text>'
            f'<text x="{middle:.0f}" y="{y + 36:.0f}" font-size="11">{knows}</text>'
        )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {tall}" font-family="sans-serif" '
        'text-anchor="middle">'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 L8 4 L0 8 z" fill="#8a93a0"/></marker></defs>'
        f'<rect width="{WIDTH}" height="{tall}" fill="white"/>'
    )
    return "\n".join([head, *lines, *boxes, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture())
