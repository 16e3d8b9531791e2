"""What drives a scene: supports, and tools that are moved or pushed, from what the user stated of them."""

from collections.abc import Mapping, Sequence

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.assembly.supports import Support as Entry
from fenics_contact.assembly.supports import Supports, ToolMotion
from fenics_contact.assembly.ties import Ties
from fenics_contact.contact.tools import Tool
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.scene.functions import AtPoints, Drive, Path, ramp
from fenics_contact.scene.motion import Driven, Motion, driven
from fenics_contact.scene.statements import Support, Tie
from fenics_contact.types import Floats, Ints64, Space
from fenics_contact.values import SceneError, shown

Moves = Mapping[Tool, Drive | Motion]


def supports_of(
    mesh: NamedMesh,
    space: Space,
    statements: Sequence[Support],
    section: Section | None = None,
    tied: Sequence[Tie] = (),
    tools: Sequence[Tool] = (),
) -> Supports:
    """Supports from Support and Tie statements, checked; of a Section, those that keep it in its plane and on its axis;
    tools: to which ties may tie. Collective."""
    X, keys = space.tabulate_dof_coordinates(), node_keys(space)
    entries = []
    for stated in statements:
        blocks, value = mesh.nodes(space, *stated.group), stated.value
        what, at = f"prescribed displacement of {stated.name}", (keys[blocks], X[blocks])
        way = AtPoints(mesh.comm, what, value, *at) if callable(value) else value
        entries.append(Entry(blocks, np.array(stated.direction), way))
    names = [stated.name for stated in statements]
    if section is not None:
        entries.append(Entry(np.arange(len(X), dtype=np.int32), np.eye(3)[2], 0.0))
        names.append("the plane along z")
    if section is not None and section.axisymmetric:
        size = max(mesh.comm.allgather(np.abs(X).max(initial=0.0)))
        entries.append(Entry(np.flatnonzero(X[:, 0] <= ON_AXIS * size).astype(np.int32), np.eye(3)[0], 0.0))
        names.append("the axis along x")
    supports = Supports(space, entries, names, _ties(mesh, space, statements, tied, tools))
    conflicts = [c for c in mesh.comm.allgather(supports.conflict) if c]
    if conflicts:
        raise SceneError(f"supports contradict each other where they meet: {conflicts[0][0]} and {conflicts[0][1]}")
    return supports


def _ties(mesh: NamedMesh, space: Space, supports: Sequence[Support], tied: Sequence[Tie], tools: Sequence[Tool]) -> Ties:
    """Ties whose nodes nothing else leads, nodes that two groups of one body have in common once. Collective."""
    X, found = space.tabulate_dof_coordinates(), list[tuple[int, Ints64, Floats]]()
    led: list[tuple[str, Tool | None, Ints64]] = [
        (f"the support of '{'+'.join(one.group)}'", None, _nodes(mesh, space, one.group)) for one in supports
    ]
    nodes_of: dict[Tool, list[Ints64]] = {}
    for tie in tied:
        name, nodes = "+".join(tie.group), _nodes(mesh, space, tie.group)
        for what, hub, others in led:
            if hub is not tie.hub and mesh.comm.allreduce(len(np.intersect1d(nodes, others))):
                raise SceneError(
                    f"tie of '{name}' to '{tie.hub.name}': {what} leads some of the same nodes; leave one of them out, or "
                    "name surfaces that do not meet"
                )
        led.append((f"the tie of '{name}' to '{tie.hub.name}'", tie.hub, nodes))
        nodes_of.setdefault(tie.hub, []).append(nodes)
    for hub, parts in nodes_of.items():
        nodes = np.unique(np.concatenate(parts))
        found.append((tools.index(hub), nodes, X[nodes]))
    return Ties(found, space.dofmap.index_map.size_local)


def _nodes(mesh: NamedMesh, space: Space, group: tuple[str, ...]) -> Ints64:
    """Local numbers of a group's nodes."""
    return mesh.nodes(space, *group).astype(np.int64)


def motion_of(
    comm: MPI.Comm,
    tools: Sequence[Tool],
    move: Moves,
    push: Mapping[Tool, Drive],
    lever: float,
    section: Section | None = None,
) -> ToolMotion:
    """ToolMotion of tools, each at rest, moved by {tool: way or Motion} or pushed by {tool: force}, see `build`; lever:
    ToolMotion's; of a Section within its plane, or along its axis. Collective."""
    for what, drive in (("move", move), ("push", push)):
        if not isinstance(drive, dict) or not all(isinstance(tool, Tool) for tool in drive):
            raise SceneError(f"{what} = {shown(drive)}: give {{tool: (x, y, z)}}, the tool itself being the key")
    for tool in [*move, *push]:
        if tool not in tools:
            raise SceneError(f"tool '{tool.name}' is moved or pushed but is in no contact or tie")
        if tool in move and tool in push:
            raise SceneError(f"tool '{tool.name}' is both moved and pushed; choose one, or state both in one Motion")
    drives = [_driven(comm, tool, move, push) for tool in tools]
    if section is not None:
        for tool, one in zip(tools, drives, strict=True):
            _refuse_out_of_plane(tool.name, one, section)
    paths, loads = [drive.path for drive in drives], [drive.load for drive in drives]
    points, free = [drive.point for drive in drives], [drive.free for drive in drives]
    return ToolMotion(paths, loads, points, free, [tool.name for tool in tools], lever)


def _driven(comm: MPI.Comm, tool: Tool, move: Moves, push: Mapping[Tool, Drive]) -> Driven:
    """What drives a tool. Collective."""
    way, force = move.get(tool, (0.0, 0.0, 0.0)), push.get(tool, (0.0, 0.0, 0.0))
    if isinstance(force, Motion):
        raise SceneError(f"push of '{tool.name}': a Motion says itself what is moved and pushed; give it in move=")
    if isinstance(way, Motion):
        return driven(comm, tool.name, way, tool.point)
    path, load = ramp(comm, way, f"move of '{tool.name}'"), ramp(comm, force, f"push of '{tool.name}'")
    free = np.zeros(6, dtype=bool)
    if tool in push:
        free[:3] = np.any([load(t) != 0.0 for t in (0.5, 1.0)], axis=0)
        if not free.any():
            raise SceneError(f"push of '{tool.name}' has no force in any direction")
    return Driven(_unturned(path), _unturned(load), free, tool.point)


def _unturned(part: Path) -> Path:
    """Three components, and none of a rotation."""
    return lambda t: np.append(part(t), np.zeros(3))


def turning(move: object) -> list[str]:
    """Names of the tools that turn by what is stated of their motion."""
    stated = move.items() if isinstance(move, Mapping) else ()
    return [tool.name for tool, motion in stated if isinstance(motion, Motion) and motion.turns]


def _refuse_out_of_plane(name: str, drive: Driven, section: Section) -> None:
    """Nothing may move, push or free a tool out of a plane mesh, nor, all the way round, anything but along its axis."""
    allowed = np.isin(np.arange(6), [1] if section.axisymmetric else [0, 1, 5])
    driven = drive.free | np.any([(drive.path(t) != 0.0) | (drive.load(t) != 0.0) for t in (0.25, 0.5, 1.0)], axis=0)
    for i in np.flatnonzero(driven & ~allowed):
        way = f"along {'xyz'[i]}" if i < 3 else f"about {'xyz'[i - 3]}"
        why = "all the way round there is no such motion" if section.axisymmetric else "the mesh lies in the plane z = 0"
        raise SceneError(f"tool '{name}' is driven {way}: {why}; leave that component out")
