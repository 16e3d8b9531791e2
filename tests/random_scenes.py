"""Random scenes, each from its seed: stated here, run and judged by `scene_judge.py`.

python3 tests/random_scenes.py FIRST COUNT [--ranks 1 2] [--out scenes.csv] [--limit SECONDS]

runs COUNT scenes from seed FIRST, each in a process of its own, one line each and a count of every class at the end; with
several numbers of ranks they must give the same forces. A night's worth: `0 200 --ranks 1 2`. The classes: converged (and
checked), cured (a verdict whose remedy, done, gives a checked answer), impossible (a verdict that is true of the statement),
wrong, uncured, unclear, refused, exception, timeout. `--show SEED` prints a statement.
"""

import argparse
import csv
import json
import os
import signal
import subprocess
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import gmsh
import numpy as np

from fenics_contact import (
    ArcSteps,
    Body,
    Load,
    Method,
    Penalty,
    Scene,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    rigid_surface,
)
from fenics_contact.compat import Constant
from fenics_contact.meshes import box, tool_surfaces, two_blocks
from fenics_contact.solid.materials import Isotropic

ROOT = Path(__file__).parent.parent
GOOD = ("converged", "cured", "impossible")
BREAKS = {  # t at which a path turns, and where it is then: how far pressed, dragged
    "press": ([0.0, 1.0], [0.0, 1.0], [0.0, 0.0]),
    "drag": ([0.0, 0.4, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]),
    "lift": ([0.0, 0.4, 0.8, 1.0], [0.0, 1.0, 1.0, -0.2], [0.0, 0.0, 1.0, 1.0]),
    "push": ([0.0, 1.0], [0.0, 1.0], [0.0, 0.0]),
    "push aside": ([0.0, 0.5, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]),
}


@dataclass(frozen=True)
class Statement:
    """A scene in plain values; lengths in units of about a millimetre, pressures of about one MPa.

    what: "tool" on one body, "pair" of bodies, or "both": a tool on the upper one of a pair. hold: how the lower body is
    held; size, cells: of the only or lower body; upper, upper_cells: of the other; depth: pressed so far [length]; drag
    (2,): then dragged; force, aside: pushed so hard [force], then aside by that share of it; length,
    pressure: the units that it is computed in; method: of solve; arcs: whether it goes by arc length.
    """

    seed: int
    what: str
    tool: str
    path: str
    hold: str
    load: str
    tetrahedra: bool
    degree: int
    element: str
    shear: float
    second: float
    ratio: float
    size: tuple
    cells: tuple
    upper: tuple
    upper_cells: tuple
    place: tuple
    gap: float
    depth: float
    drag: tuple
    force: float
    aside: float
    radius: float
    half: float
    fillet: float
    friction: float
    floor_friction: float
    points: object
    penetration: float | None
    steps: int
    amount: float
    length: float
    pressure: float
    axes: str = ""  # along which symmetry planes hold a body that contacts alone hold otherwise
    penalty_factor: float | None = None
    tangential_share: float | None = None
    method: Method = Method()
    arcs: bool = False

    @property
    def young(self):
        return 9.0 * self.ratio * self.shear / (3.0 * self.ratio + 1.0)

    @property
    def top(self):
        """Height of the surface that is pressed; the lower body's lies at 0."""
        return 0.0 if self.what == "tool" else self.upper[2]

    @property
    def pressed_height(self):
        return self.size[2] + self.top

    @property
    def pushed(self):
        return self.path.startswith("push")

    @property
    def cell(self):
        """Edge of a cell of the slave surface."""
        size, cells = (self.size, self.cells) if self.what == "tool" else (self.upper, self.upper_cells)
        return max(size[0] / cells[0], size[1] / cells[1])


# -- drawn by chance --------------------------------------------------------------------------------------------------
def draw(seed):
    """The Statement of a seed."""
    rng = np.random.default_rng(seed)

    def one_of(*values, p=None):
        return values[rng.choice(len(values), p=p)]

    def between(low, high, log=False):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))) if log else rng.uniform(low, high))

    what = one_of("tool", "pair", "both", p=(0.55, 0.25, 0.2))
    path = one_of(*BREAKS, p=(0.25, 0.3, 0.15, 0.18, 0.12))
    if what == "both" and path == "lift":
        path = "drag"
    tools = ("plane", "sharp punch", "filleted punch", "sphere", "cylinder", "meshed ball", "meshed punch")
    tool = "" if what == "pair" else one_of(*tools)
    friction = one_of(0.0, between(0.05, 0.6), between(0.6, 1.5), p=(0.3, 0.45, 0.25))
    tetrahedra = bool(rng.random() < 0.3)
    ratio = between(2.0, 500.0, log=True)
    shear, second = between(0.2, 1.0), one_of(0.0, between(0.05, 0.3))
    if tetrahedra and what != "tool":
        ratio = between(2.0, 5.0)  # a deformable master needs degree 1, and these lock beyond
    degree = 1 if what != "tool" else one_of(1, 2)
    if tetrahedra and ratio > 5.0:
        degree = 2
    element = "displacement"
    if degree == 1 and not tetrahedra:
        element = one_of("displacement", "mixed") if ratio < 40.0 else "mixed"
    elif degree == 2:
        element = one_of("displacement", "mixed") if ratio < 15.0 else "mixed"
    most = 6 if degree == 1 else 3
    size = (
        (between(4, 9), between(4, 9), between(2, 4)) if what == "tool" else (between(7, 10), between(6, 9), between(2, 3))
    )
    cells = tuple(int(rng.integers(most - 1 - (i == 2) * (most // 3), most + 1 - (i == 2) * (most // 3))) for i in range(3))
    upper = between(3, 5), between(3, 5), between(1.2, 3.5)
    upper_cells = tuple(int(n) for n in rng.integers((2, 2, 1), (5, 5, 3)))
    pressed = size if what == "tool" else upper
    height = size[2] + (0.0 if what == "tool" else upper[2])
    depth = height * between(*((0.03, 0.25) if tool in ("", "plane") else (0.03, 0.3)))
    if what == "both":
        depth = min(depth, 0.3 * upper[2])
    radius = max(pressed[:2]) * between(0.8, 2.0)
    half = min(pressed[:2]) * between(0.2, 0.35)
    edges = zip(pressed[:2], (cells if what == "tool" else upper_cells)[:2], strict=False)
    half = max(half, 1.1 * max(side / count for side, count in edges) / degree)  # or it falls between the nodes
    if what == "both" and tool in ("sharp punch", "meshed punch"):
        tool = "sphere"
    # a push by about the strain that a path of that depth makes
    young, strain = 9.0 * ratio * shear / (3.0 * ratio + 1.0), between(0.03, 0.25)
    area = {"": pressed[0] * pressed[1], "plane": pressed[0] * pressed[1], "cylinder": pressed[1] * np.sqrt(radius * depth)}
    area |= dict.fromkeys(("sphere", "meshed ball"), np.pi * radius * depth)
    force = young * strain * float(area.get(tool, 4.0 * half**2))
    if what == "both":
        force = min(force, 0.15 * young * upper[0] * upper[1])
    points = one_of(None, "nodes", 3, int(rng.integers(1, 5)), p=(0.5, 0.2, 0.15, 0.15))
    if degree == 2 and (tetrahedra or tool.startswith("meshed")):
        points = one_of(3, 4)
    elif degree == 2 and points in (1, 2):
        points = 3
    deformable = what != "tool" or tool.startswith("meshed")
    penetration = between(1e-4, 1e-2) if rng.random() < 0.12 else None
    if penetration is not None:
        points = (3 if tetrahedra and degree == 2 else "nodes") if not deformable else (1 if degree == 1 else 3)
    hold = one_of("fixed", "floor", "symmetry", p=(0.5, 0.25, 0.25)) if what == "tool" else "fixed"
    load = one_of("", "pressure", "body force", p=(0.6, 0.2, 0.2))
    if load == "pressure" and hold != "fixed":
        load = "body force"
    axes = "xy" if hold == "symmetry" or (friction == 0.0 and (hold == "floor" or what == "both")) else ""
    if what == "pair" and path.startswith("push") and friction == 0.0:
        axes = "xy"
    aside = friction * one_of(between(0.3, 0.9), 1.3, p=(0.75, 0.25)) if path == "push aside" else 0.0
    turn, far = between(0.0, 2.0 * np.pi), between(0.1, 0.8) * (pressed[2] if tool in ("", "plane") else 0.5 * pressed[0])
    if what == "both":
        far = min(far, 0.7 * upper[2])
    stabilise = path.startswith("push") and rng.random() < 0.7
    length, pressure = one_of((1.0, 1.0), (1e-3, 1e6), (25.4, 145.0), p=(0.6, 0.3, 0.1))
    slack = 0.2 * (size[0] - upper[0]), 0.2 * (size[1] - upper[1])
    place = (float(rng.uniform(-0.2, 0.2) * pressed[0]), float(rng.uniform(-0.2, 0.2) * pressed[1]))
    return Statement(
        seed, what, tool, path, hold, load, tetrahedra, degree, element, shear, second, ratio, size, cells, upper,
        upper_cells,
        place if what != "pair" else tuple(float(rng.uniform(-s, s)) for s in slack),
        0.0 if path.startswith("push") else one_of(0.0, between(0.005, 0.05) * height),
        depth, (far * float(np.cos(turn)), far * float(np.sin(turn))), force, aside, radius, half,
        half * between(0.4, 0.9), friction, friction * one_of(0.6, 1.4), points, penetration, int(rng.integers(3, 13)),
        between(0.01, 0.08), length, pressure, axes, method=Method(stabilise=stabilise),
    )  # fmt: skip


# -- stated in the package's words ------------------------------------------------------------------------------------
def build(s):
    """(scene, tool or None, options of solve) of a Statement."""
    mesh = read_gmsh(blocks, s=s)
    law = rubber(mesh, s.shear * s.pressure, s.second, s.ratio)
    names = ("box",) if s.what == "tool" else ("lower", "upper")
    laws = [law, rubber(mesh, 1.4 * s.shear * s.pressure, 0.0, min(s.ratio, 5.0 if s.tetrahedra else s.ratio))]
    parts = [Body(mesh, name, law) for name, law in zip(names, laws, strict=False)]
    scene = Scene(*parts, degree=s.degree, element=s.element)
    steps = ArcSteps(until=Load(1.0), first=1 / s.steps) if s.arcs else times(s)
    options = {"steps": steps, "method": s.method}
    _hold(s, scene)
    _load(s, scene)
    tool = None
    if s.what != "tool":
        _contact(s, scene, "upper_bottom", "lower_top", "joint")
    if s.what != "pair":
        tool = make_tool(s)
        _contact(s, scene, "zmax" if s.what == "tool" else "upper_top", tool, "top")
        options["push" if s.pushed else "move"] = {tool: lambda t: drive(s, t)}
    elif s.pushed:
        scene.traction("upper_top", lambda t: drive(s, t) / (s.length**2 * s.upper[0] * s.upper[1]))
    else:
        for i, axis in enumerate("xyz"):
            scene.prescribe("upper_top", axis, lambda X, t, i=i: np.full(len(X), drive(s, t)[i]))
    return scene, tool, options


def drive(s, t):
    """Travel (3,) [length], or force (3,) [force] where the path is pushed, in the units that are computed in."""
    at, pressed, dragged = BREAKS[s.path]
    down, along = np.interp(t, at, pressed), np.interp(t, at, dragged)
    if s.pushed:
        way = np.array(s.drag) / np.linalg.norm(s.drag)
        sideways = along * s.aside * s.force * way
        return s.pressure * s.length**2 * np.array([*sideways, -down * s.force])
    return s.length * np.array([along * s.drag[0], along * s.drag[1], -down * (s.gap + s.depth)])


def times(s, finer=1):
    """The schedule: steps of each stretch of the path, `finer` times as many as stated."""
    at = BREAKS[s.path][0]
    parts = [max(round(s.steps * (b - a)), 1) * finer for a, b in zip(at, at[1:], strict=False)]
    ends = zip(at, at[1:], parts, strict=False)
    return np.concatenate([a + (b - a) * np.arange(1, n + 1) / n for a, b, n in ends])


def rubber(mesh, shear, second, ratio):
    """Mooney-Rivlin, whose numbers are Constants: forms of all scenes of a kind are compiled once."""
    a1, a2, K = (Constant(mesh.domain, x) for x in (0.5 * shear * (1.0 - second), 0.5 * shear * second, ratio * shear))

    def isochoric(I1, I2):
        return a1 * (I1 - 3) + a2 * ((I1**2 - I2) / 2 - 3)

    def volumetric(J):
        return K / 2 * (J - 1) ** 2

    name = f"Mooney-Rivlin, mu = {shear:.4g}, K / mu = {ratio:.4g}"
    return Isotropic(name, lambda I1, I2, J: isochoric(I1, I2) + volumetric(J), shear, ratio * shear, isochoric, volumetric)


def blocks(s):
    """The bodies' mesh: the pressed surface above the origin, the lower body's top at z = 0."""
    L = s.length
    size, origin = L * np.array(s.size), L * np.array([-s.size[0] / 2, -s.size[1] / 2, -s.size[2]])
    upper, above = L * np.array(s.upper), L * np.array([-s.upper[0] / 2, -s.upper[1] / 2, 0.0])
    if s.what == "pair":
        above[:2] += L * np.array(s.place)
    parts = [("box" if s.what == "tool" else "lower", size, s.cells, origin)]
    parts += [] if s.what == "tool" else [("upper", upper, s.upper_cells, above)]
    if s.tetrahedra:
        _tetrahedra(parts)
    elif s.what == "tool":
        box.build(tuple(size), s.cells, tuple(origin))
    else:
        two_blocks.build(tuple(size), s.cells, tuple(origin), tuple(upper), s.upper_cells, tuple(above))


def _tetrahedra(parts):
    """The groups of meshes/box.py and meshes/two_blocks.py on irregular tetrahedra."""
    for name, size, cells, origin in parts:
        volume = gmsh.model.occ.addBox(*origin, *size)
        gmsh.model.occ.synchronize()
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
        edge = float(np.mean(size / cells))
        gmsh.model.mesh.setSize(gmsh.model.getBoundary([(3, volume)], recursive=True), edge)
        for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
            middle = (np.array(gmsh.model.occ.getCenterOfMass(2, face)) - origin) / size
            axis = int(np.abs(middle - 0.5).argmax())
            end = middle[axis] > 0.5
            label = "xyz"[axis] + ("max" if end else "min")
            if len(parts) > 1:
                label = name + "_" + ({False: "bottom", True: "top"}[bool(end)] if axis == 2 else label)
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), label)
    gmsh.model.mesh.generate(3)


def make_tool(s):
    L = s.length
    x, y, z = L * np.array([*s.place, s.top + s.gap])
    facets = L * s.radius * 0.15
    if s.tool == "plane":
        return rigid_plane((0.0, 0.0, z), (0.0, 0.0, -1.0), name="tool")
    if s.tool in ("sharp punch", "filleted punch"):
        fillet = L * s.fillet if s.tool == "filleted punch" else 0.0
        return rigid_punch(L * s.half, L * 2.0 * s.half, (x, y, z), fillet=fillet, name="tool")
    if s.tool == "sphere":
        return rigid_sphere(L * s.radius, (x, y, z + L * s.radius), name="tool")
    if s.tool == "cylinder":
        return rigid_cylinder(L * s.radius, (x, y, z + L * s.radius), name="tool")
    if s.tool == "meshed ball":
        centre = (x, y, z + L * s.radius)
        return rigid_surface(
            tool_surfaces.ball, group="ball", radius=L * s.radius, centre=centre, mesh_size=facets, reach=0.8, name="tool"
        )
    sizes = {"half_width": L * s.half, "height": L * 2.0 * s.half, "fillet": L * 0.8 * s.half, "mesh_size": L * 0.3 * s.half}
    return rigid_surface(tool_surfaces.punch, group="punch", face=(x, y, z), **sizes, name="tool")


def _hold(s, scene):
    if s.what != "tool":
        scene.fix("lower_bottom")
    elif s.hold == "fixed":
        scene.fix("zmin")
    else:
        floor = rigid_plane((0.0, 0.0, -s.length * s.size[2]), name="ground")
        scene.contact("zmin", floor, 0.0 if s.hold == "symmetry" else s.floor_friction, name="floor")
    for axis in s.axes:
        scene.fix(f"{axis}min" if s.what == "tool" else f"upper_{axis}min", axis)


def _load(s, scene):
    amount = s.amount * s.shear * s.pressure
    if s.load == "pressure":
        scene.pressure("xmax" if s.what == "tool" else "lower_xmax", amount)
    elif s.load == "body force":
        scene.body_force((0.0, 0.0, -amount / (s.length * s.size[2])))


def _contact(s, scene, slave, master, name):
    penetration = s.penetration and s.penetration * s.length * s.cell
    points = s.points
    if isinstance(master, str) and penetration is not None:
        points = 1
    elif isinstance(master, str) and points == "nodes":
        points = "corners"
    numbers = {"penalty": Penalty(factor=s.penalty_factor, share=s.tangential_share), "penetration": penetration}
    scene.contact(slave, master, s.friction, points=points, name=name, **numbers)


# -- run, each in a process of its own --------------------------------------------------------------------------------
def child(seed, ranks, limit):
    """What a seed's own process says of it on so many ranks: a dict, with class "exception" or "timeout" where it fails."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX", "PRTE", "OMPI_MCA_orte"))}
    env |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "PYTHONPATH": str(ROOT)}
    env |= {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}
    command = [sys.executable, str(Path(__file__).with_name("scene_judge.py")), str(seed)]
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command, "once"]
    run = subprocess.Popen(
        command, env=env, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        out, err = run.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return {"seed": seed, "class": "timeout", "says": f"no end within {limit} s"}
    if run.returncode != 0 or not out.strip():
        last = [line for line in err.strip().splitlines() if line.strip() and "---" not in line]
        return {"seed": seed, "class": "exception", "says": f"exit {run.returncode}: {last[-1] if last else ''}"}
    return json.loads(out.strip().splitlines()[-1])


SAME = 1e-7  # of the largest force: forces on other ranks; steps end at 1e-8


def compared(one, other):
    """The other run's dict, its class "wrong" where its forces on the same steps are not those of the first."""
    if other["class"] not in GOOD or not one.get("forces") or one.get("t") != other.get("t"):
        return other
    a, b = np.array(one["forces"]), np.array(other["forces"])
    off = np.abs(a - b).max() / max(np.abs(a).max(), 1e-300)
    if off > SAME:
        return other | {"class": "wrong", "says": f"on other ranks forces differ by {off:.1e}"}
    return other


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1])
    parser.add_argument("--out")
    parser.add_argument("--limit", type=float, default=300.0)
    parser.add_argument("--show", type=int)
    asked = parser.parse_args()
    if asked.show is not None:
        print(json.dumps(asdict(draw(asked.show)), indent=1))
        return 0
    columns, counts = ["seed", "ranks", "class", "kind", "by", "seconds", "statement", "says"], Counter()
    if asked.out:
        Path(asked.out).parent.mkdir(parents=True, exist_ok=True)
    out = open(asked.out, "w", newline="") if asked.out else open(os.devnull, "w")  # noqa: SIM115
    with out:
        table = csv.DictWriter(out, columns, extrasaction="ignore", restval="")
        table.writeheader()
        for seed in range(asked.first, asked.first + asked.count):
            first = None
            for ranks in asked.ranks:
                found = child(seed, ranks, asked.limit)
                found = compared(first, found) if first else found
                first = first or found
                counts[ranks, found["class"]] += 1
                table.writerow(found | {"ranks": ranks})
                out.flush()
                words = [f"{found.get(name, '')}" for name in columns[2:]]
                print(f"{seed:5d} on {ranks}: " + " | ".join(word for word in words if word), flush=True)
    for (ranks, kind), count in sorted(counts.items()):
        print(f"{ranks} ranks, {kind}: {count}")
    return int(any(kind not in GOOD for _, kind in counts))


if __name__ == "__main__":
    sys.exit(main())
