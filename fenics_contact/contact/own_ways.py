"""What friction would do more at samples of averages, if each rubbed by its own way and not by the mean one of its node."""

import numpy as np

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.friction import allowed
from fenics_contact.contact.meeting import MortarFeet
from fenics_contact.contact.node_laws import NodeLaws
from fenics_contact.contact.on_facets import own
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.types import Bools, Floats, Ints64


def more_friction(laws: NodeLaws, number: Ints64, feet: MortarFeet, trial: Trial) -> tuple[Floats, Floats]:
    """Forces on the master (np, 3) that samples would rub with more, each by its own way since the anchors, under the
    pressures of the nodes at its corners, whose numbers are (nf, m), -1: another process answers for it; and sums (ns,) of
    their sizes around the nodes [force].

    Friction of a node is one traction: where what is around it slides this way and that, as in the middle of a body that
    spreads, it is none there, and from there to the next nodes it is linear.
    """
    averaged, _, N, T, _ = laws.tractions(feet, trial)
    slaves, friction = feet.samples.slaves, laws.friction(feet, trial)
    at = number[slaves.facet]
    ways, known = _own_ways(feet, trial)
    pulled = laws.stick(averaged, trial)[at] * ways
    if len(friction.directions):
        friction = friction._replace(directions=np.ascontiguousarray(friction.directions[at].reshape(-1, 3)))
    limits, shares = allowed(friction, -N[at], pulled)
    rubs = np.minimum(np.linalg.norm(pulled, axis=2), limits * shares)[..., None] * unit(pulled)
    share = np.where((at >= 0) & known, slaves.N * (slaves.weights * feet.met[6])[:, None], 0.0)
    more, normals = share[..., None] * (rubs - T[at]), feet.projection[5]
    sizes = np.bincount(at[at >= 0], np.linalg.norm(more, axis=2)[at >= 0], len(N))
    force = more.sum(axis=1)
    return np.asarray(force - (force * normals).sum(axis=1, keepdims=True) * normals), np.asarray(sizes, dtype=float)


def _own_ways(feet: MortarFeet, trial: Trial) -> tuple[Floats, Bools]:
    """Ways (np, m, 3) of samples since the anchors that each has for the nodes at its corners, and which are known (np, m)
    [length]."""
    (nodes, weights), slaves = own(trial.history.anchors), feet.samples.slaves
    known = (feet.projection[1] != NONE)[:, None] & (nodes[:, 0] >= 0).reshape(slaves.N.shape)
    anchors = np.einsum("ai,aic->ac", weights, feet.coords[nodes]).reshape(*slaves.N.shape, 3)
    ways = np.where(known[..., None], feet.met[10][:, :1] - anchors, 0.0)
    for along in (feet.projection[5][:, None], feet.normals[slaves.group[slaves.facet]]):
        ways = ways - (ways * along).sum(axis=2, keepdims=True) * along
    return ways, known


def add_rubbing(feet: MortarFeet, facets: Ints64, more: Floats, forces: Floats) -> None:
    """Add what samples rub with more, forces on the master (np, 3), whose facets have nodes (nf, l), to the forces of nodes
    (nx, 3) as the virtual power (14) has them: on the slave's the same, on the master's the opposite."""
    slaves, met = feet.samples.slaves, feet.projection[1] != NONE
    np.add.at(forces, slaves.nodes[slaves.facet], slaves.shape[..., None] * more[:, None])
    np.add.at(forces, facets[feet.projection[0][met]], -feet.met[9][met, 0][..., None] * more[met][:, None])
