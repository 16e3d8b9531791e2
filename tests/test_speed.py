"""What speed rests on, by counts that do not depend on the machine: iterations, factorisations, patterns, mallocs, bytes."""

import ast
import inspect
import os
import subprocess
import textwrap
from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact import Body, Scene, compat, mooney_rivlin, neo_hooke, read_gmsh, rigid_plane, rigid_punch, timing
from fenics_contact.kernels import contact_pairs, contact_tangent, rigid_element
from fenics_contact.meshes import box, punch_plate, rectangles, two_blocks
from fenics_contact.solvers import factors, linear, reuse
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.timing import Timers

UNIFORM = {"inside": 7, "outside": 7, "layers": 4, "ratio": 1.0}  # 3375 unknowns
STEPS = 3


def plate(patch=False):
    scene = Scene(Body(read_gmsh(punch_plate.build, **UNIFORM, patch=patch), "plate", mooney_rivlin(0.1863, 0.0098, 5.0)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    return scene


def parity():
    scene = plate(patch=True)
    scene.fix("bottom", "z")
    scene.prescribe("under_punch", "z", -0.2 * STEPS)
    return scene.system()


def rough_punch():
    scene = plate()
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, 0.3, name="top")
    scene.contact("bottom", rigid_plane(name="floor"), 0.3, name="bottom")
    return scene.system({punch: (0, 0, -0.2 * STEPS)})


def carried(system, method, tolerance=1e-8):
    """The solver and the Newton iterations of a run of STEPS steps."""
    solver, iterations = LinearSolver(system, method), []
    newton = Newton(solver, tolerance=tolerance)
    for i in range(STEPS):
        iterations.append(newton.step(system, (i + 1) / STEPS).iterations)
        system.trail.commit()
    return solver, iterations


@pytest.mark.parallel
@pytest.mark.parametrize("method", ["direct", "iterative"])
def test_counts_of_the_parity_scene(method):
    system = parity()
    solver, iterations = carried(system, method)
    assert max(iterations) <= 3  # as in five other codes
    assert solver.builds <= STEPS  # at most one factorisation or hierarchy per step, a third of the tangents
    assert solver.iterations <= 30 * sum(iterations)  # a fresh hierarchy needs about 25 at the tightest tolerance
    assert system.couplings.patterns == 1
    assert "baij" in system.matrix.getType()  # insertion by blocks
    assert system.matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["mallocs"] == 0


@pytest.mark.parallel
def test_counts_of_the_rough_punch():
    system = rough_punch()
    solver, iterations = carried(system, "iterative")
    assert max(iterations[1:]) <= 5  # after the first touch
    assert solver.builds < sum(iterations)
    assert solver.iterations <= 40 * sum(iterations)  # penalties must not show: the parity scene's bound and a third
    assert not solver.stalls.count
    assert system.couplings.patterns == 1
    assert system.matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["mallocs"] == 0


def two_rough_blocks():
    """A block pressed into a larger one by 0.2 mm and dragged over two thirds of its cells."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(8, 8, 2), upper_cells=(5, 5, 2))
    scene = Scene(*(Body(mesh, name, mooney_rivlin(0.1863, 0.0098, 5.0)) for name in ("lower", "upper")))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -0.2 * min(t * STEPS, 1.0)))
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 1.6 * max(t * STEPS - 1.0, 0.0)))
    scene.contact(slave="upper_bottom", master="lower_top", friction=0.3, name="interface")
    return scene.system()


@pytest.mark.parallel
def test_counts_of_two_blocks(monkeypatch):
    system, states = two_rough_blocks(), []
    contact = system.contact_terms[0]
    pairing = contact.places.sights.pairing
    project, seek = pairing.project, pairing.seek
    searched = []
    monkeypatch.setattr(pairing, "project", lambda *a: states.append(system.state.u.x.array.copy()) or project(*a))
    monkeypatch.setattr(pairing, "seek", seek._replace(fill=lambda *a: searched.append(0) or seek.fill(*a)))
    solver, iterations = carried(system, "direct")
    different = 1 + sum(not np.array_equal(a, b) for a, b in zip(states, states[1:], strict=False))
    same_everywhere = system.comm.allreduce(different)  # a rank projects again where only another one's nodes have moved
    assert len(states) * system.comm.size <= same_everywhere + system.comm.size
    assert len(states) <= len(searched) <= len(states) + 1  # the far search is for points without a partner only
    assert system.couplings.patterns <= 1 + STEPS  # at most one per step, not one per tangent
    assert sum(iterations) > 2 * system.couplings.patterns
    assert system.matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["mallocs"] == 0


@pytest.mark.parallel
def test_cells_inside_a_part_fill_the_own_block_with_the_same_numbers():
    system = rough_punch()
    form, matrix = system.terms[0]._tangents[0], system.matrix
    system.assemble_tangent()
    system.state.u.x.array[:] = np.sin(system.space.tabulate_dof_coordinates()).ravel() * 0.01
    matrices = []
    for add in (form.add, lambda matrix: compat.assemble_matrix(matrix, form.whole)):
        matrix.zeroEntries()
        add(matrix)
        matrix.assemble()
        matrices.append(matrix.copy())
    assert form._usable and (len(form._rest.cells) > 0) == (system.comm.size > 1)
    size = matrices[0].norm()
    matrices[0].axpy(-1.0, matrices[1], structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    assert matrices[0].norm() < 1e-15 * size  # at nodes on borders between ranks the sums come in another order


@pytest.mark.serial
@pytest.mark.parametrize("scene", [parity, rough_punch])
def test_reuse_does_not_change_results(scene, monkeypatch):
    """An old factorisation or hierarchy against a new factorisation for every tangent."""
    displacements = {}
    for name, method, above in (("new", "direct", 10**9), ("old", "direct", 0), ("multigrid", "iterative", 0)):
        monkeypatch.setattr(reuse, "REUSE_ABOVE", above)
        system = scene()
        solver, iterations = carried(system, method, tolerance=1e-11)
        assert (solver.builds == sum(iterations)) == (name == "new")
        displacements[name] = system.state.u.x.array.copy()
    size = np.abs(displacements["new"]).max()
    for name in ("old", "multigrid"):
        assert np.abs(displacements[name] - displacements["new"]).max() < 1e-9 * size  # the bound for accelerations


@pytest.mark.serial
def test_modes_that_fade_where_penalties_hold(monkeypatch):
    """Rigid-body modes that know nothing of supports and contacts take more than half as many iterations again."""
    counts = {}
    for name, sweeps in (("rigid", 0), ("soft", linear.SWEEPS)):
        monkeypatch.setattr(linear, "SWEEPS", sweeps)
        counts[name] = carried(rough_punch(), "iterative")[0].iterations
    assert counts["rigid"] > 1.5 * counts["soft"], counts


@pytest.mark.serial
def test_history_takes_32_bytes_per_point():
    """Anchor and slip path: what a step cut back must restore."""
    history = rough_punch().contact_terms[0].accepted.history
    assert (history.anchors[0].nbytes + history.slip_path.nbytes) / history.met.size == 32


@pytest.mark.serial
def test_a_new_preconditioner_is_made_when_it_pays():
    rule = reuse.Reuse(build_cost=10)
    rates = [1, 2, 2, 3, 4, 6]  # iterations per digit; on average 11, 6.5, 5, 4.5, 4.4, 4.7 with the build's ten
    for rate in rates:
        assert not rule.stale
        rule.solved(rate, 0.1)
    assert rule.stale
    rule.built()
    assert not rule.stale


@pytest.mark.serial
def test_a_factorisation_in_the_plane_is_worth_fewer_iterations(monkeypatch):
    """It has fewer operations for each entry of its factors: see `PER_OPERATION`."""
    monkeypatch.setattr(reuse, "REUSE_ABOVE", 0)
    monkeypatch.setattr(factors, "PLAIN", 0)  # of MUMPS
    flat = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (4.0, 4.0), (30, 30))})
    deep = read_gmsh(box.build, size=(4.0, 4.0, 4.0), cells=(9, 9, 9))
    costs = {}
    for kind, mesh, plane in (("plane", flat, "strain"), ("space", deep, None)):
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane=plane)
        scene.fix("box_ymin" if plane else "zmin")
        scene.body_force((1e-3, 0, 0))
        solver, _ = carried(scene.system(), "direct")
        costs[kind] = solver._solver._reuse.build_cost
    assert 3.0 < costs["plane"] < 5.0 and 8.0 < costs["space"] <= 15.0, costs
    assert factors.factorisation_cost(9e11, -3000) == factors.factorisation_cost(9e11, 3 * 10**9) == 11.5  # in millions


@pytest.mark.serial
def test_stages_add_up(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(timing.time, "perf_counter", lambda: now[0])
    timers = Timers()
    now[0] = 1.0
    with timers("residual"):
        now[0] = 3.0
        with timers("contact kernel"):
            now[0] = 7.0
        now[0] = 8.0
    now[0] = 10.0
    table = timers.table()
    assert (table["residual"], table["contact kernel"], table["other"], table["total"]) == (3.0, 4.0, 3.0, 10.0)


@pytest.mark.serial
def test_ranks_yield_their_core_and_on_open_mpi_4_a_process_alone_does_not():
    """MUMPS looks for messages thousands of times: beside three other programs a plane scene took four times as long."""
    name, root = "OMPI_MCA_mpi_yield_when_idle", Path(__file__).parents[1]
    given = {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ}
    script = f'. {root}/.ci/environment; echo "alone ${name}"; mpirun --version | head -1; mpirun -n 2 printenv {name}'
    alone, version, *ranks = subprocess.run(
        ["bash", "-c", script], env=given, capture_output=True, text=True, check=True, timeout=60
    ).stdout.splitlines()
    assert ranks == ["1", "1"]
    assert alone == ("alone " if "Open MPI) 4" in version else "alone 1")


@pytest.mark.serial
@pytest.mark.parametrize(
    "kernel",
    [
        rigid_element.contact_elements, rigid_element.committed_anchors, rigid_element.point_normals,
        rigid_element.distances, contact_pairs.add_forces, contact_tangent.add_tangents,
    ],
    ids=lambda kernel: kernel.__name__,
)  # fmt: skip
def test_kernels_unpack_groups_before_their_loops(kernel):
    """An array of a tuple costs a reference counted by all cores wherever it is looked at: in loops over points that took
    three quarters of the time that the forces of pairs did."""
    function = ast.parse(textwrap.dedent(inspect.getsource(getattr(kernel, "py_func", kernel)))).body[0]
    groups = {"points", "tool", "law", "history", "pairs", "out"} & {argument.arg for argument in function.args.args}
    loops = [loop for loop in ast.walk(function) if isinstance(loop, ast.For)]
    used = {name.id for loop in loops for line in loop.body for name in ast.walk(line) if isinstance(name, ast.Name)}
    assert groups and loops and not groups & used, groups & used
