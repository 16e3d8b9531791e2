"""Penalties of contact pairs: anchors on the master that go with greater ones."""

import numpy as np

from fenics_contact.contact.penalties import Penalties
from fenics_contact.kernels.contact_pairs import stiffened_anchors
from fenics_contact.kernels.status import STICK


class PairPenalties(Penalties):
    """Mixed into DeformableContact."""

    def put_penalties(self, normal, tangential):
        super().put_penalties(normal, tangential)
        self._penalties = tuple(np.repeat(eps, self.shift.shape[1]) for eps in (normal, tangential))

    def swap_anchors(self, anchors):
        old, self._anchors = self._anchors, anchors
        return old

    def hold_friction(self, factor):
        coords, points, normals = self._places
        projection = self._pairing.project(points, normals, coords, self.timers)
        feet = self._new_anchors(coords, projection, -np.inf)[0]
        self._anchors = self._stiffened(coords, projection, feet, factor)

    def rest_anchors(self, state, factor):
        self.evaluate(state)
        coords, _, projection = self._project(state)
        sticks, new = (self.status == STICK).reshape(-1, 1), self._stiffened(coords, projection, self._rests, factor)
        return tuple(np.where(sticks, ours, old) for ours, old in zip(new, self._anchors, strict=True))

    def _stiffened(self, coords, projection, rests, factor):
        new, pairs = self._no_anchors(), (coords, self._slaves, self._facets, projection)
        stiffened_anchors(*pairs, self._anchors, rests, self._law, factor, new)
        return new
