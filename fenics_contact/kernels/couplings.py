"""Pairs of nodes that a list of contact pairs may couple."""

import numpy as np
from numba import njit


@njit(cache=True)
def clique_keys(offsets, nodes, count):
    """Key row * count + column of every ordered pair of nodes within each list; CSR lists offsets (n + 1,), nodes."""
    total = 0
    for q in range(len(offsets) - 1):
        total += (offsets[q + 1] - offsets[q]) ** 2
    keys = np.empty(total, np.int64)
    at = 0
    for q in range(len(offsets) - 1):
        for i in range(offsets[q], offsets[q + 1]):
            for j in range(offsets[q], offsets[q + 1]):
                keys[at] = nodes[i] * count + nodes[j]
                at += 1
    return keys
