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

from fenics_contact import ArcSteps, Body, Film, Load, Output, Scene, Travel, mooney_rivlin, read_gmsh, rigid_sphere, solve
from fenics_contact.meshes import dome

OUT = Path("results/snap_dome")
RADIUS, WALL, BALL = 40.0, 2.0, 8.0
END = 20.0  # travel of the ball at which it turns round
ROOT = MPI.COMM_WORLD.rank == 0


def scene_of(mesh):
    """The clamped quarter dome and its ball."""
    scene = Scene(Body(mesh, "dome", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), degree=2, element="mixed")
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
    """Through and back under a force; also drawings of all steps."""
    scene, ball = scene_of(mesh)
    film = Film("contact_pressure", mirror="x", view=(20, -70))  # into the half that is cut open
    result = solve(
        scene,
        push={ball: (0, 0, -1.0)},
        steps=ArcSteps(until=Travel(ball, "z", -END), back=Load(0.02), first=0.1, largest=largest),
        record={"frame": film},
        out=Output(OUT / "pushed", overwrite=True),
    )
    if not result.converged:
        raise SystemExit(f"pushed: {result.verdict.reason}")
    return result, film


def move(mesh, travels):
    """The same travels prescribed to the ball."""
    scene, ball = scene_of(mesh)
    result = solve(
        scene, move={ball: (0, 0, -travels[-1])}, steps=travels / travels[-1], out=Output(OUT / "moved", overwrite=True)
    )
    if not result.converged:
        raise SystemExit(f"moved: {result.verdict.reason}")
    return result


def picture(through, back, moved, limits, shapes, path):
    """Force over travel, and the dome at the points marked on it."""
    figure = Figure(figsize=(6.3, 5.8), layout="constrained")
    places = figure.subplot_mosaic([["curve"] * 3, [*"abc"]], height_ratios=[2, 1])
    axes = places["curve"]
    axes.plot(*(np.insert(values, 0, 0.0) for values in through), "-o", markersize=3, label="pushed, through")
    axes.plot(*back, "--", label="pushed, back")
    axes.plot(*moved, "k+", label="moved: travel prescribed")
    for letter, (travel, force) in zip("abc", limits, strict=True):
        axes.plot(travel, force, "rv", markersize=7)
        axes.annotate(letter, (travel, force), (4, 8), textcoords="offset points", fontsize=12)
    axes.set_xlabel("travel of the ball [mm]")
    axes.set_ylabel("force on the quarter [N]")
    axes.legend()
    for letter, dome_then in zip("abc", shapes, strict=True):
        colours = dome_then.draw(places[letter], limits=(0.0, max(shape.colours.high for shape in shapes)))
        places[letter].set_title(letter, fontsize=12)
    colours.explain([places[letter] for letter in "abc"], 9, location="bottom", shrink=0.7, aspect=40)
    figure.savefig(path, dpi=150)


def main(quick=False):
    mesh = read_gmsh(dome.build, radius=RADIUS, thickness=WALL, boss=5.0, cells=3 if quick else 8)
    pushed, film = push(mesh, largest=4.0 if quick else 1.0)
    travel, force = curve(pushed)
    turn = int(np.argmax(travel))
    through, back = (travel[: turn + 1], force[: turn + 1]), (travel[turn:], force[turn:])
    moved = curve(move(mesh, through[0]))
    apart = np.abs(moved[1] - through[1]).max() / through[1].max()

    marks = [*np.flatnonzero(pushed.column("limit_point")[: turn + 1]), turn]
    if ROOT:
        then = [film.drawings[step] for step in marks]
        picture(through, back, moved, [(travel[i], force[i]) for i in marks], then, OUT / "snap_dome.png")
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
