"""The contact element of a slave point and a deformable master facet: place, rates, slide of the anchor.

A slave point is x_S = sum a_i x_i over k slave nodes: one node, or the nodes of a slave facet seen from a quadrature
point.  The history of a point is its ANCHOR: node numbers and weights W_i (sum 1) on the facet where it last slid.  Its
image x_a = sum W_i x_i moves with the master body, knows no parametrisation and turns with the body, so traction is
continuous over facet edges and frame-indifferent.

Nodes of an element in order: k slave nodes, 4 master facet nodes, 4 anchor nodes: k + 8.  All that the traction depends on
are four vectors, its MODES, each a sum of node positions with the coefficients share[mode, node]:
    JUMP    x_S - x_M, place on the facet held
    FIRST   r_1, and SECOND r_2: tangents of the master facet (in kernels/ray_element.py: of the slave's facet)
    DRAG    x_M - x_a, place on the facet held
so rates are taken with respect to the modes (d(xi) = sum_m beta[m] . d(mode m), and so on) and spread to nodes at the end.

Arrays travel in groups (tuples, C-contiguous, float64 and int64):
    slaves     (nodes (np, k), weights a (np, k), area (np,) [length^2], gradients (np, 2, k) of the slave facet's shape
               functions where its normal seeks the master; (0, 2, k) where the closest point is meant)
    surface    (nodes (nf, 4), size (nf,)) as in kernels/facets.py
    projection (facet (np,), kind (np,), feature (np,), xi (np, 2), gap (np,), normal (np, 3)) as filled by
               kernels/closest_point.py or kernels/slave_ray.py at the same coordinates
    anchors    (nodes (np, 4), weights W (np, 4)); nodes[:, 0] = -1: no anchor yet
    law        (eps_n (np,), eps_t (np,) [pressure/length], Friction of kernels/law.py, touch [length], shift (np,)
               [length], judged (np,) or (0,) [length]); shift: multiplier over eps_n, by which a point presses more
               than its gap does; touch: gap + shift up to it counts as closed; judged: gaps, shifts added, that decide
               the points' status where they are not the present ones; (0,): they are
    pairs      (coords (nx, 3) present positions of nodes [length], slaves, surface, projection, anchors)
"""

import math
from typing import NamedTuple

from numba import njit

from fenics_contact.kernels.closest_point import EDGE, INTERIOR, Projection
from fenics_contact.kernels.facets import Surface, corner, shape, shape_gradient, shape_mixed
from fenics_contact.kernels.law import Friction, Partials
from fenics_contact.kernels.normals import tangents_at
from fenics_contact.kernels.vectors import (
    ZERO,
    Four,
    Vector,
    cross,
    dot,
    got,
    less,
    minus,
    norm,
    of_four,
    of_nodes,
    of_three,
    planar,
    plus,
    put,
    row,
    times,
)
from fenics_contact.types import Floats, Ints64

# The groups that no other kernel names
Slaves = tuple[Ints64, Floats, Floats, Floats]
Anchors = tuple[Ints64, Floats]
PointLaws = tuple[Floats, Floats, Friction, float, Floats, Floats]
Pairs = tuple[Floats, Slaves, Surface, Projection, Anchors]
Patch = tuple[Vector, Vector, Vector, Vector]
Foot = tuple[int, int, float, float, float]  # kind, size of the facet, xi, gap

# Modes.
JUMP, FIRST, SECOND, DRAG = 0, 1, 2, 3


class Pair(NamedTuple):
    """Kinematics (1) of a slave point and its facet [length]: gap, normal, x_S - x_M, r_1, r_2, r_12, the elastic slip
    x_M - x_a before projection, shape functions of the facet with their gradients; tangents of the slave's facet and
    |t1 x t2|, 0 without."""

    g: float
    n: Vector
    d: Vector
    r1: Vector
    r2: Vector
    r12: Vector
    w: Vector
    N: Four
    N1: Four
    N2: Four
    t1: Vector
    t2: Vector
    size: float


@njit(cache=True)
def slave_points(coords: Floats, nodes: Ints64, weights: Floats, points: Floats) -> None:
    """Fill points (np, 3) with x_S = sum a_i x_i of nodes (np, k) and weights (np, k)."""
    for q in range(nodes.shape[0]):
        points[q, 0], points[q, 1], points[q, 2] = of_nodes(weights, q, nodes, coords)


@njit(cache=True, error_model="numpy", inline="always")
def facet_corners(coords: Floats, nodes: Ints64, f: int) -> Patch:
    """Places of the nodes (nf, 4) of facet f."""
    return row(coords, nodes[f, 0]), row(coords, nodes[f, 1]), row(coords, nodes[f, 2]), row(coords, nodes[f, 3])


def _pair(at: Foot, patch: Patch, x: Vector, anchor: tuple[bool, Vector], tangents: tuple[bool, Vector, Vector]) -> Pair:
    """The Pair of a slave point at x and its foot on a facet.

    anchor, tangents: is there one, and are there such; x_a, and the tangents of the slave's facet, whose normal then seeks
    the master: kernels/slave_ray.py.
    """
    (kind, m, s, t, gap), (x0, x1, x2, x3) = at, patch
    N = shape(m, s, t)
    N1, N2 = shape_gradient(m, s, t)
    x_m = of_four(N, x0, x1, x2, x3)
    r1, r2, r12 = of_four(N1, x0, x1, x2, x3), of_four(N2, x0, x1, x2, x3), of_four(shape_mixed(m), x0, x1, x2, x3)
    d, w = minus(x, x_m), minus(x_m, anchor[1]) if anchor[0] else ZERO
    seeks, t1, t2 = tangents
    if seeks:
        n = cross(t2, t1)
        area = norm(n)
        n = times(1.0 / area, n)
        return Pair(dot(d, n), n, d, r1, r2, r12, w, N, N1, N2, t1, t2, area)
    if kind == INTERIOR:
        n = cross(r1, r2)
        n = times(1.0 / norm(n), n)
        return Pair(dot(d, n), n, d, r1, r2, r12, w, N, N1, N2, ZERO, ZERO, 0.0)
    g = math.copysign(norm(d), gap)
    return Pair(g, times(1.0 / g, d), d, r1, r2, r12, w, N, N1, N2, ZERO, ZERO, 0.0)


# A copy in each of its callers takes seconds to compile: only where assembly spends its time, in loops that have unpacked
# the groups, for an array of a tuple that is looked at for a point costs more, in reference counts, than its arithmetic
pair_of = njit(cache=True, error_model="numpy", inline="always")(_pair)
_pair_apart = njit(cache=True, error_model="numpy")(_pair)


@njit(cache=True, error_model="numpy")
def place_apart(q: int, pairs: Pairs) -> Pair:
    """The Pair of slave point q."""
    coords, (nodes, weights, _, gradients), (corners, size), (facet, kind, _, xi, gap, _), (held, held_weights) = pairs
    f, seeks, anchored = facet[q], len(gradients) > 0, held[q, 0] >= 0
    t1, t2 = tangents_at(coords, nodes, q, gradients, q) if seeks else (ZERO, ZERO)
    anchor = anchored, of_nodes(held_weights, q, held, coords) if anchored else ZERO
    at, x = (kind[q], size[f], xi[q, 0], xi[q, 1], gap[q]), of_nodes(weights, q, nodes, coords)
    return _pair_apart(at, facet_corners(coords, corners, f), x, anchor, (seeks, t1, t2))


@njit(cache=True, error_model="numpy")
def _foot_metric(kind: int, m: int, feature: int, pair: Pair) -> Vector:
    """G in d(xi)^a = G^ab (jump r_b + d N_,b) du: inside H^-1, of (4) times r_b; its like on an edge; 0 at a vertex."""
    r1, r2 = pair.r1, pair.r2
    if kind == INTERIOR:
        a11, a12, a22 = dot(r1, r1), dot(r1, r2) - dot(pair.d, pair.r12), dot(r2, r2)  # H_ab = a_ab - g n.r_ab
        det = a11 * a22 - a12 * a12
        if det == 0.0:  # x_S in the centre of curvature: the foot has no rate there
            return 0.0, 0.0, 0.0
        return a22 / det, -a12 / det, a11 / det
    if kind == EDGE:
        s0, t0 = corner(m, feature)
        s1, t1 = corner(m, (feature + 1) % m)
        ds, dt = s1 - s0, t1 - t0
        edge = plus(times(ds, r1), times(dt, r2))
        ee = dot(edge, edge)
        return ds * ds / ee, ds * dt / ee, dt * dt / ee
    return 0.0, 0.0, 0.0


@njit(cache=True)
def foot_rate(kind: int, m: int, feature: int, pair: Pair, beta: Floats) -> None:
    """Fill beta (2, 4, 3): xi^alpha moves by sum_m beta[alpha, m] . d(mode m), (4) times r_b."""
    g11, g12, g22 = _foot_metric(kind, m, feature, pair)
    # (v_S - v_M).r_b + g n.v_M,b
    put(beta, 0, JUMP, plus(times(g11, pair.r1), times(g12, pair.r2)))
    put(beta, 1, JUMP, plus(times(g12, pair.r1), times(g22, pair.r2)))
    put(beta, 0, FIRST, times(g11, pair.d))
    put(beta, 1, FIRST, times(g12, pair.d))
    put(beta, 0, SECOND, times(g12, pair.d))
    put(beta, 1, SECOND, times(g22, pair.d))


@njit(cache=True, error_model="numpy")
def normal_rate(kind: int, pair: Pair, beta: Floats, dn: Floats) -> None:
    """Fill dn (4, 3, 3): n moves by sum_m dn[m] d(mode m), from (6) inside and from n = d/g at edges and vertices."""
    n, r1, r2 = pair.n, pair.r1, pair.r2
    a11, a12, a22, twist = dot(r1, r1), dot(r1, r2), dot(r2, r2), dot(n, pair.r12)
    det = a11 * a22 - a12 * a12
    across1, across2 = planar(r1, n), planar(r2, n)
    for mode in range(DRAG):
        beta1, beta2 = got(beta, 0, mode), got(beta, 1, mode)
        if kind == INTERIOR:
            # n.(v_M,a + r_ab xi^b) with r_12 the only second derivative of the patch
            w1 = plus(times(twist, beta2), n if mode == FIRST else ZERO)
            w2 = plus(times(twist, beta1), n if mode == SECOND else ZERO)
            u1, u2 = times(-1.0 / det, less(times(a22, w1), a12, w2)), times(-1.0 / det, less(times(a11, w2), a12, w1))
            put(dn, mode, 0, plus(times(r1[0], u1), times(r2[0], u2)))
            put(dn, mode, 1, plus(times(r1[1], u1), times(r2[1], u2)))
            put(dn, mode, 2, plus(times(r1[2], u1), times(r2[2], u2)))
            continue
        one, k = (1.0 if mode == JUMP else 0.0), -1.0 / pair.g
        along = times(one / pair.g, n)
        put(dn, mode, 0, less(times(k, plus(times(across1[0], beta1), times(across2[0], beta2))), n[0], along))
        put(dn, mode, 1, less(times(k, plus(times(across1[1], beta1), times(across2[1], beta2))), n[1], along))
        put(dn, mode, 2, less(times(k, plus(times(across1[2], beta1), times(across2[2], beta2))), n[2], along))
        for a in range(3):
            dn[mode, a, a] -= k * one


@njit(cache=True, error_model="numpy")
def traction_rate(T: Vector, by: Partials, pair: Pair, beta: Floats, dn: Floats, rates: Floats) -> None:
    """Fill rates (4, 3, 9): T moves by rates[m, 0] d(mode m), 3 x 3; T xi^1 and T xi^2, T held, by rates[m, 1] and [m, 2].

    The law's Partials `by` of the traction T (3,) meet the rates of gap, normal and way: (26)-(28).
    """
    by_n, by_w, r1, r2 = by.n, by.w, pair.r1, pair.r2
    # n . r_a, zero where n is the master's own normal
    lean = (dot(pair.n, r1), dot(pair.n, r2)) if pair.size > 0.0 else (0.0, 0.0)
    along1 = dot(by_w[0], r1), dot(by_w[1], r1), dot(by_w[2], r1)  # dw = r_a dxi^a, (10), + drag
    along2 = dot(by_w[0], r2), dot(by_w[1], r2), dot(by_w[2], r2)
    for mode in range(DRAG):
        beta1, beta2 = got(beta, 0, mode), got(beta, 1, mode)
        dn0, dn1, dn2 = got(dn, mode, 0), got(dn, mode, 1), got(dn, mode, 2)
        # (8): on the master's own normal the rate of the gap needs no rate of xi
        dg = less(less(pair.n if mode == JUMP else ZERO, lean[0], beta1), lean[1], beta2)
        one = of_three((by.g[0], along1[0], along2[0]), dg, beta1, beta2)
        two = of_three((by.g[1], along1[1], along2[1]), dg, beta1, beta2)
        three = of_three((by.g[2], along1[2], along2[2]), dg, beta1, beta2)
        _put_row(rates, mode, 0, plus(one, of_three(by_n[0], dn0, dn1, dn2)))
        _put_row(rates, mode, 1, plus(two, of_three(by_n[1], dn0, dn1, dn2)))
        _put_row(rates, mode, 2, plus(three, of_three(by_n[2], dn0, dn1, dn2)))
        # In the rate of (14), (11) leaves -dv_M,a Dxi^a of D(dv_S - dv_M). N n times it, with N Dn . (dv_S - dv_M) from
        # dT/dn, is N times (12) with + g dn . Dn: put (5) for dv_S - dv_M, and (6), (7) for n . r_a. T_T times it, with
        # DT_T, is the rate of T_T . dg_T, (13), and of g T_T . dn, which (17) leaves out of (14).
        for a in range(2):
            _put_outer(rates, mode, 1 + a, T, got(beta, a, mode))
    for a in range(3):
        _put_row(rates, DRAG, a, by_w[a])


@njit(cache=True)
def _put_row(rates: Floats, mode: int, a: int, vector: Vector) -> None:
    rates[mode, 0, 3 * a], rates[mode, 0, 3 * a + 1], rates[mode, 0, 3 * a + 2] = vector


@njit(cache=True)
def _put_outer(rates: Floats, mode: int, part: int, a: Vector, b: Vector) -> None:
    rates[mode, part, 0], rates[mode, part, 1], rates[mode, part, 2] = times(a[0], b)
    rates[mode, part, 3], rates[mode, part, 4], rates[mode, part, 5] = times(a[1], b)
    rates[mode, part, 6], rates[mode, part, 7], rates[mode, part, 8] = times(a[2], b)


@njit(cache=True, error_model="numpy")
def slide_anchor(q: int, pair: Pair, tangential: Vector, eps_t: float, weights: Floats) -> None:
    """Take e^alpha N_i,alpha off weights[q]: the anchor trails x_M by the elastic slip e = T_T/eps_T.

    At an edge or vertex e is normal to n but may leave the facet's plane; there the vector e' of the plane with
    P(n) e' = e stands for it, so that the committed traction is felt again unchanged.
    """
    r1, r2, n = pair.r1, pair.r2, pair.n
    up = cross(r1, r2)
    # cos of 84 degrees: a normal that lies flatter on its facet than that has no such e'
    tilt = dot(up, tangential) / dot(up, n) if dot(up, n) > 0.1 * norm(up) else 0.0
    e = times(1.0 / eps_t, less(tangential, tilt, n))
    a11, a12, a22, e1, e2 = dot(r1, r1), dot(r1, r2), dot(r2, r2), dot(e, r1), dot(e, r2)
    det = a11 * a22 - a12 * a12
    one, two = (a22 * e1 - a12 * e2) / det, (a11 * e2 - a12 * e1) / det  # e^alpha = a^ab e_b
    N1, N2 = pair.N1, pair.N2
    weights[q, 0] -= one * N1[0] + two * N2[0]
    weights[q, 1] -= one * N1[1] + two * N2[1]
    weights[q, 2] -= one * N1[2] + two * N2[2]
    weights[q, 3] -= one * N1[3] + two * N2[3]
