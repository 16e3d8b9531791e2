"""Prescribed dofs as functions of the load parameter t."""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.change import Change
from fenics_contact.assembly.entries import Entries
from fenics_contact.assembly.pairs import Pairs
from fenics_contact.assembly.ties import Ties
from fenics_contact.assembly.turned import ONE, Turned
from fenics_contact.types import Floats, Ints, Ints64, Mat, Space


class Supports:
    """Dofs with prescribed displacement: components along the nodes' axes, which are x, y, z but for turned nodes.

    space: of u; entries: Entries. dofs: 3 node + axis, local, first those of nodes that are not
    turned; owned: those of owned nodes; turned: the nodes where a support along another direction acts, with all supports
    that meet there, None where no rank has one; ties: of nodes in none of the entries, which rigid bodies hold, tied: which
    of the dofs are theirs; pairs: of nodes in neither, whose displacement relative to those that lead them is prescribed;
    change: u = T v such that all is components of v, None: they are those of u. Collective, but for `free`, `spanned` and
    `parts`.
    """

    def __init__(self, space: Space, entries: Entries, ties: Ties | None = None, pairs: Pairs | None = None) -> None:
        self.entries, self.ties, self.pairs = entries, ties or Ties(), pairs
        nodes, directions, entry = entries.nodes, entries.directions, entries.entry
        skew = np.count_nonzero(directions, axis=1) > 1
        apart = np.isin(nodes, nodes[skew[entry]])
        self._straight = np.flatnonzero(~apart)
        axis, sign = np.abs(directions).argmax(axis=1), directions.sum(axis=1)
        self._sign = sign[entry]
        dofs = 3 * nodes[self._straight] + axis[entry[self._straight]]
        stated, self._first, self._inverse = np.unique(dofs, return_index=True, return_inverse=True)
        plain = np.union1d(stated, self.ties.dofs)
        self._stated = np.atleast_1d(np.searchsorted(plain, stated))
        self.turned = self._turned(np.flatnonzero(apart)) if skew.any() else None
        turned = 3 * self.turned.nodes[:, None] + np.arange(3) if self.turned else np.empty((0, 3), dtype=np.int64)
        held = [plain, turned[self.turned.held] if self.turned else turned.ravel()]
        self._plain, self._alone = plain, sum(map(len, held))
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

    def _turned(self, rows: Ints64) -> Turned:
        """The nodes of these rows of the entries."""
        nodes = self.entries.nodes
        rows = rows[np.argsort(nodes[rows], kind="stable")]
        known, first, count = np.unique(nodes[rows], return_index=True, return_counts=True)
        places = np.arange(max(count, default=0))
        there = places < count[:, None]
        self._rows = np.where(there, rows[np.minimum(first[:, None] + places, len(rows) - 1)], -1)
        directions = np.where(there[..., None], self.entries.directions[self.entries.entry[self._rows]], 0.0)
        return Turned(known, directions)

    @property
    def meet(self) -> bool:
        """Whether nodes of this rank have several statements that could contradict each other."""
        return len(self._straight) > len(self._first) or self.turned is not None

    def conflict(self, t: float) -> tuple[str, str] | None:
        """Names of two entries that contradict each other on this rank at t, or None. Collective."""
        entries, values = self.entries, self.entries.values(t)
        allowed = 1e-12 * max(1.0, np.abs(values).max(initial=0.0))
        along = values[self._straight] * self._sign[self._straight]
        gap = np.abs(along - along[self._first][self._inverse])
        if gap.size and gap.max() > allowed:
            worst = int(gap.argmax())
            pair = self._straight[[self._first[self._inverse[worst]], worst]]
            return entries.names[entries.entry[pair[0]]], entries.names[entries.entry[pair[1]]]
        if self.turned is not None and self._rows.size:
            made = np.einsum("nmk,nm->nk", self.turned.shares, self._at_turned(values))
            made = np.einsum("nmc,nck,nk->nm", self.turned.directions, self.turned.axes, made)
            gap = np.abs(made - self._at_turned(values))
            # directions that count as one may differ by ONE
            if gap.max() > allowed + ONE * np.abs(values).max():
                rows = self._rows[gap.max(axis=1).argmax()]
                met = entries.entry[rows[rows >= 0]]
                one, other = _contradicting(entries.directions[met], values[rows[rows >= 0]])
                return entries.names[met[one]], entries.names[met[other]]
        return None

    def _at_turned(self, values: Floats) -> Floats:
        """Values (n, m) of the statements at turned nodes, of all rows' values."""
        return np.where(self._rows >= 0, values[self._rows], 0.0)

    def values(self, t: float) -> Floats:
        """Prescribed displacements [length] of `dofs` at load parameter t; zero of those that are tied."""
        values, plain = self.entries.values(t), np.zeros(len(self._plain))
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
        entries, forces = self.entries, np.zeros(len(self.entries.nodes))
        plain = reactions[self._stated] / np.maximum(np.bincount(self._inverse, minlength=len(self._stated)), 1)
        forces[self._straight] = plain[self._inverse] * self._sign[self._straight]
        if self.turned is not None:
            components = np.zeros((len(self.turned.nodes), 3))
            components[self.turned.held] = reactions[len(self._plain) : self._alone]
            along = np.einsum("nmk,nk->nm", self.turned.shares, components)
            forces[self._rows[self._rows >= 0]] = along[self._rows >= 0]
        return list(zip(entries.parted, entries.split(forces), strict=True))


def _contradicting(directions: Floats, values: Floats) -> tuple[int, int]:
    """Of displacements (m,) along unit directions (m, 3) that cannot all be, the first that those before it do not allow,
    behind the one of these whose direction is nearest to its own."""
    for last in range(1, len(values)):
        known = directions[: last + 1]
        u = np.linalg.lstsq(known, values[: last + 1], rcond=ONE)[0]
        if np.abs(known @ u - values[: last + 1]).max() > ONE * np.abs(values).max():
            break
    return int(np.abs(directions[:last] @ directions[last]).argmax()), last
