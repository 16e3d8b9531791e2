"""The tangent of contact averaged at slave nodes, first part: how the forces of tractions that are held move with the
samples' normals, their feet and what of them is covered, facet by facet.

Exact derivative of the forces of kernels/mortar.py, with its arrays. Columns of normals become those of the nodes around
them last. The second part is in kernels/mortar_rates.py.
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.mortar import Met, Slaves, foot_of
from fenics_contact.kernels.vectors import ZERO, Vector, dot, got, less, plus, row, times
from fenics_contact.types import Bools, Floats, Ints64

# slot_starts, slot_nodes, turns of kernels/normals.py; lengths (np,) of the samples' mean normals
Turned = tuple[Ints64, Ints64, Floats, Floats]
Matrix = tuple[Ints64, Ints64, Ints64, Ints64, Floats, Bools]  # a Pattern, values (nb, 3, 3) and used (nb,) of its blocks


@njit(cache=True)
def join(node: int, known: Ints64, stamp: Ints64, mark: int, nodes: Ints64, n: int) -> int:
    """Give a node its place in a list of n; returns how long the list is then."""
    if stamp[node] != mark:
        stamp[node], known[node], nodes[n] = mark, n, node
        n += 1
    return n


@njit(cache=True)
def _outer(blocks: Floats, j: int, share: float, a: Vector, b: Vector) -> None:
    """Block j of a row of blocks (3, 3 n) += share a b^T."""
    for i in range(3):
        for k in range(3):
            blocks[i, 3 * j + k] += share * a[i] * b[k]


@njit(cache=True, error_model="numpy")
def _held(f: int, s: int, slaves: Slaves, acting: tuple[Floats, Floats, Ints64]) -> tuple[float, Vector]:
    """Normal and tangential force of sample s of facet f, covered whole, under the tractions of the nodes this process
    answers for."""
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
    met: Met,
    turned: Turned,
    acting: tuple[Floats, Floats, Ints64],
    matrix: Matrix,
) -> int:
    """Add how the forces of tractions that are held move; returns the number of blocks that have no place in the matrix.

    acting: as in add_node_forces.
    """
    nodes, table, shapes, group, N = slaves[0], slaves[2], slaves[3], slaves[4], met[9]
    slot_starts, slot_nodes, turns, lengths = turned
    count, m, k = len(shapes), shapes.shape[1], nodes.shape[1]
    l = surface[0].shape[1]
    rows, ring = k + (l + 2) * count, 0
    for g in range(len(slot_starts) - 1):
        ring = max(ring, slot_starts[g + 1] - slot_starts[g])
    known, stamp, here = np.empty(len(coords), np.int64), np.full(len(coords), -1), np.empty(rows + m * ring, np.int64)
    element, leaned = np.zeros((rows, 3, 3 * (rows + m * ring))), np.zeros((rows, m, 3, 3))
    lean, carried, missing, order = np.empty((3, 3)), np.empty((3, 3)), 0, np.empty(len(here), np.int64)
    for f in range(len(nodes)):
        n = 0
        for i in range(k):
            n = join(nodes[f, i], known, stamp, f, here, n)
        for s in range(count):
            q = f * count + s
            if met[1][q] == NONE:
                continue
            normal = row(met[5], q)
            total, t = _held(f, s, slaves, acting)
            if total == 0.0 and t[0] == 0.0 and t[1] == 0.0 and t[2] == 0.0:
                continue
            foot, part = foot_of(q, coords, surface, met), met[6][q]
            across = dot(normal, t)
            t = less(t, across, normal)
            if part < 1.0:
                whole, turn = plus(times(total, normal), t), times(-1.0 / lengths[q], got(met[8], q, 1))
                for i in range(4):
                    n = join(met[7][q, i], known, stamp, f, here, n)
                corners = surface[0][met[0][q]]
                for j in range(l):
                    n = join(corners[j], known, stamp, f, here, n)
                for i in range(k):
                    _uncover(element[i], leaned[i], times(table[s, i], whole), q, turn, met, slaves, known)
                for j in range(l):
                    at = known[corners[j]]
                    _uncover(element[at], leaned[at], times(-N[q, 0, j], whole), q, turn, met, slaves, known)
            total, across, t = part * total, part * across, times(part, t)
            force = plus(times(total, normal), t)
            for a in range(3):  # force moves by lean times the motion of the corners' mean normal
                for b in range(3):
                    one = 1.0 if a == b else 0.0
                    lean[a, b] = -((total - across) * (one - normal[a] * normal[b]) - normal[a] * t[b]) / lengths[q]
            for i in range(k):
                _lean(leaned, i, table[s, i], lean, shapes, s)
            corners = surface[0][met[0][q]]
            for j in range(l):
                if N[q, 0, j] == 0.0 and N[q, 1, j] == 0.0 and N[q, 2, j] == 0.0:
                    continue
                n = join(corners[j], known, stamp, f, here, n)
                at, h = known[corners[j]], plus(times(N[q, 1, j], foot.c1), times(N[q, 2, j], foot.c2))
                for a in range(3):
                    for b in range(3):
                        carried[a, b] = lean[a, b] * N[q, 0, j] + foot.g / lengths[q] * force[a] * h[b]
                _lean(leaned, at, -1.0, carried, shapes, s)
                for i in range(k):
                    _outer(element[at], i, -table[s, i], force, h)
                for i in range(l):
                    n = join(corners[i], known, stamp, f, here, n)
                    _outer(element[at], known[corners[i]], N[q, 0, i], force, h)
        height = n
        if height == k and not leaned[:k].any():
            continue
        for c in range(m):
            for at in range(slot_starts[group[f, c]], slot_starts[group[f, c] + 1]):
                n = join(slot_nodes[at], known, stamp, f, here, n)
                column = known[slot_nodes[at]]
                for i in range(height):
                    _multiply(element[i], column, leaned[i, c], turns[at])
        sort_columns(here, n, matrix[0], order)
        for i in range(height):
            missing += insert_row(here[i], here, order, n, element[i], matrix)
        element[:height, :, : 3 * n] = 0.0
        leaned[:height] = 0.0
    return missing


@njit(cache=True)
def _uncover(
    element: Floats, leaned: Floats, force: Vector, q: int, turn: Vector, met: Met, slaves: Slaves, known: Ints64
) -> None:
    """Add how a sample's force on one node moves with the sample's share; turn: slope of the share with its mean normal."""
    nodes, table, shapes, ends = slaves[0], slaves[2], slaves[3], met[7]
    f, s = q // len(shapes), q % len(shapes)
    for i in range(nodes.shape[1]):
        _outer(element, known[nodes[f, i]], table[s, i], force, got(met[8], q, 0))
    for c in range(shapes.shape[1]):
        _outer(leaned[c], 0, shapes[s, c], force, turn)
    for i in range(3):
        _outer(element, known[ends[q, i]], 1.0, force, got(met[8], q, 2 + i))
    _outer(element, known[ends[q, 3]], -1.0, force, got(met[8], q, 4))


@njit(cache=True)
def _lean(leaned: Floats, i: int, share: float, lean: Floats, shapes: Floats, s: int) -> None:
    for c in range(shapes.shape[1]):
        for a in range(3):
            for b in range(3):
                leaned[i, c, a, b] += share * shapes[s, c] * lean[a, b]


@njit(cache=True)
def _multiply(blocks: Floats, j: int, left: Floats, right: Floats) -> None:
    """Block j of a row of blocks (3, 3 n) += left right."""
    for a in range(3):
        for b in range(3):
            blocks[a, 3 * j + b] += left[a, 0] * right[0, b] + left[a, 1] * right[1, b] + left[a, 2] * right[2, b]


@njit(cache=True)
def sort_columns(nodes: Ints64, n: int, blocks: Ints64, order: Ints64) -> None:
    """Fill order (n,) with the places of the first n nodes, rising by their blocks."""
    for i in range(n):
        at = i
        while at > 0 and blocks[nodes[order[at - 1]]] > blocks[nodes[i]]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i


@njit(cache=True)
def insert_row(head: int, nodes: Ints64, order: Ints64, n: int, added: Floats, matrix: Matrix) -> int:
    """Add a row of blocks (3, 3 n) of a node with the sorted nodes; returns how many, not zero, have no place there."""
    blocks, first, end, columns, values, used = matrix
    at, stop, missing = first[head], end[head], 0
    for place in range(n):
        j = order[place]
        largest = 0.0
        for a in range(3):
            for b in range(3):
                largest = max(largest, abs(added[a, 3 * j + b]))
        if largest == 0.0:
            continue
        column = blocks[nodes[j]]
        while at < stop and columns[at] < column:
            at += 1
        if at == stop or columns[at] != column:
            missing += 1
            continue
        used[at] = True
        for a in range(3):
            for b in range(3):
                values[at, a, b] += added[a, 3 * j + b]
    return missing
