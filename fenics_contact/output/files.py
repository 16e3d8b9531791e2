"""The files of a results folder: which of them are a run's own, and how one comes to its name only when it is complete."""

import os
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from fenics_contact.agreement import agreed
from fenics_contact.values import FolderError

STEPS = "steps"  # folder of the field files, one per step
FIELDS = "results.pvd"  # their table of contents
TOOLS = "tools"  # folder of the tools' files, one per step, and their tables of contents
CHECKPOINTS = ("checkpoint_0.npz", "checkpoint_1.npz")
# Everything a run writes but the files of its steps. Checkpoints go first: without them nothing resumes half a folder.
NAMES = (*CHECKPOINTS, "history.csv", "summary.json", "body.png")


@dataclass(frozen=True)
class StepFiles:
    """A table of contents and the names of the files it lists: steps/000001.vtu of results.pvd, X_000001.vtu of X.pvd."""

    index: Path

    @property
    def _prefix(self) -> str:
        return f"{STEPS}/" if self.index.name == FIELDS else f"{self.index.stem}_"

    def name(self, step: int) -> str:
        """A step's file, seen from the table's folder."""
        return f"{self._prefix}{step:06d}.vtu"

    def path(self, step: int) -> Path:
        return self.index.parent / self.name(step)

    def step(self, name: str) -> int | None:
        """Number of the step whose file has this name; None for other files."""
        found = re.fullmatch(re.escape(self._prefix) + r"(\d{6,})\.vtu", name)
        return None if found is None else int(found[1])

    def there(self) -> list[Path]:
        """The table and those of its files that there are; nothing where it is not a run's: it lists no file, or others."""
        if not self.index.is_file():
            return []
        names = re.findall(r'file="([^"]*)"', self.index.read_text(encoding="utf-8", errors="replace"))
        steps = [step for name in names if (step := self.step(name)) is not None]
        if self.index.name != FIELDS and not 0 < len(steps) == len(names):
            return []
        return [self.index, *(path for step in steps if (path := self.path(step)).is_file())]


def writing(comm: MPI.Comm, folder: Path, what: str) -> AbstractContextManager[None]:
    """A block that writes `what` into the folder, on any ranks: FolderError on all where it fails. Collective."""
    return agreed(comm, f"output folder '{folder}': writing {what}", FolderError)


def prepare_folder(path: str | os.PathLike[str], comm: MPI.Comm) -> Path:
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


def results_in(folder: Path) -> list[Path]:
    """The files of an earlier run in a folder, in the order in which to remove them."""
    found = [folder / name for name in NAMES if (folder / name).is_file()]
    for index in (folder / FIELDS, *sorted((folder / TOOLS).glob("*.pvd"))):
        found += StepFiles(index).there()
    return found


def clear_results(folder: Path) -> None:
    """Remove an earlier run's files, so that none is taken for the present one's; what a run did not write stays."""
    for path in results_in(folder):
        path.unlink()


@contextmanager
def complete(target: Path) -> Iterator[Path]:
    """The path of a draft to write, which takes the target's place at the end of the block, and vanishes if that fails."""
    draft = target.with_suffix(".part")
    try:
        yield draft
        os.replace(draft, target)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
