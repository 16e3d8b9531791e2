"""A stretched rubber strap is wound a quarter turn over a rigid drum and pulled until it slides: T2/T1 = exp(mu theta).

The law of Euler and Eytelwein holds for a strap without thickness, so three thicknesses show how the ratio of the end
forces tends to it. Plane strain, one layer of hexahedra. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/capstan.py   # --quick: the thickest strap, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Output, Scene, Stage, neo_hooke, read_gmsh, rigid_cylinder, solve
from fenics_contact.meshes import box

OUT = Path("results/capstan")
FRICTION, TURN = 0.3, np.pi / 2
EXACT = np.exp(FRICTION * TURN)
RADIUS, TAIL = 25.0, 10.0  # mm, of the drum and of the strap's straight ends
RIGHT = RADIUS * TURN + TAIL  # mm, from the point where it first touches to the end that is moved
THICKNESSES = (2.0, 1.0, 0.5)  # mm
STRETCH = (1.0, 1.4, 1.4, 1.7)  # of the moved part at the times 0 ... 3
STEPS = {"stretch": 3, "wind": 18, "pull": 10}  # the last till it slides


def end(X, t):
    """Displacement (n, 3) of the moved end: a rigid face that stays normal to the straight part between drum and end."""
    angle = np.interp(t, [1, 2], [0, TURN])
    along, normal = np.array([np.cos(angle), -np.sin(angle), 0]), np.array([np.sin(angle), np.cos(angle), 0])
    length = np.interp(t, range(4), STRETCH) * RIGHT - RADIUS * angle
    return RADIUS * normal + length * along + (X[:, 1:2] - RADIUS) * normal - X * [1, 1, 0]


def stage(name, number):
    """One of the three, from time `number` on; what the end moves by counts from there."""
    ways = {("xmax", axis): lambda X, s, i=i: (end(X, number + s) - end(X, number))[:, i] for i, axis in enumerate("xy")}
    return Stage(name, prescribe=ways, steps=STEPS[name])


def wind(thickness):
    """Result and pulling over holding force after each step; the strap starts straight on top of the drum."""
    length = TAIL + RIGHT
    size, cells = (length, thickness, length / 80), (80, 2, 1)
    mesh = read_gmsh(box.build, size=size, cells=cells, origin=(-TAIL, RADIUS, 0.0), name="strap")
    scene = Scene(Body(mesh, "strap", neo_hooke(mu=0.4, K=5.0)))
    scene.fix("xmin", "xy")
    scene.fix("zmin", "z")
    scene.fix("zmax", "z")
    scene.fix("xmax", "xy")
    drum = rigid_cylinder(RADIUS, point=(0, 0, 0), axis=(0, 0, 1), name="drum")
    scene.contact("ymin", drum, friction=FRICTION, name="wrap")
    stages = [stage(name, i) for i, name in enumerate(STEPS)]
    result = solve(
        scene, stages=stages, out=Output(OUT / f"thickness_{thickness:g}", overwrite=True, progress=False)
    ).require()
    # wound by 90 degrees, one end pulls along -y and the other along -x; the drum balances both
    wound = result.column("t") > 2 - 1e-9
    ratio = (result.column("wrap_force_y_N") / np.maximum(result.column("wrap_force_x_N"), 1e-12))[wound]
    return result, result.column("t")[wound] - 2, ratio


def figure(curves, last, strap):
    picture = Figure(figsize=(6.3, 5.5), layout="constrained")
    places = picture.subplot_mosaic([["ratio", "strap"], ["limit", "strap"]])
    axes, limit = places["ratio"], places["limit"]
    for thickness, (pull, ratio) in curves.items():
        moved = RIGHT * (STRETCH[3] - STRETCH[2]) * pull
        axes.plot(moved, ratio, marker="o", markersize=3, label=f"{thickness:g} mm thick")
    axes.axhline(EXACT, color="k", linewidth=0.8, label="exp(μθ)")
    axes.set_xlabel("travel of the pulled end [mm]"), axes.set_ylabel("ratio of the end forces")
    axes.set_ylim(1.0, None), axes.legend(fontsize=9)
    share = np.array(list(curves)) / RADIUS
    limit.plot(share, EXACT - last, marker="o")
    limit.set_xlim(0, None), limit.set_ylim(0, None)
    limit.set_xlabel("thickness over drum radius"), limit.set_ylabel("exp(μθ) less the ratio\nwhen sliding")
    strap.draw(places["strap"]).explain(places["strap"], 9, location="bottom")
    places["strap"].set_title("sliding; pressure also\nas the height of the band", fontsize=10)
    picture.savefig(OUT / "capstan.png", dpi=150)


def main(quick=False):
    curves, last, root = {}, [], MPI.COMM_WORLD.rank == 0
    for thickness in THICKNESSES[:1] if quick else THICKNESSES:
        result, pull, ratio = wind(thickness)
        curves[thickness] = pull, ratio
        last.append(ratio[-1])
        if root:
            spent = f"{result.verdict.iterations} Newton iterations in {len(result.history)} steps"
            print(f"strap {thickness:g} mm thick: ratio {ratio[-1]:.4f} when sliding; {spent}")
    strap = result.drawing("contact_pressure")
    if root:
        figure(curves, np.array(last), strap)
        print(f"exp(mu theta) = {EXACT:.6f}")
        if not quick:
            print(f"the last two thicknesses extrapolate to {2 * last[-1] - last[-2]:.4f}")
        print(f"picture: {OUT / 'capstan.png'}")
    # the law for no thickness; half of one over the radius, 1 % of the thinnest, is what the strap's own lever arm takes off
    # the exponent
    assert abs(last[-1] / EXACT - 1) < thickness / (2 * RADIUS)


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
