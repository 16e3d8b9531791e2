"""Prescribed dofs and prescribed or pushed tools as functions of the load parameter t."""

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import numpy as np

from fenics_contact.types import Bools, Floats, Ints

Paths = Sequence[Callable[[float], Floats]]  # of each tool: t -> (3,)


class Prescribed(Protocol):
    """Displacements [length] of an entry's dofs (n,) at t, and of a few of its points, the same on all ranks."""

    def __call__(self, t: float) -> Floats: ...

    def few(self, t: float) -> Floats: ...


class Supports:
    """Dofs with prescribed displacement.

    entries: (dofs, value) with local dofs (n,) (ghosts included), value a number (ramped with t) or a function of t that
    gives (n,) and that all ranks call. conflict: names of two entries that contradict each other, or None.
    """

    def __init__(self, entries: Sequence[tuple[Ints, float | Prescribed]], owned_dofs: int, names: Sequence[str]) -> None:
        self._entries, self._names = entries, names
        dofs = np.concatenate([e[0] for e in entries]) if entries else np.empty(0, dtype=np.int32)
        self.dofs, self._first, inverse = np.unique(dofs, return_index=True, return_inverse=True)
        self.owned = self.dofs[self.dofs < owned_dofs]
        self.conflict = None
        for t in (0.0, 0.5, 1.0):
            values = self._all(t)
            gap = np.abs(values - values[self._first][inverse])
            if gap.size and gap.max() > 1e-12 * max(1.0, np.abs(values).max()):
                sizes = np.cumsum([len(e[0]) for e in entries])
                second = int(np.searchsorted(sizes, int(np.argmax(gap)), side="right"))
                first = int(np.searchsorted(sizes, self._first[inverse[int(np.argmax(gap))]], side="right"))
                self.conflict = (names[first], names[second])

    def _all(self, t: float) -> Floats:
        parts = [value(t) if callable(value) else np.full(len(dofs), value * t) for dofs, value in self._entries]
        return np.concatenate(parts) if parts else np.empty(0)

    def sampled(self, times: Iterable[float]) -> dict[str, list[float]]:
        """{name: prescribed displacements [length] at these t, of a function at a few points}. Collective."""
        out: dict[str, list[float]] = {}
        for (_, value), name in zip(self._entries, self._names, strict=True):
            at = [value.few(t) if callable(value) else [value * t] for t in times]
            out[name] = out.get(name, []) + [float(x) for x in np.concatenate(at)]
        return out

    def largest(self, t: float) -> list[tuple[str, float]]:
        """[(name, largest displacement [length] on this rank)] of all entries at t."""
        parts = np.split(np.abs(self._all(t)), np.cumsum([len(dofs) for dofs, *_ in self._entries]))
        return [(name, float(part.max(initial=0.0))) for name, part in zip(self._names, parts[:-1], strict=True)]

    def values(self, t: float) -> Floats:
        """Prescribed displacements [length] of `dofs` at load parameter t."""
        return self._all(t)[self._first]


class ToolMotion:
    """Rigid tools' travel: prescribed components follow a path, free ones balance a force.

    paths: one function t -> (3,) [length] per tool; forces: one function t -> (3,) [force]; free (tools, 3) bool; names.
    """

    def __init__(self, paths: Paths, forces: Paths, free: Bools | Sequence[Bools], names: Sequence[str] = ()) -> None:
        self.names = tuple(names) or tuple(str(i) for i in range(len(paths)))
        self._paths, self._forces = paths, forces
        self.free = np.asarray(free, dtype=bool).reshape(len(paths), 3)

    def __len__(self) -> int:
        return len(self._paths)

    def prescribed(self, t: float) -> Floats:
        """Prescribed travel (tools, 3) at t; zero where the component is free."""
        return np.where(self.free, 0.0, _stack(self._paths, t))

    def forces(self, t: float) -> Floats:
        """External forces (tools, 3) at t."""
        return _stack(self._forces, t)


def _stack(functions: Paths, t: float) -> Floats:
    return np.array([f(t) for f in functions], dtype=float).reshape(len(functions), 3)
