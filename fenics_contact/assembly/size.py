"""How large the bodies are."""

import numpy as np

from fenics_contact.types import Space


def bodies_size(space: Space) -> float:
    """Largest side of the box around all bodies [length]. Collective."""
    X, comm = space.tabulate_dof_coordinates(), space.mesh.comm
    low, high = X.min(axis=0, initial=np.inf), X.max(axis=0, initial=-np.inf)
    low, high = np.min(comm.allgather(low), axis=0), np.max(comm.allgather(high), axis=0)
    return float((high - low).max())
