"""Both sides of the walls of a body that meets itself: they cannot touch, for the body lies between them.

A normal that goes back through a thin wall would find the master behind it, and the slave would seem to be deep inside.
"""

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.contact.master import MasterSurface, area_vectors
from fenics_contact.contact.passing import facet_tangents
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.broad_phase import candidates
from fenics_contact.kernels.coverage import FACING, SHUT, Walls
from fenics_contact.types import Floats, Ints64

Ring = tuple[MasterSurface, Ints64]  # and corners (nf, 4) of its facets


def walls_between(slave: Ring, master: Ring, part: Ints64, search: float = 0.0) -> Walls | None:
    """Of facets of two surfaces; None where no two of them hang together. part: that of every local node of the mesh;
    search: how far what is behind the slave's walls is looked for, where it is [length]. Collective."""
    ours, theirs = (_parts(*side, part) for side in (slave, master))
    alike = bool(np.isin(ours, theirs).any())  # here, where few of the slave's facets may be
    if not max(slave[0].comm.allgather(alike)):
        return None
    thick = _thick(slave, search) if search > 0.0 else np.full(len(ours), np.inf)
    if not alike:
        return None
    return Walls(*_placed(*slave), ours, thick, (*_placed(*master), theirs))


def _thick(slave: Ring, search: float) -> Floats:
    """How far (nf,) behind facets as drawn [length] the body ends, with a facet of any name that is opposite; endless from
    `search` on. Collective."""
    surface, (middles, normals, _) = slave[0], _placed(*slave)
    skin = MasterSurface(surface.space, compat.exterior_facets(surface.space.mesh), surface.section, surface.whole)
    theirs, thick = _placed(skin, skin.corners[0]), np.full(len(middles), np.inf)
    starts, listed = candidates(middles, skin.X, *skin.corners, search)
    s = np.repeat(np.arange(len(middles)), np.diff(starts))
    (place, out, size), n = (value[listed] for value in theirs), normals[s]
    way = place - middles[s]
    deep = -np.einsum("nc,nc->n", n, way)
    aside = np.linalg.norm(way + deep[:, None] * n, axis=1)
    behind = (np.einsum("nc,nc->n", n, out) < -FACING) & (deep > SHUT * size) & (aside < size)
    np.minimum.at(thick, s[behind], deep[behind])
    return thick


def walls_at(nodes: Ints64, slave: Ring, master: Ring, part: Ints64) -> list[Walls]:
    """The same of nodes (n,) of one of them, with mean normals and the longest side around each; and once more with those of
    the body's other walls, named or not, in whose inner corners they lie: a way that leads behind one of the two leads into
    the body there, though it may be in front of the other. Empty where no two facets hang together. Collective."""
    walls = walls_between(slave, master, part)
    if walls is None:
        return []
    (surface, ring), sizes, parts = slave, *np.zeros((2, len(slave[0].X)))
    normals = np.zeros_like(surface.X)
    np.add.at(normals, ring, area_vectors(surface.X[ring])[:, None])
    np.maximum.at(sizes, ring, walls.sizes[:, None])
    parts[ring] = walls.parts[:, None]
    place = surface.X[nodes], sizes[nodes], parts[nodes].astype(np.int64), np.full(len(nodes), np.inf)
    both = unit(normals)[nodes], unit(_others(surface, normals))[nodes]
    return [Walls(place[0], directions, *place[1:], walls.others) for directions in both]


def _others(surface: MasterSurface, normals: Floats) -> Floats:
    """Area vectors (nm, 3), summed around nodes with these normals (nm, 3), of the body's facets as drawn that are not the
    surface's and lie in front of it there: in an inner corner; zero elsewhere, as beyond an outer one. Collective."""
    space, moving, blocks = surface.space, surface.moving, compat.global_blocks(surface.space)
    at = np.minimum(np.searchsorted(moving, blocks), len(moving) - 1)
    ours = np.where((moving[at] == blocks)[:, None], normals[at], 0.0)
    rest = skin_of(space, np.setdiff1d(compat.exterior_facets(space.mesh), surface.named))
    tangents = facet_tangents(rest.slopes, rest.X)
    area = np.cross(tangents[:, 0], tangents[:, 1]).reshape(*rest.area.shape, 3).mean(axis=1)
    ways, sums = rest.X.mean(axis=1)[:, None] - rest.X, compat.Function(space)
    front = np.einsum("ekc,ekc->ek", ours[rest.nodes], ways) > 0.0
    np.add.at(sums.x.array.reshape(-1, 3), rest.nodes, front[..., None] * area[:, None])
    compat.sum_to_owners(sums)
    out = surface.gathered(sums.x.array.reshape(-1, 3)[surface.owned])
    return np.tile(out, (len(surface.X) // len(out), 1))  # far nodes of strips are the near ones


def _parts(surface: MasterSurface, ring: Ints64, part: Ints64) -> Ints64:
    """Of facets (nf,). Collective."""
    near = surface.gathered(np.tile(part[surface.owned, None], 3).astype(float))[:, 0].astype(np.int64)
    return near[ring[:, 0] % max(len(near), 1)]  # far nodes of strips are the near ones


def _placed(surface: MasterSurface, ring: Ints64) -> tuple[Floats, Floats, Floats]:
    """Middles (nf, 3), unit normals (nf, 3) and longest sides (nf,) of facets with corners (nf, 4) as they were drawn."""
    X = surface.X[ring]
    area, sides = area_vectors(X), np.linalg.norm(X - np.roll(X, 1, axis=1), axis=2)
    return X.mean(axis=1), unit(area), sides.max(axis=1, initial=0.0)
