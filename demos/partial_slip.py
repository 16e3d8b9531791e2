"""The paper's element where it is right: slave nodes, each with its closest point, on a smooth master over a short way.

Two equal cylinders are pressed together and one of them is drawn sideways until the rim of their contact slips, while its
middle still sticks. The traction curves are those of Hertz, Cattaneo (1938) and Mindlin (1949; Johnson 1985, Contact
Mechanics, 7.2); Gauss points beside them for comparison. Plane strain, one layer of hexahedra. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/partial_slip.py   # --quick: fewer cells and the nodes alone, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Method, Output, Scene, Stage, from_elastic, read_gmsh, solve
from fenics_contact.meshes import two_cylinders

OUT = Path("results/partial_slip")
R, E, NU, FRICTION = 8.0, 200.0, 0.3, 0.2
STAR = E / (2 * (1 - NU**2))
DEPTH = 0.1  # mm, of the slice
DOWN, ALONG = 0.0074, 0.0011  # mm, of one axis towards and along the other: strains of 0.8 %, half the contact slips
FINE = 0.16  # mm, half the width of the zone of small cells
POINTS = {"nodes": "nodes (the paper)", 3: "3 x 3 Gauss points", "averages": "averages"}
COMM = MPI.COMM_WORLD


def press_and_draw(size, points):
    """(x [mm], pressure, friction [MPa]) of all points, by rows, forces P, Q per depth [N/mm], result, drawing."""
    mesh = read_gmsh(two_cylinders.build, radius=R, fine=FINE, depth=DEPTH, **size)
    scene = Scene(Body(mesh, "lower", from_elastic(E, NU)), Body(mesh, "upper", from_elastic(E, NU)))
    scene.fix("lower_axis")
    scene.fix("ends", "y")
    scene.fix("upper_axis", "xz")
    scene.contact("upper_rim", "lower_rim", FRICTION, points=points, name="rim")
    ways = {"press": ("z", -DOWN), "draw": ("x", ALONG)}
    stages = [Stage(name, prescribe={("upper_axis", axis): way}, steps=2) for name, (axis, way) in ways.items()]
    kept = Output(OUT / f"points_{points}", overwrite=True, progress=False)
    result = solve(scene, stages=stages, method=Method(linear="direct"), out=kept).require()
    contact = result.system.contact_terms[0]
    pressure, along = contact.forces.split_traction(result.system.state)
    rows = np.stack([contact.spots()[:, 0], pressure.ravel(), np.linalg.norm(along, axis=2).ravel()], axis=1)
    rows = np.concatenate(COMM.allgather(rows))
    last = result.history[-1]
    where = result.drawing("status")
    return rows[np.argsort(rows[:, 0])], last["rim_force_z_N"] / DEPTH, -last["rim_force_x_N"] / DEPTH, result, where


def exact(P, Q):
    """Half-width a of the contact, its largest pressure p0 and half-width c of what sticks, under forces P and Q."""
    a = np.sqrt(2 * P * R / (np.pi * STAR))
    return a, 2 * P / (np.pi * a), a * np.sqrt(1 - Q / (FRICTION * P))


def ellipse(x, half_width):
    return np.sqrt(np.maximum(1 - (x / half_width) ** 2, 0.0))


def tractions(x, a, p0, c):
    """Exact pressure and friction [MPa] at places x from the middle."""
    pressure = p0 * ellipse(x, a)
    return pressure, FRICTION * (pressure - p0 * c / a * ellipse(x, c))


def picture(found, path):
    figure = Figure(figsize=(6.3, 7), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[2.4, 1])
    axes, zoom = above.subplots(), below.subplots()
    axes.set_xlabel("place along the rim [mm]"), axes.set_ylabel("traction [MPa]")
    (rows, P, Q, _, cylinders), marks = found["nodes"], {"nodes": "o", 3: ".", "averages": "+"}
    a, p0, c = exact(P, Q)
    x = np.linspace(-1.1 * a, 1.1 * a, 801)
    for curve, label in zip(tractions(x, a, p0, c), ("pressure, exact", "friction, exact"), strict=True):
        axes.plot(x, curve, "k-" if "pressure" in label else "k--", linewidth=0.8, label=label)
    for points, (rows, *_) in found.items():
        near = np.abs(rows[:, 0]) < 1.3 * a
        for column, colour, name in ((1, "tab:blue", "pressure"), (2, "tab:red", "friction")):
            axes.plot(*rows[near][:, [0, column]].T, marks[points], color=colour, fillstyle="none", markersize=5,
                      label=f"{name}, {POINTS[points]}")  # fmt: skip
    axes.axvspan(-c, c, color="grey", alpha=0.15, label="sticks")
    axes.legend(fontsize=9, ncol=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    cylinders.draw(zoom).explain(zoom, 9)
    zoom.set_xlim(-1.3 * a, 1.3 * a), zoom.set_ylim(-0.4 * a, 0.4 * a)
    zoom.set_title("where the upper cylinder sticks and slips", fontsize=10)
    figure.savefig(path, dpi=150)


def main(quick=False):
    size = {"cells": 16, "outside": 7, "through": 12} if quick else {"cells": 36}
    found = {points: press_and_draw(size, points) for points in list(POINTS)[: 1 if quick else 3]}
    for points, (rows, P, Q, result, _) in found.items():
        a, p0, c = exact(P, Q)
        pressure, friction = tractions(rows[:, 0], a, p0, c)
        off = [np.sqrt(np.mean((mine - its)[np.abs(rows[:, 0]) < a] ** 2)) / p0 for mine, its in
               ((rows[:, 1], pressure), (rows[:, 2] / FRICTION, friction / FRICTION))]  # fmt: skip
        if COMM.rank == 0:
            print(f"{POINTS[points]}: P = {P:.4f}, Q = {Q:.4f} N/mm; half-width {a:.4f}, of what sticks {c:.4f} mm")
            print(f"    pressure off by {off[0]:.2%} of its top, friction by {off[1]:.2%} of it times μ (root mean square)")
            print(f"    largest pressure {rows[:, 1].max():.4f} MPa (exact {p0:.4f}), {result.verdict.iterations} tangents")
            np.savetxt(OUT / f"points_{points}" / "tractions.csv", rows, "%.9g", ",",
                       header="x_mm,pressure_MPa,friction_MPa", comments="")  # fmt: skip
    rows, P, Q, *_ = found["nodes"]
    (a, p0, c), cell = exact(P, Q), 2 * FINE / size["cells"]
    if COMM.rank == 0:
        picture(found, OUT / "partial_slip.png")
        print(f"picture: {OUT / 'partial_slip.png'}")
    # strains of 0.8 % are what the theory of half-spaces leaves out
    assert abs(rows[:, 1].max() / p0 - 1) < 0.01
    # no node within a cell of the border between stick and slip is judged
    spare, place = FRICTION * rows[:, 1] - rows[:, 2], np.abs(rows[:, 0])
    assert (spare[place < c - cell] > 0).all() and (np.abs(spare[place > c + cell]) < 1e-9 * p0).all()


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
