"""Fields and tools over the steps for ParaView and the like: a file per step, whole or not there, and tables of contents."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from fenics_contact.assembly.pose import Pose
from fenics_contact.output.files import FIELDS, STEPS, TOOLS, StepFiles, complete, writing
from fenics_contact.output.grid import Grid, per_cell
from fenics_contact.output.tool_surfaces import SAG, piece, tool_surface
from fenics_contact.output.vtu import facets_file, read_collection, write_collection
from fenics_contact.scene.scene import Scene
from fenics_contact.types import Array, Floats, Function

BEYOND = 1.5  # of the diagonal of the bodies at rest: size of what is drawn of an endless tool at first
LONGEST_NAME = 60  # characters of a tool's name in the names of its files, which may have 255 bytes


class FieldFiles:
    """results.pvd with steps/*.vtu, the bodies with all fields, and for every tool tools/NAME.pvd with NAME_*.vtu.

    The bodies' points are those of the reference: warp them by the displacement; a tool's points are where it is. Rank 0
    writes, nodes and cells in the same order on any number of ranks. last: number of the step a resumed run goes on from, 0
    for none; later ones are dropped.
    """

    def __init__(self, folder: Path, scene: Scene, last: int = 0) -> None:
        """Collective."""
        self._folder, self._scene, self._comm = folder, scene, scene.mesh.comm
        self._grid = Grid(scene)
        self._size = 0.0 if self._grid.points is None else BEYOND * float(np.linalg.norm(np.ptp(self._grid.points, axis=0)))
        self._bodies, self._tools = _Series(StepFiles(folder / FIELDS)), list[_Series]()
        with writing(self._comm, folder, f"{STEPS}/ and {TOOLS}/"):
            if self._comm.rank == 0:
                names = file_names([tool.name for tool in scene.tools])
                self._tools = [_Series(StepFiles(folder / TOOLS / f"{name}.pvd")) for name in names]
                for series in (self._bodies, *self._tools):
                    series.take_up(last)

    def write(self, step: int, functions: Mapping[str, Function], poses: Sequence[Pose], t: float, stamp: float) -> None:
        """Write accepted step number `step`, 0 for the start, as of time `stamp`, which must grow. Collective.

        functions: {name: Function of degree 1, of the displacement's degree or constant per cell}, the displacement first;
        poses: of the tools; t: load parameter.
        """
        values = {name: self._grid.values(function) for name, function in functions.items()}
        in_cells = [name for name, function in functions.items() if per_cell(function)]
        with writing(self._comm, self._folder, f"the fields of step {step}"):
            file, body = self._grid.file, self._grid.body
            if file is not None and body is not None and self._grid.points is not None:
                points = {name: _plain(array) for name, array in values.items() if array is not None}
                cells = {"body": body} | {name: points.pop(name) for name in in_cells}
                displacement: Floats = next(iter(points.values()))
                self._write_tools(step, self._grid.points, displacement, poses, stamp)
                whole = _times(stamp) | {"t": np.array([t])}
                whole |= {f"body_{b.group}": np.array([i], dtype=np.int32) for i, b in enumerate(self._scene.bodies)}
                self._bodies.add(step, stamp, partial(file.write, points=points, cells=cells, whole=whole))

    def _write_tools(self, step: int, X: Floats, u: Floats, poses: Sequence[Pose], stamp: float) -> None:
        """X, u (n, 3): the bodies' nodes at rest and their displacement, beside which endless tools are drawn."""
        rest, about = (0.5 * (x.min(axis=0) + x.max(axis=0)) for x in (X, X + u))
        for tool, series, pose in zip(self._scene.tools, self._tools, poses, strict=True):
            size, place = piece(tool, self._size, rest, about, pose)
            file = facets_file(*tool_surface(tool, size, place, pose, SAG * self._size / size))
            whole = _times(stamp) | {f"travel_{self._scene.units.length}": pose.travel[None]}
            series.add(step, stamp, partial(file.write, points={}, cells={}, whole=whole))


def file_names(names: Sequence[str]) -> list[str]:
    """A name for the files of each, of letters, digits, '.', '-' and '_'; no two are alike, in capitals or not."""
    out: list[str] = []
    for name in names:
        safe = re.sub(r"[^\w.-]", "_", name)[:LONGEST_NAME].lstrip(".") or "_"
        taken, number, base = {other.casefold() for other in out}, 2, safe
        while safe.casefold() in taken:
            safe, number = f"{base}_{number}", number + 1
        out.append(safe)
    return out


def _plain(values: Array) -> Array:
    """Numbers (n,) in the place of one component (n, 1)."""
    return values[:, 0] if values.shape[1] == 1 else values


def _times(stamp: float) -> dict[str, Array]:
    """What VTK's readers take a file's time from."""
    return {"TimeValue": np.array([stamp])}


class _Series:
    """A table of contents and the files of its steps, each complete before it gets its name. Used on rank 0 alone."""

    def __init__(self, files: StepFiles) -> None:
        self._files = files
        self._entries: dict[float, str] = {}

    def take_up(self, last: int) -> None:
        """Go on from step `last` of what a run has left, if any: files of later steps go."""
        self._files.path(0).parent.mkdir(exist_ok=True)
        if not last or not self._files.index.exists():
            return
        found = read_collection(self._files.index)
        late = {stamp for stamp, name in found.items() if (self._files.step(name) or 0) > last}
        self._entries = {stamp: name for stamp, name in found.items() if stamp not in late}
        self._publish()
        for stamp in late:
            (self._files.index.parent / found[stamp]).unlink(missing_ok=True)

    def add(self, step: int, stamp: float, write: Callable[[Path], None]) -> None:
        """A step's file, written by write(path)."""
        with complete(self._files.path(step)) as draft:
            write(draft)
        self._entries[stamp] = self._files.name(step)
        self._publish()

    def _publish(self) -> None:
        with complete(self._files.index) as draft:
            write_collection(draft, self._entries)
