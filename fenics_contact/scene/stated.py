"""What a scene states of its parts, as plain values by name, and where two such statements differ."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.assembly.system import System
from fenics_contact.scene.statements import Spin, StatedFluid
from fenics_contact.solid.materials import sampled_energy

if TYPE_CHECKING:  # which is built from what begins with these
    from fenics_contact.scene.scene import Scene

SAME = 1e-9  # of the largest value of its name: nodes moved between ranks are rounded by 1e-16
LISTED = 16  # a longer array, e.g. a tool's mesh, is known by sums

Statement = dict[str, Any]  # texts, numbers or lists of these


def parts_of(scene: "Scene", system: System) -> Statement:
    """{name: text, number or list of these} of bodies, ties, pairs, supports, springs, fluids, tools and contacts, whatever
    drives them. Collective."""
    out: Statement = {}
    for body in scene.bodies:
        out[f"material of '{body.group}'"] = body.material.name
        out[f"energy of '{body.group}'"] = sampled_energy(body.material)
    out["ties"] = [f"{'+'.join(tie.group)} to '{tie.hub.name}'" for tie in scene.ties]
    for pair in scene.pairs:
        out[pair.what] = [*(pair.axis if pair.axis is not None else ()), *(pair.point if pair.point is not None else ())]
    for i, support in enumerate(scene.supports):
        if support.axis is None:
            out[f"direction of support {i + 1}"] = list(support.direction)
    for spin in (load for load in scene.loads if isinstance(load, Spin)):
        out["spin"] = [*spin.axis, *spin.point, *spin.density.values()]
    for i, spring in enumerate(scene.springs):
        out[f"spring {i + 1} on {'+'.join(spring.group)}"] = [spring.stiffness, *(spring.direction or ())]
    for i, fluid in enumerate(load for load in scene.loads if isinstance(load, StatedFluid)):
        out[f"source of fluid {i + 1}"] = plain(fluid.source or ("all",))
    for tool, point in zip(scene.tools, system.tools.points, strict=True):
        out |= {f"tool '{tool.name}', {key}": plain(value) for key, value in vars(tool).items()}
        out[f"tool '{tool.name}', reference point"] = plain(point)
    for one, term in zip(scene.contacts, system.contact_terms, strict=True):
        parts = vars(one) | {f"penalty {key}": value for key, value in vars(one.penalty).items()}
        del parts["penalty"]
        parts |= {"master": term.master_name, "slave points": system.comm.allreduce(term.surface.count)}
        out |= {f"contact '{one.name}', {key}": plain(value) for key, value in parts.items()}
    return out


def first_difference(there: Statement, here: Statement) -> tuple[str, Any, Any] | None:
    """(name, value there, value here) of the first that differ, or None; of lists, the first numbers that do."""
    for name in [*here, *there]:
        if name not in there or name not in here:
            return name, there.get(name, "nothing"), here.get(name, "nothing")
        for a, b in _pairs_unlike(there[name], here[name]):
            return name, a, b
    return None


def unlike(there: Statement, here: Statement) -> list[str]:
    """What is stated there and differs here, in words; of a thing that is not stated here its name alone."""
    found = dict[str, None]()
    gone = {_thing(name) for name in there} - {_thing(name) for name in here}
    for name, value in there.items():
        if _thing(name) in gone:
            found[f"{_thing(name)} is not stated"] = None
        elif name in here:
            for a, b in _pairs_unlike(value, here[name]):
                found.setdefault(f"{name} is {b} and was {a}")
    return list(found)


def _thing(name: str) -> str:
    """Of a name like "contact 'top', friction" what it is of."""
    return name.split(", ")[0]


def _pairs_unlike(one: Any, other: Any) -> Iterator[tuple[Any, Any]]:
    """Pairs of values of one name, of lists of entries, that are not the same."""
    if not isinstance(one, list) or not isinstance(other, list) or len(one) != len(other):
        one, other = [one], [other]
    sizes = [abs(value) for value in [*one, *other] if isinstance(value, float)]
    for a, b in zip(one, other, strict=True):
        close = isinstance(a, int | float) and isinstance(b, int | float) and abs(a - b) <= SAME * max(sizes, default=0.0)
        if a != b and not close:
            yield a, b


def plain(value: Any) -> Any:
    """A value as JSON gives it back: arrays as flat lists of floats."""
    if isinstance(value, np.ndarray):
        flat = value.astype(float).ravel()
        if len(flat) > LISTED:
            weights = np.cos(np.arange(len(flat)))
            return [float(len(flat)), float(np.abs(flat).sum()), float(weights @ flat)]
        return flat.tolist()
    if isinstance(value, tuple):
        return [entry for part in map(plain, value) for entry in (part if isinstance(part, list) else [part])]
    return value
