"""Checkpoint files: two generations, each complete or not there at all, whenever the run is killed."""

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.output.files import CHECKPOINTS, complete
from fenics_contact.output.history import plain
from fenics_contact.types import Array

BROKEN = (EOFError, OSError, ValueError, KeyError, zipfile.BadZipFile)  # what a file that is no checkpoint raises


class CheckpointFiles:
    """checkpoint_0.npz and checkpoint_1.npz of a folder, written in turn. Used on rank 0 alone."""

    def __init__(self, folder: Path) -> None:
        self._paths = [Path(folder) / name for name in CHECKPOINTS]
        self._turn = 0  # which of them is written next

    def write(self, step: int, arrays: dict[str, Any], content: dict[str, Any]) -> None:
        """Keep arrays {name: array} and content (plain values) of accepted step number `step`."""
        text = json.dumps({"step": step, **content}, default=plain)
        target = self._paths[self._turn]
        with complete(target) as draft, open(draft, "wb") as file:
            np.savez(file, **arrays, content=np.frombuffer(text.encode(), dtype=np.uint8))
            file.flush()
            os.fsync(file.fileno())
        _keep_name(target)
        self._turn = 1 - self._turn

    def read(self) -> tuple[dict[str, Array], dict[str, Any]] | None:
        """(arrays, content) of the newest complete checkpoint, or None where there is no file. Torn: none is complete."""
        there = [i for i, path in enumerate(self._paths) if path.exists()]
        if not there:
            return None
        found = {i: pair for i in there if (pair := self._load(self._paths[i])) is not None}
        if not found:
            raise Torn(f"{' and '.join(self._paths[i].name for i in there)}: damaged, none can be read")
        newest = max(found, key=lambda i: found[i][1]["step"])
        self._turn = 1 - newest
        return found[newest]

    def _load(self, path: Path) -> tuple[dict[str, Array], dict[str, Any]] | None:
        try:
            with np.load(path) as file:
                arrays = {name: file[name] for name in file.files}  # the archive's checksums are tested here
            return arrays, json.loads(arrays.pop("content").tobytes())
        except BROKEN:
            return None


class Torn(ValueError):
    """There are checkpoints, and none of them is complete."""


def _keep_name(target: Path) -> None:
    """Have the disk know of a file that has come to its name."""
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
