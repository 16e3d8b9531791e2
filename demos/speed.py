"""Speed as ratios taken in one run: contact against bulk, rate-form tangent against the energy's, two ranks against one.

FElupe from PyPI with pypardiso is timed beside it where it is installed; nothing else needs it. Writes
results/speed.json and prints a table.

    python3 demos/speed.py
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import Body, Scene, compat, mooney_rivlin, read_gmsh, rigid_punch, solve
from fenics_contact import virtual_power as vp
from meshes import punch_plate

RUBBER = {"a1": 0.1863, "a2": 0.0098, "K": 5.0}
SIZES = {"20x20x5": (10, 10, 5), "40x40x10": (20, 20, 10)}


def punch(cells, steps, friction, linear):
    """The punch scene on a uniform mesh; returns the summary's seconds and the number of tangent solves."""
    mesh = read_gmsh(punch_plate.build, inside=cells[0], outside=cells[1], layers=cells[2], ratio=1.0)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(**RUBBER)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("bottom", "z")
    tool = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", tool, friction, name="top")
    start = time.perf_counter()
    result = solve(scene, move={tool: (0, 0, -0.2 * steps)}, steps=steps, linear=linear, progress=False)
    return {"wall": time.perf_counter() - start, "iterations": result.verdict.iterations, **result.summary["seconds"]}


def tangent_forms(repeats=5):
    """Median assembly times of the rate form and of the second derivative of the energy, same flags and quadrature."""
    mesh = read_gmsh(punch_plate.build, inside=20, outside=20, layers=10, ratio=1.0)
    material = mooney_rivlin(**RUBBER)
    scene = Scene(Body(mesh, "plate", material))
    u = compat.Function(scene.space)
    u.x.array[:] = 0.01 * np.random.default_rng(1).random(len(u.x.array))
    v, du, dx = ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space), scene.dx(scene.bodies[0])
    F = vp.deformation_gradient(u)
    J = ufl.det(F)
    B = J ** (-2 / 3) * ufl.dot(F, F.T)
    energy = material.psi(ufl.tr(B), ufl.tr(ufl.dot(B, B)), J) * dx
    times = {}
    for name, form in (
        ("rate", vp.stress_power_rate(material, u, du, v, dx)),
        ("energy", ufl.derivative(ufl.derivative(energy, u, v), u, du)),
    ):
        compiled = compat.compile_form(form)
        matrix = compat.create_matrix(compiled)
        samples = []
        for _ in range(repeats):
            matrix.zeroEntries()
            start = time.perf_counter()
            compat.assemble_matrix(matrix, compiled)
            matrix.assemble()
            samples.append(time.perf_counter() - start)
        times[name] = float(np.median(samples))
    return times


def felupe_seconds_per_iteration(cells, steps=5):
    """The parity scene in FElupe (neo-Hooke, its cheapest law), or None where it is not installed."""
    try:
        import felupe as fem
        from pypardiso import spsolve
    except ImportError:
        return None
    mesh = fem.Cube(b=(40, 40, 10), n=tuple(n + 1 for n in (2 * cells[0], 2 * cells[1], cells[2])))
    field = fem.FieldContainer([fem.Field(fem.RegionHexahedron(mesh), dim=3)])
    solid = fem.SolidBody(fem.NeoHooke(mu=2 * (RUBBER["a1"] + RUBBER["a2"]), bulk=RUBBER["K"]), field)
    x, y, z = mesh.points.T
    bounds = {
        "x": fem.Boundary(field[0], fx=0, skip=(0, 1, 1)),
        "y": fem.Boundary(field[0], fy=0, skip=(1, 0, 1)),
        "z": fem.Boundary(field[0], fz=0, skip=(1, 1, 0)),
        "tool": fem.Boundary(field[0], mask=(z > 9.99) & (x < 20.01) & (y < 20.01), skip=(1, 1, 0)),
    }
    iterations, start = 0, time.perf_counter()
    for step in range(1, steps + 1):
        bounds["tool"].update(-0.2 * step)
        dof0, dof1 = fem.dof.partition(field, bounds)
        ext0 = fem.dof.apply(field, bounds, dof0)
        newton = fem.newtonraphson(items=[solid], dof0=dof0, dof1=dof1, ext0=ext0, verbose=0, solver=spsolve, tol=1e-8)
        iterations += newton.iterations
    return (time.perf_counter() - start) / iterations


def on_ranks(ranks):
    """The frictional 40x40x10 scene with the iterative solver under mpirun; its seconds."""
    command = ["mpirun", "-n", str(ranks), sys.executable, __file__, "--measure"]
    # a copy of the environment from before MPI started here: mpirun does not nest
    out = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ.copy()).stdout
    return json.loads(out.splitlines()[-1])


def share(seconds, *starts):
    return sum(value for name, value in seconds.items() if name.startswith(starts))


def main():
    rows, forms = [], tangent_forms()
    rows.append(("rate-form tangent / energy's second derivative", forms["rate"] / forms["energy"], "<= 0.6"))
    for name, cells in SIZES.items():
        linear = "direct" if name == "20x20x5" else "iterative"
        ours = punch(cells, 5, 0.0, linear)
        peer = felupe_seconds_per_iteration(cells)
        if peer is not None:
            newton = share(ours, "residual", "tangent", "factorisation", "linear solve") / ours["iterations"]
            rows.append((f"seconds per iteration, {name}, ours / FElupe", newton / peer, "<= 0.33"))
    one, two = on_ranks(1), on_ranks(2)
    bulk, contact = share(one, "tangent: solid"), share(one, "tangent: top", "residual: top")
    rows.append(("contact / bulk tangent, 40x40x10, friction", contact / bulk, "<= 0.05"))
    known = share(one, "tangent: solid", "factorisation", "linear solve")
    rows.append(("neither linear solve nor bulk tangent / run", 1 - known / one["wall"], "<= 0.10"))
    per = [share(s, "tangent", "residual") / s["iterations"] for s in (one, two)]
    rows.append(("assembly and contact, 1 rank / 2 ranks", per[0] / per[1], ">= 1.7"))
    whole = [s["wall"] / s["iterations"] for s in (one, two)]
    rows.append(("whole run, 1 rank / 2 ranks", whole[0] / whole[1], ">= 1.4"))
    rows.append(("Newton iterations per step, friction 0.3", one["iterations"] / 5, "<= 5"))

    Path("results").mkdir(exist_ok=True)
    Path("results/speed.json").write_text(json.dumps({"table": rows, "one rank": one, "two ranks": two}, indent=2))
    for what, value, target in rows:
        print(f"{what:52} {value:6.2f}   target {target}")


if __name__ == "__main__":
    if "--measure" in sys.argv:
        seconds = punch(SIZES["40x40x10"], 5, 0.3, "iterative")
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(seconds))
    else:
        main()
