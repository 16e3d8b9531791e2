"""Cells with nodes between their corners: whether these are common to all cells around, and whether a side reaches into
another cell, which planes through corners do not say."""

import gmsh
import numpy as np

from fenics_contact.meetings import hashes, place_of
from fenics_contact.types import Array, Floats, Ints64

_STRAIGHT = {"Triangle": 2, "Quadrilateral": 3, "Tetrahedron": 4, "Hexahedron": 5}  # gmsh's types of cells of corners alone
_TURNS = 12  # of Newton's method, which doubles its digits in each: a cell is bent less than a quarter of a circle
_FOUND = 1e-9  # of a cell's size: what is left of the way to the point
_FOLLOWED = 1e-3  # of a cell: closer than that parabolas of 30 degrees follow a circle, so that two of its cuts differ less


def refuse_ambiguous(kind: int, cells: Ints64, X: Floats) -> None:
    """ValueError where a node is between other corners of one cell than of another, or where there are two nodes between the
    same corners: dolfinx knows one node of each corner, edge, side and cell, and writes past its memory's end.

    cells (n, k): nodes as rows of X (nodes, 3), each of which some cell has.
    """
    name, dim, order, _, nodes, count = gmsh.model.mesh.getElementProperties(kind)
    if order == 1:
        return
    shares = _shapes(_STRAIGHT[name.split()[0]], np.asarray(nodes).reshape(-1, dim))[..., 0]  # of each corner in each node
    corners = hashes(cells[:, :count] + 1)
    between, of_node = np.zeros(cells.shape, dtype=np.uint64), np.zeros(len(X), dtype=np.uint64)
    for row, share in enumerate(shares):
        between[:, row] = corners[:, share > 0.5 / count].sum(axis=1)
    of_node[cells] = between
    if len(twofold := np.unique(cells[of_node[cells] != between])):
        raise ValueError(
            f"{len(twofold)} nodes are in the middle of a side or an edge of one cell, and of another one at a corner or in "
            f"another middle, the first at {place_of(X[twofold[0]])}: the cells do not meet side to side; bond bodies with "
            "gmsh.model.occ.fragment before meshing, or leave their nodes unmerged and state a contact"
        )
    _, first, times = np.unique(of_node, return_index=True, return_counts=True)
    if len(doubled := np.sort(first[times > 1])):
        raise ValueError(
            f"{len(doubled)} sides or edges have a middle node for each of the cells around, the first at "
            f"{place_of(X[doubled[0]])}; merge nodes by gmsh.model.mesh.removeDuplicateNodes() after setOrder(2), not before"
        )


def reaching(kind: int, own: Floats, sides: Ints64, others: Floats) -> Array:
    """Whether the middle of a side of each cell lies in another one, both of gmsh's type `kind`; True for cells of order 1.

    own, others (n, k, 3): nodes of the cells; sides (n, j): the corners of the side.
    """
    name, dim, order, _, nodes, _ = gmsh.model.mesh.getElementProperties(kind)
    if order == 1 or not len(own):
        return np.ones(len(own), dtype=bool)
    corners = np.asarray(nodes).reshape(-1, dim)
    at = corners[sides].mean(axis=1)
    points = np.einsum("nk,nkc->nc", _shapes(kind, at)[..., 0], own)[:, :dim]
    x, size = others[..., :dim], np.ptp(others, axis=1).max(axis=1)
    at = np.broadcast_to(corners.mean(axis=0), at.shape)
    for _ in range(_TURNS):
        left = points - np.einsum("nk,nkc->nc", _shapes(kind, at)[..., 0], x)
        slopes = np.einsum("nkd,nkc->ncd", _shapes(kind, at, "Grad")[..., :dim], x)
        at = np.clip(at + np.einsum("ndc,nc->nd", np.linalg.pinv(slopes), left), -2.0, 2.0)
    simplex = name.split()[0] in ("Triangle", "Tetrahedron")
    outside = np.maximum(-at.min(axis=1), at.sum(axis=1) - 1.0) if simplex else np.abs(at).max(axis=1) - 1.0
    return np.asarray((np.linalg.norm(left, axis=1) <= _FOUND * size) & (outside <= _FOLLOWED))


def _shapes(kind: int, at: Floats, slope: str = "") -> Floats:
    """Shape functions (n, k, 1) of a cell at points (n, dim) of its own, or their slopes (n, k, 3)."""
    uvw = np.column_stack([at, np.zeros((len(at), 3 - at.shape[1]))])
    _, values, _ = gmsh.model.mesh.getBasisFunctions(kind, uvw.ravel(), f"{slope}Lagrange")
    return np.array(values).reshape(len(at), -1, 3 if slope else 1)  # a copy: gmsh frees its memory with `values`
