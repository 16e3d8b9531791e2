"""What drives a scene: supports, and tools that are moved or pushed, from what the user stated of them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from mpi4py import MPI

from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.assembly.supports import Support as Entry
from fenics_contact.assembly.supports import Supports, ToolMotion
from fenics_contact.contact.tools import Tool
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.scene.functions import AtPoints, Drive, ramp
from fenics_contact.scene.statements import Support
from fenics_contact.types import Floats, Space
from fenics_contact.values import SceneError, shown


def supports_of(mesh: NamedMesh, space: Space, statements: Sequence[Support], section: Section | None = None) -> Supports:
    """Supports from Support statements, checked; of a Section, those that keep it in its plane and on its axis.
    Collective."""
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
    supports = Supports(space, entries, names)
    conflicts = [c for c in mesh.comm.allgather(supports.conflict) if c]
    if conflicts:
        raise SceneError(f"supports contradict each other where they meet: {conflicts[0][0]} and {conflicts[0][1]}")
    return supports


def motion_of(
    comm: MPI.Comm,
    tools: Sequence[Tool],
    move: Mapping[Tool, Drive],
    push: Mapping[Tool, Drive],
    section: Section | None = None,
) -> ToolMotion:
    """ToolMotion of tools, each at rest, moved by {tool: way} or pushed by {tool: force}, see `build`; of a Section within
    its plane, and along its axis. Collective."""
    for what, drive in (("move", move), ("push", push)):
        if not isinstance(drive, dict) or not all(isinstance(tool, Tool) for tool in drive):
            raise SceneError(f"{what} = {shown(drive)}: give {{tool: (x, y, z)}}, the tool itself being the key")
    for tool in [*move, *push]:
        if tool not in tools:
            raise SceneError(f"tool '{tool.name}' is moved or pushed but is in no contact")
    paths, forces, free = [], [], []
    for tool in tools:
        if tool in move and tool in push:
            raise SceneError(f"tool '{tool.name}' is both moved and pushed; choose one")
        paths.append(ramp(comm, move.get(tool, (0.0, 0.0, 0.0)), f"move of '{tool.name}'"))
        forces.append(ramp(comm, push.get(tool, (0.0, 0.0, 0.0)), f"push of '{tool.name}'"))
        free.append(np.any([forces[-1](t) != 0.0 for t in (0.5, 1.0)], axis=0) if tool in push else np.zeros(3, bool))
        if tool in push and not free[-1].any():
            raise SceneError(f"push of '{tool.name}' has no force in any direction")
        if section is not None:
            _refuse_out_of_plane(tool, (paths[-1], forces[-1]), section)
    return ToolMotion(paths, forces, free, [tool.name for tool in tools])


def _refuse_out_of_plane(tool: Tool, drives: Sequence[Callable[[float], Floats]], section: Section) -> None:
    """Nothing may move or push a tool out of a plane mesh, nor away from an axis of turning."""
    for drive, word in zip(drives, ("moves", "pushes"), strict=True):
        largest = np.max([np.abs(drive(t)) for t in (0.25, 0.5, 1.0)], axis=0)
        for axis in (0, 2) if section.axisymmetric else (2,):
            if largest[axis] > 0.0:
                why = "the mesh lies in the plane z = 0" if axis == 2 else "all the way round there is no such direction"
                raise SceneError(f"tool '{tool.name}' {word} along {'xyz'[axis]}: {why}; leave that component zero")
