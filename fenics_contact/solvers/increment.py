"""One tangent solve, from the residual assembled last to the next state."""

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.system import System
from fenics_contact.assembly.trial import Trials
from fenics_contact.solvers.linear import LinearSolver, Solution
from fenics_contact.solvers.reuse import TIGHTEST
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Floats

FARTHEST = (
    10.0  # sizes of the bodies; a solve that moves a node or tool by more than that and what is driven has met no resistance
)


def solve_once(
    system: System,
    linear: LinearSolver,
    du: Floats,
    dq: Floats,
    tolerance: float = TIGHTEST,
    trials: Trials | None = None,
) -> Solution:
    """One tangent solve with the assembled residual, and the update of the state. trials: see System.assemble_tangent."""
    system.assemble_tangent(trials=trials)
    increment = linear.solve(du, dq, tolerance)
    if flies(system, increment, max(np.abs(du).max(initial=0.0), np.abs(dq).max(initial=0.0))):
        raise StepFailed("the tangent is singular: an increment is not finite or far larger than the bodies")
    system.update(*increment)
    return increment


def flies(system: System, increment: Solution, driven: float = 0.0) -> bool:
    """Whether an increment moves anything farther than FARTHEST allows, beside what is driven [length]. Collective."""
    moved = max(increment[0].norm(PETSc.NormType.NORM_INFINITY), np.abs(increment[1]).max(initial=0.0))
    return not moved <= FARTHEST * system.extent + driven
