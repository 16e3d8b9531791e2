"""A rubber block pressed on a larger one and dragged over it: large frictional sliding of two deformable bodies.

Upper block 20 x 20 x 10 mm (10 x 10 x 4 hexahedra) on a lower one of 40 x 40 x 10 mm (16 x 16 x 4), friction 0.3; the
upper face goes down by 2 mm in five steps, then 10 mm sideways in twenty. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/block_on_block.py   # --quick: a coarse mesh, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Output, Scene, Stage, mooney_rivlin, read_gmsh, solve
from fenics_contact.meshes import two_blocks

OUT = Path("results/block_on_block")
FRICTION = 0.3
PRESS, DRAG = 2.0, 10.0
FORCE = (94.1, 95.6)  # N after pressing: four finite element codes on this mesh, classical Mooney-Rivlin, K = 5 MPa


def slide(quick):
    mesh = read_gmsh(two_blocks.build, **({"lower_cells": (8, 8, 2), "upper_cells": (5, 5, 2)} if quick else {}))
    rubber = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
    scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber))
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact(slave="upper_bottom", master="lower_top", friction=FRICTION, name="interface")
    press = Stage("press", prescribe={("upper_top", "z"): -PRESS}, steps=5)
    drag = Stage("drag", prescribe={("upper_top", "x"): DRAG}, steps=20)
    return solve(scene, stages=[press, drag], out=Output(OUT, overwrite=True)).require()


def figure(t, ratio, normal, blocks):
    picture = Figure(figsize=(6.3, 7), layout="constrained")
    bodies, axes = picture.subplots(2, 1, height_ratios=[1.3, 1])
    blocks.draw(bodies).explain(bodies, 9, shrink=0.8)
    bodies.set_title("at the end of the way, seen from below through the lower block", fontsize=10)
    travel = np.maximum(t - 1.0, 0.0) * DRAG
    axes.plot(travel, ratio, marker="o", markersize=3, label="horizontal over vertical force")
    axes.axhline(FRICTION, color="grey", linewidth=0.8, label="Coulomb's μ")
    axes.set_xlabel("travel of the upper face [mm]")
    axes.set_ylabel("force ratio")
    axes.legend(loc="lower right")
    other = axes.twinx()
    other.plot(travel, normal, color="tab:red", linewidth=0.8)
    other.set_ylim(0, 1.3 * normal.max())
    other.set_ylabel("vertical force [N]", color="tab:red")
    picture.savefig(OUT / "block_on_block.png", dpi=150)


def main(quick=False):
    result = slide(quick)
    t, normal = result.column("t"), result.column("interface_force_z_N")
    ratio = -result.column("interface_force_x_N") / normal
    blocks = result.drawing("contact_pressure")
    pressed = result.column("interface_force_z_N", "press")[-1]
    sliding = ratio[t > 1.375]
    if MPI.COMM_WORLD.rank == 0:
        figure(t, ratio, normal, blocks)
        print(f"vertical force when pressed {pressed:.2f} N (four codes: {FORCE[0]} to {FORCE[1]} N)")
        print(f"force ratio while sliding {sliding.min():.3f} to {sliding.max():.3f} (μ = {FRICTION})")
        verdict = result.verdict
        print(f"{verdict.iterations} tangents, {verdict.corrections} corrections with old ones in {len(t)} steps")
        print(f"picture: {OUT / 'block_on_block.png'}")
    assert quick or FORCE[0] <= pressed <= FORCE[1]


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
