"""Where a point of the undeformed bodies lies: its cell, and its place in it."""

import basix
import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.facet_points import geometry_degree
from fenics_contact.assembly.section import ON_AXIS, Section
from fenics_contact.types import Bools, Floats, Function, Mesh

INSIDE = 1e-6  # of a cell: a point so far outside still counts as in it
STEPS = 20  # of Newton's method: one suffices in a parallelepiped

Place = tuple[int, int, Floats]  # rank, local cell, place (2,) or (3,) in the reference cell


def locate(comm: MPI.Comm, mesh: Mesh, point: Floats) -> Place:
    """The place of a point (3,) [length], in the first cell of the gmsh model that holds it. Collective.

    ValueError, on all ranks, where none does.
    """
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)[: compat.cell_map(mesh).size_local]]
    near = np.flatnonzero(_in_boxes(x, point))
    local = _pulled_back(mesh, x[near], point)
    cell = compat.cell_name(mesh)
    inside = _outside(cell, local) <= INSIDE
    numbers = compat.original_cells(mesh)[near[inside]].astype(float)
    here = (np.inf, -1, local[:0].sum(axis=0))
    if len(numbers):
        first = int(numbers.argmin())
        here = (float(numbers[first]), int(near[inside][first]), local[inside][first])
    everywhere = comm.allgather(here)
    rank = int(np.argmin([number for number, _, _ in everywhere]))
    _, found, at = everywhere[rank]
    if found < 0:
        raise ValueError(
            f"the point {tuple(point)} lies in no body; give one of the undeformed bodies in their unit of length"
        )
    return rank, found, at


def interpolated(u: Function, cell: int, local: Floats, section: Section | None = None) -> tuple[Floats, Floats]:
    """A vector Function (3,) and its gradient (3, 3) at a place of a local cell; section: what a plane mesh stands for."""
    space = u.function_space
    mesh, name = space.mesh, compat.cell_name(space.mesh)
    table = compat.tabulate(compat.basix_element(name, compat.degree(space)), 1, local[None])[:, 0]
    shape = compat.tabulate(compat.basix_element(name, geometry_degree(mesh)), 1, local[None])[1:, 0]
    x, dim = mesh.geometry.x[compat.geometry_dofmap(mesh)[cell]], mesh.topology.dim
    slopes = shape @ x[:, :dim]  # row r: dX/dxi_r
    nodal = u.x.array.reshape(-1, 3)[compat.cell_dofs(space)[cell]]
    value, gradient = table[0] @ nodal, np.zeros((3, 3))
    gradient[:, :dim] = (np.linalg.inv(slopes) @ table[1:] @ nodal).T
    if section is not None and section.axisymmetric:
        form = compat.tabulate(compat.basix_element(name, geometry_degree(mesh)), 0, local[None])[0, 0]
        R = float(form @ x[:, 0])
        gradient[2, 2] = value[0] / R if ON_AXIS * np.abs(x).max() < R else gradient[0, 0]
    return value, gradient


def _in_boxes(x: Floats, point: Floats) -> Bools:
    """Which cells with nodes x (n, k, 3) have the point in their boxes."""
    low, high = x.min(axis=1), x.max(axis=1)
    slack = INSIDE * (high - low).max(axis=1, keepdims=True)
    return np.asarray(((point >= low - slack) & (point <= high + slack)).all(axis=1))


def _pulled_back(mesh: Mesh, x: Floats, point: Floats) -> Floats:
    """Places (n, 3) of the point in the reference cells of cells with nodes x (n, k, 3), by Newton's method."""
    cell = compat.cell_name(mesh)
    element, local = compat.basix_element(cell, geometry_degree(mesh)), np.tile(centre_of(cell), (len(x), 1))
    dim = mesh.topology.dim
    x, point = x[..., :dim], point[:dim]
    for _ in range(STEPS if len(x) else 0):
        table = compat.tabulate(element, 1, local)
        slopes = np.einsum("rnk,nkc->ncr", table[1:], x)
        step = np.linalg.solve(slopes, (point - np.einsum("nk,nkc->nc", table[0], x))[..., None])[..., 0]
        local = np.clip(local + step, -2.0, 3.0)
        if np.abs(step).max() < 1e-14:
            break
    return local


def _outside(cell: str, local: Floats) -> Floats:
    """How far outside the reference cell places (n, 2 or 3) are."""
    beyond = np.maximum(-local, local - 1.0).max(axis=1, initial=-np.inf)
    return np.maximum(beyond, local.sum(axis=1) - 1.0) if cell in ("tetrahedron", "triangle") else beyond


def centre_of(cell: str) -> Floats:
    """The middle (2,) or (3,) of the reference cell."""
    return np.asarray(basix.geometry(getattr(basix.CellType, cell)).mean(axis=0))


def inner_points(cell: str) -> Floats:
    """Points (n, dim) of the reference cell at which strains of displacements of degree 2 are most accurate: Gauss'."""
    degree = 2 if cell in ("tetrahedron", "triangle") else 3
    return np.asarray(basix.make_quadrature(getattr(basix.CellType, cell), degree)[0])


def corner_weights(cell: str, degree: int) -> Floats:
    """Weights (nodes, corners) of a cell's corners in its nodes of a degree, between which what is linear is their mean."""
    return np.asarray(compat.tabulate(compat.basix_element(cell, 1), 0, compat.basix_element(cell, degree).points)[0])
