"""From where friction between facets grows: for each slave point a place on the master, that of a foot long past."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.on_facets import own
from fenics_contact.contact.partner import SingleAnchors, slid_since
from fenics_contact.contact.point_places import FacetFeet
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.contact_pairs import anchors_since_rest, committed_anchors
from fenics_contact.kernels.quadratic import foot_shapes
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.types import Anchors, Array, Floats, Ints, Ints64

if TYPE_CHECKING:
    from fenics_contact.contact.facets import FacetPartner


class PointAnchors(SingleAnchors):
    """(nodes (np, m), weights (np, m)): numbers among the coordinates, -1: none."""

    def __init__(self, partner: FacetPartner) -> None:
        self._partner, self._places, self._shape = partner, partner.places, partner.surface.area.shape

    def none(self) -> tuple[Ints64, Floats]:
        shape = int(np.prod(self._shape)), self._places.facets[0].shape[1]
        return np.full(shape, -1, dtype=np.int64), np.zeros(shape)

    def _committed(self, feet: FacetFeet, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        new, sliding = self.none(), np.empty(np.prod(self._shape))
        committed_anchors(self._partner.pairs(feet, trial), self._partner.laws(feet, trial, touch), new, sliding)
        return new, sliding.reshape(self._shape)

    def slips(self, feet: FacetFeet, trial: Trial, status: Ints) -> Floats:
        """See `Anchoring.slips`."""
        ways = self._since(trial.history.rests, feet, trial, (1.0, 1.0))[1]
        return np.where(status >= STICK, ways[:, 2].reshape(self._shape), 0.0)

    def slid(self, feet: FacetFeet, trial: Trial, status: Ints) -> tuple[Floats, Floats]:
        """See `Anchoring.slid`."""
        ways = self._since(trial.history.rests, feet, trial, (1.0, 1.0))[1]
        way, worked, _ = ways.T.reshape(3, *self._shape)
        return np.where(status == SLIP, way, 0.0), np.where(status == OPEN, way, np.where(status == SLIP, worked, 0.0))

    def augmented(self, feet: FacetFeet, trial: Trial, status: Ints, share: float) -> Anchors:
        """See `Anchoring.augmented`."""
        return self._since(trial.history.rests, feet, trial, (share, 1.0))[0]

    def stiffened(self, feet: FacetFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for points that slip on from rest as they do."""
        return self._since(rests, feet, trial, (factor - 1.0, factor))[0]

    def _since(
        self, rests: Anchors, feet: FacetFeet, trial: Trial, grown: tuple[float, float]
    ) -> tuple[tuple[Ints64, Floats], Floats]:
        """Anchors and ways (np, 3) since points came to rest, see `anchors_since_rest`."""
        pairs, laws = self._partner.pairs(feet, trial), self._partner.laws(feet, trial)
        nodes, weights, ways = anchors_since_rest(pairs, own(rests), laws, grown)
        return (nodes, weights), ways

    def coming(self, then: FacetFeet, now: FacetFeet, anchors: Anchors) -> Anchors:
        """Anchors that points which have met the master since then have, too: what lies under them now, where it was from
        them then, or when they touched it."""
        at = np.flatnonzero((then.projection[1] == NONE) & (now.projection[1] != NONE))
        N, nodes = np.empty((len(at), 3, self._places.facets[0].shape[1])), self._places.facets[0][now.projection[0][at]]
        foot_shapes(at, self._places.facets, now.projection, N)
        tangents = np.einsum("nai,nic->nac", N[:, 1:], now.coords[nodes])
        parts = np.einsum("nca,nc->na", np.linalg.pinv(tangents), slid_since(then, now, at, (nodes, N[:, 0])))
        out = own(anchors)[0].copy(), own(anchors)[1].copy()
        out[0][at], out[1][at] = nodes, N[:, 0] - np.einsum("na,nai->ni", parts, N[:, 1:])
        return out

    def packed(self, anchors: Anchors, feet: FacetFeet, name: str) -> dict[str, Array]:
        """Anchors as keys of the master's nodes (-1: none) and their weights, arrays (ne, ...) that no partition changes."""
        (nodes, weights), shape = anchors, (*self._shape, anchors[0].shape[1])
        return {name: self._places.keys_of(nodes).reshape(shape), f"{name}_weight": weights.reshape(shape)}

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        keys = values[name].reshape(-1, self._places.facets[0].shape[1])
        return self._places.of_keys(keys), np.ascontiguousarray(values[f"{name}_weight"].reshape(keys.shape))
