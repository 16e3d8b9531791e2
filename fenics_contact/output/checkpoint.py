"""Checkpoint files: two generations, each complete or not there at all, whenever the run is killed."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np

from fenics_contact.output.history import plain

GENERATIONS = 2
BROKEN = (OSError, ValueError, KeyError, zipfile.BadZipFile)  # what a file that is no checkpoint raises


class CheckpointFiles:
    """checkpoint_0.npz and checkpoint_1.npz of a folder, written in turn. Used on rank 0 alone."""

    def __init__(self, folder):
        self._folder = Path(folder)

    def _path(self, step):
        return self._folder / f"checkpoint_{step % GENERATIONS}.npz"

    def write(self, step, arrays, content):
        """Keep arrays {name: array} and content (plain values) of accepted step number `step`."""
        text = json.dumps({"step": step, **content}, default=plain)
        target = self._path(step)
        draft = target.with_suffix(".part")
        with open(draft, "wb") as file:
            np.savez(file, **arrays, content=np.frombuffer(text.encode(), dtype=np.uint8))
            file.flush()
            os.fsync(file.fileno())
        replace(draft, target)

    def read(self):
        """(arrays, content) of the newest complete checkpoint, or None where there is none."""
        found = [self._load(self._path(i)) for i in range(GENERATIONS)]
        return max(filter(None, found), key=lambda pair: pair[1]["step"], default=None)

    def clear(self):
        """A run from the start must not leave older ones to be taken for its own."""
        for i in range(GENERATIONS):
            self._path(i).unlink(missing_ok=True)

    def _load(self, path):
        try:
            with np.load(path) as file:
                arrays = {name: file[name] for name in file.files}  # the archive's checksums are tested here
            return arrays, json.loads(arrays.pop("content").tobytes())
        except BROKEN:
            return None


def replace(draft, target):
    """Move a finished file to its name, and have the disk know of it."""
    os.replace(draft, target)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
