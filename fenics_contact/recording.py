"""What a run keeps of every accepted step, and says while it goes on."""

import math
import pathlib
import sys
from collections.abc import Callable, Mapping, Sequence

from tqdm import tqdm

from fenics_contact.contact.images import IMAGES, Images
from fenics_contact.contact.overlap import Overlaps
from fenics_contact.options import Output
from fenics_contact.output.columns import ARCS, Columns, HistoryRow, damping_column
from fenics_contact.output.fields import Fields
from fenics_contact.output.files import clear_results, writing
from fenics_contact.output.film import Film
from fenics_contact.output.results import Results
from fenics_contact.output.view import View
from fenics_contact.output.writer import Writer
from fenics_contact.restart import Keeper
from fenics_contact.scene.build import Built
from fenics_contact.scene.functions import number_of
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.symmetry import SYMMETRY, Symmetry
from fenics_contact.solvers.arc_length import ArcReport
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.verdict import OVERLAPS, Verdict
from fenics_contact.values import SceneError, shown, text

SEPARATORS = ',"\r\n'  # of a CSV file
TURNED = "cells inside out"  # by which a run remembers what it has said of these

Recorded = dict[str, Callable[[View], float]]  # what the user adds to the history


class Recorder:
    """What a run keeps of every accepted step: a history row, fields, a checkpoint; and its progress bar.

    Called with the step's report, its seconds and whether it is on the schedule, on all ranks.
    """

    def __init__(
        self,
        scene: Scene,
        built: Built,
        output: Output,
        keeper: Keeper | None,
        named: tuple[Columns, Recorded],
        arcs: bool,
    ) -> None:
        """named: the history's columns, and what the user adds; arcs: whether a stage is a continuation."""
        self.scene, self.system, self.keeper = scene, built.system, keeper
        self.columns, self.extra = named
        folder = None if output.folder is None else pathlib.Path(output.folder)
        system = self.system
        self._overlaps, self._images, self._symmetry = Overlaps(system), Images(system), Symmetry(scene, system)
        self._films = [value for value in self.extra.values() if isinstance(value, Film)]
        for film in self._films:
            film.begin()
        self.arcs, self._augments = arcs, bool(system.augmented) or system.stabilised
        self.verdict, self.history = (keeper.verdict, keeper.rows) if keeper else (Verdict(), [])
        self.history[:] = [self.columns.fitted(row, self._of_arc(ArcReport()), self.extra) for row in self.history]
        self._told = len(self.verdict.notes)  # those that have been printed
        with system.timers("output"):
            clock = (lambda: len(self.history)) if arcs else (lambda: system.state.t)
            if folder and not (keeper and keeper.resumed):
                self._start_anew(folder)
            so_far = self.columns.energies(self.history)
            as_drawn = built.beginning.as_drawn
            self.results = Results(scene, system, built.loads, so_far, built.harder, as_drawn)
            if keeper:
                keeper.follow(self.results)
            self.view = View(scene, system)
            self.writer = None
            if folder:
                fields = Fields(scene, system, self.results.surfaces)
                self.writer = Writer(folder, scene, fields, clock, list(self.history))
        layout = "{elapsed} {postfix}" if arcs else "{l_bar}{bar}| {elapsed} {postfix}"  # t's end is not known
        self.silent = not output.progress or system.comm.rank != 0
        self.bar = tqdm(total=sum(system.stages.durations), disable=self.silent, bar_format=layout)

    def _start_anew(self, folder: pathlib.Path) -> None:
        """An earlier run's files go; then comes a checkpoint of the start: what is killed from here on can be resumed."""
        with writing(self.system.comm, folder, "in the place of older results"):
            if self.system.comm.rank == 0:
                clear_results(folder)
        if self.keeper:
            self.keeper.keep()

    def __call__(self, report: StepReport, seconds: float, on_schedule: bool) -> None:
        self.verdict.remark_on(OVERLAPS, self._overlaps.remarks())
        self.verdict.remark_on(IMAGES, self._images.remarks())
        self.verdict.remark_on(SYMMETRY, self._symmetry.remarks())
        smallest_J, turned = self.system.cells.look()
        self.verdict.remark_on(TURNED, turned)
        news, self.verdict.said = self.verdict.said, []  # no checkpoint need hold what the log has had
        with self.system.timers("output"):
            self.history.append(self._row(report, seconds, smallest_J))
            for film in self._films:
                film.take(self.scene, self.system)
            if self.writer and on_schedule:
                self.writer.write_fields(len(self.history))
            if self.keeper:
                self.keeper.keep()
            if self.writer:
                self.writer.write_row(self.history[-1])
        t = self.system.state.t
        self.bar.set_postfix_str(self._words(report), refresh=self.arcs)
        news += self.verdict.notes[self._told :]
        self._told = len(self.verdict.notes)
        if not self.bar.disable and news:
            tqdm.write("\n".join(news), file=sys.stderr)
        if not self.arcs:
            self.bar.n = min(t, self.bar.total)  # steps may go past t = 1, if only by rounding; tqdm would warn of it
            self.bar.update(0)

    def _words(self, report: StepReport) -> str:
        name = self.system.stages.name
        words = f"step {len(self.history)}, {f'{name}, ' if name else ''}t = {self.system.state.t:.4g}"
        words += f", {report.iterations} iterations"
        if cuts := self.verdict.cuts:
            words += f", {cuts} cut-backs so far"
        if loads := [contact.load for contact in self.view.contacts.values()]:
            words += f", greatest contact load {max(loads):.4g} {self.scene.units.force}"
        return words

    def remark(self, notes: list[str]) -> None:
        """Notes on the run as a whole, each said once."""
        self.verdict.notes += [note for note in notes if note not in self.verdict.notes]
        news = self.verdict.said + self.verdict.notes[self._told :]
        self.verdict.said, self._told = [], len(self.verdict.notes)
        if news and not self.silent:
            tqdm.write("\n".join(news), file=sys.stderr)

    def _row(self, report: StepReport, seconds: float, smallest_J: float) -> HistoryRow:
        state, result = self.system.state, self.results.of_step(report.jumped)
        if report.jumped and self.system.damping is not None:
            self.system.damping.took(self.results.balance.let_go, result.energies.strain)
        view = self.view.show(result)
        row = self.columns.row(len(self.history) + 1, state.t, report, seconds, smallest_J, result)
        if name := self.system.stages.name:
            row = {"step": row["step"], "stage": name} | row
        if self._augments:
            row["augmentations"] = report.augmentations
        row |= self._own(view)
        if self.system.damped:
            row[damping_column(self.scene.units)] = self.results.balance.let_go
        return row | self._of_arc(report if isinstance(report, ArcReport) else ArcReport())

    def _own(self, view: View) -> HistoryRow:
        """The user's columns; of each the first value that is not finite is noted."""
        row = {name: number_of(self.system.comm, f"record '{name}'", value, view) for name, value in self.extra.items()}
        for name in [name for name, value in row.items() if not math.isfinite(value)]:
            words = f"record '{name}' is not finite"
            if not any(note.startswith(words) for note in self.verdict.notes):
                step, t = len(self.history) + 1, self.system.state.t
                self.verdict.notes.append(f"{words}: {row[name]:g}, first in step {step}, at t = {t:.6g}")
        return row

    def _of_arc(self, report: ArcReport) -> HistoryRow:
        """The columns of a run with a stage by arc length; {} of another."""
        values = (report.limit_point, report.station, report.negative, report.bifurcation)
        return dict(zip(ARCS, values, strict=True)) if self.arcs else {}


def columns_of(record: Recorded, scene: Scene, turning: Sequence[str] = ()) -> Columns:
    """The columns of a scene's history, which no two things of the scene may share, nor the user's own; turning: names of
    the tools that turn."""
    rough = {contact.name: contact.friction.mu > 0.0 for contact in scene.contacts}
    groups = list(dict.fromkeys("+".join(support.group) for support in scene.supports))
    tied = list(dict.fromkeys(tie.hub.name for tie in scene.ties))
    tools = [tool.name for tool in scene.tools]
    moved = [name for name in turning if name in tools]  # others are refused with the motions
    columns = Columns(tools, rough, groups, scene.units, scene.section, moved, tied, [pair.column for pair in scene.pairs])
    if shared := columns.clash():
        raise SceneError(
            f"two contacts, tools, supports or pairs would share the columns '{shared}_...'; give one another name"
        )
    if not isinstance(record, Mapping):
        raise SceneError(f"record = {shown(record)}: give {{name: function of a View}}")
    taken = columns.all()
    for name, value in record.items():
        if set(text(name, "record: name")) & set(SEPARATORS):
            raise SceneError(f"record {shown(name)}: commas, quotes and line breaks separate columns; choose another name")
        if name in taken:
            raise SceneError(f"record '{name}': the history has a column of that name; choose another")
        if not callable(value):
            raise SceneError(f"record '{name}' must be a function of the run's View that gives one number, not {value!r}")
    return columns
