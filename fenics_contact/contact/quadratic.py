"""Facets of degree 2, straight or curved, as a contact's master, in space and in the plane; met by Gauss points."""

from typing import NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.facet_points import ACROSS
from fenics_contact.assembly.term import State
from fenics_contact.contact.facets import FacetFeet, FacetPartner, own, unit
from fenics_contact.contact.pairing import FACING, Seek
from fenics_contact.contact.trial import Response, Trial
from fenics_contact.kernels import contact_pairs as flat
from fenics_contact.kernels.closest_point import INTERIOR, NONE, Lists, Projection
from fenics_contact.kernels.contact_tangent import add_tangents
from fenics_contact.kernels.deformable_element import Pairs, PointLaws
from fenics_contact.kernels.facets import Surface
from fenics_contact.kernels.quadratic import add_lifted, foot_shapes, quadratic_rays
from fenics_contact.kernels.status import OPEN
from fenics_contact.kernels.turning import add_turning_tangents
from fenics_contact.types import Anchors, Floats, Ints, Ints64

# corners of a pair's flat facets: of the slave's, the master's, the anchor; behind them the direction of friction, if any
SLAVE, MASTER, ANCHOR, CORNERS = 0, 3, 6, 7


class Touching(NamedTuple):
    """Flat facets that touch those of the pairs `at` (n,), numbers of slave points: `pairs` and laws as the kernels take
    them; nodes (n, k) of slave facet, master facet and anchor (-1: none), lift (n, corners, k): their parts in the corners,
    CORNERS or one more, a direction; rows: how many of the nodes forces act on."""

    at: Ints64
    pairs: Pairs
    nodes: Ints64
    lift: Floats
    rows: int


class QuadraticPartner(FacetPartner):
    """Gauss points of slave facets of degree 2 against facets of degree 2, which they seek along their own normals.

    A foot lies on the true facet, and its forces go to that one's nodes by their shape functions there: a constant pressure
    gives both sides the loads of their own shape functions. Rates come from the flat facets that touch both sides there, see
    kernels/quadratic.py.
    """

    # -- where the points are -------------------------------------------------------------------------------------
    def _seek(self) -> Seek:
        def seek(
            points: Floats, normals: Floats, coords: Floats, facets: Surface, lists: Lists, search: float, out: Projection
        ) -> None:
            quadratic_rays(points, -self._outward(coords), coords, facets, lists, (search, 0.0, FACING), out)

        return seek

    def _outward(self, coords: Floats) -> Floats:
        """Unit normals (np, 3) out of the slave in its points, the nodes at coords."""
        tangents = np.einsum("qtk,qkc->tqc", self._gradients, coords[self._nodes])
        return unit(np.cross(tangents[0], tangents[1] if len(tangents) > 1 else ACROSS))

    def _touching(self, feet: FacetFeet, trial: Trial, at: Ints64, area: Floats | None = None) -> Touching:
        """The flat facets of the pairs `at`."""
        _, weights, areas, gradients = self._slaves(area)
        facets, (facet, _, _, _, gap, normal) = self._facets[0], feet.projection
        anchor_nodes, anchor_weights = own(trial.history.anchors)
        n, k, m, directed = len(at), weights.shape[1], facets.shape[1], self._directed(trial.law.friction)
        corners = CORNERS + (directed is not None)
        N, lift = np.empty((n, 3, m)), np.zeros((n, corners, k + 2 * m))
        foot_shapes(at, self._facets, feet.projection, N)
        lift[:, SLAVE:MASTER, :k] = weights[at][:, None]
        lift[:, SLAVE + 1 : SLAVE + 1 + gradients.shape[1], :k] += gradients[at]
        lift[:, MASTER:ANCHOR, k : k + m] = N[:, :1]
        lift[:, MASTER + 1 : ANCHOR, k : k + m] += N[:, 1:]
        lift[:, ANCHOR, k + m :] = anchor_weights[at]
        if directed is not None:
            lift[:, CORNERS, k : k + m] = directed.parts[facet[at]]
        nodes = np.column_stack([self._nodes[at], facets[facet[at]], anchor_nodes[at]])
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
        anchors = _images(anchor_nodes[at], numbers[:, ANCHOR])
        pairs: Pairs = coords.reshape(-1, 3), slaves, surface, projection, anchors
        return Touching(at, pairs, nodes, lift, k + m)

    def _paired(self, feet: FacetFeet) -> Ints64:
        return np.flatnonzero(feet.projection[1] != NONE)

    def _pressing(self, feet: FacetFeet, trial: Trial) -> Ints64:
        """Numbers of the points that count as closed."""
        gaps = trial.judged if len(trial.judged) else feet.projection[4] + trial.history.shift.reshape(-1)
        return np.flatnonzero((feet.projection[1] != NONE) & (gaps <= trial.law.touch))

    def _law_at(self, feet: FacetFeet, trial: Trial, at: Ints64, touch: float | None = None) -> PointLaws:
        eps_n, eps_t, friction, touch, shift, judged = self._law(feet, trial, touch)
        if len(friction.directions):
            friction = friction._replace(directions=friction.directions[at])
        return eps_n[at], eps_t[at], friction, touch, shift[at], judged[at] if len(judged) else judged

    # -- forces and tangent ---------------------------------------------------------------------------------------
    def response(self, feet: FacetFeet, trial: Trial) -> Response:
        touching = self._touching(feet, trial, self._pressing(feet, trial), trial.area)
        at, n = touching.at, len(touching.at)
        traction, excess, status = np.empty((n, 3)), np.empty(n), np.empty(n, dtype=np.int32)
        at_corners = np.zeros_like(touching.pairs[0])
        flat.add_forces(*touching.pairs, self._law_at(feet, trial, at), (at_corners, status, traction, excess))
        forces, rows = np.zeros_like(feet.coords), touching.rows
        at_nodes = np.einsum("qcn,qcx->qnx", touching.lift[:, :, :rows], at_corners.reshape(*touching.lift.shape[:2], 3))
        np.add.at(forces, touching.nodes[:, :rows], at_nodes)
        shape = self.surface.area.shape
        every = np.zeros((shape[0] * shape[1], 3)), np.full(shape, OPEN, dtype=np.int32), np.zeros(shape)
        every[0][at], every[1].reshape(-1)[at], every[2].reshape(-1)[at] = traction, status, excess
        gap = np.minimum(feet.projection[4], self.search).reshape(shape)
        return Response(every[0].reshape(*shape, 3), gap, *every[1:], np.ones(shape), forces)

    def tangent(self, feet: FacetFeet, trial: Trial) -> Blocks:
        touching = self._touching(feet, trial, self._pressing(feet, trial), trial.area)
        (n, corners, _), law = touching.lift.shape, self._law_at(feet, trial, touching.at)
        numbers = np.arange(corners * n)
        first = numbers // corners * corners  # each pair's corners are coupled with one another
        columns = (first[:, None] + np.arange(corners)).ravel()
        pattern = numbers, corners * numbers, corners * (numbers + 1), columns
        out = np.zeros((len(columns), 3, 3)), np.zeros(len(columns), dtype=bool)
        add_tangents(*touching.pairs, law, pattern, out)
        if corners > CORNERS:
            parts = numbers.reshape(n, corners)[:, CORNERS:], np.ones((n, 1))
            add_turning_tangents(*touching.pairs, law, parts, (*pattern, *out))
        matrices = out[0].reshape(n, corners, corners, 3, 3)
        lifted = matrices, touching.lift, touching.nodes, touching.rows
        rows, others, values, missing = self._pattern.filled(lambda *out: add_lifted(*lifted, *out))
        if missing:
            raise RuntimeError(f"contact with '{self.name}': {missing} couplings are not in the pattern")
        return Blocks(pairs=(rows, others, values), at=feet)

    def foreseen(self, feet: FacetFeet, before: FacetFeet, trial: Trial) -> Floats:
        """Gaps (np,) that the tangent at the places `before` foresees at these, shifts added."""
        touching, gaps = self._touching(before, trial, self._paired(before)), before.projection[4].copy()
        moved = np.einsum("qcn,qnx->qcx", touching.lift, (feet.coords - before.coords)[touching.nodes]).reshape(-1, 3)
        found = np.empty(len(touching.at))
        flat.foreseen_gaps(*touching.pairs, moved, found)
        gaps[touching.at] = found
        return np.where(np.isfinite(gaps), gaps, feet.projection[4]) + trial.history.shift.reshape(-1)

    # -- anchors --------------------------------------------------------------------------------------------------
    def _kept(self, touching: Touching, old: Anchors, new: Anchors) -> Anchors:
        """Anchors of all points: of the pairs those on the corners of the facets that touch theirs, unless these are the
        old ones; of others the old."""
        (nodes, weights), k, at = (part.copy() for part in old), self._nodes.shape[1], touching.at
        renewed = new[0][:, 0] % touching.lift.shape[1] == MASTER
        m, which = nodes.shape[1], at[renewed]
        nodes[which] = touching.nodes[renewed, k : k + m]
        of_corners = touching.lift[renewed, MASTER:ANCHOR, k : k + m]
        given = new[1][renewed][:, :3] + new[1][renewed][:, 3:] * [0.0, 0.0, 1.0]
        weights[which] = np.einsum("qc,qcn->qn", given, of_corners)
        return nodes, weights

    def _committed(self, feet: FacetFeet, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        touching = self._touching(feet, trial, self._paired(feet))
        n = len(touching.at)
        new, slid = (np.full((n, 4), -1), np.empty((n, 4))), np.empty(n)
        flat.committed_anchors(*touching.pairs, self._law_at(feet, trial, touching.at, touch), new, slid)
        lost = (feet.projection[1] == NONE)[:, None]
        (no_nodes, no_weights), (nodes, weights) = self.no_anchors(), own(trial.history.anchors)
        old = np.where(lost, no_nodes, nodes), np.where(lost, no_weights, weights)
        sliding = np.zeros(self.surface.area.size)
        sliding[touching.at] = slid
        return self._kept(touching, old, new), sliding.reshape(self.surface.area.shape)

    def _from_rest(self, feet: FacetFeet, trial: Trial, rests: Anchors) -> tuple[Touching, Pairs, tuple[Ints64, Floats]]:
        """The pairs with where they came to rest, (nodes, weights) on corners that come behind those of the facets."""
        nodes, weights = own(rests)
        touching = self._touching(feet, trial, np.flatnonzero((feet.projection[1] != NONE) & (nodes[:, 0] >= 0)))
        at, (coords, *others) = touching.at, touching.pairs
        places = np.einsum("qn,qnx->qx", weights[at], feet.coords[nodes[at]])
        images = _images(nodes[at], len(coords) + np.arange(len(at)))
        return touching, (np.concatenate([coords, places]), *others), images

    def _augmented(self, feet: FacetFeet, trial: Trial, share: float = 1.0) -> tuple[Anchors, Floats]:
        touching, pairs, rested = self._from_rest(feet, trial, trial.history.rests)
        nodes, weights, slipped = flat.augmented_anchors(*pairs, rested, self._law_at(feet, trial, touching.at), share)
        slips = np.zeros(self.surface.area.size)
        slips[touching.at] = slipped
        return self._kept(touching, own(trial.history.anchors), (nodes, weights)), slips.reshape(self.surface.area.shape)

    def stiffened(self, feet: FacetFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for points that slip on from rest as they do."""
        touching, pairs, rested = self._from_rest(feet, trial, rests)
        new = flat.stiffened_anchors(*pairs, rested, self._law_at(feet, trial, touching.at), factor)
        return self._kept(touching, own(trial.history.anchors), new)

    # -- what else is asked of a master ---------------------------------------------------------------------------
    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which this rank's slave points look for the master: their normals. Collective."""
        return self._outward(self.feet(state).coords).reshape((*self.surface.area.shape, 3))

    def node_gaps(self, state: State, nodes: Ints, X: Floats) -> Floats:
        """Gaps (n,) of slave nodes along the mean normals around them, endless without a partner. Collective."""
        coords = self.feet(state).coords
        normal, _, weights = compat.Function(state.u.function_space), *self._slaves()[:2]
        sums, local = normal.x.array.reshape(-1, 3), self._local[self._nodes]
        # squares: on quadratic triangles a corner's shape function has no area
        np.add.at(sums, local, weights[..., None] ** 2 * self._outward(coords)[:, None])
        compat.sum_to_owners(normal)
        compat.copy_to_ghosts(normal)
        places = coords[np.searchsorted(self._local, nodes)]
        n = len(nodes)
        facet, kind, feature = (np.empty(n, dtype=np.int64) for _ in range(3))
        found = facet, kind, feature, np.empty((n, 2)), np.empty(n), np.empty((n, 3))
        lists = self._pairing.within(places, coords, self.search)
        quadratic_rays(places, -unit(sums[nodes]), coords, self._facets, lists, (self.search, 0.0, FACING), found)
        return found[4]


def _images(nodes: Ints64, numbers: Ints64) -> tuple[Ints64, Floats]:
    """Anchors (nodes (n, 4), weights (n, 4)) of one point each, with these numbers (n,); none where nodes (n, m) are."""
    at = np.where(nodes[:, :1] < 0, -1, np.tile(numbers[:, None], (1, 4)))
    return np.ascontiguousarray(at), np.tile([1.0, 0.0, 0.0, 0.0], (len(nodes), 1))
