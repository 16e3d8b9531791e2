"""The tangent of contact averaged at slave nodes, row by row of blocks: what the forces on a block's nodes change with.

Exact derivative of the forces of kernels/mortar.py, with its arrays. They change with the tractions of the slave nodes, by
the products of kernels/mortar_rates.py, and where these are held with the samples' normals, their feet and what of them is
covered.  Columns of normals become those of the nodes around them last.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.mortar import Acting, Met, Pairs, Slaves, aside, foot_of
from fenics_contact.kernels.mortar_patches import NODE, PLACE, gathered, join, no_list
from fenics_contact.kernels.mortar_rates import Products, Turned, gap_rates
from fenics_contact.kernels.sharp_means import weight
from fenics_contact.kernels.vectors import (
    AXES,
    ZERO,
    Four,
    add_four,
    dot,
    four,
    four_of,
    four_plus,
    got,
    less,
    plus,
    put_four,
    row,
    times,
)
from fenics_contact.types import Bools, Floats, Ints64

Block = tuple[Four, Four, Four]
Gathered = tuple[Ints64, Ints64]  # see `gathered`
# List of the columns of a row, see `join`, and sums (n, 3, 4) of their blocks; of its normals alike
Row = tuple[Ints64, Floats]
# Which samples press (np,), their rates (np, 8, 4), and v and rates of gaps (np, 2, 4), see `held_rates`
Held = tuple[Bools, Floats, Floats]
FORCE, WHOLE, PRESS = 3, 4, 5
NOUGHT = (0.0, 0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def held_rates(pairs: Pairs, lengths: Floats, acting: Acting) -> Held:
    """Of forces of samples under tractions that are held: three rows of their rates with the mean of the normals at the
    nodes, the force, the force if the sample were covered whole, and three with what is added to the normal at ends. Where
    gaps differ in weight, forces change by v with a sample's gap, too, that of its nodes held: v and the rates of the gap.
    lengths (np,): of the means."""
    (coords, slaves, _, met, _, _), (N, T, gaps, number) = pairs, acting
    weights, shapes, sharp, bending = slaves.weights, slaves.N, slaves.sharp, len(slaves.sharp) > 0
    presses, rates = np.zeros(len(met[0]), np.bool_), np.empty((len(met[0]), 8, 4))
    bends = np.empty((len(met[0]) if bending else 0, 2, 4))
    for q in range(len(presses)):
        f = slaves.facet[q]
        if met[1][q] == NONE:
            continue
        total, at_ends, t, ends, normal, part = 0.0, 0.0, ZERO, ZERO, row(met[5], q), met[6][q]
        stiff, stiff_at_ends = 0.0, 0.0
        for c in range(shapes.shape[1]):
            A = number[f, c]
            if A >= 0:
                share = shapes[q, c] * weights[q]
                pressed = share * N[A] * weight(A, met[4][q], gaps[A], sharp)
                total += pressed
                at_ends += pressed * slaves.leans[f, c]
                if bending:
                    stiff -= sharp[A] * pressed
                    stiff_at_ends -= sharp[A] * pressed * slaves.leans[f, c]
                t = less(t, -share, row(T, A))
                ends = less(ends, -share * slaves.leans[f, c], row(T, A))
        if total == 0.0 and t[0] == 0.0 and t[1] == 0.0 and t[2] == 0.0:
            continue
        presses[q], across, more = True, dot(normal, t), aside(q, slaves, coords)
        t, drawn = less(t, across, normal), dot(more, ends)
        whole = plus(plus(times(total - drawn, normal), times(at_ends, more)), t)
        scale, press = part / lengths[q], total - across - drawn
        for a in range(3):  # -((N - n.t - a.t) P(n) - n t^T)
            lean = times(normal[a], plus(times(press, normal), t))
            put_four(rates, q, a, four(times(scale, less(lean, press, (1.0 * (a == 0), 1.0 * (a == 1), 1.0 * (a == 2))))))
        put_four(rates, q, FORCE, four(times(part, whole)))
        put_four(rates, q, WHOLE, four(whole))
        for a in range(3):
            put_four(rates, q, PRESS + a, four(less(times(part * at_ends, AXES[a]), part * normal[a], ends)))
        if bending:
            push, turn, _ = gap_rates(foot_of(q, met))
            v = times(part, plus(times(stiff, normal), times(stiff_at_ends, more)))
            put_four(bends, q, 0, four(v))
            put_four(bends, q, 1, four(push))
            for a in range(3):
                add_four(rates, q, a, -v[a] / lengths[q], four(turn))
    return presses, rates, bends


@njit(cache=True, error_model="numpy")
def tangent_rows(
    pairs: Pairs, turned: Turned, held: Held, products: Products, count: int, out: tuple[Ints64, Ints64, Floats]
) -> int:
    """Fill rows (n,), rising, columns (n,) and blocks (n, 3, 3) of the tangent, each pair of `count` blocks once; returns
    how many there are: called again where that is more than there is room for."""
    _, slaves, surface, met, _, _ = pairs
    blocks, factors, corners = products[0], products[2], surface[0]
    table, group, steered, bending = slaves.shape, slaves.group, slaves.aside, len(held[2]) > 0
    N, frames, (slot_starts, slot_nodes, turns, lengths), (_, rates, bends) = met[9], met[10], turned, held
    k, l, groups = slaves.nodes.shape[1], corners.shape[1], len(slot_starts) - 1
    patches, members = _patch_rows(products, count), products[1][2]
    on_slave, leans, asides = _slave_rows(slaves, held, blocks, count), *_slave_leans(slaves, held)
    slave_rows, ours = on_slave
    (master_rows, theirs), bare = _master_rows(surface, met, held, blocks, count), (held[0] & (met[6] < 1.0)).any()
    listed, sums, end = no_list(count), np.zeros((count, 3, 4)), 0
    at_group, leaned = no_list(groups), np.zeros((groups, 3, 4))
    columns, normals = (listed, sums), (at_group, leaned)
    here = (slaves, met, lengths, held, blocks), columns, normals
    for i in range(count):
        n = _add_patches(i, patches, members, factors, columns)
        ng = _add_slave(i, on_slave, group, leans, normals)
        for at in range(slave_rows[i], slave_rows[i + 1] if len(asides) else slave_rows[i]):
            for j in range(k):
                block = blocks[slaves.nodes[ours[at] // k, j]]
                n = join(block, listed, i, n)
                _add(sums, listed[PLACE, block], 1.0, _block(asides, ours[at] * k + j))
        if bending:
            n = _bend_slave(i, n, on_slave, here[0], surface, columns)
        if bare:
            n = _uncover_slave(i, n, on_slave, *here)
        for at in range(master_rows[i], master_rows[i + 1]):
            q, place = theirs[at] // l, theirs[at] % l
            f, part = slaves.facet[q], N[q, 0, place]
            carried = _carried(rates, q, N[q, 1, place], N[q, 2, place], frames)
            moved = _both(1.0, carried, part, _bent(bends, q)) if bending else carried
            for j in range(k):
                block = blocks[slaves.nodes[f, j]]
                n = join(block, listed, i, n)
                _add(sums, listed[PLACE, block], -table[q, j], moved)
                if len(steered):
                    _add(sums, listed[PLACE, block], -part * steered[q, j], _block(rates, q, PRESS))
            for j in range(l):
                block = blocks[corners[met[0][q], j]]
                n = join(block, listed, i, n)
                _add(sums, listed[PLACE, block], N[q, 0, j], moved)
            lean = _both(met[4][q] / lengths[q], carried, part, _block(rates, q))
            for c in range(k):
                ng = join(group[f, c], at_group, i, ng)
                _add(leaned, at_group[PLACE, group[f, c]], -table[q, c], lean)
            if met[6][q] < 1.0:
                n = _uncover(i, n, (q, -part), *here)
        for at in range(ng):
            lean = _block(leaned, at)
            for slot in range(slot_starts[at_group[NODE, at]], slot_starts[at_group[NODE, at] + 1]):
                block = blocks[slot_nodes[slot]]
                n = join(block, listed, i, n)
                _add_turned(sums, listed[PLACE, block], lean, turns, slot)
        end = _put_row(i, listed[NODE, :n], sums, out, end)
        sums[:n], leaned[:ng] = 0.0, 0.0
    return end


@njit(cache=True)
def _patch_rows(products: Products, count: int) -> Gathered:
    """Where the members that nodes act on begin, by blocks (count + 1,), and spans (n, 3): member, begin and end of its
    patch."""
    starts, heights, members = products[1]
    acted, owner = np.full(len(members), -1), np.empty(len(members), np.int64)
    for A in range(len(heights)):
        owner[starts[A] : starts[A + 1]] = A
        acted[starts[A] : starts[A] + heights[A]] = members[starts[A] : starts[A] + heights[A]]
    rows, entries = gathered(acted, count)
    spans = np.empty((rows[count], 3), np.int64)
    for at in range(len(spans)):
        entry = entries[at]
        spans[at, 0], spans[at, 1], spans[at, 2] = entry, starts[owner[entry]], starts[owner[entry] + 1]
    return rows, spans


@njit(cache=True)
def _slave_leans(slaves: Slaves, held: Held) -> tuple[Floats, Floats]:
    """Rates of the held forces on the nodes of the slave's facets with the normals there (k nf k, 3, 4), and with the places
    of the facets' nodes, in which their directions have a part (k nf k, 3, 4); none where they have not."""
    (presses, rates, bends), table = held, slaves.shape
    k, turning, bending = table.shape[1], len(slaves.aside) > 0, len(bends) > 0
    pairs = k * len(slaves.nodes) * k
    leans, asides = np.zeros((pairs, 3, 4)), np.zeros((pairs if turning or bending else 0, 3, 4))
    for q in range(len(presses)):
        f = slaves.facet[q]
        for i in range(k if presses[q] else 0):
            for j in range(k):
                _add(leans, (k * f + i) * k + j, table[q, i] * table[q, j], _block(rates, q))
                if turning:
                    _add(asides, (k * f + i) * k + j, table[q, i] * slaves.aside[q, j], _block(rates, q, PRESS))
                if bending:
                    _add(asides, (k * f + i) * k + j, table[q, i] * table[q, j], _bent(bends, q))
    return leans, asides


@njit(cache=True)
def _slave_rows(slaves: Slaves, held: Held, blocks: Ints64, count: int) -> Gathered:
    """Nodes of the slave's facets that a sample presses on, gathered by blocks: numbers k facet + place there."""
    nodes, first = slaves.nodes, slaves.first
    k = nodes.shape[1]
    numbers = np.full(k * len(nodes), -1)
    for f in range(len(nodes)):
        for i in range(k if held[0][first[f] : first[f + 1]].any() else 0):
            numbers[k * f + i] = blocks[nodes[f, i]]
    return gathered(numbers, count)


@njit(cache=True)
def _master_rows(surface: Surface, met: Met, held: Held, blocks: Ints64, count: int) -> Gathered:
    """Nodes of the master that samples press on, gathered by blocks: numbers l sample + place in its facet."""
    l = surface[0].shape[1]
    numbers = np.full(l * len(held[0]), -1)
    for q in range(len(held[0])):
        for j in range(l if held[0][q] else 0):
            if met[9][q, 0, j] != 0.0 or met[9][q, 1, j] != 0.0 or met[9][q, 2, j] != 0.0:
                numbers[l * q + j] = blocks[surface[0][met[0][q], j]]
    return gathered(numbers, count)


@njit(cache=True)
def _add_patches(i: int, patches: Gathered, members: Ints64, factors: Floats, columns: Row) -> int:
    """Add R M S of all patches that act on row i, see `_patch_rows`; returns how many columns it has then."""
    (rows, spans), (listed, sums), n = patches, columns, 0
    for at in range(rows[i], rows[i + 1]):
        force = _block(factors, spans[at, 0])
        for e in range(spans[at, 1], spans[at, 2]):
            n = join(members[e], listed, i, n)
            _add_product(sums, listed[PLACE, members[e]], force, factors, e)
    return n


@njit(cache=True)
def _add_slave(i: int, ours: Gathered, group: Ints64, leans: Floats, normals: Row) -> int:
    """Add how the forces of samples on their own facets' nodes lean in row i; returns how many normals it has then."""
    (rows, numbers), (at_group, leaned) = ours, normals
    ng, k = 0, group.shape[1]
    for at in range(rows[i], rows[i + 1]):
        f = numbers[at] // k
        for c in range(k):
            ng = join(group[f, c], at_group, i, ng)
            _add(leaned, at_group[PLACE, group[f, c]], 1.0, _block(leans, numbers[at] * k + c))
    return ng


@njit(cache=True)
def _bend_slave(
    i: int, n: int, ours: Gathered, where: tuple[Slaves, Met, Floats, Held, Ints64], surface: Surface, columns: Row
) -> int:
    """Add to row i of n columns how forces of samples on their own facets' nodes change with gaps, by the master's motion;
    returns how many columns it has then."""
    (slaves, met, _, (presses, _, bends), blocks), (listed, sums) = where, columns
    k, first, corners = slaves.nodes.shape[1], slaves.first, surface[0]
    for at in range(ours[0][i], ours[0][i + 1]):
        f, place = ours[1][at] // k, ours[1][at] % k
        for q in range(first[f], first[f + 1]):
            if not presses[q]:
                continue
            bend = _bent(bends, q)
            for j in range(corners.shape[1]):
                block = blocks[corners[met[0][q], j]]
                n = join(block, listed, i, n)
                _add(sums, listed[PLACE, block], -slaves.shape[q, place] * met[9][q, 0, j], bend)
    return n


@njit(cache=True)
def _uncover_slave(
    i: int, n: int, ours: Gathered, where: tuple[Slaves, Met, Floats, Held, Ints64], columns: Row, normals: Row
) -> int:
    """Add to row i of n columns how forces of samples on their own facets' nodes move with their shares; returns how many
    columns it has then."""
    slaves, met, _, (presses, _, _), _ = where
    k, first = slaves.nodes.shape[1], slaves.first
    for at in range(ours[0][i], ours[0][i + 1]):
        f, place = ours[1][at] // k, ours[1][at] % k
        for q in range(first[f], first[f + 1]):
            if presses[q] and met[6][q] < 1.0:
                n = _uncover(i, n, (q, slaves.shape[q, place]), where, columns, normals)
    return n


@njit(cache=True)
def _block(blocks: Floats, i: int, at: int = 0) -> Block:
    """Three rows of blocks[i], from row `at`."""
    return four_of(blocks, i, at), four_of(blocks, i, at + 1), four_of(blocks, i, at + 2)


@njit(cache=True)
def _add_product(sums: Floats, i: int, force: Block, factors: Floats, e: int) -> None:
    """sums[i] += R M S, of three rows by four and four rows by three."""
    c0, c1, c2, c3 = four_of(factors, e, 3), four_of(factors, e, 4), four_of(factors, e, 5), four_of(factors, e, 6)
    (x, y, z), (f, g, h) = _block(sums, i), force
    x = four_plus(four_plus(four_plus(four_plus(x, f[0], c0), f[1], c1), f[2], c2), f[3], c3)
    y = four_plus(four_plus(four_plus(four_plus(y, g[0], c0), g[1], c1), g[2], c2), g[3], c3)
    z = four_plus(four_plus(four_plus(four_plus(z, h[0], c0), h[1], c1), h[2], c2), h[3], c3)
    put_four(sums, i, 0, x)
    put_four(sums, i, 1, y)
    put_four(sums, i, 2, z)


@njit(cache=True)
def _add_turned(sums: Floats, i: int, lean: Block, turns: Floats, slot: int) -> None:
    """sums[i] += lean turn."""
    t0, t1, t2 = _block(turns, slot)
    (x, y, z), (f, g, h) = _block(sums, i), lean
    x = four_plus(four_plus(four_plus(x, f[0], t0), f[1], t1), f[2], t2)
    y = four_plus(four_plus(four_plus(y, g[0], t0), g[1], t1), g[2], t2)
    z = four_plus(four_plus(four_plus(z, h[0], t0), h[1], t1), h[2], t2)
    put_four(sums, i, 0, x)
    put_four(sums, i, 1, y)
    put_four(sums, i, 2, z)


@njit(cache=True)
def _carried(rates: Floats, q: int, one: float, two: float, frames: Floats) -> Block:
    """How the force of sample q on a node, whose shape function has these derivatives, moves with x_S - x_M by its foot."""
    h = plus(times(one, got(frames, q, 3)), times(two, got(frames, q, 4)))
    return _outer(four_of(rates, q, FORCE), four(h))


@njit(cache=True)
def _both(r: float, a: Block, s: float, b: Block) -> Block:
    """r a + s b."""
    return (
        four_plus(four_plus(NOUGHT, r, a[0]), s, b[0]),
        four_plus(four_plus(NOUGHT, r, a[1]), s, b[1]),
        four_plus(four_plus(NOUGHT, r, a[2]), s, b[2]),
    )


@njit(cache=True)
def _uncover(
    i: int, n: int, of: tuple[int, float], where: tuple[Slaves, Met, Floats, Held, Ints64], columns: Row, normals: Row
) -> int:
    """Add to row i of n columns how a part of a sample's force moves with the sample's share; returns how many columns it
    has then."""
    slaves, met, lengths, (_, rates, _), blocks = where
    (q, part), (listed, sums), (at_group, leaned) = of, columns, normals
    f, ends, slopes, force = slaves.facet[q], met[7], met[8], four_of(rates, q, WHOLE)
    moved = _outer(force, four(got(slopes, q, 0)))
    for j in range(slaves.nodes.shape[1]):
        block = blocks[slaves.nodes[f, j]]
        n = join(block, listed, i, n)
        _add(sums, listed[PLACE, block], part * slaves.shape[q, j], moved)
    leant = _outer(force, four(got(slopes, q, 1)))
    for c in range(slaves.nodes.shape[1]):
        _add(leaned, at_group[PLACE, slaves.group[f, c]], -part * slaves.shape[q, c] / lengths[q], leant)
    for j in range(4):
        n = join(blocks[ends[q, j]], listed, i, n)
        slope = got(slopes, q, 2 + j if j < 3 else 4)
        _add(sums, listed[PLACE, blocks[ends[q, j]]], part if j < 3 else -part, _outer(force, four(slope)))
    return n


@njit(cache=True)
def _outer(a: Four, b: Four) -> Block:
    """a b^T of vectors."""
    return four_plus(NOUGHT, a[0], b), four_plus(NOUGHT, a[1], b), four_plus(NOUGHT, a[2], b)


@njit(cache=True)
def _bent(bends: Floats, q: int) -> Block:
    """How the force of sample q changes with how far its foot is from it."""
    return _outer(four_of(bends, q, 0), four_of(bends, q, 1))


@njit(cache=True)
def _add(sums: Floats, i: int, share: float, block: Block) -> None:
    """sums[i] += share block."""
    add_four(sums, i, 0, share, block[0])
    add_four(sums, i, 1, share, block[1])
    add_four(sums, i, 2, share, block[2])


@njit(cache=True)
def _put_row(i: int, columns: Ints64, sums: Floats, out: tuple[Ints64, Ints64, Floats], end: int) -> int:
    """Put the columns (n,) of row i, but for zeros, behind the rows before it while there is room; returns the new end."""
    rows, others, values = out
    for j in range(len(columns)):
        largest = 0.0
        for a in range(3):
            largest = max(largest, abs(sums[j, a, 0]), abs(sums[j, a, 1]), abs(sums[j, a, 2]))
        if largest == 0.0:
            continue
        if end < len(rows):
            rows[end], others[end] = i, columns[j]
            for a in range(3):
                for b in range(3):
                    values[end, a, b] = sums[j, a, b]
        end += 1
    return end
