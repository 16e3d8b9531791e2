"""A moment on a surface, fixed in space while the surface turns: nodal forces about its present centroid."""

from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.exchange import lasting
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.assembly.pose import skew
from fenics_contact.assembly.term import FormTerm, State
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Floats, Ints, Ints64, Space


class Moment(FormTerm):
    """Forces f_i = w_i a x r_i on the nodes i of a surface, r_i from their present centroid, with J a = M.

    w_i: their areas at the start, J = sum w (r.r I - r r^T). The forces have no resultant and exactly the moment M, about
    any point, and their power is M times the mean spin of the surface, J^-1 sum w r x v, which they do not stiffen. Every
    rank knows the surface's nodes. nodes (n,): local numbers; facets: local ones.
    """

    def __init__(self, name: str, space: Space, nodes: Ints, facets: Ints) -> None:
        super().__init__(name, None, None, symmetric=False)
        self._comm, index_map = lasting(space.mesh.comm), space.dofmap.index_map
        self._owned = nodes[nodes < index_map.size_local].astype(np.int64)
        self._X = space.tabulate_dof_coordinates()[self._owned]
        skin, areas = skin_of(space, facets), compat.node_values(space)
        np.add.at(areas.array, skin.nodes, np.einsum("eq,eqk->ek", skin.area, skin.N))
        compat.sum_to_owners(areas)
        self._weights = self._all(areas.array[self._owned])
        self._blocks: Ints64 = self._all(self._owned + index_map.local_range[0])  # rising: ranks have theirs in a row
        first = int(np.searchsorted(self._blocks, index_map.local_range[0]))
        self._mine, self._total, self._told = slice(first, first + len(self._owned)), index_map.size_global, False
        self._moment = np.zeros(3)

    def set_moment(self, moment: Floats) -> None:
        """Take the moment (3,) [force length] of a load parameter."""
        self._moment[:] = moment

    def _all(self, mine: Any) -> Any:
        return np.concatenate(self._comm.allgather(mine))

    def _state(self, state: State) -> tuple[Floats, Floats, Floats]:
        """Places r (n, 3) from the centroid, J^-1 (3, 3) and a (3,). Collective."""
        x, w = self._all(self._X + state.u.x.array.reshape(-1, 3)[self._owned]), self._weights
        r = x - w @ x / w.sum()
        J = np.einsum("n,nc,nc->", w, r, r) * np.eye(3) - np.einsum("n,nc,nd->cd", w, r, r)
        inverse = np.linalg.inv(J)
        return r, inverse, inverse @ self._moment

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None:
        r, _, a = self._state(state)
        forces = self._weights[self._mine, None] * np.cross(a, r[self._mine])
        residual.reshape(-1, 3)[self._owned] -= forces

    def couplings(self, state: State, trials: Trials | None = None) -> Any:
        """All of the surface's nodes with each other, from the first tangent on."""
        if self._told:
            return None
        self._told = True
        return (self._blocks[self._mine][:, None] * self._total + self._blocks).ravel()

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        """df_i/dx_j = w_i ([a] (I d_ij - w_j/W) - [r_i] da/dx_j), da/dx_j = -J^-1 w_j (2 a r_j^T - (r_j.a) I - r_j a^T)."""
        (r, inverse, a), w = self._state(state), self._weights
        turned = 2.0 * np.einsum("c,jd->jcd", a, r) - np.einsum("jc,c->j", r, a)[:, None, None] * np.eye(3)
        turned -= np.einsum("jc,d->jcd", r, a)
        rate = -np.einsum("cd,j,jde->jce", inverse, w, turned)
        mine = np.arange(len(w))[self._mine]
        values = -np.einsum("icd,jde->ijce", skew(r[mine]), rate) - skew(a) * (w / w.sum())[None, :, None, None]
        values[np.arange(len(mine)), mine] += skew(a)
        values *= -w[mine, None, None, None]
        rows, columns = np.repeat(self._blocks[mine], len(w)), np.tile(self._blocks, len(mine))
        return Blocks(pairs=(rows, columns, np.ascontiguousarray(values.reshape(-1, 3, 3))))
