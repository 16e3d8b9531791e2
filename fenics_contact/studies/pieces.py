"""What a run's time is made of: cost per tangent over the size of the mesh, shares of contact, kernels alone."""

import resource
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from matplotlib.figure import Figure

from fenics_contact import compat
from fenics_contact.assembly.cell_forms import CellForm
from fenics_contact.assembly.pattern import MatrixPattern
from fenics_contact.assembly.system import System
from fenics_contact.contact.pairing import CLOSEST, Pairing
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import two_blocks
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.materials import mooney_rivlin
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.studies.peers.ours import plate, pressed
from fenics_contact.studies.peers.plate import A1, A2, K
from fenics_contact.studies.runner import Row, Run, Study
from fenics_contact.studies.speed import written
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH
from fenics_contact.timing import Timers
from fenics_contact.types import Array

STEPS, FINE = 2, 0.1  # of the growing mesh, with this travel in each [mm]
GROWTH = ((10, 5), (20, 10), (32, 13), (50, 15), (70, 16))  # cells to the edge, over the height: 7.9e3 ... 1.0e6 unknowns
PRESSED, DRAGGED = 5, 3  # steps of the two blocks: 0.4 mm down each, then 0.5 mm sideways
CONTACT = ("search", "projection", "contact kernel", "insertion")
OUTPUTS = ("per_tangent_s", "krylov", "builds", "bulk_s", "contact_s", "linear_s", "rest_s", "peak_MB")
REPEATS = 5
MARKS = "<!-- pieces: written by `make bench` -->\n", "<!-- end of pieces -->\n"


def punch(cells: int, layers: int) -> Row:
    """A rough punch with sharp edges on the plate: the time of its steps alone."""
    rows = []
    for size in ((4, 2), (cells, layers)):  # a small one first: what is compiled or read when it is first called
        scene, timers = plate(*size), Timers()
        move = pressed(scene, 0.3, FINE * STEPS)
        rows.append(_carried(scene.system(move, timers=timers), timers, STEPS))
    return rows[-1]


def blocks(lower: list[int], upper: list[int]) -> Row:
    """A block pressed on a larger one and dragged over it, friction 0.3; cells per edge of both."""
    rows, steps = [], PRESSED + DRAGGED
    for below, above in (([4, 4, 2], [3, 3, 2]), (lower, upper)):  # a small one first, as with the punch
        mesh, timers = read_gmsh(two_blocks.build, lower_cells=below, upper_cells=above), Timers()
        scene = Scene(*(Body(mesh, name, mooney_rivlin(A1, A2, K)) for name in ("lower", "upper")))
        scene.fix("lower_bottom")
        scene.fix("upper_top", "y")
        scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -0.4 * min(t * steps, PRESSED)))
        scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 0.5 * max(t * steps - PRESSED, 0.0)))
        scene.contact(slave="upper_bottom", master="lower_top", friction=0.3, name="interface")
        rows.append(_carried(scene.system(timers=timers), timers, steps))
    return rows[-1]


def _carried(system: System, timers: Timers, steps: int) -> Row:
    """Counts and seconds (wall) of a path of equal steps, without set-up and output."""
    timers.seconds.clear()
    linear = LinearSolver(system)
    stepper, tangents, start = Newton(linear), 0, time.perf_counter()
    for i in range(steps):
        tangents += stepper.step(system, (i + 1) / steps).iterations
        system.trail.commit()
    wall, spent = time.perf_counter() - start, timers.seconds
    stages = {
        "bulk_s": spent["bulk tangent"] + spent["residual"],
        "contact_s": sum(spent.get(stage, 0.0) for stage in CONTACT),
        "linear_s": spent["factorisation"] + spent["solve"],
    }
    peak = max(system.comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))
    return {
        "unknowns": system.vector.getSize(), "iterations": tangents, "seconds": wall, "per_tangent_s": wall / tangents,
        "krylov": linear.iterations, "builds": linear.builds, **stages, "rest_s": wall - sum(stages.values()),
        "peak_MB": peak, "processes": system.comm.size,
    }  # fmt: skip


def forms(cells: int, layers: int) -> Row:
    """Seconds of assembling the tangent, the energy's second derivative, next to nothing; of two products with it."""
    scene = plate(cells, layers)
    u = compat.Function(scene.space)
    u.x.array[:] = 0.01 * np.random.default_rng(1).random(len(u.x.array))
    v, du, dx = ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space), scene.groups.dx(scene.bodies[0])
    material, F = mooney_rivlin(A1, A2, K), vp.deformation_gradient(u)
    J = ufl.det(F)
    B = J ** (-2 / 3) * ufl.dot(F, F.T)
    energy = material.psi(ufl.tr(B), ufl.tr(ufl.dot(B, B)), J) * dx
    nearly_nothing = ufl.inner(ufl.grad(du), ufl.grad(v)) * dx(metadata={"quadrature_degree": 0})
    compiled = {
        "rate_s": CellForm(vp.stress_power_rate(material, u, du, v, dx), symmetric=True),
        "energy_s": CellForm(ufl.derivative(ufl.derivative(energy, u, v), u, du), symmetric=True),
        "insertion_s": CellForm(nearly_nothing, symmetric=True),
    }
    matrix = MatrixPattern(compiled["rate_s"].whole, scene.space).matrix(np.empty(0, dtype=np.int64))
    x = compat.petsc_vector(u)
    y = x.duplicate()

    def assemble(form: CellForm) -> None:
        matrix.zeroEntries()
        form.add(matrix)
        matrix.assemble()

    work: dict[str, Callable[[], Any]] = {name: partial(assemble, form) for name, form in compiled.items()}
    work["products_s"] = lambda: (matrix.mult(x, y), matrix.mult(x, y))
    return {"cells_in_all": 4 * cells**2 * layers, **_interleaved(work)}


def kernels(points: int) -> Row:
    """Nanoseconds per point of the broad search and the projection onto a wavy grid with as many facets."""
    n = int(np.sqrt(points))
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    coords = np.stack([x, y, 0.01 * np.sin(9 * x) * np.sin(7 * y)], axis=-1).reshape(-1, 3)
    corner: Array = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    facets = np.stack([corner, corner + n + 1, corner + n + 2, corner + 1], axis=1), np.full(n * n, 4)
    slaves = coords[corner] + [0.37 / n, 0.41 / n, 0.1 / n]
    normals = np.tile([0.0, 0.0, -1.0], (len(slaves), 1))
    pairing = Pairing(facets, CLOSEST, 1.0 / n, 0.5 / n)
    lists = pairing.within(slaves, coords, 1.5 / n)
    work: dict[str, Callable[[], Any]] = {
        "search_ns": lambda: pairing.within(slaves, coords, 1.5 / n),
        "projection_ns": lambda: pairing._sought(slaves, normals, coords, lists, 1.0 / n),
    }
    return {name: 1e9 * seconds / len(slaves) for name, seconds in _interleaved(work).items()}


def _interleaved(work: Mapping[str, Callable[[], Any]]) -> dict[str, float]:
    """Median CPU seconds of functions called in turn, after one call of each."""
    samples: dict[str, list[float]] = {name: [] for name in work}
    for turn in range(REPEATS + 1):
        for name, call in work.items():
            start = time.process_time()
            call()
            if turn:
                samples[name].append(time.process_time() - start)
    return {name: float(np.median(one)) for name, one in samples.items()}


def studies(quick: bool) -> list[Study]:
    growth: list[Run] = [
        {"cells": cells, "layers": layers, "processes": processes} for cells, layers in GROWTH for processes in (1, 2)
    ]
    sliding: list[Run] = [{"lower": [40, 40, 10], "upper": [20, 20, 10]}, {"lower": [16, 16, 4], "upper": [10, 10, 4]}]
    form: list[Run] = [{"cells": 20, "layers": 10}]
    points: list[Run] = [{"points": 10**power} for power in (3, 4, 5, 6)]
    if quick:
        growth, sliding = [growth[0] | {"cells": 3, "layers": 1}], [{"lower": [4, 4, 1], "upper": [3, 3, 1]}]
        form, points = [{"cells": 3, "layers": 1}], points[:1]
    return [
        Study("growth", punch, growth, limit=1200.0, outputs=OUTPUTS),
        Study("sliding", blocks, sliding, outputs=OUTPUTS),
        Study("forms", forms, form, outputs=("rate_s", "energy_s", "insertion_s", "products_s", "cells_in_all")),
        Study("kernels", kernels, points, outputs=("search_ns", "projection_ns")),
    ]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """The chart of the growing mesh, the table in docs/speed.md, and its lines."""
    lines = ["| unknowns | processes | s per tangent | tangents | Krylov | kB per unknown | bulk, contact, solver, rest |"]
    lines += ["|---|---|---|---|---|---|---|"]
    grown = sorted(rows["growth"], key=lambda row: (row["unknowns"], row["processes"]))
    for row in grown:
        shares = ", ".join(f"{row[stage] / row['seconds']:.0%}" for stage in ("bulk_s", "contact_s", "linear_s", "rest_s"))
        memory = 1024 * row["peak_MB"] / row["unknowns"]
        lines.append(f"| {row['unknowns']} | {row['processes']} | {row['per_tangent_s']:.3g} | {row['iterations']} "
                     f"| {row['krylov']} | {memory:.1f} | {shares} |")  # fmt: skip
    sentences = []
    for processes in (1, 2):
        of = [(row["unknowns"], row["per_tangent_s"]) for row in grown if row["processes"] == processes]
        of = [point for point in of if point[0] > 5e4]
        if len(of) > 1:
            power = np.log(of[-1][1] / of[0][1]) / np.log(of[-1][0] / of[0][0])
            span = f"from {of[0][0]:.1e} to {of[-1][0]:.1e} unknowns"
            sentences.append(f"a tangent's cost grows as N^{power:.2f} {span}, processes: {processes}")
    (form,) = rows["forms"]
    sentences += [
        f"rate-form tangent / energy's second derivative: {form['rate_s'] / form['energy_s']:.2f}",
        f"a cell's tangent {1e6 * form['rate_s'] / form['cells_in_all']:.1f} µs, insertion "
        f"{1e6 * form['insertion_s'] / form['cells_in_all']:.1f} µs of it",
    ]
    for row in rows["sliding"]:
        sizes = " under ".join("×".join(str(n) for n in _numbers(row[name])) for name in ("lower", "upper"))
        sentences.append(f"contact / bulk, blocks of {sizes} cells, friction: {row['contact_s'] / row['bulk_s']:.3f}")
    for name in ("search", "projection"):
        spans = [row[f"{name}_ns"] for row in rows["kernels"]]
        sentences.append(f"{name}: {min(spans):.0f} … {max(spans):.0f} ns per point, 1e3 … 1e6 points")
    _draw(grown, charts / "growth.png")
    if not quick:
        machine = f"*{rows['growth'][0]['machine']}; two steps of 0.1 mm, friction 0.3, sharp edges.*"
        written(MARKS, [*lines, "", machine, "", *(f"- {sentence}" for sentence in sentences), ""])
    return sentences


def _numbers(value: object) -> list[int]:
    """Of a list, or of how a table holds it."""
    return [int(part) for part in str(value).strip("[]").split(",")]


def _draw(rows: list[Row], path: Path) -> None:
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    axis = figure.add_subplot(xscale="log", yscale="log")
    for processes in (1, 2):
        mine = [(row["unknowns"], row["per_tangent_s"]) for row in rows if row["processes"] == processes]
        if mine:
            axis.plot(*np.transpose(mine), marker="o", label=f"{processes} process{'es' * (processes > 1)}")
    axis.set_xlabel("unknowns", fontsize=LETTERS)
    axis.set_ylabel("seconds per tangent", fontsize=LETTERS)
    axis.tick_params(labelsize=LETTERS)
    axis.grid(which="major", linewidth=0.3)
    axis.legend(fontsize=LETTERS)
    figure.savefig(path, dpi=DOTS)
