"""Means of gaps over the samples around a slave node in which what is nearer counts more.

Facets of degree 2 have nodes between those with pressures.  Were all that these do left to the bodies, surfaces would
come apart in waves between the corners where pressure is above two or three times mu.  With a mean
-log(<exp(-beta g)>) / beta of the gaps g a sample is pressed by N exp(-beta (g - mean)), in sum by N: its derivative, so
there is a potential, and alike gaps are pressed alike.
"""

import numpy as np
from numba import njit

from fenics_contact.types import Floats


@njit(cache=True)
def weight(A: int, gap: float, mean: float, sharp: Floats) -> float:
    """How much a sample with a gap counts in node A of this mean gap, for its gap and its pressure; sharp (ns,): beta
    [1/length], (0,): all count alike."""
    return np.exp(-sharp[A] * (gap - mean)) if len(sharp) > 0 else 1.0


@njit(cache=True)
def strays(A: int, gap: float, mean: float, sharp: Floats) -> float:
    """By how much a gap moves the mean gap of node A, for what its sample has of the area."""
    return (1.0 - weight(A, gap, mean, sharp)) / sharp[A] if len(sharp) > 0 else gap - mean


def weights(gaps: Floats, means: Floats, sharp: Floats) -> Floats:
    """How much samples with gaps (np, 1) count in nodes of these mean gaps (np, m), where they are finite; sharp (np, m)."""
    known = np.isfinite(means) & np.isfinite(gaps)
    return np.exp(np.where(known, -sharp * (np.where(known, gaps, 0.0) - np.where(known, means, 0.0)), 0.0))
