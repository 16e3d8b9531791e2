"""Loads that depend on where the bodies are or on what they are made of: spin, swelling, springs to the ground."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import ufl

from fenics_contact import compat
from fenics_contact.assembly.moment import Moment
from fenics_contact.assembly.term import FormTerm
from fenics_contact.scene.directions import Group, Unit, chosen, normals, unit
from fenics_contact.scene.functions import AtPoints, Drive, Path, Place, Ramp, load_path, ramp, whole
from fenics_contact.scene.statements import Body, Loading, MomentLoad, Spin, Swelling
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.materials import Material, swollen
from fenics_contact.types import Constant, Expr, Floats, Function, Ints, Measure
from fenics_contact.values import SceneError, finite, group_names, positive, quoted, shown

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene


@dataclass(frozen=True)
class Spring:
    """Springs from a surface to the ground, `stiffness` in all [force/length], along one direction or, with None, all."""

    group: tuple[str, ...]
    stiffness: float
    direction: Unit | None


@dataclass(frozen=True)
class FieldLoads:
    """What a scene's statements of these come to.

    materials: by volume, swollen where that is stated; terms: of spin, springs and moments; grounds: local nodes that
    springs hold, and (3, 3) the sum of d d^T over their directions; set(t): puts the loads of t into the terms.
    """

    materials: Mapping[str, Material]
    terms: list[FormTerm]
    grounds: list[tuple[Ints, Floats]]
    set: Callable[[float], None]


# -- statements, checked ----------------------------------------------------------------------------------------------
def spin_of(scene: "Scene", speed: Drive, density: object, axis: Sequence[float], point: Sequence[float]) -> Spin:
    """A stated Spin. Collective."""
    groups = [body.group for body in scene.bodies]
    if isinstance(density, Mapping):
        if unknown := [name for name in density if name not in groups]:
            raise SceneError(f"spin: density of {shown(unknown[0])}, but the bodies are {', '.join(groups)}")
        if left := [name for name in groups if name not in density]:
            raise SceneError(f"spin: body '{left[0]}' has no density; give one, 0 for a body without mass")
        stated = dict(density)
    else:
        stated = dict.fromkeys(groups, density)
    for name, value in stated.items():
        positive(value, f"spin: density of '{name}'", zero=True)
    if not any(stated.values()):
        raise SceneError("spin: no body has a density above zero; give density=, a number or {volume: number}")
    path = ramp(scene.mesh.comm, speed, "speed of the spin", ())
    about, through = unit(axis, "spin: axis"), finite(point, "spin: point", (3,))
    if scene.section is not None:
        along, word = (1, "y, the axis of the section") if scene.section.axisymmetric else (2, "z, across the plane")
        if abs(about[along]) < 1.0 or (scene.section.axisymmetric and through[0] != 0.0):
            raise SceneError(f"spin: in this plane scene bodies can turn about {word}, alone; give axis= and point= so")
    return Spin(path, about, through, stated)


def swelling_of(scene: "Scene", body: Body | str, ratio: Drive | Place) -> Swelling:
    """A stated Swelling. Collective."""
    name = body.group if isinstance(body, Body) else body
    if name not in [one.group for one in scene.bodies]:
        known = ", ".join(one.group for one in scene.bodies)
        raise SceneError(f"swell: {shown(name)} is no body of the scene; its bodies are {known}")
    if (name,) in [one.group for one in scene.loads if isinstance(one, Swelling)]:
        raise SceneError(f"swell '{name}': it swells already; give one function for both")
    what = f"swelling of '{name}'"
    path, nodes = swelling_path(scene, name, ratio, what)
    if not isinstance(path, Ramp):
        start = np.atleast_1d(whole(path, 0.0))
        if abs(off := start[np.abs(start - 1.0).argmax()] - 1.0) > 1e-12:  # rounding of a function
            raise SceneError(f"{what} is {1.0 + off:g} at t = 0, where all is at rest; let its function start from 1")
    return Swelling((name,), path, nodes)


def swelling_path(scene: "Scene", body: str, ratio: Drive | Place, what: str) -> tuple[Path, Ints | None]:
    """The ratio reached, or a function of t or of (X, t), which is asked for positive numbers, and the local nodes that it
    gives values at, if it is one of places. Collective."""
    more = ", the volume without stress over that at the start"
    if not callable(ratio):
        return Ramp(np.array(float(positive(ratio, what, more=more)))), None
    mesh = scene.mesh
    cells = mesh.cell_tags.indices[mesh.cell_tags.values == mesh.volume_tag(body)]
    path, nodes = load_path(scene.space, cells, ratio, what, (), mesh.domain.topology.dim)

    def checked(value: Floats, t: float) -> Floats:
        positive(float(np.min(value)), f"{what} at t = {t:g}", more=more)
        return value

    if isinstance(path, AtPoints):
        return path.under(checked), nodes
    return lambda t: checked(path(t), t), None


def springs_of(
    scene: "Scene", group: Group, stiffness: float, direction: Sequence[float] | None, normal: bool
) -> list[Spring]:
    """Stated Springs: several where several surfaces have normals of their own. Collective."""
    what = f"spring on {quoted(group)}"
    positive(stiffness, f"{what}: stiffness", more=" [force/length]")
    chosen(None, direction, normal, what)
    names = group_names(group)
    if direction is not None:
        along = unit(direction, what)
        if scene.section is not None and along[2] != 0.0:
            raise SceneError(f"{what} along z: nothing moves out of a plane mesh; give a direction in the plane")
        return [Spring(names, float(stiffness), along)]
    if not normal:
        return [Spring(names, float(stiffness), None)]
    ways, whole = normals(scene.mesh, scene.space, group, what), scene.groups.area(names)
    return [Spring(of, float(stiffness) * scene.groups.area(of) / whole, along) for of, along in ways]


# -- forms ------------------------------------------------------------------------------------------------------------
def field_loads(scene: "Scene", u: Function, loads: Sequence[Loading]) -> FieldLoads:
    """FieldLoads of a scene's statements; loads: as they go over the stages. Collective."""
    domain, v, du = scene.mesh.domain, ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space)
    materials: dict[str, Material] = {body.group: body.material for body in scene.bodies}
    followed: list[tuple[Constant, Path]] = []
    placed: list[tuple[Function, Ints, Path]] = []
    for swelling in (one for one in loads if isinstance(one, Swelling)):
        ratio, (group,) = _ratio(scene, swelling), swelling.group
        materials[group] = swollen(materials[group], ratio)
        if swelling.nodes is None:
            followed.append((ratio, swelling.path))
        else:
            placed.append((ratio, swelling.nodes, swelling.path))
    terms: list[FormTerm] = []
    for spin in (one for one in loads if isinstance(one, Spin)):
        parts, weights = _spin(scene, spin)
        followed += weights
        arm = vp.place(domain) + u - compat.Constant(domain, spin.point)
        terms.append(_term("spin", [(weight, across, arm, du, dx) for weight, across, dx in parts], v, -1.0))
    if scene.springs:
        parts = [_spring(scene, spring) for spring in scene.springs]
        terms.append(_term("springs", [(weight, along, u, du, ds) for weight, along, ds in parts], v, 1.0))
    moments = [(_moment(scene, stated), stated.path) for stated in loads if isinstance(stated, MomentLoad)]
    terms += [term for term, _ in moments]
    grounds = [(scene.mesh.nodes(scene.space, *spring.group), _directions(spring)) for spring in scene.springs]

    def set_loads(t: float) -> None:
        for constant, path in followed:
            constant.value = float(path(t))
        for function, nodes, path in placed:
            function.x.array[nodes] = path(t)
        for term, path in moments:
            term.set_moment(path(t))

    return FieldLoads(materials, terms, grounds, set_loads)


def _ratio(scene: "Scene", swelling: Swelling) -> Constant | Function:
    """What stands for a ratio in the forms: one number, or those at nodes, 1 at the start and off the body."""
    if swelling.nodes is None:
        return compat.Constant(scene.mesh.domain, 1.0)
    ratio = compat.Function(compat.lagrange_space(scene.mesh.domain, scene.degree))
    ratio.x.array[:] = 1.0
    return ratio


def _directions(spring: Spring) -> Floats:
    """Sum (3, 3) of d d^T over the directions d of a spring."""
    return np.eye(3) if spring.direction is None else np.outer(spring.direction, spring.direction)


def _moment(scene: "Scene", stated: MomentLoad) -> Moment:
    nodes, facets = scene.mesh.nodes(scene.space, *stated.group), scene.mesh.facets(*stated.group)
    return Moment(f"moment on '{'+'.join(stated.group)}'", scene.space, nodes, facets)


Weighted = tuple[Constant, Constant, Measure]  # weight, projector, over what


def _spin(scene: "Scene", spin: Spin) -> tuple[list[Weighted], list[tuple[Constant, Path]]]:
    """Of every body with a mass its weight, and what the weights follow."""
    domain = scene.mesh.domain
    across = compat.Constant(domain, np.eye(3) - np.outer(spin.axis, spin.axis))
    parts: list[Weighted] = []
    followed: list[tuple[Constant, Path]] = []
    for body in scene.bodies:
        if density := spin.density[body.group]:
            weight = compat.Constant(domain, 0.0)
            parts.append((weight, across, scene.groups.dx(body)))
            followed.append((weight, partial(_force_over_arm, spin.path, density)))
    return parts, followed


def _force_over_arm(speed: Path, density: float, t: float) -> Floats:
    return density * speed(t) ** 2


def _spring(scene: "Scene", spring: Spring) -> Weighted:
    domain, weight = scene.mesh.domain, spring.stiffness / scene.groups.area(spring.group)
    return compat.Constant(domain, weight), compat.Constant(domain, _directions(spring)), scene.groups.ds(spring.group)


def _term(name: str, parts: list[tuple[Constant, Constant, Expr, Expr, Measure]], v: Expr, sign: float) -> FormTerm:
    """The term of forces against (sign 1) or along (-1) what parts (weight, projector, moved, its rate, dx) say.

    Constants and not numbers, from which FFCx 0.5 makes no kernel here, and which would make one for every value."""
    power = sum(vp.projected_power(sign * weight, along, moved, v, dx) for weight, along, moved, _, dx in parts)
    rate = sum(vp.projected_power(sign * weight, along, moved, v, dx) for weight, along, _, moved, dx in parts)
    return FormTerm(name, power, rate)
