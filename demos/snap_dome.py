"""A rubber dome with a thick crown under a rough ball: through its snap-through and back, pushed by a force.

Load control cannot pass the two limit points of the force; arc length does, with contact and friction active. The same
travels prescribed to the ball (displacement control, stable here) must give the same forces. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/snap_dome.py   # --quick: a coarse dome, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import ArcSteps, Body, Load, Scene, Travel, mooney_rivlin, read_gmsh, rigid_sphere, solve
from fenics_contact.output.fields import exterior_surface
from fenics_contact.output.pictures import draw_body
from meshes import dome

OUT = Path("results/snap_dome")
RADIUS, WALL, BALL = 40.0, 2.0, 8.0
END = 20.0  # travel of the ball at which it turns round
ROOT = MPI.COMM_WORLD.rank == 0


def scene_of(mesh):
    """The clamped quarter dome and its ball."""
    scene = Scene(Body(mesh, "dome", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), degree=2)
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("rim")
    ball = rigid_sphere(BALL, (0, 0, RADIUS + WALL / 2 + BALL), name="ball")
    scene.contact("outer", ball, friction=0.3, name="crown")
    return scene, ball


def curve(result):
    """Travel downwards [mm] and force on the quarter [N] of all steps."""
    return -result.column("ball_travel_z_mm"), -result.column("crown_force_z_N")


def push(mesh, largest):
    """Through and back under a force; also every step's displacement (on this rank) for pictures."""
    scene, ball = scene_of(mesh)
    shapes = []

    def keep(state):
        shapes.append(state.u.x.array.copy())
        return len(shapes)

    result = solve(
        scene,
        push={ball: (0, 0, -1.0)},
        method="arc_length",
        steps=ArcSteps(first=0.1, largest=largest),
        until=Travel(ball, "z", -END),
        back=Load(0.02),
        record={"shape": keep},
        out=OUT / "pushed",
        overwrite=True,
    )
    if not result.converged:
        raise SystemExit(f"pushed: {result.verdict.reason}")
    return scene, result, shapes


def move(mesh, travels):
    """The same travels prescribed to the ball."""
    scene, ball = scene_of(mesh)
    result = solve(scene, move={ball: (0, 0, -travels[-1])}, steps=travels / travels[-1], out=OUT / "moved", overwrite=True)
    if not result.converged:
        raise SystemExit(f"moved: {result.verdict.reason}")
    return result


def picture(through, back, moved, limits, shapes, path):
    """Force over travel, and the dome at the points marked on it."""
    figure = Figure(figsize=(11, 6.5))
    axes = figure.add_axes((0.07, 0.1, 0.5, 0.85))
    axes.plot(*(np.insert(values, 0, 0.0) for values in through), "-o", markersize=3, label="pushed, through")
    axes.plot(*back, "--", label="pushed, back")
    axes.plot(*moved, "k+", label="moved: travel prescribed")
    for letter, (travel, force) in zip("abc", limits, strict=True):
        axes.plot(travel, force, "rv", markersize=7)
        axes.annotate(letter, (travel, force), (4, 8), textcoords="offset points", fontsize=12)
    axes.set_xlabel("travel of the ball [mm]")
    axes.set_ylabel("force on the quarter [N]")
    axes.legend()
    everywhere = [values for _, values in shapes]
    colours = min(v.min() for v in everywhere), max(v.max() for v in everywhere)
    for i, (letter, (corners, values)) in enumerate(zip("abc", shapes, strict=True)):
        body = figure.add_axes((0.58, 0.64 - 0.32 * i, 0.31, 0.36), projection="3d")
        scale = draw_body(body, corners, values, limits=colours, view=(12, 225))  # from the side of the cuts
        body.text2D(0.1, 0.75, letter, transform=body.transAxes, fontsize=12)
        body.set_xticks([]), body.set_yticks([])
    figure.colorbar(scale, cax=figure.add_axes((0.92, 0.25, 0.015, 0.5)), label="vertical displacement [mm]")
    figure.savefig(path, dpi=150)


def main(quick=False):
    mesh = read_gmsh(dome.build, radius=RADIUS, thickness=WALL, boss=5.0, cells=3 if quick else 8)
    scene, pushed, shapes = push(mesh, largest=4.0 if quick else 1.0)
    travel, force = curve(pushed)
    turn = int(np.argmax(travel))
    through, back = (travel[: turn + 1], force[: turn + 1]), (travel[turn:], force[turn:])
    moved = curve(move(mesh, through[0]))
    apart = np.abs(moved[1] - through[1]).max() / through[1].max()

    marks = [*np.flatnonzero(pushed.column("limit_point")[: turn + 1]), turn]
    surfaces = []
    for step in marks:
        pushed.u.x.array[:] = shapes[step]
        surfaces.append(exterior_surface(scene, pushed.u, shapes[step][2::3]))
    if ROOT:
        picture(through, back, moved, [(travel[i], force[i]) for i in marks], surfaces, OUT / "snap_dome.png")
        for point in pushed.summary["limit_points"]:
            place = "through" if point["step"] <= turn + 1 else "back"
            print(f"{place:8} {point['kind']}: {point['t']:.6f} N at a travel of {travel[point['step'] - 1]:.4f} mm")
        print(f"pushed and moved are {apart:.1e} of the largest force apart; picture: {OUT / 'snap_dome.png'}", flush=True)
    kinds = [point["kind"][:3] for point in pushed.summary["limit_points"]]
    assert kinds == ["max", "min", "min", "max"]
    # same states, same steps, so the same friction history: both balance to 1e-8, and the travel lands where it is sent
    assert apart < 1e-6


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
