"""Steps solved with softer penalties first: a thin strap with no number typed; nothing of the way stays in the result."""

import numpy as np
import pytest
from by_node import displacements, of_all
from mpi4py import MPI

from fenics_contact import (
    Body,
    Output,
    Scene,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.softened import Softened
from fenics_contact.solvers.verdict import StepFailed, Verdict

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RADIUS, WIDTH, TAIL = 25.0, 0.2, 10.0  # mm


def strap(width=WIDTH, **options):
    """A strap of 0.2 mm bent over a sixth of a drum, from straight and tight; it presses with T/R, 0.002 of its modulus."""
    turn, cells = np.pi / 6, 48
    length = RADIUS * turn + TAIL
    size = (TAIL + length, width, 1.0)
    mesh = read_gmsh(box.build, size=size, cells=(cells, 2, 1), origin=(-TAIL, RADIUS, 0.0), name="strap")
    scene = Scene(Body(mesh, "strap", neo_hooke(mu=0.4, K=5.0)))
    for group, axes in (("xmin", "xy"), ("zmin", "z"), ("zmax", "z")):
        scene.fix(group, axes)

    def end(X, t, axis):
        angle, stretch = turn * max(2 * t - 1, 0.0), 1.0 + 0.4 * min(2 * t, 1.0)
        along, normal = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
        x = RADIUS * normal + (stretch * length - RADIUS * angle) * along + (X[:, 1:2] - RADIUS) * normal
        return x[:, axis] - X[:, axis]

    scene.prescribe("xmax", "x", lambda X, t: end(X, t, 0))
    scene.prescribe("xmax", "y", lambda X, t: end(X, t, 1))
    scene.contact("ymin", rigid_cylinder(RADIUS, (0, 0, 0), (0, 0, 1)), friction=0.5, name="wrap", **options)
    return scene


def test_a_thin_strap_with_no_number_typed():
    steps = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    plain, typed = (solve(strap(**o), steps=steps).require() for o in ({}, {"penalty": 5.0}))
    (note,) = (note for note in plain.verdict.notes if "softer penalties first" in note)
    assert "the contact's own ones, to which the result belongs" in note and "Newton iterations left" in note
    assert plain.verdict.cuts == 0  # six steps, cut six times where the default penalties are used from the start
    # the soft number typed lets the strap sink by 0.002 mm, a ten-thousandth of the radius over which its end is bent;
    # in the few points that touch, friction of half the pressing force feels a hundredth of that
    assert plain.history[-1]["wrap_penetration_mm"] < 0.02 * typed.history[-1]["wrap_penetration_mm"]
    size = np.hypot(*(plain.history[-1][f"wrap_force_{axis}_N"] for axis in "xy"))
    for axis in "xy":
        name = f"wrap_force_{axis}_N"
        assert abs(plain.history[-1][name] - typed.history[-1][name]) < 0.02 * size


@pytest.mark.parametrize("width", [0.25, 0.15])
def test_what_touches_first_is_led_there_without_friction(width):
    """Within the step it goes through the drum by more than its width: with friction Newton's method fails there, and the
    softer penalties that came to its help were those of all later steps."""
    result = solve(strap(width), steps=[0.5, 0.6, 0.7, 0.8, 0.9, 1.0]).require()
    assert result.verdict.cuts == 0 and not any("softer penalties" in note for note in result.verdict.notes)
    assert result.column("residual")[-1] < 1e-8


def test_a_resumed_run_knows_that_softer_penalties_help(tmp_path):
    """It would fail in its first step, and solve that with other iterates."""
    out, steps = COMM.bcast(tmp_path), [0.5, 0.75, 0.9]

    def go(folder, upto, resume=False):
        kept = Output(out / folder, checkpoint=True, resume=resume)
        return solve(strap(), steps=steps[:upto], out=kept).require()

    whole, part = go("whole", 3), go("parts", 2)
    soft = [note for note in part.verdict.notes if "softer penalties first" in note]
    assert len(soft) == 1
    resumed = go("parts", 3, resume=True)
    if COMM.size == 1:  # on several the solver's sums differ from run to run, and what iterates that fail leave with them
        assert resumed.column("iterations").tolist() == whole.column("iterations").tolist()
        assert resumed.verdict.notes == whole.verdict.notes
    # of its own step, which has not failed again; a first touch without friction before would have no such note
    assert [note for note in resumed.verdict.notes if "softer penalties first" in note][:1] == soft


def ball():
    """A rough ball pressed into a block on a rough floor and drawn, which Newton solves as it is."""
    mesh = read_gmsh(box.build, size=(8.0, 8.0, 4.0), cells=(4, 4, 2), origin=(-4.0, -4.0, -4.0))
    scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)))
    tool = rigid_sphere(4.0, (0, 0, 4.0))
    scene.contact("zmax", tool, friction=0.4, name="top")
    scene.contact("zmin", rigid_plane((0, 0, -4.0), name="floor"), friction=0.9, name="bottom")
    path = lambda t: (0.6 * max(t - 0.5, 0.0), 0.2 * max(t - 0.5, 0.0), -0.5 * min(2 * t, 1.0))  # noqa: E731
    return scene.system({tool: path})


def final(softened, stumbles=False):
    system = ball()
    stepper = Softened(Newton(LinearSolver(system), 1e-11))
    for t in (0.25, 0.5, 0.75, 1.0):
        stepper.helps = softened
        if stumbles and t == 0.75:
            stepper.step(system, 1.0)
            system.trail.rollback()
        report = stepper.step(system, t)
        Verdict().accept(report, system)
        system.trail.commit()
    return system, report


def test_the_solution_is_that_of_the_penalties():
    (plain, _), (eased, report) = final(False), final(True)
    assert report.raises == 1  # it was solved so
    u, eased_u = displacements(plain.state.u), displacements(eased.state.u)
    np.testing.assert_allclose(eased_u, u, rtol=0, atol=1e-9 * np.abs(u).max())

    def left(system, contact):
        law, status = contact.trial.law, contact.response(system.state).status
        return [of_all(contact.key, values) for values in (law.eps_n, law.eps_t, status)]

    for one, other in zip(eased.contact_terms, plain.contact_terms, strict=True):
        for a, b in zip(left(eased, one), left(plain, other), strict=True):
            # the mesh of each is its own: geometry may be rounded in another order
            np.testing.assert_allclose(a, b, rtol=1e-14)


def test_a_dropped_step_leaves_no_trace():
    (direct, _), (cut, _) = final(True), final(True, stumbles=True)
    np.testing.assert_allclose(displacements(cut.state.u), displacements(direct.state.u), rtol=0, atol=1e-10)


def test_a_failure_on_the_way_puts_penalties_back():
    system = ball()
    stepper = Softened(Newton(LinearSolver(system)))
    stepper.step(system, 0.5)
    system.trail.commit()
    before = [c.trial for c in system.contact_terms]
    stepper.helps, stepper.rough.limit, stepper.stepper.limit = True, 1, 1
    with pytest.raises(StepFailed):
        stepper.step(system, 1.0)
    system.trail.rollback()
    assert all(contact.trial is trial for contact, trial in zip(system.contact_terms, before, strict=True))


def test_a_step_that_softer_penalties_fail_in_is_solved_without_them():
    system = ball()
    stepper = Softened(Newton(LinearSolver(system)))
    stepper.step(system, 0.5)
    system.trail.commit()
    laws = [c.trial.law for c in system.contact_terms]
    stepper.helps, stepper.rough.limit = True, 1
    assert stepper.step(system, 1.0).raises == 0
    assert all(contact.trial.law is law for contact, law in zip(system.contact_terms, laws, strict=True))
