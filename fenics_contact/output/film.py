"""Film: a drawing of every accepted step, taken while a run goes on, and an animation of them."""

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from fenics_contact.agreement import agreed
from fenics_contact.assembly.system import System
from fenics_contact.output.fields import Fields
from fenics_contact.output.late import animations
from fenics_contact.output.pictures import Drawing
from fenics_contact.output.plot import drawing, refuse_backend, refuse_limits
from fenics_contact.output.views import Angles
from fenics_contact.scene.scene import Scene
from fenics_contact.values import SceneError, count

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS = 110  # per inch


class Film:
    """Takes a drawing after every accepted step, or every n-th: solve(..., record={"frame": film}), then film.save("a.gif").

    field, mirror, view, backend as for `Result.plot`; its column in the history is the number of drawings so far. A further
    run it is given to begins anew.
    drawings: those of this run, in the order of its steps, on rank 0; a drawing holds the bodies' surface, not the volume.
    """

    _fields: Fields | None

    def __init__(
        self,
        field: str | None = None,
        *,
        mirror: str = "",
        view: str | Angles | None = None,
        every: int = 1,
        backend: str | None = None,
    ) -> None:
        self.field, self.mirror, self.view, self.every = field, mirror, view, count(every, "Film: every")
        self.backend = backend
        self._comm: MPI.Comm | None = None
        self.begin()

    def begin(self) -> None:
        """A run begins: drawings of an earlier one go."""
        self.drawings, self._fields = list[Drawing](), None
        self._steps = self._taken = 0

    def __call__(self, view: object) -> float:
        """Number of drawings before this step's."""
        return float(self._taken)

    def take(self, scene: Scene, system: System) -> None:
        """Draw the system's state, which has been accepted. Collective."""
        self._steps += 1
        if (self._steps - 1) % self.every:
            return
        if self._fields is None:
            refuse_backend(self.backend, system.comm)
            self._fields, self._comm = Fields(scene, system), system.comm
        self._fields.update()
        box = self.drawings[-1].box if self.drawings else None
        found = drawing(self._fields, self.field, self.mirror, self.view, box)
        self._taken += 1
        if found is not None:
            self.drawings.append(replace(found, backend=self.backend))

    def save(self, path: str | PathLike[str], seconds: float = 0.15, limits: tuple[float, float] | None = None) -> None:
        """Write all drawings as an animation, .gif or .mp4, in one view and range of colours; seconds: of each. Collective.

        SceneError, on all ranks, where nothing was taken, limits do not rise, the file cannot be written, or it is
        .mp4 and there is no ffmpeg.
        """
        refuse_limits(limits)
        if self._comm is None:
            raise SceneError('the film has no drawings: give it to a run, solve(..., record={"frame": film})')
        with agreed(self._comm, f"animation '{path}'", SceneError):
            if self._comm.rank == 0:
                animate(self.drawings, Path(path), seconds, limits)


def animate(
    drawings: Sequence[Drawing], path: Path, seconds: float = 0.15, limits: tuple[float, float] | None = None
) -> None:
    """Write drawings of one model as a GIF or MP4. The view is that of the drawing with the largest value."""
    writer = _writer(path, 1.0 / seconds)
    best = max(drawings, key=lambda one: (not one.colours.blank, one.colours.high))
    frames = [replace(one, view=best.view, dots=2 * DOTS) for one in drawings]
    ends = np.array([one.extent() for one in frames])
    extent = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
    limits = limits or common_limits(drawings)
    figure: Figure = frames[0].figure(limits, extent=extent)
    writer.setup(figure, path, dpi=DOTS)
    for frame in frames:
        frame.fill(figure, limits, extent=extent)
        writer.grab_frame()
    writer.finish()


def common_limits(drawings: Sequence[Drawing]) -> tuple[float, float]:
    """Limits of the colours for all drawings; those without a value, of a step without contact, have no say."""
    seen = [one.colours for one in drawings if not one.colours.blank] or [one.colours for one in drawings]
    return min(tint.low for tint in seen), max(tint.high for tint in seen)


def _writer(path: Path, per_second: float) -> Any:
    """What writes an animation with the ending of this path."""
    ending = path.suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise SceneError(f"animation '{path}': give it the ending .gif or .mp4")
    if ending == ".gif":
        return animations.PillowWriter(fps=per_second)
    if not animations.FFMpegWriter.isAvailable():
        raise SceneError(f"animation '{path}': MP4 takes ffmpeg, Debian's package ffmpeg; install it, or save a .gif")
    # frames for players that know 4:2:0 alone
    return animations.FFMpegWriter(fps=per_second, codec="h264", extra_args=["-pix_fmt", "yuv420p"])
