"""Moved or pushed tools as functions of the load parameter t."""

from collections.abc import Callable, Sequence

import numpy as np

from fenics_contact.assembly.pose import Poses
from fenics_contact.assembly.stages import Stages
from fenics_contact.types import Bools, Floats

Paths = Sequence[Callable[[float], Floats]]  # of each tool: t -> (6,)
BETWEEN = 4  # parts of a step in which its paths are followed


class ToolMotion:
    """Rigid tools' motion: prescribed components follow a path, free ones balance a load.

    stages: of the run; ways: paths and loads, in the stage that is on of each tool a function t -> (6,), travel and, times
    the lever, rotation vector [length]; force and, over the lever, moment [force]. points (tools, 3): where the reference
    points start [length]; free_by_stage: (tools, 6) bool of each stage; names; sizes: lever [length], by which rotations are
    made lengths, and moments forces, and reach, the largest length of which gaps with tools are differences [length].
    """

    def __init__(
        self,
        stages: Stages,
        ways: tuple[Paths, Paths],
        points: Sequence[Floats],
        free_by_stage: Sequence[Bools],
        names: Sequence[str],
        sizes: tuple[float, float],
    ) -> None:
        self.stages, self.names, (self.lever, self.reach) = stages, tuple(names), sizes
        (self._paths, self._loads), self._free_by_stage = ways, free_by_stage
        self.points = np.asarray(points, dtype=float).reshape(len(self.names), 3)

    def __len__(self) -> int:
        return len(self._paths)

    @property
    def free(self) -> Bools:
        """Which components (tools, 6) are free in the stage that is on."""
        return self._free_by_stage[self.stages.index]

    def prescribed(self, t: float) -> Floats:
        """Prescribed coordinates (tools, 6) at t [length]; zero where the component is free."""
        return np.where(self.free, 0.0, _stack(self._paths, t))

    def forces(self, t: float) -> Floats:
        """External forces, and moments over the lever, (tools, 6) at t [force]; zero where the component is not free."""
        return np.where(self.free, _stack(self._loads, t), 0.0)

    def turns(self, start: float, end: float) -> Floats:
        """By how much (tools,) paths turn the tools between two t of the stage that is on, to and fro together [rad]."""
        at = np.array([self.prescribed(t)[:, 3:] for t in np.linspace(start, end, 1 + BETWEEN)]) / self.lever
        return np.linalg.norm(np.diff(at, axis=0), axis=2).sum(axis=0)

    def poses(self) -> Poses:
        """Of the tools at the start."""
        return Poses(self.points, self.lever, lambda: self.free[:, 3:].all(axis=1))


def _stack(functions: Paths, t: float) -> Floats:
    return np.array([f(t) for f in functions], dtype=float).reshape(len(functions), 6)
