"""Pressure of a fluid on surfaces that touch: it acts where contact does not press, as far as it has come in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks, ToolBlocks
from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.facet_points import ACROSS, Skin, skin_of
from fenics_contact.assembly.finding import foremost, spot
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.pose import skew
from fenics_contact.assembly.section import Section
from fenics_contact.assembly.term import FluidTerm, State
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Array, Bools, Floats, Ints, Ints64, Space

AS_MUCH = 1e-3  # of a fluid's pressure: contact that presses by no more beyond it might as well not touch


class Patch(NamedTuple):
    """A part of a surface, and the numbers of the contacts that have all of it as slave or master: none, one or several."""

    skin: Skin
    contacts: list[int]


def patches_of(space: Space, facets: Ints, touching: Sequence[Ints], section: Section | None = None) -> list[Patch]:
    """The Patches of a surface of local facets; touching: facets that each contact has as slave or master, of this surface
    and of others; section: what a plane mesh stands for. Collective."""
    among = np.array([np.isin(facets, of) for of in touching], dtype=bool).reshape(len(touching), len(facets))
    kinds = sorted({kind for part in space.mesh.comm.allgather({tuple(kind) for kind in among.T.tolist()}) for kind in part})
    skins = [skin_of(space, facets[(kind == among.T).all(axis=1)], section) for kind in kinds]
    return [Patch(skin, np.flatnonzero(kind).tolist()) for skin, kind in zip(skins, kinds, strict=True)]


class NodalSums:
    """Sums over all ranks of what each has at its local nodes. Collective."""

    def __init__(self, space: Space) -> None:
        self._work = compat.Function(space)
        self.count = len(self._work.x.array) // 3

    def of(self, values: Floats) -> Floats:
        """Sums (n, 3) at the local nodes, ghosts too, of values (n, 3) or (3 n,)."""
        self._work.x.array[:] = values.ravel()
        compat.sum_to_owners(self._work)
        compat.copy_to_ghosts(self._work)
        return self._work.x.array.reshape(-1, 3).copy()

    def anywhere(self, marks: Bools) -> Bools:
        """Nodes (n,) that any rank has marked."""
        return self.of(np.repeat(marks[:, None], 3, axis=1).astype(float))[:, 0] > 0.0

    def areas(self, skin: Skin, x: Floats) -> Floats:
        """Present area vectors (n, 3) of a skin at the local nodes, which are at x (n, 3) [length^2]."""
        first, second = skin.tangents(x[skin.nodes])
        out = np.zeros_like(x)
        np.add.at(out, skin.nodes, np.einsum("eq,eqk,eqc->ekc", skin.weights, skin.N, np.cross(first, second)))
        return self.of(out)


class _Pressed(NamedTuple):
    """Of a contact at the local nodes: the pressure p (n,), its part R (n, 3) of the residual, and H (n, 3)."""

    p: Floats
    R: Floats
    H: Floats


class Fluid(FluidTerm):
    """A fluid of pressure p_f on a surface: where contact presses a node of it with p, the node feels (p_f - p)_+ of the
    fluid on the facets around it that this contact has, so that the larger of both acts there, and p_f on facets of no
    contact, or of none that presses there, all along the present area vectors.

    p = R . H / |H|^2, with R a contact's part of the residual and H the area vector that its surfaces have at the node:
    so whatever a contact meets, and however, its pressure falls and the fluid's share grows by the same law, without a
    jump; where several contacts have a facet, p is their sum. Where a source is given the fluid acts only on nodes that it
    has `reached`: those of the source, and the nodes of each facet that has one that is reached and open there, p < p_f.
    That set stays while Newton's method looks for balance; `advance` moves it in balanced states.

    patches: of the surface; contacts: by number the terms, and the skins of all facets that each has; path(t): the pressure
    [pressure], one for all, or (n,) at the local nodes; source (n,): which local nodes the fluid comes from, None: it is
    everywhere. All methods that take a state are collective.
    """

    def __init__(
        self,
        name: str,
        space: Space,
        patches: Sequence[Patch],
        contacts: Mapping[int, tuple[ContactTerm, Skin]],
        path: Callable[[float], Floats],
        source: Bools | None,
    ) -> None:
        super().__init__(name, None, None, symmetric=False)
        self._space, self._path, self._pressure = space, path, np.zeros(())
        self._patches, self._contacts = patches, contacts
        self._owned = space.dofmap.index_map.size_local
        self._sums = NodalSums(space)
        self._source = None if source is None else self._sums.anywhere(source)
        self.reached = self._accepted = np.ones(self._sums.count, dtype=bool) if self._source is None else self._source
        on = np.unique(np.concatenate([patch.skin.nodes.ravel() for patch in patches]))
        self.nodes = on
        self._kept = on[on < self._owned] if source is not None else on[:0]
        self.key = node_keys(space)[self._kept] if source is not None else self.key

    def set_time(self, t: float) -> None:
        """Take the pressure of load parameter t."""
        self._pressure = self._path(t)

    # -- pressures at nodes ---------------------------------------------------------------------------------------
    def _place(self, state: State) -> Floats:
        return self._space.tabulate_dof_coordinates() + state.u.x.array.reshape(-1, 3)

    def _pressed(self, state: State, trials: Trials | None = None) -> dict[int, _Pressed]:
        """What each contact does at the local nodes. Collective."""
        out, x = dict[int, _Pressed](), self._place(state)
        for i, (contact, touching) in self._contacts.items():
            total, ignored = np.zeros_like(state.u.x.array), np.zeros_like(state.q)
            contact.add_residual(state, total, ignored, trials)
            R, H = self._sums.of(total), self._sums.areas(touching, x)
            square = np.einsum("nc,nc->n", H, H)
            p = np.divide(np.einsum("nc,nc->n", R, H), square, out=np.zeros(len(H)), where=square > 0.0)
            out[i] = _Pressed(p, R, H)
        return out

    def contact_pressure(self, state: State) -> Floats:
        """What contact presses the local nodes with on each patch (patches, n) [pressure]. Collective."""
        return self._on_patches(self._pressed(state))

    def _on_patches(self, pressed: dict[int, _Pressed]) -> Floats:
        none = np.zeros(self._sums.count)
        return np.array([sum((pressed[i].p for i in patch.contacts), none) for patch in self._patches])

    def share(self, state: State) -> Floats:
        """Of the fluid's pressure, what acts on the local nodes on each patch (patches, n). Collective."""
        most, acting = np.where(self.reached, self._pressure, 0.0), self._acting(self.contact_pressure(state))
        return np.divide(acting, most, out=np.zeros_like(acting), where=most > 0.0)

    def _acting(self, p: Floats) -> Floats:
        """Pressures (patches, n) of the fluid where contact presses with p (patches, n)."""
        return np.where(self.reached, np.maximum(self._pressure - p, 0.0), 0.0)

    # -- the term -------------------------------------------------------------------------------------------------
    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None:
        acting, x = self._acting(self._on_patches(self._pressed(state, trials))), self._place(state)
        for patch, p in zip(self._patches, acting, strict=True):
            residual[: 3 * self._owned] += (p[:, None] * self._sums.areas(patch.skin, x))[: self._owned].ravel()

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        """The exact derivative: that of the area vectors, and rows of the contacts' tangents, which give dp."""
        pressed, x, one = self._pressed(state, trials), self._place(state), np.eye(3)
        acting = self._acting(self._on_patches(pressed))
        parts = [_rates(patch.skin, x, p[:, None, None] * one) for patch, p in zip(self._patches, acting, strict=True)]
        areas = [
            self._sums.areas(patch.skin, x) * (p > 0.0)[:, None] for patch, p in zip(self._patches, acting, strict=True)
        ]
        for i, (contact, touching) in self._contacts.items():
            S = sum(
                (area for area, patch in zip(areas, self._patches, strict=True) if i in patch.contacts), np.zeros_like(x)
            )
            _, R, H = pressed[i]
            square = np.maximum(np.einsum("nc,nc->n", H, H), 1e-300)[:, None]
            # dp = (H . dR + R . (I - 2 H H^T / |H|^2) dH) / |H|^2
            turned = (R - 2.0 * (np.einsum("nc,nc->n", R, H)[:, None] / square) * H) / square
            parts.append(_rates(touching, x, -np.einsum("na,nb->nab", S, turned)))
            lifted = -np.einsum("na,nb->nab", S, H / square)
            parts.append(_scaled(contact.tangent(state, trials), lifted, self._everywhere(lifted)))
        return Blocks(parts=tuple(parts))

    def _everywhere(self, lifted: Floats) -> tuple[Ints64, Floats]:
        """Numbers (m,), rising, of the System's blocks whose rows are not zero, on all ranks, and the rows' factors."""
        mine = np.flatnonzero(np.abs(lifted[: self._owned]).max(axis=(1, 2), initial=0.0))
        found = self._space.mesh.comm.allgather((compat.global_blocks(self._space)[mine], lifted[mine]))
        blocks = np.concatenate([part[0] for part in found]).astype(np.int64)
        order = np.argsort(blocks)
        return blocks[order], np.concatenate([part[1] for part in found])[order]

    # -- how far the fluid has come -------------------------------------------------------------------------------
    def advance(self, state: State, back: bool) -> bool:
        """Let the fluid go, in a balanced state, to where it is connected to its source; whether that changed anything.
        back: may it also leave what is cut off? Collective."""
        if self._source is None:
            return False
        reached = self._connected(state)
        reached = reached if back else reached | self.reached
        changed = bool((reached != self.reached).any())
        self.reached = reached
        return bool(self._space.mesh.comm.allreduce(int(changed)))

    def gained(self) -> tuple[int, str, str] | None:
        """None where it is as in the accepted state; else how many nodes it has reached since, one of them that lay next to
        it and the one farthest from that, as text. Collective."""
        comm, X = self._space.mesh.comm, self._space.tabulate_dof_coordinates()
        mine = self.nodes[self.nodes < self._owned]
        fresh, known = self.reached[mine] & ~self._accepted[mine], self._accepted[mine]
        new, old = (np.concatenate(comm.allgather(X[mine[part]])) for part in (fresh, known))
        if not len(new):
            return None
        near = np.array([((old - x) ** 2).sum(axis=1).min(initial=np.inf) for x in new])
        first = foremost(comm, -near, new)
        here = first.place if first else new[0]
        last = foremost(comm, ((new - here) ** 2).sum(axis=1), new)
        return len(new), spot(here), spot(last.place if last else here)

    def opening(self, state: State, more: float) -> tuple[int, str, str] | None:
        """What it would gain in the accepted state if its pressure were greater by a share. Collective."""
        if self._source is None:
            return None
        pressure, self._pressure = self._pressure, (1.0 + more) * self._pressure
        self.reached = self._accepted | self._connected(state)
        gain = self.gained()
        self._pressure, self.reached = pressure, self._accepted
        return gain

    def _connected(self, state: State) -> Bools:
        """The local nodes (n,) that the fluid reaches under the present contact pressures. Collective."""
        pressed, none = self._pressed(state), np.zeros(self._sums.count, dtype=bool)
        held = [sum((pressed[i].R.any(axis=1) for i in patch.contacts), none) for patch in self._patches]
        is_open = (self._on_patches(pressed) < self._pressure) | ~np.array(held, dtype=bool)
        reached, before = self._source.copy() if self._source is not None else self.reached, -1
        while (count := self._space.mesh.comm.allreduce(int(reached[: self._owned].sum()))) != before:
            before, here = count, -1
            while (now := int(reached.sum())) != here:  # as far as this rank sees
                here = now
                for patch, passes in zip(self._patches, is_open, strict=True):
                    nodes = patch.skin.nodes
                    reached[nodes[(reached & passes)[nodes].any(axis=1)].ravel()] = True
            reached = self._sums.anywhere(reached)
        return reached

    def kept_out(self, state: State) -> tuple[list[str], float]:
        pressed, comm = self._pressed(state), self._space.mesh.comm
        dry, keeping = self._acting(self._on_patches(pressed)) == 0.0, list[str]()
        greatest = max(comm.allgather(float(self._pressure.max(initial=0.0))))
        for i, (contact, _) in self._contacts.items():
            on = [k for k, patch in enumerate(self._patches) if i in patch.contacts]
            if comm.allreduce(int((dry[on] & (pressed[i].p > (1.0 + AS_MUCH) * greatest)).sum())):
                keeping.append(contact.name)
        return keeping, greatest

    def commit(self, state: State) -> None:
        self._accepted = self.reached

    def rollback(self) -> None:
        self.reached = self._accepted

    def history(self) -> dict[str, Array]:
        return {} if self._source is None else {"reached": self._accepted[self._kept]}

    def restore(self, values: dict[str, Array], state: State) -> None:
        if self._source is not None:
            marks = np.zeros(len(self.reached), dtype=bool)
            marks[self._kept] = values["reached"]
            self.reached = self._accepted = self._sums.anywhere(marks)


def _rates(skin: Skin, x: Floats, factors: Floats) -> Blocks:
    """Element matrices of factors (n, 3, 3) times the rates of the nodes' area vectors, where nodes are at x (n, 3)."""
    first, second = skin.tangents(x[skin.nodes])
    # d(x_1 x x_2) = x_1 x dx_2 - x_2 x dx_1
    turns = -np.einsum("eqk,eqab->eqkab", skin.slopes[:, :, 0], skew(second))
    if skin.section is None:
        turns += np.einsum("eqk,eqab->eqkab", skin.slopes[:, :, 1], skew(first))
    elif skin.section.axisymmetric:  # the way round grows with x
        turns[..., 0] += 2.0 * np.pi * np.einsum("eqk,eqa->eqka", skin.N, np.cross(first, ACROSS))
    rates = np.einsum("eq,eqi,eqkab->eiakb", skin.weights, skin.N, turns)
    matrices = np.einsum("eica,eiakb->eickb", factors[skin.nodes], rates)
    k = 3 * skin.nodes.shape[1]
    return Blocks(cells=(skin.nodes, np.ascontiguousarray(matrices.reshape(-1, k, k))))


def _scaled(blocks: Blocks, lifted: Floats, known: tuple[Ints64, Floats]) -> Blocks:
    """A contact's tangent with its rows multiplied by lifted (n, 3, 3), or by `known` of the System's blocks; no forces on
    tools."""
    cells, pairs, tool = blocks.cells, blocks.pairs, blocks.tool
    if cells is not None:
        nodes, values = cells
        n, k = nodes.shape
        rows = np.einsum("nkab,nkbm->nkam", lifted[nodes], values.reshape(n, k, 3, 3 * k))
        cells = nodes, np.ascontiguousarray(rows.reshape(n, 3 * k, 3 * k))
    if pairs is not None:
        numbers, columns, values = pairs
        names, factors = known if blocks.whole else (np.arange(len(lifted)), lifted)
        place = np.minimum(np.searchsorted(names, numbers), max(len(names) - 1, 0))
        ours = names[place] == numbers if len(names) else np.zeros(len(numbers), dtype=bool)
        pairs = numbers[ours], columns[ours], np.ascontiguousarray(factors[place[ours]] @ values[ours])
    if tool is not None:
        moved = np.ascontiguousarray(lifted[tool.nodes] @ tool.columns)
        tool = ToolBlocks(tool.index, tool.nodes, moved, np.zeros_like(tool.rows), np.zeros_like(tool.corner))
    return Blocks(cells=cells, pairs=pairs, whole=blocks.whole, tool=tool)
