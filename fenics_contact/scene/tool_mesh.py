"""rigid_surface(script or file, ...): a meshed rigid tool, read and checked."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.contact.master import area_vectors
from fenics_contact.contact.seams import joined, joined_sides, slits
from fenics_contact.contact.tools import MeshedTool, Slits
from fenics_contact.mesh_io import read_curve, read_surface
from fenics_contact.types import Bools, Floats, Ints64
from fenics_contact.values import SceneError


def rigid_surface(
    source: Callable[..., Any] | str | Path,
    group: str | None = None,
    name: str = "tool",
    flip: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **parameters: Any,
) -> MeshedTool:
    """Rigid tool whose surface is a gmsh mesh of triangles or quadrilaterals.

    source: a gmsh script, called with `parameters`, or a file as for read_mesh, an .stl file too (its facets without an area
    are left out); group: the surface group that is the tool, by default all surfaces. Its facets must be counter-clockwise
    seen from the body they touch; flip=True turns them all. Corners that are one but for rounding become one, and facets on
    whose edges those of others lie are divided there. Raises SceneError, on all ranks, where there are no such facets, where
    some have no area, where they turn different ways, or where more than two meet in an edge.
    """
    nodes, size, X = read_surface(source, group, comm, **parameters)
    left_out, listed = 0, isinstance(source, str | Path) and Path(source).suffix.lower() == ".stl"
    if listed:
        flat = _flat(nodes, X)
        nodes, size, left_out = nodes[~flat], size[~flat], int(flat.sum())
    if flip:
        nodes = np.where(size[:, None] == 4, nodes[:, [0, 3, 2, 1]], nodes[:, [0, 2, 1, 1]])
    _refuse_flat(name, nodes, X)
    surface, X, lost = joined((nodes, size), X, thin=listed)
    if not len(surface[0]):
        raise SceneError(f"{name}: '{source}' has no facets with an area")
    found = slits(surface, X)
    _refuse_mixed(name, surface[0], X, found)
    return MeshedTool(name, *surface, X, left_out=left_out + lost, slits=found)


def rigid_curve(
    source: Callable[..., Any] | str | Path,
    group: str | None = None,
    name: str = "tool",
    flip: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **parameters: Any,
) -> MeshedTool:
    """Rigid tool of a plane scene whose surface is a gmsh mesh of curves.

    source: a gmsh script, called with `parameters`, or a file as for read_mesh; group: the curve group that is the tool, by
    default all curves. The tool is on the left of its curve: that is where a meshed surface which the curve bounds lies,
    else the curve runs so; flip=True turns it. Raises SceneError, on all ranks, where there is no such curve or where it has
    no length.
    """
    ends, X = read_curve(source, group, comm, **parameters)
    ends = ends[:, ::-1] if flip else ends
    lengths = np.linalg.norm(X[ends[:, 1]] - X[ends[:, 0]], axis=1)
    if not lengths.min() > 1e-12 * np.ptp(X, axis=0).max():
        raise SceneError(f"{name}: a side at {X[ends[lengths.argmin(), 0]]} has no length; mesh that curve again")
    ends, X = joined_sides(ends, X)
    deep = np.array([0.0, 0.0, 0.5 * lengths.mean()])  # the same at either side of the plane, as of a scene's own curves
    nodes = np.ascontiguousarray(np.column_stack([ends, ends[:, ::-1] + len(X)]))
    return MeshedTool(name, nodes, np.full(len(nodes), 4, dtype=np.int64), np.concatenate([X - deep, X + deep]), True)


def _flat(nodes: Ints64, X: Floats) -> Bools:
    """Which facets have no area."""
    return np.linalg.norm(area_vectors(X[nodes]), axis=1) < 1e-12 * np.ptp(X, axis=0).max() ** 2


def _refuse_flat(name: str, nodes: Ints64, X: Floats) -> None:
    flat = np.flatnonzero(_flat(nodes, X))
    if len(flat):
        place = X[nodes[flat[0]]].mean(axis=0)
        raise SceneError(f"{name}: {len(flat)} facets have no area, the first at {place}; mesh that surface again")


def _refuse_mixed(name: str, nodes: Ints64, X: Floats, found: Slits | None) -> None:
    """Two facets that agree on their outside run through their common edge in opposite directions; where more meet in an
    edge there is no telling which of them go on in which. What nearly meets, and is joined in part, may seem so."""
    nearly = f". It may only seem so, for facets nearly meet and do not: {found.told}; export more digits" if found else ""
    start, end = nodes.ravel(), np.roll(nodes, -1, axis=1).ravel()
    start, end = start[start != end], end[start != end]
    edge = np.minimum(start, end) * len(X) + np.maximum(start, end)
    _, first, count = np.unique(edge, return_index=True, return_counts=True)
    onward = np.bincount(np.unique(edge, return_inverse=True)[1], weights=start < end)
    turned, many = first[(count == 2) & (onward != 1.0)], count > 2
    if len(turned):
        raise SceneError(
            f"{name}: neighbouring facets turn different ways, first at {X[start[turned[0]]]}; orient them in the script "
            "with gmsh.model.mesh.setOutwardOrientation(volume) before meshing, or gmsh.model.mesh.reverse([(2, surface)])"
            + nearly
        )
    if many.any():
        middle = 0.5 * (X[start] + X[end])[first[many][0]]
        raise SceneError(
            f"{name}: more than two facets meet in an edge, {count[many][0]} at {middle}, the first of {many.sum()} such "
            "edges, and none of them says where the tool is; leave out walls within the tool, give a rib both of its sides, "
            "or make of parts that touch a tool each" + nearly
        )
