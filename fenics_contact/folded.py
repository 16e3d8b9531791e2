"""Cells that are inside out as drawn: wholly, or at a node alone, where no quadrature point lies."""

from dataclasses import dataclass

import basix
import gmsh
import numpy as np

from fenics_contact.types import Array, Floats

_RULES = (3, 5)  # `quadrature_degree` of solid/elements.py, of bodies of degree 1 and 2
_ROUNDED = 1e-10  # of a cell's mean Jacobian: a side of no length leaves that at its ends, and is no fold
_AT_ONCE = 10_000  # cells, not to fill the memory


@dataclass(frozen=True)
class Folded:
    """Cells of a body that are inside out at nodes, and upright in their quadrature points: how many, of the worst its
    element, the place of that node, and the Jacobian there over the cell's mean; curved: whether their sides are."""

    body: str
    count: int
    element: int
    place: tuple[float, ...]
    worst: float
    curved: bool


def folded(kind: int, tags: Array, X: Floats, body: Array) -> tuple[Folded, ...]:
    """The Folded cells, by body, among those of gmsh's type `kind` with nodes at X (n, k, 3), of these bodies (n,).

    ValueError where a quadrature point is inside out, or flat."""
    name, dim, order, _, nodes, _ = gmsh.model.mesh.getElementProperties(kind)
    straight = order == 1 and name.split()[0] in ("Tetrahedron", "Triangle")  # with one Jacobian all over
    inner, at_nodes = _inner(name, dim, straight), np.asarray(nodes).reshape(-1, dim)
    found = _jacobians(kind, X[..., :dim], np.concatenate([inner, at_nodes[: 0 if straight else None]]))
    within, at = found[:, : len(inner)], found[:, len(inner) :]
    least = within.min(axis=1)
    bad = np.flatnonzero(~(least > 0.0))
    if bad.size:
        raise ValueError(
            f"{bad.size} inverted or flat elements, the first is element {tags[bad[0]]} with Jacobian {least[bad[0]]:.3g}; "
            "mesh the volume again or reverse its orientation"
        )
    shares = at / within.mean(axis=1)[:, None]
    bad = np.flatnonzero(shares.min(axis=1, initial=1.0) < -_ROUNDED)
    groups = []
    for of in dict.fromkeys(body[bad].tolist()):
        cells = bad[body[bad] == of]
        one, node = np.unravel_index(int(shares[cells].argmin()), shares[cells].shape)
        worst, place = cells[one], tuple(X[cells[one], node].tolist())
        groups.append(Folded(of, len(cells), int(tags[worst]), place, float(shares[worst, node]), order > 1))
    return tuple(groups)


def _inner(name: str, dim: int, straight: bool) -> Floats:
    """The quadrature points (n, dim) of the solid, as gmsh counts them."""
    shape = name.split()[0].lower()
    rules = [basix.make_quadrature(getattr(basix.CellType, shape), degree)[0] for degree in _RULES]
    points = np.concatenate(rules)[: 1 if straight else None]
    return points if shape in ("tetrahedron", "triangle") else 2.0 * points - 1.0


def _jacobians(kind: int, X: Floats, points: Floats) -> Floats:
    """Determinants (n, points) of cells with nodes at X (n, k, dim)."""
    dim = X.shape[2]
    uvw = np.column_stack([points, np.zeros((len(points), 3 - dim))])
    _, gradients, _ = gmsh.model.mesh.getBasisFunctions(kind, uvw.ravel(), "GradLagrange")
    slopes = np.asarray(gradients).reshape(len(points), X.shape[1], 3)[..., :dim]
    parts = [X[i : i + _AT_ONCE] for i in range(0, len(X), _AT_ONCE)]
    return np.concatenate([_determinants(np.tensordot(slopes, part, (1, 1))) for part in parts], axis=1).T


def _determinants(a: Floats) -> Floats:
    """Of matrices (p, dim, n, dim) those (p, n), by cofactors: of many small ones many times as fast as by pivots."""
    if a.shape[1] == 2:
        return np.asarray(a[:, 0, :, 0] * a[:, 1, :, 1] - a[:, 0, :, 1] * a[:, 1, :, 0])
    one, two, three = (np.ascontiguousarray(a[:, i].transpose(2, 0, 1)) for i in range(3))
    out = one[0] * (two[1] * three[2] - two[2] * three[1])
    out += one[1] * (two[2] * three[0] - two[0] * three[2])
    out += one[2] * (two[0] * three[1] - two[1] * three[0])
    return np.asarray(out)
