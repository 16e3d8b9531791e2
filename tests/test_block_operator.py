"""Our own products with matrices of 3x3 blocks, as PETSc sees them."""

import gc

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import Body, Method, Scene, mooney_rivlin, read_gmsh, rigid_plane, solve
from fenics_contact.assembly import block_operator
from fenics_contact.assembly.block_operator import BlockOperator
from fenics_contact.assembly.gauss_seidel import GaussSeidel
from fenics_contact.kernels.block_products import add_product
from fenics_contact.meshes import box, two_blocks
from fenics_contact.solvers.multigrid import hierarchy_of, multigrid

COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
pytestmark = pytest.mark.parallel


def tangent(cells=4):
    """System of two blocks in frictional contact with its tangent, unsymmetric, assembled in a state of no meaning."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(2 * cells, 2 * cells, 2), upper_cells=(cells + 1, cells + 1, 2))
    scene = Scene(*(Body(mesh, name, RUBBER) for name in ("lower", "upper")))
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "z", -0.4)
    scene.contact("upper_bottom", "lower_top", 0.3, name="c")
    system = scene.system()
    system.begin_step(1.0)
    system.state.u.x.array[:] = 0.03 * np.sin(system.space.tabulate_dof_coordinates()).ravel()
    system.assemble_residual()
    system.assemble_tangent()
    return system


def some(system):
    x = system.new_vector()
    first, end = x.getOwnershipRange()
    x.array_w[:] = np.cos(np.arange(first, end))
    return x


def apart(a, b):
    difference = a.copy()
    difference.axpy(-1.0, b)
    return difference.norm() / b.norm()


@pytest.mark.parametrize("kind", ["baij", "aij"])
def test_the_product_is_petsc_s(kind):
    system = tangent()
    x, ours, theirs = some(system), system.new_vector(), system.new_vector()
    matrix = system.matrix if kind == "baij" else system.matrix.convert("aij", out=PETSc.Mat())
    blocks = BlockOperator(matrix)
    for _ in range(2):
        matrix.mult(x, theirs)
        blocks.mat.mult(x, ours)
        assert apart(ours, theirs) < 1e-14
        matrix.scale(2.0)  # the entries are the matrix' own; one by scalars must be given again
        blocks.use(matrix, 1)
    blocks.destroy()


def test_another_matrix_can_be_given():
    system, other = tangent(), tangent(3)
    blocks = BlockOperator(system.matrix)
    larger = system.matrix.copy()
    larger.shift(7.0)
    x, ours, theirs = some(system), system.new_vector(), system.new_vector()
    for pattern, matrix in enumerate([larger, system.matrix, larger]):
        blocks.use(matrix, pattern)
        matrix.mult(x, theirs)
        blocks.mat.mult(x, ours)
        assert apart(ours, theirs) < 1e-14
    blocks.destroy()
    del system
    gc.collect()
    x, ours, theirs = some(other), other.new_vector(), other.new_vector()
    blocks = BlockOperator(other.matrix)
    other.matrix.mult(x, theirs)
    blocks.mat.mult(x, ours)
    assert apart(ours, theirs) < 1e-14
    blocks.destroy()


def test_the_blocks_on_the_diagonal_are_inverted():
    system = tangent()
    system.matrix.shift(1e-3)
    blocks = BlockOperator(system.matrix)
    inverse = system.matrix.invertBlockDiagonal().reshape(-1, 3, 3)
    for _ in range(2):
        found = np.zeros(9 * blocks.rows)
        blocks.inverses(found)
        found = found.reshape(-1, 3, 3).transpose(0, 2, 1)
        np.testing.assert_allclose(found, inverse, rtol=1e-9, atol=1e-12 * np.abs(inverse).max())
        system.matrix.scale(4.0)
        inverse = inverse / 4.0
    blocks.destroy()


def gathered(matrix):
    """All of a matrix, on every process."""
    first, end = matrix.getOwnershipRange()
    own = matrix.getValues(np.arange(first, end, dtype=np.int32), np.arange(matrix.getSize()[1], dtype=np.int32))
    return np.concatenate(COMM.allgather(own))


@pytest.mark.parametrize("sweeps", [1, 2])
def test_sweeps_are_those_of_gauss_and_seidel(sweeps):
    """By the triangles of the whole matrix, rows in the order of the sweeps; again once the matrix has changed."""
    system = tangent(2)
    system.matrix.shift(1e-3)
    blocks, pc = BlockOperator(system.matrix), PETSc.PC().create(COMM)
    pc.setOperators(blocks.rounded)
    relaxation, (inner, border, place, turn, turns) = GaussSeidel(pc, blocks, sweeps), blocks.order
    assert (turns > 1) == (COMM.size > 1) and (len(border) > 0) == (COMM.size > 1)
    assert np.array_equal(np.sort(place), np.arange(blocks.rows)) and place[inner].max() == len(inner) - 1
    b, found = some(system), system.new_vector()
    first, end = b.getOwnershipRange()
    when = np.zeros(blocks.rows)
    when[border] = 1 + turn
    places = np.empty(b.getSize(), dtype=int)
    when = np.repeat(np.concatenate(COMM.allgather(when)), 3)
    places[np.argsort(when, kind="stable")] = np.arange(len(places)) // 3
    side = np.concatenate(COMM.allgather(b.array_r.copy()))
    for pattern in range(2):
        dense = gathered(system.matrix)
        lower, upper = np.where(places[:, None] > places, dense, 0.0), np.where(places[:, None] < places, dense, 0.0)
        expected = np.zeros(len(dense))
        for _ in range(sweeps):
            expected = np.linalg.solve(dense - upper, side - upper @ expected)
            expected = np.linalg.solve(dense - lower, side - lower @ expected)
        pc.apply(b, found)
        # the blocks are rounded to 6e-8, and the tangent of no meaning has some that are nearly singular
        np.testing.assert_allclose(found.array_r, expected[first:end], atol=1e-5 * np.abs(expected).max())
        system.matrix.shift(2.0)
        blocks.use(system.matrix, pattern)
        relaxation.renew()
    pc.destroy(), blocks.destroy()


@pytest.mark.parametrize("levels", [1, 2])
def test_a_cycle_is_linear_and_lowers_the_error(levels):
    """Of a matrix that is all in one level, too: fewer unknowns than PETSc coarsens. Where there are more, nothing holds the
    copy by scalars any more, a quarter of a run's memory."""
    count = 1 if levels == 1 else 7
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(count, count, count)), "box", RUBBER))
    scene.fix("zmin")
    system = scene.system()
    system.assemble_residual()
    system.assemble_tangent()
    matrix = system.supports.eliminated(system.matrix, 1.0)
    scalars = matrix.convert("aij", out=PETSc.Mat())
    blocks = BlockOperator(matrix)
    pc, _kept = multigrid(hierarchy_of(scalars, "test_"), blocks, "test_")
    assert (pc.getType() == "mg") == (levels > 1)
    assert (scalars.refcount == 1) == (levels > 1)
    x = some(system)
    once, twice, right = system.new_vector(), system.new_vector(), system.new_vector()
    matrix.mult(x, right)
    pc.apply(right, once)
    assert apart(once, x) < 0.9
    right.scale(-3.0)
    pc.apply(right, twice)
    once.scale(-3.0)
    assert apart(twice, once) < 1e-12
    pc.destroy(), blocks.destroy(), scalars.destroy()


@pytest.mark.parametrize("option", [("fc_pc_type", "jacobi"), ("fc_cycle_mg_levels_ksp_max_it", 2)])
def test_options_of_the_user_s_own_reach_petsc(option):
    """Another preconditioner, or another cycle: the same forces."""
    found = []
    for given in (False, True):
        scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(4, 4, 4)), "box", RUBBER))
        scene.fix("zmin")
        plate = rigid_plane((0, 0, 2), (0, 0, -1), name="plate")
        scene.contact("zmax", plate, name="lid")
        if given:
            PETSc.Options()[option[0]] = option[1]
        try:
            result = solve(scene, move={plate: (0, 0, -0.2)}, steps=2, method=Method(linear="iterative")).require()
        finally:
            PETSc.Options().delValue(option[0])
        found.append((result.history[-1]["lid_force_z_N"], result.summary["method"]["krylov_iterations"]))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-7) and found[0][1] != found[1][1]


@pytest.mark.parametrize("at", [3, 60])
def test_an_interrupt_within_a_product_ends_the_solve(monkeypatch, at):
    """While the hierarchy is made, and while it serves."""
    calls = []

    def interrupted(*given):
        calls.append(0)
        if len(calls) == at:
            raise KeyboardInterrupt
        add_product(*given)

    monkeypatch.setattr(block_operator, "add_product", interrupted)
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(4, 4, 4)), "box", RUBBER))
    scene.fix("zmin")
    scene.prescribe("zmax", "z", -0.2)
    with pytest.raises(KeyboardInterrupt):
        solve(scene, steps=4, method=Method(linear="iterative"))
    assert len(calls) >= at
    monkeypatch.setattr(block_operator, "add_product", add_product)
    assert solve(scene, steps=1, method=Method(linear="iterative")).converged  # nothing of it is left
