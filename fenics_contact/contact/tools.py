"""Rigid tools, analytic or meshed: what the user states, checked, and what the kernels need of it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.kernels import rigid_shapes
from fenics_contact.types import Floats, Ints64
from fenics_contact.values import SceneError, finite, positive, text

LYING = 1e-9  # of an axis' part: the rest is round-off
ROUND = {
    rigid_shapes.SPHERE: "ball",
    rigid_shapes.CYLINDER: "cylinder",
    rigid_shapes.CONE: "cone",
    rigid_shapes.TORUS: "torus",
    rigid_shapes.REVOLUTION: "profile of revolution",
}


@dataclass(frozen=True, eq=False)
class Tool(ABC):
    """A rigid body without dofs; scenes move it along a path or push it with a force."""

    name: str

    def __post_init__(self) -> None:
        text(self.name, "name of a rigid tool")

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest length of which gaps are differences [length]."""

    @property
    @abstractmethod
    def point(self) -> Floats:
        """The point (3,) of the tool, at the start, about which moments on it are taken [length]."""


class Slits(NamedTuple):
    """Ends of a meshed tool's facets that nearly meet: how many corners lie beside an edge, and of the one that is farthest
    from it its place (3,) and how far that is [length]."""

    corners: int
    place: Floats
    width: float

    @property
    def told(self) -> str:
        """In words."""
        corners = f"{self.corners} corners lie" if self.corners > 1 else "1 corner lies"
        return f"{corners} beside an edge of others, the farthest at {spot(self.place)}, off by {self.width:.2g}"


@dataclass(frozen=True, eq=False)
class MeshedTool(Tool):
    """A rigid tool given by facets that are counter-clockwise seen from outside it, so that normals point at the body.

    nodes (nf, 4): rows of X (a triangle repeats its third), size (nf,): corners of each facet; X (nm, 3) [length]; is_curve:
    its facets stand for the sides of a curve in a plane scene; left_out: how many facets of its file have no area; slits:
    where its facets nearly meet, if anywhere.
    """

    nodes: Ints64
    size: Ints64
    X: Floats
    is_curve: bool = False
    left_out: int = 0
    slits: Slits | None = None

    @property
    def reach(self) -> float:
        """Largest length of which gaps are differences [length]."""
        return float(np.abs(self.X).max())

    @property
    def point(self) -> Floats:
        """The centroid (3,) of its facets [length]."""
        corners = self.X[self.nodes]
        first, second, third = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
        halves = np.linalg.norm([np.cross(first, second), np.cross(second, third)], axis=2)  # areas, doubled
        middles = (corners[:, 0] + corners[:, 2])[None] + corners[:, [1, 3]].transpose(1, 0, 2)
        return np.einsum("hf,hfc->c", halves, middles) / (3.0 * halves.sum())


@dataclass(frozen=True, eq=False)
class RigidTool(Tool):
    """An analytic rigid tool.

    kind, shape: the kernel's code and numbers of the shape, as many as the kind takes; axes (3, 3): columns are the tool's
    axes; origin (3,): its frame's place at the start [length]; extent: largest length of its shape; edge_kind: what the
    output says of its edges.
    """

    kind: int
    shape: Floats
    axes: Floats
    origin: Floats
    extent: float = 0.0
    edge_kind: str = "none"

    @property
    def flat(self) -> bool:
        """Whether it is a plane."""
        return self.kind == rigid_shapes.PLANE

    @property
    def sharp(self) -> bool:
        """Whether it is a punch whose flat faces hold points beyond its sharp edges, too."""
        return bool(rigid_shapes.ends_sharply(self.kind, self.shape))

    @property
    def profiled(self) -> bool:
        """Whether it is a profile, whose points go one way or the other."""
        return self.kind in (rigid_shapes.EXTRUSION, rigid_shapes.REVOLUTION)

    @property
    def whole(self) -> bool:
        """Whether it ends by itself all round: of planes, profiles and unions half of a tool may be stated, and more."""
        return not (self.flat or self.profiled or self.kind == rigid_shapes.UNION)

    @property
    def solid(self) -> bool:
        """Whether it is a ball or a cylinder, and not all around one."""
        return self.kind in (rigid_shapes.SPHERE, rigid_shapes.CYLINDER) and self.shape[0] > 0.0

    @property
    def reach(self) -> float:
        """Largest length of which gaps are differences [length]."""
        return float(max(np.abs(self.origin).max(), self.extent))

    @property
    def point(self) -> Floats:
        """The point, centre or apex (3,) it was stated with; of a punch the centre of its face [length]."""
        return self.origin + (self.shape[2] * self.axes[:, 2] if self.kind == rigid_shapes.BOX else 0.0)


@dataclass(frozen=True, eq=False)
class Hub(Tool):
    """A rigid body without a shape, to which surfaces are tied. place (3,): its point at the start [length]."""

    place: Floats

    @property
    def reach(self) -> float:
        """Zero: it has no gaps [length]."""
        return 0.0

    @property
    def point(self) -> Floats:
        """The point (3,) that it was stated with [length]."""
        return self.place


def rigid_hub(name: str, point: Sequence[float] | Floats = (0.0, 0.0, 0.0)) -> Hub:
    """Rigid body without a shape: what `Scene.tie` ties to it moves with it. name: of its columns; point: its reference
    point at the start [length]."""
    return Hub(text(name, "name of a rigid hub"), finite(point, f"{name}: point", (3,)))


def axes_along(third: object, what: str) -> Floats:
    """Right-handed orthonormal axes whose third is along `third`, aligned with x, y, z where that is possible."""
    third = finite(third, what, (3,))
    length = np.linalg.norm(third)
    if length == 0.0:
        raise SceneError(f"{what} must not be the zero vector")
    third = third / length
    helper = np.eye(3)[0] if abs(third[0]) < 0.9 else np.eye(3)[1]
    second = np.cross(third, helper)
    second /= np.linalg.norm(second)
    return np.column_stack([np.cross(second, third), second, third])


def _length(value: object, what: str, zero: bool = False) -> float:
    return float(positive(value, what, zero=zero, more=", a length"))


def rigid_plane(
    point: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    normal: Sequence[float] | Floats = (0.0, 0.0, 1.0),
    name: str = "plane",
) -> RigidTool:
    """Half-space behind a plane.

    point: of the plane [length]; normal: of any length, out of the tool, at the body; name: of the tool and its columns.
    """
    axes = axes_along(normal, f"{name}: normal")
    return RigidTool(name, rigid_shapes.PLANE, np.zeros(4), axes, finite(point, f"{name}: point", (3,)))


def rigid_punch(
    half_width: float,
    height: float,
    face: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    *,
    half_depth: float | None = None,
    direction: Sequence[float] | Floats = (0.0, 0.0, -1.0),
    fillet: float = 0.0,
    name: str = "punch",
) -> RigidTool:
    """Flat rectangular punch, all sizes lengths.

    half_width: half of its width, along x of a punch along z, in the plane of a plane scene; height: of its sides; face: the
    centre of its flat face; half_depth: half of its depth, across, by default as its width; direction: out of the face, at
    the body; fillet: radius of all edges, 0 for sharp ones.
    """
    half = _length(half_width, f"{name}: half_width")
    depth = half if half_depth is None else _length(half_depth, f"{name}: half_depth")
    tall = _length(height, f"{name}: height") / 2
    fillet = _length(fillet, f"{name}: fillet", zero=True)
    if fillet > min(half, depth, tall):
        raise SceneError(f"{name}: a fillet of {fillet} does not fit half sizes {half}, {depth}, {tall}; make it smaller")
    axes = axes_along(direction, f"{name}: direction")
    origin = finite(face, f"{name}: face", (3,)) - tall * axes[:, 2]
    edge_kind = f"filleted, radius {fillet:g}" if fillet > 0 else "sharp"
    shape = np.array([half, depth, tall, fillet])
    return RigidTool(name, rigid_shapes.BOX, shape, axes, origin, max(half, depth, tall), edge_kind)


def _round(radius: float, hollow: bool, name: str) -> tuple[Floats, float]:
    """(kernel's numbers, radius) of a ball or cylinder."""
    length = _length(radius, f"{name}: radius")
    if not isinstance(hollow, bool):
        raise SceneError(f"{name}: hollow = {hollow!r} must be True, where the body lies within, or False")
    return np.array([-length if hollow else length]), length


def rigid_sphere(radius: float, centre: Sequence[float] | Floats, hollow: bool = False, name: str = "sphere") -> RigidTool:
    """Ball. radius, centre: of the ball [length]; hollow: the tool is all around it, and the body lies in the hollow."""
    shape, extent = _round(radius, hollow, name)
    return RigidTool(name, rigid_shapes.SPHERE, shape, np.eye(3), finite(centre, f"{name}: centre", (3,)), extent)


def rigid_cylinder(
    radius: float,
    point: Sequence[float] | Floats,
    axis: Sequence[float] | Floats = (0.0, 1.0, 0.0),
    hollow: bool = False,
    name: str = "cylinder",
) -> RigidTool:
    """Circular cylinder without end.

    radius: of the cylinder [length]; point, axis: a point on its axis, and the direction of that; hollow: the tool is all
    around it, and the body lies in the bore.
    """
    shape, extent = _round(radius, hollow, name)
    axes = axes_along(axis, f"{name}: axis")
    return RigidTool(name, rigid_shapes.CYLINDER, shape, axes, finite(point, f"{name}: point", (3,)), extent)


def rigid_torus(
    ring: float,
    tube: float,
    centre: Sequence[float] | Floats,
    axis: Sequence[float] | Floats = (0.0, 0.0, 1.0),
    name: str = "torus",
) -> RigidTool:
    """Ring of round section. ring: radius of the circle in the middle of the section [length]; tube: radius of the section,
    smaller than that; centre, axis: of the ring."""
    ring, tube = _length(ring, f"{name}: ring"), _length(tube, f"{name}: tube")
    if not tube < ring:
        raise SceneError(f"{name}: a tube of radius {tube} closes a ring of radius {ring}; make it smaller")
    axes, shape = axes_along(axis, f"{name}: axis"), np.array([ring, tube])
    return RigidTool(name, rigid_shapes.TORUS, shape, axes, finite(centre, f"{name}: centre", (3,)), ring + tube)


def rigid_cone(
    half_angle: float,
    apex: Sequence[float] | Floats,
    direction: Sequence[float] | Floats = (0.0, 0.0, -1.0),
    tip: float = 0.0,
    name: str = "cone",
) -> RigidTool:
    """Circular cone without end.

    half_angle: between its axis and its side [radians]; apex: its point [length]; direction: out of the apex, at
    the body; tip: radius of the ball that rounds its end [length]; 0 is a sharp apex, which a point of the body straight
    before it meets along the axis.
    """
    half_angle = float(positive(half_angle, f"{name}: half_angle", most=np.pi / 2, more=", in radians"))
    tip = _length(tip, f"{name}: tip", zero=True)
    shape = np.array([tip, np.cos(half_angle), np.sin(half_angle), 0.0])
    axes, edge_kind = (
        axes_along(direction, f"{name}: direction"),
        f"rounded tip, radius {tip:g}" if tip > 0 else "sharp apex",
    )
    return RigidTool(name, rigid_shapes.CONE, shape, axes, finite(apex, f"{name}: apex", (3,)), tip, edge_kind)


def rigid_union(*tools: RigidTool, name: str = "union") -> RigidTool:
    """Several analytic tools that move as one, each where it was stated; its point is that of the first.

    A point meets the nearest of them: where two meet in a corner into which the body is pressed, one alone would hold it.
    State a profile with a fillet there, or two tools.
    """
    if len(tools) < 2 or not all(isinstance(tool, RigidTool) for tool in tools):
        raise SceneError(f"{name}: a union is made of two or more analytic tools, rigid_union(rigid_plane(...), ...)")
    for tool in tools:
        if tool.edge_kind == "sharp":
            raise SceneError(f"{name}: the sharp edges of '{tool.name}' cannot be in a union; give it a fillet")
        if tool.kind == rigid_shapes.UNION:
            raise SceneError(f"{name}: '{tool.name}' is a union itself; name its parts instead")
    origin = tools[0].point
    parts = [
        np.concatenate([[tool.kind, len(tool.shape)], tool.origin - origin, tool.axes.ravel(), tool.shape]) for tool in tools
    ]
    edges = dict.fromkeys(tool.edge_kind for tool in tools if tool.edge_kind != "none")
    reach = max(tool.reach for tool in tools)
    return RigidTool(name, rigid_shapes.UNION, np.concatenate(parts), np.eye(3), origin, reach, ", ".join(edges) or "none")


def cut_shapes(tool: RigidTool, section: Section) -> list[str]:
    """Names of a tool's shapes that neither go on along z nor, all the way round, turn about y: a plane mesh meets their cut
    alone. Planes, punches, extrusions and cylinders along z are read as what they are in the plane."""
    found = []
    for part in parts_of(tool):
        along_z = part.kind == rigid_shapes.CYLINDER and abs(part.axes[2, 2]) > 1.0 - LYING
        about_y = part.kind == rigid_shapes.SPHERE or abs(part.axes[1, 2]) > 1.0 - LYING
        on_axis = section.axisymmetric and about_y and abs(part.origin[0]) <= ON_AXIS * part.reach
        if part.kind in ROUND and not (along_z or on_axis):
            found.append(ROUND[part.kind])
    return list(dict.fromkeys(found))


def parts_of(tool: RigidTool) -> list[RigidTool]:
    """The parts of a union, where they are at the start; of other tools the tool itself."""
    if tool.kind != rigid_shapes.UNION:
        return [tool]
    parts, left = [], tool.shape
    while len(left):
        end = rigid_shapes.PART + int(left[1])
        shape, axes, place = left[rigid_shapes.PART : end], left[5 : rigid_shapes.PART].reshape(3, 3), left[2:5]
        parts.append(RigidTool(tool.name, int(left[0]), shape, axes, tool.origin + place))
        left = left[end:]
    return parts
