"""A run that starts from the last state of another one: what is kept of that, and taken up."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_contact.assembly.memory import Memory
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.stages import End
from fenics_contact.assembly.system import System
from fenics_contact.scene.courses import Course
from fenics_contact.scene.functions import Path
from fenics_contact.scene.stated import Statement, parts_of, unlike
from fenics_contact.scene.statements import LOADS
from fenics_contact.types import Bools, Floats
from fenics_contact.values import SceneError

if TYPE_CHECKING:  # which is built from it
    from fenics_contact.scene.scene import Scene

Driven = Sequence[tuple[str, Path]]  # loads by name, as functions of t
Drives = dict[str, dict[str, Any]]  # plain values: JSON takes them
JUMP = 1e-3  # of the largest force: what is out of balance where a run starts from another one's end
STILL = 1e-9  # of the bodies' size: what may lie between a tied surface and where its rigid body has carried it


class LeftTool(NamedTuple):
    """A tool as a run leaves it. q (6,): coordinates [length]; forces (6,): outer force and, over the lever, moment [force];
    point (3,): where its reference point began [length], said: whether a stage named that; turn (3, 3): its rotation since
    then; free (6,): components that balance loads, and go on doing so until a stage names the tool."""

    q: Floats
    forces: Floats
    point: Floats
    turn: Floats
    free: Bools
    said: Bools


@dataclass(frozen=True)
class Start:
    """Another run's last state. name: of the run, in words; arrays: what Memory collected of it, on rank 0; drives: see
    `drives_left`."""

    name: str
    arrays: dict[str, Any] | None = field(repr=False)
    drives: Drives = field(repr=False)

    @property
    def tools(self) -> dict[str, LeftTool]:
        """The other run's tools by name."""
        return {name: LeftTool(*map(np.array, one)) for name, one in self.drives["tools"].items()}


def drives_left(system: System, driven: Driven, scene: "Scene", parts: Callable[[], Statement]) -> Drives:
    """What holds a run's last state: {"loads": {name: [value, what the scene says of it]}, "supports": {name: what the scene
    says}, "tools": {name: LeftTool as lists}, "space": what displacements are of, "parts": as `parts_of`}. Collective."""
    state, end, motion = system.state, system.ending(), system.tools
    loads = {what: [path.everywhere(state.t).tolist(), path.said()] for what, path in _courses(driven).items()}
    turns = [pose.turn for pose in state.tools]
    said = [np.any(point != tool.point) for point, tool in zip(motion.points, scene.tools, strict=True)]
    ends = zip(motion.names, end.q, end.forces, motion.points, turns, motion.free, said, strict=True)
    tools = {name: [part.tolist() for part in one] for name, *one in ends}
    supports = system.supports.entries.said()
    return {"loads": loads, "supports": supports, "tools": tools, "space": _space(scene), "parts": parts()}


def _space(scene: "Scene") -> dict[str, Any]:
    """What displacements must have in common to be taken over, besides the mesh, as a scene states it."""
    section = scene.section
    plane = None if section is None else "axisymmetric" if section.axisymmetric else "strain"
    return {"degree": scene.degree, "plane": plane, "thickness": section.thickness if section else None}


def begin(system: System, driven: Driven, start: Start, scene: "Scene") -> list[str]:
    """Put a System at rest into another run's last state. Returns what is to be said of it.

    SceneError on all ranks where the meshes, degrees or planes differ. Collective.
    """
    here, there = _space(scene), start.drives.get("space", {})  # which checkpoints of older versions do not say
    for word, one in here.items():
        if (other := there.get(word, one)) != one:
            raise SceneError(
                f"start = {start.name} does not fit: that run has Scene(..., {word}={other!r}) and this one {word}={one!r}; "
                f"state the same {word} in both, or start from rest"
            )
    q, forces = _tools(system, start.tools)
    system.stages.begin(End(0.0, q, forces))
    for what, course in _courses(driven).items():
        value, before = start.drives["loads"].get(what, [course.everywhere(0.0).tolist(), ()])
        origin = np.array(value, dtype=float)
        if origin.shape not in (course.shape, course.shape[1:]):
            raise SceneError(
                f"start = {start.name} does not fit: {what} has values of shape {origin.shape} there; start from one on the "
                "same mesh, and state it as a function value(X, t) where it is one there"
            )
        course.begin(origin, before)
    memory = Memory(system)
    try:
        memory.place(start.arrays)
    except ValueError as error:
        raise SceneError(f"start = {start.name} does not fit: {error}; start from one on the same mesh") from None
    u = system.state.u.x.array.copy()
    system.supports.ties.place(system.state.poses, q, u)
    if max(system.comm.allgather(np.abs(u - system.state.u.x.array).max(initial=0.0))) > STILL * system.extent:
        raise SceneError(
            f"start = {start.name} does not fit: what is tied here has moved there without its rigid body; tie it there too"
        )
    system.supports.entries.begin(u, start.drives["supports"])
    left = memory.begin(start.arrays, q)
    return _left_out(system, driven, start) + [
        f"contact '{name}' starts without a history: {start.name} has none of that name and points" for name in left
    ]


def _left_out(system: System, driven: Driven, start: Start) -> list[str]:
    """What the other scene had and this one has not: a tool by another name is not where it was, a load ends at once."""
    tools, loads, here = start.tools, start.drives["loads"], _courses(driven)
    lost = ", ".join(f"'{name}'" for name in tools if name not in system.tools.names)
    new = ", ".join(f"'{name}'" for name in system.tools.names if name not in tools)
    notes = (
        [f"tool {new} starts where the scene states it: {start.name} has none of that name, but {lost}"]
        if lost and new
        else []
    )
    notes += [
        f"tool '{name}', pushed where {start.name} ends, is in no contact or tie: its force is gone at once"
        for name, tool in tools.items()
        if name not in system.tools.names and np.any(tool.forces[tool.free])
    ]
    for what, (value, _) in loads.items():
        rest = 1.0 if what.startswith(LOADS["swell"]) else 0.0
        if what not in here and np.any(np.array(value) != rest):
            notes.append(
                f"{what}, with which {start.name} ends, is not stated and gone at once: state it, to let it go in steps"
            )
    return notes


def let_go(system: System, start: Start, scene: "Scene") -> str | None:
    """What is to be said where another run's last state, taken up, is out of balance by more than JUMP. Collective."""
    system.begin_step(0.0)
    out, scale = system.assemble_residual(), system.scales.balance
    if not out > JUMP * scale:
        return None
    here = system.supports.entries.said()
    causes = [f"support of {name} is not stated" for name in start.drives["supports"] if name not in here]
    causes += unlike(start.drives.get("parts", {}), parts_of(scene, system))
    why = f" ({'; '.join(causes)})" if causes else ""
    return (
        f"{start.name} ends out of balance in this scene, by {out / scale:.0%} of the largest force, for its scene did not "
        f"state the same{why}: the first step lets that go at once, and no number of steps makes a path of it; state it as "
        "it was, and let loads and supports go in a stage; what no stage changes, take off its load before that run ends"
    )


def _tools(system: System, there: dict[str, LeftTool]) -> tuple[Floats, Floats]:
    """Coordinates and outer forces (tools, 6) of the tools in another run's last state, those of no such name at rest; the
    rotations are put into the state."""
    tools, poses = system.tools, system.state.poses
    q, forces = np.zeros((2, len(tools), 6))
    for i, (name, point) in enumerate(zip(tools.names, tools.points, strict=True)):
        if name in there:
            q[i], forces[i], start, turn, *_ = there[name]
            pose = Pose(start, q[i, :3].copy(), turn, np.eye(3), tools.lever)
            q[i, :3] = pose.placed(point) - point  # of the reference point, which may be another one here
            forces[i, 3:] += np.cross(pose.place - point - q[i, :3], forces[i, :3]) / tools.lever
            poses.turns[i] = turn
    poses.resume(q[:, 3:], poses.turns.copy())
    return q, forces


def _courses(driven: Driven) -> dict[str, Course]:
    """Courses by names of their own."""
    found: dict[str, Course] = {}
    for what, path in driven:
        if isinstance(path, Course):
            number = sum(name.split(" #")[0] == what for name in found)
            found[f"{what} #{number + 1}" if number else what] = path
    return found
