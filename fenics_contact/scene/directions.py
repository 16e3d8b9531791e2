"""Along what a support acts: axes by letters, any direction, or the normals of flat surfaces."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.contact.master import area_vectors, oriented_facets
from fenics_contact.mesh_io import NamedMesh
from fenics_contact.types import Floats, Space
from fenics_contact.values import SceneError, finite, flag, group_names, shown

Group = str | tuple[str, ...]
Unit = tuple[float, ...]  # a direction (3,) of length one

FLAT = 1e-6  # of a surface's size: how far its nodes may lie out of their plane, a hundred times gmsh's own tolerance
AXIS = 1e-12  # a part of a direction that is rounding


def unit(direction: object, what: str) -> Unit:
    """A stated direction (3,) of any length, of length one."""
    vector = finite(direction, f"{what}: direction", (3,))
    if not vector.any():
        raise SceneError(f"{what}: direction {shown(direction)} has no length")
    return _rounded(vector / np.abs(vector).max())


def _rounded(vector: Floats) -> Unit:
    vector = vector / np.linalg.norm(vector)
    vector = np.where(np.abs(vector) < AXIS, 0.0, vector)
    return tuple(float(part) for part in vector / np.linalg.norm(vector))


def normals(mesh: NamedMesh, space: Space, group: Group, what: str) -> list[tuple[tuple[str, ...], Unit]]:
    """(name, outward normal) of each of the flat surfaces named. Collective."""
    out: list[tuple[tuple[str, ...], Unit]] = []
    for name in group_names(group):
        if name in {**mesh.edges, **mesh.points}:
            raise SceneError(f"{what}: '{name}' is no surface and has no normal; give direction=(x, y, z)")
        facets = mesh.facets(name)
        mesh.refuse_inside(facets, what)
        nodes, _, _ = oriented_facets(space, facets)
        corners = space.tabulate_dof_coordinates()[nodes]
        corners[:, 2:, 2] += float(mesh.plane)  # sides as strips
        total = sum(mesh.comm.allgather(area_vectors(corners).sum(axis=0)))
        points = np.concatenate(mesh.comm.allgather(corners.reshape(-1, 3)))
        size, area = float(np.ptp(points, axis=0).max()), float(np.linalg.norm(total))
        normal = total / max(area, 1e-300)
        out_of_plane = float(np.ptp(points @ normal)) if area > FLAT * size**2 else size
        if out_of_plane > FLAT * size:
            raise SceneError(
                f"{what}: surface '{name}' is not flat, its nodes lie {out_of_plane:.3g} out of a plane; give "
                "direction=(x, y, z), or name flat parts of it"
            )
        out.append(((name,), _rounded(normal)))
    return out


def chosen(axis: object, direction: Sequence[float] | None, normal: bool, what: str) -> None:
    """One of the three ways to say a direction must be taken."""
    flag(normal, f"{what}: normal")
    if (axis is not None) + (direction is not None) + normal > 1:
        raise SceneError(f"{what}: axis=, direction= and normal=True are three ways to say one thing; give one")


def unsigned(direction: Unit) -> Unit:
    """The same line: along an axis, not against it."""
    return tuple(abs(part) for part in direction) if np.count_nonzero(direction) == 1 else direction
