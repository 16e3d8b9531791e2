"""Where methods fail: maps of convergence over penalty, friction, step, compressibility, meshes, edges and load."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import rigid_plane
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import disc, sphere_shell, two_blocks
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_paper, mooney_rivlin
from fenics_contact.solvers.course import ArcSteps
from fenics_contact.studies.controls import CONTROLS, MULTIPLIERS
from fenics_contact.studies.exact import A1, A2, Radial
from fenics_contact.studies.punch import punched_plate
from fenics_contact.studies.runner import Row, Run, Study, grid, metrics
from fenics_contact.studies.sphere import RADIUS, WALL, inner_radial
from fenics_contact.studies.stability import iterations, stability_map

RUBBER: dict[str, Any] = {"a1": A1, "a2": A2, "K": 5.0}  # MPa
SHEAR = 2 * A1 + 2 * A2  # MPa, classical reading at rest
ELEMENTS: dict[str, dict[str, Any]] = {
    "degree 1": {"degree": 1, "accept_locking": True},
    "degree 1, mixed": {"degree": 1, "element": "mixed"},
    "degree 2": {"degree": 2},
    "degree 2, mixed": {"degree": 2, "element": "mixed"},
}
PENALTIES, FRICTIONS = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5], [0.0, 0.1, 0.3, 0.6, 1.0, 2.0]
LOADS = ("load, plain Newton", "load, line search", "load, step control", "arc length")


def press(penalty_factor: float, steps: int, friction: float, control: str, cells: int = 6) -> Row:
    """Sharp punch pressed into a rubber plate by 40 % of its thickness."""
    allowed = 1e-3 if control == MULTIPLIERS else None  # mm
    penalty = Penalty(factor=penalty_factor, share=0.1)
    scene, tool = punched_plate(cells, friction, penalty=penalty, penetration=allowed)
    return metrics(solve(scene, move={tool: (0, 0, -4.0)}, steps=steps, out=Output(progress=False), **CONTROLS[control]))


def fillets(fillet: float, cell: float, points: int | str) -> Row:
    """Filleted punch at 2 mm in 20 steps; error: largest jump of the force's increments over the last force."""
    scene, tool = punched_plate(round(20.0 / cell), 0.0, fillet, points=points)
    result = solve(scene, move={tool: (0, 0, -2.0)}, steps=20, out=Output(progress=False))
    forces = -result.column("top_force_z_N") if result.history else np.zeros(1)
    jump = np.abs(np.diff(forces, n=2, prepend=0.0)).max(initial=0.0) / forces[-1]
    return metrics(result, error=jump, value=forces[-1])


def compressibility(ratio: float, element: str, cells: int = 6) -> Row:
    """Rubber cylinder squeezed by a tenth of its diameter; value: force per depth over the shear modulus [mm]."""
    mesh = read_gmsh(disc.build, radius=20.0, depth=1.0, cells=cells)
    scene = Scene(Body(mesh, "disc", mooney_rivlin(A1, A2, ratio * SHEAR)), **ELEMENTS[element])
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_z", "z")
    scene.fix(("front", "back"), "y")
    plate = rigid_plane((0, 0, 20.0), (0, 0, -1.0))
    scene.contact("rim", plate, name="rim")
    result = solve(scene, move={plate: (0, 0, -2.0)}, steps=2, out=Output(progress=False))
    return metrics(result, value=-2 * result.history[-1]["rim_force_z_N"] / SHEAR if result.history else 0.0)


def blocks(upper_cells: int, lower_cells: int, friction: float, points: int | str, drag: float, per_step: float) -> Row:
    """A small block pressed 1 mm into a longer one, then dragged; error: ripple of the pressing force while dragged."""
    lower, upper = (24.0, 8.0, 4.0), (8.0, 4.0, 4.0)
    cells = [
        (max(1, round(n * s[0] / 8)), max(1, round(n * s[1] / 8)), 2)
        for n, s in ((lower_cells, lower), (upper_cells, upper))
    ]
    mesh = read_gmsh(two_blocks.build, lower=lower, lower_cells=cells[0], lower_origin=(0, 0, -4.0), upper=upper,
                     upper_cells=cells[1], upper_origin=(3.0, 2.0, 0.0))  # fmt: skip
    scene = Scene(Body(mesh, "lower", mooney_rivlin(**RUBBER)), Body(mesh, "upper", mooney_rivlin(**RUBBER)))
    pressing, dragging = 4, round(drag / per_step)
    down = pressing / (pressing + dragging)
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -min(t / down, 1.0)))
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), drag * max(t - down, 0.0) / max(1.0 - down, 1e-12)))
    scene.contact("upper_bottom", "lower_top", friction, points=points, name="interface")
    result = solve(scene, steps=pressing + dragging, out=Output(progress=False))
    force = np.abs([row["interface_force_z_N"] for row in result.history if row["t"] > down + 0.3 * (1.0 - down)])
    ripple = np.ptp(force) / force.mean() if len(force) else float("nan")
    return metrics(result, error=ripple, value=force[-1] if len(force) else 0.0)


def patch(slave_over_master: float, points: int | str, stretch: float = 0.9, cells: int = 12) -> Row:
    """Two stacked blocks of non-matching cells squeezed between frictionless ends: force against the homogeneous state."""
    mine, other = (cells, max(2, round(cells * slave_over_master))) if slave_over_master < 1 else (
        max(2, round(cells / slave_over_master)), cells)  # fmt: skip
    mesh = read_gmsh(two_blocks.build, lower=(10.0, 10.0, 5.0), lower_cells=(other, other, 2), lower_origin=(0, 0, -5.0),
                     upper=(10.0, 10.0, 5.0), upper_cells=(mine, mine, 2), upper_origin=(0.0, 0.0, 0.0))  # fmt: skip
    scene = Scene(Body(mesh, "lower", mooney_rivlin(**RUBBER)), Body(mesh, "upper", mooney_rivlin(**RUBBER)))
    for name in ("lower", "upper"):
        scene.fix(f"{name}_xmin", "x")
        scene.fix(f"{name}_ymin", "y")
    scene.fix("lower_bottom", "z")
    scene.prescribe("upper_top", "z", -10.0 * (1.0 - stretch))
    scene.contact("upper_bottom", "lower_top", points=points, name="interface")
    result = solve(scene, steps=2, out=Output(progress=False))
    force = abs(result.history[-1]["interface_force_z_N"]) if result.history else 0.0
    return metrics(result, error=abs(force / (100.0 * UNIAXIAL[stretch]) - 1), value=force)


UNIAXIAL = {0.9: 0.1288051}  # MPa, nominal stress of the classical reading with K = 5 MPa


def limit(reach: float, way: str, cells: int = 4) -> Row:
    """Sphere inflated towards a displacement [mm of 95]: to its load or, beyond the limit point, 3 % more than it bears."""
    mesh = read_gmsh(sphere_shell.build, inner=RADIUS, thickness=WALL, cells=cells, layers=1)
    scene = Scene(Body(mesh, "shell", mooney_paper(**RUBBER)))
    for axis in "xyz":
        scene.fix(f"symmetry_{axis}", axis)
    exact = Radial("sphere", RUBBER["K"])
    highest = max(exact.solve((RADIUS, RADIUS + WALL), RADIUS + float(u))[0] for u in np.arange(36.0, 45.0))
    aim = exact.solve((RADIUS, RADIUS + WALL), RADIUS + reach)[0]
    radial = inner_radial(scene)
    if way == "arc length":
        scene.pressure("inner", aim)
        result = solve(scene, steps=ArcSteps(until=lambda s: radial(s) - reach, first=1 / STEPS), out=Output(progress=False))
        error = abs(result.history[-1]["t"] - 1) if result.history else float("nan")
        return metrics(result, error=error, value=radial(result.system.state))
    scene.pressure("inner", aim if reach < PEAK else 1.03 * highest)
    control = dict(zip(LOADS, CONTROLS.values(), strict=False))[way]
    result = solve(scene, steps=STEPS, out=Output(progress=False), **control)
    moved = radial(result.system.state)
    return metrics(result, error=abs(moved / reach - 1), value=moved)


STEPS, PEAK = 8, 40.3126  # of the load; mm, displacement at the limit pressure for K = 5 MPa


def studies(quick: bool) -> list[Study]:
    """One study per map."""
    few = slice(None, None, 3) if quick else slice(None)
    controls = list(CONTROLS)[::2] if quick else list(CONTROLS)
    steps = {"steps": [1, 2, 4, 8, 16][few], "control": controls}

    def coarser(cells: int) -> dict[str, list[Any]]:
        return {"cells": [cells]} if quick else {}

    plans: dict[str, tuple[Callable[..., Row], Run, Run]] = {
        "map_penalty": (press, {"penalty_factor": PENALTIES[few], "friction": [0.3], **coarser(4)}, steps),
        "map_friction": (press, {"friction": FRICTIONS[few], "penalty_factor": [100.0], **coarser(4)}, steps),
        "map_compressibility": (
            compressibility,
            {"ratio": [3.0, 12.75, 100.0, 1000.0, 1e4, 1e5][few], **coarser(3)},
            {"element": list(ELEMENTS)[:2] if quick else list(ELEMENTS)},
        ),
        "map_ratio": (
            patch,
            {"slave_over_master": [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0][few], **coarser(4)},
            {"points": ["averages", "corners", 1, 2, 3, 5][few]},
        ),
        "map_edge": (
            fillets,
            {"fillet": [0.0, 0.5, 1.0, 2.0, 4.0][few], "cell": [5.0] if quick else [5.0, 3.4, 2.5, 1.7]},
            {"points": ["nodes", 3]},
        ),
        "map_limit": (
            limit,
            {"reach": [9.5, 19.0, 28.5, 36.0, 39.0, 42.0, 57.0, 95.0][few], **coarser(2)},
            {"way": list(LOADS)[few]},
        ),
        "map_sliding": (
            blocks,
            {"per_step": [2.0] if quick else [0.5, 1.0, 2.0, 4.0], "lower_cells": [4] if quick else [2, 4, 8, 16]},
            {"points": ["averages", "corners", 3], "upper_cells": [6], "friction": [0.3], "drag": [4.0 if quick else 8.0]},
        ),
    }
    return [Study(name, case, grid(**across, **up), limit=60.0, shared=True) for name, (case, across, up) in plans.items()]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """The maps of the rows {study: rows}, and what they say."""
    axis = {"penalty_factor": "penalty over E/h", "steps": "number of steps", "ratio": "K/μ", "reach": "aim [mm of 95]",
            "per_step": "sliding per step [mm]", "lower_cells": "master cells per 8 mm", "fillet": "fillet radius [mm]",
            "slave_over_master": "slave cell / master cell", "points": "slave points", "cell": "cell under the punch [mm]",
            "friction": "friction μ", "control": "Newton", "element": "element", "way": ""}  # fmt: skip

    def share(row: Row) -> str:
        return f"{iterations(row)}\n{row['error']:.2g}"

    def draw(name: str, x: str, y: str, panel: str | None = None, **how: Any) -> None:
        stability_map(charts / f"{name}.png", rows[name], x, y, panel=panel, names=axis, **how)

    rows["map_compressibility"] = _against_finest(rows["map_compressibility"])
    draw("map_penalty", "penalty_factor", "steps", "control", title="Sharp punch, 4 of 10 mm, friction 0.3")
    draw("map_friction", "friction", "steps", "control", title="Sharp punch, 4 of 10 mm, penalty 100 E/h")
    draw(
        "map_compressibility", "ratio", "element", wrong=lambda row: abs(row["value"] - 1) > 0.05,
        title="Squeezed cylinder: solves, force over the uppermost element's; framed: 5 % off",
        text=lambda row: f"{iterations(row)}\n{row['value']:.3f}",
    )  # fmt: skip
    draw(
        "map_sliding", "per_step", "lower_cells", "points", text=share, wrong=lambda row: row["error"] > 0.1,
        title="Block dragged over a block: solves, ripple of the pressing force; framed: above 0.1",
    )  # fmt: skip
    draw(
        "map_ratio", "slave_over_master", "points", text=share, wrong=lambda row: row["error"] > 0.01,
        title="Stacked blocks, 10 %: solves, error of the force; framed: above 0.01",
    )  # fmt: skip
    draw(
        "map_edge", "fillet", "cell", "points", text=share, wrong=lambda row: row["error"] > 0.01,
        title="Punch, 20 steps: solves, largest change of the force's increment over the force; framed: above 0.01",
    )  # fmt: skip
    draw(
        "map_limit", "reach", "way", text=share,
        title="Inflated sphere, limit point at 40.3 mm: solves, error (load: of displacement; arc length: of load)",
    )  # fmt: skip
    return [_failures(name, mine) for name, mine in rows.items()]


def _against_finest(rows: list[Row]) -> list[Row]:
    """Forces over that of the last element of the list at the same K/μ."""
    last = {row["ratio"]: row["value"] for row in rows if row["element"] == rows[-1]["element"]}
    return [row | {"value": row["value"] / last[row["ratio"]]} for row in rows]


def _failures(name: str, rows: list[Row]) -> str:
    """In one sentence, how many runs converge with each safeguard, contact points, element or way."""
    panel = next(key for key in ("control", "points", "element", "way") if key in rows[0])
    parts = []
    for value in dict.fromkeys(row[panel] for row in rows):
        mine = [row for row in rows if row[panel] == value]
        good = [row for row in mine if row["converged"] is True]
        cut = sum(row["cut_backs"] > 0 for row in good)
        parts.append(f"{panel} {value}: {len(good)} of {len(mine)} converge" + (f", {cut} after cut-backs" if cut else ""))
    return f"{name}: {'; '.join(parts)}"
