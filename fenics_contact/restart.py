"""Checkpoints of a run, and the way back from one: on any number of ranks, refused where the scene is another."""

from dataclasses import asdict

from fenics_contact.assembly.memory import Memory
from fenics_contact.checks import SceneError
from fenics_contact.output.checkpoint import CheckpointFiles
from fenics_contact.solvers.verdict import Verdict


class Keeper:
    """Keeps the accepted steps of a run in its folder: `verdict` and `rows` are those so far, from the start or resumed.

    A stepper that remembers more than the System, a continuation's Path, offers memory() -> ({name: local array like u},
    {name: plain values}) and recall(fields, numbers), which raises ValueError where they do not fit.
    """

    def __init__(self, folder, scene, system, stepper, every, resume):
        self.comm, self.stepper, self.every = system.comm, stepper, every
        self.verdict, self.rows = Verdict(), []
        self._memory, self._files, self._scene = Memory(system), CheckpointFiles(folder), _statement(scene, system)
        found = self._files.read() if resume and self.comm.rank == 0 else None
        if self.comm.bcast(found is not None):
            self._take_up(*(found or (None, None)), folder)
        elif self.comm.rank == 0:
            self._files.clear()

    def _take_up(self, arrays, content, folder):
        content = self.comm.bcast(content)
        for what, here in self._scene.items():
            if content["scene"].get(what) != here:
                raise SceneError(
                    f"the checkpoint in '{folder}' is of another scene, {what}: {content['scene'].get(what)} there, {here} "
                    "here; resume with the script that wrote it, or start anew without resume"
                )
        stated, kept = hasattr(self.stepper, "recall"), content.get("stepper") is not None
        if stated != kept:
            ways = 'a continuation, method="arc_length"', "a run in load steps"
            there, here = ways if kept else ways[::-1]
            raise SceneError(
                f"the checkpoint in '{folder}' is of {there}, and this is {here}; resume with the method that wrote it, or "
                "start anew without resume"
            )
        try:
            fields = self._memory.restore(arrays)
            if kept:
                self.stepper.recall(fields, content["stepper"])
        except ValueError as error:
            raise SceneError(f"the checkpoint in '{folder}' does not fit: {error}; start anew without resume") from None
        self.verdict, self.rows = Verdict(**content["verdict"]), content["rows"]

    def keep(self):
        """Call after every accepted step: writes a checkpoint where one is due. Collective."""
        if len(self.rows) % self.every == 0:
            fields, numbers = self.stepper.memory() if hasattr(self.stepper, "memory") else (None, None)
            arrays = self._memory.collect(fields)
            if arrays:
                content = {"scene": self._scene, "verdict": asdict(self.verdict), "rows": self.rows, "stepper": numbers}
                self._files.write(len(self.rows), arrays, content)


def _statement(scene, system):
    """What must be the same for a state to mean the same. Collective."""
    comm = system.comm
    return {
        "degree": scene.degree,
        "cells": scene.mesh.domain.topology.index_map(3).size_global,
        "materials": {body.group: body.material.name for body in scene.bodies},
        "contacts": [[c.name, c.master_name, c.edge, c.friction, comm.allreduce(c.surface.points)] for c in system.contacts],
    }
