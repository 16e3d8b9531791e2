"""What the output takes of a scene: its mesh with names, its bodies, supports, contacts and tools, its units."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from fenics_contact.assembly.section import Section
from fenics_contact.contact.tools import Tool
from fenics_contact.output.units import Units
from fenics_contact.solid.body import Body, NamedCells
from fenics_contact.types import Floats, Ints, Space


class Touching(Protocol):
    @property
    def name(self) -> str: ...

    @property
    def slave(self) -> tuple[str, ...]: ...

    @property
    def master(self) -> Tool | tuple[str, ...]: ...


class Held(Protocol):
    @property
    def group(self) -> tuple[str, ...]: ...

    @property
    def axis(self) -> int | None: ...

    @property
    def direction(self) -> tuple[float, ...]: ...

    @property
    def value(self) -> float | Callable[[Floats, float], Any]: ...


class Led(Protocol):
    @property
    def column(self) -> str: ...


class NamedFacets(NamedCells, Protocol):
    @property
    def surfaces(self) -> Mapping[str, tuple[int, ...]]: ...

    def facets(self, *names: str) -> Ints: ...

    def refuse_inside(self, facets: Ints, what: str) -> None: ...

    def nodes(self, space: Space, *names: str) -> Ints: ...


class Solved(Protocol):
    @property
    def mesh(self) -> NamedFacets: ...

    @property
    def space(self) -> Space: ...

    @property
    def degree(self) -> int: ...

    @property
    def section(self) -> Section | None: ...

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

    @property
    def pairs(self) -> Sequence[Led]: ...
