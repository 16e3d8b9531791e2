"""The tangent of contact averaged at slave nodes: exact derivative of the forces of kernels/mortar.py, with its arrays.

Two parts: how the forces of tractions that are held move with the samples' normals and feet, facet by facet; and how the
tractions of a slave node change with its gap and way, R_A M_A S_A: its forces per traction, the rates of the law, the rates
of its means.  Columns of normals are turned into those of the nodes around them last.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.couplings import find
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.mortar import Anchors, Foot, Slaves, foot_of
from fenics_contact.kernels.vectors import ZERO, Vector, dot, less, minus, of_four, of_nodes, plus, row, times
from fenics_contact.types import Bools, Floats, Ints64

# slot_starts, slot_nodes, turns of kernels/normals.py; lengths (np,) of the samples' mean normals
Turned = tuple[Ints64, Ints64, Floats, Floats]
Matrix = tuple[Ints64, Ints64, Ints64, Ints64, Floats, Bools]  # a Pattern, values (nb, 3, 3) and used (nb,) of its blocks


@njit(cache=True)
def _join(node: int, known: Ints64, stamp: Ints64, mark: int, nodes: Ints64, n: int) -> int:
    """Give a node its place in a list of n; returns how long the list is then."""
    if stamp[node] != mark:
        stamp[node], known[node], nodes[n] = mark, n, node
        n += 1
    return n


@njit(cache=True)
def _outer(matrix: Floats, share: float, a: Vector, b: Vector) -> None:
    """matrix (3, 3) += share a b^T."""
    for i in range(3):
        for j in range(3):
            matrix[i, j] += share * a[i] * b[j]


@njit(cache=True, error_model="numpy")
def _held(f: int, s: int, slaves: Slaves, acting: tuple[Floats, Floats, Ints64]) -> tuple[float, Vector]:
    """Normal and tangential force of sample s of facet f under the tractions of the nodes this process answers for."""
    N, T, number = acting
    total, tangential = 0.0, ZERO
    for c in range(slaves[3].shape[1]):
        A = number[f, c]
        if A >= 0:
            share = slaves[3][s, c] * slaves[1][f, s]
            total += share * N[A]
            tangential = less(tangential, -share, row(T, A))
    return total, tangential


@njit(cache=True, error_model="numpy")
def add_held_tangents(
    coords: Floats,
    slaves: Slaves,
    surface: Surface,
    projection: Projection,
    turned: Turned,
    acting: tuple[Floats, Floats, Ints64],
    matrix: Matrix,
) -> int:
    """Add how the forces of tractions that are held move; returns the number of blocks that have no place in the matrix.

    acting: as in add_node_forces.
    """
    nodes, table, shapes, group = slaves[0], slaves[2], slaves[3], slaves[4]
    slot_starts, slot_nodes, turns, lengths = turned
    count, m, k = len(shapes), shapes.shape[1], nodes.shape[1]
    rows, ring = k + 4 * count, 0
    for g in range(len(slot_starts) - 1):
        ring = max(ring, slot_starts[g + 1] - slot_starts[g])
    known, stamp, here = np.empty(len(coords), np.int64), np.full(len(coords), -1), np.empty(rows + m * ring, np.int64)
    element, leaned = np.zeros((rows, rows + m * ring, 3, 3)), np.zeros((rows, m, 3, 3))
    lean, carried, missing = np.empty((3, 3)), np.empty((3, 3)), 0
    for f in range(len(nodes)):
        n = 0
        for i in range(k):
            n = _join(nodes[f, i], known, stamp, f, here, n)
        for s in range(count):
            q = f * count + s
            if projection[1][q] == NONE:
                continue
            normal = row(projection[5], q)
            total, t = _held(f, s, slaves, acting)
            if total == 0.0 and t[0] == 0.0 and t[1] == 0.0 and t[2] == 0.0:
                continue
            foot = foot_of(q, coords, surface, projection)
            across = dot(normal, t)
            t = less(t, across, normal)
            force = plus(times(total, normal), t)
            for a in range(3):  # force moves by lean times the motion of the corners' mean normal
                for b in range(3):
                    one = 1.0 if a == b else 0.0
                    lean[a, b] = -((total - across) * (one - normal[a] * normal[b]) - normal[a] * t[b]) / lengths[q]
            for i in range(k):
                _lean(leaned, i, table[s, i], lean, shapes, s)
            corners = surface[0][projection[0][q]]
            for j in range(4):
                if foot.N[j] == 0.0 and foot.N1[j] == 0.0 and foot.N2[j] == 0.0:
                    continue
                n = _join(corners[j], known, stamp, f, here, n)
                at, h = known[corners[j]], plus(times(foot.N1[j], foot.c1), times(foot.N2[j], foot.c2))
                for a in range(3):
                    for b in range(3):
                        carried[a, b] = lean[a, b] * foot.N[j] + foot.g / lengths[q] * force[a] * h[b]
                _lean(leaned, at, -1.0, carried, shapes, s)
                for i in range(k):
                    _outer(element[at, i], -table[s, i], force, h)
                for l in range(4):
                    n = _join(corners[l], known, stamp, f, here, n)
                    _outer(element[at, known[corners[l]]], foot.N[l], force, h)
        height = n
        if height == k and not leaned[:k].any():
            continue
        for c in range(m):
            for at in range(slot_starts[group[f, c]], slot_starts[group[f, c] + 1]):
                n = _join(slot_nodes[at], known, stamp, f, here, n)
                column = known[slot_nodes[at]]
                for i in range(height):
                    _multiply(element[i, column], leaned[i, c], turns[at])
        for i in range(height):
            for j in range(n):
                missing += _insert(here[i], here[j], element[i, j], matrix)
        element[:height, :n] = 0.0
        leaned[:height] = 0.0
    return missing


@njit(cache=True)
def _lean(leaned: Floats, i: int, share: float, lean: Floats, shapes: Floats, s: int) -> None:
    for c in range(shapes.shape[1]):
        for a in range(3):
            for b in range(3):
                leaned[i, c, a, b] += share * shapes[s, c] * lean[a, b]


@njit(cache=True)
def _multiply(matrix: Floats, left: Floats, right: Floats) -> None:
    """matrix += left right."""
    for a in range(3):
        for b in range(3):
            matrix[a, b] += left[a, 0] * right[0, b] + left[a, 1] * right[1, b] + left[a, 2] * right[2, b]


@njit(cache=True)
def _insert(head: int, tail: int, block: Floats, matrix: Matrix) -> int:
    """Add a block to the matrix; returns 1 where it has no place there, unless the block is zero."""
    blocks, first, end, columns, values, used = matrix
    largest = 0.0
    for a in range(3):
        for b in range(3):
            largest = max(largest, abs(block[a, b]))
    if largest == 0.0:
        return 0
    at = find(columns, first[head], end[head], blocks[tail])
    if at < 0:
        return 1
    used[at] = True
    for a in range(3):
        for b in range(3):
            values[at, a, b] += block[a, b]
    return 0


@njit(cache=True, error_model="numpy")
def add_node_tangents(
    coords: Floats,
    slaves: Slaves,
    surface: Surface,
    projection: Projection,
    anchors: Anchors,
    turned: Turned,
    changing: tuple[Floats, Floats, Floats],
    matrix: Matrix,
) -> int:
    """Add R_A M_A S_A; changing: (rates (ns, 4, 4) M, areas (ns,), anchored areas (ns,)). Returns blocks without a place."""
    starts, facets, places = slaves[5], slaves[6], slaves[7]
    slot_starts, slot_nodes, turns, lengths = turned
    nodes, weights, table, shapes, group = slaves[0], slaves[1], slaves[2], slaves[3], slaves[4]
    count, m, k = len(shapes), shapes.shape[1], nodes.shape[1]
    known, stamp, here = np.empty(len(coords), np.int64), np.full(len(coords), -1), np.empty(len(coords), np.int64)
    groups = len(slot_starts) - 1
    known_groups, group_stamp, these = np.empty(groups, np.int64), np.full(groups, -1), np.empty(groups, np.int64)
    rates, leaned = np.zeros((len(coords), 4, 3)), np.zeros((groups, 4, 3))
    forces, rubs, acted = np.zeros((len(coords), 3)), np.zeros((len(coords), 3, 3)), np.zeros(len(coords), np.bool_)
    changed, block, missing = np.empty((4, 3)), np.empty((3, 3)), 0
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
                if projection[1][q] == NONE:
                    continue
                foot, a = foot_of(q, coords, surface, projection), q * m + c
                has_anchor = rough and anchors[0][a, 0] >= 0
                share = weights[f, s] * shapes[s, c]
                by_gap, by_way = share / changing[1][A], share / changing[2][A] if has_anchor else 0.0
                w = minus(foot.x, of_nodes(anchors[1], a, anchors[0], coords)) if has_anchor else ZERO
                push, turn, drags, swings = _sample_rates(foot, w)
                for i in range(k):
                    n = _join(nodes[f, i], known, stamp, A, here, n)
                    _spread(rates, known[nodes[f, i]], table[s, i], by_gap, by_way, push, drags)
                    _act(forces, rubs, acted, known[nodes[f, i]], share * table[s, i], foot.n)
                corners = surface[0][projection[0][q]]
                for j in range(4):
                    n = _join(corners[j], known, stamp, A, here, n)
                    at = known[corners[j]]
                    _spread(rates, at, -foot.N[j], by_gap, by_way, push, drags)
                    _act(forces, rubs, acted, at, -share * foot.N[j], foot.n)
                    if has_anchor:
                        _drag(rates, at, by_way * foot.N[j], foot.n)
                        n = _join(anchors[0][a, j], known, stamp, A, here, n)
                        _drag(rates, known[anchors[0][a, j]], -by_way * anchors[1][a, j], foot.n)
                for b in range(m):
                    ng = _join(group[f, b], known_groups, group_stamp, A, these, ng)
                    _spread(leaned, known_groups[group[f, b]], -shapes[s, b] / lengths[q], by_gap, by_way, turn, swings)
        for at in range(ng):
            for slot in range(slot_starts[these[at]], slot_starts[these[at] + 1]):
                n = _join(slot_nodes[slot], known, stamp, A, here, n)
                j = known[slot_nodes[slot]]
                for a in range(4):
                    for b in range(3):
                        rates[j, a, b] += (
                            leaned[at, a, 0] * turns[slot, 0, b]
                            + leaned[at, a, 1] * turns[slot, 1, b]
                            + leaned[at, a, 2] * turns[slot, 2, b]
                        )
        for j in range(n):
            for a in range(4 if rough else 1):
                for b in range(3):
                    changed[a, b] = M[a, 0] * rates[j, 0, b]
                    if rough:
                        changed[a, b] += M[a, 1] * rates[j, 1, b] + M[a, 2] * rates[j, 2, b] + M[a, 3] * rates[j, 3, b]
            for i in range(n):
                if not acted[i]:
                    continue
                for a in range(3):
                    for b in range(3):
                        block[a, b] = forces[i, a] * changed[0, b]
                        if rough:
                            block[a, b] += (
                                rubs[i, a, 0] * changed[1, b] + rubs[i, a, 1] * changed[2, b] + rubs[i, a, 2] * changed[3, b]
                            )
                missing += _insert(here[i], here[j], block, matrix)
        rates[:n], leaned[:ng], forces[:n], rubs[:n], acted[:n] = 0.0, 0.0, 0.0, 0.0, False
    return missing


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


@njit(cache=True, error_model="numpy")
def foreseen_averages(
    coords: Floats,
    slaves: Slaves,
    surface: Surface,
    projection: Projection,
    anchors: Anchors,
    turned: Turned,
    moved: Floats,
) -> Floats:
    """Changes (ns, 4) of the mean gaps and ways, linearised, when the nodes move by moved (nx, 3)."""
    starts, facets, places = slaves[5], slaves[6], slaves[7]
    slot_starts, slot_nodes, turns, lengths = turned
    nodes, weights, table, shapes, group = slaves[0], slaves[1], slaves[2], slaves[3], slaves[4]
    count, m = shapes.shape
    tilts, changes = np.zeros((len(slot_starts) - 1, 3)), np.zeros((len(starts) - 1, 4))
    for g in range(len(tilts)):
        for slot in range(slot_starts[g], slot_starts[g + 1]):
            for a in range(3):
                for b in range(3):
                    tilts[g, a] += turns[slot, a, b] * moved[slot_nodes[slot], b]
    for A in range(len(changes)):
        total, area, way, anchored = 0.0, 0.0, ZERO, 0.0
        for e in range(starts[A], starts[A + 1]):
            f, c = facets[e], places[e]
            for s in range(count):
                q, share = f * count + s, weights[f, s] * shapes[s, c]
                if projection[1][q] == NONE:
                    continue
                foot, tilt, jump = foot_of(q, coords, surface, projection), ZERO, ZERO
                for b in range(m):
                    tilt = less(tilt, shapes[s, b] / lengths[q], row(tilts, group[f, b]))
                for i in range(nodes.shape[1]):
                    jump = less(jump, -table[s, i], row(moved, nodes[f, i]))
                at = surface[0][projection[0][q]]
                m0, m1, m2, m3 = row(moved, at[0]), row(moved, at[1]), row(moved, at[2]), row(moved, at[3])
                a = q * m + c
                has_anchor = anchors[0][a, 0] >= 0
                w = minus(foot.x, of_nodes(anchors[1], a, anchors[0], coords)) if has_anchor else ZERO
                push, turn, drags, swings = _sample_rates(foot, w)
                here = of_four(foot.N, m0, m1, m2, m3)
                jump = minus(jump, here)
                total += share * (dot(push, jump) + dot(turn, tilt))
                area += share
                if has_anchor:
                    drag = minus(here, of_nodes(anchors[1], a, anchors[0], moved))
                    drag = less(drag, dot(foot.n, drag), foot.n)
                    turned_way = dot(swings[0], tilt), dot(swings[1], tilt), dot(swings[2], tilt)
                    pulled = dot(drags[0], jump), dot(drags[1], jump), dot(drags[2], jump)
                    way = less(way, -share, plus(plus(drag, pulled), turned_way))
                    anchored += share
        if area > 0.0:
            changes[A, 0] = total / area
        if anchored > 0.0:
            changes[A, 1], changes[A, 2], changes[A, 3] = times(1.0 / anchored, way)
    return changes
