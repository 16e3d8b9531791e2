"""An order of a mesh's nodes that no partition changes: what a state must be kept in to be read on other ranks."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.types import Array, Ints64, Space


def node_keys(space: Space) -> Ints64:
    """Number (nodes,) int64 of every local node, ghosts included, the same on any number of ranks. Collective.

    A node is known by the first cell of the gmsh model that holds it and by its place there: that tells apart nodes
    that lie on one another, and those on edges and faces of cells of degree 2.
    """
    mesh = space.mesh
    owned = compat.cell_map(mesh).size_local
    cells = compat.cell_dofs(space)[:owned]
    key = compat.original_cells(mesh)[:owned, None] * float(cells.shape[1]) + np.arange(cells.shape[1])
    last = compat.Function(space)  # of the negative keys: PETSc sends the largest to owners, not the smallest
    last.x.array[:] = -np.inf
    at_nodes = np.full(len(last.x.array) // 3, -np.inf)
    np.maximum.at(at_nodes, cells, -key)
    last.x.array[::3] = at_nodes
    vector = compat.petsc_vector(last)
    vector.ghostUpdate(addv=PETSc.InsertMode.MAX, mode=PETSc.ScatterMode.REVERSE)
    vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
    vector.destroy()
    return -last.x.array[::3].astype(np.int64)


def gather(comm: MPI.Comm, keys: Ints64, values: Array) -> tuple[Ints64, Array] | None:
    """Rows of all ranks on rank 0 in the order of their keys: (keys (n,), values (n, ...)); other ranks get None."""
    parts = comm.gather((keys, values))
    if parts is None:
        return None
    keys = np.concatenate([part[0] for part in parts])
    order = np.argsort(keys, kind="stable")
    return keys[order], np.concatenate([part[1] for part in parts])[order]


def spread(comm: MPI.Comm, gathered: tuple[Ints64, Array] | None, keys: Ints64) -> Array:
    """Rows of what `gather` gave on rank 0 that belong to this rank's keys; KeyError, on all ranks, where one is missing."""
    known, values = comm.bcast(gathered)
    place = np.minimum(np.searchsorted(known, keys), max(len(known) - 1, 0))
    found = bool(len(known) and (known[place] == keys).all()) or not len(keys)
    if not all(comm.allgather(found)):
        raise KeyError("a row is missing")
    return values[place] if len(keys) else values[:0]
