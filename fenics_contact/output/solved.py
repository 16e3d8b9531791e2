"""What the output takes of a scene: its mesh with names, its bodies, tools and slave surfaces, its units."""

from collections.abc import Sequence
from typing import Protocol

from fenics_contact.contact.tools import Tool
from fenics_contact.output.units import Units
from fenics_contact.solid.body import Body, NamedCells
from fenics_contact.types import Ints, Measure, Space


class NamedParts(NamedCells, Protocol):
    def facets(self, *names: str) -> Ints: ...


class Touching(Protocol):
    @property
    def name(self) -> str: ...

    @property
    def slave(self) -> tuple[str, ...]: ...


class Held(Protocol):
    @property
    def group(self) -> tuple[str, ...]: ...

    @property
    def axis(self) -> int: ...


class Solved(Protocol):
    @property
    def mesh(self) -> NamedParts: ...

    @property
    def space(self) -> Space: ...

    @property
    def degree(self) -> int: ...

    @property
    def units(self) -> Units: ...

    @property
    def bodies(self) -> Sequence[Body]: ...

    @property
    def tools(self) -> Sequence[Tool]: ...

    @property
    def contacts(self) -> Sequence[Touching]: ...

    @property
    def supports(self) -> Sequence[Held]: ...

    def ds(self, group: Sequence[str]) -> Measure: ...
