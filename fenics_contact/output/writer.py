"""The results folder of a run: history, XDMF for ParaView, summary and a picture, written as the run goes."""

import os
from pathlib import Path

from fenics_contact.output.fields import Fields, exterior_surface
from fenics_contact.output.history import HistoryFile, write_summary
from fenics_contact.output.pictures import body_picture
from fenics_contact.output.series import Series, StepSeries


class FolderError(ValueError):
    """The output folder cannot be written; raised on all ranks before work starts."""


def prepare_folder(path, comm):
    """Make the folder on rank 0 and see that it can be written."""
    problem = None
    if comm.rank == 0:
        try:
            Path(path).mkdir(parents=True, exist_ok=True)
            if not os.access(path, os.W_OK):
                problem = "it is not writable"
        except OSError as error:
            problem = error.strerror
    if problem := comm.bcast(problem):
        raise FolderError(f"output folder '{path}': {problem}; choose another with out=...")
    return Path(path)


class Writer:
    """Writes every accepted step into a folder: history.csv and the fields, at the end summary.json and body.png.

    clock: function () -> time stamp in results.xdmf, which must grow: a continuation's t does not; safe: fields go into
    files that a kill leaves intact; rows: history rows of the steps before, where a run is resumed.
    """

    def __init__(self, folder, scene, system, clock, safe=False, rows=None):
        self.comm, self._clock = system.comm, clock
        self.folder, self.scene, self.system = folder, scene, system
        self.fields = Fields(scene, system)
        self._history = HistoryFile(folder, rows or ()) if self.comm.rank == 0 else None
        mesh = scene.mesh.domain
        self._series = StepSeries(folder, mesh, None if rows is None else len(rows)) if safe else Series(folder, mesh)
        if rows is None:
            self.write_fields(0)

    def write_fields(self, step):
        """Fields of accepted step number `step`, 0 for the start."""
        self.fields.update()
        self._series.write(step, self.fields.all, self._clock())

    def write_row(self, row):
        if self._history:
            self._history.write(row)

    def finish(self, summary):
        self._series.close()
        u = self.system.state.u
        corners, values = exterior_surface(self.scene, u, u.x.array[2::3])
        if self.comm.rank == 0:
            self._history.close()
            write_summary(self.folder, summary)
            label = f"vertical displacement [{self.scene.units.length}]"
            body_picture(self.folder / "body.png", corners, values, label, f"t = {self.system.state.t:.4g}")
