"""Targets at which a continuation ends: a load, the displacement of a surface, or the travel of a tool."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.facet_points import skin_of_means
from fenics_contact.assembly.system import System
from fenics_contact.contact.tools import Tool
from fenics_contact.scene.checks import AXES
from fenics_contact.scene.functions import number_of
from fenics_contact.scene.motion import COMPONENTS
from fenics_contact.scene.scene import Scene
from fenics_contact.types import Floats, Ints
from fenics_contact.values import SceneError, axis_letters, count, finite, function, group_names, is_number, shown

WEIGHTLESS = 1e-12  # share of a mean, or component of a unit direction, that round-off leaves


@dataclass(frozen=True)
class Load:
    """The load parameter t, in a stage its s, reaches `value`, from either side."""

    value: float

    def __str__(self) -> str:
        return f"load t = {self.value:g}"

    def distance(self, scene: Scene, system: System) -> Callable[[], float]:
        return lambda: system.stages.share(system.state.t) - self.value


@dataclass(frozen=True)
class Displacement:
    """The mean displacement of a surface along an axis, over its area at the start, reaches `value` [length]."""

    group: str
    axis: str
    value: float

    def __str__(self) -> str:
        return f"displacement of '{self.group}' along {self.axis} = {self.value:g}"

    def distance(self, scene: Scene, system: System) -> Callable[[], float]:
        axis_letters(self.axis, f"Displacement of '{self.group}'", most=1)
        try:
            facets = scene.mesh.facets(*group_names(self.group, "Displacement"))
        except ValueError as error:
            raise SceneError(f"{self}: {error}") from None
        scene.mesh.refuse_inside(facets, str(self))
        skin, shares = skin_of_means(scene.space, facets, scene.section), compat.Function(scene.space)
        np.add.at(shares.x.array, 3 * skin.nodes + AXES[self.axis], np.einsum("eq,eqk->ek", skin.area, skin.N))
        compat.sum_to_owners(shares)
        owned = shares.x.array[: 3 * scene.space.dofmap.index_map.size_local].copy()
        owned /= system.comm.allreduce(float(skin.area.sum()))

        def mean(u: Floats) -> float:
            return system.comm.allreduce(float(owned @ u[: len(owned)]))

        if not _is_free(system, np.flatnonzero(np.abs(owned) > WEIGHTLESS)):
            now, *later = (mean(_led(system, system.stages.time(share))) for share in (0.0, 0.5, 1.0))
            if all(then == now for then in later):
                raise SceneError(f"{self}: along it that surface is neither free nor led anywhere; choose another target")
        return lambda: mean(system.state.u.x.array) - self.value


@dataclass(frozen=True)
class Travel:
    """A tool's travel along an axis reaches `value` [length], or its rotation about one, "rx", "ry" or "rz" [radians]."""

    tool: Tool
    axis: str
    value: float

    def __str__(self) -> str:
        what, along = ("rotation", "about") if self.axis in COMPONENTS[3:] else ("travel", "along")
        return f"{what} of '{self.tool.name}' {along} {self.axis[-1]} = {self.value:g}"

    def distance(self, scene: Scene, system: System) -> Callable[[], float]:
        if not isinstance(self.tool, Tool):
            raise SceneError(f"Travel: {shown(self.tool)} is no tool; give the tool itself")
        if self.axis not in COMPONENTS:
            raise SceneError(f"Travel of '{self.tool.name}': axis {shown(self.axis)} is not one of {', '.join(COMPONENTS)}")
        if self.tool not in scene.tools:
            raise SceneError(f"{self}: that tool is in no contact or tie of the scene")
        i, component = scene.tools.index(self.tool), COMPONENTS.index(self.axis)
        unit = 1.0 if component < 3 else system.tools.lever
        now, *later = (system.tools.prescribed(system.stages.time(share))[i, component] for share in (0.0, 0.5, 1.0))
        if not system.tools.free[i, component] and all(then == now for then in later):
            raise SceneError(f"{self}: that component neither moves nor is free; state it in move= or push=")
        return lambda: system.state.q[i, component] / unit - self.value


@dataclass(frozen=True)
class Branch:
    """At the bifurcation of this number the path goes on along another branch: that on which a surface moves along an axis,
    `towards` 1 or -1; of several that branch off there, the one most like such a motion."""

    group: str
    axis: str
    towards: float = 1.0
    number: int = 1

    def dofs(self, scene: Scene, system: System) -> Ints:
        """Owned dofs of the surface along the axis. SceneError where none is free."""
        axis_letters(self.axis, f"Branch along a motion of '{self.group}'", most=1)
        if not (is_number(self.towards) and self.towards in (-1.0, 1.0)):
            raise SceneError(f"Branch: towards = {shown(self.towards)} must be 1 or -1")
        count(self.number, "Branch: number")
        try:
            facets = scene.mesh.facets(*group_names(self.group, "Branch"))
        except ValueError as error:
            raise SceneError(f"Branch: {error}") from None
        blocks = compat.locate_blocks(scene.space, facets)
        dofs = 3 * blocks[blocks < scene.space.dofmap.index_map.size_local] + AXES[self.axis]
        if not _is_free(system, dofs):
            raise SceneError(f"Branch: '{self.group}' cannot move along {self.axis}; choose another axis or surface")
        return dofs


def _is_free(system: System, dofs: Ints) -> bool:
    """Whether any rank has, of these owned dofs, one that no support holds; a hub's may be free too. Collective."""
    nodes, axes = np.divmod(dofs, 3)
    ways = system.supports.free(nodes)[np.arange(len(nodes)), :, axes]
    here = bool(np.abs(ways).max(initial=0.0) > WEIGHTLESS) or bool(np.isin(dofs, system.supports.ties.dofs).any())
    return system.comm.allreduce(here, op=MPI.LOR)


def _led(system: System, t: float) -> Floats:
    """Displacement of what supports lead, at t, as a local array that is zero elsewhere. Collective."""
    u = np.zeros_like(system.state.u.x.array)
    system.supports.put(u, system.supports.values(t))
    return u


def distances(until: object, scene: Scene, system: System) -> dict[str, Callable[[], float]]:
    """{words: function () -> signed distance} of a target or a list of them; a callable of the state is a target too.

    Raises SceneError, on all ranks, for what is no target.
    """
    found: dict[str, Callable[[], float]] = {}
    for target in until if isinstance(until, list | tuple) else [until]:
        if isinstance(target, Load | Displacement | Travel):
            finite(target.value, f"{type(target).__name__}: value")
            distance = target.distance(scene, system)  # which checks what the words are made of
            found[str(target)] = distance
        elif callable(target):
            function(target, "until", "until(state)")
            name = getattr(target, "__name__", "function").replace("<lambda>", "function")
            words = f"target {len(found) + 1}, {name} = 0"
            found[words] = functools.partial(number_of, system.comm, words, target, system.state)
        else:
            raise SceneError(f"until = {shown(target)}: give a Load, Displacement, Travel, function of the state, or a list")
    return found
