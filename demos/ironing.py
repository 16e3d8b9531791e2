"""Shallow ironing: a stiff round indenter is pressed into a softer block, drawn along it with friction, and lifted.

The scene of Fischer & Wriggers (2006, Comput. Methods Appl. Mech. Engrg. 195, 5020), repeated by later papers whose
forces scatter; plane strain, the block's surface is the slave. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/ironing.py   # --quick: a shorter block, drawn by 0.5 mm, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Film, Output, Scene, Stage, from_elastic, read_gmsh, solve
from fenics_contact.meshes import ironing

OUT = Path("results/ironing")
BLOCK, INDENTER, NU, FRICTION = 689.6, 6896.0, 0.32, 0.3  # Young's moduli [MPa]
PRESS, DRAW = 1.0, 10.0  # mm
VERTICAL, RATIO = (335.0, 420.0), (0.30, 0.53)  # published plateaus of V [N/mm] and of H/V
# while the indenter's middle (x = 0.8 mm at first) is more than the block's height, 4 mm, away from both its ends
PLATEAU = (1.32, 1.72)


# the same cells on two thirds of the block, from its middle on
QUICK = {"length": 8.0, "foundation": (32, 8), "left": 3.4}
SHORT = 0.5  # mm


def iron(quick):
    """Result, and drawings of all steps."""
    mesh, way = read_gmsh(ironing.build, **(QUICK if quick else {})), SHORT if quick else DRAW
    bodies = Body(mesh, "foundation", from_elastic(BLOCK, NU)), Body(mesh, "indenter", from_elastic(INDENTER, NU))
    scene = Scene(*bodies, plane="strain", thickness=1.0)
    scene.fix("foundation_bottom")
    scene.fix("indenter_top")
    scene.contact("foundation_top", ("indenter_under", "indenter_flanks"), friction=FRICTION, name="interface")
    film = Film("contact_pressure")
    stages = [
        Stage("press", prescribe={("indenter_top", "y"): -PRESS}, steps=10),
        Stage("draw", prescribe={("indenter_top", "x"): way}, steps=round(80 * way / DRAW)),
        Stage("lift", prescribe={("indenter_top", "y"): PRESS}, steps=5 if quick else 10),
    ]
    result = solve(scene, stages=stages, out=Output(OUT, overwrite=True, progress=False), record={"frame": film}).require()
    return result, film


def figure(time, vertical, horizontal, bodies):
    picture = Figure(figsize=(6.3, 8.5), layout="constrained")
    axes, drawn_part, slice_ = picture.subplots(3, 1, height_ratios=[1, 1, 1.3])
    axes.plot(time, vertical, label="vertical"), axes.plot(time, horizontal, label="horizontal")
    axes.fill_between((1, 2), *VERTICAL, color="tab:blue", alpha=0.15, label="published plateaus, vertical")
    axes.set_xlabel("time: 1 pressed, 2 drawn, 3 lifted"), axes.set_ylabel("force per depth [N/mm]")
    axes.legend(ncol=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9)
    axes, drawn = drawn_part, (time > 1.0) & (time <= 2.0)
    axes.plot(time[drawn], horizontal[drawn] / vertical[drawn], color="tab:red")
    axes.fill_between((1, 2), *RATIO, color="tab:red", alpha=0.15, label="published plateaus")
    axes.axvspan(*PLATEAU, color="grey", alpha=0.15, label="a block's height from both ends")
    axes.set_xlabel("time"), axes.set_ylabel("horizontal over vertical")
    axes.legend(ncol=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9)
    bodies.draw(slice_).explain(slice_, 9, location="bottom", aspect=40)
    slice_.set_title("half-way, at time 1.5; pressure also as the height of the band", fontsize=10)
    picture.savefig(OUT / "ironing.png", dpi=150)


def main(quick=False):
    result, film = iron(quick)
    time = result.column("t")
    vertical, horizontal = -result.column("interface_force_y_N"), result.column("interface_force_x_N")  # of 1 mm
    plateau = (time > PLATEAU[0]) & (time < PLATEAU[1])
    if quick:
        plateau = (time > 1.6) & (time < 2.01)
    V, ratio = vertical[plateau], horizontal[plateau] / vertical[plateau]
    ripple = np.ptp(V) / V.mean()
    if MPI.COMM_WORLD.rank == 0:
        figure(time, vertical, horizontal, film.drawings[np.argmin(np.abs(time - 1.5))])
        print(f"vertical force {V.min():.1f} to {V.max():.1f} N/mm (published {VERTICAL}), ripple {ripple:.2%}")
        print(f"horizontal over vertical {ratio.mean():.3f}, {ratio.min():.3f} to {ratio.max():.3f} (published {RATIO})")
        print(f"lifted: {vertical[-1]:.1e} and {horizontal[-1]:.1e} N/mm")
        print(f"{result.verdict.iterations} Newton iterations in {len(time)} steps; picture: {OUT / 'ironing.png'}")
    assert VERTICAL[0] < V.min() and V.max() < VERTICAL[1]
    assert quick or RATIO[0] < ratio.mean() < RATIO[1]  # a short way is not yet all slip


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
