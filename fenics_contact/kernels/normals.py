"""Averaged normals of a faceted surface: one per node, several where facets meet at a crease.

A group is a node's normal: the unit mean of the unit normals, in that node, of facets around it that look the same way.
Each counts by its angle there, as drawn, so that diagonals between triangles do not matter.  Which facets these are is
settled once.  Groups travel as a tuple:
    starts (ng + 1,)      where each group's facets begin in the next two
    facets, places (ne,)  facet, and which of its nodes the node is
    slot_starts (ng + 1,) where each group's nodes begin in the next one
    slot_nodes (ns,)      nodes the group's normal depends on, each once
    slots (ne, k)         which of these each node of the facet is; -1: the normal in this node does not feel it
    angles (ne,)          of the facets at the node
    kept (ng, 3, 3)       what stays of the sum over these facets if the images of all behind planes of symmetry join it
"""

import math

import numpy as np
from numba import njit

from fenics_contact.kernels.vectors import ZERO, Vector, cross, dot, got, less, minus, norm, of_block, plus, put, row, times
from fenics_contact.types import Bools, Floats, Ints64

CREASE = 30.0  # degrees between facets from which on they do not share a normal
Groups = tuple[Ints64, Ints64, Ints64, Ints64, Ints64, Ints64, Floats, Floats]


@njit(cache=True)
def tangents_at(coords: Floats, nodes: Ints64, f: int, gradients: Floats, c: int) -> tuple[Vector, Vector]:
    """t1, t2 = sum dN_i,alpha x_i of facet f of nodes (nf, k) in a place c of gradients (np, 2, k), counter-clockwise seen
    from outside: t1 x t2 points out of the body."""
    t1, t2 = ZERO, ZERO
    for i in range(nodes.shape[1]):
        x = row(coords, nodes[f, i])
        t1, t2 = less(t1, -gradients[c, 0, i], x), less(t2, -gradients[c, 1, i], x)
    return t1, t2


@njit(cache=True, error_model="numpy")
def grouped_corners(
    coords: Floats, nodes: Ints64, gradients: Floats, wanted: Bools, cosine: float, group: Ints64
) -> tuple[Ints64, Ints64, Ints64]:
    """Fill group (nf, m) of the corners of wanted facets (nf,), else -1; returns starts, facets, places.

    coords (nx, 3), of the reference; nodes (nf, k), corners first; gradients (m, 2, k) at the corners; cosine: of the angle
    between facets beyond which they do not share a normal.
    """
    m = gradients.shape[0]
    count = nodes.max() + 1 if len(nodes) else 0
    first = np.zeros(count + 1, np.int64)
    for f in range(len(nodes)):
        for c in range(m):
            first[nodes[f, c] + 1] += 1
    most = (first**2).sum()
    for node in range(count):
        first[node + 1] += first[node]
    own, normals, at = np.empty((len(nodes) * m, 2), np.int64), np.empty((len(nodes), m, 3)), first.copy()
    for f in range(len(nodes)):
        for c in range(m):
            t1, t2 = tangents_at(coords, nodes, f, gradients, c)
            area = cross(t1, t2)
            put(normals, f, c, times(1.0 / max(norm(area), 1e-300), area))
            own[at[nodes[f, c]], 0], own[at[nodes[f, c]], 1] = f, c
            at[nodes[f, c]] += 1
    starts, facets, places = np.zeros(len(own) + 1, np.int64), np.empty(most, np.int64), np.empty(most, np.int64)
    group[:] = -1
    n = end = 0
    for node in range(count):
        old = n
        for a in range(first[node], first[node + 1]):
            f, c = own[a]
            if not wanted[f]:
                continue
            end = starts[n]
            for b in range(first[node], first[node + 1]):
                if dot(got(normals, f, c), got(normals, own[b, 0], own[b, 1])) >= cosine:
                    facets[end], places[end] = own[b]
                    end += 1
            for g in range(old, n):
                if np.array_equal(facets[starts[g] : starts[g + 1]], facets[starts[n] : end]):
                    group[f, c] = g
            if group[f, c] < 0:
                group[f, c] = n
                n += 1
                starts[n] = end
    return starts[: n + 1].copy(), facets[: starts[n]].copy(), places[: starts[n]].copy()


@njit(cache=True, error_model="numpy")
def corner_angles(coords: Floats, nodes: Ints64, corners: int, facets: Ints64, places: Ints64) -> Floats:
    """Angles (ne,) of facets, of that many corners each, at their places; of nodes between these that of a straight side."""
    angles = np.empty(len(facets))
    for e in range(len(facets)):
        f, c = facets[e], places[e]
        if c >= corners:
            angles[e] = math.pi
            continue
        x = row(coords, nodes[f, c])
        one = minus(row(coords, nodes[f, (c + 1) % corners]), x)
        two = minus(row(coords, nodes[f, (c + corners - 1) % corners]), x)
        angles[e] = math.atan2(norm(cross(one, two)), dot(one, two))
    return angles


@njit(cache=True)
def group_slots(
    starts: Ints64, facets: Ints64, places: Ints64, nodes: Ints64, gradients: Floats
) -> tuple[Ints64, Ints64, Ints64]:
    """slot_starts, slot_nodes, slots of groups whose facets have the nodes (nf, k)."""
    k = nodes.shape[1]
    slots, found = np.full((len(facets), k), -1), np.empty(len(facets) * k, np.int64)
    slot_starts, n = np.zeros(len(starts), np.int64), 0
    for g in range(len(starts) - 1):
        for e in range(starts[g], starts[g + 1]):
            for i in range(k):
                if gradients[places[e], 0, i] == 0.0 and gradients[places[e], 1, i] == 0.0:
                    continue
                node, at = nodes[facets[e], i], slot_starts[g]
                while at < n and found[at] != node:
                    at += 1
                found[at], slots[e, i] = node, at
                n = max(n, at + 1)
        slot_starts[g + 1] = n
    return slot_starts, found[:n].copy(), slots


@njit(cache=True, error_model="numpy")
def group_normals(coords: Floats, nodes: Ints64, gradients: Floats, groups: Groups, normals: Floats, turns: Floats) -> None:
    """Fill unit normals (ng, 3) and turns (ns, 3, 3), or (ns, 3, 4) with zeros behind: a normal moves by the sum of its
    slots' turns times their motion."""
    starts, facets, places, slot_starts, _, slots, angles, kept = groups
    turns[:] = 0.0
    for g in range(len(normals)):
        total = ZERO
        for e in range(starts[g], starts[g + 1]):
            f, c = facets[e], places[e]
            t1, t2 = tangents_at(coords, nodes, f, gradients, c)
            area = cross(t1, t2)
            size = max(norm(area), 1e-300)
            n = times(1.0 / size, area)
            total = less(total, -angles[e], n)
            for i in range(nodes.shape[1]):
                if slots[e, i] >= 0:  # da = arm x dx
                    share = angles[e] / size
                    arm = less(times(share * gradients[c, 1, i], t1), share * gradients[c, 0, i], t2)
                    _add_turn(turns, slots[e, i], arm, n)
        total = of_block(kept, g, total)
        length = max(norm(total), 1e-300)
        mean = times(1.0 / length, total)
        normals[g, 0], normals[g, 1], normals[g, 2] = mean
        for s in range(slot_starts[g], slot_starts[g + 1]):
            _keep(turns, s, kept, g)
            across = of_rows(mean, got(turns, s, 0), got(turns, s, 1), got(turns, s, 2))
            for a in range(3):
                for b in range(3):
                    turns[s, a, b] = (turns[s, a, b] - mean[a] * across[b]) / length


@njit(cache=True)
def of_rows(n: Vector, r0: Vector, r1: Vector, r2: Vector) -> Vector:
    """n^T times the matrix with rows r0, r1, r2."""
    return less(less(times(n[0], r0), -n[1], r1), -n[2], r2)


@njit(cache=True)
def _keep(turns: Floats, s: int, kept: Floats, g: int) -> None:
    """turns[s] = kept[g] turns[s]."""
    r0, r1, r2 = got(turns, s, 0), got(turns, s, 1), got(turns, s, 2)
    for a in range(3):
        put(turns, s, a, of_rows(got(kept, g, a), r0, r1, r2))


@njit(cache=True)
def _add_turn(turns: Floats, s: int, arm: Vector, n: Vector) -> None:
    """turns[s] += P(n) [arm x]."""
    across = cross(n, arm)  # n^T [arm x]
    rows = (0.0, -arm[2], arm[1]), (arm[2], 0.0, -arm[0]), (-arm[1], arm[0], 0.0)
    put(turns, s, 0, plus(got(turns, s, 0), less(rows[0], n[0], across)))
    put(turns, s, 1, plus(got(turns, s, 1), less(rows[1], n[1], across)))
    put(turns, s, 2, plus(got(turns, s, 2), less(rows[2], n[2], across)))
