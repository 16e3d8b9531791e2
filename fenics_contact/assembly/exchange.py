"""PETSc vectors that ranks share: exchange between owners and ghosts, and the communicator they live on."""

from functools import cache

from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.types import Space, Vec


def lasting(comm: MPI.Comm) -> MPI.Comm:
    """The communicator of the same processes that outlives every mesh, where there is one.

    Python alone never frees what several ranks share: PETSc keeps it with its communicator until all ranks clean up there,
    and what lives on the communicator of a mesh or a space that is gone can never be freed.
    """
    for known in (MPI.COMM_WORLD, MPI.COMM_SELF):
        if MPI.Comm.Compare(comm, known) in (MPI.IDENT, MPI.CONGRUENT):
            _hold(known.py2f())
            return known
    return comm


@cache
def _hold(handle: int) -> None:
    """Let PETSc keep its duplicate of a communicator to the end of the process. Collective.

    At its end PETSc frees what several ranks share on ranks that still have the duplicate, and the duplicate goes with the
    last object there. Had one rank alone an object left, that rank would wait for the others for ever.
    """
    vector = PETSc.Vec().createMPI((0, 0), comm=MPI.Comm.f2py(handle))
    vector.incRef()  # Python never frees it


def ghosted_vector(space: Space) -> Vec:
    """New PETSc vector (owned and ghost dofs of a vector space), zero, on the lasting communicator."""
    index_map, comm = space.dofmap.index_map, space.mesh.comm
    ghosts = compat.global_blocks(space)[index_map.size_local :].astype(PETSc.IntType)
    sizes = 3 * index_map.size_local, 3 * index_map.size_global
    return PETSc.Vec().createGhost(ghosts, sizes, bsize=3, comm=lasting(comm))


def sum_to_owners(vector: Vec) -> None:
    """Add what ranks wrote into their ghosts to the owners' values."""
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)


def copy_to_ghosts(vector: Vec) -> None:
    """Give every ghost its owner's value."""
    vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
