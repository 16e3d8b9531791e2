"""Pressure and friction of slave nodes from the averages of gap and way over the samples around them."""

import numpy as np
from mpi4py.MPI import Intracomm

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.friction import Friction
from fenics_contact.contact.friction import turned as turned_along
from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.node_places import NodePlaces
from fenics_contact.contact.on_facets import own
from fenics_contact.kernels import mortar as kernel
from fenics_contact.types import Anchors, Bools, Floats, Ints, Ints64

JUDGED = 5  # numbers of a node in `Trial.judged`: see `judged`


class NodeLaws:
    """Of the nodes of these places, at feet and with a trial."""

    def __init__(self, places: NodePlaces) -> None:
        self._places = places
        self._last: tuple[MortarFeet, Anchors, kernel.Averaged] | None = None  # feet, anchors and averages asked for last

    def averaged(self, feet: MortarFeet, anchors: Anchors) -> kernel.Averaged:
        """What the slave nodes have on average; residual, couplings, tangent and what is foreseen ask for the same."""
        last = self._last
        if last is None or last[0] is not feet or last[1] is not anchors:
            last = self._last = feet, anchors, self.averages(feet, anchors)
        return last[2]

    def averages(self, feet: MortarFeet, anchors: Anchors) -> kernel.Averaged:
        return kernel.averages(self.pairs(feet, anchors))

    def pairs(self, feet: MortarFeet, anchors: Anchors) -> kernel.Pairs:
        return feet.pairs(self._places.facets, own(anchors))

    def numbers(self, trial: Trial, friction: Friction) -> kernel.NodeLaws:
        law, shift = trial.law, trial.history.shift.ravel()
        judged, body = trial.judged.reshape(-1, JUDGED), self._places.surface.stiffness
        return law.eps_n, law.eps_t, friction, float(law.touch), shift, judged, body

    def friction(self, feet: MortarFeet, trial: Trial) -> Friction:
        """The law of friction at these feet, with what directions it has there: sums over the samples around each node."""
        law, (parts, facet) = turned_along(trial.law.friction, feet.pose), self.leading(feet, trial.law.friction)
        if not len(parts):
            return law
        at_samples = np.einsum("qi,qic->qc", parts[facet], feet.coords[self._places.facets[0][facet]])
        share = np.where(feet.seated, feet.samples.share, 0.0)
        return law._replace(directions=np.einsum("nj,njc->nc", share, at_samples[feet.samples.table]))

    def leading(self, feet: MortarFeet, friction: Friction) -> tuple[Floats, Ints64]:
        """Parts (nf, m) of nodes in their facets' directions of friction, and the samples' facets (nq,) that hold there."""
        directed = self._places.directed(friction)
        if directed is None:
            return np.empty((0, self._places.facets[0].shape[1])), feet.projection[0]
        return directed.parts, directed.leading(feet.projection)

    def share(self, trial: Trial) -> Floats:
        return (trial.area / self._places.surface.area).ravel()

    def turned(self, feet: MortarFeet) -> tuple[Ints64, Ints64, Floats, Floats]:
        return self._places.around.groups[3], self._places.around.groups[4], feet.turns, feet.lengths

    def tractions(self, feet: MortarFeet, trial: Trial) -> tuple[kernel.Averaged, Ints, Floats, Floats, Floats]:
        """Averages, and status, N, T_T, T_T^tr of the slave nodes."""
        averaged = self.averaged(feet, trial.history.anchors)
        return averaged, *kernel.node_tractions(self.numbers(trial, self.friction(feet, trial)), averaged, self.share(trial))

    def softened(self, averaged: kernel.Averaged, trial: Trial) -> Floats:
        """Penalties of the nodes (ns,) over those of nodes that are covered whole."""
        part = np.empty(len(averaged[0]))
        kernel.softening(self.numbers(trial, trial.law.friction), averaged, part)  # in which no direction has a part
        return part

    def stick(self, averaged: kernel.Averaged, trial: Trial) -> Floats:
        """Penalties (ns, 1) of the nodes' slip [pressure/length]; without a foot there is no slip."""
        part = self.softened(averaged, trial)
        return (trial.law.eps_t * np.where(part > 0.0, part, 1.0))[:, None]


def judged(gaps: Floats, ways: Floats, bends: Floats | float = 1.0) -> Floats:
    """What decides of nodes (5 ns,), as `Trial.judged` has it: gaps (ns,), shifts added, ways (ns, 3), and how much (ns,)
    of their tractions bends with the surfaces in the next tangent."""
    return np.column_stack([gaps, ways, np.broadcast_to(bends, gaps.shape)]).ravel()


def bending(foreseen: Floats, taken: Floats, pressed: Bools, area: Floats, comm: Intracomm) -> Floats:
    """How much (ns,) of what nodes are taken to press with bends with the surfaces in the next tangent.

    foreseen, taken (ns,): pressures that the last solve foresaw, and that the next begins with; pressed (ns,): who pressed
    in the last tangent; area (ns,): the nodes'. Collective.

    Where closed nodes were to pull, what the others pressed with against them goes as these open; what closes is pressed by
    no solve yet, but by how deep it lies, as a solid body would be. Of a slender part either may be thousands of times its
    force, and a tangent with such pressures, turning with it, leads nowhere. So what goes on pressing bends with no more
    than was foreseen in all, what closes with no more than any of it.
    """
    kept, force = pressed & (taken > 0.0), foreseen * area
    here = np.array([force[pressed].sum(), force[kept].sum(), foreseen[kept].max(initial=0.0)])
    every = np.array(comm.allgather(here))
    (whole, stays), most = every[:, :2].sum(axis=0), every[:, 2].max()
    share = min(max(whole / stays, 0.0), 1.0) if stays > 0.0 else 1.0
    more = taken > share * most
    return np.where(pressed, share, np.where(more, share * most / np.where(more, taken, 1.0), 1.0))
