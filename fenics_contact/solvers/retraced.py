"""The curve of the states that a path has been at, and whether a step goes back along it."""

from typing import Any

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.types import Floats

# Of a step's length: how far its chord may lie from a path that turns by the angle for which steps are steered, over that
# angle; twice as far as on a circle, where two chords differ by it
BESIDE = 0.25


class Retraced:
    """The states accepted in a leg, each by a few numbers: the load t, tools' coordinates, and moments of the displacement
    [length], its mean and that of its products with the places over the bodies' size. None of them hangs on the ranks.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        owned = system.space.dofmap.index_map.size_local
        X = system.space.tabulate_dof_coordinates()[:owned]
        self._weights = np.column_stack([np.ones(owned), X / system.extent])
        self._nodes = system.comm.allreduce(owned)
        self.points: list[list[float]] = []

    def _here(self) -> list[float]:
        """The state at hand. Collective."""
        state, owned = self._system.state, len(self._weights)
        moments = self._weights.T @ state.u.x.array.reshape(-1, 3)[:owned]
        total: Any = self._system.comm.allreduce(moments)
        return [state.t, *state.q.ravel().tolist(), *(total / self._nodes).ravel().tolist()]

    def add(self, negative: float, begins: bool) -> None:
        """The state at hand is accepted, with so many negative pivots; begins: as the first one of a leg, before which
        nothing counts. Collective."""
        self.points = [*([] if begins else self.points), [negative, *self._here()]]

    def led_back(self, negative: float, per_load: float, turn: float) -> int:
        """Whether the state at hand, with so many negative pivots, ends a step that goes back along an earlier one, where
        there were as many: how many steps ago that was, 0: none. One that goes beside it at the same load is another path.

        per_load: length that stands for a load of 1; turn: angle [radians] by which a path turns in a step. Collective.
        """
        if len(self.points) < 3:
            return 0
        here, curve = np.array(self._here()), np.array(self.points)
        pivots, curve = curve[:, 0], curve[:, 1:]
        here[0] *= per_load
        curve[:, 0] *= per_load
        begins, ways, step = curve[:-2], np.diff(curve[:-1], axis=0), here - curve[-1]
        lengths, far = np.linalg.norm(ways, axis=1), here - begins
        along = np.clip((far * ways).sum(axis=1) / np.maximum(lengths**2, 1e-300), 0.0, 1.0)
        off, near = far - along[:, None] * ways, BESIDE * turn
        beside = (np.abs(off[:, 0]) <= near * np.abs(ways[:, 0])) & (_sizes(off) <= near * _sizes(ways))
        alike = np.isnan(negative) | (pivots[1:-1] == negative) | (pivots[:-2] == negative)
        straight = ways @ step < -np.cos(min(turn, 1.0)) * lengths * np.linalg.norm(step)
        found = np.flatnonzero(straight & beside & alike)
        return len(ways) - int(found[-1]) + 1 if len(found) else 0


def _sizes(parts: Floats) -> Floats:
    """Of displacements and coordinates alone, without the load (n,) [length]."""
    return np.asarray(np.linalg.norm(parts[:, 1:], axis=1))
