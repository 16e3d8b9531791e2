"""Flat facets that touch those of degree 2 where a contact's points meet them."""

from typing import NamedTuple

import numpy as np

from fenics_contact.kernels.deformable_element import Pairs
from fenics_contact.types import Floats, Ints64

# corners of a pair's flat facets: of the slave's, the master's, the anchor; behind them the direction of friction, if any
SLAVE, MASTER, ANCHOR, CORNERS = 0, 3, 6, 7


class Touching(NamedTuple):
    """Flat facets that touch those of the pairs `at` (n,), numbers of slave points: `pairs` and laws as the kernels take
    them; nodes (n, k) of slave facet, master facet and anchor (-1: none), lift (n, corners, k): their parts in the corners,
    CORNERS or one more, a direction; rows: how many of the nodes forces act on."""

    at: Ints64
    pairs: Pairs
    nodes: Ints64
    lift: Floats
    rows: int


def images(nodes: Ints64, numbers: Ints64) -> tuple[Ints64, Floats]:
    """Anchors (nodes (n, 4), weights (n, 4)) of one point each, with these numbers (n,); none where nodes (n, m) are."""
    at = np.where(nodes[:, :1] < 0, -1, np.tile(numbers[:, None], (1, 4)))
    return np.ascontiguousarray(at), np.tile([1.0, 0.0, 0.0, 0.0], (len(nodes), 1))
