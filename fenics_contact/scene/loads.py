"""The loads of a scene over the stages of a run: what each of these makes of them, checked."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.assembly.stages import Stages
from fenics_contact.scene.courses import Course, Part
from fenics_contact.scene.field_loads import swelling_path
from fenics_contact.scene.functions import AtPoints, Drive, Path, Place, Ramp, load_path, ramp, whole
from fenics_contact.scene.stage import ARC_LENGTH, Stage
from fenics_contact.scene.statements import Loading, StatedFluid, StatedLoad, Swelling, called
from fenics_contact.types import Ints
from fenics_contact.values import SceneError

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene


def loads_of(scene: "Scene", stated: Sequence[Stage], stages: Stages) -> list[Loading]:
    """All loads of a scene, their paths being their courses over stages. Collective."""
    loads = scene.loads
    keys, parts = [(one.word, one.group) for one in loads], [dict[int, Part]() for _ in loads]
    nodes = [one.nodes if isinstance(one, StatedLoad | StatedFluid | Swelling) else None for one in loads]
    for i, stage in enumerate(stated):
        for key, value in stage.loads.items():
            what = stage.says(called(*key))
            if keys.count(key) != 1:
                known = ", ".join(sorted("+".join(group) for word, group in keys if word == key[0] and group)) or "none"
                how = f"the scene states {keys.count(key)} of them" if key in keys else "the scene states none"
                raise SceneError(f"{what}: {how}; state one, with the value of the first stage, 0 for none (there: {known})")
            k = keys.index(key)
            last = stated[max(parts[k], default=0)]  # that has changed it, the first one by what the scene says
            if i > 0 and callable(value) and last.method == ARC_LENGTH and (parts[k] or not _none(loads[k])):
                raise SceneError(
                    f"{what}: a function of s cannot know how large the load is after {last}, whose arc may end anywhere; "
                    "give a number, to which it goes linearly in this stage, or put a stage with a number before this one"
                )
            path, places = _path(scene, loads[k], value, what)
            parts[k][i], nodes[k] = Part(path), nodes[k] if places is None else places
    return [_over_stages(stages, *each) for each in zip(loads, parts, nodes, strict=True)]


def _none(load: Loading) -> bool:
    """Whether what the scene says of a load is that there is none yet."""
    rest = 1.0 if isinstance(load, Swelling) else 0.0
    return isinstance(load.path, Ramp) and not (load.path.end != rest).any()


def _path(scene: "Scene", load: Loading, value: Any, what: str) -> tuple[Path, Ints | None]:
    """What a stage says of a load, and the local nodes that it gives values at, if it is a function of places too."""
    if isinstance(load, Swelling):
        return swelling_path(scene, load.group[0], value, what)
    if isinstance(load, StatedLoad) and load.word == "forces":
        return force_path(scene, value, what), None
    if isinstance(load, StatedLoad | StatedFluid):
        facets = None if load.group is None else scene.mesh.facets(*load.group)
        return place_path(scene, facets, value, what, load.shape)
    return ramp(scene.mesh.comm, value, what, load.shape), None


def place_path(
    scene: "Scene", facets: Ints | None, value: Drive | Place, what: str, shape: tuple[int, ...]
) -> tuple[Path, Ints | None]:
    """path(t) of a load and the nodes that it gives values at, as of `load_path`. Collective."""
    path, nodes = load_path(scene.space, facets, value, what, shape)
    if shape:
        _refuse_out_of_plane(scene, path, what)
    return path, nodes


def _refuse_out_of_plane(scene: "Scene", path: Path, what: str) -> None:
    """Nothing may push out of a plane mesh. Collective."""
    if scene.section is not None and any((whole(path, t)[..., 2] != 0.0).any() for t in (0.25, 0.5, 1.0)):
        raise SceneError(f"{what} along z: nothing moves out of a plane mesh; leave that component out")


def force_path(scene: "Scene", vector: Drive, what: str) -> Path:
    """A force on a surface as a function of t. Collective."""
    path = ramp(scene.mesh.comm, vector, what)
    _refuse_out_of_plane(scene, path, what)
    if scene.section is not None and scene.section.axisymmetric and any(path(t)[0] != 0.0 for t in (0.5, 1.0)):
        raise SceneError(f"{what} along x: all the way round it cancels; state a traction, per area")
    return path


def _over_stages(stages: Stages, load: Loading, parts: dict[int, Part], nodes: Ints | None) -> Loading:
    placed = [path for path in (load.path, *(part.way for part in parts.values())) if isinstance(path, AtPoints)]
    rest, mine = 1.0 if isinstance(load, Swelling) else 0.0, None
    origin = np.full(load.shape, rest)
    if placed:
        origin, mine = np.full((placed[0].count, *load.shape), rest), placed[0].mine
    path = Course(stages, load.path, parts, origin, mine)
    if isinstance(load, StatedLoad | StatedFluid | Swelling):
        return replace(load, path=path, nodes=nodes)
    return replace(load, path=path)
