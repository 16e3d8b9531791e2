"""Planes of symmetry on which both surfaces of a contact end: behind them the other half goes on as their mirror image."""

from typing import NamedTuple

import numpy as np

from fenics_contact.kernels.normals import CREASE
from fenics_contact.types import Bools, Floats

MIRRORED = np.sin(np.radians(CREASE / 2))  # of a way across an end: with less a facet and its mirror image have no crease
Mirror = tuple[Floats, Bools]  # unit normal (3,) of a plane, and which of a surface's nodes lie on it
Standing = tuple[bool, ...]  # which planes are such at a state


class Mirrors(NamedTuple):
    """Planes of symmetry of both surfaces as drawn: of each the nodes on them, and which nodes (nx,) of the slave, then of
    the master, must not have gone across it, by more than `near` [length]: what is led away slides over a guide."""

    slave: list[Mirror]
    master: list[Mirror]
    still: list[Bools]
    near: float

    def standing(self, gone: Floats) -> Standing:
        """Which planes are such where nodes have gone so far (nx, 3) [length] since they were drawn."""
        planes = zip(self.slave, self.still, strict=True)
        return tuple(bool(np.abs(gone[still] @ normal).max(initial=0.0) <= self.near) for (normal, _), still in planes)


def kept(normals: Floats, mirrors: list[Mirror]) -> Floats:
    """What stays (n, 3, 3) of vectors if their images behind the planes on which they stand are added, over their number:
    the part in these; normals (n, 3): of the surface as drawn, which has no crease on the plane."""
    out, on = np.tile(np.eye(3), (len(normals), 1, 1)), np.zeros((len(mirrors), len(normals)), dtype=bool)
    for k, (across, here) in enumerate(mirrors):
        on[k] = here & (np.abs(normals @ across) <= MIRRORED)
    ways = np.array([across for across, _ in mirrors]).reshape(-1, 3)
    for some in np.unique(on, axis=1).T:
        out[(on == some[:, None]).all(axis=0)] -= np.linalg.pinv(ways[some]) @ ways[some]
    return out
