"""Reactions of the groups of surfaces that supports hold or move."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.assembly.system import System
from fenics_contact.output.solved import Solved
from fenics_contact.types import Floats, Ints64


@dataclass(frozen=True)
class Reaction:
    """Force (3,) and moment (3,) of a support on its body [force, force x length]; point (3,): about which the moment is
    taken, the present centroid of the group [length]."""

    force: Floats
    moment: Floats
    point: Floats


@dataclass(frozen=True)
class _Group:
    dofs: Ints64  # owned ones that its statements prescribe
    nodes: Ints64  # owned ones on its facets
    weights: Floats  # of these nodes in the centroid


class Reactions:
    """Of every group named in a support, by name. Where two groups prescribe the same displacement of a node each of them
    has half of its reaction: so the groups' forces add up to all that supports give."""

    def __init__(self, scene: Solved, system: System) -> None:
        self._system = system
        axes: dict[tuple[str, ...], set[int]] = {}
        for support in scene.supports:
            axes.setdefault(support.group, set()).add(support.axis)
        self._groups = {"+".join(name): self._group(scene, name, sorted(along)) for name, along in axes.items()}
        self._shared = np.zeros(len(system.state.u.x.array))
        for group in self._groups.values():
            self._shared[group.dofs] += 1.0

    def _group(self, scene: Solved, name: tuple[str, ...], along: Sequence[int]) -> _Group:
        space, facets = scene.space, scene.mesh.facets(*name)
        owned = space.dofmap.index_map.size_local
        nodes = compat.locate_blocks(space, facets).astype(np.int64)
        nodes = nodes[nodes < owned]
        skin, areas = skin_of(space, facets, scene.section), compat.Function(compat.lagrange_space(space.mesh, scene.degree))
        np.add.at(areas.x.array, skin.nodes, np.einsum("eq,eqk->ek", skin.area, np.abs(skin.N)))
        compat.sum_to_owners(areas)
        weights = areas.x.array[nodes]
        total = self._system.comm.allreduce(float(weights.sum()))
        weights = weights if total > 0.0 else np.ones(len(nodes))  # a surface inside a body
        return _Group((3 * nodes[:, None] + np.array(along)).ravel(), nodes, weights)

    def names(self) -> list[str]:
        return list(self._groups)

    def at_state(self) -> dict[str, Reaction]:
        """The Reaction of each group at the state assembled last. Collective."""
        system = self._system
        forces, u = np.zeros(len(self._shared)), system.state.u.x.array.reshape(-1, 3)
        forces[system.supports.dofs] = system.reactions
        forces = np.divide(forces, self._shared, out=np.zeros_like(forces), where=self._shared > 0.0)
        x = system.space.tabulate_dof_coordinates() + u
        found = {}
        for name, group in self._groups.items():
            mine = np.zeros((len(u), 3))
            mine.ravel()[group.dofs] = forces[group.dofs]
            mine, here = mine[group.nodes], x[group.nodes]
            sums = np.concatenate([mine.sum(axis=0), np.cross(here, mine).sum(axis=0), group.weights @ here])
            sums = system.comm.allreduce(np.append(sums, group.weights.sum()))
            centroid = sums[6:9] / max(sums[9], 1e-300)
            found[name] = Reaction(sums[:3], sums[3:6] - np.cross(centroid, sums[:3]), centroid)
        return found
