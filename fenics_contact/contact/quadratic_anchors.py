"""From where friction between facets of degree 2 grows: places on these, renewed on flat ones that touch them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.on_facets import own
from fenics_contact.contact.point_anchors import PointAnchors
from fenics_contact.contact.point_places import FacetFeet
from fenics_contact.contact.touching import ANCHOR, MASTER, Touching, images
from fenics_contact.kernels import contact_pairs as flat
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.deformable_element import Pairs
from fenics_contact.types import Anchors, Floats, Ints64

if TYPE_CHECKING:
    from fenics_contact.contact.quadratic import QuadraticPartner


class QuadraticAnchors(PointAnchors):
    """Anchors on facets of degree 2, all of whose m nodes have weights."""

    _partner: QuadraticPartner

    def _kept(self, touching: Touching, old: Anchors, new: Anchors) -> tuple[Ints64, Floats]:
        """Anchors of all points: of the pairs those on the corners of the facets that touch theirs, unless these are the
        old ones; of others the old."""
        (nodes, weights), k, at = (part.copy() for part in old), self._places.nodes.shape[1], touching.at
        renewed = new[0][:, 0] % touching.lift.shape[1] == MASTER
        m, which = nodes.shape[1], at[renewed]
        nodes[which] = touching.nodes[renewed, k : k + m]
        of_corners = touching.lift[renewed, MASTER:ANCHOR, k : k + m]
        given = new[1][renewed][:, :3] + new[1][renewed][:, 3:] * [0.0, 0.0, 1.0]
        weights[which] = np.einsum("qc,qcn->qn", given, of_corners)
        return nodes, weights

    def _committed(self, feet: FacetFeet, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        touching = self._partner.touching(feet, trial, self._partner.paired(feet))
        n = len(touching.at)
        new, slid = (np.full((n, 4), -1), np.empty((n, 4))), np.empty(n)
        flat.committed_anchors(touching.pairs, self._partner.laws_at(feet, trial, touching.at, touch), new, slid)
        lost = (feet.projection[1] == NONE)[:, None]
        (no_nodes, no_weights), (nodes, weights) = self.none(), own(trial.history.anchors)
        old = np.where(lost, no_nodes, nodes), np.where(lost, no_weights, weights)
        sliding = np.zeros(np.prod(self._shape))
        sliding[touching.at] = slid
        return self._kept(touching, old, new), sliding.reshape(self._shape)

    def _from_rest(self, feet: FacetFeet, trial: Trial, rests: Anchors) -> tuple[Touching, Pairs, tuple[Ints64, Floats]]:
        """The pairs with where they came to rest, (nodes, weights) on corners that come behind those of the facets."""
        nodes, weights = own(rests)
        touching = self._partner.touching(feet, trial, np.flatnonzero((feet.projection[1] != NONE) & (nodes[:, 0] >= 0)))
        at, (coords, *others) = touching.at, touching.pairs
        places = np.einsum("qn,qnx->qx", weights[at], feet.coords[nodes[at]])
        rested = images(nodes[at], len(coords) + np.arange(len(at)))
        return touching, (np.concatenate([coords, places]), *others), rested

    def _since(
        self, rests: Anchors, feet: FacetFeet, trial: Trial, grown: tuple[float, float]
    ) -> tuple[tuple[Ints64, Floats], Floats]:
        touching, pairs, rested = self._from_rest(feet, trial, rests)
        laws = self._partner.laws_at(feet, trial, touching.at)
        nodes, weights, gone = flat.anchors_since_rest(pairs, rested, laws, grown)
        ways = np.zeros((np.prod(self._shape), 3))
        ways[touching.at] = gone
        return self._kept(touching, own(trial.history.anchors), (nodes, weights)), ways
