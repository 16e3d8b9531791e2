"""Targets at which a continuation ends: a load, the displacement of a surface, or the travel of a tool."""

import functools
from dataclasses import dataclass

import numpy as np

from fenics_contact import compat
from fenics_contact.checks import AXES, SceneError
from fenics_contact.functions import number_of


@dataclass(frozen=True)
class Load:
    """The load parameter t reaches `value`, from either side."""

    value: float

    def __str__(self):
        return f"load t = {self.value:g}"

    def distance(self, scene, system):
        return lambda: system.state.t - self.value


@dataclass(frozen=True)
class Displacement:
    """The mean displacement of a surface's nodes along an axis reaches `value` [length]."""

    group: str
    axis: str
    value: float

    def __str__(self):
        return f"displacement of '{self.group}' along {self.axis} = {self.value:g}"

    def distance(self, scene, system):
        _known_axis(self)
        try:
            facets = scene.mesh.facets(self.group)
        except ValueError as error:
            raise SceneError(f"{self}: {error}") from None
        blocks = compat.locate_blocks(scene.space, facets)
        blocks = blocks[blocks < scene.space.dofmap.index_map.size_local]
        count = system.comm.allreduce(len(blocks))
        dofs = 3 * blocks + AXES[self.axis]
        return lambda: system.comm.allreduce(float(system.state.u.x.array[dofs].sum())) / count - self.value


@dataclass(frozen=True)
class Travel:
    """A tool's travel along an axis reaches `value` [length]."""

    tool: object
    axis: str
    value: float

    def __str__(self):
        return f"travel of '{self.tool.name}' along {self.axis} = {self.value:g}"

    def distance(self, scene, system):
        _known_axis(self)
        if self.tool not in scene.tools:
            raise SceneError(f"{self}: that tool is in no contact of the scene")
        index = scene.tools.index(self.tool), AXES[self.axis]
        return lambda: system.state.travel[index] - self.value


def _known_axis(target):
    if target.axis not in AXES:
        raise SceneError(f"{target}: axis '{target.axis}' is not one of x, y, z")


def distances(until, scene, system):
    """{words: function () -> signed distance} of a target or a list of them; a callable of the state is a target too.

    Raises SceneError, on all ranks, for what is no target.
    """
    found = {}
    for target in until if isinstance(until, list | tuple) else [until]:
        if hasattr(target, "distance"):
            if not np.isfinite(target.value):
                raise SceneError(f"{target}: give a finite number")
            found[str(target)] = target.distance(scene, system)
        elif callable(target):
            name = getattr(target, "__name__", "function").replace("<lambda>", "function")
            words = f"target {len(found) + 1}, {name} = 0"
            found[words] = functools.partial(number_of, system.comm, words, target, system.state)
        else:
            raise SceneError(f"until = {target!r}: give Load, Displacement, Travel or a function of the state, or a list")
    return found
