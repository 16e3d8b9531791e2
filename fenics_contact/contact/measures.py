"""What a contact hands to the history: sums over its slave points on all ranks."""

from typing import Any

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.trial import Response
from fenics_contact.kernels.status import OPEN, STICK


def contact_measures(surface: SlaveSurface, response: Response, state: State) -> dict[str, Any]:
    """Force and moment on the slave body [force, force x length], areas and counts of a contact's points. Collective."""
    s, comm = surface, state.u.function_space.mesh.comm
    x = np.einsum("eqk,ekc->eqc", s.a, s.X + state.u.x.array.reshape(-1, 3)[s.nodes])
    force, closed = -response.traction * s.area[..., None], response.status != OPEN
    sums = np.concatenate([
        force.sum(axis=(0, 1)),
        np.cross(x, force).sum(axis=(0, 1)),
        [s.area[closed].sum(), closed.sum(), (response.status == STICK).sum(), s.area.size],
    ])  # fmt: skip
    sums = comm.allreduce(sums)
    held = response.gap[response.cover >= 1.0]  # points half out under a sharp edge are meant to sink in
    return {
        "force": sums[:3],
        "moment": sums[3:6],
        "area": sums[6],
        "active": int(sums[7]),
        "sticking": int(sums[8]),
        "points": int(sums[9]),
        "penetration": -min(comm.allgather(held.min(initial=0.0))),
    }
