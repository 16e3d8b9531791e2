"""The results folder of a run: history, fields and tools for ParaView, summary and a picture, written as the run goes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.fields import Fields
from fenics_contact.output.files import complete, writing
from fenics_contact.output.history import HistoryFile, Summary, write_summary
from fenics_contact.output.pictures import DOTS, save
from fenics_contact.output.plot import drawing
from fenics_contact.output.series import FieldFiles
from fenics_contact.scene.scene import Scene


class Writer:
    """Writes every accepted step into a folder: history.csv, the fields and the tools, at the end summary.json and body.png.

    Whatever ends the run, complete steps are in the folder, and no file there is half-written. FolderError, on all ranks,
    where one cannot be written. clock: function () -> time stamp in results.pvd, which must grow: a continuation's t does
    not; rows: history rows of the steps before, where a run is resumed.
    """

    def __init__(
        self, folder: Path, scene: Scene, fields: Fields, clock: Callable[[], float], rows: Sequence[HistoryRow] = ()
    ) -> None:
        self.comm, self._clock = fields.system.comm, clock
        self.folder, self.scene, self.system, self.fields = folder, scene, fields.system, fields
        self._history: HistoryFile | None = None
        with writing(self.comm, folder, "history.csv"):
            if self.comm.rank == 0:
                self._history = HistoryFile(folder, rows)
        self._files = FieldFiles(folder, scene, len(rows))
        if not rows:
            self.write_fields(0)

    def write_fields(self, step: int) -> None:
        """Fields of accepted step number `step`, 0 for the start. Collective."""
        self.fields.update()
        state = self.system.state
        functions = {self.fields.displacement.name: state.u}  # at all nodes, in the place of that at the corners
        functions |= {field.name: field for field in self.fields.all if field is not self.fields.displacement}
        self._files.write(step, functions, state.tools, state.t, self._clock())

    def write_row(self, row: HistoryRow) -> None:
        """Append a row to history.csv. Collective."""
        with writing(self.comm, self.folder, "history.csv"):
            if self._history:
                self._history.write(row)

    def close(self, summary: Summary) -> None:
        """The history's end, and summary.json. Collective."""
        with writing(self.comm, self.folder, "summary.json"):
            if self._history is not None:
                self._history.close()
                write_summary(self.folder, summary)

    def finish(self, summary: Summary) -> None:
        """summary.json and body.png. Collective."""
        self.close(summary)
        self.fields.update()
        drawn = drawing(self.fields)
        if drawn is not None and not summary["verdict"]["converged"]:
            drawn = drawn.stopped_early()
        with writing(self.comm, self.folder, "body.png"):
            if drawn is not None:
                with complete(self.folder / "body.png") as draft:
                    save(replace(drawn, dots=DOTS).figure(), draft)
