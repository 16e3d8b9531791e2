"""The linear solvers' objects: what a failed factorisation leaves behind, and memory over many solves."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import Body, Method, Scene, blas, mooney_rivlin, neo_hooke, read_gmsh, rigid_plane, rigid_punch, solve
from fenics_contact.meshes import box, punch_plate
from fenics_contact.solvers import factors, reuse
from fenics_contact.solvers import linear as linear_solver
from fenics_contact.solvers.choice import EARLIEST, ENOUGH, OTHER, Choice, foreseen_costs
from fenics_contact.solvers.free_rows import Rows
from fenics_contact.solvers.linear import LinearFailure, LinearSolver
from fenics_contact.solvers.multigrid import multigrid
from fenics_contact.solvers.reuse import ReusingSolver
from fenics_contact.timing import Timers

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
    solver = ReusingSolver(Rows(COMM, 3 * 27), symmetric, "direct", None, Timers())
    right, out = system.new_vector(), system.new_vector()
    right.set(1.0)
    for _ in range(2):
        assert solver.solve(singular, 0, right, out, 1e-8) < 0
        assert solver.mumps_code < 0  # a singular matrix: -10, or -9, for pivots are delayed until space runs out
    assert solver.solve(regular, 0, right, out, 1e-8) >= 0
    rest = right.copy()
    regular.mult(out, rest)
    rest.axpy(-1.0, right)
    assert rest.norm() < 1e-12 * right.norm()


@pytest.mark.parallel
@pytest.mark.parametrize("symmetric", [True, False])
def test_a_factorisation_short_of_workspace_gets_more(symmetric, monkeypatch):
    """What MUMPS foresees is too little now and then on several ranks: no sign of a singular matrix."""
    monkeypatch.setattr(factors, "WORKSPACE", (-90, 100))
    monkeypatch.setattr(factors, "PLAIN", 0)
    system = block(4).system()
    system.assemble_tangent()
    regular = system.matrix.copy()
    regular.shift(1.0)
    solver = ReusingSolver(Rows(COMM, 3 * 125), symmetric, "direct", None, Timers())
    right, out, rest = (system.new_vector() for _ in range(3))
    right.set(1.0)
    for _ in range(2):
        assert solver.solve(regular, 0, right, out, 1e-8) >= 0
        regular.mult(out, rest)
        rest.axpy(-1.0, right)
        assert rest.norm() < 1e-12 * right.norm()
    assert solver.builds == 2 and solver.mumps_code == 0  # the second solve has the first one's
    other = regular.copy()
    other.shift(1.0)
    assert solver.solve(other, 1, right, out, 1e-8) >= 0 and solver.builds == 3
    assert solver._factors._pc.getFactorMatrix().getMumpsIcntl(14) == 100  # kept with another pattern


@pytest.mark.parallel
@pytest.mark.parametrize("plane", [True, False])
def test_what_lies_in_a_plane_is_ordered_by_minimum_degree(plane, monkeypatch):
    """Also when the pattern has changed, and no other scene's matrices are."""
    monkeypatch.setattr(factors, "PLAIN", 0)
    system = block(4).system()
    system.assemble_tangent()
    right, out = (system.new_vector() for _ in range(2))
    right.set(1.0)
    solver = ReusingSolver(Rows(COMM, 3 * 125, plane=plane), True, "direct", None, Timers())
    for pattern in range(2):
        matrix = system.matrix.copy()
        matrix.shift(1.0 + pattern)
        assert solver.solve(matrix, pattern, right, out, 1e-8) >= 0
        assert (solver._factors._pc.getFactorMatrix().getMumpsInfog(7) == factors.MINIMUM_DEGREE) is plane
        assert not PETSc.Options().hasName("fc_" + factors.ORDERING)


def small_matrix(dense, symmetric):
    """A matrix of 3x3 blocks of these numbers, for one process, and a solver of such."""
    matrix = PETSc.Mat().createBAIJ(dense.shape, 3, comm=MPI.COMM_SELF)
    matrix.setUp()
    for i in range(0, len(dense), 3):
        for j in range(0, len(dense), 3):
            matrix.setValuesBlocked([i // 3], [j // 3], dense[i : i + 3, j : j + 3])
    matrix.assemble()
    return matrix, ReusingSolver(Rows(MPI.COMM_SELF, len(dense)), symmetric, "direct", None, Timers())


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("negative", [0, 1, 2, 5])
def test_pivots_of_petscs_own_factorisation_have_the_signs_of_eigenvalues(symmetric, negative):
    """As many negative ones as the matrix has eigenvalues, and of an unsymmetric one its determinant's sign."""
    random = np.random.default_rng(negative)
    turn, _ = np.linalg.qr(random.normal(size=(30, 30)))
    values = np.linspace(1.0, 2.0, 30) * np.where(np.arange(30) < negative, -1.0, 1.0)
    dense = turn @ (values[:, None] * turn.T) + (0.0 if symmetric else 0.01 * random.normal(size=(30, 30)))
    matrix, solver = small_matrix(dense, symmetric)
    right, out = matrix.createVecs()
    right.set(1.0)
    assert solver.solve(matrix, 0, right, out, 1e-8) >= 0 and solver._factors.plain
    assert out.array_r == pytest.approx(np.linalg.solve(dense, np.ones(30)), rel=1e-9)
    assert solver.negative_pivots() == (negative if symmetric else int(np.linalg.det(dense) < 0.0))


@pytest.mark.parametrize("pivot", [0.0, 1e-13], ids=["none", "tiny"])
@pytest.mark.parametrize("symmetric", [True, False])
def test_a_pivot_too_small_for_petscs_own_factorisation_has_mumps_take_over(symmetric, pivot):
    """It exchanges no rows. A saddle point's unknowns without a diagonal need that."""
    dense = np.kron(np.eye(10), np.array([[pivot, 1.0, 0.0], [1.0, pivot, 0.0], [0.0, 0.0, 1.0]]))
    dense += 0.01 * np.diag(np.ones(29), 1) + (0.01 if symmetric else 0.02) * np.diag(np.ones(29), -1)
    matrix, solver = small_matrix(dense, symmetric)
    right, out = matrix.createVecs()
    right.array_w[:] = np.cos(np.arange(30))
    for _ in range(2):
        assert solver.solve(matrix, 0, right, out, 1e-8) >= 0 and not solver._factors.plain
        assert out.array_r == pytest.approx(np.linalg.solve(dense, right.array_r), rel=1e-9, abs=1e-10)
    assert solver.negative_pivots() == (10 if symmetric else 0)


@pytest.mark.parallel
@pytest.mark.parametrize("symmetric", [True, False])
def test_a_matrix_of_another_pattern_is_factorised_anew(symmetric):
    """PETSc has counted as many changes in either."""
    system = block(2).system()
    system.assemble_tangent()
    one, other = system.matrix.copy(), system.matrix.copy()
    one.shift(1.0), other.shift(100.0)
    assert one.stateGet() == other.stateGet()
    solver = ReusingSolver(Rows(COMM, 3 * 27), symmetric, "direct", None, Timers())
    right, out, rest = (system.new_vector() for _ in range(3))
    right.set(1.0)
    for pattern, matrix in enumerate([one, other]):
        assert solver.solve(matrix, pattern, right, out, 1e-8) >= 0
        matrix.mult(out, rest)
        rest.axpy(-1.0, right)
        assert rest.norm() < 1e-12 * right.norm()


@pytest.mark.parallel
@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("above", [0, 10**6], ids=["old factors precondition", "factors solve"])
def test_rows_that_supports_hold_are_not_factorised(symmetric, above, monkeypatch):
    """Of a block on its base MUMPS gets the nodes above it; held rows of the whole system are solved all the same."""
    monkeypatch.setattr(reuse, "REUSE_ABOVE", above)
    system = block(3).system()
    system.assemble_tangent()
    held, rest = system.supports.owned, system.new_vector()
    matrix = system.supports.eliminated(system.matrix, 2.0)
    solver = ReusingSolver(Rows(COMM, 3 * 64, held), symmetric, "direct", None, Timers())
    right, out = system.new_vector(), system.new_vector()
    right.array_w[:] = np.cos(np.arange(*right.getOwnershipRange()))
    for _ in range(2):
        assert solver.solve(matrix, 0, right, out, 1e-12) >= 0
        matrix.mult(out, rest)
        rest.axpy(-1.0, right)
        assert rest.norm() < 1e-11 * right.norm()
        assert out.array_r[held] == pytest.approx(right.array_r[held] / matrix.getDiagonal().array_r[held], rel=1e-10)
        matrix.shift(1e-3)
    assert solver.builds == (1 if above == 0 else 2) and (solver.iterations > 2) == (above == 0)
    assert solver.negative_pivots() == 0
    assert solver._rows.inner.getOperators()[1].getSize() == (3 * 48, 3 * 48)


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


def pressed():
    """A slender bar pressed past its buckling load, and straight: its tangent resists some motions by less than nothing."""
    scene = Scene(Body(read_gmsh(box.build, size=(1.0, 1.0, 8.0), cells=(2, 2, 12)), "box", neo_hooke(1.0, 3.0)))
    scene.fix("zmin")
    scene.traction("xmax", (1.0, 0.3, 0.2))
    system = scene.system()
    system.state.u.x.array.reshape(-1, 3)[:, 2] = -0.005 * system.space.tabulate_dof_coordinates()[:, 2]
    system.begin_step(1.0)
    system.assemble_residual()
    system.assemble_tangent()
    return system


@pytest.mark.parallel
def test_the_iterative_solver_solves_where_the_tangent_is_indefinite():
    """As on Newton's way at a kink: conjugate gradients end there, and each end costs a step cut back."""
    system, found = pressed(), []
    for method in ("direct", "iterative"):
        solver = LinearSolver(system, method)
        found.append(solver.solve(*system.still(), tolerance=1e-8)[0])
        assert method == "iterative" or solver.negative > 0
    found[1].axpy(-1.0, found[0])
    assert found[1].norm() < 1e-5 * found[0].norm()  # 1e-8 of the forces, times the tangent's condition


@pytest.mark.parallel
def test_to_factorise_is_the_remedy_where_iterations_do_not_suffice(monkeypatch):
    """Whoever states the iterative solver has no other one that takes over."""
    monkeypatch.setattr(reuse, "LONGEST", 2)
    scene = block(2)
    scene.traction("zmax", (0.0, 0.0, -0.05))
    verdict = solve(scene, steps=1, method=Method(linear="iterative")).verdict
    assert verdict.remedy.startswith("let the linear solver factorise"), verdict.reason
    assert solve(scene, steps=1, method=Method(linear="auto")).converged


@pytest.mark.parallel
def test_a_tolerance_below_rounding_is_met_by_rounding():
    scene = block(3)
    plane = rigid_plane((0, 0, 2.0), (0, 0, -1.0))
    scene.contact("zmax", plane, 0.3)
    result = solve(scene, move={plane: (0, 0, -0.2)}, steps=2, method=Method(tolerance=1e-18))
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


@pytest.mark.parametrize("ratio", [1.0, 1.3])
def test_hierarchies_of_graded_meshes_coarsen(ratio, monkeypatch):
    """By four from level to level, whether cells are alike or grow by three tenths from row to row."""
    made = []

    def spied(*arguments):
        cycle, relaxation = multigrid(*arguments)
        made.append([cycle.getMGSmoother(i).getOperators()[0].getSize()[0] for i in range(cycle.getMGLevels())])
        return cycle, relaxation

    monkeypatch.setattr(reuse, "multigrid", spied)
    mesh = read_gmsh(punch_plate.build, inside=12, outside=10, layers=6, ratio=ratio)
    scene = Scene(Body(mesh, "plate", RUBBER))
    for group, axis in (("symmetry_x", "x"), ("symmetry_y", "y"), ("bottom", "z")):
        scene.fix(group, axis)
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, 0.3)
    assert solve(scene, move={punch: (0, 0, -0.1)}, steps=1, method=Method(linear="iterative")).converged
    assert made
    for rows in made:
        assert len(rows) > 2 and all(4 * coarse <= fine for coarse, fine in itertools.pairwise(rows)), rows


# -- which solver a run takes -----------------------------------------------------------------------------------------
def taken(foreseen, true, solves, per_preconditioner=3):
    """Methods of the solves of a run whose true costs are (preconditioner, solve) by method."""
    choice = Choice(COMM, foreseen)
    method, methods = choice.first, []
    for number in range(solves):
        if number % per_preconditioner == 0:
            method = choice.next(method)
            choice.spent(true[method][0])
        choice.spent(true[method][1], 8.0)
        methods.append(method)
    return methods


@pytest.mark.parallel
def test_the_cheaper_solver_is_found_by_trial():
    foreseen = {"direct": 1.0, "iterative": 2.0}
    worse, better = (2.0, 0.5), (1.0, 0.1)
    wrong = taken(foreseen, {"direct": worse, "iterative": better}, 60)
    early = 2 * EARLIEST  # it was foreseen to be twice as dear
    assert wrong[:early] == ["direct"] * early and wrong[early + 3 :] == ["iterative"] * (57 - early)
    right = taken(foreseen, {"direct": better, "iterative": worse}, 60)
    assert right.count("iterative") == 3  # one preconditioner on trial
    sure = taken({"direct": 1.0, "iterative": 7.0}, {"direct": worse, "iterative": better}, 60)
    assert set(sure) == {"direct"}  # no doubt, no trial


@pytest.mark.parallel
def test_a_trial_ends_once_its_solves_alone_cost_more():
    choice = Choice(COMM, {"direct": 1.0, "iterative": 1.0})
    assert not choice.lost("direct")
    choice.spent(1.0)
    for solve_number in range(EARLIEST):
        assert not choice.due("direct"), solve_number
        choice.spent(0.1, 8.0)
    assert choice.due("direct")
    assert choice.next("direct") == "iterative" and not choice.due("iterative") and not choice.lost("iterative")
    rate = choice.rates["direct"]
    choice.spent(50.0)  # a hierarchy, which is paid already
    choice.spent(0.9 * rate * 8.0, 8.0)
    assert not choice.lost("iterative")
    choice.spent(1.2 * rate * 8.0, 8.0)
    assert choice.lost("iterative")
    assert choice.next("iterative") == "direct" and not choice.lost("direct")


@pytest.mark.parallel
def test_a_solver_that_grows_dear_is_given_up():
    choice = Choice(COMM, {"direct": 1.0, "iterative": 1.0})
    choice.spent(1.0, 40.0), choice.spent(0.0, 0.0)
    for _ in range(EARLIEST):
        choice.spent(0.1, 8.0)
    assert choice.next("direct") == "iterative"
    choice.spent(4.0)
    for _ in range(ENOUGH - 1):
        choice.spent(0.1, 8.0)
        assert choice.next("iterative") == "iterative"  # a preconditioner more: too few solves to judge by
    choice.spent(0.1, 8.0)
    assert choice.next("iterative") == "direct"
    for _ in range(ENOUGH):
        choice.spent(0.8, 8.0)  # five times what it was
    assert choice.next("direct") == "iterative"


@pytest.mark.parallel
def test_costs_are_foreseen_from_the_shape_of_the_bodies():
    """A factorisation is dearer for a cube than for a plate of as many nodes, by the cube of the nodes across."""
    costs = []
    for size, cells in (((2.0, 2.0, 2.0), (7, 7, 7)), ((31.0, 15.0, 1.0), (31, 15, 1))):
        scene = Scene(Body(read_gmsh(box.build, size=size, cells=cells), "box", RUBBER))
        scene.fix("zmin")
        costs.append(foreseen_costs(scene.system()))
    cube, plate = costs
    assert cube["direct"] / plate["direct"] == pytest.approx((64 / 32) ** 3)
    assert cube["iterative"] / plate["iterative"] == pytest.approx(512 / 1024)


@pytest.mark.parallel
def test_a_run_that_changes_its_solver_gives_the_same(monkeypatch):
    """Both solvers take turns: nothing of one is left in the other, and the summary tells of both."""
    monkeypatch.setattr(Choice, "next", lambda self, method: self.rates.update({method: 1.0}) or OTHER[method])
    monkeypatch.setattr(Choice, "due", lambda self, method: True)
    monkeypatch.setattr(linear_solver, "REUSE_ABOVE", 0)
    monkeypatch.setattr(reuse, "REUSE_ABOVE", 0)
    found = []
    for method in ("auto", "direct"):
        scene = block(4)
        plate = rigid_plane((0, 0, 2), (0, 0, -1), name="plate")
        scene.contact("zmax", plate, 0.3, name="lid")
        result = solve(scene, move={plate: (0.1, 0, -0.3)}, steps=4, method=Method(linear=method)).require()
        found.append(result.history[-1]["lid_force_z_N"])
        told = result.summary["method"]["seconds_per_digit"]
        assert set(told) == ({"direct", "iterative"} if method == "auto" else set())
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("taken", "flags", "better"),
    [
        ("Prescott", "sse2 avx2 fma avx512f avx512dq avx512cd avx512bw avx512vl", "SkylakeX"),
        ("Prescott", "sse2 avx2 fma avx512f", "Haswell"),
        ("Nehalem", "sse2 avx", ""),
        ("Haswell", "sse2 avx2 fma avx512f avx512dq avx512cd avx512bw avx512vl", ""),
    ],
)
def test_kernels_for_a_processor_that_the_blas_does_not_know(taken, flags, better):
    """What OpenBLAS has chosen by itself it keeps."""
    assert blas.better(taken, set(flags.split())) == better


@pytest.mark.serial
@pytest.mark.parametrize("core", ["Prescott", "Haswell"])
def test_the_blas_in_use_is_said(core):
    """OpenBLAS takes the kernels that it is told to, if the processor has what they need; another BLAS says so."""
    if not blas.core():
        pytest.skip("another BLAS")
    assert in_a_process_of_its_own("", OPENBLAS_CORETYPE=core)[0] == f"OpenBLAS for {core}"


@pytest.mark.serial
def test_the_best_kernels_are_chosen_where_nothing_is_stated():
    """Unless NumPy has loaded the same BLAS before: then it is said what would be faster."""
    if not blas.core():
        pytest.skip("another BLAS")
    taken, *_ = in_a_process_of_its_own("import ctypes; ctypes.CDLL('libblas.so.3')")
    best = blas.better(taken.split()[-1], blas.processor())
    assert in_a_process_of_its_own("")[0] == (f"OpenBLAS for {best}" if best else taken)
    told = in_a_process_of_its_own("import ctypes; ctypes.CDLL('libblas.so.3')")[1:]
    assert told == ([f"faster here: export OPENBLAS_CORETYPE={best}"] if best else [])


@pytest.mark.serial
@pytest.mark.parametrize(("ranks", "stated", "threads"), [(1, {}, None), (64, {}, "1"), (2, {"OMP_NUM_THREADS": "3"}, "3")])
def test_processes_share_the_cores(ranks, stated, threads):
    """blas.py as a script's only module: nothing of the package is imported."""
    script = (
        "import os, runpy; runpy.run_path('fenics_contact/blas.py')['prepare'](); print(os.environ.get('OMP_NUM_THREADS'))"
    )
    env = bare_environment() | {"OMPI_COMM_WORLD_LOCAL_SIZE": str(ranks)} | stated
    said = subprocess.run(
        [sys.executable, "-S", "-c", script], capture_output=True, text=True, check=True, env=env, cwd=ROOT
    )
    assert said.stdout.split() == [str(threads)]


ROOT = Path(__file__).parents[1]


def bare_environment():
    """This one without what states the BLAS' kernels and threads, or that this is one of several processes."""
    dropped = ("OPENBLAS_", "OMP_", "OMPI_", "PMIX_", "MPI_", "PRTE_")
    return {name: value for name, value in os.environ.items() if not name.startswith(dropped)} | {"PYTHONPATH": str(ROOT)}


def in_a_process_of_its_own(first, **stated):
    """What is told of the BLAS after `first` has been run and then the package imported, by parts."""
    script = f"{first}\nimport fenics_contact.packages\nfrom fenics_contact import blas\nprint(blas.told())"
    said = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=bare_environment() | stated
    )
    return said.stdout.strip().split("; ")
