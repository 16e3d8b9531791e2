"""Prescribed dofs and moved or pushed tools as functions of the load parameter t."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.change import Change
from fenics_contact.assembly.pairs import Pairs
from fenics_contact.assembly.pose import Poses
from fenics_contact.assembly.stages import Stages
from fenics_contact.assembly.ties import Ties
from fenics_contact.assembly.turned import ONE, Turned
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64, Mat, Space

Paths = Sequence[Callable[[float], Floats]]  # of each tool: t -> (6,)


class Prescribed(Protocol):
    """Displacements [length] of an entry's nodes (n,) at t; few: what its stage states at t, the same on all ranks, of a
    function at a few points; jump: the largest step [length] that it makes on this rank at the very start of the stage;
    begin, said: see Supports."""

    def __call__(self, t: float) -> Floats: ...

    def few(self, t: float) -> Floats: ...

    def jump(self) -> float: ...

    def begin(self, origin: Floats, before: Sequence[float]) -> None: ...

    def said(self) -> list[float]: ...


class Carried(NamedTuple):
    """Of an entry whose nodes lead those of paired faces that a statement holds: its number; of these X (n, 3) [length],
    how they follow as in Follower, and how far they are ahead, t -> (n, 3) [length], which all ranks call."""

    statement: int
    X: Floats
    turn: Floats
    ahead: Floats
    offset: Callable[[float], Floats]


class Support(NamedTuple):
    """Displacement of local nodes (n,), ghosts included, along a unit direction (3,): a function of t that gives (n,) and
    that all ranks call [length]; carried: for which nodes they stand."""

    nodes: Ints
    direction: Floats
    value: Prescribed
    carried: Carried | None = None


class Hindered(NamedTuple):
    """A support of local nodes (n,) that are tied to a body, which it must not hinder: its name, unit direction (3,) and
    what it prescribes of them."""

    name: str
    nodes: Ints64
    direction: Floats
    value: Prescribed


class Supports:
    """Dofs with prescribed displacement: components along the nodes' axes, which are x, y, z but for turned nodes.

    space: of u; entries: Support; names: of the entries. dofs: 3 node + axis, local, first those of nodes that are not
    turned; owned: those of owned nodes; turned: the nodes where a support along another direction acts, with all supports
    that meet there, None where no rank has one; ties: of nodes in none of the entries, which rigid bodies hold, tied: which
    of the dofs are theirs; pairs: of nodes in neither, whose displacement relative to those that lead them is prescribed;
    hindered: of tied nodes, which have no other part in this; change: u = T v such that all is components of v, None: they
    are those of u. Collective, but for `free`, `spanned` and `parts`.
    """

    def __init__(
        self, space: Space, entries: Sequence[Support], names: Sequence[str], ties: Ties | None = None,
        pairs: Pairs | None = None, hindered: Sequence[Hindered] = (),
    ) -> None:  # fmt: skip
        self.entries, self._names, self.ties, self.pairs = entries, names, ties or Ties(), pairs
        self.hindered = hindered
        nodes = _joined([np.asarray(entry.nodes, dtype=np.int64) for entry in entries], np.int64)
        self._entry = np.repeat(np.arange(len(entries)), [len(entry.nodes) for entry in entries])
        self._directions = np.array([entry.direction for entry in entries], dtype=float).reshape(-1, 3)
        skew = np.count_nonzero(self._directions, axis=1) > 1
        apart = np.isin(nodes, nodes[skew[self._entry]])
        self._straight = np.flatnonzero(~apart)
        axis, sign = np.abs(self._directions).argmax(axis=1), self._directions.sum(axis=1)
        self._sign = sign[self._entry]
        dofs = 3 * nodes[self._straight] + axis[self._entry[self._straight]]
        stated, self._first, self._inverse = np.unique(dofs, return_index=True, return_inverse=True)
        plain = np.union1d(stated, self.ties.dofs)
        self._stated = np.atleast_1d(np.searchsorted(plain, stated))
        self.turned = self._turned(nodes, np.flatnonzero(apart)) if skew.any() else None
        turned = 3 * self.turned.nodes[:, None] + np.arange(3) if self.turned else np.empty((0, 3), dtype=np.int64)
        held = [plain, turned[self.turned.held] if self.turned else turned.ravel()]
        self._plain, self._nodes, self._alone = plain, nodes, sum(map(len, held))
        self.dofs = np.concatenate([*held, pairs.dofs] if pairs else held)
        self.change = self._change(space)
        self._free_of_led = np.tile(np.eye(3), (len(pairs.nodes) if pairs else 0, 1, 1))
        if pairs is not None:
            self._free_of_led = self._led_free(pairs, space)
        self.tied = np.isin(self.dofs, self.ties.dofs)
        self.owned = self.dofs[self.dofs < 3 * space.dofmap.index_map.size_local].astype(PETSc.IntType)

    def _change(self, space: Space) -> Change | None:
        changes = [part.change(space) for part in (self.pairs, self.turned) if part is not None]
        return changes[0].after(changes[1], space) if len(changes) > 1 else changes[0] if changes else None

    def _turned(self, nodes: Ints64, rows: Ints64) -> Turned:
        """The nodes of these rows of all entries."""
        rows = rows[np.argsort(nodes[rows], kind="stable")]
        known, first, count = np.unique(nodes[rows], return_index=True, return_counts=True)
        places = np.arange(max(count, default=0))
        there = places < count[:, None]
        self._rows = np.where(there, rows[np.minimum(first[:, None] + places, len(rows) - 1)], -1)
        directions = np.where(there[..., None], self._directions[self._entry[self._rows]], 0.0)
        return Turned(known, directions)

    @property
    def meet(self) -> bool:
        """Whether nodes of this rank have several statements that could contradict each other."""
        return len(self._straight) > len(self._first) or self.turned is not None

    def conflict(self, t: float) -> tuple[str, str] | None:
        """Names of two entries that contradict each other on this rank at t, or None. Collective."""
        return self._contradiction(self._all(t))

    def _contradiction(self, values: Floats) -> tuple[str, str] | None:
        allowed = 1e-12 * max(1.0, np.abs(values).max(initial=0.0))
        along = values[self._straight] * self._sign[self._straight]
        gap = np.abs(along - along[self._first][self._inverse])
        if gap.size and gap.max() > allowed:
            worst = int(gap.argmax())
            pair = self._straight[[self._first[self._inverse[worst]], worst]]
            return self._names[self._entry[pair[0]]], self._names[self._entry[pair[1]]]
        if self.turned is not None and self._rows.size:
            made = np.einsum("nmk,nm->nk", self.turned.shares, self._at_turned(values))
            made = np.einsum("nmc,nck,nk->nm", self.turned.directions, self.turned.axes, made)
            gap = np.abs(made - self._at_turned(values))
            # directions that count as one may differ by ONE
            if gap.max() > allowed + ONE * np.abs(values).max():
                rows = self._rows[gap.max(axis=1).argmax()]
                one, other = _contradicting(self._directions[self._entry[rows[rows >= 0]]], values[rows[rows >= 0]])
                return self._names[self._entry[rows[one]]], self._names[self._entry[rows[other]]]
        return None

    def _at_turned(self, values: Floats) -> Floats:
        """Values (n, m) of the statements at turned nodes, of all rows' values."""
        return np.where(self._rows >= 0, values[self._rows], 0.0)

    def _all(self, t: float) -> Floats:
        return _joined([entry.value(t) for entry in self.entries], float)

    def sampled(self, times: Iterable[float]) -> dict[str, list[float]]:
        """{name: what the stage that is on prescribes [length] at these t, by a function at a few points}. Collective."""
        out: dict[str, list[float]] = {}
        for (_, _, value, _), name in zip(self.entries, self._names, strict=True):
            at = [value.few(t) for t in times]
            out[name] = out.get(name, []) + [float(x) for x in np.concatenate(at)]
        return out

    def largest(self, t: float) -> list[tuple[str, float]]:
        """[(name, largest displacement [length] on this rank)] of all entries at t."""
        parts = np.split(np.abs(self._all(t)), np.cumsum([len(entry.nodes) for entry in self.entries]))
        return [(name, float(part.max(initial=0.0))) for name, part in zip(self._names, parts[:-1], strict=True)]

    def jumps(self) -> list[tuple[str, float]]:
        """[(name, largest step [length] on this rank)] of all entries at the very start of the stage. Collective."""
        return [(name, value.jump()) for (_, _, value, _), name in zip(self.entries, self._names, strict=True)]

    def begin(self, u: Floats, before: Mapping[str, Sequence[float]]) -> None:
        """Start from a displacement u (local array) of another run; before: {name: what its scene said}. Collective."""
        for (nodes, direction, value, _), name in zip(self.entries, self._names, strict=True):
            value.begin(u.reshape(-1, 3)[nodes] @ direction, before.get(name, ()))
        for name, tied, direction, value in self.hindered:
            value.begin(u.reshape(-1, 3)[tied] @ direction, before.get(name, ()))

    def said(self) -> dict[str, list[float]]:
        """{name: what the scene states of it}. Collective."""
        return {name: value.said() for (_, _, value, _), name in zip(self.entries, self._names, strict=True)}

    def values(self, t: float) -> Floats:
        """Prescribed displacements [length] of `dofs` at load parameter t; zero of those that are tied."""
        values, plain = self._all(t), np.zeros(len(self._plain))
        plain[self._stated] = (values * self._sign)[self._straight][self._first]
        out = [plain]
        if self.turned is not None:
            made = np.einsum("nmk,nm->nk", self.turned.shares, self._at_turned(values))
            out.append(made[self.turned.held])
        if self.pairs is not None:
            out.append(self.pairs.values(t))
        return np.concatenate(out)

    # -- of local arrays of u or of forces, of owned dofs or with the ghosts behind them --------------------------
    def held(self, u: Floats) -> Floats:
        """Components of a displacement at `dofs`, as many as the array has."""
        held = self._components(u)
        return held if self.pairs is None else np.append(held, self.pairs.relative(u))

    def put(self, u: Floats, values: Floats | float) -> None:
        """Set the components of a displacement at `dofs`, as many as the array has; other ones stay."""
        values = np.broadcast_to(values, len(self.dofs))
        self._set(u, values)
        if self.pairs is not None:
            self.pairs.place(u, values[self._alone :].reshape(-1, 3))

    def held_forces(self, forces: Floats) -> Floats:
        """What forces do on the components at `dofs`, as many as the array has; exact where these are owned."""
        if self.pairs is None:
            return self._components(forces)
        folded = forces.copy()
        self.pairs.fold(folded)
        own = folded.reshape(-1, 3)[self.pairs.nodes[: self.pairs.count(forces)]]
        return np.append(self._components(folded), own)

    def put_forces(self, forces: Floats, values: Floats | float) -> None:
        """Set what forces do on the components at `dofs`, as many as the array has; on other ones they do what they did."""
        values = np.broadcast_to(values, len(self.dofs))
        if self.pairs is None:
            self._set(forces, values)
            return
        self.pairs.fold(forces)
        self._set(forces, values)
        count = self.pairs.count(forces)
        forces.reshape(-1, 3)[self.pairs.nodes[:count]] = values[self._alone :].reshape(-1, 3)[:count]
        self.pairs.fold(forces, -1.0)

    def _components(self, array: Floats) -> Floats:
        """Of the nodes that follow no others."""
        plain = array[self._plain[: np.searchsorted(self._plain, len(array))]]
        if self.turned is None:
            return plain
        components = self.turned.components(array)
        return np.concatenate([plain, components[self.turned.held[: len(components)]]])

    def _set(self, array: Floats, values: Floats) -> None:
        """The same, of values of all dofs."""
        plain = self._plain[: np.searchsorted(self._plain, len(array))]
        array[plain] = values[: len(plain)]
        if self.turned is not None:
            components = self.turned.components(array)
            mask = self.turned.held[: len(components)]
            components[mask] = values[len(self._plain) : len(self._plain) + int(mask.sum())]
            self.turned.put(array, components)

    def eliminated(self, matrix: Mat, diagonal: float, pattern: int | None = None) -> Mat:
        """The tangent with unit rows and columns, times `diagonal`, of all held dofs: itself, or that of `change`.

        pattern: number that changes with its nonzero pattern; None: unlike any before."""
        if self.change is not None:
            matrix = self.change.changed(matrix, pattern)
        matrix.zeroRowsColumns(self.owned + matrix.getOwnershipRange()[0], diagonal)
        return matrix

    # -- what else is asked ---------------------------------------------------------------------------------------
    def free(self, nodes: Ints | Ints64) -> Floats:
        """Unit directions (..., 3, 3) of nodes (...), by rows, in which no support leads them; zero in their places."""
        out = np.broadcast_to(np.eye(3), (*nodes.shape, 3, 3)).copy()
        if self.turned is not None and len(self.turned.nodes):
            at = np.minimum(np.searchsorted(self.turned.nodes, nodes), len(self.turned.nodes) - 1)
            of_turned = self.turned.nodes[at] == nodes
            out[of_turned] = self.turned.axes[at[of_turned]].transpose(0, 2, 1)
        out[np.isin(3 * nodes[..., None].astype(np.int64) + np.arange(3), self.dofs[: self._alone])] = 0.0
        if self.pairs is not None and len(self.pairs.nodes):
            at = np.minimum(np.searchsorted(self.pairs.nodes, nodes), len(self.pairs.nodes) - 1)
            follows = self.pairs.nodes[at] == nodes
            out[follows] = self._free_of_led[at[follows]]
        return out

    def _led_free(self, pairs: Pairs, space: Space) -> Floats:
        """Directions (n, 3, 3), by rows, in which the nodes that follow others may go."""
        free = self.free(np.arange(space.dofmap.index_map.size_local))
        led = np.stack([pairs.led(free[:, i].ravel()) for i in range(3)], axis=1)
        return np.einsum("nki,nji->nkj", led, pairs.follower.turn)

    def spanned(self, nodes: Ints64) -> Floats:
        """Sum (3, 3) of d d^T over the directions d along which these nodes are held: what it maps to zero is free."""
        free = self.free(nodes)
        held = len(nodes) * np.eye(3) - np.einsum("nki,nkj->ij", free, free)
        return held if self.pairs is None else held + self.pairs.spanned(nodes)

    def relative_forces(self, reactions: Floats) -> Floats:
        """Of all reactions those (n, 3) on nodes that follow others."""
        return reactions[self._alone :].reshape(-1, 3)

    def parts(self, reactions: Floats) -> list[tuple[Ints64, Floats]]:
        """Of every entry its nodes and the forces (n,) that it gives them along its direction, of the held components of all
        reactions; equal shares where entries hold the same."""
        forces = np.zeros(len(self._entry))
        plain = reactions[self._stated] / np.maximum(np.bincount(self._inverse, minlength=len(self._stated)), 1)
        forces[self._straight] = plain[self._inverse] * self._sign[self._straight]
        if self.turned is not None:
            components = np.zeros((len(self.turned.nodes), 3))
            components[self.turned.held] = reactions[len(self._plain) : self._alone]
            along = np.einsum("nmk,nk->nm", self.turned.shares, components)
            forces[self._rows[self._rows >= 0]] = along[self._rows >= 0]
        ends = np.cumsum([len(entry.nodes) for entry in self.entries])
        return list(zip(np.split(self._nodes, ends)[:-1], np.split(forces, ends)[:-1], strict=True))


def _contradicting(directions: Floats, values: Floats) -> tuple[int, int]:
    """Of displacements (m,) along unit directions (m, 3) that cannot all be, the first that those before it do not allow,
    behind the one of these whose direction is nearest to its own."""
    for last in range(1, len(values)):
        known = directions[: last + 1]
        u = np.linalg.lstsq(known, values[: last + 1], rcond=ONE)[0]
        if np.abs(known @ u - values[: last + 1]).max() > ONE * np.abs(values).max():
            break
    return int(np.abs(directions[:last] @ directions[last]).argmax()), last


def _joined(parts: Sequence[Array], kind: type) -> Array:
    return np.concatenate([np.empty(0, dtype=kind), *parts])


class ToolMotion:
    """Rigid tools' motion: prescribed components follow a path, free ones balance a load.

    stages: of the run; paths, loads: in the stage that is on, of each tool a function t -> (6,), travel and, times the
    lever, rotation vector [length]; force and, over the lever, moment [force]. points (tools, 3): where the reference points
    start [length]; free_by_stage: (tools, 6) bool of each stage; names; lever [length]: by which rotations are made lengths,
    and moments forces.
    """

    def __init__(
        self, stages: Stages, paths: Paths, loads: Paths, points: Sequence[Floats], free_by_stage: Sequence[Bools],
        names: Sequence[str], lever: float,
    ) -> None:  # fmt: skip
        self.stages, self.names, self.lever = stages, tuple(names), lever
        self._paths, self._loads, self._free_by_stage = paths, loads, free_by_stage
        self.points = np.asarray(points, dtype=float).reshape(len(paths), 3)

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

    def poses(self) -> Poses:
        """Of the tools at the start."""
        return Poses(self.points, self.lever, lambda: self.free[:, 3:].all(axis=1))


def _stack(functions: Paths, t: float) -> Floats:
    return np.array([f(t) for f in functions], dtype=float).reshape(len(functions), 6)
