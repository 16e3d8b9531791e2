"""How far an analytic tool has come into a body between its slave points, and from which side it lies in their facets."""

from typing import NamedTuple

import numpy as np

from fenics_contact.contact.passing import facet_tangents, tool_distances, tool_normals
from fenics_contact.contact.surface import Dense
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.rigid_element import ToolPose
from fenics_contact.types import Bools, Floats, Ints64

FACING = 0.5  # cosine of the tool's normal with a facet's from which on the two look the same way
# Of the way from a place to the nearest slave point: a round tool that meets the points around it has come in by so much
# where its radius is 1.25 of that way
DEEP = 0.5


class Entered(NamedTuple):
    """Of n facets in which a tool lies deeper between slave points than at them.

    sag (n,): by how much [length], share (n,): over the points' distance; normals (n, 3): outward ones where it is deepest;
    behind (n,): the nearest way out of the tool leads out of the body there: half of it is through; deep (n,):
    it reaches into the body by half of the way to the nearest slave point, or more; facets (n,): their numbers.
    """

    sag: Floats
    share: Floats
    normals: Floats
    behind: Bools
    deep: Bools
    facets: Ints64


def entered(dense: Dense, x: Floats, points: Floats, tool: ToolPose, nearly: float, outward: Floats | None) -> Entered:
    """The facets of which nodes are at x (nf, k, 3) and slave points at (nf, np, 3) that a tool lies in; nearly: what of
    FACING and DEEP is enough; outward (nf, k, 3): normals at the nodes where the facets' own ones are not to be taken."""
    middle = x.mean(axis=1)
    radius = np.linalg.norm(x - middle[:, None], axis=2).max(axis=1, initial=0.0)
    near = np.flatnonzero(tool_distances(middle, tool) < radius)  # no place is farther from the middle
    places = dense.a[dense.kind[near]] @ x[near]
    gaps = _gaps(places, tool)
    deepest = gaps.argmin(axis=1) if len(near) else np.empty(0, dtype=np.int64)
    sag = -np.minimum(gaps.min(axis=1, initial=np.inf), 0.0) + np.minimum(
        _gaps(points[near], tool).min(axis=1, initial=0.0), 0.0
    )
    some = np.flatnonzero(sag > 0.0)
    near, sag, deepest = near[some], sag[some], deepest[some]
    place = places[some, deepest]
    if outward is None:
        tangents = facet_tangents(dense.gradients[dense.kind[near], deepest][:, None], x[near])
        normals = np.cross(tangents[:, 0], tangents[:, 1])
    else:
        normals = np.einsum("nk,nkc->nc", dense.a[dense.kind[near], deepest], outward[near])
    normals = unit(normals)
    way = nearly * DEEP * np.linalg.norm(points[near] - place[:, None], axis=2).min(axis=1, initial=np.inf)
    behind = np.einsum("nc,nc->n", tool_normals(place, tool), normals) > nearly * FACING
    deep = tool_distances(place - way[:, None] * normals, tool) < 0.0
    return Entered(sag, sag / dense.spacing[near], normals, behind, deep, near)


def _gaps(places: Floats, tool: ToolPose) -> Floats:
    """Signed distances (n, q) to the tool of places (n, q, 3)."""
    return tool_distances(places.reshape(-1, 3), tool).reshape(places.shape[:2])
