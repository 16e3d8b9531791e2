"""A shaft turns in a rubber ring squeezed on it, off its middle: the torque grows while the ring sticks, then it slides.

From there on the torque is friction times pressure times radius over the surface, wherever the pressure is: the columns of
moments are about the middle of the shaft, which has moved. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/shaft_seal.py   # --quick: a coarse ring
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Motion, Output, Scene, neo_hooke, read_gmsh, rigid_cylinder, solve
from fenics_contact.meshes import ring

OUT = Path("results/shaft_seal")
RADIUS, FRICTION = 10.0, 0.3  # mm, of the shaft
SQUEEZE, OFF, TURN = 0.4, 0.2, 0.5  # mm, mm, radians
FITTED = 0.25  # of the run: then the ring is on, and the shaft begins to turn


def squeezed(axis):
    """Displacement of the ring's outside, inwards."""
    return lambda X, t: -SQUEEZE * min(t / FITTED, 1.0) * X[:, axis] / np.hypot(X[:, 0], X[:, 2])


def main(quick=False):
    mesh = read_gmsh(ring.build, inner=RADIUS, outer=14.0, width=6.0, cells=(32, 2, 2) if quick else (80, 4, 4))
    scene = Scene(Body(mesh, "ring", neo_hooke(mu=1.0, K=10.0)))
    scene.prescribe("outside", "x", squeezed(0))
    scene.fix("outside", "y")
    scene.prescribe("outside", "z", squeezed(2))
    shaft = rigid_cylinder(RADIUS, point=(0, 0, 0), name="shaft")
    scene.contact("inside", shaft, friction=FRICTION, name="seal")
    motion = Motion(x=lambda t: OFF * min(t / FITTED, 1.0), ry=lambda t: TURN * max(t - FITTED, 0.0) / (1 - FITTED))
    result = solve(scene, move={shaft: motion}, steps=16, out=Output(OUT, overwrite=True, progress=False)).require()
    fitted = result.column("t") >= FITTED - 1e-9
    angle, torque = result.column("shaft_angle_y_rad")[fitted], np.abs(result.column("seal_moment_y_Nmm")[fitted])
    sliding = FRICTION * RADIUS * result.column("seal_load_N")[fitted]
    drawn = result.drawing("contact_pressure", view=(35, -60))
    if MPI.COMM_WORLD.rank == 0:
        picture = Figure(figsize=(6.3, 5.5), layout="constrained")
        curve, seal = picture.subplots(2, 1, height_ratios=(1, 2))
        curve.plot(np.degrees(angle), torque, marker="o", markersize=3, label="torque")
        curve.plot(np.degrees(angle), sliding, "k", linewidth=0.8, label="μ ∫ p r dA")
        curve.set_xlabel("angle of the shaft [degrees]"), curve.set_ylabel("torque [N mm]"), curve.legend(fontsize=9)
        drawn.draw(seal).explain(seal, 9)
        picture.savefig(OUT / "shaft_seal.png", dpi=150)
        print(f"torque {torque[-1]:.3f} N mm, μ ∫ p r dA = {sliding[-1]:.3f} N mm")
        print(f"picture: {OUT / 'shaft_seal.png'}")
    # r is the shaft's radius less what the penalties give way, some 5e-4 of it
    assert abs(torque[-1] / sliding[-1] - 1) < 2e-3


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
