"""Pairing of slave points with the facet of the master surface that is nearest to each."""

import numpy as np

from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.closest_point import closest_points
from fenics_contact.kernels.slave_ray import slave_rays

FACING = 0.0  # cosine of outward normals above which a facet looks the slave's own way and is no partner
# Of a facet's radius: by how much a normal from the border of a surface may miss the master. Surfaces that end together part
# by less, and a point that far outside has left.
BEYOND = 0.1


class Pairing:
    """Partners of slave points on a master surface within `search` [length].

    facets: the master's (nodes, size); seek(points, normals, coords, facets, lists, search, projection): what fills the
    projection arrays of kernels/closest_point.py.

    Candidate lists are a cache: they hold all facets within search + margin and are renewed when points and facets have
    moved by more than the margin since; no result depends on when.
    """

    def __init__(self, facets, seek, search, margin):
        self.facets, self.seek, self.search, self.margin = facets, seek, search, margin
        self._lists = self._places = None

    def project(self, points, normals, coords, timers):
        """Projection of points (np, 3) with outward normals (np, 3) on the facets at positions coords (nx, 3)."""
        if self._lists is None or self._strayed(points, coords):
            with timers("search"):
                self._lists = candidates(points, coords, *self.facets, self.search + self.margin)
            self._places = points, coords
        return self._sought(points, normals, coords, self._lists, self.search)

    def _strayed(self, points, coords):
        far = [(np.square(a - b)).sum(axis=1).max(initial=0.0) for a, b in zip((points, coords), self._places, strict=True)]
        return not np.sqrt(far).sum() <= self.margin

    def within(self, points, coords, search):
        """CSR lists (offsets, facets) of the facets whose box, enlarged by `search`, holds the points (np, 3)."""
        return candidates(points, coords, *self.facets, search)

    def far(self, points, normals, coords, search):
        """Projection with another search distance, nothing kept."""
        return self._sought(points, normals, coords, self.within(points, coords, search), search)

    def _sought(self, points, normals, coords, lists, search):
        n = len(points)
        out = (*(np.empty(n, dtype=np.int64) for _ in range(3)), np.empty((n, 2)), np.empty(n), np.empty((n, 3)))
        self.seek(points, normals, coords, self.facets, lists, search, out)
        return out


def seek_closest(points, normals, coords, facets, lists, search, out):
    """Closest point on the master, for slave nodes."""
    closest_points(points, normals, coords, facets, lists, search, FACING, out)


def seek_along_normals(nodes, gradients, corners):
    """Seeker for points of facets: the slave facet's normal finds the master. nodes (np, k), gradients (np, 2, k); corners:
    points may lie on the border of their surface."""
    beyond = BEYOND if corners else 0.0

    def seek(points, normals, coords, facets, lists, search, out):
        slave_rays(points, (nodes, gradients), coords, facets, lists, search, beyond, out)

    return seek
