"""Reactions of the groups of surfaces that supports hold or move."""

from dataclasses import dataclass

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.entries import Carried
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.assembly.system import System
from fenics_contact.scene.scene import Scene
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
    entries: list[int]  # numbers of its statements
    nodes: Ints64  # owned ones of it
    weights: Floats  # of these nodes in the centroid
    carried: list[tuple[int, Carried]]  # numbers of the entries by which nodes that lead others on hold these for it


class Reactions:
    """Of every group named in a support, by name. Each statement gives a force along its direction; where two prescribe the
    same displacement of a node each of them has half of its reaction: so the groups' forces add up to all that supports
    give."""

    def __init__(self, scene: Scene, system: System) -> None:
        self._X = system.space.tabulate_dof_coordinates()
        self._system, self._directions = system, [np.array(support.direction) for support in scene.supports]
        entries: dict[tuple[str, ...], list[int]] = {}
        for i, support in enumerate(scene.supports):
            entries.setdefault(support.group, []).append(i)
        self._pair_names = [pair.column for pair in scene.pairs]
        self._groups = {"+".join(name): self._group(scene, name, of_it) for name, of_it in entries.items()}

    def _group(self, scene: Scene, name: tuple[str, ...], entries: list[int]) -> _Group:
        space, facets = scene.space, scene.mesh.facets(*(part for part in name if part in scene.mesh.surfaces))
        owned = space.dofmap.index_map.size_local
        nodes = scene.mesh.nodes(space, *name).astype(np.int64)
        nodes = nodes[nodes < owned]
        skin, areas = skin_of(space, facets, scene.section), compat.node_values(space)
        np.add.at(areas.array, skin.nodes, np.einsum("eq,eqk->ek", skin.area, np.abs(skin.N)))
        compat.sum_to_owners(areas)
        weights = areas.array[nodes]
        total = self._system.comm.allreduce(float(weights.sum()))
        weights = weights if total > 0.0 else np.ones(len(nodes))  # a surface inside a body, edges
        carried = [(i, entry.carried) for i, entry in enumerate(self._system.supports.entries.all)
                   if entry.carried is not None and entry.carried.statement in entries]  # fmt: skip
        return _Group(entries, nodes, weights, carried)

    def _carried(self, i: int, carried: Carried, leads: Ints64, forces: Floats) -> tuple[Floats, Floats]:
        """Forces (n, 3) on followers of this rank's leading nodes, and where these are (n, 3)."""
        system = self._system
        mine = leads < system.space.dofmap.index_map.size_local
        u, turn = system.state.u.x.array.reshape(-1, 3)[leads[mine]], carried.turn[mine]
        way = np.einsum("nab,nb->na", turn, u) + carried.offset(system.state.t)[mine]
        return forces[mine][:, None] * (turn @ system.supports.entries.all[i].direction), carried.X[mine] + way

    def of_pairs(self) -> dict[str, Floats]:
        """Forces (3,) that lead the second faces of pairs, without those of supports, at the state assembled last: what does
        work on their ways. Collective."""
        supports = self._system.supports
        if supports.pairs is None:
            return {}
        total = supports.pairs.on_ways(supports.relative_forces(self._system.reactions))
        for entry, (leads, forces) in zip(supports.entries.all, supports.parts(self._system.reactions), strict=True):
            if entry.carried is not None:
                mine = leads < self._system.space.dofmap.index_map.size_local
                along = entry.carried.turn[mine] @ entry.direction
                total -= np.einsum("n,nc,ncpd->pd", forces[mine], along, entry.carried.ahead[mine])
        return dict(zip(self._pair_names, self._system.comm.allreduce(total), strict=True))

    def names(self) -> list[str]:
        return list(self._groups)

    def at_state(self) -> dict[str, Reaction]:
        """The Reaction of each group at the state assembled last. Collective."""
        system = self._system
        u, parts = system.state.u.x.array.reshape(-1, 3), system.supports.parts(system.reactions)
        x = self._X + u
        found = {}
        for name, group in self._groups.items():
            mine = np.zeros((len(u), 3))
            for i in group.entries:
                mine[parts[i][0]] += parts[i][1][:, None] * self._directions[i]
            mine, here = mine[group.nodes], x[group.nodes]
            sums = np.concatenate([mine.sum(axis=0), np.cross(here, mine).sum(axis=0), group.weights @ here])
            for i, carried in group.carried:
                force, place = self._carried(i, carried, *parts[i])
                sums[:6] += np.concatenate([force.sum(axis=0), np.cross(place, force).sum(axis=0)])
            sums = system.comm.allreduce(np.append(sums, group.weights.sum()))
            centroid = sums[6:9] / max(sums[9], 1e-300)
            found[name] = Reaction(sums[:3], sums[3:6] - np.cross(centroid, sums[:3]), centroid)
        return found
