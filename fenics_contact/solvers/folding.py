"""Steps that fold cells: what they end in may be in balance, but by a way that shorter steps do not take."""

from fenics_contact.assembly.finding import Finding
from fenics_contact.assembly.system import System

FOLDS = "a step that folds cells"  # the kind of failure
SHORTEST = 0.25  # of the step on the schedule: where that folds cells too, they are what the path leads to


def folds(system: System) -> Finding | None:
    """The Finding that the step to the present state has folded cells, where none were as it began. Collective."""
    if system.cells.folded() is None:
        return None
    u = system.state.u.x.array
    now, u[:] = u.copy(), system.trail.last.u
    before = system.cells.folded()
    u[:] = now
    return None if before else Finding(FOLDS, "it has folded cells, as shorter steps may not")
