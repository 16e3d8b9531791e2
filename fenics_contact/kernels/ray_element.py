"""What differs where a slave facet's own normal finds the master, against kernels/deformable_element.py.

The normal is n = -n_S of the slave's facet, its modes FIRST and SECOND are the tangents t_1, t_2 of that facet, and
x_S - x_M = g n gives, with m = r_1 x r_2,

    dxi^a from the two components of  d(x_S - x_M) - r_a dxi^a - g dn  normal to n,   dg = n . d(x_S - x_M) - n . r_a dxi^a.
"""

from numba import njit

from fenics_contact.kernels.deformable_element import FIRST, JUMP, NORMAL, R1, R2, SECOND, T1, T2, D
from fenics_contact.kernels.slave_ray import slave_normal


@njit(cache=True)
def place_along_normal(q, coords, slaves, work):
    """After place(): put the slave's tangents and normal in their places; returns (gap, |t1 x t2|)."""
    vec, share = work[0], work[5]
    size = slave_normal(coords, slaves[0][q], slaves[3][q], vec[T1], vec[T2], vec[NORMAL])
    share[FIRST, :] = share[SECOND, :] = 0.0
    for i in range(slaves[0].shape[1]):
        share[FIRST, i], share[SECOND, i] = slaves[3][q, 0, i], slaves[3][q, 1, i]
    return vec[D, 0] * vec[NORMAL, 0] + vec[D, 1] * vec[NORMAL, 1] + vec[D, 2] * vec[NORMAL, 2], size


@njit(cache=True)
def ray_rates(g, size, work):
    """Fill dn (4, 3, 3) from the slave's facet and beta (2, 4, 3), the rates of xi."""
    vec, beta, dn = work[0], work[6], work[7]
    det = 0.0
    for p in range(3):
        a, b = (p + 1) % 3, (p + 2) % 3
        det += vec[NORMAL, p] * (vec[R1, a] * vec[R2, b] - vec[R1, b] * vec[R2, a])
    for mode in range(3):
        for b in range(3):
            e, f = (b + 1) % 3, (b + 2) % 3
            # n = (t2 x t1)/size: d(t2 x t1) is t2 x e_b or e_b x t1
            dn[mode, b, b] = dn[mode, e, b] = dn[mode, f, b] = 0.0
            if mode == FIRST:
                dn[mode, f, b], dn[mode, e, b] = -vec[T2, e], vec[T2, f]
            elif mode == SECOND:
                dn[mode, f, b], dn[mode, e, b] = vec[T1, e], -vec[T1, f]
            along = 0.0
            for p in range(3):
                along += vec[NORMAL, p] * dn[mode, p, b]
            for p in range(3):
                dn[mode, p, b] = (dn[mode, p, b] - along * vec[NORMAL, p]) / size
            first = second = 0.0
            for p in range(3):
                e, f = (p + 1) % 3, (p + 2) % 3
                turned_e = -g * dn[mode, e, b] + (1.0 if mode == JUMP and e == b else 0.0)
                turned_f = -g * dn[mode, f, b] + (1.0 if mode == JUMP and f == b else 0.0)
                first += vec[NORMAL, p] * (turned_e * vec[R2, f] - turned_f * vec[R2, e])
                second += vec[NORMAL, p] * (vec[R1, e] * turned_f - vec[R1, f] * turned_e)
            beta[0, mode, b], beta[1, mode, b] = first / det, second / det
