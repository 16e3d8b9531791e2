"""How much of the friction that a contact could exert against a motion it does exert: all of it where the motion begins."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import ENDLESS
from fenics_contact.solvers.motions import Drift
from fenics_contact.types import Floats

NEARBY = 1e-3  # of a contact's deepest penetration: a motion that opens none of its points, but for those that hardly press
SWEEPS = 50  # of reweighted least squares; each share is one that a motion has, so that fewer only find less
LEAST = 1e-6  # of the fastest point's: a slower one, at the centre of a turn, weighs as one of that


def used_share(system: System, contact: ContactTerm, motions: Sequence[Drift], asked: bool = False) -> float:
    """The largest share, over all combinations of motions, that the work of the friction present is of what it would be with
    all points slipping along the combination; asked: of the friction that there would be, were it endless. Collective.

    It is sum f v / sum mu p |v| of the points' slips v, and 1 where the contact is at its limit: a point at the centre of a
    turn slips nowhere and does not count (limit analysis of rigid bodies, Drucker 1954). The largest share is found by
    least squares, weighted by mu p / |v| of the combination before.
    """
    sums = system.comm.allreduce
    area = contact.surface.area
    trial = contact.trial.with_friction(ENDLESS) if asked else None
    friction = (contact.forces.split_traction(system.state, trial)[1] * area[..., None]).reshape(-1, 3)
    most = (contact.forces.limits(system.state) * area).ravel()
    slips = _slips(system, contact, motions)
    force = sums(np.einsum("kpc,pc->k", slips, friction))
    weights, share = most, 0.0
    for _ in range(SWEEPS):
        combined = np.linalg.lstsq(sums(np.einsum("kpc,p,jpc->kj", slips, weights, slips)), force, rcond=1e-10)[0]
        speeds = np.linalg.norm(np.einsum("k,kpc->pc", combined, slips), axis=1)
        fastest, work = max(system.comm.allgather(speeds.max(initial=0.0))), sums(float(most @ speeds))
        if not work > 0.0:
            break
        share = max(share, float(force @ combined) / work)
        weights = most / np.maximum(speeds, LEAST * fastest)
    return share


def _slips(system: System, contact: ContactTerm, motions: Sequence[Drift]) -> Floats:
    """How the points of this rank slip in motions (len(motions), points, 3), against the friction that resists it."""
    state, law, forces = system.state, contact.trial.law, contact.forces
    u, q, endless = state.u.x.array.copy(), state.q.copy(), contact.trial.with_friction(ENDLESS)
    deepest = np.max(forces.split_traction(state)[0] / law.eps_n[:, None], initial=0.0)
    way = NEARBY * max(system.comm.allgather(deepest))
    before = forces.split_traction(state, endless)[1]
    slips = np.zeros((len(motions), contact.surface.area.size, 3))
    for slip, motion in zip(slips, motions, strict=True):
        share = float(way / motion.largest)
        system.update(share * motion.du, share * motion.dq)
        slip[:] = ((forces.split_traction(state, endless)[1] - before) / law.eps_t[:, None, None]).reshape(-1, 3) / share
        state.u.x.array[:], state.q[:] = u, q
    return slips
