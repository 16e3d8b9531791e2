"""From where the friction of slave nodes grows: a place on the master for each part that a sample has in a node."""

import numpy as np

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.node_laws import NodeLaws
from fenics_contact.contact.node_places import NodePlaces
from fenics_contact.contact.on_facets import own
from fenics_contact.contact.partner import slid_since, strayed, worked
from fenics_contact.kernels import mortar as kernel
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints, Ints64

FLAT = 1e-12  # of the tangential directions: what normals may differ by and count as one


class NodeAnchors:
    """(nodes (np, m), weights (np, m)): numbers among the coordinates, -1: none; `samples.anchor` says whose they are."""

    def __init__(self, places: NodePlaces, laws: NodeLaws) -> None:
        self._places, self._laws = places, laws

    def none(self) -> tuple[Ints64, Floats]:
        shape = self._places.samples.slaves.N.size, self._places.facets[0].shape[1]
        return np.full(shape, -1, dtype=np.int64), np.zeros(shape)

    def here(self, feet: MortarFeet, trial: Trial) -> Anchors:
        """The samples' places on the master."""
        return self.trailing(feet, np.zeros((len(self._places.surface.area), 3)))

    def resting(self, feet: MortarFeet, trial: Trial) -> Anchors:
        """Where nodes that came to rest here slip from: their places, behind by what the body's spring of those that are
        covered in part gives way under their traction."""
        averaged, _, _, T, _ = self._laws.tractions(feet, trial)
        spring = 1.0 - self._laws.softened(averaged, trial)[:, None]
        return self.trailing(feet, spring * T / self._laws.stick(averaged, trial))

    def trailing(self, feet: MortarFeet, slips: Floats) -> Anchors:
        """Anchors that trail all feet by slips (ns, 3) [length]."""
        return self._behind(feet, self.none(), np.ones(len(slips), dtype=bool), slips)

    def coming(self, then: MortarFeet, now: MortarFeet, anchors: Anchors) -> Anchors:
        """Anchors that nodes which have met the master since then have, too: what lies under them now, where it was from
        them then, or when they touched it."""
        of = ~then.seated.any(axis=1) & now.seated.any(axis=1)
        table, share = now.samples.table[of], np.where(now.seated[of], now.samples.share[of], 0.0)
        under = self._places.facets[0][now.projection[0][table]], now.met[9][table][:, :, 0]
        since = slid_since(then, now, table, under)
        slips = np.zeros((len(of), 3))
        slips[of] = np.einsum("nj,njc->nc", share, since) / np.maximum(share.sum(axis=1), 1e-300)[:, None]
        return self.chosen(of[:, None], self._behind(now, self.none(), of, slips), anchors)

    def _behind(self, feet: MortarFeet, anchors: Anchors, renewed: Bools, slips: Floats) -> Anchors:
        """Anchors of which those of renewed nodes trail their feet so that the node's way is its slip (ns, 3) [length]."""
        s, slip = feet.samples, np.zeros_like(slips)
        some = np.flatnonzero(renewed & slips.any(axis=1))
        table = s.table[some]
        share = np.where(feet.seated[some], s.share[some] * feet.met[6][table], 0.0)
        # a mean of P(m) P(n_q) slip, m: the node's own normal, is shorter than the slip where normals differ
        corner = s.anchor[some] % s.slaves.N.shape[1]
        n, m = feet.projection[5][table], feet.normals[s.slaves.group[s.slaves.facet[table], corner]]
        along = np.einsum("nj,njc,njd->ncd", share, n, n) + np.einsum("nj,njc,njd->ncd", share, m, m)
        both = np.einsum("nj,njc,njd->ncd", share * np.einsum("njc,njc->nj", m, n), m, n)
        whole = np.maximum(share.sum(axis=1), 1e-300)[:, None, None]
        kept = feet.kept[some]
        apart = np.linalg.pinv(kept @ (np.eye(3) + (both - along) / whole) @ kept, rcond=FLAT)
        slip[some] = np.einsum("ncd,nd->nc", apart, slips[some])
        return kernel.anchors_behind(feet.pairs(self._places.facets, own(anchors)), (renewed, slip))

    def committed(self, feet: MortarFeet, trial: Trial) -> tuple[Anchors, Floats]:
        """The anchors to keep when a step is accepted, and the ways in it of nodes (ns, 1) that do not stick [length].

        A node that sticks keeps its own, unless a sample of it has come over the master: no anchor of that one alone would
        leave the mean way as it was.
        """
        averaged, status, _, T, _ = self._laws.tractions(feet, trial)
        slips, stuck = T / self._laws.stick(averaged, trial), status == STICK
        slid = np.where(stuck, 0.0, np.linalg.norm(averaged[1] - slips, axis=1))
        anchors = trial.history.anchors
        missing = feet.seated & (own(anchors)[0][feet.samples.anchor, 0] < 0)
        return self._behind(feet, anchors, ~stuck | missing.any(axis=1), slips), slid[:, None]

    def slips(self, feet: MortarFeet, trial: Trial, status: Ints) -> Floats:
        """See `Anchoring.slips`."""
        of, slip, _, pulled = self._rubbing(feet, trial)
        slips = (status.ravel() == SLIP)[:, None]
        wrong = np.linalg.norm(np.where(slips, strayed(pulled, slip), slip), axis=1)
        return np.where((status.ravel() >= STICK) & of, wrong, 0.0)[:, None]

    def slid(self, feet: MortarFeet, trial: Trial, status: Ints) -> tuple[Floats, Floats]:
        """See `Anchoring.slid`; what the body's spring of a node covered in part gives way is no slip, as in `resting`."""
        of, slip, _, pulled = self._rubbing(feet, trial)
        slips = ((status.ravel() == SLIP) & of)[:, None]
        slid, rubbed = np.linalg.norm(slip, axis=1), worked(pulled, slip)
        rubbed = np.where(status.ravel() == OPEN, slid, np.where(slips[:, 0], rubbed, 0.0))
        return np.where(slips, slid[:, None], 0.0), rubbed[:, None]

    def augmented(self, feet: MortarFeet, trial: Trial, status: Ints, share: float) -> Anchors:
        """See `Anchoring.augmented`."""
        of, slip, held, pulled = self._rubbing(feet, trial)
        return self._behind(feet, trial.history.anchors, of, pulled + share * (held + slip - pulled))

    def _rubbing(self, feet: MortarFeet, trial: Trial) -> tuple[Bools, Floats, Floats, Floats]:
        """Which nodes stick or slip since they came to rest, their slips (ns, 3) since, and their friction and its trial
        over eps_T (ns, 3) [length]. What the spring of a node covered in part gives way is no slip, as in `resting`."""
        ways, rested = self._rested(feet, trial.history.rests)
        averaged, found, _, T, trial_traction = self._laws.tractions(feet, trial)
        stick = self._laws.stick(averaged, trial)
        held, pulled = T / stick, trial_traction / stick
        slip = ways - (1.0 - self._laws.softened(averaged, trial)[:, None]) * held
        return (found >= STICK) & rested, slip, held, pulled

    def _rested(self, feet: MortarFeet, rests: Anchors) -> tuple[Floats, Bools]:
        """Ways (ns, 3) since the samples came to rest, and which nodes have such."""
        _, ways, _, anchored, _ = self._laws.averages(feet, rests)  # not kept: all else asks for those of the anchors
        return ways, anchored > 0.0

    def stiffened(self, feet: MortarFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for nodes that slip on from rest as they do."""
        ways, rested = self._rested(feet, rests)
        averaged, found, _, _, pulled = self._laws.tractions(feet, trial)
        slips = (pulled / self._laws.stick(averaged, trial) + (factor - 1.0) * ways) / factor
        return self._behind(feet, trial.history.anchors, (found >= STICK) & rested, slips)

    def chosen(self, points: Bools, ours: Anchors, others: Anchors) -> Anchors:
        """Our anchors at some nodes (ns, 1), the others elsewhere."""
        at = np.zeros(len(own(ours)[0]), dtype=bool)
        table = self._places.samples.anchor[points.ravel()]
        at[table[table >= 0]] = True
        return tuple(np.where(at[:, None], one, two) for one, two in zip(ours, others, strict=True))

    def packed(self, anchors: Anchors, feet: MortarFeet, name: str) -> dict[str, Array]:
        """Anchors as keys of the master's nodes (-1: none) and their weights, arrays (ns, ...) that no partition changes."""
        nodes, weights = own(anchors)
        table = feet.samples.anchor
        at = np.where((table < 0)[..., None], -1, nodes[table])
        return {name: self._places.keys_of(at), f"{name}_weight": np.where(at < 0, 0.0, weights[table])}

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        table, (nodes, weights) = self._places.samples.anchor, self.none()
        some = table >= 0
        nodes[table[some]] = self._places.of_keys(values[name])[some]
        weights[table[some]] = values[f"{name}_weight"][some]
        return nodes, weights
