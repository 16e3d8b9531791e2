"""Patch test: two stacked rubber blocks with meshes that do not match are squeezed by 10 % without friction.

Both blocks are then in one homogeneous state whose force has a closed form. Averages and corners against Gauss points of the
slave's facets, and the error's fall with the penalty. Units: mm, N, MPa.

    python3 demos/stacked_blocks.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Output, Scene, mooney_rivlin, read_gmsh, solve
from fenics_contact.meshes import two_blocks

OUT = Path("results/stacked_blocks")
A1, A2, K = 0.1863, 0.0098, 5.0
SIDE, SQUEEZE = 20.0, 0.1
PENALTIES = np.array([10.0, 100.0, 1000.0])  # MPa/mm
POINTS = {"averages": "averages", "corners": "facets' corners", 2: "2 x 2 Gauss points", 3: "3 x 3 Gauss points"}


def exact_force():
    """Uniaxial compression of a compressible Mooney-Rivlin solid: its lateral stretch b leaves no lateral stress."""

    def stresses(stretch, b):
        J = stretch * b * b
        axial, lateral = (np.array([stretch, b]) * J ** (-1 / 3)) ** 2  # eigenvalues of B^
        first, second = axial + 2 * lateral, 2 * axial * lateral + lateral**2
        tau = [
            2 * A1 * (e - first / 3) + 2 * A2 * (first * e - e * e - 2 * second / 3) + K * J * (J - 1)
            for e in (axial, lateral)
        ]
        return tau[0] / stretch, tau[1] / b

    low, high = 1.0, 1.2
    for _ in range(60):  # bisection to round-off
        b = 0.5 * (low + high)
        low, high = (b, high) if stresses(1 - SQUEEZE, b)[1] < 0 else (low, b)
    return -stresses(1 - SQUEEZE, b)[0] * SIDE**2


def squeeze(mesh, points, penalty):
    """Force [N], half of what the pressure at the points scatters [MPa, per reference area], and the result."""
    rubber = mooney_rivlin(a1=A1, a2=A2, K=K)
    scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber))
    for body in ("lower", "upper"):
        scene.fix(f"{body}_xmin", "x")
        scene.fix(f"{body}_ymin", "y")
    scene.fix("lower_bottom", "z")
    scene.prescribe("upper_top", "z", -2 * 10.0 * SQUEEZE)
    scene.contact("upper_bottom", "lower_top", penalty=penalty, points=points, name="interface")
    result = solve(scene, steps=2, out=Output(progress=False)).require()
    pressure, _ = result.system.contact_terms[0].forces.split_traction(result.system.state)
    lowest = mesh.comm.allreduce(pressure.min(initial=np.inf), op=MPI.MIN)
    highest = mesh.comm.allreduce(pressure.max(initial=0.0), op=MPI.MAX)
    return result.history[-1]["interface_force_z_N"], (highest - lowest) / 2, result


def main():
    size = {"lower": (SIDE, SIDE, 10.0), "upper": (SIDE, SIDE, 10.0)}
    origin = {"lower_origin": (0.0, 0.0, -10.0), "upper_origin": (0.0, 0.0, 0.0)}
    mesh = read_gmsh(two_blocks.build, **size, **origin, lower_cells=(3, 3, 2), upper_cells=(5, 5, 2))
    exact = exact_force()
    root = MPI.COMM_WORLD.rank == 0
    figure = Figure(figsize=(6.3, 7), layout="constrained")
    bodies, axes = figure.subplots(2, 1)
    for points, label in POINTS.items():
        forces, scatter, results = zip(*(squeeze(mesh, points, penalty) for penalty in PENALTIES), strict=True)
        errors = np.abs(np.array(forces) / exact - 1)
        axes.loglog(PENALTIES, errors, marker="o", label=label)
        if root:
            shares = ", ".join(f"{e:.1e}" for e in errors)
            share = scatter[-1] * SIDE**2 / exact
            print(f"{label:20} force errors {shares} at {PENALTIES} MPa/mm; scatter of pressure {share:.1%}")
    drawing = results[-1].drawing("contact_pressure", mirror="xy")
    if root:
        axes.set_xlabel("penalty [MPa/mm]")
        axes.set_ylabel("relative error of the force")
        axes.legend()
        drawing.draw(bodies).explain(bodies, 9, shrink=0.8)
        bodies.set_title(f"{label}, {PENALTIES[-1]:g} MPa/mm, seen from below", fontsize=10)
        OUT.mkdir(parents=True, exist_ok=True)
        figure.savefig(OUT / "stacked_blocks.png", dpi=150)
        print(f"exact force {exact:.6f} N; picture: {OUT / 'stacked_blocks.png'}")
    # 3 x 3 Gauss points at the largest penalty: compliance 7e-5 of the force, integration error below it
    assert errors[-1] < 1e-4


if __name__ == "__main__":
    main()
