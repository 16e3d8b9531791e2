"""Fields as all ranks together have them, in an order that no partition and no numbering changes."""

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.numbering import gather, node_keys


def displacements(u):
    """Displacement (nodes, 3) of all nodes, the same on every rank: two models of one script have it in one order.

    dolfinx numbers nodes by what other ranks' messages bring first, 0.11 differently each time. Collective.
    """
    space = u.function_space
    owned = space.dofmap.index_map.size_local
    return of_all(node_keys(space)[:owned], u.x.array.reshape(-1, 3)[:owned])


def of_all(keys, values):
    """Rows (n, ...) of all ranks in the order of their keys (n,). Collective."""
    return MPI.COMM_WORLD.bcast(gather(MPI.COMM_WORLD, np.asarray(keys), np.asarray(values)))[1]
