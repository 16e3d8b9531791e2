"""A case run over many parameters, each run in a process of its own and written to a CSV file at once."""

import ast
import csv
import inspect
import itertools
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from fenics_contact import compat
from fenics_contact.options import Method
from fenics_contact.output.names import plain_name
from fenics_contact.result import Result
from fenics_contact.scene.stage import ARC_LENGTH
from fenics_contact.scene.targets import Load
from fenics_contact.solvers.course import ArcSteps

# What a run leaves beside its parameters; empty where it does not apply. notes: those on the result, as a run prints them,
# without those on what it overcame; busy: share of the wall time on the processor.
METRICS = (
    "error", "value", "converged", "verdict", "notes", "t_reached", "iterations", "cut_backs", "unknowns", "seconds",
    "busy", "seconds_bulk", "seconds_contact", "seconds_linear", "memory_MB", "processes", "machine", "versions",
)  # fmt: skip

BETWEEN = " | "  # notes of a row
WHY = ".why"  # ends the name of the file in which, beside the answer's, a process that fails has its error's words
BANNER = 60 * "-"  # begins what mpirun says of processes that have failed

Run = dict[str, Any]  # parameters of a run, as JSON knows them
Row = dict[str, Any]  # these and METRICS
Values = Mapping[str, Sequence[Any]]  # of each parameter that a curve varies
Panels = Mapping[str, Mapping[str, Values]]  # {title: {label of a curve: its values}}


class StudyError(ValueError):
    """A study cannot be run or drawn as stated, or contradicts theory."""


class Metrics(Row):
    """A row of `metrics`; last: the last row of the run's history, whose columns a study may ask for too, those of friction
    where a contact of the scene has none."""

    last: Row
    smooth: tuple[str, ...]


def grid(**values: Sequence[Any]) -> list[Run]:
    """All combinations of the parameters' values, as a list of dicts."""
    return [dict(zip(values, combination, strict=True)) for combination in itertools.product(*values.values())]


def expand(base: Run, panels: Panels) -> list[Run]:
    """The runs of a work-precision chart, each once: `base` and, from it, what its curves vary.

    panels: {title: {label of a curve: {parameter: values}}}; several parameters of a curve make a grid.
    """
    varied = [base | run for curves in panels.values() for values in curves.values() for run in grid(**values)]
    return _once([base, *varied])


def _json(value: Any) -> str:
    """As another process reads it. TypeError for what is no number, text, truth or list of these."""
    return json.dumps(value, default=np.generic.item)


def _once(runs: list[Run]) -> list[Run]:
    """Runs, each once: by equal numbers, 1 and 1.0, a case is run alike."""
    known: dict[frozenset[tuple[str, str]], Run] = {}
    for run in runs:
        known.setdefault(frozenset((name, _told(value)) for name, value in run.items()), run)
    return list(known.values())


def _told(value: Any) -> str:
    """What tells a parameter's value from others, as stated or as a table has it: equal numbers are one."""
    if isinstance(value, str):
        value = _value(value)
    if isinstance(value, str) and value.startswith(("[", "(")):
        with suppress(ValueError, SyntaxError, TypeError):  # a list, which a table has as text
            value = json.loads(_json(ast.literal_eval(value)))
    whole = json.loads(_json(value), parse_float=lambda text: int(x) if (x := float(text)).is_integer() else x)
    return "None" if whole is None else str(whole)


def of_curve(rows: list[Row], base: Run, values: Values) -> list[Row]:
    """The rows of a curve: equal to `base` in all that the curve does not vary, in the order of its values."""
    wanted = [base | run for run in grid(**values)]
    return [row for run in wanted for row in rows if all(row.get(key) == run[key] for key in run)]


def stepping(method: str, steps: int, linear: str) -> dict[str, Any]:
    """Options of `solve`: so many load steps by a method; or arcs to the whole load, the first of which aims at one."""
    if method == ARC_LENGTH:
        return {"steps": ArcSteps(Load(1.0), first=1.0 / steps), "method": Method(linear=linear)}
    return {"steps": steps, "method": Method(method, linear)}


def metrics(result: Result, error: float = float("nan"), value: float = float("nan"), **outputs: Any) -> Metrics:
    """The metrics of a Result. error: relative, against what the case compares with; value: the figure compared; outputs:
    what else the case gives, by name, each a column of the study's table. Collective.

    A failed run has its verdict and the t it reached; its error means nothing.
    """
    summary, verdict = result.summary, result.verdict
    seconds, comm = summary["seconds"], result.system.comm
    stages = {
        "bulk": ("bulk tangent", "residual"),
        "contact": ("search", "projection", "contact kernel", "insertion"),
        "linear": ("factorisation", "solve"),
    }
    spent = {name: sum(seconds[stage] for stage in parts) for name, parts in stages.items()}
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    row = Metrics(
        {
            "error": error if verdict.converged else float("nan"),
            "value": value,
            "converged": verdict.converged,
            "verdict": verdict.kind,
            "notes": BETWEEN.join(verdict.doubts),
            "t_reached": verdict.t,
            "iterations": verdict.iterations,
            "cut_backs": verdict.cuts,
            "unknowns": summary["sizes"]["unknowns"],
            "seconds": seconds["total"] - summary["seconds_before_first_step"],
            **{f"seconds_{stage}": amount for stage, amount in spent.items()},
            "memory_MB": memory,
            "processes": comm.size,
            **outputs,
        }
    )
    row.last = result.history[-1] if result.history else {}
    row.smooth = tuple(contact.name for contact in result.system.contact_terms if not contact.rough)
    return row


def row_of(found: Result | Row, outputs: Sequence[str]) -> Row:
    """A row of what a case returned. Collective. StudyError where it is none, or lacks an output."""
    if not isinstance(found, Result | dict):
        raise StudyError(f"a case returns a Result or a dict, and this one has returned {found!r:.60}")
    row = metrics(found) if isinstance(found, Result) else found
    last = row.last | _frictionless(row.smooth, outputs) if isinstance(row, Metrics) else {}
    row = {"converged": True, "verdict": "converged", "t_reached": ""} | row
    known = last | row
    if row["converged"] and (lacking := [name for name in outputs if name not in known]):
        raise StudyError(f"the case gives no '{lacking[0]}'; it gives {', '.join(known)}")
    given = {name: known.get(name, "") for name in outputs}
    if row["converged"] and (
        lost := [name for name, value in given.items() if isinstance(value, float) and np.isnan(value)]
    ):
        row = row | {"converged": False, "verdict": f"'{lost[0]}' is not a number"}
    return row | given


def _frictionless(contacts: Sequence[str], outputs: Sequence[str]) -> Row:
    """Zeros for the columns of friction that outputs name and contacts without any do not have."""
    begins = tuple(f"{plain_name(name)}_friction_{part}_" for name in contacts for part in ("x", "y", "z", "work"))
    return {name: 0.0 for name in outputs if name.startswith(begins)}


@dataclass
class Study:
    """A case and the parameters it is run over.

    case: function of JSON values, at the top level of an importable file, that returns a Result, a dict of the outputs, or
    `metrics(...)`; runs: list of its keyword arguments, where `processes` is the number of MPI processes and not given to
    it; repeats: runs of each, for medians of times; limit: seconds after which a run counts as failed; shared: one process
    for run after run until one fails in it, which saves each its start but makes memory_MB the largest of them; outputs:
    columns that every run which converges must fill with numbers: figures of the case's, or columns of the history, at the
    end. Figures that are not named here are columns too, blank where a run gives none.
    """

    name: str
    case: Callable[..., Result | Row]
    runs: list[Run]
    repeats: int = 1
    limit: float = 600.0
    shared: bool = False
    outputs: Sequence[str] = ()
    parameters: list[str] = field(init=False)
    _worker: "_Worker | None" = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.parameters = list(dict.fromkeys(key for run in self.runs for key in run))
        if clash := {*self.parameters, *self.outputs} & set(METRICS) - {"processes"}:
            raise StudyError(f"study '{self.name}': parameter or output '{clash.pop()}' has the name of a metric; rename it")
        if clash := set(self.parameters) & set(self.outputs):
            raise StudyError(f"study '{self.name}': '{clash.pop()}' is a parameter and an output; rename one")
        for run in self.runs:
            self._refuse_unfit(run)
        self.runs = _once([json.loads(_json(run)) for run in self.runs])  # as every process has them

    def _refuse_unfit(self, run: Run) -> None:
        """Every run would fail so, and stay in the table as failed."""
        try:
            inspect.signature(self.case).bind(**_arguments(run))
            _json(run)
        except TypeError as error:
            raise StudyError(f"study '{self.name}': its case cannot be run with {run}: {error}") from None

    def run(self, folder: str | Path, progress: bool = True, isolated: bool = True) -> Path:
        """Run what the CSV file in `folder` does not hold yet; returns its path. Not for use under mpirun.

        isolated: each run and its repeats in a process of their own; else all in this one, which saves seconds per run but
        where nothing catches a crash, and `processes` is 1. What failed once is not repeated.
        """
        path = Path(folder) / f"{self.name}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        held, before = _columns(path), read(path) if path.exists() else []
        if held and (lacking := [name for name in [*self.parameters, *self.outputs] if name not in held]):
            raise StudyError(f"study '{self.name}': {path} has no column '{lacking[0]}'; move it away, or rename the study")
        done = {self._key(row) for row in before}
        failed = {self._key(row, False) for row in before if row["converged"] is not True}
        todo = []
        for run in self.runs:
            missing = [i for i in range(self.repeats) if self._key(run | {"repeat": i}) not in done]
            if missing and self._key(run, False) not in failed:
                todo.append((run, missing))
        measure = self._measure if isolated else self._measure_here
        try:
            for run, missing in tqdm(todo, desc=self.name, disable=not progress):
                self._write(path, run, measure(run, len(missing)), missing)
        finally:
            self._dismiss()
        return path

    def _write(self, path: Path, run: Run, rows: list[Row], numbers: list[int]) -> None:
        """Add a run's rows to the table, which gains a column for each figure that is new to it."""
        held, metric = _columns(path), [name for name in METRICS if name not in self.parameters]
        columns = list(held or [*self.parameters, "repeat", *self.outputs, *metric])
        given = list(dict.fromkeys(name for row in rows for name in row))
        stated = set(columns[: columns.index("repeat") + 1]) - {"processes"}
        if clash := [name for name in given if name in stated]:
            raise StudyError(f"study '{self.name}': its case gives '{clash[0]}', which names a column of its own; rename it")
        place = columns.index(METRICS[0])
        columns[place:place] = [name for name in given if name not in columns]
        parameters = {key: "None" if (value := run.get(key, "")) is None else value for key in self.parameters}
        new = [row | parameters | {"repeat": number} | _here() for row, number in zip(rows, numbers, strict=False)]
        if columns == held:
            _append(path, columns, new)
            return
        whole = path.with_suffix(".part")  # which takes the table's place at once, or not at all
        whole.unlink(missing_ok=True)
        _append(whole, columns, [*(_texts(path) if held else []), *new])
        whole.replace(path)

    def mine(self, rows: list[Row]) -> list[Row]:
        """The rows that belong to this study's runs as they are stated now."""
        wanted = {self._key(run | {"repeat": i}) for run in self.runs for i in range(self.repeats)}
        return [row for row in rows if self._key(row) in wanted]

    def _key(self, row: Row, with_repeat: bool = True) -> frozenset[tuple[str, str]]:
        """What tells a run from others, of the run or of a row: all that was stated, also by an earlier study alone."""
        stated = [*itertools.takewhile(lambda name: name != "repeat", row), *self.parameters, *["repeat"] * with_repeat]
        return frozenset((name, told) for name in stated if (told := _told(row.get(name, ""))))

    def _measure(self, run: Run, repeats: int) -> list[Row]:
        """Metrics of a run's repeats in another process; one that dies or takes too long is a row with its reason."""
        processes = int(run.get("processes", 1))
        with tempfile.TemporaryDirectory() as scratch:
            answer, limit = Path(scratch) / "metrics.json", repeats * self.limit
            task = _json(
                [inspect.getfile(self.case), self.case.__name__, _arguments(run), list(self.outputs), repeats, str(answer)]
            )
            if processes > 1:
                self._dismiss()
            self._worker = self._worker or _Worker(processes, task)
            reason = self._worker.do(task, answer, limit)
            if reason or processes > 1 or not self.shared:
                self._dismiss()
            if not answer.exists():
                return [{"converged": False, "verdict": f"stopped: {reason}", "processes": processes}]
            return json.loads(answer.read_text())

    def _dismiss(self) -> None:
        if self._worker is not None:
            self._worker.end()
        self._worker = None

    def _measure_here(self, run: Run, repeats: int) -> list[Row]:
        return [row_of(self.case(**_arguments(run)), self.outputs) for _ in range(repeats)]


class _Worker:
    """A process that does tasks given as lines, or several processes that do one task: mpirun feeds lines to the first."""

    def __init__(self, processes: int, task: str) -> None:
        command = [sys.executable, "-m", "fenics_contact.studies.worker", "-"]
        self.single = processes > 1
        if self.single:
            command = ["mpirun", "-n", str(processes), *command[:-1], task]
        self.errors = tempfile.TemporaryFile("w+")
        # the environment as this process found it: a started MPI library would pass its own on to mpirun
        self.process = subprocess.Popen(
            command, env=os.environ.copy(), stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self.errors, text=True
        )

    def do(self, task: str, answer: Path, limit: float) -> str | None:
        """Wait for the answer's file; returns why there is none: what a process has written of its error, or with what exit
        code it has died."""
        said = os.fstat(self.errors.fileno()).st_size
        if not self.single and self.process.stdin is not None:
            self.process.stdin.write(task + "\n")
            self.process.stdin.flush()
        end, why = time.monotonic() + limit, Path(f"{answer}{WHY}")
        while not answer.exists():
            died = self.process.poll()
            if why.exists():
                return why.read_text()
            if died is not None and not answer.exists():
                return self._death(died, said)
            if time.monotonic() > end:
                return f"no end within {limit:g} s"
            time.sleep(0.02)
        return None

    def _death(self, code: int, said: int) -> str:
        """The exit code, of what a signal has ended as shells and mpirun have it, and the last line written since `said`
        [byte], before mpirun's own."""
        self.errors.seek(said)
        lines = self.errors.read().split(BANNER)[0].strip().splitlines()
        return ": ".join([f"exit {code if code >= 0 else 128 - code}", *lines[-1:]])

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.errors.close()


def _arguments(run: Run) -> Run:
    return {key: value for key, value in run.items() if key != "processes"}


def _here() -> dict[str, str]:
    return {"machine": _machine(), "versions": " ".join(f"{k} {v}" for k, v in compat.versions().items())}


def _machine() -> str:
    cpu = next((line.split(":", 1)[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")), "")
    return f"{cpu or platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def _lines(path: str) -> list[str]:
    return Path(path).read_text().splitlines() if Path(path).exists() else []


def read(path: str | Path) -> list[Row]:
    """Rows of a study's CSV file; numbers as floats, True and False as such."""
    return [{k: _value(v) for k, v in row.items()} for row in _texts(path)]


def _texts(path: str | Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def _columns(path: Path) -> list[str]:
    """Columns of a table, none where there is no table yet."""
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return next(csv.reader(file), [])


def _append(path: Path, columns: list[str], rows: Sequence[Row]) -> None:
    """Add rows to a table, which begins with the names of its columns."""
    new = not path.exists()
    with open(path, "a", newline="") as file:
        writer = csv.DictWriter(file, columns)
        if new:
            writer.writeheader()
        writer.writerows(rows)


def _value(text: str) -> bool | int | float | str:
    if text in ("True", "False"):
        return text == "True"
    try:
        return float(text) if "." in text or "e" in text.lower() or not text.lstrip("-").isdigit() else int(text)
    except ValueError:
        return text
