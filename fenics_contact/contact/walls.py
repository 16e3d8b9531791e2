"""Both sides of the walls of a body that meets itself: they cannot touch, for the body lies between them.

A normal that goes back through a thin wall would find the master behind it, and the slave would seem to be deep inside.
"""

import numpy as np

from fenics_contact.contact.master import MasterSurface, area_vectors
from fenics_contact.kernels.coverage import Walls
from fenics_contact.types import Floats, Ints64

Ring = tuple[MasterSurface, Ints64]  # and corners (nf, 4) of its facets


def walls_between(slave: Ring, master: Ring, part: Ints64) -> Walls | None:
    """Of facets of two surfaces; None where no two of them hang together. part: that of every local node of the mesh.
    Collective."""
    ours, theirs = (_parts(*side, part) for side in (slave, master))
    return Walls(*_placed(*slave), ours, (*_placed(*master), theirs)) if np.isin(ours, theirs).any() else None


def walls_at(nodes: Ints64, slave: Ring, master: Ring, part: Ints64) -> Walls | None:
    """The same of nodes (n,) of one of them, with mean normals and the longest side around each."""
    walls = walls_between(slave, master, part)
    if walls is None:
        return None
    (surface, ring), normals, sizes, parts = slave, *(np.zeros_like(slave[0].X[:, i]) for i in (slice(3), 0, 0))
    np.add.at(normals, ring, area_vectors(surface.X[ring])[:, None])
    np.maximum.at(sizes, ring, walls.sizes[:, None])
    parts[ring] = walls.parts[:, None]
    normals = normals[nodes] / np.maximum(np.linalg.norm(normals[nodes], axis=1, keepdims=True), 1e-300)
    return Walls(surface.X[nodes], normals, sizes[nodes], parts[nodes].astype(np.int64), walls.others)


def _parts(surface: MasterSurface, ring: Ints64, part: Ints64) -> Ints64:
    """Of facets (nf,). Collective."""
    near = surface.gathered(np.tile(part[surface.owned, None], 3).astype(float))[:, 0].astype(np.int64)
    return near[ring[:, 0] % max(len(near), 1)]  # far nodes of strips are the near ones


def _placed(surface: MasterSurface, ring: Ints64) -> tuple[Floats, Floats, Floats]:
    """Middles (nf, 3), unit normals (nf, 3) and longest sides (nf,) of facets with corners (nf, 4) as they were drawn."""
    X = surface.X[ring]
    area, sides = area_vectors(X), np.linalg.norm(X - np.roll(X, 1, axis=1), axis=2)
    return X.mean(axis=1), area / np.linalg.norm(area, axis=1, keepdims=True), sides.max(axis=1, initial=0.0)
