"""Exchange of dof values between owners and ghosts of a PETSc vector."""

from petsc4py import PETSc


def sum_to_owners(vector):
    """Add what ranks wrote into their ghosts to the owners' values."""
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)


def copy_to_ghosts(vector):
    """Give every ghost its owner's value."""
    vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
