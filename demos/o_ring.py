"""An O-ring is squeezed by a lid; then a fluid comes in from the left and presses it into the corner: it seals itself.

The fluid acts where the lid does not press, and comes in as far as it presses more than the lid: `pressure(where="open")`.
Plane strain, upper half of the section, no friction. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/o_ring.py   # --quick: fewer cells, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Scene, neo_hooke, read_gmsh, rigid_plane, solve
from meshes import o_ring

OUT = Path("results/o_ring")
RADIUS, DEPTH, SQUEEZE, GAP = 1.5, 0.1, 0.4, 0.1  # mm: of the section and the slice, of the lid's way, to the groove's wall
PRESSURE = 10.0  # MPa, of the fluid at the end


def seal(cells, steps):
    """The ring squeezed until t = 0.5, then under a fluid whose pressure grows."""
    scene = Scene(Body(read_gmsh(o_ring.build, radius=RADIUS, depth=DEPTH, cells=cells), "ring", neo_hooke(4.0, 40.0)))
    scene.fix("symmetry_z", "z")
    scene.fix("ends", "y")
    lid = rigid_plane((0, 0, RADIUS), (0, 0, -1), name="lid")
    scene.contact("rim", lid, name="lid")
    scene.contact("rim", rigid_plane((RADIUS + GAP, 0, 0), (-1, 0, 0), name="wall"), name="wall")
    scene.pressure("rim", lambda t: PRESSURE * max(2 * t - 1, 0.0), where="open", from_="wet")
    drive = {lid: lambda t: (0, 0, -SQUEEZE * min(2 * t, 1.0))}
    return solve(scene, move=drive, steps=steps, stabilise=True, out=OUT, overwrite=True, progress=False).require()


def main(quick=False):
    result = seal(*((4, 8) if quick else (12, 16)))
    fluid, lid = PRESSURE * np.maximum(2 * result.column("t") - 1, 0.0), result.column("lid_peak_pressure_MPa")
    drawing = result.drawing("contact_pressure")
    if MPI.COMM_WORLD.rank == 0:
        picture = Figure(figsize=(6, 7), layout="constrained")
        section, axes = picture.subplots(2, 1)
        axes.plot(fluid, lid, marker="o", markersize=3, label="the lid's, where it is greatest")
        axes.axline((0, 0), slope=1, color="k", linewidth=0.8, label="the fluid's")
        axes.set_xlabel("pressure of the fluid [MPa]"), axes.set_ylabel("pressure [MPa]"), axes.legend(fontsize=9)
        drawing.draw(section).explain(section, 9, location="bottom")
        picture.savefig(OUT / "o_ring.png", dpi=150)
        whole, part = (result.history[-1][f"{name}_z_N"] / DEPTH for name in ("symmetry_z_reaction", "lid_force"))
        print(f"the section is pressed with {whole:.2f} N/mm: {-part:.2f} by the lid, the rest by the fluid")
        print(f"the lid's greatest pressure: {lid[-1]:.2f} MPa; picture: {OUT / 'o_ring.png'}")
    assert lid[-1] > PRESSURE > lid[fluid == 0.0].max()  # squeezed with less than the fluid has, it holds it


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
