"""What a contact hands to the history: sums over its slave points on all ranks."""

from typing import Any

import numpy as np

from fenics_contact.assembly.term import State
from fenics_contact.contact.surface import SlaveSurface
from fenics_contact.contact.trial import Response
from fenics_contact.kernels.status import OPEN, STICK
from fenics_contact.types import Floats


def contact_measures(surface: SlaveSurface, response: Response, bare: Floats, shift: Floats, state: State) -> dict[str, Any]:
    """Force and moment on the slave body [force, force x length], areas and counts of a contact's points. Collective.

    bare (n,): shares of the points' areas that do not lie over the master; shift (ne, nq): multipliers [length].
    """
    s, comm = surface, state.u.function_space.mesh.comm
    x = np.einsum("eqk,ekc->eqc", s.a, s.X + state.u.x.array.reshape(-1, 3)[s.nodes])
    force, closed = -response.traction * s.area[..., None], response.status != OPEN
    covered = s.area * (1.0 - bare.reshape(s.area.shape))
    sums = np.concatenate([
        force.sum(axis=(0, 1)),
        np.cross(x, force).sum(axis=(0, 1)),
        [covered[closed].sum(), closed.sum(), (response.status == STICK).sum(), s.area.size],
    ])  # fmt: skip
    sums = comm.allreduce(sums)
    whole = closed & (response.cover >= 1.0)  # points half out over an end are meant to sink in
    if not comm.allreduce(int(whole.sum())):  # of all of them what the penalty gives way, without the body's spring
        whole = closed
    held = (response.cover * (response.gap + shift) - shift)[whole]
    return {
        "force": sums[:3],
        "moment": sums[3:6],
        "area": sums[6],
        "active": int(sums[7]),
        "sticking": int(sums[8]),
        "points": int(sums[9]),
        "penetration": max(comm.allgather(0.0 - held.min(initial=0.0))),
    }
