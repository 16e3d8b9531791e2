"""The numbers of choices.md on steps and cells: `python3 docs/steps_and_cells.py`, a few minutes."""

from fenics_contact import Body, Output, Scene, Stage, neo_hooke, read_gmsh, rigid_sphere, solve
from fenics_contact.meshes import box

RADIUS, DEEP, FAR = 4.0, 0.8, 2.0  # mm: of the ball, pressed in by, dragged by
STEPS, CELLS = (1, 2, 4, 8, 16), (6, 8, 12, 16, 24)  # of each of both stages; along an edge of 8 mm


def dragged(steps, cells):
    """Load after pressing [N], friction's force [N] and work [N mm] after dragging, share of the work that is missing, and
    tangent solves, of a rough ball on the half of a block of rubber."""
    size = (8.0, 4.0, 3.0)
    number = tuple(round(cells * length / size[0]) for length in size)
    scene = Scene(Body(read_gmsh(box.build, size=size, cells=number), "box", neo_hooke(mu=0.7, K=5.0)))
    scene.fix("zmin")
    scene.fix("ymin", "y")
    ball = rigid_sphere(RADIUS, (3.0, 0.0, size[2] + RADIUS), name="ball")
    scene.contact("zmax", ball, 0.3, name="top")
    press = Stage("press", move={ball: (0, 0, -DEEP)}, steps=steps)
    result = solve(
        scene, stages=[press, Stage("drag", move={ball: (FAR, 0, -DEEP)}, steps=steps)], out=Output(progress=False)
    ).require()
    force, work = (abs(result.column(f"top_{name}")[-1]) for name in ("force_x_N", "friction_work_Nmm"))
    return (
        result.column("top_load_N", "press")[-1],
        force,
        work,
        result.summary["energy"]["error_share"],
        result.verdict.iterations,
    )


if __name__ == "__main__":
    for steps, cells in [*((n, 12) for n in STEPS), *((8, n) for n in CELLS)]:
        print(f"{steps} steps, {cells} cells:", *(f"{x:.5g}" for x in dragged(steps, cells)), flush=True)
