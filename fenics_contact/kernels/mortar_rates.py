"""The tangent of contact averaged at slave nodes, second part: how the tractions of a node change with its gap, its way and
the share of it that is covered.

R_A M_A S_A: its forces per traction, the rates of the law, the rates of its means, with the arrays of kernels/mortar.py.
Columns of normals become those of the nodes around them last. The first part is in kernels/mortar_tangent.py.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.mortar import Anchors, Averaged, Foot, Met, Slaves, foot_of
from fenics_contact.kernels.mortar_tangent import Matrix, Turned, insert_row, join, sort_columns
from fenics_contact.kernels.vectors import ZERO, Vector, dot, got, less, minus, of_nodes, plus, row, times
from fenics_contact.types import Bools, Floats, Ints64


@njit(cache=True, error_model="numpy")
def add_node_tangents(
    coords: Floats,
    slaves: Slaves,
    surface: Surface,
    met: Met,
    anchors: Anchors,
    turned: Turned,
    changing: tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Ints64],
    matrix: Matrix,
) -> int:
    """Add R_A M_A S_A; changing: (rates M of `node_rates`, averaged of kernels/mortar.py, directed (nf, l): parts of the
    master facets' nodes in their directions of friction, (0, l) where one holds for all, and the samples' facets (nq,) that
    count for these). Returns blocks without a place."""
    starts, facets, places = slaves[5], slaves[6], slaves[7]
    slot_starts, slot_nodes, turns, lengths = turned
    nodes, weights, table, shapes, group = slaves[0], slaves[1], slaves[2], slaves[3], slaves[4]
    count, m, k = len(shapes), shapes.shape[1], nodes.shape[1]
    known, stamp, here = np.empty(len(coords), np.int64), np.full(len(coords), -1), np.empty(len(coords), np.int64)
    groups = len(slot_starts) - 1
    known_groups, group_stamp, these = np.empty(groups, np.int64), np.full(groups, -1), np.empty(groups, np.int64)
    rates, leaned = np.zeros((len(coords), 5, 3)), np.zeros((groups, 5, 3))
    gaps, ways, areas, anchored, whole, directed, leading = changing[1:]
    forces, rubs, acted = np.zeros((len(coords), 3)), np.zeros((len(coords), 3, 3)), np.zeros(len(coords), np.bool_)
    changed, added, missing = np.empty((4, 3 * len(coords))), np.empty((3, 3 * len(coords))), 0
    order, led = np.empty(len(coords), np.int64), np.zeros(len(coords))
    for A in range(len(starts) - 1):
        M, rough = changing[0][A], False
        if M[0, 0] == 0.0:
            continue
        for a in range(1, 4):
            rough = rough or M[a, 0] != 0.0 or M[a, 1] != 0.0 or M[a, 2] != 0.0 or M[a, 3] != 0.0
        n = ng = 0
        for e in range(starts[A], starts[A + 1]):
            f, c = facets[e], places[e]
            for s in range(count):
                q = f * count + s
                if met[1][q] == NONE:
                    continue
                foot, a = foot_of(q, coords, surface, met), q * m + c
                has_anchor = rough and anchors[0][a, 0] >= 0
                around, part = weights[f, s] * shapes[s, c], met[6][q]
                share = part * around
                by_gap, by_way = share / areas[A], share / anchored[A] if has_anchor else 0.0
                w = minus(foot.x, of_nodes(anchors[1], a, anchors[0], coords)) if has_anchor else ZERO
                push, turn, drags, swings = _sample_rates(foot, w)
                for i in range(k):
                    n = join(nodes[f, i], known, stamp, A, here, n)
                    _spread(rates, known[nodes[f, i]], table[s, i], by_gap, by_way, push, drags)
                    _act(forces, rubs, acted, known[nodes[f, i]], share * table[s, i], foot.n)
                corners = surface[0][met[0][q]]
                for j in range(len(corners)):
                    n, N = join(corners[j], known, stamp, A, here, n), met[9][q, 0, j]
                    at = known[corners[j]]
                    _spread(rates, at, -N, by_gap, by_way, push, drags)
                    _act(forces, rubs, acted, at, -share * N, foot.n)
                    if len(directed) > 0:
                        n = join(surface[0][leading[q], j], known, stamp, A, here, n)
                        led[known[surface[0][leading[q], j]]] += around * directed[leading[q], j]
                    if has_anchor:
                        _drag(rates, at, by_way * N, foot.n)
                        n = join(anchors[0][a, j], known, stamp, A, here, n)
                        _drag(rates, known[anchors[0][a, j]], -by_way * anchors[1][a, j], foot.n)
                for b in range(m):
                    ng = join(group[f, b], known_groups, group_stamp, A, these, ng)
                if part < 1.0:
                    for i in range(4):
                        n = join(met[7][q, i], known, stamp, A, here, n)
                    strayed = less(less(w, dot(foot.n, w), foot.n), 1.0, row(ways, A))
                    strayed = times(around / anchored[A] if has_anchor else 0.0, strayed)
                    of_share = (foot.g - gaps[A]) * around / areas[A], strayed, around / whole[A]
                    for i in range(k):
                        _cover(rates[known[nodes[f, i]]], table[s, i], of_share, got(met[8], q, 0))
                    for b in range(m):
                        at = known_groups[group[f, b]]
                        _cover(leaned[at], -shapes[s, b] / lengths[q], of_share, got(met[8], q, 1))
                    for i in range(3):
                        _cover(rates[known[met[7][q, i]]], 1.0, of_share, got(met[8], q, 2 + i))
                    _cover(rates[known[met[7][q, 3]]], -1.0, of_share, got(met[8], q, 4))
                for b in range(m):
                    _spread(leaned, known_groups[group[f, b]], -shapes[s, b] / lengths[q], by_gap, by_way, turn, swings)
        for at in range(ng):
            for slot in range(slot_starts[these[at]], slot_starts[these[at] + 1]):
                n = join(slot_nodes[slot], known, stamp, A, here, n)
                j = known[slot_nodes[slot]]
                for a in range(5):
                    for b in range(3):
                        rates[j, a, b] += (
                            leaned[at, a, 0] * turns[slot, 0, b]
                            + leaned[at, a, 1] * turns[slot, 1, b]
                            + leaned[at, a, 2] * turns[slot, 2, b]
                        )
        for j in range(n):
            for a in range(4 if rough else 1):
                for b in range(3):
                    changed[a, 3 * j + b] = M[a, 0] * rates[j, 0, b] + M[a, 4] * rates[j, 4, b]
                    if rough:
                        changed[a, 3 * j + b] += (
                            M[a, 1] * rates[j, 1, b] + M[a, 2] * rates[j, 2, b] + M[a, 3] * rates[j, 3, b]
                        )
                    if len(directed) > 0:
                        changed[a, 3 * j + b] += M[a, 5 + b] * led[j]
        sort_columns(here, n, matrix[0], order)
        for i in range(n):
            if acted[i]:
                _couple(forces[i], rubs[i], changed, 3 * n, rough, added)
                missing += insert_row(here[i], here, order, n, added, matrix)
        rates[:n], leaned[:ng], forces[:n], rubs[:n], acted[:n], led[:n] = 0.0, 0.0, 0.0, 0.0, False, 0.0
    return missing


@njit(cache=True)
def _couple(force: Floats, rub: Floats, changed: Floats, n: int, rough: bool, added: Floats) -> None:
    """Fill added (3, n) with a node's forces per traction times the changes (4, n) of N and T_T."""
    for a in range(3):
        if not rough:
            for j in range(n):
                added[a, j] = force[a] * changed[0, j]
            continue
        f, one, two, three = force[a], rub[a, 0], rub[a, 1], rub[a, 2]
        for j in range(n):
            added[a, j] = f * changed[0, j] + one * changed[1, j] + two * changed[2, j] + three * changed[3, j]


@njit(cache=True, error_model="numpy")
def _sample_rates(
    foot: Foot, w: Vector
) -> tuple[Vector, Vector, tuple[Vector, Vector, Vector], tuple[Vector, Vector, Vector]]:
    """Rates of a sample's gap with x_S - x_M, place on the facet held, and with its normal (3,); of P (x_M - x_a) with the
    same, by rows, x_M - x_a held at its place."""
    n, c1, c2 = foot.n, foot.c1, foot.c2
    lean = plus(times(dot(n, foot.r1), c1), times(dot(n, foot.r2), c2))
    turn = times(foot.g, lean)
    turn = less(turn, dot(n, turn), n)
    p1, p2 = less(foot.r1, dot(n, foot.r1), n), less(foot.r2, dot(n, foot.r2), n)
    along, w_across = dot(n, w), less(w, dot(n, w), n)
    drag0 = plus(times(p1[0], c1), times(p2[0], c2))
    drag1 = plus(times(p1[1], c1), times(p2[1], c2))
    drag2 = plus(times(p1[2], c1), times(p2[2], c2))
    # -g P r_a c_a - (n.w) P - n (P w)^T: what is turned is normal to n
    swing0 = less(times(-foot.g, drag0), n[0], w_across)
    swing1 = less(times(-foot.g, drag1), n[1], w_across)
    swing2 = less(times(-foot.g, drag2), n[2], w_across)
    p = _across(n)
    swings = less(swing0, along, p[0]), less(swing1, along, p[1]), less(swing2, along, p[2])
    return minus(n, lean), turn, (drag0, drag1, drag2), swings


@njit(cache=True)
def _across(n: Vector) -> tuple[Vector, Vector, Vector]:
    """Rows of P(n)."""
    return less((1.0, 0.0, 0.0), n[0], n), less((0.0, 1.0, 0.0), n[1], n), less((0.0, 0.0, 1.0), n[2], n)


@njit(cache=True)
def _spread(
    rates: Floats, i: int, part: float, by_gap: float, by_way: float, push: Vector, drags: tuple[Vector, Vector, Vector]
) -> None:
    for b in range(3):
        rates[i, 0, b] += part * by_gap * push[b]
    if by_way != 0.0:
        for b in range(3):
            rates[i, 1, b] += part * by_way * drags[0][b]
            rates[i, 2, b] += part * by_way * drags[1][b]
            rates[i, 3, b] += part * by_way * drags[2][b]


@njit(cache=True)
def _cover(rates: Floats, part: float, of_share: tuple[float, Vector, float], slope: Vector) -> None:
    """Add the rates of the means and of the covered share with a sample's own share, which has a slope with a place."""
    by_gap, by_way, whole = of_share
    for b in range(3):
        rates[0, b] += part * by_gap * slope[b]
        rates[1, b] += part * by_way[0] * slope[b]
        rates[2, b] += part * by_way[1] * slope[b]
        rates[3, b] += part * by_way[2] * slope[b]
        rates[4, b] += part * whole * slope[b]


@njit(cache=True)
def _drag(rates: Floats, i: int, part: float, n: Vector) -> None:
    """The rates of P dx with the motion of a node that has a part in x."""
    p = _across(n)
    for b in range(3):
        rates[i, 1, b] += part * p[0][b]
        rates[i, 2, b] += part * p[1][b]
        rates[i, 3, b] += part * p[2][b]


@njit(cache=True)
def _act(forces: Floats, rubs: Floats, acted: Bools, i: int, part: float, n: Vector) -> None:
    """Add a part of n to the force per pressure on a node, and of P(n) to that per traction."""
    acted[i] = True
    p = _across(n)
    for a in range(3):
        forces[i, a] += part * n[a]
        for b in range(3):
            rubs[i, a, b] += part * p[a][b]


@njit(cache=True)
def _uncovered(q: int, met: Met, moved: Vector, tilt: Vector, nodes_moved: Floats) -> float:
    """Change of a sample's share when it moves, the mean normal of its corners tilts, and nodes (nx, 3) move."""
    around, slopes = met[7], met[8]
    change = dot(got(slopes, q, 0), moved) - dot(got(slopes, q, 1), tilt)
    for i in range(3):
        change += dot(got(slopes, q, 2 + i), row(nodes_moved, around[q, i]))
    return change - dot(got(slopes, q, 4), row(nodes_moved, around[q, 3]))


@njit(cache=True, error_model="numpy")
def foreseen_averages(
    coords: Floats,
    slaves: Slaves,
    surface: Surface,
    met: Met,
    anchors: Anchors,
    averaged: Averaged,
    turned: Turned,
    motion: tuple[Floats, Floats, Ints64],
) -> Floats:
    """Changes (ns, 8) of mean gaps, mean ways, covered shares and directions of friction, linearised, when the nodes move.

    motion: (moved (nx, 3), directed and their facets as in add_node_tangents).
    """
    moved, directed, leading = motion
    starts, facets, places = slaves[5], slaves[6], slaves[7]
    slot_starts, slot_nodes, turns, lengths = turned
    nodes, weights, table, shapes, group = slaves[0], slaves[1], slaves[2], slaves[3], slaves[4]
    count, m = shapes.shape
    tilts, changes = np.zeros((len(slot_starts) - 1, 3)), np.zeros((len(starts) - 1, 8))
    for g in range(len(tilts)):
        for slot in range(slot_starts[g], slot_starts[g + 1]):
            for a in range(3):
                for b in range(3):
                    tilts[g, a] += turns[slot, a, b] * moved[slot_nodes[slot], b]
    for A in range(len(changes)):
        total, way, bared = 0.0, ZERO, 0.0
        for e in range(starts[A], starts[A + 1]):
            f, c = facets[e], places[e]
            for s in range(count):
                q = f * count + s
                share = weights[f, s] * shapes[s, c] * met[6][q]
                if met[1][q] == NONE:
                    continue
                foot, tilt, jump = foot_of(q, coords, surface, met), ZERO, ZERO
                for b in range(m):
                    tilt = less(tilt, shapes[s, b] / lengths[q], row(tilts, group[f, b]))
                for i in range(nodes.shape[1]):
                    jump = less(jump, -table[s, i], row(moved, nodes[f, i]))
                a, here = q * m + c, ZERO
                for j in range(surface[0].shape[1]):
                    here = less(here, -met[9][q, 0, j], row(moved, surface[0][met[0][q], j]))
                    if len(directed) > 0:
                        led = weights[f, s] * shapes[s, c] * directed[leading[q], j]
                        for b in range(3):
                            changes[A, 5 + b] += led * moved[surface[0][leading[q], j], b]
                has_anchor = anchors[0][a, 0] >= 0
                w = minus(foot.x, of_nodes(anchors[1], a, anchors[0], coords)) if has_anchor else ZERO
                push, turn, drags, swings = _sample_rates(foot, w)
                if met[6][q] < 1.0:
                    change = weights[f, s] * shapes[s, c] * _uncovered(q, met, jump, tilt, moved)
                    total += change * (foot.g - averaged[0][A])
                    bared += change
                    if has_anchor:
                        way = less(way, -change, less(less(w, dot(foot.n, w), foot.n), 1.0, row(averaged[1], A)))
                jump = minus(jump, here)
                total += share * (dot(push, jump) + dot(turn, tilt))
                if has_anchor:
                    drag = minus(here, of_nodes(anchors[1], a, anchors[0], moved))
                    drag = less(drag, dot(foot.n, drag), foot.n)
                    turned_way = dot(swings[0], tilt), dot(swings[1], tilt), dot(swings[2], tilt)
                    pulled = dot(drags[0], jump), dot(drags[1], jump), dot(drags[2], jump)
                    way = less(way, -share, plus(plus(drag, pulled), turned_way))
        changes[A, 4] = bared / averaged[4][A]
        if averaged[2][A] > 0.0:
            changes[A, 0] = total / averaged[2][A]
        if averaged[3][A] > 0.0:
            changes[A, 1], changes[A, 2], changes[A, 3] = times(1.0 / averaged[3][A], way)
    return changes
