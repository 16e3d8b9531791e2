"""Another body's facets as a contact's master, met with one pressure per slave node: means over the samples around it."""

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.term import State
from fenics_contact.assembly.trial import Response, Trial
from fenics_contact.contact.friction import Friction
from fenics_contact.contact.master import motion
from fenics_contact.contact.meeting import Linearised, MortarFeet
from fenics_contact.contact.node_anchors import NodeAnchors
from fenics_contact.contact.node_laws import JUDGED, NodeLaws, bending, judged
from fenics_contact.contact.node_pattern import NodePattern
from fenics_contact.contact.node_places import NodePlaces, ends_at
from fenics_contact.contact.on_facets import MARGIN, OnFacets, own
from fenics_contact.contact.partner import weighed
from fenics_contact.contact.samples import Samples
from fenics_contact.contact.turning import add_rubbing, more_friction
from fenics_contact.contact.unit import unit
from fenics_contact.kernels import mortar as kernel
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.foreseen import WEIGHT
from fenics_contact.kernels.mortar_patches import NORMAL, ROUGH
from fenics_contact.kernels.mortar_rates import Products, foreseen_averages, node_products
from fenics_contact.kernels.mortar_tangent import held_rates, tangent_rows
from fenics_contact.kernels.sharp_means import weights
from fenics_contact.kernels.status import SLIP, STICK
from fenics_contact.types import Array, Floats, Ints64

SLID = 0.05  # of a cell: a node that has gone less has not begun to slide; the double is all


class MortarPartner(OnFacets):
    """Slave nodes against the facets of another body, through samples of the facets around them.

    Forces go back by sums over the surfaces' nodes. Methods that take feet are collective.
    """

    settles = foretells = True
    smooth = False
    places: NodePlaces

    def __init__(self, name: str, places: NodePlaces) -> None:
        super().__init__(name, places)
        self._laws = NodeLaws(places)
        self.anchors = NodeAnchors(places, self._laws)
        self._pattern = self._new_pattern()

    def _new_pattern(self) -> NodePattern:
        blocks = np.concatenate([self.places.skin.blocks, self.places.master.blocks]).astype(np.int64)
        return NodePattern(self.places.around, self.places.facets, blocks, self.places.skin.size)

    def resampled(self, trial: Trial, feet: MortarFeet) -> Trial:
        """With samples where the surfaces lie at feet; nodes have the ways since anchors and rests that they had."""
        h = trial.history
        ways = [self._laws.averages(h.feet, anchors)[1] for anchors in (h.anchors, h.rests)] if trial.rough else []
        then, come = self.places.resampled(h.feet, feet, self._slides(trial) if trial.rough else None)
        anchors, rests = [self.anchors.trailing(then, way) for way in ways] or [self.anchors.here(then, trial)] * 2
        if come is not None:
            anchors = self.anchors.coming(then, come, anchors)
        return trial.remembering(anchors=anchors, rests=rests, before=anchors, feet=then)

    def _slides(self, trial: Trial) -> Floats:
        """How much (ns,) nodes slide, from 0 to 1: by the way that they have slid, for what comes to rest would be loaded
        anew, slip, and so on, if it pressed otherwise at once."""
        return np.clip(trial.history.slip_path.ravel() / (SLID * self.surface.spacing.ravel()) - 1.0, 0.0, 1.0)

    def return_to(self, trial: Trial) -> None:
        """To the samples of a trial."""
        if self.places.samples is not trial.history.feet.samples:
            self.places.use(trial.history.feet.samples)

    def sites(self, feet: MortarFeet) -> dict[str, Array]:
        """Where the samples around each node are (ns, J, 4), see `Samples.packed`."""
        return {"samples": feet.samples.packed()}

    def put_sites(self, values: dict[str, Array], state: State) -> None:
        """Take samples where they were. Collective."""
        coords = np.concatenate([self.places.skin.positions(state), self.places.master.positions(state)])
        sites, steered = self.places.around.unpacked(values["samples"])
        self.places.use(Samples(self.places.around, sites, ends_at(self.places, coords)[0], steered))

    def friction(self, feet: MortarFeet, trial: Trial) -> Friction:
        """The law of friction at these feet, with what directions it has there."""
        return self._laws.friction(feet, trial)

    def response(self, feet: MortarFeet, trial: Trial) -> Response:
        averaged, status, N, T, _ = self._laws.tractions(feet, trial)
        forces, sums, area = np.zeros_like(feet.coords), np.zeros((len(N), 13)), self.surface.area
        acting = N, T, averaged[0], self.places.around.number
        kernel.add_node_forces(self._laws.pairs(feet, trial.history.anchors), acting, forces, sums)
        if len(trial.rubs):
            add_rubbing(feet, self.places.facets[0], trial.rubs, forces)
        gap = np.minimum(averaged[0], self.places.search)[:, None]
        cover = self._laws.softened(averaged, trial)[:, None]
        traction, split = (sums[:, :3] / area)[:, None], (-sums[:, 3:4] / area, (-sums[:, 4:7] / area)[:, None])
        more = sums[:, 8:9] / np.maximum(sums[:, 7:8], 1e-300)
        aslant = -sums[:, 9:10] / area, (-sums[:, 10:] / area)[:, None]
        return Response(traction, gap, status[:, None], cover, forces, split, 1.0 + more, aslant)

    def add_forces(self, feet: MortarFeet, response: Response, residual: Floats, tool_residual: Floats) -> None:
        """Add area T to the slave nodes' forces and its opposite to the master's, (14)."""
        self.places.skin.add_forces(response.forces[: self.places.first], residual)
        self.places.master.react(feet, response.forces, residual, tool_residual)

    def tangent(self, feet: MortarFeet, trial: Trial) -> Blocks:
        rows, columns, blocks, at = self._tangent(feet, trial)
        return Blocks(pairs=(rows, columns, blocks), at=at)

    def _tangent(self, feet: MortarFeet, trial: Trial) -> tuple[Ints64, Ints64, Floats, Linearised]:
        """Rows (n,), rising, columns (n,) and blocks (n, 3, 3) of the tangent, each pair once, and what it knew."""
        averaged, _, N, T, _ = self._laws.tractions(feet, trial)
        law = self._laws.numbers(trial, self._laws.friction(feet, trial))
        rates, pressed, rubbed = kernel.node_rates(law, averaged, self._laws.share(trial))
        rates[:, :, 1:4] = rates[:, :, 1:4] @ feet.kept
        pairs, turned, pattern = self._laws.pairs(feet, trial.history.anchors), self._laws.turned(feet), self._pattern
        directed, leading = self._laws.leading(feet, trial.law.friction)
        rough = NORMAL + (ROUGH - NORMAL) * rates[:, 1:, :4].any(axis=(1, 2))
        asked = np.where(rates[:, 0, 0] != 0.0, rough, 0)
        patches = pattern.patches(asked, feet, pairs[4], leading if len(directed) else leading[:0])
        products: Products = pattern.blocks, patches, np.empty((len(patches[2]), 7, 4))
        changing = _moved(rates, pressed, self.places.around.sharp), *averaged, directed, leading
        node_products(pairs, turned, changing, products)
        held = held_rates(pairs, feet.lengths, (pressed, rubbed, averaged[0], self.places.around.number))
        where = pairs, turned, held, products, pattern.size
        rows, columns, blocks = pattern.filled(lambda out: tangent_rows(*where, out))
        return rows, columns, blocks, Linearised(feet, N, T, rates)

    def couplings(self, feet: MortarFeet, trial: Trial) -> Ints64 | None:
        """None while all closed nodes lie in the pattern asked for last; else keys row * N + column of a new one."""
        averaged = self._laws.averaged(feet, trial.history.anchors)
        gaps = averaged[0] + trial.history.shift.ravel()
        gaps = np.minimum(gaps, trial.judged.reshape(-1, JUDGED)[:, 0]) if len(trial.judged) else gaps
        closed = np.isfinite(averaged[0]) & (gaps <= 2.0 * trial.law.touch)
        anchors = own(trial.history.anchors)
        if self._pattern.suffices(closed, feet, anchors):
            return None
        with self.timers("search"):
            near = self.places.sights.pairing.within(feet.points, feet.coords, MARGIN * self.places.master.edge)
        self._pattern.provide(near, closed, feet, anchors)
        return self._pattern.keys

    def foreseen(self, feet: MortarFeet, before: Linearised, trial: Trial) -> Floats:
        """What decides (5 ns,), see `judged`: of the tractions which the tangent `before` foresees at these places, with a
        share of what is found there.

        A node that pressed then opens by its pressure, or by a gap more than 1/SOFT times as wide as the solve has moved it:
        of a slender part the stiffness is far below E/h, by which what curvature leaves open would outweigh its pressure.
        """
        then, law, anchors = before.feet, trial.law, trial.history.anchors
        means = self._laws.averages(then, anchors)
        moved = motion(then, feet, self.places.first), *self._laws.leading(then, law.friction)
        change = foreseen_averages(self._laws.pairs(then, anchors), means, self._laws.turned(then), moved)
        averaged = self._laws.averaged(feet, anchors)
        part = self._laws.softened(averaged, trial)
        eps = np.column_stack([law.eps_n, law.eps_t, law.eps_t, law.eps_t]) * np.maximum(part, 1e-300)[:, None]
        foreseen = (np.column_stack([before.N, before.T]) + np.einsum("nab,nb->na", before.rates, change)) / eps
        gaps = np.minimum(averaged[0], self.places.search)
        found = np.column_stack([gaps + trial.history.shift.ravel(), averaged[1]])
        share = np.minimum(WEIGHT * self.surface.stiffness[:, None] / eps, 1.0)
        pressed = before.rates[:, 0, 0] != 0.0
        soft = kernel.SOFT * np.abs(foreseen[:, 0]) / np.maximum(np.abs(gaps - means[0]), 1e-300)
        share[pressed, 0] = np.minimum(share[:, 0], soft)[pressed]
        gaps = foreseen[:, 0] + share[:, 0] * (found - foreseen)[:, 0]
        pressures = -eps[:, 0] * foreseen[:, 0], -eps[:, 0] * gaps
        bends = bending(*pressures, pressed, self.surface.area.ravel(), self.places.skin.comm)
        return judged(gaps, weighed(foreseen[:, 1:], found[:, 1:], share[:, 1:]), bends)

    def found(self, feet: MortarFeet, trial: Trial) -> Floats:
        """See `ContactPartner.found`."""
        averaged = self._laws.averaged(feet, trial.history.anchors)
        return judged(np.minimum(averaged[0], self.places.search) + trial.history.shift.ravel(), averaged[1])

    def deciding(self, feet: MortarFeet, before: Trial, trial: Trial, gaps: Floats, wide: Floats) -> Floats:
        """See `Partner.deciding`: these gaps, and the ways of what stuck by the friction that it had; of what is to slip
        the farther."""
        averaged, status, *_, pulled = self._laws.tractions(feet, before)
        now = self._laws.averaged(feet, trial.history.anchors)[1]
        ways = np.where((status == STICK)[:, None], pulled / self._laws.stick(averaged, trial), now / np.minimum(wide, 1.0))
        return judged(gaps.ravel(), ways)

    def carried_on(self, trial: Trial, share: float) -> Floats:
        """Gaps, shifts added, carried on from those of the last accepted step by a share of the change in it, and ways
        that decide at the start of the next."""
        averaged, status, *_ = self._laws.tractions(trial.history.feet, trial)
        # a node that slipped has been left on its cone, whose ellipse turns with the master: its way goes on, beyond it
        further = np.where(status == SLIP, 2.0, 1.0)[:, None]
        return judged(trial.history.carried_on(share).ravel(), further * averaged[1])

    def ahead(self, feet: MortarFeet, before: Linearised, trial: Trial) -> Floats:
        """See `ContactPartner.ahead`."""
        ways = [self._laws.averages(at, trial.history.anchors)[1] for at in (before.feet, feet)]
        return np.stack([np.einsum("nc,nc->n", before.T, way) for way in ways], axis=-1)

    def more_friction(self, feet: MortarFeet, trial: Trial) -> tuple[Floats, Floats]:
        """See `turning.more_friction`."""
        return more_friction(self._laws, self.places.around, feet, trial)

    def lean(self, feet: MortarFeet, trial: Trial) -> Floats:
        """Sums over this rank's samples of what acts aside, a vector of nodes in facets at the slave's ends and creases and
        one of all, then of the load, a vector and its size, and, where nodes slip that press along their own normals, of
        friction as they have it and as their samples do, and of both kinds of what acts aside the part along friction, (14,)
        [force]. Aside: of forces the part across the master's normal, and where nodes slip what that lacks of friction's law
        by the part along it, the load.

        Surfaces that lie on one another have the same normals, but where an edge is all that touches. Collective.
        """
        averaged, status, N, T, _ = self._laws.tractions(feet, trial)
        around, slaves = self.places.around, feet.samples.slaves
        number, facet = around.number[slaves.facet], slaves.facet
        share = slaves.N * np.where(feet.projection[1] != NONE, slaves.weights * feet.met[6], 0.0)[:, None]
        share = np.where(number < 0, 0.0, share)
        p = -N[number] * share
        if len(slaves.sharp):
            p *= weights(feet.projection[4][:, None], averaged[0][number], np.where(number < 0, 0.0, slaves.sharp[number]))
        t, slips = T[number] * share[..., None], (status == SLIP)[number]
        ours, theirs = feet.projection[5][:, None], self.places.master_normals(feet)[:, None]
        along = np.tile(ours, (1, number.shape[1], 1))
        if len(slaves.aside):
            more = np.einsum("qi,qic->qc", slaves.aside, feet.coords[slaves.nodes[facet]])
            along = along + slaves.leans[facet][..., None] * more[:, None]
        # of what sticks no law tells the friction
        force = p[..., None] * along - np.where(slips[..., None], t - _dot(along, t) * ours, 0.0)
        load = _dot(theirs, force)
        apart, rubs = force - load * theirs, t - _dot(theirs, t) * theirs
        size = np.maximum(p * np.linalg.norm(rubs, axis=2), 1e-300)
        law = (np.where(slips, np.linalg.norm(t, axis=2), 0.0) / size)[..., None] * load * rubs
        apart = np.where(p[..., None] > 0.0, apart + law, 0.0)
        slid = np.where((slips & (slaves.leans[facet] == 0.0))[..., None], t, 0.0)
        felt = [np.linalg.norm(part, axis=2).sum() for part in (slid, slid - _dot(ours, slid) * ours)]
        near = np.isin(number, np.unique(around.number[around.tips.any(axis=1)]))
        all_over = [part.sum(axis=(0, 1)) for part in (apart, load * theirs)]
        along = _dot(apart, unit(t))[..., 0] * slips
        return np.concatenate([apart[near].sum(axis=0), *all_over, [load.sum()], felt, [along[near].sum(), along.sum()]])


def _dot(a: Floats, b: Floats) -> Floats:
    """Products (..., 1) of vectors."""
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def _moved(rates: Floats, N: Floats, sharp: Floats) -> Floats:
    """Rates of nodes (ns, 4, 4), and how their pressures N (ns,) go over to what is farther off as the mean gap grows."""
    if not len(sharp):
        return rates
    out = rates.copy()
    out[:, 0, 0] += sharp * N
    return out
