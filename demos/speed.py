"""Speed as ratios taken in one run, with FElupe from PyPI beside it where it is installed (felupe, pypardiso).

    python3 demos/speed.py                   # the table of ratios (`make bench`, a few minutes)
    python3 demos/speed.py growth 1000000    # cost per iteration up to that many unknowns, on 1 and 2 processes: runs what
                                             # results/speed/growth.csv lacks (delete it to start anew) and draws its chart
    python3 demos/speed.py kernels           # search and contact kernel alone, 1e3 to 1e6 points
    python3 demos/speed.py --quick           # forms, parity and kernels at a size where times say nothing, seconds

Everything is written to results/speed/*.csv; growth and kernels draw a chart. Times are CPU seconds of one thread where one
process is measured, medians of three interleaved runs; wall seconds where 1 and 2 processes are compared.
"""

import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
import numpy as np
import ufl
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import Body, Scene, compat, mooney_rivlin, read_gmsh, rigid_punch
from fenics_contact.assembly.pattern import MatrixPattern
from fenics_contact.contact.pairing import Pairing, seek_closest
from fenics_contact.kernels.rigid_element import contact_elements
from fenics_contact.meshes import punch_plate, two_blocks
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.timing import Timers

try:
    import felupe
    from pypardiso import spsolve
except ImportError:
    felupe = None

OUT = Path("results/speed")
ENVIRONMENT = os.environ.copy()  # from before MPI's start in here: mpirun does not nest
RUBBER = {"a1": 0.1863, "a2": 0.0098, "K": 5.0}
SMALLEST, SMALL, LARGE = (4, 2), (10, 5), (20, 10)  # cells to the punch's edge and over the height: 20x20x5 and 40x40x10
LARGE_BLOCKS, SMALL_BLOCKS = ((40, 40, 10), (20, 20, 10)), ((16, 16, 4), (10, 10, 4))  # lower and upper: 3600, 900 points
PRESSED, SLIDING = 5, 3  # steps of the two blocks: 0.4 mm down each, then 0.5 mm sideways
GROWTH = [(20, 10), (32, 13), (50, 15), (70, 16)]  # 5.5e4, 1.8e5, 4.9e5, 1.0e6 unknowns
CONTACT = ("search", "projection", "contact kernel")


# -- what is measured -------------------------------------------------------------------------------------------------
def plate(cells, patch=False):
    inside, layers = cells
    mesh = read_gmsh(punch_plate.build, inside=inside, outside=inside, layers=layers, ratio=1.0, patch=patch)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(**RUBBER)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("bottom", "z")
    return scene


def carried(system, timers, steps):
    """Seconds (CPU and wall), counts and stages of a load path of equal steps, without set-up and output."""
    timers.seconds.clear()
    solver = LinearSolver(system)
    stepper, iterations = Newton(solver), 0
    cpu, wall = time.process_time(), time.perf_counter()
    for i in range(steps):
        iterations += stepper.step(system, (i + 1) / steps).iterations
        system.commit()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    peak = system.comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return {
        "unknowns": system.vector.getSize(), "processes": system.comm.size, "steps": steps, "iterations": iterations,
        "krylov": solver.iterations, "factorisations": solver.builds, "solver": solver.method, "cpu": cpu, "wall": wall,
        "peak_MB_per_process": max(peak), **timers.seconds,
    }  # fmt: skip


def parity(cells, steps):
    """The scene all codes agree on: the top nodes under the punch moved down 0.2 mm per step."""
    scene, timers = plate(cells, patch=True), Timers()
    scene.prescribe("under_punch", "z", -0.2 * steps)
    return carried(scene.system(timers=timers), timers, steps)


def punch(cells, steps, friction, travel=0.2):
    """The real punch: unilateral, sharp edge, `travel` mm per step."""
    scene, timers = plate(cells), Timers()
    tool = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", tool, friction, name="top")
    return carried(scene.system({tool: (0, 0, -travel * steps)}, timers=timers), timers, steps)


def blocks(lower, upper):
    """A block pressed on a larger one and dragged over it, friction 0.3, points as by default; cells per edge of both."""
    mesh, timers = read_gmsh(two_blocks.build, lower_cells=lower, upper_cells=upper), Timers()
    scene, steps = Scene(*(Body(mesh, name, mooney_rivlin(**RUBBER)) for name in ("lower", "upper"))), PRESSED + SLIDING
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -0.4 * min(t * steps, PRESSED)))
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 0.5 * max(t * steps - PRESSED, 0.0)))
    scene.contact(slave="upper_bottom", master="lower_top", friction=0.3, name="interface")
    return carried(scene.system(timers=timers), timers, steps)


def felupe_parity(cells, steps):
    """CPU seconds per iteration of the parity scene in FElupe (neo-Hooke, its cheapest law)."""
    mesh = felupe.Cube(b=(40, 40, 10), n=(2 * cells[0] + 1, 2 * cells[0] + 1, cells[1] + 1))
    field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(mesh), dim=3)])
    solid = felupe.SolidBody(felupe.NeoHooke(mu=2 * (RUBBER["a1"] + RUBBER["a2"]), bulk=RUBBER["K"]), field)
    x, y, z = mesh.points.T
    bounds = {
        "x": felupe.Boundary(field[0], fx=0, skip=(0, 1, 1)),
        "y": felupe.Boundary(field[0], fy=0, skip=(1, 0, 1)),
        "z": felupe.Boundary(field[0], fz=0, skip=(1, 1, 0)),
        "tool": felupe.Boundary(field[0], mask=(z > 9.99) & (x < 20.01) & (y < 20.01), skip=(1, 1, 0)),
    }
    iterations, start = 0, time.process_time()
    for step in range(1, steps + 1):
        bounds["tool"].update(-0.2 * step)
        dof0, dof1 = felupe.dof.partition(field, bounds)
        prescribed = felupe.dof.apply(field, bounds, dof0)
        newton = felupe.newtonraphson(
            items=[solid], dof0=dof0, dof1=dof1, ext0=prescribed, verbose=0, solver=spsolve, tol=1e-8
        )
        iterations += newton.iterations
    return (time.process_time() - start) / iterations


def tangent_forms(cells=LARGE):
    """Median CPU seconds of assembling the rate form and the second derivative of the energy, and of what bounds them."""
    scene = plate(cells)
    u = compat.Function(scene.space)
    u.x.array[:] = 0.01 * np.random.default_rng(1).random(len(u.x.array))
    v, du, dx = ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space), scene.dx(scene.bodies[0])
    material, F = scene.bodies[0].material, vp.deformation_gradient(u)
    J = ufl.det(F)
    B = J ** (-2 / 3) * ufl.dot(F, F.T)
    energy = material.psi(ufl.tr(B), ufl.tr(ufl.dot(B, B)), J) * dx
    forms = {
        "rate": compat.compile_form(vp.stress_power_rate(material, u, du, v, dx)),
        "energy": compat.compile_form(ufl.derivative(ufl.derivative(energy, u, v), u, du)),
        "insertion": compat.compile_form(ufl.inner(ufl.grad(du), ufl.grad(v)) * dx(metadata={"quadrature_degree": 0})),
    }
    matrix = MatrixPattern(forms["rate"], scene.space).matrix(np.empty(0, dtype=np.int64))
    x = compat.petsc_vector(u)
    y = x.duplicate()

    def assemble(form):
        matrix.zeroEntries()
        compat.assemble_matrix(matrix, form)
        matrix.assemble()

    work = {name: (lambda form=form: assemble(form)) for name, form in forms.items()}
    work["twice through the matrix"] = lambda: (matrix.mult(x, y), matrix.mult(x, y))
    streams = [np.ones(2 * 10**7) for _ in range(3)]
    work["triad"] = lambda: triad(*streams, 3.0)
    seconds = interleaved(work, repeats=5)
    blocks = matrix.getInfo()["nz_used"] / 9
    cells, nodes = compat.cell_dofs(scene.space).shape
    # blocks of 9 numbers read and written, their columns; per cell the places and displacements of its nodes
    moved = {"assembly": blocks * (2 * 72 + 4) + cells * nodes * (3 + 3) * 8, "triad": 3 * 8 * len(streams[0])}
    return seconds, {name: 1e-9 * moved[name] / seconds[of] for name, of in (("assembly", "rate"), ("triad", "triad"))}


@numba.njit(cache=True)
def triad(a, b, c, factor):
    """McCalpin's STREAM triad."""
    for i in range(len(a)):
        a[i] = b[i] + factor * c[i]


def interleaved(work, repeats=3):
    """Median CPU seconds of functions called in turn, after one call of each."""
    samples = {name: [] for name in work}
    for turn in range(repeats + 1):
        for name, call in work.items():
            start = time.process_time()
            call()
            if turn:
                samples[name].append(time.process_time() - start)
    return {name: float(np.median(s)) for name, s in samples.items()}


# -- processes of their own -------------------------------------------------------------------------------------------
def apart(processes, name, *arguments, **environment):
    """A measurement of this file under mpirun; its dict."""
    command = ["mpirun", "-n", str(processes), sys.executable, __file__, "--measure", name, json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT | environment)
    if done.returncode:
        raise SystemExit(f"{name}{arguments} on {processes}: {done.stderr[-1500:]}")
    return json.loads(done.stdout.splitlines()[-1])


def before_first_step(_):
    """Wall seconds from a scene to its system, compilation included."""
    start = time.perf_counter()
    punch(SMALL, 1, 0.3)
    return {"wall": time.perf_counter() - start}


def write(name, rows):
    OUT.mkdir(parents=True, exist_ok=True)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with open(OUT / f"{name}.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


# -- the three programs -----------------------------------------------------------------------------------------------
def ratios():
    table = []

    def row(what, value, target):
        table.append({"what": what, "value": round(value, 4), "target": target})
        print(f"{what:62} {value:8.3f}   target {target}", flush=True)

    forms, bandwidth = tangent_forms()
    row("rate-form tangent / energy's second derivative", forms["rate"] / forms["energy"], "<= 0.6")
    row("tangent's assembly / twice through the matrix", forms["rate"] / forms["twice through the matrix"], "")
    row("share of the insertion in the tangent's assembly", forms["insertion"] / forms["rate"], "")
    row("memory bandwidth of a thread, triad [GB/s]", bandwidth["triad"], "")
    row("tangent's assembly: matrix and geometry [GB/s]", bandwidth["assembly"], "")
    row("tangent's assembly / memory bandwidth", bandwidth["assembly"] / bandwidth["triad"], "")
    for name, cells, steps in (("20x20x5", SMALL, 10), ("40x40x10", LARGE, 2)):
        ours, peers = [], []
        for _ in range(3 if felupe else 1):
            run = parity(cells, steps)
            ours.append(run["cpu"] / run["iterations"])
            peers.append(felupe_parity(cells, 1 if cells == LARGE else steps) if felupe else np.nan)
        row(f"parity {name}, CPU s per iteration", np.median(ours), "")
        row(f"parity {name}, ours / FElupe per iteration", np.median(np.divide(ours, peers)), "<= 0.33")
    runs = {(n, c): [apart(n, "punch", c, 5, 0.3) for _ in range(3)] for c in (SMALL, LARGE) for n in (1, 2)}
    write("punch", [run for group in runs.values() for run in group])

    def median(processes, cells, amount):
        return float(np.median([amount(run) for run in runs[processes, cells]]))

    row(
        "contact / bulk tangent, 40x40x10, friction",
        median(1, LARGE, lambda r: share(r, *CONTACT) / r["bulk tangent"]),
        "<= 0.05",
    )
    for name, target, cells in (
        ("40x40x10 under 20x20x10", "<= 0.15", LARGE_BLOCKS),
        ("16x16x4 under 10x10x4", "", SMALL_BLOCKS),
    ):
        slides = [apart(1, "blocks", *cells) for _ in range(3)]
        write(f"blocks_{cells[0][0]}", slides)
        ratio = np.median([share(run, *CONTACT, "insertion") / run["bulk tangent"] for run in slides])
        row(f"contact / bulk tangent, {name}, friction", float(ratio), target)
    known = ("bulk tangent", "factorisation", "solve")
    row(
        "neither linear solve nor bulk tangent / run",
        median(1, LARGE, lambda r: 1 - share(r, *known) / r["wall"]),
        "<= 0.10",
    )
    parts = (*CONTACT, "insertion", "bulk tangent", "residual")
    for cells, name in ((SMALL, "20x20x5"), (LARGE, "40x40x10")):
        one, two = (median(n, cells, lambda r: share(r, *parts) / r["iterations"]) for n in (1, 2))
        row(f"assembly and contact, 1 process / 2, {name}", one / two, ">= 1.7" if cells == LARGE else "")
        one, two = (median(n, cells, lambda r: r["wall"] / r["iterations"]) for n in (1, 2))
        row(f"whole run, 1 process / 2, {name}", one / two, ">= 1.4" if cells == LARGE else "")
    row("Newton iterations per step, friction 0.3, 40x40x10", median(1, LARGE, lambda r: r["iterations"] / 5), "<= 5")
    row("Krylov iterations per Newton iteration, 40x40x10", median(1, LARGE, lambda r: r["krylov"] / r["iterations"]), "")
    with tempfile.TemporaryDirectory() as empty:
        cold = apart(1, "before_first_step", None, XDG_CACHE_HOME=empty, NUMBA_CACHE_DIR=empty)["wall"]
    row("scene and first step, cold caches [s]", cold, "<= 60")
    row("the same again, caches warm [s]", apart(1, "before_first_step", None)["wall"], "<= 5")
    write("ratios", table)


def share(run, *stages):
    return sum(run.get(stage, 0.0) for stage in stages)


def known_rows(name):
    """Rows of a CSV file written before, numbers as numbers; none where there is no file."""
    path = OUT / f"{name}.csv"
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return [{k: _number(v) for k, v in row.items() if v != ""} for row in csv.DictReader(file)]


def _number(text):
    try:
        return float(text)
    except ValueError:
        return text


def growth(largest):
    rows = known_rows("growth")
    for cells in GROWTH:
        unknowns = 3 * (2 * cells[0] + 1) ** 2 * (cells[1] + 1)
        known = {row["processes"] for row in rows if row["unknowns"] == unknowns}
        for processes in {1, 2} - known if unknowns <= largest else ():
            run = apart(processes, "punch", cells, 2, 0.3, 0.1)
            rows.append(run | {"wall_per_iteration": run["wall"] / run["iterations"]})
            print({k: round(v, 3) if isinstance(v, float) else v for k, v in rows[-1].items()}, flush=True)
            write("growth", sorted(rows, key=lambda row: (row["unknowns"], row["processes"])))
    draw_growth(known_rows("growth"))


def draw_growth(rows):
    """The chart of all rows, wherever they were gathered, and the exponents between the smallest and largest of each."""
    figure = Figure(figsize=(6, 4), layout="tight")
    axes = figure.add_subplot(xlabel="unknowns", ylabel="wall seconds per Newton iteration", xscale="log", yscale="log")
    for processes in (1, 2):
        of = [(r["unknowns"], r["wall_per_iteration"]) for r in rows if r["processes"] == processes]
        if not of:
            continue
        axes.plot(*np.transpose(of), marker="o", label=f"{processes} process{'es' * (processes > 1)}")
        if len(of) > 1:
            slope = np.log(of[-1][1] / of[0][1]) / np.log(of[-1][0] / of[0][0])
            print(f"{processes} process(es): cost per iteration grows as N^{slope:.2f}   target <= N^1.15")
    axes.legend()
    figure.savefig(OUT / "growth.png", dpi=150)


def kernels(sizes=(10**3, 10**4, 10**5, 10**6)):
    """Search of a master surface and the rigid contact element, on flat surfaces of 1e3 to 1e6 points."""
    scene = plate((4, 2))
    tool = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 9.9))
    scene.contact("top", tool, 0.3, name="top", points=3)
    system, rows = scene.system(), []
    for points in sizes:
        seconds = interleaved({"rigid element": rigid_elements(system, points), **master_search(points)})
        rows += [{"what": what, "points": points, "ns_per_point": 1e9 * t / points} for what, t in seconds.items()]
        print(points, {what: f"{1e9 * t / points:.0f} ns/point" for what, t in seconds.items()}, flush=True)
    write("kernels", rows)
    figure = Figure(figsize=(6, 4), layout="tight")
    axes = figure.add_subplot(xlabel="slave points", ylabel="ns per point, one thread", xscale="log", yscale="log")
    for what in dict.fromkeys(row["what"] for row in rows):
        axes.plot(
            *np.transpose([(r["points"], r["ns_per_point"]) for r in rows if r["what"] == what]), marker="o", label=what
        )
    axes.legend()
    figure.savefig(OUT / "kernels.png", dpi=150)


def rigid_elements(system, points):
    """The elements of a small scene repeated up to a number of points, all closed, with tangent."""
    term = system.contacts[0]
    s, tool, law = term.surface, term.partner.tool, term.trial.law
    n = -(-points // s.area.size)

    def many(array):
        return np.concatenate([array] * n)

    x = s.X + system.state.u.x.array.reshape(-1, 3)[s.nodes]
    at = tuple(many(a) for a in (x, s.a, s.area, s.spacing))
    law = (*(many(a) for a in (law.eps_n, law.eps_t, s.stiffness)), law.friction, 0.0)
    (ne, nq, k), points = s.a.shape, s.area.shape
    out = [np.empty((ne, k, 3)), np.empty((ne, 3 * k, 3 * k)), np.empty((ne, nq, 3))]
    out += [np.empty(points), np.empty(points, dtype=np.int32), np.empty(points), np.empty(points)]
    out, history = tuple(many(a) for a in out), (many(term.trial.history.anchors[0]), many(term.trial.history.shift))
    place = (tool.kind, tool.shape, tool.origin, tool.axes, np.zeros(3))
    return lambda: contact_elements(at, place, law, history, np.empty(0), True, out)


def master_search(points):
    """Broad search and projection of points on a wavy master grid with as many facets."""
    n = int(np.sqrt(points))
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    coords = np.stack([x, y, 0.01 * np.sin(9 * x) * np.sin(7 * y)], axis=-1).reshape(-1, 3)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    facets = np.stack([corner, corner + n + 1, corner + n + 2, corner + 1], axis=1), np.full(n * n, 4)
    slaves = coords[corner] + [0.37 / n, 0.41 / n, 0.1 / n]
    normals = np.tile([0.0, 0.0, -1.0], (len(slaves), 1))
    pairing = Pairing(facets, seek_closest, 1.0 / n, 0.5 / n)
    lists = pairing.within(slaves, coords, 1.5 / n)
    return {
        "search": lambda: pairing.within(slaves, coords, 1.5 / n),
        "projection": lambda: pairing._sought(slaves, normals, coords, lists, 1.0 / n),
    }


def quick():
    """Every kind of measurement once, on one process: what the programs above are made of still works."""
    steps, (forms, _) = 2, tangent_forms(SMALLEST)
    run = parity(SMALLEST, steps)
    table = [
        {"what": "rate-form tangent / energy's second derivative", "value": forms["rate"] / forms["energy"]},
        {"what": "parity, Newton iterations per step", "value": run["iterations"] / steps},
        {"what": "blocks, contact seconds", "value": share(blocks((8, 8, 2), (5, 5, 2)), *CONTACT, "insertion")},
    ]
    print(*(f"{row['what']:62} {row['value']:8.3f}" for row in table), sep="\n", flush=True)
    write("ratios", table)
    kernels((10**3, 10**4))


MEASUREMENTS = {"punch": punch, "blocks": blocks, "parity": parity, "before_first_step": before_first_step}

if __name__ == "__main__":
    program = sys.argv[1] if len(sys.argv) > 1 else "ratios"
    if program == "--measure":
        measured = MEASUREMENTS[sys.argv[2]](*json.loads(sys.argv[3]))
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(measured))
    elif program == "growth":
        growth(float(sys.argv[2]) if len(sys.argv) > 2 else 2e5)
    elif program == "kernels":
        kernels()
    elif program == "--quick":
        quick()
    else:
        ratios()
