"""What the statements of supports prescribe: a row for each node of each of them."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from fenics_contact.types import Array, Floats, Ints, Ints64


class Prescribed(Protocol):
    """Displacements [length] of an entry's nodes (n,) at t; few: what its stage states at t, the same on all ranks, of a
    function at a few points; jump: the largest step [length] that it makes on this rank at the very start of the stage;
    begin, said: see Entries; led: whether a stage moves them (collective)."""

    def __call__(self, t: float) -> Floats: ...

    def few(self, t: float) -> Floats: ...

    def jump(self) -> float: ...

    def begin(self, origin: Floats, before: Sequence[float]) -> None: ...

    def said(self) -> list[float]: ...

    def led(self) -> bool: ...


class Carried(NamedTuple):
    """Of an entry whose nodes lead those of paired faces that a statement holds: its number; of these X (n, 3) [length],
    how they follow as in Follower, and how far they are ahead, t -> (n, 3) [length], which all ranks call."""

    statement: int
    X: Floats
    turn: Floats
    ahead: Floats
    offset: Callable[[float], Floats]


class Entry(NamedTuple):
    """Displacement of local nodes (n,), ghosts included, along a unit direction (3,): a function of t that gives (n,) and
    that all ranks call [length]; carried: for which nodes they stand."""

    nodes: Ints
    direction: Floats
    value: Prescribed
    carried: Carried | None = None


class Hindered(NamedTuple):
    """A support of local nodes (n,) that are tied to a body, which it must not hinder: its name, unit direction (3,) and
    what it prescribes of them."""

    name: str
    nodes: Ints64
    direction: Floats
    value: Prescribed


class Entries:
    """All Entry of a scene's supports, with names, and the Hindered ones.

    Of all entries' nodes, one after the other: nodes (n,) their local numbers, entry (n,) whose they are; parted: those of
    each entry; directions (entries, 3).
    """

    def __init__(self, entries: Sequence[Entry], names: Sequence[str], hindered: Sequence[Hindered] = ()) -> None:
        self.all, self.names, self._hindered = entries, names, hindered
        self.parted: list[Ints64] = [np.asarray(entry.nodes, dtype=np.int64) for entry in entries]
        self.nodes: Ints64 = _joined(self.parted, np.int64)
        self.entry = np.repeat(np.arange(len(entries)), [len(nodes) for nodes in self.parted])
        self.directions: Floats = np.array([entry.direction for entry in entries], dtype=float).reshape(-1, 3)

    def _named(self) -> Iterator[tuple[Entry, str]]:
        return zip(self.all, self.names, strict=True)

    def values(self, t: float) -> Floats:
        """Displacements (n,) of all nodes at t [length]. Collective."""
        return _joined([entry.value(t) for entry in self.all], float)

    def split(self, values: Floats) -> list[Floats]:
        """Of values (n,) those of each entry."""
        return np.split(values, np.cumsum([len(nodes) for nodes in self.parted]))[:-1]

    def sampled(self, times: Iterable[float]) -> dict[str, list[float]]:
        """{name: what the stage that is on prescribes [length] at these t, by a function at a few points}. Collective."""
        out: dict[str, list[float]] = {}
        for (_, _, value, _), name in self._named():
            at = [value.few(t) for t in times]
            out[name] = out.get(name, []) + [float(x) for x in np.concatenate(at)]
        return out

    def largest(self, t: float) -> list[tuple[str, float]]:
        """[(name, largest displacement [length] on this rank)] of all entries at t."""
        parts = self.split(np.abs(self.values(t)))
        return [(name, float(part.max(initial=0.0))) for name, part in zip(self.names, parts, strict=True)]

    def jumps(self) -> list[tuple[str, float]]:
        """[(name, largest step [length] on this rank)] of all entries at the very start of the stage. Collective."""
        return [(name, value.jump()) for (_, _, value, _), name in self._named()]

    def begin(self, u: Floats, before: Mapping[str, Sequence[float]]) -> None:
        """Start from a displacement u (local array) of another run; before: {name: what its scene said}. Collective."""
        for (nodes, direction, value, _), name in self._named():
            value.begin(u.reshape(-1, 3)[nodes] @ direction, before.get(name, ()))
        for name, tied, direction, value in self._hindered:
            value.begin(u.reshape(-1, 3)[tied] @ direction, before.get(name, ()))

    def said(self) -> dict[str, list[float]]:
        """{name: what the scene states of it}. Collective."""
        return {name: value.said() for (_, _, value, _), name in self._named()}


def _joined(parts: Sequence[Array], kind: type) -> Array:
    return np.concatenate([np.empty(0, dtype=kind), *parts])
