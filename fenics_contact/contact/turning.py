"""What friction would do more at samples of averages where it turns round between nodes, were it at its limit there, too."""

import numpy as np

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.friction import allowed
from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.node_laws import NodeLaws
from fenics_contact.contact.samples import SlaveFacets
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.types import Bools, Floats, Ints64

AT_LIMIT = 0.99  # of the limit: a node has no less friction while it slides, nor after it has
AROUND = 0.5  # of the sum of directions, over their number: friction around a node that has less of it turns round there


def more_friction(laws: NodeLaws, around: SlaveFacets, feet: MortarFeet, trial: Trial) -> tuple[Floats, Floats]:
    """Forces on the master (np, 3) that samples would rub with more, were friction along its own direction at its limit in
    facets where it turns round, under the pressures of the nodes at the corners; and sums (ns,) of their sizes around the
    nodes [force]. Collective.

    Friction of a node is one traction. Where what is around it slides this way and that, as in the middle of a body that
    spreads, it is none there, and from there to the next nodes it is linear: all that slides is missed by up to half of it.
    Where it turns round at one node, between nodes at their limits, or between two of these, nobody knows how much of what
    lies there sticks; where two nodes stick beside one another friction grows from the one to the other as it should.
    """
    _, _, N, T, _ = laws.tractions(feet, trial)
    limits, shares = allowed(laws.friction(feet, trial), -N, T)
    limits = np.where(N < 0.0, limits * shares, 0.0)
    slides = np.linalg.norm(T, axis=1) >= AT_LIMIT * limits
    known = around.at_corners(np.column_stack([T, limits, slides, np.ones(len(N))]))
    turns = slides | _turned(around, known, feet)
    told = (around.at_corners(turns[:, None])[..., 0] == known[..., 5]).all(axis=1)
    slaves, normals = feet.samples.slaves, feet.projection[5]
    facet = slaves.facet
    at, ways = around.number[facet], np.einsum("qm,qmc->qc", slaves.N, known[facet, :, :3])
    counts = (at >= 0) & (told[facet] & (feet.projection[1] != NONE))[:, None]
    share = np.where(counts, slaves.N * (slaves.weights * feet.met[6])[:, None], 0.0)
    more = share[..., None] * (known[facet, :, 3:4] * unit(ways)[:, None] - known[facet, :, :3])
    sizes = np.bincount(at[at >= 0], np.linalg.norm(more, axis=2)[at >= 0], len(N))
    force = more.sum(axis=1)
    return np.asarray(force - (force * normals).sum(axis=1, keepdims=True) * normals), np.asarray(sizes, dtype=float)


def _turned(around: SlaveFacets, known: Floats, feet: MortarFeet) -> Bools:
    """At which own nodes (ns,) friction of the nodes around that are at their limit turns round, seen along the own normal:
    the surface may be round. known (nf, m, 6): tractions, limits and whether these are reached at the corners.

    On planes of symmetry what is not kept there counts for nothing: beyond them the opposite acts."""
    facets, normals = around.facets, feet.normals[around.group[around.facets, around.places]][:, None]
    at_limit = (known[facets, :, 4] > 0.0) & (known[facets, :, 3] > 0.0)
    ways = known[facets, :, :3]
    ways = np.where(at_limit[..., None], unit(ways - (ways * normals).sum(axis=2, keepdims=True) * normals), 0.0)
    node: Ints64 = np.repeat(np.arange(len(around.own)), np.diff(around.starts))
    sums = np.zeros((len(around.own), 4))
    np.add.at(sums, node, np.column_stack([ways.sum(axis=1), at_limit.sum(axis=1)]))
    total = np.linalg.norm(np.einsum("nij,nj->ni", feet.kept, sums[:, :3]), axis=1)
    return np.asarray((sums[:, 3] > 0.0) & (total <= AROUND * sums[:, 3]))


def add_rubbing(feet: MortarFeet, facets: Ints64, more: Floats, forces: Floats) -> None:
    """Add what samples rub with more, forces on the master (np, 3), whose facets have nodes (nf, l), to the forces of nodes
    (nx, 3) as the virtual power (14) has them: on the slave's the same, on the master's the opposite."""
    slaves, met = feet.samples.slaves, feet.projection[1] != NONE
    np.add.at(forces, slaves.nodes[slaves.facet], slaves.shape[..., None] * more[:, None])
    np.add.at(forces, facets[feet.projection[0][met]], -feet.met[9][met, 0][..., None] * more[met][:, None])
