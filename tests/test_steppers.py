"""The steppers, linear solvers and numbers of ranks give one answer; the incremental scheme converges to it."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import (
    Body,
    Method,
    Motion,
    Scene,
    Stage,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box, disc, punch_plate, ring
from fenics_contact.solvers.control import run
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton

ROOT = Path(__file__).resolve().parent.parent
COARSE = {"inside": 4, "outside": 3, "layers": 2, "ratio": 1.0}


def rubber():
    return mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def frictional_punch(push=None, **numbers):
    """Small plate under a punch on a rough floor, moved down 1 mm and 0.3 mm aside, or pushed."""
    scene = Scene(Body(read_gmsh(punch_plate.build, **COARSE), "plate", rubber()))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, 0.3, name="top")
    scene.contact("bottom", rigid_plane(name="floor"), 0.2, name="bottom")
    drive = {"move": {punch: (0.3, 0, -1.0)}} if push is None else {"push": {punch: push}}
    result = solve(scene, **drive, steps=4, method=Method(tolerance=1e-11, **numbers))
    assert result.converged, result.verdict.reason
    return result


def forces(result):
    """Forces of both contacts on the body and the punch's travel in every step."""
    names = [f"{contact}_force_{axis}_N" for contact in ("top", "bottom") for axis in "xyz"]
    return np.array([result.column(n) for n in (*names, "punch_travel_z_mm")])


def apart(one, other):
    return np.abs(one - other).max() / np.abs(other).max()


@pytest.mark.parallel
@pytest.mark.parametrize("push", [None, (0, 0, -60.0)])
def test_newton_and_snes_agree(push):
    newton, snes = (frictional_punch(push, name=name) for name in ("newton", "snes"))
    assert apart(forces(snes), forces(newton)) < 1e-8  # required


@pytest.mark.parallel
def test_iterative_and_direct_solver_agree():
    direct, iterative = (frictional_punch(linear=linear) for linear in ("direct", "iterative"))
    assert iterative.summary["method"]["linear_solver"] == "iterative"
    assert apart(forces(iterative), forces(direct)) < 1e-6  # Newton stops at 1e-11: the linear tolerance must not show


def squeezed(method, steps):
    """A block squeezed by a fifth between a held face and a plane it always touches: smooth in the load parameter."""
    mesh = read_gmsh(box.build, size=(10.0, 10.0, 10.0), cells=(2, 2, 2))
    scene = Scene(Body(mesh, "box", rubber()))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 10.0), (0, 0, -1.0))
    scene.contact("zmax", plate, name="top")
    result = solve(scene, move={plate: (0, 0, -2.0)}, steps=steps, method=method)
    return result.history[-1]["top_force_z_N"]


def test_incremental_scheme_converges_to_newton():
    exact = squeezed("newton", 5)
    steps = [10, 20, 40, 80]
    errors = np.array([abs(squeezed("incremental", n) / exact - 1) for n in steps])
    orders = np.log2(errors[:-1] / errors[1:])
    # at least order 1; the carried out-of-balance force is a Newton correction of the step before, which makes it 2
    assert np.all(orders > 0.8), (errors, orders)
    assert errors[-1] < 1e-2, errors


def test_an_incremental_run_that_strays_names_its_lost_balance_and_no_penalty():
    """A ball that is pressed into a block and dragged ends deep in it, with the default penalty."""
    mesh = read_gmsh(box.build, size=(4.0, 3.0, 1.0), cells=(8, 6, 4))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=1.0, K=4.0)))
    scene.fix("zmin")
    ball = rigid_sphere(2.0, (1.5, 1.5, 3.0), name="ball")
    scene.contact("zmax", ball, friction=0.4, name="top")
    path = [Stage("press", move={ball: Motion(z=-0.25)}, steps=30), Stage("drag", move={ball: Motion(x=0.5)}, steps=50)]
    result = solve(scene, stages=path, method="incremental")
    assert not result.converged and result.verdict.kind == "no convergence"
    assert "of the force out of balance" in result.verdict.reason and 'method="newton"' in result.verdict.remedy


def test_incremental_run_that_ends_out_of_balance_has_not_converged():
    """A plane that has closed its gap within the last step presses with the whole penalty: no state, and no answer."""
    scene = Scene(Body(read_gmsh(box.build, size=(10.0, 10.0, 10.0), cells=(2, 2, 2)), "box", rubber()))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 10.525), (0, 0, -1.0))
    scene.contact("zmax", plate, name="top")
    short, enough = (solve(scene, move={plate: (0, 0, -1.0)}, steps=steps, method="incremental") for steps in (1, 20))
    assert not short.converged
    assert short.verdict.kind == "no convergence" and short.verdict.step == 1
    assert "out of balance" in short.verdict.reason and "more steps" in short.verdict.remedy
    assert enough.converged, enough.verdict.reason
    # the plane meets the block in one step, which cannot know of it: said, and mended by the next one
    assert any("1 of 20 steps" in note for note in enough.verdict.notes), enough.verdict.notes


def on_ranks(count, script=__file__):
    """The numbers of a file's main program, by default this one's, under `mpirun -n count`."""
    # the pytest process may itself be an MPI process: its child must not inherit that identity
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX", "PRTE", "OMPI_MCA_orte"))}
    env |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "PYTHONPATH": str(ROOT)}
    env |= {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}
    command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, script]
    done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr[-2000:]
    return np.array(json.loads(done.stdout.strip().splitlines()[-1]))


@pytest.mark.slow
@pytest.mark.serial
def test_same_numbers_on_one_two_and_three_ranks():
    one = numbers()
    size = np.abs(one).max(axis=1, keepdims=True)
    assert np.all(size > 0.0)
    for count in (2, 3):
        # required: each row against its own largest entry; steps end at 1e-11
        np.testing.assert_allclose(on_ranks(count) / size, one / size, rtol=0, atol=1e-9)


def numbers():
    """Forces, travel, counts and norms of a moved and a pushed frictional punch."""
    rows = []
    for push in (None, (0, 0, -60.0)):
        result = frictional_punch(push)
        rows.extend(forces(result))
        rows.append(result.column("top_active_points") + 0.0)
        rows.append(result.column("top_sticking_points") + 0.0)
        rows.append(result.column("smallest_J"))
        rows.append(np.full(4, result.system.vector.norm()))
    return np.array(rows)


if __name__ == "__main__":
    values = numbers()
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(values.tolist()))


@pytest.mark.parallel
def test_steps_that_end_before_the_paths_do_are_noted():
    scene = Scene(Body(read_gmsh(box.build, cells=(2, 2, 2)), "box", rubber()), element="mixed")
    scene.fix("zmin")
    scene.prescribe("zmax", "z", -0.1)
    notes = [solve(scene, steps=steps).require().verdict.notes for steps in ([0.5, 0.8], [0.5, 1.0], 2)]
    assert len(notes[0]) == 1 and "steps= go to t = 0.8" in notes[0][0]
    assert notes[1:] == [[], []]


@pytest.mark.parallel
@pytest.mark.parametrize("bulk", [300.0, 1e4])
def test_a_step_that_no_part_of_improves_is_taken_whole(bulk):
    """A nearly incompressible bush whose hub turns far: after the first solve a full step leaves twice as much out of
    balance, and no part of it less; then it is as good as done."""
    scene = Scene(
        Body(read_gmsh(ring.build, inner=5.0, outer=10.0, width=1.0, cells=(24, 4, 1)), "ring", neo_hooke(1.0, bulk)),
        degree=2,
        element="mixed",
    )
    scene.fix("outside")
    scene.fix(("left", "right"), "y")
    scene.tie("inside", hub := rigid_hub("hub"))
    result = solve(scene, move={hub: Motion(ry=0.8)}, steps=4).require()
    assert result.verdict.cuts == 0 and result.column("iterations").max() <= 5


def disc_squeezed(steps, degree, way, led):
    """Verdict, travel and force at the end of a quarter of a disc under a lid that is moved, or against one by the support
    of its middle, after steps of whose first solve elements are turned inside out."""
    rubbery = Body(read_gmsh(disc.build, radius=2.0, depth=None), "disc", neo_hooke(2.0, 20.0))
    scene = Scene(rubbery, degree=degree, plane="strain")
    scene.fix("symmetry_x", "x")
    lid = rigid_plane((0, 2.0, 0), normal=(0, -1, 0), name="lid")
    scene.contact("rim", lid, name="lid")
    if led:
        scene.prescribe("symmetry_y", "y", way)
    else:
        scene.fix("symmetry_y", "y")
    record = {"led": lambda view: view.at("symmetry_y").displacement[1]}
    result = solve(scene, move={} if led else {lid: (0, -way, 0)}, steps=steps, record=record).require()
    end = result.history[-1]
    return result.verdict, end["led"] if led else -end["lid_travel_y_mm"], end["lid_force_y_N"]


@pytest.mark.parallel
@pytest.mark.parametrize("degree, way, led", [(1, 1.2, False), (2, 0.8, True)])
def test_what_is_left_of_a_step_is_carried_to_its_end(degree, way, led):
    """An increment that would turn elements inside out is halved; the next one carries the rest, and was shortened, too,
    where it did not lower the force out of balance: there was balance at three quarters of the way, t = 1."""
    verdict, travel, force = disc_squeezed(1, degree, way, led)
    assert verdict.cuts == 0
    np.testing.assert_allclose(travel, way, rtol=1e-9)
    np.testing.assert_allclose(force, disc_squeezed(8, degree, way, led)[2], rtol=2e-4)


@pytest.mark.parallel
def test_a_step_that_ends_before_its_supports_do_is_not_accepted():
    """Of a stepper that leads them nine tenths of the way."""
    scene = Scene(Body(read_gmsh(box.build, cells=(2, 2, 2)), "box", rubber()))
    scene.fix("zmin")
    scene.prescribe("zmax", "z", -0.1)
    system = scene.system()
    stepper = Newton(LinearSolver(system))
    short = SimpleNamespace(step=lambda system, t: (stepper.step(system, 0.9 * t), system.begin_step(t))[0])
    verdict = run(system, short, [1.0], lambda *_: None)
    assert not verdict.converged and "have not come all the way" in verdict.reason
