"""Connected parts of a mesh: what hangs together by shared nodes, whatever its groups and ranks."""

import numpy as np

from fenics_contact import compat
from fenics_contact.kernels.sets import join
from fenics_contact.types import Ints64, Space


def connected_parts(space: Space) -> tuple[Ints64, int]:
    """Part (n,) of every local node (owned, then ghost) of a space of blocks of three, and how many parts there are.

    Parts are numbered by their first cell in the gmsh model, so that any number of ranks agrees. Collective.
    """
    mesh, cells = space.mesh, compat.cell_dofs(space).astype(np.int64)
    numbers = compat.global_blocks(space)
    here = np.arange(len(numbers))
    join(cells, here)
    label = numbers[here]  # of the parts that this rank sees: one of its nodes
    shared = compat.Function(space)
    shared.x.array[::3] = label
    compat.copy_to_ghosts(shared)
    seen_twice = np.stack([label, shared.x.array[::3].astype(np.int64)], axis=1)  # by this rank and by the node's owner
    labels, pairs = np.unique(np.concatenate(mesh.comm.allgather(np.unique(seen_twice, axis=0))), return_inverse=True)
    root = np.arange(len(labels))
    join(pairs.reshape(-1, 2), root)
    part = root[np.searchsorted(labels, label)]
    owned = compat.cell_map(mesh).size_local
    first = np.full(len(labels), np.iinfo(np.int64).max)
    np.minimum.at(first, part[cells[:owned, 0]], compat.original_cells(mesh)[:owned])
    first = np.min(mesh.comm.allgather(first), axis=0)
    order = np.flatnonzero(root == np.arange(len(root)))
    order = order[np.argsort(first[order])]
    number = np.empty(len(labels), dtype=np.int64)
    number[order] = np.arange(len(order))
    return number[part], len(order)
