"""Forces and tangent of slave points and master facets on all coordinates, as dense arrays."""

import numpy as np

from fenics_contact.kernels.contact_pairs import add_forces
from fenics_contact.kernels.contact_tangent import add_tangents

ALL_GAPS = np.empty(0)


def evaluated(coords, slaves, surface, projection, anchors, law, judged=ALL_GAPS, want_tangent=True):
    """Forces (3 nx,), tangent (3 nx, 3 nx), and per point status and traction (np, 3)."""
    n, points = len(coords), len(slaves[2])
    pairs = (coords, slaves, surface, projection, anchors), (*law, judged)
    forces, status, traction = np.zeros((n, 3)), np.full(points, 7), np.full((points, 3), np.nan)
    add_forces(*pairs, (forces, status, traction))
    values, used = np.zeros((n * n, 3, 3)), np.zeros(n * n, dtype=bool)
    if want_tangent:
        rows = np.arange(n) * n
        pattern = (np.arange(n), rows, rows + n, np.tile(np.arange(n), n))
        assert add_tangents(*pairs, pattern, (values, used)) == 0
        assert not values[~used].any()
    tangent = values.reshape(n, n, 3, 3).transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)
    return forces.ravel(), tangent, status, traction
