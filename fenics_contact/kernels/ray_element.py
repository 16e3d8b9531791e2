"""What differs where a slave facet's own normal finds the master, against kernels/deformable_element.py.

The normal is n = -n_S of the slave's facet, its modes FIRST and SECOND are the tangents t_1, t_2 of that facet, and
x_S - x_M = g n gives, with r_1, r_2 of the master's facet,

    dxi^a = c_a . (d(x_S - x_M) - g dn),  c_1 = r_2 x n / det,  c_2 = n x r_1 / det,  det = n . (r_1 x r_2),
    dn = P(n) (t_2 x dt_1 + dt_2 x t_1) / |t_1 x t_2|,   dg = n . d(x_S - x_M) - n . r_a dxi^a.
"""

from numba import njit

from fenics_contact.kernels.deformable_element import FIRST, JUMP, SECOND, Pair
from fenics_contact.kernels.vectors import Vector, cross, dot, less, minus, planar, put, times
from fenics_contact.types import Floats


@njit(cache=True, error_model="numpy")
def foot_covectors(pair: Pair) -> tuple[Vector, Vector]:
    """c_1 and c_2."""
    one, two = cross(pair.r2, pair.n), cross(pair.n, pair.r1)
    det = dot(pair.r1, one)
    return times(1.0 / det, one), times(1.0 / det, two)


@njit(cache=True, error_model="numpy")
def ray_rates(pair: Pair, beta: Floats, dn: Floats) -> None:
    """Fill dn (4, 3, 3) from the slave's facet and beta (2, 4, 3), the rates of xi."""
    one, two = foot_covectors(pair)
    arm = -pair.g / pair.size
    put(beta, 0, JUMP, one)
    put(beta, 1, JUMP, two)
    put(beta, 0, FIRST, times(arm, cross(one, pair.t2)))
    put(beta, 1, FIRST, times(arm, cross(two, pair.t2)))
    put(beta, 0, SECOND, times(arm, cross(pair.t1, one)))
    put(beta, 1, SECOND, times(arm, cross(pair.t1, two)))
    _put_turn(dn, FIRST, times(1.0 / pair.size, pair.t2), pair.n)
    _put_turn(dn, SECOND, times(-1.0 / pair.size, pair.t1), pair.n)


@njit(cache=True)
def _put_turn(dn: Floats, mode: int, t: Vector, n: Vector) -> None:
    """dn[mode] = P(n) [t x]."""
    across = cross(n, t)
    put(dn, mode, 0, less((0.0, -t[2], t[1]), n[0], across))
    put(dn, mode, 1, less((t[2], 0.0, -t[0]), n[1], across))
    put(dn, mode, 2, less((-t[1], t[0], 0.0), n[2], across))


@njit(cache=True, error_model="numpy")
def ray_gap_rate(pair: Pair, jump: Vector, first: Vector, second: Vector) -> float:
    """dg when x_S - x_M, place on the facet held, and the slave's tangents change by jump, first, second."""
    n = pair.n
    turn = less(cross(pair.t2, first), -1.0, cross(second, pair.t1))
    jump_along = less(jump, pair.g / pair.size, planar(turn, n))
    one, two = foot_covectors(pair)
    foot = less(times(dot(one, jump_along), pair.r1), -dot(two, jump_along), pair.r2)
    return dot(n, minus(jump, foot))
