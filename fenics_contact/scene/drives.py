"""What drives a scene through its stages: supports, and tools that are moved or pushed, from what the user stated."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.entries import Entries, Entry, Hindered
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.assembly.size import bodies_size
from fenics_contact.assembly.stages import Stages
from fenics_contact.assembly.supports import Supports
from fenics_contact.assembly.term import State
from fenics_contact.assembly.tool_motion import ToolMotion
from fenics_contact.contact.tools import Tool
from fenics_contact.scene.courses import Part, SupportCourse
from fenics_contact.scene.directions import Unit, normals, unit
from fenics_contact.scene.functions import AtPoints, Path, Places, Ramp, ramp
from fenics_contact.scene.motion import Driven, Motion, driven, loaded, only_free
from fenics_contact.scene.pairs import CourseAt, FacePairs
from fenics_contact.scene.stage import ARC_LENGTH, Along, Stage, Way
from fenics_contact.scene.start import LeftTool
from fenics_contact.scene.statements import Support
from fenics_contact.scene.tied import Bound, ties_of
from fenics_contact.types import Bools, Floats, Ints64
from fenics_contact.values import SceneError, finite, function, group_names, shown

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene

STILL = 1e-9  # of a force: what may lie between the end of a stage and the start of the next
AXIS = "the axis along x"  # by which messages call what keeps bodies of revolution on it
NEAR = 1e-9  # of the bodies' size: points no farther from each other are one
ELSEWHERE = (  # where an error on a second reference point ends
    "To turn about another point p give the turn rx, ry, rz together with the way of the reference point that goes with it, "
    "(R - 1)(c - p), c being where it is then and R the turn"
)
ALONG = 1.0 - 1e-12  # cosine from which on two directions are one


# -- supports ---------------------------------------------------------------------------------------------------------
def supports_of(
    scene: "Scene", stated: Sequence[Stage], motion: ToolMotion, ways: Sequence[Path]
) -> tuple[Supports, Callable[[State], None], Callable[[State, float], None]]:
    """Supports from a scene's Support, Tie and FacePair statements, the last ones' ways, and what stages prescribe, checked;
    of a Section, those that keep it in its plane and on its axis; motion: of what it is tied to. And what refuses a state to
    begin with from which that would leave supports, and a t at which these contradict each other, as functions may do
    anywhere. Collective."""
    stages = motion.stages
    mesh, space, section = scene.mesh, scene.space, scene.section
    X, keys = space.tabulate_dof_coordinates(), node_keys(space)
    ties, hindered = ties_of(scene), list[Hindered]()
    paired = FacePairs(scene, ways, ties) if scene.pairs else None
    stated_of: list[tuple[str, Ints64, Floats, CourseAt]] = []  # name, nodes, direction, course
    changed = [_prescribed(scene, stage) for stage in stated]
    for k, one in enumerate(scene.supports):
        said = {i: (stated[i], *of[k]) for i, of in enumerate(changed) if k in of}
        course: CourseAt = partial(_course, scene, stages, one, said)
        stated_of.append((one.name, mesh.nodes(space, *one.group).astype(np.int64), np.array(one.direction), course))
    if section is not None:
        stated_of.append(("the plane along z", np.arange(len(X)), np.eye(3)[2], partial(_still, stages)))
    if section is not None and section.axisymmetric:
        size = max(mesh.comm.allgather(np.abs(X).max(initial=0.0)))
        on_axis = np.flatnonzero(X[:, 0] <= ON_AXIS * size)
        stated_of.append((AXIS, on_axis, np.eye(3)[0], partial(_still, stages)))
    for pair, held in paired.on_axis if paired else ():
        nodes = np.flatnonzero(np.isin(keys, held))
        stated_of += [(f"{pair.what} on its axis", nodes, way, partial(_still, stages)) for way in pair.across]
    entries, names, carried = list[Entry](), list[str](), list[tuple[Entry, str]]()
    for k, (name, nodes, direction, course) in enumerate(stated_of):
        tied = np.isin(nodes, ties.nodes)
        if mesh.comm.allreduce(int(tied.any())):  # what holds these wholly is their body
            value = course((keys[nodes], X[nodes]), keys[nodes[tied]])
            hindered.append(Hindered(name, nodes[tied], direction, value))
        mine = nodes[~tied & ~np.isin(keys[nodes], paired.led)] if paired else nodes[~tied]
        entries.append(Entry(mine.astype(np.int32), direction, course((keys[nodes], X[nodes]), keys[mine])))
        names.append(name)
        of_leaders = paired.of_leaders(k, nodes, direction, course) if paired else []
        carried += [(entry, f"{name}, of paired faces") for entry in of_leaders]
    named = Entries(entries + [entry for entry, _ in carried], names + [name for _, name in carried], hindered)
    supports = Supports(space, named, ties, paired.pairs() if paired else None)
    bound = Bound(mesh.comm, motion, ties, hindered, paired)
    for i, stage in enumerate(stated):
        with stages.foreseen(i):
            for t in (stages.time(s) for s in (0.0, 0.5, 1.0)):
                _refuse_conflict(mesh.comm, stage, supports, paired, t)
    meet = bool(mesh.comm.allreduce(int(supports.meet)))

    def refuse_apart(state: State, t: float) -> None:
        stage = stated[stages.index]
        if meet or paired:
            _refuse_conflict(mesh.comm, stage, supports, paired, t, f"at t = {t:g} ")
        if not (stages.ahead and stages.index):  # where a later stage begins is not known yet
            bound.refuse_astray(stage, t, state.poses, state.q)

    return supports, lambda state: bound.refuse_hindered(stated, state.poses), refuse_apart


def _refuse_conflict(
    comm: MPI.Comm, stage: Stage, supports: Supports, paired: FacePairs | None, t: float, when: str = ""
) -> None:
    """Supports agree at t where they meet, and so do pairs of faces. Collective."""
    conflicts = [c for c in comm.allgather(supports.conflict(t)) if c]
    if conflicts:
        words = f"{when}supports contradict each other where they meet: {conflicts[0][0]} and {conflicts[0][1]}"
        raise SceneError(stage.says(words))
    if paired and (found := paired.open_loop(paired.ways(t))):
        pair, X = found
        words = f"{when}{pair.what}: with the other pairs it leads the node at {spot(X)} to two places; let their ways agree"
        raise SceneError(stage.says(words))


def _course(
    scene: "Scene",
    stages: Stages,
    one: Support,
    said: dict[int, tuple[Stage, Way, float]],
    places: Places,
    wanted: Ints64,
) -> SupportCourse:
    """What a statement, and stages by their numbers, prescribe of the wanted ones of its nodes, at places. Collective."""
    what = f"prescribed displacement of {one.name}"

    def way(value: Way, sign: float, what: str) -> Path:
        if not callable(value):
            return Ramp(sign * finite(value, what))
        values = function(value, what, "value(X, s)")
        signed = values if sign > 0.0 else lambda X, s: -np.asarray(values(X, s))
        return AtPoints(scene.mesh.comm, what, signed, places, wanted=wanted)

    parts = {i: Part(way(value, sign, stage.says(what)), by=True) for i, (stage, value, sign) in said.items()}
    return SupportCourse(stages, way(one.value, 1.0, what), parts, np.zeros(len(wanted)))


def _still(stages: Stages, places: Places, wanted: Ints64) -> SupportCourse:
    """Of nodes that never move."""
    return SupportCourse(stages, Ramp(np.zeros(())), {}, np.zeros(len(wanted)))


def _prescribed(scene: "Scene", stage: Stage) -> dict[int, tuple[Way, float]]:
    """{number of a support of the scene: what a stage says of it, and 1, or -1 along the opposite direction}. Collective."""
    out: dict[int, tuple[Way, float]] = {}
    for (group, along), value in stage.prescribe.items():
        name = group if isinstance(group, str) else "+".join(group)
        what = stage.says(f"prescribe '{name}' along {along if isinstance(along, str) else shown(along)}")
        for names, direction in _ways(scene, group_names(group, stage.says("prescribe")), along, what):
            there = [
                (k, float(np.dot(one.direction, direction))) for k, one in enumerate(scene.supports) if one.group == names
            ]
            found = {k: (value, float(np.sign(cosine))) for k, cosine in there if abs(cosine) > ALONG}
            if not found:
                how = "normal=True" if along == "normal" else repr(along) if isinstance(along, str) else f"direction={along}"
                held = ", ".join(sorted(one.name for one in scene.supports)) or "none"
                raise SceneError(
                    f"{what}: no support of the scene holds it; state it, scene.fix({shown(group)}, {how}); it holds {held}"
                )
            if twice := found.keys() & out.keys():
                raise SceneError(f"{what}: the stage has named {scene.supports[min(twice)].name} already; name it once")
            out |= found
    return out


def _ways(scene: "Scene", names: tuple[str, ...], along: Along, what: str) -> list[tuple[tuple[str, ...], Unit]]:
    """Surfaces of supports and the directions along which a stage moves them. Collective."""
    if along == "normal" and all((name,) in [one.group for one in scene.supports] for name in names):
        return normals(scene.mesh, scene.space, names, what)
    if isinstance(along, str):
        return [(names, tuple(float(along == letter) for letter in "xyz"))]  # no direction where no normal is supported
    return [(names, unit(along, what))]


# -- tools ------------------------------------------------------------------------------------------------------------
def motion_of(scene: "Scene", stated: Sequence[Stage], stages: Stages, left: Mapping[str, LeftTool]) -> ToolMotion:
    """ToolMotion of a scene's tools, each at rest or as another run has left it, moved by {tool: way or Motion} or pushed by
    {tool: force} in the stages; of a plane mesh within it, or along its axis; left: another run's tools by name. Collective.
    """
    comm, tools, section, lever = scene.mesh.comm, scene.tools, scene.section, bodies_size(scene.space)
    driven_by, frees, scale = list[dict[int, Driven]](), list[Bools](), np.repeat([1.0, lever], 3)
    free, forces = _left_free(tools, left)
    reached = np.where(free, scale * forces, np.nan)  # by what tools are pushed where the stages so far end; NaN: unknown
    for n, stage in enumerate(stated):
        _refuse_drives(tools, stage)
        named = {**stage.move, **stage.push}
        now = {k: _driven(comm, tool, stage, free[k]) for k, tool in enumerate(tools) if tool in named}
        free = free.copy()
        for k, one in now.items():
            free[k] = one.free
            if section is not None:
                _refuse_out_of_plane(stage, tools[k].name, one, section)
            for i, load in enumerate(one.loads):
                mine = k, slice(3 * i, 3 * i + 3)
                if n > 0 and load is not None and not isinstance(load, Ramp):
                    what = f"the {'moment' if i else 'force'} on '{tools[k].name}'"
                    _refuse_start(stage, what, load(0.0), stated[n - 1], reached[mine], free[mine])
                if load is not None:
                    reached[mine] = np.nan if stage.method == ARC_LENGTH else load(1.0)
        reached[~free] = np.nan
        driven_by.append(now)
        frees.append(free)

    def path(k: int, t: float) -> Floats:
        one, start = driven_by[stages.index].get(k), stages.start.q[k]
        return start if one is None or one.path is None else start + scale * one.path(stages.share(t))

    def pushed(k: int, t: float) -> Floats:
        one, start = driven_by[stages.index].get(k), scale * stages.start.forces[k]
        if one is not None:
            parts = zip(one.loads, (start[:3], start[3:]), strict=True)
            start = np.concatenate([at if way is None else Part(way).value(at, stages.share(t)) for way, at in parts])
        return start / scale

    paths, loads = ([partial(way, k) for k in range(len(tools))] for way in (path, pushed))
    points = list[Floats]()
    for k, tool in enumerate(tools):
        its, own = [now.get(k) for now in driven_by], left.get(tool.name)
        points.append(_point(tool, its, own))
        turns = [bool(free[k, 3:].any()) or (one is not None and one.turned) for free, one in zip(frees, its, strict=True)]
        _refuse_late_point(tool, own, list(zip(stated, its, turns, strict=True)), NEAR * lever)
    reach = max((tool.reach for tool in tools), default=0.0)
    return ToolMotion(stages, (paths, loads), points, frees, [tool.name for tool in tools], (lever, reach))


def _driven(comm: MPI.Comm, tool: Tool, stage: Stage, free: Bools) -> Driven:
    """What a stage states of a tool that it moves or pushes; free (6,): in the stage before. Collective."""
    if tool in stage.move:
        way = stage.move[tool]
        if isinstance(way, Motion):
            return driven(comm, stage.says(f"motion of '{tool.name}'"), way, free)
        travel = ramp(comm, way, stage.says(f"move of '{tool.name}'"))
        return Driven(lambda s: np.append(travel(s), np.zeros(3)), (None, None), np.zeros(6, dtype=bool))
    force, what = stage.push[tool], stage.says(f"push of '{tool.name}'")
    if isinstance(force, Motion):
        raise SceneError(f"{what}: a Motion says itself what is moved and pushed; give it in move=")
    load = ramp(comm, force, what)
    free = free | np.append(loaded(load), np.zeros(3, dtype=bool))  # what was free stays so, under no force
    if not free[:3].any():
        raise SceneError(
            f'{what} has no force in any direction; what is to move freely takes move=Motion(free="y"), say, with the '
            "components that are free"
        )
    return Driven(None, (only_free(load, free[:3], what), None), free)


def _left_free(tools: Sequence[Tool], left: Mapping[str, LeftTool]) -> tuple[Bools, Floats]:
    """Which components (tools, 6) of tools another run has left free, and what then acts on them, see LeftTool."""
    there = [left.get(tool.name) for tool in tools]
    free = np.array([one.free if one else np.zeros(6, dtype=bool) for one in there], dtype=bool).reshape(-1, 6)
    return free, np.array([one.forces if one else np.zeros(6) for one in there]).reshape(-1, 6)


def _point(tool: Tool, stages: Sequence[Driven | None], left: LeftTool | None) -> Floats:
    """The reference point (3,) of a tool, one in all stages, which state this of it, and in those of the run that left it
    as it is; another one only where no rotation goes on from there under a load that acts about the old one."""
    said = [one.about for one in stages if one is not None and one.about is not None]
    if said and any(not np.array_equal(about, said[0]) for about in said):
        raise SceneError(
            f"motion of '{tool.name}': about = {said[0].tolist()} in one stage and {said[-1].tolist()} in another; a tool "
            f"has one reference point, stated where it is at the start, in all stages. {ELSEWHERE}"
        )
    if left is None:
        return said[0] if said else tool.point
    point, first = said[0] if said else left.point if left.said else tool.point, stages[0]
    if np.any(point != left.point) and left.free[3:].any() and (first is None or first.path is None):
        raise SceneError(
            f"tool '{tool.name}' turns freely about {left.point.tolist()} in the run to start from, and goes on so in the "
            f"first stage, but its reference point is {point.tolist()} here: let it be the same, Motion(about=...), or let "
            "the first stage move the tool"
        )
    return point


def _refuse_late_point(
    tool: Tool, left: LeftTool | None, course: Sequence[tuple[Stage, Driven | None, bool]], near: float
) -> None:
    """No stage is the first to name a tool's reference point, farther than `near` [length] from where it is if none does,
    after one that may turn the tool: that would turn it about the point named too. course: by stage what it states of the
    tool, and whether it may turn it."""
    before = list[str]()
    for stage, one, turns in course:
        if one is None or one.about is None:
            before += [str(stage)] * turns
            continue
        own, about = left.point if left and left.said else tool.point, one.about
        if before and np.abs(about - own).max() > near:
            raise SceneError(
                f"motion of '{tool.name}': about = {about.tolist()} in {stage}, but not in {' and '.join(before)} before "
                "it, where it turns or may turn; a tool has one reference point in all stages, so that there it would "
                f"be this one too, and not its own, {own.tolist()}. Where that is meant, name about in {before[0]} as "
                f"well, else leave it out. {ELSEWHERE}"
            )
        return


def turning(stated: Sequence[Stage], left: Mapping[str, LeftTool]) -> list[str]:
    """Names of the tools that turn by what is stated of their motion, or did in the run that left them, each once."""
    moves = [stage.move.items() for stage in stated if isinstance(stage.move, Mapping)]
    turned = [name for name, one in left.items() if one.free[3:].any() or np.any(one.turn != np.eye(3))]
    stating = [tool.name for move in moves for tool, way in move if isinstance(way, Motion) and way.turns]
    return list(dict.fromkeys(turned + stating))


def _refuse_start(stage: Stage, what: str, first: Floats, before: Stage, reached: Floats, free: Bools) -> None:
    """A force or moment on a tool, `what`, that is a function of s starts (3,) from what the stage before reached (3,): NaN
    where that is known in the run alone."""
    unknown = free & np.isnan(reached)
    if not unknown.any() and not np.any((np.abs(first - reached) > STILL * np.abs(reached[free]).max(initial=0.0))[free]):
        return
    begun = ", ".join(f"{letter} {value:.6g}" for letter, value in zip("xyz", first + 0.0, strict=True))
    if unknown.any():
        along = " and ".join(np.array(list("xyz"))[unknown])
        why = "arc length may end anywhere" if before.method == ARC_LENGTH else "the tool was moved or held that way"
        raise SceneError(
            f"{stage.says(what)} is a function of s that starts from {begun}, but how large its component {along} is at the "
            f"end of {before} is known only there, for {why}; give the load at the end of '{stage.name}' as numbers: it "
            "goes there linearly from what it was"
        )
    ended = ", ".join(f"{letter} {value + 0.0:.6g}" for letter, value in zip("xyz", np.nan_to_num(reached), strict=True))
    raise SceneError(
        f"{stage.says(what)} is a function of s that starts from {begun}, but {before} ends with {ended}: loads count from "
        "zero, not from where a stage begins; let the function start from there, or give the load at the end of "
        f"'{stage.name}' as numbers: it goes there linearly"
    )


def _refuse_drives(tools: Sequence[Tool], stage: Stage) -> None:
    """A stage moves or pushes tools of the scene, each in one way."""
    for what, drive in (("move", stage.move), ("push", stage.push)):
        if not isinstance(drive, dict) or not all(isinstance(tool, Tool) for tool in drive):
            raise SceneError(stage.says(f"{what} = {shown(drive)}: give {{tool: (x, y, z)}}, the tool itself being the key"))
    for tool in [*stage.move, *stage.push]:
        if tool not in tools:
            raise SceneError(stage.says(f"tool '{tool.name}' is moved or pushed but is in no contact or tie"))
    for tool in stage.move:
        if tool in stage.push:
            words = f"tool '{tool.name}' is both moved and pushed; choose one, or state both in one Motion"
            raise SceneError(stage.says(words))


def _refuse_out_of_plane(stage: Stage, name: str, drive: Driven, section: Section) -> None:
    """Nothing may move, push or free a tool out of a plane mesh, nor, all the way round, anything but along its axis."""
    allowed = np.isin(np.arange(6), [1] if section.axisymmetric else [0, 1, 5])
    driven = drive.free.copy()
    if drive.path is not None:
        driven |= np.any([drive.path(s) != 0.0 for s in (0.25, 0.5, 1.0)], axis=0)
    for i in np.flatnonzero(driven & ~allowed):
        way = f"along {'xyz'[i]}" if i < 3 else f"about {'xyz'[i - 3]}"
        why = "all the way round there is no such motion" if section.axisymmetric else "the mesh lies in the plane z = 0"
        raise SceneError(stage.says(f"tool '{name}' is driven {way}: {why}; leave that component out"))
