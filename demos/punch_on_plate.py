"""A rigid square punch pressed into a rubber plate on a rigid plane: the second example of Abdrakhmanova & Sultanov (2018).

A quarter of the plate 80 x 80 x 10 mm under a punch of 40 x 40 mm, in four friction cases, each driven by displacement
(2 mm) and by force (what the frictionless punch needs for 2 mm). Units: mm, N, MPa.

    mpirun -n 2 python3 demos/punch_on_plate.py   # --quick: a coarse mesh, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Output, Penalty, Scene, mooney_paper, read_gmsh, rigid_plane, rigid_punch, solve
from fenics_contact.meshes import punch_plate

OUT = Path("results/punch_on_plate")
CASES = [(0.0, 0.0), (0.3, 0.0), (1.0, 0.0), (0.0, 1.0)]  # (punch on plate, plate on plane)
TRAVEL = 2.0
ROOT = MPI.COMM_WORLD.rank == 0


def say(*words):
    if ROOT:
        print(*words, flush=True)


def press(mesh, case, out, force=None, share=None, steps=10):
    """One run; returns numbers of the last step, the force-travel curve and what to draw (on rank 0)."""
    scene = Scene(Body(mesh, "plate", mooney_paper(a1=0.1863, a2=0.0098, K=5.0)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    punch, floor = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10)), rigid_plane(name="floor")
    scene.contact("top", punch, case[0], name="top", penalty=Penalty(share=share))
    scene.contact("bottom", floor, case[1], name="bottom", penalty=Penalty(share=share))
    drive = {"move": {punch: (0, 0, -TRAVEL)}} if force is None else {"push": {punch: (0, 0, -force)}}
    result = solve(scene, **drive, steps=steps, out=Output(out, overwrite=True))
    if not result.converged:
        raise SystemExit(f"friction {case}: {result.verdict.reason}")
    u, comm = result.u.x.array[2::3], mesh.comm
    x = scene.space.tabulate_dof_coordinates()
    lowest = comm.allreduce(u.min(initial=0.0), op=MPI.MIN)
    top, bottom = (comm.allreduce(u[np.abs(x[:, 2] - z) < 1e-6].max(initial=-9.0), op=MPI.MAX) for z in (10.0, 0.0))
    return {
        "indentation": -result.history[-1]["punch_travel_z_mm"],
        "deflection": -lowest,
        "uplift": top,
        "floor_lift": bottom,
        "force": -result.history[-1]["top_force_z_N"],
        "curve": (-result.column("punch_travel_z_mm"), -result.column("top_force_z_N")),
        "plate": result.drawing("contact_pressure", view=(30, -60)),
        "iterations": [row["iterations"] for row in result.history],
        "edge": punch.edge_kind,
    }


def four_quarters(runs, path):
    """The deformed quarters of the paper's Figs 3-6, with the pressure under the punch and the rim that lifts."""
    figure = Figure(figsize=(6.3, 5.2), layout="constrained")
    panels = figure.subplots(2, 2)
    for axes, case, run in zip(panels.flat, CASES, runs, strict=True):
        colours = run["plate"].draw(axes, limits=(0.0, max(r["plate"].colours.high for r in runs)))
        axes.set_title(f"μ₁ = {case[0]:g}, μ₂ = {case[1]:g}: {run['force']:.0f} N", fontsize=10)
    colours.explain(list(panels.flat), 9, location="bottom", shrink=0.7, aspect=40)
    figure.savefig(path, dpi=150)


def curves(moved, path):
    figure = Figure(figsize=(6.3, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for case, run in zip(CASES, moved, strict=True):
        travel, force = (np.concatenate([[0.0], values]) for values in run["curve"])
        axes.plot(travel, force, marker="o", markersize=3, label=f"μ₁ = {case[0]:g}, μ₂ = {case[1]:g}")
    axes.set_xlabel("travel of the punch [mm]")
    axes.set_ylabel("force on the quarter [N]")
    axes.legend()
    figure.savefig(path, dpi=150)


def table(moved, pushed):
    lines = ["drive         μ1   μ2   indentation  uplift of top  lift off floor   force   iterations"]
    lines.append("                            [mm]          [mm]           [mm]        [N]   per step")
    for drive, runs in (("displacement", moved), ("force", pushed)):
        for case, r in zip(CASES, runs, strict=True):
            lines.append(
                f"{drive:12} {case[0]:4.1f} {case[1]:4.1f} {r['indentation']:10.4f} {r['uplift']:13.4f} "
                f"{r['floor_lift']:14.4f} {r['force']:11.3f}   {np.mean(r['iterations']):.1f}"
            )
    return lines


def statements(moved, pushed):
    """Which of the paper's two sentences holds for which measure and drive."""
    lines = ["the paper: friction at the top increases the plate's deflection, friction at the bottom decreases it; here:"]
    measures = {"displacement": ("uplift", "floor_lift", "force"), "force": ("indentation", "uplift", "floor_lift")}
    for drive, runs in (("displacement", moved), ("force", pushed)):
        for measure in measures[drive]:
            free, _, rough_top, rough_bottom = (run[measure] for run in runs)
            first, second = ("holds" if yes else "does not hold" for yes in (rough_top > free, rough_bottom < free))
            lines.append(
                f"  {drive}-driven, measured by {measure.replace('_', ' ')}: top {first} "
                f"({free:.3f} -> {rough_top:.3f}), bottom {second} ({free:.3f} -> {rough_bottom:.3f})"
            )
    return lines


def main(quick=False):
    cells = {"inside": 4, "outside": 3, "layers": 2} if quick else {"inside": 12, "outside": 10, "layers": 6}
    mesh = read_gmsh(punch_plate.build, **cells, ratio=1.1)
    name = "mu1_{:g}_mu2_{:g}".format
    steps = 5 if quick else 10
    moved = [press(mesh, case, OUT / f"moved_{name(*case)}", steps=steps) for case in CASES]
    force = moved[0]["force"]
    pushed = [press(mesh, case, OUT / f"pushed_{name(*case)}", force, steps=steps) for case in CASES]
    share = {s: press(mesh, (1.0, 0.0), None, share=s, steps=steps)["force"] for s in (0.01, 0.1, 1.0)}

    lines = [f"punch edge: {moved[0]['edge']}; second invariant: the paper's, tr(B.B)", *table(moved, pushed)]
    lines += statements(moved, pushed)
    lines.append(
        f"tangential penalty, μ1 = 1, 2 mm: {share[0.01]:.3f} N at 0.01, {share[0.1]:.3f} N at 0.1, "
        f"{moved[2]['force']:.3f} N at 1/3 (default), {share[1.0]:.3f} N at 1 times the normal one"
    )
    if ROOT:
        four_quarters(moved, OUT / "deformed_quarters.png")
        curves(moved, OUT / "force_travel.png")
        (OUT / "table.txt").write_text("\n".join(lines) + "\n")
    say("\n".join(lines))
    say(f"pictures: {OUT / 'deformed_quarters.png'}, {OUT / 'force_travel.png'}; every run's files: {OUT}/")


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
