"""How large the bodies are."""

import numpy as np
from mpi4py import MPI

from fenics_contact.types import Floats, Space


def extremes(comm: MPI.Comm, X: Floats) -> tuple[Floats, Floats]:
    """Least and largest coordinates (3,) of the points (n, 3) of all ranks. Collective."""
    low, high = X.min(axis=0, initial=np.inf), X.max(axis=0, initial=-np.inf)
    return np.min(comm.allgather(low), axis=0), np.max(comm.allgather(high), axis=0)


def bodies_size(space: Space) -> float:
    """Largest side of the box around all bodies [length]. Collective."""
    low, high = extremes(space.mesh.comm, space.tabulate_dof_coordinates())
    return float((high - low).max())


def farthest(space: Space) -> float:
    """Largest coordinate of any node of the bodies [length]. Collective."""
    return float(np.abs(extremes(space.mesh.comm, space.tabulate_dof_coordinates())).max())
