"""Vectors of three as tuples of numbers: they stay in registers, where small arrays would be counted and stored."""

import math

from numba import njit

from fenics_contact.types import Floats, Ints64

Vector = tuple[float, float, float]
Four = tuple[float, float, float, float]

ZERO = (0.0, 0.0, 0.0)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@njit(cache=True)
def row(x: Floats, i: int) -> Vector:
    """Row i of x (n, 3)."""
    return x[i, 0], x[i, 1], x[i, 2]


@njit(cache=True)
def add_row(x: Floats, i: int, share: float, vector: Vector) -> None:
    """x[i] += share vector, in an array (n, 3)."""
    x[i, 0] += share * vector[0]
    x[i, 1] += share * vector[1]
    x[i, 2] += share * vector[2]


@njit(cache=True)
def put(array: Floats, i: int, j: int, vector: Vector) -> None:
    """array[i, j] = vector, in an array (m, n, 3)."""
    array[i, j, 0], array[i, j, 1], array[i, j, 2] = vector


@njit(cache=True)
def got(array: Floats, i: int, j: int) -> Vector:
    """array[i, j] of an array (m, n, 3)."""
    return array[i, j, 0], array[i, j, 1], array[i, j, 2]


@njit(cache=True)
def four_of(x: Floats, i: int, j: int) -> Four:
    """x[i, j] of an array (m, n, 4), what a processor adds at once."""
    return x[i, j, 0], x[i, j, 1], x[i, j, 2], x[i, j, 3]


@njit(cache=True, fastmath={"contract"})
def four_plus(a: Four, s: float, b: Four) -> Four:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2], a[3] + s * b[3]


@njit(cache=True)
def put_four(x: Floats, i: int, j: int, a: Four) -> None:
    """x[i, j] = a, in an array (m, n, 4)."""
    x[i, j, 0], x[i, j, 1], x[i, j, 2], x[i, j, 3] = a


@njit(cache=True)
def add_four(x: Floats, i: int, j: int, s: float, a: Four) -> None:
    """x[i, j] += s a, in an array (m, n, 4)."""
    put_four(x, i, j, four_plus(four_of(x, i, j), s, a))


@njit(cache=True)
def four(a: Vector) -> Four:
    """A vector and a zero behind it."""
    return a[0], a[1], a[2], 0.0


@njit(cache=True)
def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True)
def times(s: float, a: Vector) -> Vector:
    return s * a[0], s * a[1], s * a[2]


@njit(cache=True)
def less(a: Vector, s: float, b: Vector) -> Vector:
    """a - s b."""
    return a[0] - s * b[0], a[1] - s * b[1], a[2] - s * b[2]


@njit(cache=True)
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def norm(a: Vector) -> float:
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@njit(cache=True)
def planar(w: Vector, n: Vector) -> Vector:
    """P(n) w: w without its part along a unit vector n."""
    return less(w, dot(n, w), n)


@njit(cache=True)
def of_nodes(weights: Floats, q: int, nodes: Ints64, x: Floats) -> Vector:
    """sum_i weights[q, i] x[nodes[q, i]]."""
    a = b = c = 0.0
    for i in range(nodes.shape[1]):
        w, n = weights[q, i], nodes[q, i]
        a, b, c = a + w * x[n, 0], b + w * x[n, 1], c + w * x[n, 2]
    return a, b, c


@njit(cache=True)
def of_block(blocks: Floats, i: int, w: Vector) -> Vector:
    """The matrix blocks[i] (3, 3) times w."""
    return dot(got(blocks, i, 0), w), dot(got(blocks, i, 1), w), dot(got(blocks, i, 2), w)


@njit(cache=True)
def of_three(w: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """w_0 a + w_1 b + w_2 c."""
    return (
        w[0] * a[0] + w[1] * b[0] + w[2] * c[0],
        w[0] * a[1] + w[1] * b[1] + w[2] * c[1],
        w[0] * a[2] + w[1] * b[2] + w[2] * c[2],
    )


@njit(cache=True)
def of_four(w: Four, a: Vector, b: Vector, c: Vector, d: Vector) -> Vector:
    """w_0 a + w_1 b + w_2 c + w_3 d."""
    return (
        w[0] * a[0] + w[1] * b[0] + w[2] * c[0] + w[3] * d[0],
        w[0] * a[1] + w[1] * b[1] + w[2] * c[1] + w[3] * d[1],
        w[0] * a[2] + w[1] * b[2] + w[2] * c[2] + w[3] * d[2],
    )
