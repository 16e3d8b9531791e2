"""The files of a results folder: which of them are a run's own, and how one comes to its name only when it is complete."""

import os
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from mpi4py import MPI

from fenics_contact.agreement import agreed

STEPS = "steps"  # folder of the field files, one per step
FIELDS = "results.xdmf"  # their table of contents
CHECKPOINTS = ("checkpoint_0.npz", "checkpoint_1.npz")
# Everything a run writes but the field files. Checkpoints go first: without them nothing resumes half a folder.
NAMES = (*CHECKPOINTS, "history.csv", "summary.json", "body.png")
IN_FIELDS = re.compile(rf"{STEPS}/(\d{{6}})\.h5:")


class FolderError(ValueError):
    """A file of the output folder cannot be written, or must not be; raised on all ranks."""


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
    index = folder / FIELDS
    if index.is_file():
        numbers = sorted(set(IN_FIELDS.findall(index.read_text(errors="replace"))))
        fields = [folder / STEPS / f"{number}.h5" for number in numbers]
        found += [index, *(path for path in fields if path.is_file())]
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


def take_room(path: Path, size: int) -> None:
    """OSError where the disk has no room for a file of `size` bytes; the path is free again afterwards.

    A library that ends the process where a disk is full must not get so far.
    """
    try:
        with open(path, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    finally:
        path.unlink(missing_ok=True)
