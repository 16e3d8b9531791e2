"""Facets of degree 2, straight or curved, as a contact's master, in space and in the plane; met by Gauss points."""

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.facet_points import ACROSS
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.facets import FacetPartner
from fenics_contact.contact.master import motion
from fenics_contact.contact.on_facets import own
from fenics_contact.contact.point_places import FacetFeet
from fenics_contact.contact.quadratic_anchors import QuadraticAnchors
from fenics_contact.contact.quadratic_places import QuadraticPlaces
from fenics_contact.contact.touching import ANCHOR, CORNERS, MASTER, SLAVE, Touching, images
from fenics_contact.kernels import contact_pairs as flat
from fenics_contact.kernels.closest_point import INTERIOR, NONE
from fenics_contact.kernels.contact_tangent import add_tangents
from fenics_contact.kernels.deformable_element import Pairs, PointLaws
from fenics_contact.kernels.quadratic import add_lifted, foot_shapes
from fenics_contact.kernels.status import OPEN
from fenics_contact.kernels.turning import add_turning_tangents
from fenics_contact.types import Floats, Ints64


class QuadraticPartner(FacetPartner):
    """Gauss points of slave facets of degree 2 against facets of degree 2, which they seek along their own normals.

    A foot lies on the true facet, and its forces go to that one's nodes by their shape functions there: a constant pressure
    gives both sides the loads of their own shape functions. Rates come from the flat facets that touch both sides there, see
    kernels/quadratic.py.
    """

    def __init__(self, name: str, places: QuadraticPlaces) -> None:
        super().__init__(name, places)
        self.anchors = QuadraticAnchors(self)

    def touching(self, feet: FacetFeet, trial: Trial, at: Ints64, area: Floats | None = None) -> Touching:
        """The flat facets of the pairs `at`."""
        _, weights, areas, gradients = self.slaves(area)
        facets, (facet, _, _, _, gap, normal) = self.places.facets[0], feet.projection
        anchor_nodes, anchor_weights = own(trial.history.anchors)
        n, k, m, directed = len(at), weights.shape[1], facets.shape[1], self.places.directed(trial.law.friction)
        corners = CORNERS + (directed is not None)
        N, lift = np.empty((n, 3, m)), np.zeros((n, corners, k + 2 * m))
        foot_shapes(at, self.places.facets, feet.projection, N)
        lift[:, SLAVE:MASTER, :k] = weights[at][:, None]
        lift[:, SLAVE + 1 : SLAVE + 1 + gradients.shape[1], :k] += gradients[at]
        lift[:, MASTER:ANCHOR, k : k + m] = N[:, :1]
        lift[:, MASTER + 1 : ANCHOR, k : k + m] += N[:, 1:]
        lift[:, ANCHOR, k + m :] = anchor_weights[at]
        if directed is not None:
            lift[:, CORNERS, k : k + m] = directed.parts[facet[at]]
        nodes = np.column_stack([self.places.nodes[at], facets[facet[at]], anchor_nodes[at]])
        coords = np.einsum("qcn,qnx->qcx", lift, feet.coords[nodes])
        if gradients.shape[1] == 1:  # sides of a plane mesh go on along z
            coords[:, [SLAVE + 2, MASTER + 2]] += ACROSS
        numbers = np.arange(corners * n).reshape(n, corners)
        slaves = (
            np.ascontiguousarray(numbers[:, SLAVE:MASTER]),
            np.tile([1.0, 0.0, 0.0], (n, 1)),
            areas[at],
            np.tile([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (n, 1, 1)),
        )
        surface = np.ascontiguousarray(numbers[:, [MASTER, MASTER + 1, MASTER + 2, MASTER + 2]]), np.full(n, 3)
        projection = np.arange(n), np.full(n, INTERIOR), np.full(n, -1), np.zeros((n, 2)), gap[at], normal[at]
        anchors = images(anchor_nodes[at], numbers[:, ANCHOR])
        pairs: Pairs = coords.reshape(-1, 3), slaves, surface, projection, anchors
        return Touching(at, pairs, nodes, lift, k + m)

    def paired(self, feet: FacetFeet) -> Ints64:
        """Numbers of the points that have a partner."""
        return np.flatnonzero(feet.projection[1] != NONE)

    def _pressing(self, feet: FacetFeet, trial: Trial) -> Ints64:
        """Numbers of the points that count as closed."""
        gaps = trial.judged if len(trial.judged) else feet.projection[4] + trial.history.shift.reshape(-1)
        return np.flatnonzero((feet.projection[1] != NONE) & (gaps <= trial.law.touch))

    def laws_at(self, feet: FacetFeet, trial: Trial, at: Ints64, touch: float | None = None) -> PointLaws:
        """Laws of the points `at`, see `laws`."""
        eps_n, eps_t, friction, touch, shift, judged = self.laws(feet, trial, touch)
        if len(friction.directions):
            friction = friction._replace(directions=friction.directions[at])
        return eps_n[at], eps_t[at], friction, touch, shift[at], judged[at] if len(judged) else judged

    def response(self, feet: FacetFeet, trial: Trial) -> Response:
        touching = self.touching(feet, trial, self._pressing(feet, trial), trial.area)
        at, n = touching.at, len(touching.at)
        traction, status = np.empty((n, 3)), np.empty(n, dtype=np.int32)
        at_corners = np.zeros_like(touching.pairs[0])
        flat.add_forces(touching.pairs, self.laws_at(feet, trial, at), (at_corners, status, traction))
        forces, rows = np.zeros_like(feet.coords), touching.rows
        at_nodes = np.einsum("qcn,qcx->qnx", touching.lift[:, :, :rows], at_corners.reshape(*touching.lift.shape[:2], 3))
        np.add.at(forces, touching.nodes[:, :rows], at_nodes)
        shape = self.surface.area.shape
        tractions, statuses = np.zeros((shape[0] * shape[1], 3)), np.full(shape, OPEN, dtype=np.int32)
        tractions[at], statuses.reshape(-1)[at] = traction, status
        gap = np.minimum(feet.projection[4], self.places.search).reshape(shape)
        return Response(tractions.reshape(*shape, 3), gap, statuses, np.ones(shape), forces)

    def tangent(self, feet: FacetFeet, trial: Trial) -> Blocks:
        touching = self.touching(feet, trial, self._pressing(feet, trial), trial.area)
        (n, corners, _), law = touching.lift.shape, self.laws_at(feet, trial, touching.at)
        numbers = np.arange(corners * n)
        first = numbers // corners * corners  # each pair's corners are coupled with one another
        columns = (first[:, None] + np.arange(corners)).ravel()
        pattern = numbers, corners * numbers, corners * (numbers + 1), columns
        out = np.zeros((len(columns), 3, 3)), np.zeros(len(columns), dtype=bool)
        add_tangents(touching.pairs, law, pattern, out)
        if corners > CORNERS:
            parts = numbers.reshape(n, corners)[:, CORNERS:], np.ones((n, 1))
            add_turning_tangents(touching.pairs, law, parts, (*pattern, *out))
        matrices = out[0].reshape(n, corners, corners, 3, 3)
        lifted = matrices, touching.lift, touching.nodes, touching.rows
        rows, others, values, missing = self._pattern.filled(lambda *out: add_lifted(*lifted, *out))
        if missing:
            raise RuntimeError(f"contact with '{self.name}': {missing} couplings are not in the pattern")
        return Blocks(pairs=(rows, others, values), at=feet)

    def foreseen(self, feet: FacetFeet, before: FacetFeet, trial: Trial) -> Floats:
        """Gaps (np,) that the tangent at the places `before` foresees at these, shifts added."""
        touching, gaps = self.touching(before, trial, self.paired(before)), before.projection[4].copy()
        moved = np.einsum("qcn,qnx->qcx", touching.lift, motion(before, feet, self.places.first)[touching.nodes]).reshape(
            -1, 3
        )
        found = np.empty(len(touching.at))
        flat.foreseen_gaps(touching.pairs, moved, found)
        gaps[touching.at] = found
        return np.where(np.isfinite(gaps), gaps, feet.projection[4]) + trial.history.shift.reshape(-1)
