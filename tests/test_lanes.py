"""Cells several at once against dolfinx, which takes one after another: elements, laws, loads; what cannot be treated."""

import numpy as np
import pytest
import ufl
from dolfinx.mesh import meshtags
from mpi4py import MPI
from test_elements import draw_tetrahedra

from fenics_contact import Body, Scene, compat, mooney_rivlin, neo_hooke, read_gmsh
from fenics_contact.assembly.cell_forms import CellForm, LinearForm
from fenics_contact.assembly.pattern import MatrixPattern
from fenics_contact.meshes import box, ring_sector, two_blocks
from fenics_contact.solid import materials, virtual_power

CLASSIC = mooney_rivlin(0.1863, 0.0098, 5.0)
compile_form = compat.compile_form  # what dolfinx assembles by itself


def users_energy(F):
    C, J = F.T * F, ufl.det(F)
    return ufl.tr(C) - 3 - 2 * ufl.ln(J) + ufl.exp(J - 1) + 0.1 * ufl.sin(C[0, 1]) * ufl.cos(J) + ufl.sqrt(ufl.tr(C))


MESHES = {
    "blocks": lambda comm: read_gmsh(two_blocks.build, comm, lower_cells=(3, 2, 1), upper_cells=(2, 2, 2)),
    "hexahedra": lambda comm: read_gmsh(box.build, comm, cells=(3, 3, 2)),
    "tetrahedra": lambda comm: read_gmsh(draw_tetrahedra, comm),
    "quadrilaterals": lambda comm: read_gmsh(ring_sector.build, comm, cells=(3, 5)),
    "triangles": lambda comm: read_gmsh(ring_sector.build, comm, cells=(3, 5), triangles=True),
}
SCENES = {  # cells, law, of the scene
    "hexahedra": ("hexahedra", CLASSIC, {}),
    "hexahedra 2": ("hexahedra", CLASSIC, {"degree": 2}),
    "hexahedra mixed": ("hexahedra", CLASSIC, {"element": "mixed"}),
    "hexahedra 2 mixed": ("hexahedra", neo_hooke(0.4, 5.0), {"degree": 2, "element": "mixed"}),
    "tetrahedra": ("tetrahedra", neo_hooke(0.4, 1.0), {}),
    "tetrahedra 2": ("tetrahedra", neo_hooke(0.4, 1.0), {"degree": 2}),
    "quadrilaterals": ("quadrilaterals", CLASSIC, {"plane": "strain", "thickness": 2.0}),
    "quadrilaterals 2 around": ("quadrilaterals", CLASSIC, {"degree": 2, "plane": "axisymmetric"}),
    "triangles 2 mixed": ("triangles", CLASSIC, {"degree": 2, "element": "mixed", "plane": "strain"}),
    "of two laws": ("blocks", CLASSIC, {}),
    "barrier": ("hexahedra", neo_hooke(0.4, 5.0, volumetric=materials.barrier), {}),
    "Yeoh": ("hexahedra", materials.yeoh(0.2, -0.01, 0.003, 5.0), {}),
    "Ogden": ("hexahedra", materials.ogden((0.6, -0.02), (1.3, -2.0), 5.0), {}),
    "Arruda-Boyce": ("hexahedra", materials.arruda_boyce(0.4, 2.5, 5.0), {}),
    "user's": ("hexahedra", materials.user_energy(users_energy, 1.0, 1.0), {}),
}


def scene_of(name, comm=MPI.COMM_WORLD):
    cells, law, of_scene = SCENES[name]
    mesh = MESHES[cells](comm)
    laws = [law, neo_hooke(0.7, 3.0)]  # of a second body
    scene = Scene(*(Body(mesh, group, law) for group, law in zip(mesh.volumes, laws, strict=False)), **of_scene)
    if cells == "blocks":
        scene.fix("lower_bottom"), scene.fix("upper_top")
    else:
        scene.fix("ymin")
    if name == "hexahedra":  # all that a form's kernel can have for coefficients
        scene.swell("box", lambda X, t: 1.0 + 0.1 * X[:, 0] * t)
    return scene


def assembled(system):
    """The matrix and the residual in a state with every cell strained differently."""
    X = system.space.tabulate_dof_coordinates()
    x, y, z = X.T
    moved = 0.05 * np.stack([np.sin(2 * y + x), np.sin(3 * x * y), np.sin(z - y)], axis=1)
    moved[:, 2] *= system.space.mesh.geometry.dim == 3
    system.begin_step(1.0)
    system.state.u.x.array[:] = moved.ravel()
    system.terms[0].add_residual(system.state, residual := np.zeros(moved.size), np.zeros_like(system.tool_residual))
    system.assemble_tangent(system.terms[:1])
    return system.matrix, residual


def dolfinx_alone(monkeypatch):
    monkeypatch.setattr(compat, "compile_form", lambda form, *_: compile_form(form))


def check(name, monkeypatch):
    system = scene_of(name).system()
    term = system.terms[0]
    assert compat.cell_name(system.space.mesh) in {"tetrahedra": "tetrahedron", "triangles": "triangle"}.get(
        SCENES[name][0], "hexahedron quadrilateral"
    )
    assert all(part.usable for form in term._residuals for part in form._lanes)
    assert all(form._usable for form in term._tangents)
    dolfinx_alone(monkeypatch)
    plain = scene_of(name).system()
    assert not any(form._usable for form in plain.terms[0]._tangents)
    (matrix, residual), (other, expected) = assembled(system), assembled(plain)
    assert np.abs(residual - expected).max() < 1e-13 * system.comm.allreduce(np.abs(expected).max(), MPI.MAX)
    size = other.norm()
    matrix.axpy(-1.0, other)
    assert matrix.norm() < 1e-13 * size


@pytest.mark.serial
@pytest.mark.parametrize("name", SCENES)
def test_as_dolfinx_does_it(name, monkeypatch):
    check(name, monkeypatch)


@pytest.mark.parallel
@pytest.mark.parametrize("name", ["hexahedra", "quadrilaterals"])
def test_as_dolfinx_does_it_on_ranks(name, monkeypatch):
    check(name, monkeypatch)


# ---- one form


def relative(form, space, usable=True):
    """Norm of the difference of CellForm's matrix and dolfinx' over that of the latter."""
    plain, ours = compile_form(form), CellForm(form)
    assert ours._usable == usable
    pattern = MatrixPattern(plain, space)
    matrix, expected = (pattern.matrix(np.empty(0, dtype=np.int64)) for _ in range(2))
    ours.add(matrix)
    compat.assemble_matrix(expected, plain)
    matrix.assemble(), expected.assemble()
    matrix.axpy(-1.0, expected)
    return matrix.norm() / expected.norm()


def mass(space, weight=1.0):
    return weight * ufl.inner(ufl.TrialFunction(space), ufl.TestFunction(space)) * ufl.dx(metadata={"quadrature_degree": 3})


@pytest.mark.parallel
def test_cells_of_two_integrals_on_each_rank():
    """One after the other in the layer that ranks share, too."""
    mesh = read_gmsh(box.build, cells=(3, 3, 3))
    space = compat.lagrange_space(mesh.domain, 1, (3,))
    cells = np.arange(compat.cell_map(mesh.domain).size_local, dtype=np.int32)
    parts = meshtags(mesh.domain, 3, cells, (1 + cells % 2).astype(np.int32))
    dx = ufl.Measure("dx", mesh.domain, subdomain_data=parts, metadata={"quadrature_degree": 3})
    product = ufl.inner(ufl.TrialFunction(space), ufl.TestFunction(space))
    assert relative(product * dx(1) + 7.0 * product * dx(2), space) < 1e-13


def stress(scene, u):
    return virtual_power.stress_power(CLASSIC, u, ufl.TestFunction(scene.space), scene.groups.dx(scene.bodies[0]))


@pytest.mark.serial
def test_an_inverted_cell_has_no_number_and_no_other_cell_loses_its_own():
    scene = scene_of("hexahedra", MPI.COMM_SELF)
    u = compat.Function(scene.space)
    u.x.array[2] = 3.0  # one node far through its cells
    forms = LinearForm(stress(scene, u)), compile_form(stress(scene, u))
    found, expected = np.zeros((2, len(u.x.array)))
    forms[0].add(found)
    compat.assemble_vector(expected, forms[1])
    assert 0 < np.isnan(expected).sum() < len(expected) / 2
    assert np.array_equal(np.isnan(found), np.isnan(expected))


@pytest.mark.serial
def test_a_matrix_that_is_not_symmetric_is_whole():
    space = scene_of("hexahedra", MPI.COMM_SELF).space
    skew = ufl.as_matrix([[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    form = ufl.inner(skew * ufl.TrialFunction(space), ufl.TestFunction(space)) * ufl.dx(metadata={"quadrature_degree": 3})
    assert relative(form, space) < 1e-14


@pytest.mark.serial
def test_what_cannot_be_treated_is_left_to_dolfinx():
    scene = scene_of("hexahedra", MPI.COMM_SELF)
    space, u = scene.space, compat.Function(scene.space)
    X = ufl.SpatialCoordinate(scene.mesh.domain)
    cases = {
        "another law on one side": ufl.conditional(ufl.lt(X[0], 0.4), 1.0, 2.0),  # lanes would have to part
        "a function that is not known": ufl.atan(X[0]),
    }
    for case, weight in cases.items():
        assert relative(mass(space, weight), space, usable=False) < 1e-14, case
    v, ds = ufl.TestFunction(space), ufl.ds(scene.mesh.domain)
    both = stress(scene, u) + ufl.inner(ufl.as_vector((1.0, 2.0, 3.0)), v) * ds  # its facets go apart
    form, found, expected = LinearForm(both), *np.zeros((2, len(u.x.array)))
    assert [part.usable for part in form._lanes] == [True, False]
    form.add(found)
    compat.assemble_vector(expected, compile_form(both))
    assert np.abs(found - expected).max() < 1e-14 * np.abs(expected).max()


@pytest.mark.serial
def test_a_compiler_without_vectors_gets_the_source_as_it_is(capfd):
    space = scene_of("hexahedra", MPI.COMM_SELF).space
    form = mass(space, 1.25)
    refused = compat.compile_form(form, lambda source: "#error no vectors here\n" + source, "refused")
    assert "no vectors here" in capfd.readouterr().err
    assert compat.cell_kernels(refused) is None
    matrix = compat.create_matrix(refused)
    compat.assemble_matrix(matrix, refused)
    matrix.assemble()
    assert matrix.norm() > 0.0
