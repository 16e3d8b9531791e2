"""Surfaces tied to rigid bodies: what else may lead their nodes, and supports there that would hinder the bodies."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.entries import Hindered
from fenics_contact.assembly.pose import Poses
from fenics_contact.assembly.ties import Ties
from fenics_contact.assembly.tool_motion import ToolMotion
from fenics_contact.contact.tools import Tool
from fenics_contact.scene.pairs import FacePairs
from fenics_contact.scene.stage import Stage
from fenics_contact.types import Floats, Ints64
from fenics_contact.values import SceneError

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene

HINDERED = 1e-9  # of a body's way: by how much less it may leave a support, whose direction is rounded
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a stage, at which its motions are looked at
TRIALS = 2  # motions of free components that are tried at each


def ties_of(scene: "Scene") -> Ties:
    """Ties whose nodes no other tie leads; nodes that two groups of one body have in common once. Collective."""
    mesh, space, tools = scene.mesh, scene.space, scene.tools
    X, found = space.tabulate_dof_coordinates(), list[tuple[int, Ints64, Floats]]()
    led: list[tuple[str, Tool, Ints64]] = []
    nodes_of: dict[Tool, list[Ints64]] = {}
    for tie in scene.ties:
        name, nodes = "+".join(tie.group), mesh.nodes(space, *tie.group).astype(np.int64)
        for what, hub, others in led:
            if hub is not tie.hub and mesh.comm.allreduce(len(np.intersect1d(nodes, others))):
                raise SceneError(
                    f"tie of '{name}' to '{tie.hub.name}': {what} leads some of the same nodes; leave one of them out, or "
                    "name surfaces that do not meet"
                )
        led.append((f"the tie of '{name}' to '{tie.hub.name}'", tie.hub, nodes))
        nodes_of.setdefault(tie.hub, []).append(nodes)
    for hub, parts in nodes_of.items():
        nodes = np.unique(np.concatenate(parts))
        found.append((tools.index(hub), nodes, X[nodes]))
    return Ties(found, space.dofmap.index_map.size_local)


class Bound(NamedTuple):
    """What is tied to rigid bodies, and the supports and pairs of faces that hold some of the same nodes."""

    comm: MPI.Comm
    motion: ToolMotion
    ties: Ties
    hindered: Sequence[Hindered]
    paired: FacePairs | None

    def refuse_hindered(self, stated: Sequence[Stage], poses: Poses) -> None:
        """Rigid bodies must be able to go all their ways from where the run begins, free ones anywhere, without leaving the
        supports of what is tied to them, as those of planes of symmetry, and as pairs of its faces move. Collective."""
        motion, stages, tried = self.motion, self.motion.stages, np.random.default_rng(0)
        first, came = stages.origin.q, np.zeros((len(motion), 6))  # how far the stages before have led
        for i, stage in enumerate(stated if self.hindered or (self.paired and self.paired.tied) else ()):
            with stages.foreseen(i):
                for t in (stages.time(share) for share in SHARES):
                    for _ in range(TRIALS):
                        free = first + motion.lever * tried.uniform(-1.0, 1.0, came.shape)
                        if words := self._off(t, poses, came + np.where(motion.free, free, motion.prescribed(t))):
                            raise SceneError(stage.says(words))
                came += np.where(motion.free, 0.0, motion.prescribed(stages.time(1.0)) - first)

    def refuse_astray(self, stage: Stage, t: float, poses: Poses, q: Floats) -> None:
        """They leave none at t either, which may lie between the places looked at before the run; q (bodies, 6): where those
        are that are free. Collective."""
        if words := self._off(t, poses, np.where(self.motion.free, q, self.motion.prescribed(t))):
            raise SceneError(stage.says(f"at t = {t:g} {words}"))

    def _off(self, t: float, poses: Poses, q: Floats) -> str:
        """What a body whose coordinates are q leaves at t, in words. Collective."""
        for one in self.hindered:
            off = np.max(self.comm.allgather(self.ties.off(one.nodes, one.direction, one.value(t), poses, q)), axis=0)
            k = int(off.argmax())
            if off[k] > HINDERED * self.motion.lever:
                return _words(self.motion.names[k], one.name, bool(self.motion.free[k].any()))
        if self.paired is None or not self.paired.tied:
            return ""
        ways = self.paired.ways(t)
        for among in self.paired.tied:
            if among.off(ways, poses.at(among.body, q[among.body])) > HINDERED * self.motion.lever:
                return among.words(self.motion.names[among.body], bool(self.motion.free[among.body].any()))
        return ""


def _words(hub: str, support: str, free: bool) -> str:
    how = "may leave" if free else "leads them off"
    return (
        f"'{hub}', to which some nodes of the support of {support} are tied, {how} where that holds them; let it stay or "
        "move along that support alone, or leave one of them out"
    )
