"""Stresses at nodes: what is linear is found everywhere, bodies are apart, closed forms at walls, one process and two."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from test_elements import draw_tetrahedra

from fenics_contact import Body, Scene, compat, neo_hooke, read_gmsh, solve
from fenics_contact.assembly.facet_points import geometry_degree
from fenics_contact.meshes import box, rectangles, tubes
from fenics_contact.output.fields import Fields
from fenics_contact.output.places import centre_of, inner_points
from fenics_contact.output.recovery import Patches

COMM = MPI.COMM_WORLD
SLOPES = np.array([[1.0, -0.3, 0.2], [0.7, 2.0, -1.0], [0.1, 0.4, -0.6]])


MESHES = {
    "hexahedra": lambda: read_gmsh(box.build, COMM, size=(3.0, 2.0, 1.0), cells=(4, 3, 2)),
    "tetrahedra": lambda: read_gmsh(draw_tetrahedra, COMM),
    "triangles": lambda: read_gmsh(
        rectangles.build, COMM, rectangles={"sheet": ((0.0, 0.0), (3.0, 2.0), (4, 3))}, triangles=True
    ),
}


def points_in(mesh, inner):
    """Places (cells, k, 3) of the points of the cells that a rank owns."""
    cell = compat.cell_name(mesh)
    at = inner_points(cell) if inner else centre_of(cell)[None]
    table = compat.tabulate(compat.basix_element(cell, geometry_degree(mesh)), 0, at)[0]
    own = compat.cell_map(mesh).size_local
    return np.einsum("kn,cnx->ckx", table, mesh.geometry.x[compat.geometry_dofmap(mesh)[:own]])


@pytest.mark.parallel
@pytest.mark.parametrize("inner", [False, True], ids=["centres", "Gauss points"])
@pytest.mark.parametrize("kind", MESHES)
def test_what_is_linear_is_found_at_every_node(kind, inner):
    mesh = MESHES[kind]().domain
    space, points = compat.lagrange_space(mesh, 1), points_in(mesh, inner)
    dim = mesh.topology.dim
    patches = Patches(space, np.arange(len(points), dtype=np.int32), points)
    X = space.tabulate_dof_coordinates()
    assert len(patches.nodes) == len(X)
    found = patches.fitted(5.0 + points[..., :dim] @ SLOPES[:dim])
    np.testing.assert_allclose(found, 5.0 + X[:, :dim] @ SLOPES[:dim], atol=1e-12)


@pytest.mark.parallel
def test_a_body_of_one_layer_has_what_changes_along_it():
    mesh = read_gmsh(box.build, COMM, size=(3.0, 2.0, 0.1), cells=(4, 3, 1)).domain
    space, points = compat.lagrange_space(mesh, 1), points_in(mesh, False)
    found = Patches(space, np.arange(len(points), dtype=np.int32), points).fitted(points[..., :2] @ SLOPES[:2])
    np.testing.assert_allclose(found, space.tabulate_dof_coordinates()[:, :2] @ SLOPES[:2], atol=1e-12)


def tube(cells, degree=1, order=1, depth=None):
    """Hoop stress over the pressure within a quarter of a tube of radii 1 and 2, at the nodes of the bore and outside."""

    def build():
        tubes.build({"tube": (1.0, 2.0, 3 * cells, cells)}, depth=depth)
        gmsh.model.mesh.setOrder(order)

    body = Body(read_gmsh(build, COMM), "tube", neo_hooke(1.0, 10.0))
    scene = Scene(body, degree=degree, plane=None if depth else "strain")
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    if depth:
        scene.fix("ends", "z")
    scene.pressure("tube_inside", PRESSURE)
    fields = Fields(scene, solve(scene, steps=1).require().system)
    fields.update()
    owned = fields.corner_stress.function_space.dofmap.index_map.size_local
    X = fields.corner_stress.function_space.tabulate_dof_coordinates()[:owned]
    R = np.hypot(X[:, 0], X[:, 1])
    around = np.stack([-X[:, 1], X[:, 0], 0.0 * R], axis=1) / R[:, None]
    nodal = np.einsum("ni,nij,nj->n", around, fields.corner_stress.x.array.reshape(-1, 3, 3)[:owned], around) / PRESSURE
    bore, outside = (np.concatenate(COMM.allgather(nodal[np.abs(R - r) < 1e-6])) for r in (1.0, 2.0))
    return bore, outside


PRESSURE = 1e-5  # of a shear modulus of one: small strain
BORE, OUTSIDE = 5 / 3, 2 / 3  # Lamé


@pytest.mark.parallel
@pytest.mark.parametrize("case", [{}, {"depth": 1.0}, {"degree": 2, "order": 2}], ids=["plane", "a layer", "degree 2"])
def test_hoop_stress_at_the_walls_of_a_tube_is_of_second_order(case):
    errors = []
    for cells in (4, 8):
        bore, outside = tube(cells, **case)
        errors.append((np.abs(bore - BORE).max(), np.abs(outside - OUTSIDE).max()))
    coarse, fine = np.array(errors)
    assert (np.log2(coarse / fine) > 1.6).all(), errors
    assert fine[0] < 0.04 * BORE and fine[1] < 0.02 * OUTSIDE, errors


def bonded():
    soft, stiff = (((0.0, y), (2.0, 1.0), (4, 2)) for y in (0.0, 1.0))
    rectangles.build({"soft": soft, "stiff": stiff})
    gmsh.model.mesh.removeDuplicateNodes()


@pytest.mark.parallel
def test_bodies_that_share_nodes_have_stresses_of_their_own():
    """Bonded blocks, one ten times as stiff, stretched alike."""
    mesh = read_gmsh(bonded, COMM)
    soft, stiff = Body(mesh, "soft", neo_hooke(1.0, 2.0)), Body(mesh, "stiff", neo_hooke(10.0, 20.0))
    scene = Scene(soft, stiff, plane="strain")
    scene.fix(("soft_xmin", "stiff_xmin"), "x")
    scene.fix("soft_ymin", "y")
    scene.prescribe(("soft_xmax", "stiff_xmax"), "x", 0.5)
    fields = Fields(scene, solve(scene, steps=2).require().system)
    fields.update()
    (_, lower), (_, upper) = fields.by_body
    both = [np.concatenate(COMM.allgather(part[:, 0, 0])) for part in (lower, upper)]
    np.testing.assert_allclose(both[0], both[0][0], rtol=1e-7)
    np.testing.assert_allclose(both[1], 10.0 * both[0][0], rtol=1e-7)
    X = fields.corner_stress.function_space.tabulate_dof_coordinates()
    seam = fields.corner_stress.x.array.reshape(-1, 9)[np.abs(X[:, 1] - 1.0) < 1e-9, 0]
    np.testing.assert_allclose(seam, 5.5 * both[0][0], rtol=1e-7)
