"""What a scene is stated with, checked and then never changed: bodies, supports, loads, contacts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fenics_contact.contact.friction import Friction
from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import Tool
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.solid.materials import Hyperelastic, Isotropic
from fenics_contact.types import Floats, Ints
from fenics_contact.values import SceneError, shown, text


@dataclass(frozen=True)
class Body:
    """A named volume of a mesh and the strain energy of its material."""

    mesh: NamedMesh
    group: str
    material: Isotropic | Hyperelastic

    def __post_init__(self) -> None:
        text(self.group, "body: its volume group")
        if not isinstance(self.mesh, NamedMesh):
            raise SceneError(f"body '{self.group}': its mesh must be one that read_gmsh gave, not {shown(self.mesh)}")
        if not isinstance(self.material, Isotropic | Hyperelastic):
            raise SceneError(
                f"body '{self.group}': its material must be a law with its moduli, e.g. neo_hooke(mu, K), not "
                f"{shown(self.material)}"
            )


@dataclass(frozen=True)
class ContactStatement:
    """A contact as stated: master is a tool, or the surfaces of a body."""

    name: str
    slave: tuple[str, ...]
    master: Tool | tuple[str, ...]
    friction: Friction
    penalty: Penalty
    points: int | str
    penetration: float | None


@dataclass(frozen=True)
class Support:
    """Displacement of groups along a unit direction: a number reached at t = 1 [length], or a function value(X, t)."""

    group: tuple[str, ...]
    direction: tuple[float, ...]
    value: float | Callable[[Floats, float], Any]

    @property
    def axis(self) -> int | None:
        """0 ... 2 where the direction is that of x, y or z, else None."""
        return self.direction.index(1.0) if sorted(self.direction) == [0.0, 0.0, 1.0] else None

    @property
    def name(self) -> str:
        """What messages call it."""
        along = "(" + ", ".join(f"{part:.6g}" for part in self.direction) + ")" if self.axis is None else "xyz"[self.axis]
        return f"{'+'.join(self.group)} along {along}"


@dataclass(frozen=True)
class Tie:
    """Surfaces that move as a part of a rigid body."""

    group: tuple[str, ...]
    hub: Tool


@dataclass(frozen=True)
class Load:
    """A dead traction on surfaces [pressure], a pressure that follows them, or, without surfaces, a force on all bodies
    [force/length^3]: path(t), one value, or those at local nodes (n,). kind: what messages call a dead load."""

    group: tuple[str, ...] | None
    path: Callable[[float], Floats]
    nodes: Ints | None = None
    kind: str = "traction"


@dataclass(frozen=True)
class Entering:
    """Pressure of a fluid on surfaces, where contact does not press: path(t) as of a Load; source: the surfaces from whose
    common nodes with `group` it comes in, None: it is everywhere."""

    group: tuple[str, ...]
    path: Callable[[float], Floats]
    nodes: Ints | None
    source: tuple[str, ...] | None
