"""CalculiX in a race: `python3 -m fenics_contact.studies.peers.calculix SCENE CELLS LAYERS` writes a deck and runs `ccx`."""

import json
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fenics_contact.studies.peers.plate import A1, A2, FRICTION, HALF, HEIGHT, SIDE, STEPS, TRAVEL, K
from fenics_contact.types import Array

STIFFNESS = 100.0  # of the contact, times Young's modulus over the plate's cell [pressure / length]


def deck(scene: str, cells: int, layers: int) -> str:
    """CalculiX's input of a scene of plate.py: hexahedra of full integration, fixed increments, its default solver."""
    ends = (np.linspace(0.0, SIDE, 2 * cells + 1),) * 2 + (np.linspace(0.0, HEIGHT, layers + 1),)
    points, elements = _grid(ends)
    x, y, z = points.T
    under = (z > HEIGHT - 1e-6) & (x < HALF + 1e-6) & (y < HALF + 1e-6)
    sets = {"SX": x < 1e-6, "SY": y < 1e-6, "SZ": z < 1e-6, "UNDER": under}
    lines = ["*NODE, NSET=ALL", *_rows(points)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=PLATE", *_rows(elements + 1)]
    for name, members in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{node + 1}," for node in np.flatnonzero(members))]
    # its energy has (J - 1)^2 / D1, ours K / 2 (J - 1)^2
    lines += ["*MATERIAL, NAME=RUBBER", "*HYPERELASTIC, MOONEY-RIVLIN"]
    lines += [f"{A1}, {A2}, {2.0 / K}", "*SOLID SECTION, ELSET=PLATE, MATERIAL=RUBBER"]
    lines += ["*BOUNDARY", "SX, 1, 1", "SY, 2, 2", "SZ, 3, 3"]
    moved, summed, steps = "UNDER", "UNDER", STEPS[scene]
    if scene != "parity":
        lines += _punch(scene, cells, len(points), elements, z[elements].max(axis=1) > HEIGHT - 1e-6)
        moved, summed = "PUNCH", "SZ"
    lines += ["*STEP, NLGEOM, INC=1000", "*STATIC, DIRECT", f"{1.0 / steps}, 1.0"]
    lines += ["*BOUNDARY", f"{moved}, 3, 3, {-TRAVEL * steps}"]
    lines += [f"*NODE PRINT, NSET={summed}, TOTALS=ONLY", "RF", "*END STEP"]
    return "\n".join(lines) + "\n"


def _grid(ends: Sequence[Array]) -> tuple[Array, Array]:
    """Nodes (n, 3) and hexahedra (m, 8) of a box, in CalculiX's order."""
    p, q, r = (len(one) - 1 for one in ends)
    points = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(p + 1, q + 1, r + 1)
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = [number[i : i + p, j : j + q, k : k + r].ravel() for k in (0, 1) for i, j in square]
    return points, np.stack(corners, axis=1)


def _punch(scene: str, cells: int, nodes: int, elements: Array, on_top: Array) -> list[str]:
    """A punch of one stiff element all of whose nodes are led, and the contact of the plate's top with its face."""
    points, (corners,) = _grid([np.array(ends) for ends in ((0.0, HALF), (0.0, HALF), (HEIGHT, 2 * HEIGHT))])
    stiffness = STIFFNESS * 6.0 * (A1 + A2) / (HALF / cells)
    lines = ["*NODE, NSET=PUNCH", *_rows(points, nodes)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=TOOL", *_rows(corners[None] + nodes + 1, len(elements))]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "1000.0, 0.3", "*SOLID SECTION, ELSET=TOOL, MATERIAL=STEEL"]
    lines += ["*SURFACE, NAME=FACE", f"{len(elements) + 1}, S1", "*SURFACE, NAME=TOP"]
    lines += [f"{element + 1}, S2" for element in np.flatnonzero(on_top)]
    lines += ["*SURFACE INTERACTION, NAME=CONTACT", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{stiffness}"]
    if FRICTION[scene] > 0.0:
        lines += ["*FRICTION", f"{FRICTION[scene]}, {0.1 * stiffness}"]
    return [*lines, "*CONTACT PAIR, INTERACTION=CONTACT, TYPE=SURFACE TO SURFACE", "TOP, FACE", "*BOUNDARY", "PUNCH, 1, 2"]


def _rows(values: Array, start: int = 0) -> list[str]:
    return [", ".join(map(str, (start + i + 1, *row))) for i, row in enumerate(values.tolist())]


def run(scene: str, cells: int, layers: int) -> dict[str, float]:
    """The force on the plate [N], unknowns, tangents, and the seconds of CalculiX alone. RuntimeError where it gives up."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "deck.inp").write_text(deck(scene, cells, layers))
        start = time.perf_counter()
        done = subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, text=True)
        wall, used = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        totals = re.findall(r"total force.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", (Path(folder) / "deck.dat").read_text())
    if "Job finished" not in done.stdout or len(totals) < STEPS[scene]:
        raise RuntimeError(f"CalculiX gave up: {done.stdout[-500:]}")
    tangents = len(re.findall(r"^ *iteration +\d+", done.stdout, re.MULTILINE))
    return {
        "force_N": abs(float(totals[-1][2])), "unknowns": 3 * (2 * cells + 1) ** 2 * (layers + 1), "tangents": tangents,
        "cpu_s": used.ru_utime + used.ru_stime, "wall_s": wall,
    }  # fmt: skip


if __name__ == "__main__":
    sys.stdout.write(f"{json.dumps(run(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))}\n")
