"""Anchors of contact averaged at slave nodes: where its friction grows from. Arrays as in kernels/mortar.py."""

from numba import njit

from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.mortar import Anchors, Foot, Pairs, foot_of
from fenics_contact.kernels.vectors import Vector, dot, row
from fenics_contact.types import Bools, Floats


@njit(cache=True, error_model="numpy")
def anchors_behind(pairs: Pairs, behind: tuple[Bools, Floats]) -> Anchors:
    """New anchors. behind: (renewed (ns,), slips (ns, 3) [length]).

    All samples of renewed nodes get one that trails the foot by the slip; those of other nodes stay.  Samples without a foot
    have none afterwards.
    """
    _, slaves, surface, met, anchors = pairs
    starts, first, m, (renewed, slips) = slaves.starts, slaves.first, slaves.N.shape[1], behind
    nodes, weights = anchors[0].copy(), anchors[1].copy()
    for A in range(len(starts) - 1):
        for e in range(starts[A], starts[A + 1]):
            f, c = slaves.facets[e], slaves.places[e]
            for q in range(first[f], first[f + 1]):
                a = q * m + c
                if met[1][q] == NONE:
                    nodes[a, :] = -1
                    weights[a, :] = 0.0
                    continue
                if not renewed[A]:
                    continue
                foot = foot_of(q, met)
                one, two = _in_facet(foot, row(slips, A))
                for i in range(nodes.shape[1]):
                    nodes[a, i] = surface[0][met[0][q], i]
                    weights[a, i] = met[9][q, 0, i] - one * met[9][q, 1, i] - two * met[9][q, 2, i]
    return nodes, weights


@njit(cache=True, error_model="numpy")
def _in_facet(foot: Foot, slip: Vector) -> tuple[float, float]:
    """Coordinates of the vector e' of the master's plane with P(n) e' = P(n) slip."""
    return dot(foot.c1, slip), dot(foot.c2, slip)
