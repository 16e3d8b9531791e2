"""Whatever goes wrong on one rank, in a function of the user's or in a file, ends all ranks with one error that names it."""

import json
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import refusals
from mpi4py import MPI
from test_restart import alone, mpirun

from fenics_contact import ArcSteps, Body, Load, Output, Scene, SceneError, coulomb, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.agreement import alike
from fenics_contact.meshes import box

ROOT = Path(__file__).resolve().parent.parent
COMM = MPI.COMM_WORLD


def bar(cells=(8, 1, 1)):
    """A bar held at one end: on two ranks only one of them has points there."""
    scene = Scene(Body(read_gmsh(box.build, size=(8.0, 1.0, 1.0), cells=cells), "box", neo_hooke(1.0, 5.0)))
    scene.fix("xmin")
    return scene


refused = partial(refusals.refused, kind=SceneError)


def broken(answer, after=0.4):
    """A function of t, or of X and t, that fails on the last rank alone, beyond a t."""

    def function(*arguments):
        if COMM.rank == COMM.size - 1 and arguments[-1] > after:
            raise RuntimeError("the table ends here")
        return answer(*arguments)

    return function


def drives(name):
    """(scene, its drive) with one function of the user's that fails on one rank, and what names it."""
    scene, drive = bar(), {}
    if name == "traction":
        scene.traction("xmax", broken(lambda t: (0.1 * t, 0, 0)))
    elif name == "pressure":
        scene.pressure("xmax", broken(lambda t: 0.1 * t))
    elif name == "body force":
        scene.body_force(broken(lambda t: (0, 0, -0.1 * t)))
    elif name == "prescribed displacement of xmax along x":
        scene.prescribe("xmax", "x", broken(lambda X, t: np.full(len(X), 0.1 * t)))
    else:
        tool = rigid_plane((8, 0, 0), (-1, 0, 0), name="plate")
        scene.contact("xmax", tool)
        drive = {name.split()[0]: {tool: broken(lambda t: (-0.1 * t, 0, 0))}}
    return scene, drive


@pytest.mark.parallel
@pytest.mark.parametrize(
    "name",
    ["traction", "pressure", "body force", "prescribed displacement of xmax along x", "move of 'plate'", "push of 'plate'"],
)
def test_a_function_that_fails_on_one_rank_is_named_on_all(name):
    scene, drive = drives(name)
    message = refused(lambda: solve(scene, **drive, steps=2), name, "RuntimeError: the table ends here")
    assert COMM.size == 1 or f"failed on rank {COMM.size - 1}:" in message


@pytest.mark.parallel
def test_functions_of_the_state_that_fail_on_one_rank():
    scene = bar()
    scene.prescribe("xmax", "x", 0.1)

    def late(state):
        if state.t > 0.6 and COMM.rank == COMM.size - 1:
            raise KeyError("no such thing")
        return 1.0 - state.t

    refused(lambda: solve(scene, steps=2, record={"mine": late}), "record 'mine'", "KeyError", "no such thing")
    arc = ArcSteps(until=late, first=0.1)
    refused(lambda: solve(scene, steps=arc), "target 1, late = 0", "KeyError")


@pytest.mark.parallel
def test_a_run_that_an_error_ends_leaves_what_it_accepted(tmp_path):
    """The folder is whole, says why it ends, and the run goes on from there once the function is mended."""
    folder = COMM.bcast(tmp_path)

    def run(fails, resume=False):
        scene = bar()
        scene.prescribe("xmax", "x", 0.1)

        def mine(view):
            if fails and view.t > 0.7:
                raise ValueError("the table ends here")
            return view.t

        return solve(scene, steps=4, out=Output(folder, checkpoint=True, resume=resume), record={"mine": mine})

    refused(lambda: run(True), "the table ends here")
    COMM.Barrier()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["verdict"]["kind"] == "ended by an error" and not summary["verdict"]["converged"]
    assert "the table ends here" in summary["verdict"]["reason"] and summary["verdict"]["step"] == 3
    assert len((folder / "history.csv").read_text().splitlines()) == 3
    assert run(False, resume=True).column("mine").tolist() == [0.25, 0.5, 0.75, 1.0]


@pytest.mark.parallel
def test_a_record_must_be_a_number_and_the_same_on_all_ranks():
    scene = bar()
    scene.prescribe("xmax", "x", 0.1)
    for value, words in ((None, "None"), (np.ones(3), "an array of shape (3,)"), ("1", "'1'"), ([1.0], "[1.0]")):
        run = lambda value=value: solve(scene, steps=1, record={"mine": lambda state: value})  # noqa: E731
        refused(run, "record 'mine'", words, "one number")
    for value in (np.float32(2.0), np.array(2.0), 2, True, float("nan")):
        result = solve(scene, steps=1, record={"mine": lambda state, value=value: value})
        np.testing.assert_equal(result.column("mine"), [float(value)])
    local = {"size": lambda state: float(len(state.u.x.array) + COMM.rank)}
    if COMM.size > 1:
        refused(lambda: solve(scene, steps=1, record=local), "record 'size'", "on rank 0", "allreduce")
        arc = ArcSteps(until=[Load(1.0), local["size"]], first=0.1)
        refused(lambda: solve(scene, steps=arc), "target 2", "on rank 0", "allreduce")


@pytest.mark.parallel
def test_what_is_no_number_is_alike_where_it_is_on_all_ranks():
    """Beside it numbers are compared as ever."""
    of_rank = lambda size: alike(COMM, "it", lambda: np.array([np.nan, np.inf, 1.0 + size * COMM.rank]), SceneError)  # noqa: E731
    np.testing.assert_equal(of_rank(1e-12), [np.nan, np.inf, 1.0])
    if COMM.size > 1:
        refused(lambda: of_rank(1.0), "it must not depend")


@pytest.mark.parallel
def test_columns_have_names_of_their_own():
    scene = bar()
    plate = rigid_plane((8, 0, 0), (-1, 0, 0), name="plate")
    scene.contact("xmax", plate, name="end")
    taken = ("t", "step", "plate_travel_x_mm", "end_force_z_N", "end_penetration_mm", "limit_point")
    for name in taken:
        run = lambda name=name: solve(scene, record={name: lambda state: 1.0})  # noqa: E731
        refused(run, f"record '{name}'", "column of that name")
    refused(lambda: solve(scene, record={"mine": 1.0}), "record 'mine'", "function")
    result = solve(scene, move={plate: (-0.1, 0, 0)}, steps=1, record={"mine": lambda state: 1.0})
    assert set(taken[:-1]) | {"mine"} <= set(result.history[0])


@pytest.mark.parallel
def test_two_tools_of_one_name():
    scene = bar()
    plate = rigid_plane((8, 0, 0), (-1, 0, 0))
    scene.contact("xmax", plate)
    refused(lambda: scene.contact("zmin", rigid_plane()), "two tools are named 'plane'", "name=")
    scene.contact("zmax", plate)  # the same tool may meet two surfaces
    assert [contact.slave for contact in scene.contacts] == [("xmax",), ("zmax",)]


@pytest.mark.parallel
def test_a_function_of_points_sees_all_of_them_on_any_rank():
    """On two ranks one has no point of xmax; what a function makes of its points together does not depend on that."""
    scene, shapes = bar(), set()

    def ramped(X, t):
        shapes.add(X.shape)
        return 0.1 * t * (X[:, 1] + X[:, 2]) / (X[:, 1] + X[:, 2]).max()

    scene.prescribe("xmax", "x", ramped)
    result = solve(scene, steps=1).require()
    assert shapes == {(4, 3)}
    X, owned = scene.space.tabulate_dof_coordinates(), scene.space.dofmap.index_map.size_local
    u = result.u.x.array.reshape(-1, 3)
    end = np.flatnonzero(X[:owned, 0] > 8 - 1e-9)
    np.testing.assert_allclose(u[end, 0], 0.05 * (X[end, 1] + X[end, 2]), atol=1e-12)
    assert COMM.allreduce(len(end)) == 4
    assert COMM.size == 1 or min(COMM.allgather(len(end))) == 0


@pytest.mark.parallel
def test_what_a_function_of_points_must_give():
    for value, words in (
        (lambda X, t: [0.1 * t], "shape (1,)"),
        (lambda X, t: X * t, "shape (4, 3)"),
        (lambda X, t: None, "xmax along x"),
    ):
        scene = bar()
        scene.prescribe("xmax", "x", value)
        refused(lambda scene=scene: solve(scene, steps=1), "xmax along x", words)


def of_rank(size):
    """A number that is another one on the last rank."""
    return size * (1.0 + 0.1 * (COMM.size > 1 and COMM.rank == COMM.size - 1))


PLATE = rigid_plane((8, 0, 0), (-1, 0, 0), name="plate")
UNLIKE = {
    "traction on 'xmax'": lambda scene: scene.traction("xmax", lambda X, t: of_rank(0.1) * t + 0.0 * X),
    "pressure on 'xmax'": lambda scene: scene.pressure("xmax", lambda X, t: of_rank(0.1) * t + 0.0 * X[:, 0]),
    "body force": lambda scene: scene.body_force(lambda t: (0.0, 0.0, of_rank(-0.001) * t)),
    "swell": lambda scene: scene.swell("box", lambda t: 1.0 + of_rank(0.1) * t),
    "xmax along x": lambda scene: scene.prescribe("xmax", "x", lambda X, t: of_rank(0.1) * t * X[:, 1]),
    "friction": lambda scene: scene.contact("xmax", PLATE, coulomb(lambda p: of_rank(0.3) / (1.0 + p), up_to=10.0)),
    "traction on 'xmax' is 0.03": lambda scene: scene.traction("xmax", (of_rank(0.1), 0, 0)),
}


@pytest.mark.parallel
@pytest.mark.parametrize("name", UNLIKE)
def test_what_ranks_state_differently_is_refused(name):
    """Functions of t, of places and of the pressure, and plain numbers."""
    scene = bar()
    UNLIKE[name](scene)
    if COMM.size == 1:
        assert solve(scene, steps=1).converged
    else:
        refused(lambda: solve(scene, steps=1), name, "on rank 0", f"on rank {COMM.size - 1}")


ALONE = """
import sys, numpy as np
from mpi4py import MPI
from fenics_contact import agreement, plans, solve
sys.path.insert(0, 'tests')
from test_faults import bar
agreement.PATIENCE = 1.0
scene = bar()
def inside_a_sum(X, t):
    if MPI.COMM_WORLD.rank == 1:
        raise RuntimeError("alone in the function")
    return np.full(len(X), 0.1 * t * MPI.COMM_WORLD.allreduce(1))
class Failing(plans.LinearSolver):
    def __init__(self, *arguments, **options):
        if MPI.COMM_WORLD.rank == 1:
            raise MemoryError("alone in the solver")
        super().__init__(*arguments, **options)
if sys.argv[1] == "function":
    scene.prescribe("xmax", "x", inside_a_sum)
else:
    plans.LinearSolver = Failing
    scene.prescribe("xmax", "x", 0.1)
solve(scene, steps=1)
print("came to its end")
"""


@pytest.mark.serial
@pytest.mark.parametrize("where", ["function", "solver"])
def test_a_rank_that_fails_while_others_wait_for_it_ends_the_run(where):
    """Within a user's own sum over ranks, or somewhere in the package: nobody can raise the error on the waiting rank."""
    command = [*mpirun(2), sys.executable, "-c", ALONE, where]
    start = time.monotonic()
    done = subprocess.run(command, env=alone(), cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0 and "came to its end" not in done.stdout
    assert f"failed on rank 1 alone: {'RuntimeError' if where == 'function' else 'MemoryError'}: alone in the" in done.stderr
    assert time.monotonic() - start < 40.0


FREED_APART = """
import sys
from mpi4py import MPI
from petsc4py import PETSc
from fenics_contact import solve
sys.path.insert(0, 'tests')
from test_faults import bar
scene = bar()
scene.prescribe("xmax", "x", 0.1)
solve(scene, steps=1)
del scene
vector = PETSc.Vec().createMPI((2, 4), comm=MPI.COMM_WORLD)
if MPI.COMM_WORLD.rank == 1:
    vector.destroy()
print("came to its end")
"""


@pytest.mark.serial
def test_processes_end_though_one_alone_has_left_something_to_petsc():
    """PETSc's clean-up at the end waits for all ranks, and is done by those that still have something."""
    command = [*mpirun(2), sys.executable, "-c", FREED_APART]
    done = subprocess.run(command, env=alone(), cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stdout.count("came to its end") == 2
