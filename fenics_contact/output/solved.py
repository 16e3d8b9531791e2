"""What the output takes of a scene: its mesh with names, its bodies, the slave surfaces of its contacts, its units."""

from collections.abc import Sequence
from typing import Protocol

from fenics_contact.output.units import Units
from fenics_contact.solid.body import Body, NamedCells
from fenics_contact.types import Measure, Space


class Touching(Protocol):
    @property
    def slave(self) -> tuple[str, ...]: ...


class Solved(Protocol):
    @property
    def mesh(self) -> NamedCells: ...

    @property
    def space(self) -> Space: ...

    @property
    def degree(self) -> int: ...

    @property
    def units(self) -> Units: ...

    @property
    def bodies(self) -> Sequence[Body]: ...

    @property
    def contacts(self) -> Sequence[Touching]: ...

    def ds(self, group: Sequence[str]) -> Measure: ...
