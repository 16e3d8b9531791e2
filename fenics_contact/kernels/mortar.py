"""Contact averaged at slave nodes: gaps, ways, forces and anchors of a mortar method with plain shape functions.

Sample points q of the slave's facets look along averaged normals and meet the master at a foot.  Gap and way of a node A are
means over the samples around it, weighted with its shape function N_A and with how much of them lies over the master
(kernels/coverage.py); its traction acts through all of them.  Of a sample's way counts what is tangential to the node, too:
where a bent surface stretches, a mean of ways across normals that differ has a part along the node's own, which is no slip.
Where only a part s of a node's area is covered, its penalties are in series with the body beneath,
1/eps_A = 1/eps + (1 - s)/(s kappa E/h): what is nearly off the master hardly presses.

Arrays travel in groups (tuples, C-contiguous, float64 and int64); coords (nx, 3) are present positions of nodes [length]:
    slaves     see Slaves
    surface    as in kernels/closest_point.py
    met        (the projection of kernels/closest_point.py, of np samples that look along its normals, the cover of
               kernels/coverage.py, N (np, 3, l): shape functions of the master's facet, of l nodes, at the feet, with
               their two derivatives, and frames (np, 5, 3): x, r1, r2, c1, c2 of each Foot)
    anchors    (nodes (np m, l), weights (np m, l)): for each sample and each corner of its facet; nodes[:, 0] = -1: none yet
    pairs      (coords, slaves, surface, met, anchors, normals (ng, 3) of the groups)
    averaged   (gaps (ns,), endless without a foot, ways (ns, 3) since the anchors [length], areas (ns,) that have met the
               master, those with anchors (ns,), and all (ns,) [length^2]) of the slave nodes
    law        (eps_n (ns,), eps_t (ns,) [pressure/length], Friction of kernels/law.py, touch [length], shift (ns,) [length],
               judged (ns, 5) or (0, 5): gap, shift added, and way that decide who is closed and who slips [length], and
               the share of its traction that bends with the surfaces in the tangent, body (ns,): E/h of what lies beneath
               [pressure/length])
A node's anchors trail the feet of its samples by its elastic slip: its friction is felt again wherever these go on.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.foreseen import rubs
from fenics_contact.kernels.law import (
    NO_RUBBING,
    Friction,
    Gaps,
    Law,
    direction_rate,
    partials,
    rubbing,
    traction,
)
from fenics_contact.kernels.sharp_means import weight
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.kernels.vectors import (
    ZERO,
    Vector,
    add_row,
    cross,
    dot,
    got,
    less,
    minus,
    norm,
    of_block,
    of_nodes,
    planar,
    plus,
    put,
    row,
    times,
)
from fenics_contact.types import Bools, Floats, Ints, Ints64

Met = tuple[Ints64, Ints64, Ints64, Floats, Floats, Floats, Floats, Ints64, Floats, Floats, Floats]
Anchors = tuple[Ints64, Floats]
Averaged = tuple[Floats, Floats, Floats, Floats, Floats]
NodeLaws = tuple[Floats, Floats, Friction, float, Floats, Floats, Floats]
# N (ns,), T_T (ns, 3) and mean gaps (ns,) of the slave nodes, number (nf, m) of the one at each corner, -1: another process
# answers for it
Acting = tuple[Floats, Floats, Floats, Ints64]

# Of the stiffness that a node has shown, its foreseen pressure over how far the solve has moved its gap, where that is less
SOFT = 0.5
KAPPA = 100.0  # E/h over the spring in series: less is more accurate and less robust


class Slaves(NamedTuple):
    """Facets of a slave, their np samples, and its nodes.

    nodes (nf, k) of the facets, corners first; group (nf, k) of kernels/normals.py; starts (ns + 1,), facets (ne,), places
    (ne,): where each slave node is a corner; first (nf + 1,): where each facet's samples begin; facet (np,): whose a sample
    is; weights (np,): its reference area [length^2]; shape (np, k) of the facet's nodes and N (np, m) of its corners there;
    aside (np, k): parts of the nodes in what is added to normals where corners press that are ends or creases, or slide, see
    `aside`; (0, k): nothing is; leans (nf, m): how much of it; kept (ns, 3, 3): what counts of each node's mean way, on
    planes of symmetry its part in them: across them that of the samples' images is opposite; sharp (ns,) [1/length]: as of
    kernels/sharp_means.py.
    """

    nodes: Ints64
    group: Ints64
    starts: Ints64
    facets: Ints64
    places: Ints64
    first: Ints64
    facet: Ints64
    weights: Floats
    shape: Floats
    N: Floats
    aside: Floats
    leans: Floats
    kept: Floats
    sharp: Floats


Pairs = tuple[Floats, Slaves, Surface, Met, Anchors, Floats]


class Foot(NamedTuple):
    """A sample and its foot: gap, normal; x_M; tangents r_1, r_2 of the master; c_1, c_2 with dxi^a = c_a . (d(x_S - x_M) -
    g dn)."""

    g: float
    n: Vector
    x: Vector
    r1: Vector
    r2: Vector
    c1: Vector
    c2: Vector


@njit(cache=True, error_model="numpy")
def sample_places(
    coords: Floats, slaves: Slaves, normals: Floats, points: Floats, directions: Floats, lengths: Floats
) -> None:
    """Fill points (np, 3), directions (np, 3) in which they look, against the mean of the normals (ng, 3) at the nodes,
    and lengths (np,) of these means."""
    nodes, group, shape = slaves.nodes, slaves.group, slaves.shape
    for q in range(len(points)):
        f, x, y = slaves.facet[q], ZERO, ZERO
        for i in range(nodes.shape[1]):
            x, y = less(x, -shape[q, i], row(coords, nodes[f, i])), less(y, shape[q, i], row(normals, group[f, i]))
        length = max(norm(y), 1e-300)
        points[q, 0], points[q, 1], points[q, 2] = x
        directions[q, 0], directions[q, 1], directions[q, 2] = times(1.0 / length, y)
        lengths[q] = length


@njit(cache=True, error_model="numpy")
def fill_frames(coords: Floats, surface: Surface, projection: Projection, N: Floats, frames: Floats) -> None:
    """Fill the frames of samples that have a foot; N, frames: of `met`."""
    corners, facet, kind, normal = surface[0], projection[0], projection[1], projection[5]
    for q in range(len(kind)):
        if kind[q] == NONE:
            continue
        f, n, x, r1, r2 = facet[q], row(normal, q), ZERO, ZERO, ZERO
        for i in range(corners.shape[1]):
            p = row(coords, corners[f, i])
            x, r1, r2 = less(x, -N[q, 0, i], p), less(r1, -N[q, 1, i], p), less(r2, -N[q, 2, i], p)
        one, two = cross(r2, n), cross(n, r1)
        det = dot(r1, one)
        put(frames, q, 0, x)
        put(frames, q, 1, r1)
        put(frames, q, 2, r2)
        put(frames, q, 3, times(1.0 / det, one))
        put(frames, q, 4, times(1.0 / det, two))


@njit(cache=True)
def foot_of(q: int, met: Met) -> Foot:
    """The Foot of sample q."""
    frames = met[10]
    x, r1, r2 = got(frames, q, 0), got(frames, q, 1), got(frames, q, 2)
    return Foot(met[4][q], row(met[5], q), x, r1, r2, got(frames, q, 3), got(frames, q, 4))


@njit(cache=True)
def aside(q: int, slaves: Slaves, coords: Floats) -> Vector:
    """What is added to the normal of sample q where slave nodes at ends and creases press, or others that slide and lean,
    with friction: it is the master's then, over its part along the sample's own, as when the last step ended, turning with
    the slave since. So a gap along the sample's own normal grows.

    An edge of the slave digs into the master, which bends round it. Along its own normal it would push a body on that
    is drawn along. Friction acts across the same, as (I - n (n + a)^T) T_T with the sample's normal n and this, a.
    """
    f, out = slaves.facet[q], ZERO
    for i in range(slaves.nodes.shape[1] if len(slaves.aside) else 0):
        out = less(out, -slaves.aside[q, i], row(coords, slaves.nodes[f, i]))
    return out


@njit(cache=True, error_model="numpy")
def _sharpened(A: int, least: float, pairs: Pairs, area: float) -> float:
    """The mean gap of node A; least: of its samples' gaps."""
    slaves, met, total = pairs[1], pairs[3], 0.0
    for e in range(slaves.starts[A], slaves.starts[A + 1]):
        f, c = slaves.facets[e], slaves.places[e]
        for q in range(slaves.first[f], slaves.first[f + 1]):
            if met[1][q] != NONE:
                total += slaves.weights[q] * slaves.N[q, c] * met[6][q] * weight(A, met[4][q], least, slaves.sharp)
    return least - np.log(total / area) / slaves.sharp[A]


@njit(cache=True, error_model="numpy")
def averages(pairs: Pairs) -> Averaged:
    """What the slave nodes have on average."""
    coords, slaves, _, met, anchors, normals = pairs
    starts, first, weights, shapes = slaves.starts, slaves.first, slaves.weights, slaves.N
    n, m = len(starts) - 1, shapes.shape[1]
    gaps, ways, areas = np.full(n, np.inf), np.zeros((n, 3)), np.zeros(n)
    anchored, whole = np.zeros(n), np.zeros(n)
    for A in range(n):
        gap, least, way = 0.0, np.inf, ZERO
        for e in range(starts[A], starts[A + 1]):
            f, c = slaves.facets[e], slaves.places[e]
            for q in range(first[f], first[f + 1]):
                whole[A] += weights[q] * shapes[q, c]
                share = weights[q] * shapes[q, c] * met[6][q]
                if met[1][q] == NONE:
                    continue
                areas[A] += share
                gap += share * met[4][q]
                least = min(least, met[4][q]) if share > 0.0 else least
                a = q * m + c
                if anchors[0][a, 0] < 0:
                    continue
                foot = foot_of(q, met)
                w = minus(foot.x, of_nodes(anchors[1], a, anchors[0], coords))
                anchored[A] += share
                way = less(way, -share, planar(planar(w, foot.n), row(normals, slaves.group[f, c])))
        if areas[A] > 0.0:
            gaps[A] = _sharpened(A, least, pairs, areas[A]) if len(slaves.sharp) > 0 else gap / areas[A]
        if anchored[A] > 0.0:
            ways[A, 0], ways[A, 1], ways[A, 2] = of_block(slaves.kept, A, times(1.0 / anchored[A], way))
    return gaps, ways, areas, anchored, whole


@njit(cache=True, error_model="numpy")
def _series(A: int, law: NodeLaws, averaged: Averaged) -> tuple[float, float]:
    """Penalties of node A over those of one covered whole, and the slope of that ratio's logarithm with the share."""
    s, ratio = averaged[2][A] / averaged[4][A], law[0][A] / (KAPPA * law[6][A])
    both = s + ratio * (1.0 - s)
    return s / both, ratio / (s * both)


@njit(cache=True)
def softening(law: NodeLaws, averaged: Averaged, part: Floats) -> None:
    """Fill part (ns,) with the penalties over those of nodes that are covered whole; 0 where nothing is."""
    for A in range(len(part)):
        part[A] = _series(A, law, averaged)[0] if averaged[2][A] > 0.0 else 0.0


@njit(cache=True)
def _node_law(A: int, decides: float, law: NodeLaws, averaged: Averaged) -> Law:
    """The Law of node A under a gap that decides [length]: without friction where none of its samples has an anchor."""
    part = _series(A, law, averaged)[0]
    eps_n = part * law[0][A]
    friction = rubbing(law[2], A, -eps_n * decides) if averaged[3][A] > 0.0 else NO_RUBBING
    return Law(eps_n, part * law[1][A], friction, law[3])


@njit(cache=True, error_model="numpy")
def node_tractions(law: NodeLaws, averaged: Averaged, share: Floats) -> tuple[Ints, Floats, Floats, Floats]:
    """status (ns,), N (ns,) and T_T (ns, 3) [pressure] times a share (ns,), T_T^tr (ns, 3) of the nodes."""
    gaps, ways, shift, judged = averaged[0], averaged[1], law[4], law[5]
    n = len(gaps)
    status, N = np.zeros(n, np.int32), np.zeros(n)
    T, trial = np.zeros((n, 3)), np.zeros((n, 3))
    for A in range(n):
        if gaps[A] == np.inf:
            continue
        press, w = gaps[A] + shift[A], row(ways, A)
        decides = judged[A, 0] if len(judged) > 0 else press
        numbers = _node_law(A, decides, law, averaged)
        told, along, _ = rubs(numbers, law[6][A], judged, A, ZERO, w)
        found = traction(numbers, Gaps(press, decides), ZERO, along, told)
        status[A], N[A] = found.status, share[A] * found.N
        T[A, 0], T[A, 1], T[A, 2] = times(share[A], found.tangential)
        trial[A, 0], trial[A, 1], trial[A, 2] = found.trial
    return status, N, T, trial


@njit(cache=True, error_model="numpy")
def node_rates(law: NodeLaws, averaged: Averaged, share: Floats) -> tuple[Floats, Floats, Floats]:
    """rates (ns, 4, 8) of N and T_T with gap, way, share and direction of friction, the last none where one holds for all,
    and N (ns,), T_T (ns, 3) that the judged gaps and ways mean, as far as they bend with the surfaces."""
    gaps, ways, shift, judged, directions = averaged[0], averaged[1], law[4], law[5], law[2].directions
    n = len(gaps)
    rates, N, T = np.zeros((n, 4, 8)), np.zeros(n), np.zeros((n, 3))
    for A in range(n):
        if gaps[A] == np.inf:
            continue
        g = judged[A, 0] if len(judged) > 0 else gaps[A] + shift[A]
        numbers, gap, w = _node_law(A, g, law, averaged), Gaps(g, g), row(ways, A)
        told, along, weight = rubs(numbers, law[6][A], judged, A, ZERO, w)
        found = traction(numbers, gap, ZERO, along, told)
        if found.status == OPEN:
            continue
        by, bends = partials(numbers, gap, ZERO, along, found), share[A] * (judged[A, 4] if len(judged) > 0 else 1.0)
        rates[A, 0, 0], N[A] = share[A] * numbers.eps_n, bends * found.N
        for a in range(3):
            T[A, a] = bends * found.tangential[a]
            rates[A, 1 + a, 0] = share[A] * by.g[a]
        if found.status == STICK and len(judged) > 0:
            for a in range(3):
                T[A, a] = bends * numbers.eps_t * judged[A, 1 + a]
        _put_rows(rates, A, 1, weight * share[A], by.w)
        slope = _series(A, law, averaged)[1]  # both penalties grow alike: so does what sticks, and what slips with N
        rates[A, 0, 4] = slope * N[A]
        for a in range(3):
            by_N = rates[A, 1 + a, 0] / (share[A] * numbers.eps_n) * N[A] if share[A] > 0.0 else 0.0
            rates[A, 1 + a, 4] = slope * (T[A, a] if found.status == STICK else by_N)
        length = norm(row(directions, A)) if len(directions) > 0 else 0.0
        if found.status == SLIP and length > 0.0:
            _put_rows(rates, A, 5, share[A], direction_rate(numbers.friction, found.tangential, length))
    return rates, N, T


@njit(cache=True)
def _put_rows(rates: Floats, A: int, at: int, share: float, rows: tuple[Vector, Vector, Vector]) -> None:
    one, two, three = rows
    for b in range(3):
        rates[A, 1, at + b], rates[A, 2, at + b], rates[A, 3, at + b] = share * one[b], share * two[b], share * three[b]


@njit(cache=True, error_model="numpy")
def add_node_forces(pairs: Pairs, acting: Acting, forces: Floats, sums: Floats) -> None:
    """Add the virtual power of (14) to forces (nx, 3), and to the sums (ns, 13) of each slave node T, N, T_T, the square of
    T_T and what it has more where friction acts aside, then what N and T_T are as forces: the size across what is pressed
    and the vector along it. Each sample presses along a normal of its own, so that T alone does not tell one from the other.
    """
    coords, slaves, surface, met, _, _ = pairs
    nodes, sharp, (N, T, gaps, number) = slaves.nodes, slaves.sharp, acting
    for q in range(len(slaves.facet)):
        if met[1][q] == NONE:
            continue
        f, total, tangential, n = slaves.facet[q], 0.0, ZERO, row(met[5], q)
        more, at_ends, across = aside(q, slaves, coords), 0.0, 0.0
        for c in range(number.shape[1]):
            A = number[f, c]
            if A < 0 or (N[A] == 0.0 and T[A, 0] == 0.0 and T[A, 1] == 0.0 and T[A, 2] == 0.0):
                continue
            t = row(T, A)
            share = slaves.N[q, c] * slaves.weights[q] * met[6][q]
            pressed = share * N[A] * weight(A, met[4][q], gaps[A], sharp)
            along = less(n, -slaves.leans[f, c], more)
            total += pressed
            at_ends += pressed * slaves.leans[f, c]
            across += share * dot(along, t)
            tangential = less(tangential, -share, t)
            in_plane = planar(t, n)
            rises = dot(along, t) - dot(n, t)
            sums[A, 3] += pressed
            sums[A, 7] += share * dot(in_plane, in_plane)
            sums[A, 8] += share * rises * rises
            sums[A, 9] += pressed * (norm(along) if slaves.leans[f, c] > 0.0 else 1.0)
            for a in range(3):
                sums[A, a] += pressed * along[a] + share * (in_plane[a] - rises * n[a])
                sums[A, 4 + a] += share * in_plane[a]
                sums[A, 10 + a] += share * (in_plane[a] - rises * n[a])
        force = plus(plus(times(total, n), times(at_ends, more)), less(tangential, across, n))
        for i in range(nodes.shape[1]):
            add_row(forces, nodes[f, i], slaves.shape[q, i], force)
        g, corners = met[0][q], surface[0]
        for i in range(corners.shape[1]):
            add_row(forces, corners[g, i], -met[9][q, 0, i], force)


@njit(cache=True, error_model="numpy")
def anchors_behind(pairs: Pairs, behind: tuple[Bools, Floats]) -> Anchors:
    """New anchors. behind: (renewed (ns,), slips (ns, 3) [length]).

    All samples of renewed nodes get one that trails the foot by the slip; those of other nodes stay.  Samples without a foot
    have none afterwards.
    """
    _, slaves, surface, met, anchors, _ = pairs
    starts, first, m, (renewed, slips) = slaves.starts, slaves.first, slaves.N.shape[1], behind
    nodes, weights = anchors[0].copy(), anchors[1].copy()
    for A in range(len(starts) - 1):
        for e in range(starts[A], starts[A + 1]):
            f, c = slaves.facets[e], slaves.places[e]
            for q in range(first[f], first[f + 1]):
                a = q * m + c
                if met[1][q] == NONE:
                    nodes[a, :] = -1
                    weights[a, :] = 0.0
                    continue
                if not renewed[A]:
                    continue
                foot = foot_of(q, met)
                # of the vector e' of the master's plane with P(n) e' = P(n) slip
                one, two = dot(foot.c1, row(slips, A)), dot(foot.c2, row(slips, A))
                for i in range(nodes.shape[1]):
                    nodes[a, i] = surface[0][met[0][q], i]
                    weights[a, i] = met[9][q, 0, i] - one * met[9][q, 1, i] - two * met[9][q, 2, i]
    return nodes, weights
