"""Where the iterative solver stalls the direct one stands in: until that step is over, or for good where it stalls often."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import Body, Method, Output, Scene, mooney_rivlin, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box, two_blocks
from fenics_contact.solvers import linear as linear_solver
from fenics_contact.solvers.choice import EARLIEST, Choice
from fenics_contact.solvers.stalls import STEPS, Stalls
from fenics_contact.solvers.verdict import Verdict

COMM = MPI.COMM_WORLD
STALLED = -3  # PETSc's reason where iterations do not suffice


@pytest.fixture
def iterative_first(monkeypatch):
    """`auto` begins with the iterative solver, as with large scenes, and tries no other."""
    monkeypatch.setattr(linear_solver, "foreseen_costs", lambda system: {"direct": 9.0, "iterative": 1.0})


def loose_block():
    """A block that springs alone hold, pressed on another one and dragged: the first step is tried too long, and its
    tangents become singular."""
    upper = {"upper": (20.0, 20.0, 10.0), "upper_cells": (8, 8, 4), "upper_origin": (8.0, 10.0, 0.0)}
    lower = {"lower": (40.0, 40.0, 10.0), "lower_cells": (12, 12, 3), "lower_origin": (0.0, 0.0, -10.0)}
    mesh = read_gmsh(two_blocks.build, **lower, **upper)
    scene = Scene(Body(mesh, "lower", neo_hooke(mu=1.0, K=5.0)), Body(mesh, "upper", neo_hooke(mu=0.5, K=2.5)))
    scene.fix("lower_bottom", "yz")
    scene.prescribe("lower_bottom", "x", lambda X, t: 3.0 * t * t + 0.0 * X[:, 0])
    scene.pressure("upper_top", 0.25)
    scene.spring("upper_xmin", 8.0)
    scene.contact("upper_bottom", "lower_top", 0.4, name="c")
    return scene


@pytest.mark.parallel
def test_a_step_that_is_taken_back_does_not_cost_the_run_its_solver(iterative_first):
    """One failed attempt at the first step had all others factorised: four times the time and the memory."""
    told, forces = {}, {}
    for method in ("auto", "direct"):
        result = solve(loose_block(), steps=4, method=Method(linear=method)).require()
        told[method], forces[method] = result.summary["method"], [result.history[-1][f"c_force_{axis}_N"] for axis in "xz"]
        assert result.verdict.cuts > 0
    assert "taken back" in told["auto"]["solver_changes"][0] and told["auto"]["linear_solver"] == "iterative"
    assert told["direct"]["solver_changes"] == []
    np.testing.assert_allclose(forces["auto"], forces["direct"], rtol=1e-7)


def pressed_block(out, last, resume=False):
    """A block pressed by a plate in steps of a tenth up to `last` tenths, with a log and checkpoints."""
    rubber = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(10, 10, 10)), "box", rubber))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="plate")
    scene.contact("zmax", plate, 0.3, name="lid")
    steps, out = [0.1 * i for i in range(1, last + 1)], Output(out, checkpoint=True, resume=resume)
    return solve(scene, move={plate: (0, 0, -0.2)}, steps=steps, out=out).require()


@pytest.mark.parallel
def test_where_it_stalls_in_several_steps_the_direct_one_stays(iterative_first, monkeypatch, tmp_path, capsys):
    """Each stall costs iterations. The log says so once, and a run that is resumed counts on."""
    monkeypatch.setattr(linear_solver, "LONGEST_IF_SMALL", 1)
    folder = COMM.bcast(tmp_path)
    whole = pressed_block(folder / "whole", 6)
    line = "from here on the direct one serves"
    assert COMM.allreduce(capsys.readouterr().err.count(line)) == 1
    assert whole.summary["method"]["linear_solver"] == "direct"
    assert whole.summary["method"]["solver_changes"] == [
        f"the iterative solver stalled {STEPS} times (PETSc's reason {STALLED}); the direct one took over for good"
    ]
    assert line not in str(whole.verdict)  # it is no doubt of the result
    pressed_block(folder / "parts", 2)
    assert line not in capsys.readouterr().err
    once_more = pressed_block(folder / "parts", 4, resume=True)
    assert once_more.summary["method"]["solver_changes"][0].startswith("the iterative solver stalled once")
    assert once_more.summary["method"]["linear_solver"] == "direct"
    parts = pressed_block(folder / "parts", 6, resume=True)
    assert parts.summary["method"]["solver_changes"] == ["the direct solver stays, as before the run was resumed"]
    assert list(parts.column("iterations")) == list(whole.column("iterations"))
    np.testing.assert_allclose(parts.column("lid_force_z_N"), whole.column("lid_force_z_N"), rtol=1e-12)


class Solver:
    """What of ReusingSolver a Stalls knows."""

    def __init__(self, choice=None):
        self.method, self.choice = "iterative", choice

    def go_by(self, choice):
        self.choice = choice

    def use(self, method):
        self.method = method


def stalls_of(choice=None, lasts=False):
    """(Stalls, its solver, its trail, the run's verdict)."""
    solver, trail = Solver(choice), SimpleNamespace(returns=0)
    return Stalls(solver, trail, lasts), solver, trail, Verdict()


def test_it_is_back_once_the_step_is_taken_back_or_accepted():
    """Not within a step, and not a third time for one that stalls it twice."""
    stalls, solver, trail, verdict = stalls_of()
    stalls.stalled(STALLED)
    stalls.renew()
    assert solver.method == "direct"
    trail.returns += 1
    stalls.renew()
    assert solver.method == "iterative"
    stalls.stalled(STALLED)
    trail.returns += 1
    stalls.renew()
    assert solver.method == "direct"
    stalls.accepted(verdict)
    assert solver.method == "direct"  # its factors may be asked for once more
    stalls.renew()
    assert solver.method == "iterative" and verdict.stood_in == 1 and verdict.said == []


def test_steps_without_a_stall_make_up_for_those_with_one():
    stalls, solver, trail, verdict = stalls_of()
    for _ in range(2 * STEPS):
        stalls.stalled(STALLED)
        stalls.accepted(verdict)
        stalls.renew()
        stalls.accepted(verdict)
    assert solver.method == "iterative" and verdict.stood_in == 0
    stalls.stalled(STALLED)
    trail.returns += 1
    stalls.accepted(verdict)  # by another solver, or by this one again: the step that stalled was taken back
    assert verdict.stood_in == 0
    for _ in range(STEPS):
        stalls.renew()
        stalls.stalled(STALLED)
        stalls.accepted(verdict)
    stalls.renew()
    assert solver.method == "direct" and len(verdict.said) == 1


def test_what_solvers_cost_is_still_known_after_a_stall():
    """But for the tangent that stalled; a solver that stalls on trial has lost it."""
    choice = Choice(COMM, {"direct": 1.0, "iterative": 1.0})
    for _ in range(EARLIEST):
        choice.spent(1.0, 8.0)
    assert choice.next("iterative") == "direct"  # on trial
    for _ in range(EARLIEST):
        choice.spent(4.0, 8.0)
    assert choice.next("direct") == "iterative"
    known = dict(choice.rates)
    stalls, solver, trail, _ = stalls_of(choice)
    choice.spent(1e6, 8.0)
    stalls.stalled(STALLED)
    assert solver.choice is None and stalls.choice.rates == known
    trail.returns += 1
    stalls.renew()
    assert solver.choice is choice and solver.method == "iterative"
    for _ in range(EARLIEST):
        choice.spent(1.0, 8.0)
    assert choice.next("iterative") == "iterative" and choice.rates == pytest.approx(known)
    del choice.rates["iterative"]
    stalls.stalled(STALLED)
    trail.returns += 1
    stalls.renew()
    assert solver.method == "direct" and stalls.stays


def test_a_continuation_stays_with_the_direct_one():
    """Behind a limit point tangents are indefinite, and the pivots that tell of bifurcations are a factorisation's."""
    stalls, solver, trail, verdict = stalls_of(lasts=True)
    stalls.stalled(STALLED)
    trail.returns += 1
    stalls.renew()
    stalls.accepted(verdict)
    assert solver.method == "direct" and len(verdict.said) == 1 and verdict.stood_in == 0
