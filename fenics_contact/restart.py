"""Checkpoints of a run, and the way back from one: on any number of ranks, refused where the scene is another."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import lru_cache, partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.agreement import agreed
from fenics_contact.assembly.memory import Memory
from fenics_contact.assembly.stages import End
from fenics_contact.assembly.system import System
from fenics_contact.options import Output
from fenics_contact.output.checkpoint import CheckpointFiles, Torn
from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.files import prepare_folder, results_in, writing
from fenics_contact.output.results import Results
from fenics_contact.scene.start import Drives, LeftTool, Start
from fenics_contact.scene.stated import Statement, first_difference
from fenics_contact.solvers.continuation import Path as Continuation
from fenics_contact.solvers.softened import Softened
from fenics_contact.solvers.verdict import Verdict
from fenics_contact.types import Floats
from fenics_contact.values import SceneError

STRAINED = "most strained"  # the field of dofs where bodies had most strain energy in the stage that is on


class Keeper:
    """Keeps the accepted steps of a run in its folder: `verdict` and `rows` are those so far, from the start or `resumed`.

    steppers: of each stage its continuation's Path, or None: it remembers more than the System, memory() -> ({name: local
    array like u}, {name: plain values}) and recall(fields, numbers), which raises ValueError where they do not fit; and its
    Newton stepper, one for all stages, that remembers whether softer penalties have helped, or None.
    """

    def __init__(
        self,
        output: Output,
        system: System,
        steppers: Sequence[tuple[Continuation | None, Softened | None]],
        stated: Callable[[tuple[float, ...]], Statement],
        left: Callable[[], Drives],
    ) -> None:
        """output: with a folder, and the number of steps from one checkpoint to the next; stated: function of the largest
        share reached of each stage begun -> `statement` of the run, the same where it is resumed; left: what holds the last
        state, see `drives_left`."""
        folder = self._folder = Path(output.folder or "")
        self.comm, self.every = system.comm, int(output.checkpoint)
        self._paths = [path for path, _ in steppers]
        self._softened = next((softened for _, softened in steppers if softened), None)
        self._stages, self._left = system.stages, left
        self.verdict, self.resumed = Verdict(), False
        self._written = -1  # rows in the last checkpoint
        self._verdict: dict[str, Any] = {}  # as it was when the last step was accepted, before a run's end is judged
        self.rows: list[HistoryRow] = []
        self._results: Results | None = None
        self._strained: Floats | None = None  # of the steps behind, as what is kept
        self._kept: tuple[dict[str, Any] | None, dict[str, Any]] = None, {}  # of the steps behind, until Results follow
        self._memory, self._files, self._stated = Memory(system), CheckpointFiles(folder), lru_cache(maxsize=1)(stated)
        if output.resume:
            self._take_up()

    def _take_up(self) -> None:
        arrays, content = None, None
        with agreed(self.comm, f"reading the checkpoints in '{self._folder}'", SceneError):
            if self.comm.rank == 0:
                arrays, content = self._newest()
        content = self.comm.bcast(content)
        if content is None:
            return
        self.rows = content["rows"]
        ends = [End(t, *(np.array(one).reshape(-1, 6) for one in tools)) for t, *tools in content.get("ends", [])]
        found = first_difference(content.get("scene", {}), self._statement([end.t for end in ends]))
        if found:
            what, there, here = found
            raise SceneError(
                f"the checkpoint in '{self._folder}' is of another scene, {what}: {there} there, {here} here; resume with "
                "the script that wrote it, or start anew with overwrite=True in the place of resume"
            )
        self._stages.leave(*ends)
        self._restore(arrays, content)

    def _newest(self) -> tuple[dict[str, Any], dict[str, Any]] | tuple[None, None]:
        """(arrays, content) of the newest checkpoint on rank 0, (None, None) in an empty folder."""
        try:
            found = self._files.read()
        except Torn as error:
            raise SceneError(
                f"nothing to resume in '{self._folder}': {error}; its results are as they were: look at them, then start "
                "anew with overwrite=True in the place of resume"
            ) from None
        if found is None and (kept := results_in(self._folder)):
            raise SceneError(
                f"nothing to resume in '{self._folder}': it holds {kept[0].name} of a run without a checkpoint; choose "
                "another folder, or start anew with overwrite=True in the place of resume"
            )
        return found or (None, None)

    def _restore(self, arrays: dict[str, Any] | None, content: dict[str, Any]) -> None:
        try:
            verdict = Verdict(**content["verdict"])
        except TypeError as error:
            raise SceneError(
                f"the checkpoint in '{self._folder}' was written by another version of this package ({error}); start anew "
                "with overwrite=True in the place of resume"
            ) from None
        try:
            fields = self._memory.restore(arrays)
            self._strained = fields.pop(STRAINED, None)
            if path := self._path:
                path.recall(fields, content["stepper"])
        except ValueError as error:
            raise SceneError(
                f"the checkpoint in '{self._folder}' does not fit: {error}; start anew with overwrite=True in the place of "
                "resume"
            ) from None
        if self._softened:
            self._softened.recall(content["softened"])
        self._kept = arrays, content.get("results", {})
        self.verdict, self.rows, self.resumed = verdict, content["rows"], True
        self.verdict.resumed.append(len(self.rows))

    def follow(self, results: Results) -> None:
        """Keep with each step what Results of the next ones need; give them that of the steps behind. Collective."""
        (arrays, numbers), self._kept, self._results = self._kept, (None, {}), results
        if numbers:
            results.recall(partial(self._memory.rows, arrays), numbers)
        if self._strained is not None:
            results.recall_most_strained(numbers["most_strained"], self._strained)

    @property
    def _path(self) -> Continuation | None:
        return self._paths[self._stages.index]

    def _statement(self, passed: Sequence[float]) -> Statement:
        """What the run states, as far as it has come; passed: t at which stages have ended. Collective."""
        times: dict[str, list[float]] = {} if self.rows else {"": []}
        for row in self.rows:
            times.setdefault(row.get("stage", ""), []).append(row["t"])
        begun = list(times.values())[: len(self._stages)]
        shares = [[1.0, *(self._stages.share(t, tuple(passed[:i])) for t in ts)] for i, ts in enumerate(begun)]
        return self._stated(tuple(max(one) for one in shares))

    def keep(self) -> None:
        """Call at the start and after every accepted step: writes a checkpoint where one is due, as at the end of a stage.
        Collective."""
        # of the residuals, a list per step that stays as it is, only the list of lists is copied
        self._verdict = asdict(replace(self.verdict, residuals=[])) | {"residuals": list(self.verdict.residuals)}
        path = self._path  # which may end at any t
        ends = path.ended if path else bool(self.rows) and self._stages.share(self.rows[-1]["t"]) >= 1.0 - 1e-9
        if len(self.rows) % self.every == 0 or ends:
            self._write()

    def keep_last(self) -> None:
        """Call at the end of a run: the state accepted last is kept, whether or not its checkpoint was due, unless a stage
        has begun since. Collective."""
        begun = self.rows and self.rows[-1].get("stage", "") != self._stages.name
        if self._verdict and self._written != len(self.rows) and not begun:
            self._write()

    def _write(self) -> None:
        fields, numbers = self._path.memory() if self._path else ({}, None)
        rows, of_results = self._results.memory() if self._results else ({}, {})
        fields = fields | ({STRAINED: self._results.most_strained[1]} if self._results else {})
        arrays, stated = self._memory.collect(fields, rows), self._statement(self._stages.passed)
        ends = [[end.t, end.q.tolist(), end.forces.tolist()] for end in self._stages.ends]
        left = self._left()
        with writing(self.comm, self._folder, "a checkpoint"):
            if arrays:
                helps = self._softened is not None and self._softened.helps
                content = {"scene": stated, "verdict": self._verdict, "rows": self.rows, "stepper": numbers,
                           "softened": helps, "ends": ends, "left": left,
                           "results": of_results}  # fmt: skip
                self._files.write(len(self.rows), arrays, content)
        self._written = len(self.rows)


def last_state(folder: str | PathLike[str], comm: MPI.Comm) -> Start:
    """The last state that a run has kept in a folder. Collective."""
    name, found = f"'{folder}'", None
    with agreed(comm, f"reading the checkpoints in {name}", SceneError):
        if comm.rank == 0:
            try:
                found = CheckpointFiles(Path(folder)).read()
            except Torn as error:
                raise SceneError(f"start = {name}: {error}; start from another run") from None
            if found is None:
                raise SceneError(
                    f"start = {name} holds no checkpoint: run it with Output(..., checkpoint=True), or give its result"
                )
    arrays, content = found or (None, {})
    left = comm.bcast(content.get("left"))
    if left is None or any(len(tool) != len(LeftTool._fields) for tool in left["tools"].values()):
        raise SceneError(
            f"start = {name}: its checkpoint is of an older version, which does not say of tools whether they are free; run "
            "it again, or start from another run"
        )
    return Start(name, arrays, left)


def results_folder(out: str | PathLike[str], comm: MPI.Comm, overwrite: bool, resume: bool) -> Path:
    """The folder for results, which may be written; one that holds results only where the user says what is to become of
    them. Collective."""
    if overwrite and resume:
        raise SceneError("overwrite=True starts anew and resume=True goes on: give one of them")
    folder = prepare_folder(out, comm)
    with agreed(comm, f"reading output folder '{out}'", SceneError):
        found = results_in(folder) if comm.rank == 0 and not (overwrite or resume) else []
        if found:
            raise SceneError(
                f"output folder '{out}' holds results of an earlier run, {found[0].name}: choose another with out=..., "
                "or give Output(..., overwrite=True) to replace them, or resume=True to go on from their last checkpoint"
            )
    return folder
