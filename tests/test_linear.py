"""The linear solvers' objects: what a failed factorisation leaves behind, and memory over many solves."""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import Body, Scene, mooney_rivlin, read_gmsh, rigid_plane, solve
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.solvers.reuse import ReusingSolver
from fenics_contact.timing import Timers
from meshes import box

COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def block(cells):
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(cells, cells, cells)), "box", RUBBER))
    scene.fix("zmin")
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize("symmetric", [True, False])
def test_a_failed_factorisation_leaves_nothing(symmetric):
    """MUMPS says a singular matrix is one, twice; the same solver then solves a regular one as if nothing had been."""
    system = block(2).system()
    system.assemble_tangent()
    singular, regular = system.matrix.copy(), system.matrix.copy()
    singular.zeroRowsColumns(np.arange(*singular.getOwnershipRange(), dtype=PETSc.IntType), 0.0)
    regular.shift(1.0)
    solver = ReusingSolver(COMM, 3 * 27, symmetric, "direct", None, Timers())
    right, out = system.new_vector(), system.new_vector()
    right.set(1.0)
    for _ in range(2):
        assert solver.solve(singular, 0, right, out, 1e-8) < 0
        assert solver.mumps_code() < 0  # a singular matrix: -10, or -9, for pivots are delayed until space runs out
    assert solver.solve(regular, 0, right, out, 1e-8) >= 0
    rest = right.copy()
    regular.mult(out, rest)
    rest.axpy(-1.0, right)
    assert rest.norm() < 1e-12 * right.norm()


@pytest.mark.parallel
@pytest.mark.parametrize("symmetric", [True, False])
def test_a_matrix_of_another_pattern_is_factorised_anew(symmetric):
    """PETSc has counted as many changes in either."""
    system = block(2).system()
    system.assemble_tangent()
    one, other = system.matrix.copy(), system.matrix.copy()
    one.shift(1.0), other.shift(100.0)
    assert one.stateGet() == other.stateGet()
    solver = ReusingSolver(COMM, 3 * 27, symmetric, "direct", None, Timers())
    right, out, rest = (system.new_vector() for _ in range(3))
    right.set(1.0)
    for pattern, matrix in enumerate([one, other]):
        assert solver.solve(matrix, pattern, right, out, 1e-8) >= 0
        matrix.mult(out, rest)
        rest.axpy(-1.0, right)
        assert rest.norm() < 1e-12 * right.norm()


@pytest.mark.parallel
@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_no_petsc_error_escapes(linear):
    system = block(2).system()
    system.assemble_residual()
    system.assemble_tangent()
    system.matrix.scale(np.nan)
    solver = LinearSolver(system, linear)
    with pytest.raises(LinearFailure):
        solver.solve(np.zeros(len(system.supports.dofs)), np.zeros((0, 3)))


@pytest.mark.parallel
def test_a_tolerance_below_rounding_is_met_by_rounding():
    scene = block(3)
    plane = rigid_plane((0, 0, 2.0), (0, 0, -1.0))
    scene.contact("zmax", plane, 0.3)
    result = solve(scene, move={plane: (0, 0, -0.2)}, steps=2, tolerance=1e-18, progress=False)
    assert result.converged, result.verdict.reason


def resident():
    """Memory of this process [bytes]."""
    return 4096 * int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.parallel
def test_memory_does_not_grow_with_the_solves():
    """A vector has 10 times the bytes of everything that Python makes meanwhile; less than one of them stays per step."""
    scene = block(14)
    plane = rigid_plane((0, 0, 2.0), (0, 0, -1.0))
    scene.contact("zmax", plane)
    system = scene.system({plane: (0, 0, -0.02)})
    solver = LinearSolver(system, "iterative")

    def some(count):
        for _ in range(count):
            system.begin_step(1.0)
            system.assemble_residual()
            system.assemble_tangent()
            solver.solve(system.supports.values(1.0), np.zeros((1, 3)))
        return resident()

    start = some(5)  # what is made once
    grown, vector = COMM.allreduce(some(25) - start, op=MPI.MAX), 8 * system.vector.getLocalSize()
    assert grown < 25 * vector
