"""Another body's facets as a contact's master, met with one pressure per slave node: means over the samples around it."""

from collections.abc import Callable

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.term import State
from fenics_contact.contact.facets import MARGIN, OnFacets, own, unit
from fenics_contact.contact.friction import Friction, turned
from fenics_contact.contact.lost import FIRST_SEARCH, deepest_lost
from fenics_contact.contact.master import MasterSurface, ToolSurface, area_vectors
from fenics_contact.contact.meeting import Linearised, MortarFeet, Sights
from fenics_contact.contact.node_pattern import NodePattern
from fenics_contact.contact.pairing import Watch
from fenics_contact.contact.samples import CREASE, Samples, samples_for
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.trial import Response, Trial
from fenics_contact.kernels import mortar as kernel
from fenics_contact.kernels.closest_point import NONE, Projection
from fenics_contact.kernels.couplings import Pattern
from fenics_contact.kernels.coverage import Ends, coverage, surface_ends
from fenics_contact.kernels.mortar_rates import add_node_tangents, foreseen_averages
from fenics_contact.kernels.mortar_tangent import add_held_tangents
from fenics_contact.kernels.quadratic import foot_shapes
from fenics_contact.kernels.status import SLIP, STICK
from fenics_contact.timing import Timers
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints, Ints64

SEARCH = 2.0  # times a cell or facet: iterates go far, and a sample that loses its foot loses its node's pressure
FLAT = 1e-12  # of the tangential directions: what normals may differ by and count as one


class MortarPartner(OnFacets):
    """Slave nodes against the facets of another body, through samples of the facets around them.

    surface: SlaveSurface of nodes; skin: all facets of the slave; master: those of the master. Each process evaluates all
    samples around its own nodes against the whole master, and so needs nothing of the others; forces go back by sums over
    the surfaces' nodes. Methods that take a state are collective.
    """

    settles = True
    smooth = False

    def __init__(
        self, name: str, surface: SlaveSurface, skin: MasterSurface, master: MasterSurface | ToolSurface, timers: Timers
    ) -> None:
        self.name, self.surface, self.skin, self.master, self.timers = name, surface, skin, master, timers
        self.search = SEARCH * max(surface.cell_height, master.longest)
        self.reach = float(np.abs(master.X).max(initial=0.0))
        each = 2 if skin.whole else 1  # one facet of degree 2 is as two of degree 1
        self.samples = Samples(skin, each * samples_for(skin.edge, master.edge))
        self._first = len(skin.X)
        self._facets = master.facets[0] + self._first, master.facets[1]
        self._pattern = self._new_pattern()
        self._comm = skin.comm
        self._corners = master.corners[0] + self._first, master.corners[1]
        normals = unit(area_vectors(master.X[master.corners[0]]))
        starts, edges, sides = surface_ends(master.corners, normals, np.cos(np.radians(CREASE)))
        self._ends: Ends = starts, edges + self._first, sides
        watched = np.unique(np.concatenate([skin.owned, master.owned]))  # what positions rest on
        self._watch = Watch(self._comm, watched)
        self.sights = Sights(self._facets, self._corners, self.search, MARGIN * master.edge)
        self._feet: MortarFeet | None = None
        self._last: tuple[MortarFeet, Anchors, kernel.Averaged] | None = None  # feet, anchors and averages asked for last

    def _new_pattern(self) -> NodePattern:
        blocks = np.concatenate([self.skin.blocks, self.master.blocks]).astype(np.int64)
        return NodePattern(self.samples, self._facets[0], blocks, self.skin.size)

    # -- where the samples are ------------------------------------------------------------------------------------
    def _feet_at(self, state: State, project: Callable[[Floats, Floats, Floats], Projection]) -> MortarFeet:
        """Where the samples are and what project(points, normals, coords) gives for them. Collective."""
        coords = np.concatenate([self.skin.positions(state), self.master.positions(state)])
        normals, turns = self.samples.normals(coords)
        n = self.samples.count
        points, directions, lengths = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
        kernel.sample_places(coords, self.samples.slaves, normals, points, directions, lengths)
        met = self._covered(points, coords, project(points, -directions, coords))
        return MortarFeet(coords, points, lengths, turns, met, self.master.pose(state))

    def _covered(self, points: Floats, coords: Floats, projection: Projection) -> kernel.Met:
        """The projection without what lies off the master, and how much of each sample lies over it."""
        n, s = len(points), self.samples
        cover = np.empty(n), np.empty((n, 4), dtype=np.int64), np.empty((n, 5, 3))
        N = np.empty((n, 3, self._facets[0].shape[1]))
        foot_shapes(np.arange(n), self._facets, projection, N)
        sight = self.sights.held or (projection[5], coords)
        coverage(coords, s.corners, s.rim, points, (self._corners, self._ends), sight, projection, cover)
        return *projection, *cover, N

    def feet(self, state: State) -> MortarFeet:
        """The places at a state; the same object while these do not change on any rank. Collective."""
        moved, feet = self._watch.moved(state), self._feet
        if moved or feet is None:
            with self.timers("projection"):
                feet = self._feet = self._feet_at(
                    state, lambda x, n, coords: self.sights.pairing.project(x, n, coords, self.timers)
                )
        return feet

    def first_feet(self, state: State) -> MortarFeet:
        """The places of the first search, which looks farther. Collective."""
        search = FIRST_SEARCH * self.search
        return self._feet_at(state, lambda x, n, coords: self.sights.pairing.far(x, n, coords, search))

    def far(self, feet: MortarFeet, search: float) -> Projection:
        """Projection from the same places with another search distance."""
        found = self.sights.pairing.far(feet.points, -feet.projection[5], feet.coords, search)
        return self._covered(feet.points, feet.coords, found)[:6]

    # -- forces and tangent ---------------------------------------------------------------------------------------
    def _averages(self, feet: MortarFeet, anchors: Anchors) -> kernel.Averaged:
        return kernel.averages(feet.coords, self.samples.slaves, self._facets, feet.met, own(anchors))

    def _averaged(self, feet: MortarFeet, anchors: Anchors) -> kernel.Averaged:
        """What the slave nodes have on average; residual, couplings, tangent and what is foreseen ask for the same."""
        last = self._last
        if last is None or last[0] is not feet or last[1] is not anchors:
            last = self._last = feet, anchors, self._averages(feet, anchors)
        return last[2]

    def _law(self, trial: Trial, friction: Friction) -> kernel.NodeLaws:
        law, shift = trial.law, trial.history.shift.ravel()
        judged, body = trial.judged.reshape(-1, 4), self.surface.stiffness
        return law.eps_n, law.eps_t, friction, float(law.touch), shift, judged, body

    def friction(self, feet: MortarFeet, trial: Trial) -> Friction:
        """The law of friction at these feet, with what directions it has there: sums over the samples around each node."""
        law, (parts, facet) = turned(trial.law.friction, feet.pose), self._leading(feet, trial.law.friction)
        if not len(parts):
            return law
        at_samples = np.einsum("qi,qic->qc", parts[facet], feet.coords[self._facets[0][facet]])
        share = np.where(self._seated(feet), self.samples.share, 0.0)
        return law._replace(directions=np.einsum("nj,njc->nc", share, at_samples[self.samples.table]))

    def _leading(self, feet: MortarFeet, friction: Friction) -> tuple[Floats, Ints64]:
        """Parts (nf, m) of nodes in their facets' directions of friction, and the samples' facets (nq,) that hold there."""
        directed = self._directed(friction)
        if directed is None:
            return np.empty((0, self._facets[0].shape[1])), feet.projection[0]
        return directed.parts, directed.leading(feet.projection)

    def _share(self, trial: Trial) -> Floats:
        return (trial.area / self.surface.area).ravel()

    def _turned(self, feet: MortarFeet) -> tuple[Ints64, Ints64, Floats, Floats]:
        return self.samples.groups[3], self.samples.groups[4], feet.turns, feet.lengths

    def _tractions(self, feet: MortarFeet, trial: Trial) -> tuple[kernel.Averaged, Ints, Floats, Floats, Floats, Floats]:
        """Averages, and status, N, T_T, T_T^tr, excess of the slave nodes."""
        averaged = self._averaged(feet, trial.history.anchors)
        return averaged, *kernel.node_tractions(self._law(trial, self.friction(feet, trial)), averaged, self._share(trial))

    def response(self, feet: MortarFeet, trial: Trial) -> Response:
        averaged, status, N, T, _, excess = self._tractions(feet, trial)
        forces, sums, s, area = np.zeros_like(feet.coords), np.zeros((len(N), 7)), self.samples, self.surface.area
        kernel.add_node_forces(s.slaves, self._facets, feet.met, (N, T, s.number), forces, sums)
        gap = np.minimum(averaged[0], self.search)[:, None]
        cover = self._softened(averaged, trial)[:, None]
        traction, split = (sums[:, :3] / area)[:, None], (-sums[:, 3:4] / area, (-sums[:, 4:] / area)[:, None])
        return Response(traction, gap, status[:, None], excess[:, None], cover, forces, split)

    def _softened(self, averaged: kernel.Averaged, trial: Trial) -> Floats:
        """Penalties of the nodes (ns,) over those of nodes that are covered whole."""
        part = np.empty(len(averaged[0]))
        kernel.softening(self._law(trial, trial.law.friction), averaged, part)  # in which no direction has a part
        return part

    def add_forces(self, feet: MortarFeet, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to the slave nodes' forces and its opposite to the master's, (14)."""
        self.skin.add_forces(response.forces[: self._first], residual)
        self.master.react(feet, response.forces, residual, tool_residual)

    def on_slave(self, feet: MortarFeet, response: Response) -> tuple[Floats, Floats]:
        """Places of all slave nodes and this rank's forces (n, 3) at them."""
        return feet.coords[: self._first], -response.forces[: self._first]

    def _stick(self, averaged: kernel.Averaged, trial: Trial) -> Floats:
        """Penalties (ns, 1) of the nodes' slip [pressure/length]; without a foot there is no slip."""
        part = self._softened(averaged, trial)
        return (trial.law.eps_t * np.where(part > 0.0, part, 1.0))[:, None]

    def tangent(self, feet: MortarFeet, trial: Trial) -> Blocks:
        rows, columns, blocks, at = self._tangent(feet, trial)
        return Blocks(pairs=(rows, columns, blocks), at=at)

    def _tangent(self, feet: MortarFeet, trial: Trial) -> tuple[Ints64, Ints64, Floats, Linearised]:
        """Rows (n,), rising, columns (n,) and blocks (n, 3, 3) of the tangent, each pair once, and what it knew."""
        averaged, _, N, T, _, _ = self._tractions(feet, trial)
        law = self._law(trial, self.friction(feet, trial))
        rates, pressed, rubbed = kernel.node_rates(law, averaged, self._share(trial))
        s, swung, anchors = self.samples, self._turned(feet), own(trial.history.anchors)
        where = feet.coords, s.slaves, self._facets, feet.met
        directed = self._leading(feet, trial.law.friction)

        def add(pattern: Pattern, out: tuple[Floats, Bools]) -> int:
            missing = add_held_tangents(*where, swung, (pressed, rubbed, s.number), (*pattern, *out))
            return missing + add_node_tangents(*where, anchors, swung, (rates, *averaged, *directed), (*pattern, *out))

        rows, columns, blocks, missing = self._pattern.filled(add)
        if missing:
            raise RuntimeError(f"contact with '{self.name}': {missing} couplings are not in the pattern")
        return rows, columns, blocks, Linearised(feet, N, T, rates)

    def couplings(self, feet: MortarFeet, trial: Trial) -> Ints64 | None:
        """None while all closed nodes lie in the pattern asked for last; else keys row * N + column of a new one."""
        averaged = self._averaged(feet, trial.history.anchors)
        gaps = averaged[0] + trial.history.shift.ravel()
        gaps = np.minimum(gaps, trial.judged.reshape(-1, 4)[:, 0]) if len(trial.judged) else gaps
        closed = np.isfinite(averaged[0]) & (gaps <= 2.0 * trial.law.touch)
        facet, anchor_nodes, ends = feet.projection[0], own(trial.history.anchors)[0], feet.met[7]
        if self._pattern.suffices(closed, facet, anchor_nodes, ends):
            return None
        with self.timers("search"):
            near = self.sights.pairing.within(feet.points, feet.coords, MARGIN * self.master.edge)
        self._pattern.provide(*near, closed, facet, anchor_nodes, ends)
        return self._pattern.keys

    def foreseen(self, feet: MortarFeet, before: Linearised, trial: Trial) -> Floats:
        """Gaps, shifts added, and ways (4 ns,) that decide: of the tractions which the tangent `before` foresees at these
        places, with a share of what is found there."""
        then, law, anchors = before.feet, trial.law, trial.history.anchors
        where = then.coords, self.samples.slaves, self._facets, then.met
        means = self._averages(then, anchors)
        motion = feet.coords - then.coords, *self._leading(then, law.friction)
        change = foreseen_averages(*where, own(anchors), means, self._turned(then), motion)
        averaged = self._averaged(feet, anchors)
        part = self._softened(averaged, trial)
        eps = np.column_stack([law.eps_n, law.eps_t, law.eps_t, law.eps_t]) * np.maximum(part, 1e-300)[:, None]
        foreseen = (np.column_stack([before.N, before.T]) + np.einsum("nab,nb->na", before.rates, change)) / eps
        found = np.column_stack([np.minimum(averaged[0], self.search) + trial.history.shift.ravel(), averaged[1]])
        share = np.minimum(kernel.WEIGHT * self.surface.stiffness[:, None] / eps, 1.0)
        turned = np.einsum("nc,nc->n", foreseen[:, 1:], found[:, 1:]) < 0.0  # it has slid against what rubs it:
        share[turned, 1:] = 0.0  # it sticks before it slides that way
        return (foreseen + share * (found - foreseen)).ravel()

    # -- anchors --------------------------------------------------------------------------------------------------
    def no_anchors(self) -> tuple[Ints64, Floats]:
        shape = self.samples.count * self.samples.corners.shape[1], self._facets[0].shape[1]
        return np.full(shape, -1, dtype=np.int64), np.zeros(shape)

    def _behind(self, feet: MortarFeet, anchors: Anchors, renewed: Bools, slips: Floats) -> Anchors:
        """Anchors of which those of renewed nodes trail their feet so that the node's way is its slip (ns, 3) [length]."""
        s, n = self.samples, feet.projection[5]
        share = np.where(self._seated(feet) & renewed[:, None], s.share * feet.met[6][s.table], 0.0)
        # a mean of P(n_q) slip is shorter than the slip where normals differ
        along = np.einsum("nj,njc,njd->ncd", share, n[s.table], n[s.table])
        whole = np.maximum(share.sum(axis=1), 1e-300)[:, None, None]
        apart = np.linalg.pinv(np.eye(3) - along / whole, rcond=FLAT, hermitian=True)
        slips = np.ascontiguousarray(np.einsum("ncd,nd->nc", apart, slips))
        where = feet.coords, s.slaves, self._facets, feet.met
        return kernel.anchors_behind(*where, own(anchors), (renewed, slips))

    def _seated(self, feet: MortarFeet) -> Bools:
        """Which of the samples around each slave node (ns, J) have a foot."""
        return (self.samples.table >= 0) & (feet.projection[1] != NONE)[self.samples.table]

    def places(self, feet: MortarFeet, trial: Trial) -> Anchors:
        """The samples' places on the master."""
        return self._trailing(feet, np.zeros((len(self.surface.area), 3)))

    def resting(self, feet: MortarFeet, trial: Trial) -> Anchors:
        """Where nodes that came to rest here slip from: their places, behind by what the body's spring of those that are
        covered in part gives way under their traction."""
        averaged, _, _, T, _, _ = self._tractions(feet, trial)
        spring = 1.0 - self._softened(averaged, trial)[:, None]
        return self._trailing(feet, spring * T / self._stick(averaged, trial))

    def _trailing(self, feet: MortarFeet, slips: Floats) -> Anchors:
        """Anchors that trail all feet by slips (ns, 3) [length]."""
        return self._behind(feet, self.no_anchors(), np.ones(len(slips), dtype=bool), slips)

    def committed(self, feet: MortarFeet, trial: Trial) -> tuple[Anchors, Floats]:
        """The anchors to keep when a step is accepted, and the ways slid in it (ns, 1) [length].

        A node that sticks keeps its own, unless a sample of it has come over the master: no anchor of that one alone would
        leave the mean way as it was.
        """
        averaged, status, _, T, _, _ = self._tractions(feet, trial)
        slips, stuck = T / self._stick(averaged, trial), status == STICK
        slid = np.where(status == SLIP, np.linalg.norm(averaged[1] - slips, axis=1), 0.0)
        anchors = trial.history.anchors
        missing = self._seated(feet) & (own(anchors)[0][self.samples.anchor, 0] < 0)
        return self._behind(feet, anchors, ~stuck | missing.any(axis=1), slips), slid[:, None]

    def _rested(self, feet: MortarFeet, rests: Anchors) -> tuple[Floats, Bools]:
        """Ways (ns, 3) since the samples came to rest, and which nodes have such."""
        _, ways, _, anchored, _ = self._averages(feet, rests)  # not kept: all else asks for those of the anchors
        return ways, anchored > 0.0

    def slips(self, feet: MortarFeet, trial: Trial, status: Ints) -> Floats:
        """What the penalty gave way in stick (ns, 1) [length]."""
        grown, slips, pulled = self._grown(feet, trial)
        return np.where((status.ravel() == STICK) & grown, np.linalg.norm(slips - pulled, axis=1), 0.0)[:, None]

    def augmented(self, feet: MortarFeet, trial: Trial, status: Ints, share: float) -> Anchors:
        """Uzawa's update of friction: anchors that give sticking nodes a traction greater by a share of eps_T times slip."""
        grown, slips, pulled = self._grown(feet, trial)
        return self._behind(feet, trial.history.anchors, grown, pulled + share * (slips - pulled))

    def _grown(self, feet: MortarFeet, trial: Trial) -> tuple[Bools, Floats, Floats]:
        """Which nodes stick since they came to rest, and slips (ns, 3) [length] of their tractions after Uzawa's update and
        now. A node covered in part keeps the body's spring, as it does along the normal."""
        ways, rested = self._rested(feet, trial.history.rests)
        averaged, found, _, _, trial_traction, _ = self._tractions(feet, trial)
        pulled = trial_traction / self._stick(averaged, trial)
        return (found == STICK) & rested, self._softened(averaged, trial)[:, None] * pulled + ways, pulled

    def stiffened(self, feet: MortarFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for nodes that slip on from rest as they do."""
        ways, rested = self._rested(feet, rests)
        averaged, found, _, _, pulled, _ = self._tractions(feet, trial)
        slips = (pulled / self._stick(averaged, trial) + (factor - 1.0) * ways) / factor
        return self._behind(feet, trial.history.anchors, (found >= STICK) & rested, slips)

    def chosen(self, points: Bools, ours: Anchors, others: Anchors) -> Anchors:
        """Our anchors at some nodes (ns, 1), the others elsewhere."""
        at = np.zeros(len(own(ours)[0]), dtype=bool)
        table = self.samples.anchor[points.ravel()]
        at[table[table >= 0]] = True
        return tuple(np.where(at[:, None], one, two) for one, two in zip(ours, others, strict=True))

    def packed(self, anchors: Anchors, name: str) -> dict[str, Array]:
        """Anchors as keys of the master's nodes (-1: none) and their weights, arrays (ns, ...) that no partition changes."""
        nodes, weights = own(anchors)
        table = self.samples.anchor
        at = np.where((table < 0)[..., None], -1, nodes[table])
        keys = np.append(self.master.keys, -1)[np.where(at < 0, -1, at - self._first)]
        return {name: keys, f"{name}_weight": np.where(at < 0, 0.0, weights[table])}

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        keys, order, table = values[name], np.argsort(self.master.keys), self.samples.anchor
        at = order[np.minimum(np.searchsorted(self.master.keys[order], keys), len(order) - 1)] + self._first
        nodes, weights = self.no_anchors()
        nodes[table[table >= 0]] = np.where(keys < 0, -1, at)[table >= 0]
        weights[table[table >= 0]] = values[f"{name}_weight"][table >= 0]
        return nodes, weights

    # -- what else is asked of a master ---------------------------------------------------------------------------
    def _mean(self, feet: MortarFeet, of: Bools) -> Floats:
        """Unit means (ns, 1, 3) of the samples' normals; of (np,): those that count."""
        s = self.samples
        share = np.where(s.table < 0, 0.0, s.share * of[s.table])
        return unit(np.einsum("nj,njc->nc", share, feet.projection[5][s.table]))[:, None]

    def normals(self, feet: MortarFeet) -> Floats:
        """Unit normals (ns, 1, 3) along which pressure acts on this rank's slave nodes; zero without a partner."""
        return self._mean(feet, feet.projection[1] != NONE)

    def looks(self, state: State) -> Floats:
        """Unit directions (ns, 1, 3) in which this rank's slave nodes look for the master: their normals. Collective."""
        feet = self.feet(state)
        return -self._mean(feet, np.ones(len(feet.points), dtype=bool))

    def lean(self, feet: MortarFeet, trial: Trial, held: Bools) -> Floats:
        """Sums over this rank's samples: beside the slave's ends and creases of pressure times the difference of their
        normals from the master's, a vector, and last of all the pressure [force]. held (ns,): nodes whose ends are none.

        Surfaces that lie on one another have the same normals, but where an edge is all that touches. Collective.
        """
        _, _, N, _, _, _ = self._tractions(feet, trial)
        none = np.concatenate(self._comm.allgather(self.samples.own[held]))
        beside = np.isin(self.samples.corners, np.setdiff1d(self.samples.ends(), none)).any(axis=1)
        s, x = self.samples, feet.coords[self._facets[0][feet.projection[0]]]
        each = np.where(s.number < 0, 0.0, -N[s.number])
        pressed = (np.einsum("sc,fc->fs", s.slaves[3], each) * s.slaves[1]).ravel() * feet.met[6]
        pressed = np.where(feet.projection[1] != NONE, pressed, 0.0)
        along, across = (np.einsum("qi,qic->qc", feet.met[9][:, i], x) for i in (1, 2))
        ours, theirs = feet.projection[5], unit(np.cross(along, across))
        theirs = theirs * np.sign(np.einsum("qc,qc->q", ours, theirs))[:, None]
        at_ends = np.where(np.repeat(beside, len(pressed) // max(len(beside), 1)), pressed, 0.0)
        return np.append(at_ends @ np.where(at_ends[:, None] > 0.0, ours - theirs, 0.0), pressed.sum())

    def bare(self, feet: MortarFeet) -> Floats:
        """Shares (ns,) of the nodes' areas that do not lie over the master."""
        s = self.samples
        return 1.0 - (s.share * feet.met[6][s.table]).sum(axis=1) / s.share.sum(axis=1)

    def features(self, feet: MortarFeet) -> Array:
        """Codes (ns, ...): where one changes the traction has a kink."""
        s = self.samples
        codes = np.column_stack([feet.projection[0], feet.met[7]])[s.table]
        return np.where((s.table < 0)[..., None], -9, codes).reshape(len(codes), 5 * s.table.shape[1])

    def touches(self, blocks: Array) -> int:
        """Number of this rank's slave and master nodes among the local nodes `blocks`."""
        return int(np.isin(self.skin.owned, blocks).sum() + np.isin(self.master.owned, blocks).sum())

    def node_gaps(self, state: State, nodes: Array, X: Floats) -> Floats:
        """Endless gaps (n,): means over samples leave nothing between them to ask for."""
        return np.full(len(nodes), np.inf)

    def lost_depth(self, state: State, trial: Trial) -> float:
        """Depth [length] of the deepest sample that is too deep in the master to have a partner, else zero. Collective."""
        return deepest_lost(self, self._first, state, trial)
