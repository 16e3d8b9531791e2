"""All pairs of slave points and master facets in one pass: forces, foreseen gaps, anchors to keep.

Arrays as in kernels/deformable_element.py.  The tangent is in kernels/contact_tangent.py.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.deformable_element import (
    Anchors,
    Pair,
    Pairs,
    PointLaws,
    facet_corners,
    pair_of,
    place_apart,
    slide_anchor,
)
from fenics_contact.kernels.law import NO_RUBBING, Gaps, Law, Traction, rubbing, traction
from fenics_contact.kernels.normals import tangents_at
from fenics_contact.kernels.ray_element import ray_gap_rate
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.kernels.vectors import (
    ZERO,
    Four,
    add_row,
    dot,
    less,
    minus,
    norm,
    of_four,
    of_nodes,
    planar,
    plus,
    row,
    times,
)
from fenics_contact.types import Floats, Ints, Ints64


@njit(cache=True, inline="always")
def deciding_gap(q: int, projection: Projection, law: PointLaws) -> float:
    """What tells open from closed at point q [length]: its gap with its shift, or the judged one."""
    return law[5][q] if len(law[5]) > 0 else projection[4][q] + law[4][q]


@njit(cache=True, inline="always")
def presses(q: int, projection: Projection, law: PointLaws) -> bool:
    """True if point q has a partner and counts as closed; most points of a surface do not."""
    return projection[1][q] != NONE and deciding_gap(q, projection, law) <= law[3]


@njit(cache=True)
def point_law(q: int, decides: float, law: PointLaws, anchors: Anchors) -> Law:
    """The Law of point q under a gap that decides [length]: without friction where it has no anchor."""
    friction = rubbing(law[2], q, -law[0][q] * decides) if anchors[0][q, 0] >= 0 else NO_RUBBING
    return Law(law[0][q], law[1][q], friction, law[3])


@njit(cache=True)
def _present_traction(q: int, pair: Pair, law: PointLaws, anchors: Anchors) -> Traction:
    """The Traction of point q at its present gap."""
    press = pair.g + law[4][q]
    return traction(point_law(q, press, law, anchors), Gaps(press, press), pair.n, pair.w)


@njit(cache=True)
def judged_traction(q: int, pair: Pair, law: PointLaws, anchors: Anchors) -> tuple[Law, Gaps, Traction]:
    """Law, gaps and Traction of point q under the pressure that decides its status: what the tangent is that of."""
    g = law[5][q] if len(law[5]) > 0 else pair.g + law[4][q]
    numbers, gaps = point_law(q, g, law, anchors), Gaps(g, g)
    return numbers, gaps, traction(numbers, gaps, pair.n, pair.w)


@njit(cache=True, error_model="numpy")
def add_forces(pairs: Pairs, law: PointLaws, out: tuple[Floats, Ints, Floats]) -> None:
    """Add the virtual power area T.(dv_S - dv_M) of (14) to forces (nx, 3).  Pure.

    T.(dv_S - dv_M) = N dg + T_T.(dg_T + g dn) by (5), with dg of (9) and dg_T of (10): none of them is formed.

    out: (forces, status, tractions); fills per point status and traction (np, 3) T = N n + T_T.
    """
    coords, (nodes, weights, area, gradients), (corners, size), (facet, kind, _, xi, gap, _), (held, held_weights) = pairs
    (eps_n, eps_t, friction, touch, shift, judged), (forces, status, tractions), seeks = law, out, len(gradients) > 0
    for q in range(len(status)):
        status[q] = OPEN
        tractions[q, 0] = tractions[q, 1] = tractions[q, 2] = 0.0
        if kind[q] == NONE or (judged[q] if len(judged) > 0 else gap[q] + shift[q]) > touch:
            continue
        f, anchored = facet[q], held[q, 0] >= 0
        t1, t2 = tangents_at(coords, nodes, q, gradients, q) if seeks else (ZERO, ZERO)
        anchor = anchored, of_nodes(held_weights, q, held, coords) if anchored else ZERO
        at, x = (kind[q], size[f], xi[q, 0], xi[q, 1], gap[q]), of_nodes(weights, q, nodes, coords)
        pair = pair_of(at, facet_corners(coords, corners, f), x, anchor, (seeks, t1, t2))
        press = pair.g + shift[q]
        gaps = Gaps(press, judged[q] if len(judged) > 0 else press)
        rub = rubbing(friction, q, -eps_n[q] * gaps.decides) if anchored else NO_RUBBING
        found = traction(Law(eps_n[q], eps_t[q], rub, touch), gaps, pair.n, pair.w)
        status[q] = found.status
        if found.status == OPEN:
            continue
        tractions[q, 0], tractions[q, 1], tractions[q, 2] = found.T
        force = times(area[q], found.T)
        for i in range(nodes.shape[1]):
            add_row(forces, nodes[q, i], weights[q, i], force)
        add_row(forces, corners[f, 0], -pair.N[0], force)
        add_row(forces, corners[f, 1], -pair.N[1], force)
        add_row(forces, corners[f, 2], -pair.N[2], force)
        add_row(forces, corners[f, 3], -pair.N[3], force)


@njit(cache=True)
def foreseen_gaps(pairs: Pairs, moved: Floats, gaps: Floats) -> None:
    """Fill gaps (np,): what the gaps of the pairs become, linearised, when the nodes move by moved (nx, 3)."""
    _, (nodes, weights, _, gradients), (corners, _), (facet, kind, _, _, _, _), _ = pairs
    for q in range(len(gaps)):
        gaps[q] = np.inf
        if kind[q] == NONE:
            continue
        pair, f = place_apart(q, pairs), facet[q]
        m0, m1, m2, m3 = (
            row(moved, corners[f, 0]),
            row(moved, corners[f, 1]),
            row(moved, corners[f, 2]),
            row(moved, corners[f, 3]),
        )
        jump = minus(of_nodes(weights, q, nodes, moved), of_four(pair.N, m0, m1, m2, m3))
        if len(gradients) > 0:
            first, second = tangents_at(moved, nodes, q, gradients, q)
            gaps[q] = pair.g + ray_gap_rate(pair, jump, first, second)
        else:
            gaps[q] = pair.g + dot(pair.n, jump)  # (8)


@njit(cache=True)
def _keep(q: int, nodes: Ints64, weights: Floats, facet_nodes: Ints64, f: int, N: Four) -> None:
    for i in range(4):
        nodes[q, i] = facet_nodes[f, i]
    weights[q, 0], weights[q, 1], weights[q, 2], weights[q, 3] = N


@njit(cache=True, error_model="numpy")
def committed_anchors(pairs: Pairs, law: PointLaws, new_anchors: Anchors, sliding: Floats) -> None:
    """The anchors to keep when a step is accepted: new_anchors = (nodes (np, 4), weights (np, 4)), and sliding (np,).

    Open or frictionless: the projection itself.  Stick: unchanged.  Slip: behind the projection by the elastic slip
    T_T/eps_T, the return mapping of (16).  No partner: none (-1).  sliding is how far points that do not stick have
    gone [length], all of it along the plane of n: anchors on a facet of another normal trail along n, too (see
    `slide_anchor`), which no slip did.
    new_anchors must not be the arrays of anchors.
    """
    _, _, surface, (facet, kind, _, _, _, _), anchors = pairs
    nodes, weights = new_anchors
    eps_t = law[1]
    for q in range(len(sliding)):
        sliding[q] = 0.0
        if kind[q] == NONE:
            nodes[q, :] = -1
            weights[q, :] = 0.0
            continue
        pair = place_apart(q, pairs)
        found = _present_traction(q, pair, law, anchors)
        if found.status == STICK:
            nodes[q, :], weights[q, :] = anchors[0][q], anchors[1][q]
            continue
        _keep(q, nodes, weights, surface[0], facet[q], pair.N)
        if found.status == SLIP:
            slide_anchor(q, pair, found.tangential, eps_t[q], weights)
        if anchors[0][q, 0] >= 0:
            sliding[q] = norm(less(planar(pair.w, pair.n), 1.0 / eps_t[q], found.tangential))


@njit(cache=True, error_model="numpy")
def anchors_since_rest(
    pairs: Pairs, rests: Anchors, law: PointLaws, grown: tuple[float, float]
) -> tuple[Ints64, Floats, Floats]:
    """Anchors of points that stick or slip, from the slip s = P(n) (x_M - x_rest) since they came to rest; rests: like
    anchors, places x_rest; grown = (share, factor).

    (share, 1) is Uzawa's update of friction: T_T^tr + share (T_T + eps_T s - T_T^tr), in stick T_T^tr + share eps_T s.
    (factor - 1, factor) lets points go on as they do where the penalty grows: T_T^tr + (factor - 1) eps_T s under a
    tangential penalty factor eps_T, so that their traction is the same at rest.  Returns nodes and weights, on the points'
    present facets, and ways (np, 3) [length]: |s|; |T_T^tr| / eps_T less what it is at rest; and |s| in stick, in slip what
    of s is not along the friction.  Anchors of other points stay, and their ways are |s|, 0, 0.
    """
    coords, slaves, surface, projection, anchors = pairs
    resting = coords, slaves, surface, projection, rests
    nodes, weights, ways = anchors[0].copy(), anchors[1].copy(), np.zeros((len(anchors[0]), 3))
    eps_t, (share, factor) = law[1], grown
    for q in range(len(ways)):
        if projection[1][q] == NONE or anchors[0][q, 0] < 0 or rests[0][q, 0] < 0:
            continue
        pair = place_apart(q, pairs)
        found = _present_traction(q, pair, law, anchors)
        rested = place_apart(q, resting)
        slip = planar(rested.w, pair.n)
        ways[q, 0] = norm(slip)
        if found.status != STICK and found.status != SLIP:
            continue
        pulled = times(1.0 / eps_t[q], found.trial)
        ways[q, 1] = norm(pulled) - norm(minus(pulled, slip))
        along = dot(pulled, slip) if found.status == SLIP else 0.0
        ways[q, 2] = norm(less(slip, along / dot(pulled, pulled), pulled)) if along > 0.0 else norm(slip)
        kept = less(found.trial, share, minus(found.trial, found.tangential)) if factor == 1.0 else found.trial
        _keep(q, nodes, weights, surface[0], projection[0][q], pair.N)
        slide_anchor(q, pair, plus(kept, times(share * eps_t[q], slip)), factor * eps_t[q], weights)
    return nodes, weights, ways
