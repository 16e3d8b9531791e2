"""What the solid takes of a scene: a body's volume and material, and the cells of a mesh by the names of volumes."""

from typing import Protocol

from mpi4py import MPI

from fenics_contact.solid.materials import Material
from fenics_contact.types import Mesh, Tags


class Body(Protocol):
    @property
    def group(self) -> str: ...

    @property
    def material(self) -> Material: ...


class NamedCells(Protocol):
    @property
    def comm(self) -> MPI.Comm: ...

    @property
    def domain(self) -> Mesh: ...

    @property
    def cell_tags(self) -> Tags: ...

    def volume_tag(self, name: str) -> int: ...
