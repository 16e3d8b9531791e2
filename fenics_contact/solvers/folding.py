"""Steps that fold cells: what they end in may be in balance, but by a way that shorter steps do not take."""

from fenics_contact.assembly.finding import Finding
from fenics_contact.assembly.system import System

FOLDS = "a step that folds cells"  # the kind of failure
SHORTEST = 0.25  # of the longest step of a stage: where that folds cells too, they are what the path leads to


class Folding:
    """Looks for cells that a step has folded, where none were as it began."""

    def __init__(self, system: System) -> None:
        self._system, self._longest = system, 0.0
        self._before = system.cells.folded() is not None

    def objection(self, shorter: bool) -> Finding | None:
        """Why the step to the present state is too long; shorter: whether it may be shorter. Collective."""
        size = self._system.state.t - self._system.trail.last.t
        self._longest = max(self._longest, size)
        if self._before or not shorter or size <= SHORTEST * self._longest * (1.0 + 1e-9):
            return None
        if self._system.cells.folded() is None:
            return None
        return Finding(FOLDS, "it has folded cells, as shorter steps may not")

    def accepted(self) -> None:
        """The next step begins. Collective."""
        self._before = self._system.cells.folded() is not None
