"""FElupe in a race: `python3 -m fenics_contact.studies.peers.felupe_plate parity CELLS LAYERS`; it has no contact."""

import importlib
import json
import sys
import time
from typing import Any

from fenics_contact.studies.peers.plate import A1, A2, HALF, HEIGHT, SIDE, STEPS, TRAVEL, K


def run(cells: int, layers: int) -> dict[str, float]:
    """The force on the plate [N], unknowns, tangents and seconds of the parity scene, by Intel's PARDISO; in the material
    that is cheapest for FElupe, neo-Hooke of the same moduli."""
    wall, cpu = time.perf_counter(), time.process_time()
    felupe: Any = importlib.import_module("felupe")
    spsolve = importlib.import_module("pypardiso").spsolve
    mesh = felupe.Cube(b=(SIDE, SIDE, HEIGHT), n=(2 * cells + 1, 2 * cells + 1, layers + 1))
    field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(mesh), dim=3)])
    solid = felupe.SolidBody(felupe.NeoHooke(mu=2 * (A1 + A2), bulk=K), field)
    x, y, z = mesh.points.T
    under = (z > HEIGHT - 0.01) & (x < HALF + 0.01) & (y < HALF + 0.01)
    bounds = {
        "x": felupe.Boundary(field[0], fx=0, skip=(0, 1, 1)),
        "y": felupe.Boundary(field[0], fy=0, skip=(1, 0, 1)),
        "z": felupe.Boundary(field[0], fz=0, skip=(1, 1, 0)),
        "tool": felupe.Boundary(field[0], mask=under, skip=(1, 1, 0)),
    }
    solved: Any = None
    tangents = 0
    for step in range(1, STEPS["parity"] + 1):
        bounds["tool"].update(-TRAVEL * step)
        dof0, dof1 = felupe.dof.partition(field, bounds)
        given = felupe.dof.apply(field, bounds, dof0)
        solved = felupe.newtonraphson(items=[solid], dof0=dof0, dof1=dof1, ext0=given, verbose=0, solver=spsolve, tol=1e-8)
        tangents += solved.iterations
    force = felupe.tools.force(field, solved.fun, bounds["tool"])[2]
    return {
        "force_N": abs(float(force)), "unknowns": mesh.points.size, "tangents": tangents,
        "cpu_s": time.process_time() - cpu, "wall_s": time.perf_counter() - wall,
    }  # fmt: skip


if __name__ == "__main__":
    sys.stdout.write(f"{json.dumps(run(int(sys.argv[2]), int(sys.argv[3])))}\n")
