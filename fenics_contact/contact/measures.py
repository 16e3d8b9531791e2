"""What a contact hands to the history: sums over its slave points on all ranks."""

import numpy as np

from fenics_contact.kernels.status import STICK


def contact_measures(contact, state, comm, closed, gaps):
    """Force and moment on the slave body [force, force x length], areas and counts of a contact's evaluated points.

    closed (ne, nq) bool; gaps: those of the points whose penetration is an error of the penalty [length].
    """
    s = contact.surface
    x = np.einsum("eqk,ekc->eqc", s.a, s.X + state.u.x.array.reshape(-1, 3)[s.nodes])
    force = -contact.traction * s.area[..., None]
    sums = np.concatenate([
        force.sum(axis=(0, 1)),
        np.cross(x, force).sum(axis=(0, 1)),
        [s.area[closed].sum(), closed.sum(), (contact.status == STICK).sum(), s.area.size],
    ])  # fmt: skip
    sums = comm.allreduce(sums)
    return {
        "force": sums[:3],
        "moment": sums[3:6],
        "area": sums[6],
        "active": int(sums[7]),
        "sticking": int(sums[8]),
        "points": int(sums[9]),
        "penetration": -min(comm.allgather(gaps.min(initial=0.0))),
    }
