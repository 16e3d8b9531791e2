"""What a scene is stated with, checked and then never changed: bodies, supports, loads, contacts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fenics_contact.contact.friction import Friction
from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.tools import Tool
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.scene.functions import Path, Ramp
from fenics_contact.solid.materials import Hyperelastic, Isotropic
from fenics_contact.types import Floats, Ints
from fenics_contact.values import SceneError, shown, text


@dataclass(frozen=True)
class Body:
    """A part of the mesh and its material.

    mesh: what `read_gmsh` gave; group: name of a group of volumes, in a plane mesh of surfaces; material: its law.
    """

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
class FacePair:
    """Two faces of which the second moves as the first one does: by way(t) (3,) further, or turned about the unit axis (3,)
    through a point."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    way: Path
    axis: Floats | None = None
    point: Floats | None = None

    @property
    def name(self) -> str:
        return f"'{'+'.join(self.first)}' - '{'+'.join(self.second)}'"

    @property
    def driven(self) -> bool:
        """Whether the second face goes further at all."""
        return not isinstance(self.way, Ramp) or bool(self.way.end.any())

    @property
    def column(self) -> str:
        """What columns call it."""
        return f"{'+'.join(self.first)}_{'+'.join(self.second)}_pair"

    @property
    def across(self) -> list[Floats]:
        """Two unit vectors (3,) square to the axis."""
        vectors = np.linalg.svd(np.array([self.axis], dtype=float))[2][1:]
        return [np.where(np.abs(v) < 1e-12, 0.0, v) for v in vectors]

    @property
    def what(self) -> str:
        """What messages call it."""
        return f"{'periodic' if self.axis is None else 'cyclic'} pair {self.name}"


# words by which stages name the loads of a scene, and what messages call these
LOADS = {"tractions": "traction on", "forces": "force on", "pressures": "pressure on", "moments": "moment on",
         "swell": "swelling of", "body_force": "body force", "spin": "speed of the spin"}  # fmt: skip


def called(word: str, group: tuple[str, ...] | None) -> str:
    """What messages call a load."""
    return LOADS[word] + (f" '{'+'.join(group)}'" if group else "")


@dataclass(frozen=True)
class StatedLoad:
    """A dead traction on surfaces [pressure], a pressure that follows them, or, without surfaces, a force on all bodies
    [force/length^3]: path(t), one value, or those at local nodes (n,), over the number `over`, a force's area; word: of
    LOADS."""

    word: str
    group: tuple[str, ...] | None
    path: Path
    nodes: Ints | None = None
    over: float = 1.0

    @property
    def shape(self) -> tuple[int, ...]:
        return () if self.word == "pressures" else (3,)


@dataclass(frozen=True)
class StatedFluid:
    """Pressure of a fluid on surfaces, where contact does not press: path(t) as of a StatedLoad; source: the surfaces from
    whose common nodes with `group` it comes in, None: it is everywhere."""

    word: ClassVar[str] = "pressures"
    shape: ClassVar[tuple[int, ...]] = ()
    group: tuple[str, ...]
    path: Path
    nodes: Ints | None
    source: tuple[str, ...] | None


@dataclass(frozen=True)
class MomentLoad:
    """A moment path(t) on a surface [force length]."""

    word: ClassVar[str] = "moments"
    shape: ClassVar[tuple[int, ...]] = (3,)
    group: tuple[str, ...]
    path: Path


@dataclass(frozen=True)
class Spin:
    """All bodies turn about an axis: speed path(t) [angle/time], point and unit axis (3,), density by volume
    [mass/length^3]."""

    word: ClassVar[str] = "spin"
    shape: ClassVar[tuple[int, ...]] = ()
    group: ClassVar[None] = None
    path: Path
    axis: tuple[float, ...]
    point: Floats
    density: Mapping[str, float]


@dataclass(frozen=True)
class Swelling:
    """A body's volume without stress over that at the start, path(t), as of a StatedLoad; of a number, from 1 to there."""

    word: ClassVar[str] = "swell"
    shape: ClassVar[tuple[int, ...]] = ()
    group: tuple[str, ...]
    path: Path
    nodes: Ints | None


Loading = StatedLoad | StatedFluid | MomentLoad | Spin | Swelling
