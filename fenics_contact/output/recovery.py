"""Stresses at nodes, fitted to those within the cells around them.

Strains are most accurate within cells, not at their nodes (Barlow 1976, doi:10.1002/nme.1620100202). So a polynomial of
degree 1 is fitted to what the cells around a node have there, and taken at the node (superconvergent patch recovery:
Zienkiewicz & Zhu 1992, doi:10.1002/nme.1620330702), each body by itself: stresses jump from one to the next.
"""

from collections.abc import Sequence

import numpy as np

from fenics_contact import compat
from fenics_contact.types import Bools, Floats, Ints, Space

# A fit is followed along a direction from its points' mean to the node where the square of that way is less than this many
# times their variance: in the corner of one cell of degree 2 it is three times. Points in one layer tell nothing across it
FARTHEST = 6.0
NO_WIDTH = 1e-12  # of the squares of the points' distances to the node: a variance that is round-off


class Patches:
    """Fits at the corners of one body's cells. Construction and `fitted` are collective.

    space: of degree 1; cells: this rank's own ones of the body; points (cells, k, 3): where they have values, in the same
    configuration as the space's nodes. nodes: the local nodes of the body's cells, those of other ranks' among them.
    """

    def __init__(self, space: Space, cells: Ints, points: Floats) -> None:
        dim = space.mesh.topology.dim
        self._space, self._corners, self._points = space, compat.cell_dofs(space)[cells], points[..., :dim]
        self._X, all_of = space.tabulate_dof_coordinates()[:, :dim], range(dim)
        away = [self._away(i) for i in all_of]
        ones = np.full(self._corners.shape, float(points.shape[1]))
        products = (away[i] * away[j] for i in all_of for j in all_of)
        sums = self._summed([ones, *(part.sum(axis=2) for part in (*away, *products))], self._corners)
        self.nodes = np.flatnonzero(sums[:, 0] > 0.0)
        self._count = np.maximum(sums[:, 0], 1.0)
        self._mean = sums[:, 1 : dim + 1] / self._count[:, None]
        squares = (sums[:, dim + 1 :] / self._count[:, None]).reshape(-1, dim, dim)
        variance, ways = np.linalg.eigh(squares - self._mean[:, :, None] * self._mean[:, None])
        reach = np.einsum("nd,ndv->nv", self._mean, ways) ** 2
        kept = (reach < FARTHEST * variance) & (variance > NO_WIDTH * np.trace(squares, axis1=1, axis2=2)[:, None])
        self._rank = np.where(sums[:, 0] > 0.0, kept.sum(axis=1), -1)  # directions of which a node's own fit tells
        self._slopes = np.einsum("nav,nv,nbv->nab", ways, np.where(kept, 1.0 / np.where(kept, variance, 1.0), 0.0), ways)

    def fitted(self, values: Floats) -> Floats:
        """Values (nodes, m) at `nodes` of those (cells, k, m) at the points: of a node's own fit, or, where nodes in its
        cells have such as tell of more directions, the mean of theirs. Collective."""
        dim, many = self._mean.shape[1], values.shape[-1]
        each = np.broadcast_to(values.sum(axis=1)[:, None], (*self._corners.shape, many))
        columns = [each[..., m] for m in range(many)]
        for i in range(dim):
            away = self._away(i)
            columns += [np.einsum("cpk,ck->cp", away, values[..., m]) for m in range(many)]
        sums = self._summed(columns, self._corners).reshape(-1, dim + 1, many) / self._count[:, None, None]
        slopes = self._slopes @ (sums[:, 1:] - self._mean[:, :, None] * sums[:, :1])
        own = np.concatenate([sums[:, :1] - np.einsum("nd,ndm->nm", self._mean, slopes)[:, None], slopes], axis=1)
        fits, known = np.zeros_like(own), np.zeros(len(own), dtype=bool)
        for rank in range(dim, -1, -1):
            now = (self._rank == rank) & ~known
            fits[now], known[now] = own[now], True
            self._carry_on(fits, known)
        return np.asarray(fits[self.nodes, 0])

    def _carry_on(self, fits: Floats, known: Bools) -> None:
        """Give nodes (n,) that are not known the mean of the known fits (n, 1 + dim, m) in their cells. Collective."""
        near = known[self._corners]
        some = near.any(axis=1) & ~near.all(axis=1)
        corners, near = self._corners[some], near[some]
        away, size = self._X[corners] - self._X[corners[:, :1]], int(np.prod(fits.shape[1:]))
        there = _moved(fits[corners], -away) * near[..., None, None]
        each = _moved(there.sum(axis=1, keepdims=True), away).reshape(*near.shape, size)
        count = np.broadcast_to(near.sum(axis=1, keepdims=True), near.shape)
        sums = self._summed([*np.moveaxis(each, -1, 0), count], corners)
        fresh = (sums[:, -1] > 0.0) & ~known
        fits[fresh] = (sums[fresh, :-1] / sums[fresh, -1:]).reshape(-1, *fits.shape[1:])
        known |= fresh

    def _away(self, axis: int) -> Floats:
        """Of the points from the corners, along an axis, (cells, corners, k)."""
        return self._points[:, None, :, axis] - self._X[self._corners, axis][:, :, None]

    def _summed(self, parts: Sequence[Floats], corners: Ints) -> Floats:
        """Sums (n, parts) at the local nodes over all ranks' cells of what these have at their corners (cells, corners), the
        same shape each. Collective."""
        columns = [np.bincount(corners.ravel(), part.ravel(), len(self._X)) for part in parts]
        sums = compat.node_values(self._space, len(columns))
        sums.array[:] = np.stack(columns, axis=1).ravel()
        compat.sum_to_owners(sums)
        compat.copy_to_ghosts(sums)
        return np.array(sums.array).reshape(-1, len(columns))


def _moved(fits: Floats, way: Floats) -> Floats:
    """Polynomials (..., 1 + dim, m) about places that lie a way (..., dim) farther."""
    out = np.array(np.broadcast_to(fits, (*way.shape[:-1], *fits.shape[-2:])))
    out[..., 0, :] += np.einsum("...d,...dm->...m", way, out[..., 1:, :])
    return out
