"""Which nodes the traction of a slave node acts on and depends on: its patch, and whether a pattern has room for it.

Nodes of one block count as one: those of a tool, of which only the sum is asked. Arrays as in kernels/mortar.py, and
    blocks     (nx,): number of each node's block, below nb
    patches    (starts (ns + 1,) of each slave node's patch, heights (ns,): it acts on so many of its members, the first of
               them, and members (n,): blocks, each once in a patch)
    felt       (facets (np,) that lead directions of friction, (0,) where none do; slot_starts and slot_nodes of
               kernels/normals.py)
"""

import numpy as np
from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.mortar import Pairs, Slaves
from fenics_contact.types import Bools, Ints64

PLACE, MARK, NODE = 0, 1, 2  # rows of lists, see `join`
NORMAL, ROUGH = 1, 2  # of what is asked: what pressure alone depends on, friction too

Patches = tuple[Ints64, Ints64, Ints64]
Felt = tuple[Ints64, Ints64, Ints64]


@njit(cache=True)
def join(node: int, listed: Ints64, mark: int, n: int) -> int:
    """Give a node its place in a list of n, one of many that have marks of their own; returns how long it is then.

    listed (3, nodes): place of each node in the list that it joined last, the mark of that, and the nodes of this one.
    """
    if listed[MARK, node] != mark:
        listed[MARK, node], listed[PLACE, node], listed[NODE, n] = mark, n, node
        n += 1
    return n


@njit(cache=True)
def no_list(count: int) -> Ints64:
    """Room for lists of nodes below count."""
    return np.full((3, count), -1)


@njit(cache=True)
def node_patches(asked: Ints64, pairs: Pairs, felt: Felt, blocks: Ints64, count: int, patches: Patches) -> int:
    """Fill the patches of slave nodes for which something is asked (ns,), 0: nothing; count: of blocks. Returns how many
    members they have: called again where that is more than there is room for."""
    (_, slaves, surface, met, (anchor_nodes, _), _), (leading, slot_starts, slot_nodes) = pairs, felt
    nodes, group, first, facets, corners = slaves.nodes, slaves.group, slaves.starts, slaves.facets, surface[0]
    (starts, heights, members), m, samples = patches, slaves.N.shape[1], slaves.first
    listed, starts[0] = no_list(count), 0
    for A in range(len(asked)):
        n, last = 0, first[A + 1] if asked[A] else first[A]
        for e in range(first[A], last):
            for i in range(nodes.shape[1]):
                n = join(blocks[nodes[facets[e], i]], listed, A, n)
            for q in range(samples[facets[e]], samples[facets[e] + 1]):
                for j in range(corners.shape[1] if met[1][q] != NONE else 0):
                    n = join(blocks[corners[met[0][q], j]], listed, A, n)
        heights[A] = n
        for e in range(first[A], last):
            for q in range(samples[facets[e]], samples[facets[e] + 1]):
                if met[1][q] == NONE:
                    continue
                a = q * m + slaves.places[e]
                for j in range(corners.shape[1] if asked[A] == ROUGH and anchor_nodes[a, 0] >= 0 else 0):
                    n = join(blocks[anchor_nodes[a, j]], listed, A, n)
                for j in range(corners.shape[1] if len(leading) > 0 else 0):
                    n = join(blocks[corners[leading[q], j]], listed, A, n)
                for j in range(4 if met[7][q, 0] >= 0 else 0):
                    n = join(blocks[met[7][q, j]], listed, A, n)
            for c in range(nodes.shape[1]):
                for slot in range(slot_starts[group[facets[e], c]], slot_starts[group[facets[e], c] + 1]):
                    n = join(blocks[slot_nodes[slot]], listed, A, n)
        if starts[A] + n <= len(members):
            members[starts[A] : starts[A] + n] = listed[NODE, :n]
        starts[A + 1] = starts[A] + n
    return starts[len(asked)]


@njit(cache=True)
def patches_lack(patches: Patches, first: Ints64, columns: Ints64) -> bool:
    """True if rows (first (nb + 1,), columns (n,)) of a pattern of blocks lack a coupling within a patch."""
    starts, heights, members = patches
    stamp = np.full(len(first) - 1, -1)
    for A in range(len(heights)):
        for e in range(starts[A], starts[A] + heights[A]):
            for at in range(first[members[e]], first[members[e] + 1]):
                stamp[columns[at]] = e
            for other in range(starts[A], starts[A + 1]):
                if stamp[members[other]] != e:
                    return True
    return False


@njit(cache=True)
def elsewhere(
    asked: Bools, slaves: Slaves, now: tuple[Ints64, Ints64, Ints64], before: tuple[Ints64, Ints64, Ints64]
) -> Bools:
    """Of slave nodes (ns,) those a sample of which has another facet, anchor or end than before; (facets (np,), anchors'
    nodes (np m, l), ends (np, 4) of kernels/coverage.py)."""
    first, facets, samples, m = slaves.starts, slaves.facets, slaves.first, slaves.N.shape[1]
    changed = np.zeros(len(asked), np.bool_)
    for A in range(len(asked)):
        for e in range(first[A], first[A + 1] if asked[A] else first[A]):
            for q in range(samples[facets[e]], samples[facets[e] + 1]):
                a = q * m + slaves.places[e]
                differs = now[0][q] != before[0][q]
                for j in range(now[1].shape[1]):
                    differs = differs or now[1][a, j] != before[1][a, j]
                for j in range(4):
                    differs = differs or now[2][q, j] != before[2][q, j]
                changed[A] = changed[A] or differs
    return changed


@njit(cache=True)
def gathered(numbers: Ints64, count: int) -> tuple[Ints64, Ints64]:
    """starts (count + 1,) and entries: where each number below count stands among the numbers (n,), -1: no number."""
    starts, entries = np.zeros(count + 1, np.int64), np.empty(len(numbers), np.int64)
    for number in numbers:
        if number >= 0:
            starts[number + 1] += 1
    for i in range(count):
        starts[i + 1] += starts[i]
    at = starts[:-1].copy()
    for n in range(len(numbers)):
        if numbers[n] >= 0:
            entries[at[numbers[n]]] = n
            at[numbers[n]] += 1
    return starts, entries
