"""How the tractions of slave nodes change with their gaps, their ways and the shares of them that are covered.

R_A M_A S_A of each node A: its forces per traction, the rates of the law, the rates of its means, with the arrays of
kernels/mortar.py and kernels/mortar_patches.py. What changes with normals does so with the nodes around them.
kernels/mortar_tangent.py adds the products up. Vectors have a zero behind them: four numbers are added at once.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.mortar import Averaged, Foot, Met, Pairs, Slaves, aside, foot_of
from fenics_contact.kernels.mortar_patches import NODE, PLACE, Patches, join, no_list
from fenics_contact.kernels.sharp_means import strays, weight
from fenics_contact.kernels.vectors import (
    ZERO,
    Four,
    Vector,
    add_four,
    dot,
    four,
    four_of,
    four_plus,
    got,
    less,
    minus,
    of_block,
    of_nodes,
    planar,
    plus,
    put_four,
    row,
    times,
)
from fenics_contact.types import Floats, Ints64

# slot_starts, slot_nodes, turns of kernels/normals.py; lengths (np,) of the samples' mean normals
Turned = tuple[Ints64, Ints64, Floats, Floats]
# Rates M of `node_rates`, averaged of kernels/mortar.py, directed (nf, l): parts of the master facets' nodes in their
# directions of friction, (0, l) where one holds for all, and the samples' facets (np,) that count for these
Changing = tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Ints64]
# blocks (nx,), patches, and factors (n, 7, 4) of their members: three rows of forces R per N and T_T, four of changes M S
Products = tuple[Ints64, Patches, Floats]
Sums = tuple[Ints64, Floats, Ints64, Floats]  # place of each block and its sums, places of the groups and their sums
OfShare = tuple[float, Vector, float]  # rates of the sums behind mean gap, mean way and covered share with a sample's share
Rows = tuple[Vector, Vector, Vector]

# Rows of a sample's rates and of sums: of the gap with x_S - x_M, the place on its facet held; of the force with N; P(n); of
# the way P (x_M - x_a) with x_S - x_M; of the gap with the normal, and of sums that of the covered share. Of a sample in a
# node the way is P(m) of that, m being the node's own normal, and P(m) P(n), its rates with x_M - x_a, follow.
PUSH, FORCE, ACROSS, DRAG, TURN, PULL = 0, 1, 2, 5, 8, 9
COVER = TURN


@njit(cache=True, error_model="numpy")
def sample_rates(met: Met) -> Floats:
    """Rates (np, 9, 4) of samples that have a foot."""
    rates = np.empty((len(met[0]), 9, 4))
    for q in range(len(rates)):
        if met[1][q] == NONE:
            continue
        foot = foot_of(q, met)
        push, turn, drags = gap_rates(foot)
        across = _across(foot.n)
        put_four(rates, q, PUSH, four(push))
        put_four(rates, q, FORCE, four(foot.n))
        for a in range(3):
            put_four(rates, q, ACROSS + a, four(across[a]))
            put_four(rates, q, DRAG + a, four(drags[a]))
        put_four(rates, q, TURN, four(turn))
    return rates


@njit(cache=True, error_model="numpy")
def node_products(pairs: Pairs, turned: Turned, changing: Changing, products: Products) -> None:
    """Fill R and M S of the nodes that have a patch."""
    (coords, slaves, surface, met, anchors, normals), (blocks, (starts, heights, members), _) = pairs, products
    nodes, weights, table, shapes, group = slaves.nodes, slaves.weights, slaves.shape, slaves.N, slaves.group
    feet, covers, N, corners, lengths, sharp = met[0], met[6], met[9], surface[0], turned[3], slaves.sharp
    anchor_nodes, anchor_weights, rates, first = anchors[0], anchors[1], sample_rates(met), slaves.first
    m, k, l, groups = shapes.shape[1], nodes.shape[1], corners.shape[1], len(turned[0]) - 1
    known, sums, led = np.empty(blocks.max() + 1 if len(blocks) else 0, np.int64), *_room(starts)
    listed, leaned, here = no_list(groups), np.zeros((groups, 5, 4)), np.zeros((1, PULL + 3, 4))
    at_group = listed[PLACE]
    for A in range(len(heights)):
        n, ng, rough = starts[A + 1] - starts[A], 0, _rubs(changing[0], A)
        for j in range(n):
            known[members[starts[A] + j]] = j
        sums[:n], led[:n] = 0.0, 0.0
        for e in range(slaves.starts[A] if n else slaves.starts[A + 1], slaves.starts[A + 1]):
            f, c = slaves.facets[e], slaves.places[e]
            for b in range(k):
                ng = join(group[f, b], listed, A, ng)
            for q in range(first[f], first[f + 1]):
                around = weights[q] * shapes[q, c]
                if feet[q] < 0:
                    continue
                a, share, way, w = q * m + c, covers[q] * around, 0.0, ZERO
                press = share * weight(A, met[4][q], changing[1][A], sharp)
                leans, normal, more = slaves.leans[f, c], row(met[5], q), four(ZERO)
                if leans > 0.0:
                    more = four(times(leans, aside(q, slaves, coords)))
                own = row(normals, group[f, c])
                _put_rates(rates, q, own, here)
                if rough and anchor_nodes[a, 0] >= 0:
                    way, w = share, minus(got(met[10], q, 0), of_nodes(anchor_weights, a, anchor_nodes, coords))
                    for j in range(l):
                        _add_anchor(sums, known[blocks[anchor_nodes[a, j]]], -way * anchor_weights[a, j], here)
                rubbed = planar(w, normal)
                for i in range(k):
                    of = press * table[q, i], share * table[q, i], way * table[q, i]
                    _add_body(sums, known[blocks[nodes[f, i]]], of, here, (normal, more))
                for j in range(l):
                    of = -press * N[q, 0, j], -share * N[q, 0, j], -way * N[q, 0, j]
                    _add_master(sums, known[blocks[corners[feet[q], j]]], of, here, (normal, more))
                turning = _turning(here, (met[4][q], normal, planar(normal, own)), w)
                _add_own_turn(leaned, at_group[group[f, c]], way, own, rubbed)
                for b in range(k):
                    part = -table[q, b] / lengths[q]
                    _add_turning(leaned, at_group[group[f, b]], press * part, way * part, turning)
                if covers[q] < 1.0:
                    into = known, sums, at_group, leaned
                    strayed = strays(A, met[4][q], changing[1][A], sharp)
                    of_share = _of_share(A, strayed, around, (way, planar(rubbed, own)), changing)
                    _uncover(q, of_share, (slaves, met, lengths), blocks, into)
                for j in range(l if len(changing[6]) > 0 else 0):
                    led[known[blocks[corners[changing[7][q], j]]]] += around * changing[6][changing[7][q], j]
        _add_normals(sums, leaned, listed[NODE, :ng], known, blocks, turned)
        _multiply(A, sums, led, changing, products)
        leaned[:ng] = 0.0


@njit(cache=True)
def _add_normals(sums: Floats, leaned: Floats, groups: Ints64, known: Ints64, blocks: Ints64, turned: Turned) -> None:
    """Add to nodes' sums what those of groups, in this order, have of the nodes' motion."""
    slot_starts, slot_nodes, turns, _ = turned
    for g in range(len(groups)):
        for slot in range(slot_starts[groups[g]], slot_starts[groups[g] + 1]):
            i = known[blocks[slot_nodes[slot]]]
            t0, t1, t2 = four_of(turns, slot, 0), four_of(turns, slot, 1), four_of(turns, slot, 2)
            for r in range(5):
                at, (x, y, z, _) = PUSH if r == 0 else DRAG - 1 + r, four_of(leaned, g, r)
                put_four(sums, i, at, four_plus(four_plus(four_plus(four_of(sums, i, at), x, t0), y, t1), z, t2))


@njit(cache=True)
def _room(starts: Ints64) -> tuple[Floats, Floats]:
    """Sums and directions of as many nodes as the longest patch has."""
    longest = 0
    for A in range(len(starts) - 1):
        longest = max(longest, starts[A + 1] - starts[A])
    return np.empty((longest, 9, 4)), np.empty(longest)


@njit(cache=True)
def _put_rates(rates: Floats, q: int, own: Vector, here: Floats) -> None:
    """Fill the rates (1, 12, 4) of sample q in a node with its own normal."""
    for r in range(PULL):
        put_four(here, 0, r, four_of(rates, q, r))
    for to, of in ((DRAG, DRAG), (PULL, ACROSS)):
        along = four_plus((0.0, 0.0, 0.0, 0.0), own[0], four_of(rates, q, of))
        along = four_plus(four_plus(along, own[1], four_of(rates, q, of + 1)), own[2], four_of(rates, q, of + 2))
        for r in range(3):
            put_four(here, 0, to + r, four_plus(four_of(rates, q, of + r), -own[r], along))


@njit(cache=True)
def _add_anchor(sums: Floats, i: int, way: float, here: Floats) -> None:
    """Add what the way of a sample has of the motion of its anchor."""
    for r in range(3):
        add_four(sums, i, DRAG + r, way, four_of(here, 0, PULL + r))


@njit(cache=True)
def _add_body(sums: Floats, i: int, shares: tuple[float, float, float], here: Floats, turned: tuple[Vector, Four]) -> None:
    """Add what a sample's gap and way have of a node's motion, and its forces, with what is added to its normal, along which
    it presses, across which it rubs; shares: of gap, friction, way."""
    (press, share, way), (normal, more) = shares, turned
    for r in range(ACROSS):
        add_four(sums, i, r, press, four_of(here, 0, r))
    for r in range(ACROSS, DRAG):
        add_four(sums, i, r, share, four_of(here, 0, r))
    for r in range(DRAG, TURN):
        add_four(sums, i, r, way, four_of(here, 0, r))
    add_four(sums, i, FORCE, press, more)
    for r in range(3):
        add_four(sums, i, ACROSS + r, -share * normal[r], more)


@njit(cache=True)
def _add_master(sums: Floats, i: int, shares: tuple[float, float, float], here: Floats, turned: tuple[Vector, Four]) -> None:
    """As _add_body, of the master's nodes: the foot moves with them, too."""
    _add_body(sums, i, shares, here, turned)
    for r in range(DRAG, TURN):
        add_four(sums, i, r, -shares[2], four_of(here, 0, r - DRAG + PULL))


@njit(cache=True)
def _turning(here: Floats, of: tuple[float, Vector, Vector], w: Vector) -> tuple[Four, Four, Four, Four]:
    """Rates of P(m) P (x_M - x_a) and the gap g `of` a sample with its normal n, x_M - x_a = w held at its place: by rows
    P(m) (-g P r_a c_a - (n.w) P - n (P w)^T), for what is turned is normal to n; P(m) n is the last of what it is `of`."""
    (g, n, lean), along = of, dot(of[1], w)
    aside, none = four(planar(w, n)), (0.0, 0.0, 0.0, 0.0)
    swing0 = four_plus(four_plus(none, -g, four_of(here, 0, DRAG)), -along, four_of(here, 0, PULL))
    swing1 = four_plus(four_plus(none, -g, four_of(here, 0, DRAG + 1)), -along, four_of(here, 0, PULL + 1))
    swing2 = four_plus(four_plus(none, -g, four_of(here, 0, DRAG + 2)), -along, four_of(here, 0, PULL + 2))
    swings = four_plus(swing0, -lean[0], aside), four_plus(swing1, -lean[1], aside), four_plus(swing2, -lean[2], aside)
    return four_of(here, 0, TURN), swings[0], swings[1], swings[2]


@njit(cache=True)
def _add_turning(leaned: Floats, g: int, share: float, way: float, turning: tuple[Four, Four, Four, Four]) -> None:
    """Add what gap and way of a sample have of the turn of a normal."""
    add_four(leaned, g, 0, share, turning[0])
    add_four(leaned, g, 1, way, turning[1])
    add_four(leaned, g, 2, way, turning[2])
    add_four(leaned, g, 3, way, turning[3])


@njit(cache=True)
def _add_own_turn(leaned: Floats, g: int, way: float, m: Vector, v: Vector) -> None:
    """Add what P(m) v, v the way of a sample, has of the turn of the node's own normal m: -(m.v) I - m v^T."""
    for a in range(3):
        add_four(leaned, g, 1 + a, -way * m[a], four(v))
        leaned[g, 1 + a, a] -= way * dot(m, v)


@njit(cache=True)
def _of_share(A: int, strays: float, around: float, moved: tuple[float, Vector], changing: Changing) -> OfShare:
    """The rates of node A with the share of a sample that strays so far and, where it has moved, has this way."""
    way, strayed = moved[0], minus(moved[1], row(changing[2], A))
    return strays * around, times(around if way > 0.0 else 0.0, strayed), around


@njit(cache=True)
def _rubs(rates: Floats, A: int) -> bool:
    """Whether the friction of node A changes with gap or way."""
    rough = False
    for a in range(1, 4):
        for b in range(4):
            rough = rough or rates[A, a, b] != 0.0
    return rough


@njit(cache=True)
def _uncover(q: int, of_share: OfShare, where: tuple[Slaves, Met, Floats], blocks: Ints64, into: Sums) -> None:
    """Add the rates of the means and of the covered share with sample q's own share."""
    (slaves, met, lengths), (known, sums, at_group, leaned) = where, into
    f, slopes, ends = slaves.facet[q], met[8], met[7]
    for i in range(slaves.nodes.shape[1]):
        _cover(sums, known[blocks[slaves.nodes[f, i]]], slaves.shape[q, i], of_share, got(slopes, q, 0), DRAG)
    for b in range(slaves.nodes.shape[1]):
        _cover(leaned, at_group[slaves.group[f, b]], -slaves.shape[q, b] / lengths[q], of_share, got(slopes, q, 1), 1)
    for i in range(3):
        _cover(sums, known[blocks[ends[q, i]]], 1.0, of_share, got(slopes, q, 2 + i), DRAG)
    _cover(sums, known[blocks[ends[q, 3]]], -1.0, of_share, got(slopes, q, 4), DRAG)


@njit(cache=True)
def _cover(sums: Floats, i: int, part: float, of_share: OfShare, slope: Vector, ways: int) -> None:
    """Add the rates with a share that has a slope with a place: of the gap, of the ways and of the share, in rows behind."""
    by_gap, by_way, whole = of_share
    add_four(sums, i, PUSH, part * by_gap, four(slope))
    for r in range(3):
        add_four(sums, i, ways + r, part * by_way[r], four(slope))
    add_four(sums, i, ways + 3, part * whole, four(slope))


@njit(cache=True)
def _multiply(A: int, sums: Floats, led: Floats, changing: Changing, products: Products) -> None:
    """Fill R and M S of the patch of node A."""
    M, (starts, heights, _), factors = changing[0][A], products[1], products[2]
    by_gap, by_share = 1.0 / changing[3][A], 1.0 / changing[5][A]
    by_way = 1.0 / changing[4][A] if changing[4][A] > 0.0 else 0.0
    for j in range(starts[A + 1] - starts[A]):
        entry = starts[A] + j
        for a in range(4):
            change = four_plus((0.0, 0.0, 0.0, 0.0), M[a, 0] * by_gap, four_of(sums, j, PUSH))
            for b in range(3):
                change = four_plus(change, M[a, 1 + b] * by_way, four_of(sums, j, DRAG + b))
            change = four_plus(change, M[a, 4] * by_share, four_of(sums, j, COVER))
            put_four(factors, entry, 3 + a, four_plus(change, led[j], (M[a, 5], M[a, 6], M[a, 7], 0.0)))
        if j < heights[A]:
            for a in range(3):
                across = four_of(sums, j, ACROSS + a)
                put_four(factors, entry, a, (sums[j, FORCE, a], across[0], across[1], across[2]))


@njit(cache=True, error_model="numpy")
def gap_rates(foot: Foot) -> tuple[Vector, Vector, Rows]:
    """Rates of a sample's gap with x_S - x_M, place on the facet held, and with its normal; of P (x_M - x_a) with the first,
    by rows."""
    n, c1, c2 = foot.n, foot.c1, foot.c2
    lean = plus(times(dot(n, foot.r1), c1), times(dot(n, foot.r2), c2))
    turn = times(foot.g, lean)
    p1, p2 = planar(foot.r1, n), planar(foot.r2, n)
    drag0 = plus(times(p1[0], c1), times(p2[0], c2))
    drag1 = plus(times(p1[1], c1), times(p2[1], c2))
    drag2 = plus(times(p1[2], c1), times(p2[2], c2))
    return minus(n, lean), planar(turn, n), (drag0, drag1, drag2)


@njit(cache=True, error_model="numpy")
def _sample_rates(foot: Foot, w: Vector) -> tuple[Vector, Vector, Rows, Rows]:
    """Those of `gap_rates`, and the rates of P (x_M - x_a) with the normal by rows, x_M - x_a = w held at its place."""
    push, turn, drags = gap_rates(foot)
    n, along = foot.n, dot(foot.n, w)
    aside, p = less(w, along, n), _across(n)
    # -g P r_a c_a - (n.w) P - n (P w)^T: what is turned is normal to n
    swing0 = less(less(times(-foot.g, drags[0]), n[0], aside), along, p[0])
    swing1 = less(less(times(-foot.g, drags[1]), n[1], aside), along, p[1])
    swing2 = less(less(times(-foot.g, drags[2]), n[2], aside), along, p[2])
    return push, turn, drags, (swing0, swing1, swing2)


@njit(cache=True)
def _across(n: Vector) -> Rows:
    """Rows of P(n)."""
    return less((1.0, 0.0, 0.0), n[0], n), less((0.0, 1.0, 0.0), n[1], n), less((0.0, 0.0, 1.0), n[2], n)


@njit(cache=True)
def _uncovered(q: int, met: Met, moved: Vector, tilt: Vector, nodes_moved: Floats) -> float:
    """Change of a sample's share when it moves, the mean normal of its corners tilts, and nodes (nx, 3) move."""
    around, slopes = met[7], met[8]
    change = dot(got(slopes, q, 0), moved) + dot(got(slopes, q, 1), tilt)
    for i in range(3):
        change += dot(got(slopes, q, 2 + i), row(nodes_moved, around[q, i]))
    return change - dot(got(slopes, q, 4), row(nodes_moved, around[q, 3]))


@njit(cache=True, error_model="numpy")
def _tilts(turned: Turned, moved: Floats) -> Floats:
    """Changes (ng, 3) of the normals of `group_normals` when nodes move by moved (nx, 3)."""
    slot_starts, slot_nodes, turns, _ = turned
    tilts = np.zeros((len(slot_starts) - 1, 3))
    for g in range(len(tilts)):
        for slot in range(slot_starts[g], slot_starts[g + 1]):
            for a in range(3):
                for b in range(3):
                    tilts[g, a] += turns[slot, a, b] * moved[slot_nodes[slot], b]
    return tilts


@njit(cache=True, error_model="numpy")
def foreseen_averages(pairs: Pairs, averaged: Averaged, turned: Turned, motion: tuple[Floats, Floats, Ints64]) -> Floats:
    """Changes (ns, 8) of mean gaps, mean ways, covered shares and directions of friction, linearised, when the nodes move.

    motion: (moved (nx, 3), directed and the samples' facets as of Changing).
    """
    (coords, slaves, surface, met, anchors, normals), (moved, directed, leading) = pairs, motion
    nodes, weights, table, shapes, first = slaves.nodes, slaves.weights, slaves.shape, slaves.N, slaves.first
    starts, sharp, m = slaves.starts, slaves.sharp, shapes.shape[1]
    tilts, lengths, changes = _tilts(turned, moved), turned[3], np.zeros((len(starts) - 1, 8))
    for A in range(len(changes)):
        total, way, bared = 0.0, ZERO, 0.0
        for e in range(starts[A], starts[A + 1]):
            f, c = slaves.facets[e], slaves.places[e]
            for q in range(first[f], first[f + 1]):
                share = weights[q] * shapes[q, c] * met[6][q]
                if met[1][q] == NONE:
                    continue
                foot, tilt, jump = foot_of(q, met), ZERO, ZERO
                for b in range(nodes.shape[1]):
                    tilt = less(tilt, table[q, b] / lengths[q], row(tilts, slaves.group[f, b]))
                for i in range(nodes.shape[1]):
                    jump = less(jump, -table[q, i], row(moved, nodes[f, i]))
                a, here = q * m + c, ZERO
                for j in range(surface[0].shape[1]):
                    here = less(here, -met[9][q, 0, j], row(moved, surface[0][met[0][q], j]))
                    if len(directed) > 0:
                        led = weights[q] * shapes[q, c] * directed[leading[q], j]
                        for b in range(3):
                            changes[A, 5 + b] += led * moved[surface[0][leading[q], j], b]
                has_anchor = anchors[0][a, 0] >= 0
                w = minus(foot.x, of_nodes(anchors[1], a, anchors[0], coords)) if has_anchor else ZERO
                push, turn, drags, swings = _sample_rates(foot, w)
                rubbed, own = planar(w, foot.n), row(normals, slaves.group[f, c])
                if met[6][q] < 1.0:
                    change = weights[q] * shapes[q, c] * _uncovered(q, met, jump, tilt, moved)
                    total += change * strays(A, foot.g, averaged[0][A], sharp)
                    bared += change
                    if has_anchor:
                        way = less(way, -change, minus(planar(rubbed, own), row(averaged[1], A)))
                jump = minus(jump, here)
                total += share * weight(A, foot.g, averaged[0][A], sharp) * (dot(push, jump) + dot(turn, tilt))
                if has_anchor:
                    drag = planar(minus(here, of_nodes(anchors[1], a, anchors[0], moved)), foot.n)
                    turned_way = dot(swings[0], tilt), dot(swings[1], tilt), dot(swings[2], tilt)
                    pulled = dot(drags[0], jump), dot(drags[1], jump), dot(drags[2], jump)
                    way = less(way, -share, planar(plus(plus(drag, pulled), turned_way), own))
                    own_tilt = row(tilts, slaves.group[f, c])
                    way = less(way, share, plus(times(dot(own, rubbed), own_tilt), times(dot(rubbed, own_tilt), own)))
        changes[A, 4] = bared / averaged[4][A]
        if averaged[2][A] > 0.0:
            changes[A, 0] = total / averaged[2][A]
        if averaged[3][A] > 0.0:
            changes[A, 1], changes[A, 2], changes[A, 3] = of_block(slaves.kept, A, times(1.0 / averaged[3][A], way))
    return changes
