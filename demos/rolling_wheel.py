"""A rubber tyre, tied to a rigid hub by its bore, is pressed on a road by a force, rolls freely, and is braked by a moment.

The hub is carried along and turns as the road bids: without a moment there is no drag. Then the brake's moment grows, and
so does the drag. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/rolling_wheel.py   # --quick: a coarse tyre
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Motion, Output, Scene, neo_hooke, read_gmsh, rigid_hub, rigid_plane, solve
from fenics_contact.meshes import ring

OUT = Path("results/rolling_wheel")
RADIUS, LOAD, FRICTION, BRAKE, WAY = 25.0, 40.0, 0.8, 400.0, 30.0  # mm, N, 1, N mm, mm
PRESSED, FREE = 0.1, 0.5  # of the run: then it is on the road, then it is braked


def roll(quick):
    mesh = read_gmsh(ring.build, outer=RADIUS, cells=(48, 2, 1) if quick else (96, 4, 3))
    scene = Scene(Body(mesh, "ring", neo_hooke(mu=0.6, K=6.0)))
    scene.tie("inside", hub := rigid_hub("hub", point=(0, 0, 0)))
    scene.contact("outside", rigid_plane((0, 0, -RADIUS)), friction=FRICTION, name="road")
    motion = Motion(
        x=lambda t: WAY * max(t - PRESSED, 0.0) / (1 - PRESSED),
        force=lambda t: (0, 0, -LOAD * min(t / PRESSED, 1.0)),
        moment=lambda t: (0, -BRAKE * max(t - FREE, 0.0) / (1 - FREE), 0),
    )
    steps = [PRESSED / 2, *np.arange(PRESSED, 1.001, 0.025)]
    return solve(scene, move={hub: motion}, steps=steps, out=Output(OUT, overwrite=True, progress=False)).require()


def main(quick=False):
    result = roll(quick)
    t, way = result.column("t"), result.column("hub_travel_x_mm")
    drag, moment = result.column("hub_force_x_N"), -result.column("hub_moment_y_Nmm")
    rolling, tyre = (t > 0.3) & (t < FREE + 1e-9), result.drawing("contact_pressure", view=(-22, -60))
    radius = np.polyfit(result.column("hub_angle_y_rad")[rolling], way[rolling], 1)[0]
    if MPI.COMM_WORLD.rank == 0:
        picture = Figure(figsize=(6.3, 5.5), layout="constrained")
        curve, wheel = picture.subplots(2, 1, height_ratios=(1, 2))
        curve.plot(way, drag, marker="o", markersize=3, label="drag")
        curve.plot(way, moment / RADIUS, "k", linewidth=0.8, label="moment of the brake / radius")
        curve.set_xlabel("way of the hub [mm]"), curve.set_ylabel("force [N]"), curve.legend(fontsize=9)
        tyre.draw(wheel).explain(wheel, 9)
        picture.savefig(OUT / "rolling_wheel.png", dpi=150)
        print(f"rolls freely on a radius of {radius:.3f} mm; at rest it is {RADIUS:g} mm")
        print(f"drag over load: {np.abs(drag[rolling]).max() / LOAD:.1e} rolling, {drag[-1] / LOAD:.4f} braked")
        print(f"picture: {OUT / 'rolling_wheel.png'}")
    # rubber gives back all work: what is left are facets that come and go, 0.8 % with 48 of them around, 0.15 % with 96
    assert np.abs(drag[rolling]).max() < 0.02 * LOAD


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
