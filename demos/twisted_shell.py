"""Half a stiff thick shell is pressed into a soft block by half of its height, then turned by 180 degrees, friction 0.5.

The benchmark of Sauer & De Lorenzis (2015, doi:10.1002/nme.4794): the moment rises while the block is dragged along, and
stays where all of it slides. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/twisted_shell.py   # --quick: a coarse mesh; --fine: minutes
"""

import sys
from pathlib import Path

import numpy as np
import ufl
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Motion, Output, Scene, Stage, read_gmsh, rigid_hub, solve, user_energy
from fenics_contact.meshes import half_shell

OUT = Path("results/twisted_shell")
FRICTION, PRESS = 0.5, 1.0
# cells of the shell along a patch and through the wall; of the block; steps to press and to turn
MESHES = {"quick": ((3, 1), (6, 6, 4), 5, 12), "": ((8, 2), (13, 13, 10), 10, 36), "fine": ((14, 4), (22, 22, 16), 10, 36)}
ANGLES = np.array([15, 30, 45, 60, 90, 120, 150])  # degrees
MOMENTS = np.array([0.1113, 0.2087, 0.2926, 0.3545, 0.3991, 0.4026, 0.4061])  # N mm, published


def rubber(E, nu=0.3):
    """Neo-Hooke's law with the logarithm of J, as the benchmark has it; E [MPa]."""
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))

    def psi(F):
        ln_J = ufl.ln(ufl.det(F))
        return lame / 2 * ln_J**2 + mu / 2 * (ufl.inner(F, F) - 3 - 2 * ln_J)

    return user_energy(psi, mu, lame + 2 * mu / 3, f"neo-Hooke with ln J, E = {E}")


def twist(kind):
    shell, block, pressing, turning = MESHES[kind]
    mesh = read_gmsh(half_shell.build, cells=shell, block_cells=block)
    scene = Scene(Body(mesh, "shell", rubber(5.0)), Body(mesh, "block", rubber(1.0)))
    scene.fix("bottom")
    scene.tie("rim", hub := rigid_hub("hub", point=(0, 0, 1)))
    scene.contact("top", "outer", FRICTION, name="interface")  # the softer body is the slave
    press = Stage("press", move={hub: Motion(z=-PRESS)}, steps=pressing)
    turn = Stage("turn", move={hub: Motion(rz=np.pi)}, steps=turning)
    return solve(scene, stages=[press, turn], out=Output(OUT, overwrite=True, progress=False)).require()


def main(kind=""):
    result = twist(kind)
    angle, moment = (result.column(f"hub_{name}") for name in ("angle_z_rad", "moment_z_Nmm"))
    at = np.interp(ANGLES, np.degrees(angle), moment)
    bodies, verdict = result.drawing("contact_pressure", view=(25, -60)), result.verdict
    if MPI.COMM_WORLD.rank == 0:
        picture = Figure(figsize=(6.3, 7), layout="constrained")
        drawn, curve = picture.subplots(2, 1, height_ratios=(1.6, 1))
        bodies.draw(drawn).explain(drawn, 9)
        curve.plot(np.degrees(angle), moment, label="here")
        curve.plot(ANGLES, MOMENTS, "o", fillstyle="none", color="k", label="Sauer & De Lorenzis (2015)")
        curve.set_xlabel("turned by [degrees]"), curve.set_ylabel("moment [N mm]"), curve.legend()
        picture.savefig(OUT / "twisted_shell.png", dpi=150)
        for row in zip(ANGLES, at, 100 * (at / MOMENTS - 1), strict=True):
            print("{:4d} degrees: {:.4f} N mm, {:+.1f} % of the published moment".format(*row))
        print(f"{verdict.iterations} tangents in {len(angle)} steps; picture: {OUT / 'twisted_shell.png'}")
    # chords lie within the shell: a coarse one is smaller, and so is the lever of friction where all of it slides
    assert np.abs(at / MOMENTS - 1).max() < {"quick": 0.2, "": 0.06, "fine": 0.03}[kind]


if __name__ == "__main__":
    main(next((kind for kind in ("quick", "fine") if f"--{kind}" in sys.argv), ""))
