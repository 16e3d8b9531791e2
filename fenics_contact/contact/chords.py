"""What straight cells cut off a round surface: how far this lies from their facets, by the normals around their corners.

A side e of a facet between corners with the surface's normals n and n' is the chord of an arc that lies e . (n' - n)/8
beside its middle: outside on a convex surface, inside (negative) in a bore.  Of a = -e . n and b = e . n', alike on arcs,
that takes twice the harmonic mean: where only one is not 0 the side lies beside a ridge.  On a triangle it grows as the
sides' three parabolas do, and is a third of the sum of their heights on average.

Elements of degree 1 have no more than that mean.  Gauss points of degree 2 touch where surfaces stick out, and a mean is
none of theirs: heights at the middles of the sides, carried by the facet's shape functions, are the parabolas themselves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.contact.unit import unit
from fenics_contact.kernels.normals import CREASE, corner_angles, grouped_corners
from fenics_contact.kernels.quadratic import LINE, QUADRILATERAL, STRIP, TRIANGLE
from fenics_contact.types import Floats, Ints64

if TYPE_CHECKING:
    from fenics_contact.contact.master import FacetSurface

# Derivatives of a triangle's shape functions along two of its sides, the same at its corners
GRADIENTS = np.tile([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (3, 1, 1))
# Number of the side, of both triangles of a quadrilateral in turn, by the facet's nodes after its corners
SIDES = {LINE: [0], STRIP: [0, 0], TRIANGLE: [0, 1, 2], QUADRILATERAL: [0, 1, 4, 5, 2]}


def cut_off(surface: FacetSurface) -> Floats:
    """Mean distances (nf,) [length] of the round surface from the facets that stand for it, positive outside."""
    area, heights = _arcs(surface)
    # a quadrilateral is two triangles, one after the other half way through
    whole = np.maximum(area.sum(axis=0), 1e-300)
    return np.asarray((area * heights.sum(axis=2) / 3.0).sum(axis=0) / whole)


def arches(surface: FacetSurface) -> Floats:
    """The distances at the nodes (nm,) of facets of degree 2 [length]: none at corners, at middles those of their sides."""
    (nodes, size), (_, heights), found = surface.facets, _arcs(surface), np.zeros(len(surface.X))
    if len(size):
        sides = SIDES[int(size[0])]
        found[nodes[:, -len(sides) :]] = np.concatenate(heights, axis=1)[:, sides]
    return found


def _arcs(surface: FacetSurface) -> tuple[Floats, Floats]:
    """Twice the areas (2, nf) [length^2] of both triangles of the facets, and how high the arcs rise above the middles of
    their sides (2, nf, 3) [length]."""
    triangles, X = _triangles(surface)
    count = len(triangles)
    if not count:
        return np.zeros((2, 0)), np.zeros((2, 0, 3))
    across = np.cross(*(X[triangles[:, i]] - X[triangles[:, 0]] for i in (1, 2)))
    area = np.linalg.norm(across, axis=1)
    group, cosine = np.empty((count, 3), dtype=np.int64), np.cos(np.radians(CREASE))
    starts, facets, places = grouped_corners(X, triangles, GRADIENTS, area > 0.0, cosine, group)
    angles = corner_angles(X, triangles, 3, facets, places)
    sums = np.add.reduceat(angles[:, None] * unit(across)[facets], starts[:-1])
    normals = unit(sums)[group]
    sides = np.roll(X[triangles], -1, axis=1) - X[triangles]
    first, last = -(sides * normals).sum(axis=2), (sides * np.roll(normals, -1, axis=1)).sum(axis=2)
    both = np.maximum(first * last, 0.0)
    heights = 0.5 * both / np.where(both > 0.0, first + last, 1.0)
    return area.reshape(2, -1), heights.reshape(2, -1, 3)


def _triangles(surface: FacetSurface) -> tuple[Ints64, Floats]:
    """Corners (2 nf, 3) of two triangles a facet, and positions of all nodes; sides of plane cells become strips along z."""
    (nodes, size), X = surface.corners, surface.X
    if flat := bool((size == 2).any()):
        nodes = nodes + np.array([0, 0, len(X), len(X)]) * (size == 2)[:, None]
    triangles = np.concatenate([nodes[:, [0, 1, 2]], nodes[:, [0, 2, 3]]])
    if not flat:
        return np.ascontiguousarray(triangles), X
    depth = np.linalg.norm(X[nodes[:, 1]] - X[nodes[:, 0]], axis=1).mean()
    return np.ascontiguousarray(triangles), np.concatenate([X, X + [0.0, 0.0, depth]])
