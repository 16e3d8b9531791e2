"""Facets of another body as a contact's master, met by points: forces and their tangent."""

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.friction import Friction, turned
from fenics_contact.contact.master import motion
from fenics_contact.contact.on_facets import MARGIN, OnFacets, own
from fenics_contact.contact.pair_pattern import PairPattern
from fenics_contact.contact.point_anchors import PointAnchors
from fenics_contact.contact.point_places import FacetFeet, PointPlaces
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.contact_pairs import add_forces, foreseen_gaps
from fenics_contact.kernels.contact_tangent import add_tangents
from fenics_contact.kernels.couplings import Pattern
from fenics_contact.kernels.deformable_element import Pairs, PointLaws, Slaves
from fenics_contact.kernels.turning import add_turning_tangents
from fenics_contact.types import Bools, Floats, Ints64


class FacetPartner(OnFacets):
    """Slave points against the facets of another body.

    Points of slave facets, Gauss points or corners, seek the master along their own facet's normal, which stays continuous
    over the master's edges; slave nodes without a facet seek the closest point on the master and its normal (the paper).
    Each rank evaluates its slave points against the whole master, whose forces are summed over its nodes. Methods that take
    feet are collective.
    """

    settles = foretells = False
    places: PointPlaces

    def __init__(self, name: str, places: PointPlaces) -> None:
        super().__init__(name, places)
        self.smooth = self.surface.gradients is None  # along the slave's normal even frictionless forces have no potential
        self.anchors = PointAnchors(self)
        self._pattern = self._new_pattern()

    def _new_pattern(self) -> PairPattern:
        where, space = self.places, self.places.space
        blocks = np.concatenate([compat.global_blocks(space)[where.slave], where.master.blocks]).astype(np.int64)
        return PairPattern(where.nodes, where.facets[0], blocks, space.dofmap.index_map.size_global)

    def resampled(self, trial: Trial, feet: FacetFeet) -> Trial:
        """With anchors of points that have come over the master since the last step."""
        h = trial.history
        come = trial.rough and bool(((h.feet.projection[1] == NONE) & (feet.projection[1] != NONE)).any())
        if not self.places.comm.allreduce(come, op=MPI.LOR):
            return trial
        return trial.remembering(anchors=self.anchors.coming(h.feet, feet, h.anchors))

    def slaves(self, area: Floats | None = None) -> Slaves:
        """Slaves as kernels/deformable_element.py takes them."""
        s = self.surface
        weights = s.a.reshape(-1, s.a.shape[2])
        return self.places.nodes, weights, (s.area if area is None else area).reshape(-1), self.places.gradients

    def laws(self, feet: FacetFeet, trial: Trial, touch: float | None = None) -> PointLaws:
        """Laws of the points as kernels/deformable_element.py takes them; touch [length]: in the place of the law's own."""
        law, nq = trial.law, self.surface.area.shape[1]
        penalties = np.repeat(law.eps_n, nq), np.repeat(law.eps_t, nq)
        touch = float(law.touch if touch is None else touch)
        return *penalties, self.friction(feet, trial), touch, trial.history.shift.reshape(-1), trial.judged

    def friction(self, feet: FacetFeet, trial: Trial) -> Friction:
        """The law of friction at these feet, with what directions it has there."""
        law, (nodes, parts) = turned(trial.law.friction, feet.pose), self._directions(feet, trial)
        return law._replace(directions=np.einsum("qi,qic->qc", parts, feet.coords[nodes])) if len(parts) else law

    def _directions(self, feet: FacetFeet, trial: Trial) -> tuple[Ints64, Floats]:
        """Nodes (np, m) of the points' directions of friction and their parts in them; (0, m): one holds for all."""
        if (directed := self.places.directed(trial.law.friction)) is None:
            return self.places.facets[0][:0], np.empty((0, self.places.facets[0].shape[1]))
        leading = directed.leading(feet.projection)
        return self.places.facets[0][leading], directed.parts[leading]

    def pairs(self, feet: FacetFeet, trial: Trial, area: Floats | None = None) -> Pairs:
        """What the kernels take of the pairs of points and facets."""
        return feet.coords, self.slaves(area), self.places.facets, feet.projection, own(trial.history.anchors)

    def response(self, feet: FacetFeet, trial: Trial) -> Response:
        forces, (ne, nq) = np.zeros_like(feet.coords), self.surface.area.shape
        traction, status = np.empty((ne * nq, 3)), np.empty(ne * nq, dtype=np.int32)
        add_forces(self.pairs(feet, trial, trial.area), self.laws(feet, trial), (forces, status, traction))
        gap, points = np.minimum(feet.projection[4], self.places.search), (ne, nq)
        return Response(traction.reshape(ne, nq, 3), gap.reshape(points), status.reshape(points), np.ones(points), forces)

    def add_forces(self, feet: FacetFeet, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to the slave nodes' forces and its opposite to the master's, (14)."""
        residual.reshape(-1, 3)[self.places.slave] += response.forces[: self.places.first]
        self.places.master.react(feet, response.forces, residual, tool_residual)

    def tangent(self, feet: FacetFeet, trial: Trial) -> Blocks:
        return Blocks(pairs=self._tangent(feet, trial), at=feet)

    def _tangent(self, feet: FacetFeet, trial: Trial) -> tuple[Ints64, Ints64, Floats]:
        """Rows (n,), rising, columns (n,) and blocks (n, 3, 3) of the tangent: each pair of nodes once."""
        pairs, parts = (self.pairs(feet, trial, trial.area), self.laws(feet, trial)), self._directions(feet, trial)

        def add(pattern: Pattern, out: tuple[Floats, Bools]) -> int:
            missing = add_tangents(*pairs, pattern, out)
            return missing + (add_turning_tangents(*pairs, parts, (*pattern, *out)) if len(parts[1]) else 0)

        rows, columns, blocks, missing = self._pattern.filled(add)
        if missing:
            raise RuntimeError(f"contact with '{self.name}': {missing} couplings are not in the pattern")
        return rows, columns, blocks

    def couplings(self, feet: FacetFeet, trial: Trial) -> Ints64 | None:
        """None while all closed pairs lie in the pattern asked for last; else keys row * N + column of a new one.

        Provided for: each slave point near the master with all facets that it may reach within MARGIN of their edges.
        """
        facet, kind, gap, anchor_nodes = feet.projection[0], feet.projection[1], feet.projection[4], trial.history.anchors[0]
        gaps = trial.judged if len(trial.judged) else gap + trial.history.shift.reshape(-1)
        now = (gaps <= 2.0 * trial.law.touch) & (kind != NONE), facet, anchor_nodes
        if self._pattern.suffices(*now):
            return None
        with self.timers("search"):
            near = self.places.pairing.within(feet.points, feet.coords, MARGIN * self.places.master.edge)
        self._pattern.provide(*near, *now)
        return self._pattern.keys

    def foreseen(self, feet: FacetFeet, before: FacetFeet, trial: Trial) -> Floats:
        """Gaps (np,) that the tangent at the places `before` foresees at these, shifts added."""
        gaps = np.empty(len(before.projection[4]))
        foreseen_gaps(self.pairs(before, trial), motion(before, feet, self.places.first), gaps)
        return np.where(np.isfinite(gaps), gaps, feet.projection[4]) + trial.history.shift.reshape(-1)
