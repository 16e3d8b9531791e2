"""What a master facet is: the shape functions of quad4 and tri3 and the patch r(xi1, xi2) they span.

A surface is a pair of arrays: nodes (n, 4) int64 and size (n,) int64, the number m of nodes, 3 or 4.
A tri3 leaves the fourth node unused; it repeats the third one, so that every entry is a valid index.
Corners run counter-clockwise seen from outside: r_1 x r_2 points out of the master body.
quad4 lives on [-1, 1]^2, tri3 on the unit triangle.  Edge e runs from corner e to corner e + 1 mod m.
"""

import math

from numba import njit

from fenics_contact.kernels.vectors import Four
from fenics_contact.types import Floats, Ints64

Surface = tuple[Ints64, Ints64]  # nodes (nf, 4), size (nf,)
PlacedSurface = tuple[Floats, Surface]  # positions (nx, 3) of all nodes [length], and the facets between them

MAX_NODES = 4


@njit(cache=True)
def corner(m: int, i: int) -> tuple[float, float]:
    """Parametric place (xi1, xi2) of corner i."""
    if m == 3:
        return (1.0 if i == 1 else 0.0), (1.0 if i == 2 else 0.0)
    return (1.0 if i == 1 or i == 2 else -1.0), (1.0 if i >= 2 else -1.0)


@njit(cache=True)
def shape(m: int, s: float, t: float) -> Four:
    """N_i(s, t); a tri3 has N_3 = 0."""
    if m == 3:
        return 1.0 - s - t, s, t, 0.0
    return (
        0.25 * (1.0 - s) * (1.0 - t),
        0.25 * (1.0 + s) * (1.0 - t),
        0.25 * (1.0 + s) * (1.0 + t),
        0.25 * (1.0 - s) * (1.0 + t),
    )


@njit(cache=True)
def shape_gradient(m: int, s: float, t: float) -> tuple[Four, Four]:
    """(N_i,1, N_i,2) at (s, t)."""
    if m == 3:
        return (-1.0, 1.0, 0.0, 0.0), (-1.0, 0.0, 1.0, 0.0)
    low1, high1, low2, high2 = 0.25 * (1.0 - t), 0.25 * (1.0 + t), 0.25 * (1.0 - s), 0.25 * (1.0 + s)
    return (-low1, low1, high1, -high1), (-low2, -high2, high2, low2)


@njit(cache=True)
def shape_mixed(m: int) -> Four:
    """N_i,12, the only second derivative that is not zero; it is constant."""
    sign = 0.0 if m == 3 else 0.25
    return sign, -sign, sign, -sign


@njit(cache=True)
def gather(x: Floats, nodes: Ints64, m: int, xf: Floats) -> None:
    """Copy the facet's current corner positions x[nodes] into xf (4, 3)."""
    for i in range(m):
        for p in range(3):
            xf[i, p] = x[nodes[i], p]


@njit(cache=True)
def patch(m: int, xf: Floats, c: Floats) -> None:
    """Fill c (4, 3) so that r(s, t) = c0 + c1 s + c2 t + c3 s t.

    With it r_1 = c1 + c3 t, r_2 = c2 + c3 s, r_12 = c3, for both shapes of facet.
    """
    for p in range(3):
        a, b, d = xf[0, p], xf[1, p], xf[2, p]
        if m == 3:
            c[0, p], c[1, p], c[2, p], c[3, p] = a, b - a, d - a, 0.0
        else:
            e = xf[3, p]
            c[0, p] = 0.25 * (a + b + d + e)
            c[1, p] = 0.25 * (b - a + d - e)
            c[2, p] = 0.25 * (d + e - a - b)
            c[3, p] = 0.25 * (a - b + d - e)


@njit(cache=True)
def patch_normal(c: Floats, s: float, t: float, n: Floats) -> float:
    """Fill n (3,) with r_1 x r_2 / |r_1 x r_2| of (1); return |r_1 x r_2|, n = 0 where that is 0."""
    a0, a1, a2 = c[1, 0] + c[3, 0] * t, c[1, 1] + c[3, 1] * t, c[1, 2] + c[3, 2] * t
    b0, b1, b2 = c[2, 0] + c[3, 0] * s, c[2, 1] + c[3, 1] * s, c[2, 2] + c[3, 2] * s
    n[0], n[1], n[2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    scale = 1.0 / length if length > 0.0 else 0.0
    for p in range(3):
        n[p] *= scale
    return length
