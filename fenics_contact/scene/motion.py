"""How a rigid tool moves: each of its six components moved along a path, pushed by a load, or free, in one statement."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.scene.functions import Drive, Path, Ramp, ramp
from fenics_contact.types import Bools, Floats
from fenics_contact.values import SceneError, finite, shown

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
ROUNDED = 1e-12  # of a load's largest component: less is round-off


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Displacement of a reference point of a tool along x, y, z [length] and rotation about it: what is not named stays.

    about (3,): the point at the start, about which moments are taken too, one in all stages, which the first that may turn
    the tool names at the latest; by default the tool's own [length]. rx, ry, rz: components of the rotation vector in space,
    whose direction is the axis and whose length the angle [radians]. Each is a number reached at t = 1 or a function of t.
    force, moment (3,): loads on the tool, of fixed direction, at t = 1 or functions of t [force, force x length]; where they
    have a component the tool is free to move, and so it is along and about the axes named in free="x rz", and where it was
    free in the stage before and the load stated now is zero. Of rotations, all three may be free, or one while the others
    stay.
    """

    about: Sequence[float] | Floats | None = None
    x: Drive | None = None
    y: Drive | None = None
    z: Drive | None = None
    rx: Drive | None = None
    ry: Drive | None = None
    rz: Drive | None = None
    force: Drive | None = None
    moment: Drive | None = None
    free: str = ""

    @property
    def moved(self) -> list[Drive | None]:
        """The six paths."""
        return [self.x, self.y, self.z, self.rx, self.ry, self.rz]

    @property
    def turns(self) -> bool:
        """Whether the tool may turn."""
        return self.moment is not None or "r" in str(self.free) or any(path is not None for path in self.moved[3:])


@dataclass(frozen=True)
class Driven:
    """What a stage states of a tool, checked. path: s -> (6,), None: it stays where it is or goes where it is pushed; loads:
    the ways of force and moment (3,), None of what is not named; free (6,); about (3,) [length], None: not said; turned:
    whether the path may turn it."""

    path: Path | None
    loads: tuple[Path | None, Path | None]
    free: Bools
    about: Floats | None = None
    turned: bool = False


def driven(comm: MPI.Comm, what: str, motion: Motion, before: Bools) -> Driven:
    """What a Motion states, `what` in words; before (6,): what was free in the stage before. SceneError on all ranks.
    Collective."""
    if not isinstance(motion.free, str) or (unknown := set(motion.free.split()) - set(COMPONENTS)):
        wrong = shown(motion.free) if not isinstance(motion.free, str) else f"'{sorted(unknown)[0]}'"
        known = ", ".join(COMPONENTS)
        raise SceneError(f'{what}: free = {wrong} is not known; name components, as in free="x rz", of {known}')
    stated = zip(COMPONENTS, motion.moved, strict=True)
    paths = [None if way is None else ramp(comm, way, f"{what}: {key}", ()) for key, way in stated]
    force, moment = (
        ramp(comm, (0.0, 0.0, 0.0) if load is None else load, f"{what}: {key}")
        for key, load in (("force", motion.force), ("moment", motion.moment))
    )

    def path(s: float) -> Floats:
        return np.array([0.0 if way is None else float(way(s)) for way in paths])

    pushed = np.concatenate([loaded(force), loaded(moment)])
    moved = [way is not None for way in paths]
    said = np.repeat([motion.force is not None, motion.moment is not None], 3)
    kept = before & said & ~np.array(moved) & ~pushed  # else a load stated as zero would be held as it was, not taken back
    free = pushed | kept | np.isin(COMPONENTS, motion.free.split())
    for key, load, part in (("force", force, slice(0, 3)), ("moment", moment, slice(3, 6))):
        # functions may act between: only_free
        if said[part].any() and isinstance(load, Ramp) and not (free[part].any() or any(moved[part])):
            raise SceneError(
                f"{what} has no {key} in any direction, nor does it move or free what that could act on: name what it does, "
                'as in force=(0, -1.0, 0), y=-0.1, free="y" or free="rz"'  # which scenes of all kinds have, not all of these
            )
    force, moment = only_free(force, free[:3], f"{what}: force"), only_free(moment, free[3:], f"{what}: moment")
    _refuse(what, [key for key, way in zip(COMPONENTS, moved, strict=True) if way], pushed, free, kept)
    about = None if motion.about is None else finite(motion.about, f"{what}: about", (3,))
    turned = any(not isinstance(way, Ramp) or bool(way.end) for way in paths[3:] if way is not None)
    return Driven(path, (force, moment), free, about, turned)


def loaded(load: Path) -> Bools:
    """Along which axes (3,) a load acts."""
    return np.any([load(s) != 0.0 for s in (0.5, 1.0)], axis=0)


def only_free(load: Path, free: Bools, what: str) -> Path:
    """A load (3,) that acts nowhere but where the tool is free (3,): elsewhere it would be lost. SceneError at a t where its
    function says otherwise."""
    if isinstance(load, Ramp):
        return load

    def checked(t: float) -> Floats:
        value = load(t)
        lost = np.flatnonzero(~free & (np.abs(value) > ROUNDED * np.abs(value).max()))
        if lost.size:
            raise SceneError(
                f"{what} at t = {t:g} has a component {'xyz'[lost[0]]}, in which the tool is not free, for it has none at "
                "t = 0.5 and 1: name that in free= of a Motion"
            )
        return value

    return checked


def _refuse(what: str, moved: list[str], pushed: Bools, free: Bools, kept: Bools) -> None:
    """A component has one drive, and rotations are coordinates only where all, one or none of them are free; kept (6,): free
    for they were so before."""
    for key, load, loose in zip(COMPONENTS, pushed, free, strict=True):
        if key in moved and loose:
            how = "pushed" if load else "free"
            raise SceneError(f"{what}: {key} is both moved and {how}; choose one")
    turning, loose = [key for key in moved if key in COMPONENTS[3:]], int(free[3:].sum())
    if loose == 2 or (loose == 1 and turning):
        still = [key for key, one in zip(COMPONENTS[3:], kept[3:], strict=True) if one]
        before = f"; {' and '.join(still)} was free before and stays so under the moment stated" if still else ""
        before += f": to hold it, name it, {still[0]}=0, or leave moment= out" if still else ""
        raise SceneError(
            f"{what}: of its rotations {' and '.join(np.array(COMPONENTS)[3:][free[3:]])} may move freely while others are "
            "held or moved: rotations about several axes depend on their order; let all three be free, or one alone while "
            f"the others stay{before}"
        )
