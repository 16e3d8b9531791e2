"""A slender column under a dead load buckles at Euler's load, without a bias, and bends along the elastica.

Arc length finds the bifurcation by the tangent's negative pivots, lands on it and leaves the straight column along the null
vector. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/buckling.py   # --quick: half the cells, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import ArcSteps, Body, Branch, Displacement, Output, Scene, from_elastic, read_gmsh, solve
from fenics_contact.meshes import box

OUT = Path("results/buckling")
LONG, E = 20.0, 1000.0  # of a column 1 mm thick, Poisson's ratio 0, clamped at its foot
EULER = np.pi**2 * E / 12 / (4 * LONG**2)  # N
SIDEWAYS = 4.0  # mm, of the head


def buckle(quick):
    mesh = read_gmsh(box.build, size=(1.0, 1.0, LONG), cells=(1, 1, 8 if quick else 16))
    scene = Scene(Body(mesh, "box", from_elastic(E, 0.0)), degree=2)
    scene.fix("zmin")
    scene.fix("ymin", "y")
    scene.traction("zmax", (0, 0, -EULER))  # t counts in Euler's loads
    steps = ArcSteps(until=Displacement("zmax", "x", SIDEWAYS), first=0.3, largest=0.4, branch=Branch("zmax", "x"))
    seen = {"head": lambda view: view.at("zmax").displacement[0]}
    return solve(scene, steps=steps, record=seen, out=Output(OUT, overwrite=True)).require()


def main(quick=False):
    result = buckle(quick)
    load, head = result.column("t"), result.column("head")
    critical = load[result.column("bifurcation") == 1][0]
    column = result.drawing("displacement")
    if MPI.COMM_WORLD.rank == 0:
        picture = Figure(figsize=(6.3, 4.0), layout="constrained")
        axes, body = picture.subplots(1, 2)
        axes.plot(head, load, marker="o", markersize=3, label="computed")
        turn = np.linspace(0, np.pi * SIDEWAYS / (2 * LONG))
        axes.plot(2 * LONG * turn / np.pi, critical * (1 + turn**2 / 8), color="grey", label="elastica, 1 + θ²/8")
        axes.set_xlabel("head sideways [mm]"), axes.set_ylabel("load over Euler's"), axes.legend(), axes.set_ylim(0.9, None)
        column.draw(body).explain(body, 9, shrink=0.8)
        picture.savefig(OUT / "buckling.png", dpi=150)
        print(f"buckles at {critical:.5f} of Euler's load {EULER:.4f} N; picture: {OUT / 'buckling.png'}")
    # shear takes P / (5/6 G A) = 1.2e-3 off, shortening by P / (E A) = 5e-4 adds; coarse cells add 1.2e-3
    assert abs(critical - 1) < (3e-3 if quick else 2e-3)


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
