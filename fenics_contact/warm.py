"""Compiles ahead what usual scenes run: a small scene of each kind in a process of its own, as many at once as cores.

What is compiled stays where Numba and FFCx keep it: beside the package and in the user's cache, or in the latter alone
where the package's own folder may not be written.
"""

import compileall
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gmsh
from tqdm import tqdm

from fenics_contact import compat
from fenics_contact.contact.tools import Tool, rigid_plane, rigid_punch
from fenics_contact.kernels.law import traction
from fenics_contact.mesh_io import NamedMesh, read_gmsh
from fenics_contact.meshes import rectangles
from fenics_contact.options import Method, Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import Isotropic, mooney_paper, mooney_rivlin, neo_hooke

PACKAGE = Path(__file__).parent
HIGH, GAP = 10.0, 0.1  # of a block, between two [mm]
# lowest corner and edge of the square of the base [mm], cells per edge
BLOCKS = {"lower": ((0.0, 0.0, 0.0), 20.0, 3), "upper": ((5.0, 5.0, HIGH + GAP), 10.0, 2)}
PRESSED = 0.5  # mm
PAPER, RIVLIN, HOOKE = mooney_paper(0.19, 0.01, K=5.0), mooney_rivlin(0.19, 0.01, K=5.0), neo_hooke(mu=0.4, K=5.0)
PUNCH, PLANE = rigid_punch(5.0, 10.0, (10.0, 10.0, HIGH)), rigid_plane((0.0, HIGH, 0.0), (0.0, -1.0, 0.0))

Drawn = Callable[[tuple[str, ...]], NamedMesh]  # of the names of blocks


# -- the lower block, or an upper one above it ----------------------------------------------------------------------------
def hexahedra(names: tuple[str, ...]) -> NamedMesh:
    """Blocks, each with its lower and upper face, NAME_below and NAME_above."""
    return read_gmsh(_draw, names=names, recombine=True)


def tetrahedra(names: tuple[str, ...]) -> NamedMesh:
    """The same of tetrahedra."""
    return read_gmsh(_draw, names=names, recombine=False)


def _draw(names: tuple[str, ...], recombine: bool) -> None:
    model, geo = gmsh.model, gmsh.model.geo
    for name in names:
        (x, y, z), edge, cells = BLOCKS[name]
        corners = [geo.addPoint(x + a * edge, y + b * edge, z) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, cells + 1)
        geo.mesh.setTransfiniteSurface(base)
        if recombine:
            geo.mesh.setRecombine(2, base)
        (_, top), (_, volume), *_ = geo.extrude([(2, base)], 0, 0, HIGH, numElements=[2], recombine=recombine)
        geo.synchronize()
        for dim, tag, group in ((3, volume, name), (2, base, f"{name}_below"), (2, top, f"{name}_above")):
            model.setPhysicalName(dim, model.addPhysicalGroup(dim, [tag]), group)
    model.mesh.generate(3)


def quadrilaterals(names: tuple[str, ...], triangles: bool = False) -> NamedMesh:
    """Blocks in the plane, y upwards, each with its lower and upper side, NAME_ymin and NAME_ymax."""
    blocks = {"lower": ((0.0, 0.0), (20.0, HIGH), (4, 2)), "upper": ((0.0, HIGH + GAP), (10.0, HIGH), (3, 2))}
    return read_gmsh(rectangles.build, rectangles={name: blocks[name] for name in names}, triangles=triangles)


# -- kinds of scenes ------------------------------------------------------------------------------------------------------
def bodies(out: Path, draw: Drawn, law: Isotropic, points: int | str = "averages", **element: Any) -> None:
    """The upper block is pressed on the lower one, which is held."""
    mesh = draw(("lower", "upper"))
    scene = Scene(Body(mesh, "lower", law), Body(mesh, "upper", law), accept_locking=True, **element)
    below, above, across, along = ("ymin", "ymax", "x", "y") if mesh.plane else ("below", "above", "xy", "z")
    scene.fix(f"lower_{below}")
    scene.fix(f"upper_{above}", across)
    scene.prescribe(f"upper_{above}", along, -PRESSED)
    scene.contact(f"upper_{below}", f"lower_{above}", 0.3, points=points)
    solve(scene, steps=1, out=Output(out, progress=False)).require()


def tool(out: Path, draw: Drawn, law: Isotropic, pressing: Tool, linear: str = "auto", **element: Any) -> None:
    """A tool is pressed on the lower block, which is held."""
    mesh = draw(("lower",))
    scene = Scene(Body(mesh, "lower", law), accept_locking=True, **element)
    below, above, way = ("ymin", "ymax", (0, -PRESSED, 0)) if mesh.plane else ("below", "above", (0, 0, -PRESSED))
    scene.fix(f"lower_{below}")
    scene.contact(f"lower_{above}", pressing, 0.3)
    result = solve(
        scene, move={pressing: way}, steps=1, method=Method(linear=linear), out=Output(out, progress=False)
    ).require()
    result.plot("contact_pressure", out / "pressure.png")


# the longest first; no two of one form, for which FFCx would let one of them wait for ten seconds only
KINDS: dict[str, Callable[[Path], None]] = {
    "bodies": partial(bodies, draw=hexahedra, law=RIVLIN),
    "Gauss points": partial(bodies, draw=hexahedra, law=PAPER, points=3),
    "bodies of degree 2": partial(bodies, draw=hexahedra, law=HOOKE, degree=2),
    "plane bodies of degree 2": partial(bodies, draw=quadrilaterals, law=HOOKE, degree=2, plane="strain"),
    "tool": partial(tool, draw=hexahedra, law=PAPER, pressing=PUNCH, linear="iterative"),
    "tool, degree 2, mixed": partial(tool, draw=hexahedra, law=RIVLIN, pressing=PUNCH, degree=2, element="mixed"),
    "tool, tetrahedra, mixed": partial(tool, draw=tetrahedra, law=RIVLIN, pressing=PUNCH, degree=2, element="mixed"),
    "tool, tetrahedra of degree 2": partial(tool, draw=tetrahedra, law=HOOKE, pressing=PUNCH, degree=2),
    "bodies of tetrahedra": partial(bodies, draw=tetrahedra, law=HOOKE),
    "neo-Hooke": partial(tool, draw=hexahedra, law=HOOKE, pressing=PUNCH),
    "plane bodies": partial(bodies, draw=quadrilaterals, law=RIVLIN, plane="strain"),
    "axisymmetric tool": partial(
        tool, draw=partial(quadrilaterals, triangles=True), law=RIVLIN, pressing=PLANE, plane="axisymmetric"
    ),
}


# -- the work, shared out -------------------------------------------------------------------------------------------------
def warm(kind: str | None = None) -> str:
    """Run the scenes whose code may not be in the caches yet, or one kind in this process; says what was done."""
    if kind is not None:
        with TemporaryDirectory() as folder:
            KINDS[kind](Path(folder) / "out")
        return f"compiled: {kind}"
    mark, state = cache_folders()[0] / "warm.json", _state()
    if _is_warm(mark, state):
        return f"nothing to compile ({mark})"
    start = time.perf_counter()
    compileall.compile_dir(PACKAGE, quiet=2)  # where Python itself keeps nothing, PYTHONDONTWRITEBYTECODE: 0.25 s per start
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(tqdm(pool.map(compile_kind, KINDS), "compiling", len(KINDS)))
    mark.write_text(json.dumps({"state": state, "files": [str(file) for file in _compiled()]}))
    return f"compiled in {time.perf_counter() - start:.0f} s: scenes start at once"


def compile_kind(kind: str) -> None:
    command = [sys.executable, "-m", "fenics_contact", "warm", kind]
    alone = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=alone)
    if done.returncode:
        raise RuntimeError(f"the scene '{kind}' failed:\n{done.stderr}")


def cache_folders() -> tuple[Path, Path]:
    """Where Numba keeps the kernels and FFCx the forms."""
    return compat.kernels_folder(traction), compat.forms_folder()


def _compiled() -> list[Path]:
    kernels, forms = cache_folders()
    return sorted([*kernels.glob("*.nbi"), *forms.glob("*.so")])


def _state() -> str:
    """What compiled code depends on, in short: the package's text and the versions of what compiles it."""
    text = b"".join(file.read_bytes() for file in sorted(PACKAGE.rglob("*.py")))
    return hashlib.sha256(text + str(compat.versions()).encode()).hexdigest()


def _is_warm(mark: Path, state: str) -> bool:
    """Whether the scenes have been run with this state, and all that they left is still there."""
    if not mark.exists():
        return False
    left = json.loads(mark.read_text())
    return left["state"] == state and all(Path(file).exists() for file in left["files"])
