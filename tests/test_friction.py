"""A block dragged over a rigid plane obeys Coulomb's law whatever the numerics; history changes at accepted steps only."""

import json

import numpy as np
import pytest
from by_node import displacements, of_all

from fenics_contact import (
    Body,
    Method,
    Motion,
    Penalty,
    Scene,
    Stage,
    coulomb,
    from_elastic,
    read_gmsh,
    rigid_plane,
    rigid_punch,
    rigid_surface,
    solve,
)
from fenics_contact.contact.findings import told_apart
from fenics_contact.meshes import box
from fenics_contact.scene.build import build
from fenics_contact.scene.fingerprint import statement
from fenics_contact.scene.stage import Only
from fenics_contact.scene.stated import first_difference
from fenics_contact.solvers.control import run
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.verdict import StepFailed

MU = 0.3
PRESS = 0.02  # depth [mm]; the block is 1 mm high with E = 1000 MPa: small strains, nearly rigid dragging
PRESSED = 0.2  # the load parameter at which pressing ends and dragging starts
LAW = 1e-6  # required of T = mu N


@pytest.fixture(scope="module")
def mesh():
    return read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1))


def dragged(mesh, path, driven="zmax", penalty=1e5, tangential=1e4, mu=MU):
    """Block on a plane; `driven` follows path(s) in x, y, s from 0 to 1 after the block is pressed down."""
    scene = Scene(Body(mesh, "box", from_elastic(1000.0, 0.3)))
    scene.prescribe("zmax", "z", lambda X, t: np.full(len(X), -PRESS * min(t / PRESSED, 1.0)))
    for axis, letter in enumerate("xy"):
        value = lambda X, t, axis=axis: np.full(len(X), path(max(t - PRESSED, 0.0) / (1 - PRESSED))[axis])  # noqa: E731
        scene.prescribe(driven, letter, value)
    scene.contact("zmin", rigid_plane(), mu, penalty=Penalty(penalty, tangential), name="floor")
    return scene


def drag_times(count):
    """One step to press, `count` equal ones to drag."""
    return [PRESSED, *(PRESSED + (1 - PRESSED) * np.arange(1, count + 1) / count)]


def force(result):
    """(steps, 3) force of the plane on the block [N]."""
    assert result.converged, result.verdict.reason
    return np.column_stack([result.column(f"floor_force_{a}_N") for a in "xyz"])


@pytest.mark.parallel
@pytest.mark.parametrize("tangential", [1e3, 1e4, 1e6])
@pytest.mark.parametrize(("steps", "angle"), [(4, 0.0), (16, 0.0), (6, 37.0), (6, 200.0)])
def test_sliding_force_is_mu_times_normal_force(mesh, tangential, steps, angle):
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    scene = dragged(mesh, lambda s: 3.0 * s * direction, tangential=tangential)
    last = force(solve(scene, steps=drag_times(steps)))[-1]
    assert last[2] > 0.0
    np.testing.assert_allclose(last[:2], -MU * last[2] * direction, atol=LAW * MU * last[2])


@pytest.mark.parallel
@pytest.mark.parametrize("shear_limit", [None, 4.5])
def test_friction_that_falls_with_pressure(mesh, shear_limit):
    """mu(p) = 0.3 (p / 10 MPa)^(-1/3) under pressures of about 20 MPa, in places more than the shear limit allows."""
    law = coulomb(MU, exponent=-1 / 3, reference=10.0, shear_limit=shear_limit)
    result = solve(dragged(mesh, lambda s: np.array([3.0 * s, 0.0]), mu=law), steps=drag_times(4))
    assert result.converged, result.verdict.reason
    assert max(result.column("iterations")[2:]) <= 3  # slips on: as many as with a constant mu, for the tangent is exact
    pressure, friction = result.system.contact_terms[0].forces.split_traction(result.system.state)
    free = MU * (10.0 * pressure**2) ** (1 / 3)
    np.testing.assert_allclose(np.linalg.norm(friction, axis=-1), np.minimum(free, shear_limit or np.inf), rtol=LAW)
    above = result.system.comm.allreduce(int((free > 4.5).sum())), result.system.comm.allreduce(int((free < 4.5).sum()))
    assert min(above) > 0


@pytest.mark.parallel
def test_friction_as_a_function_of_the_pressure(mesh):
    """A block whose nodes are all led along a plane, under 20 MPa everywhere: T = mu(p) p."""

    def mu(p):
        return 0.1 + 0.4 / (1.0 + p / 15.0)

    scene = Scene(Body(mesh, "box", from_elastic(1000.0, 0.3)))
    for group in ("zmin", "zmax"):
        scene.prescribe(group, "x", lambda X, t: np.full(len(X), 3.0 * max(t - PRESSED, 0.0)))
        scene.fix(group, "y")
    scene.traction("zmax", lambda t: (0.0, 0.0, -20.0 * min(t / PRESSED, 1.0)))
    scene.contact("zmin", rigid_plane(), coulomb(mu, up_to=200.0), name="floor")
    result = solve(scene, steps=drag_times(4))
    last = force(result)[-1]
    np.testing.assert_allclose(last, [-4.0 * 20.0 * mu(20.0), 0.0, 4.0 * 20.0], atol=1e-7 * 80)  # of a step in balance


@pytest.mark.serial
def test_another_function_is_another_statement(mesh):
    def said(mu):
        scene = dragged(mesh, lambda s: np.zeros(2), mu=coulomb(mu, up_to=50.0))
        return json.loads(json.dumps(statement(scene, build(scene), [Only()], [])))

    first = said(lambda p: 0.3 / (1.0 + p))
    assert first_difference(first, said(lambda p: 0.3 / (1.0 + p))) is None
    name, *_ = first_difference(first, said(lambda p: 0.3 / (1.0 + 1.01 * p)))
    assert name == "contact 'floor', friction"


@pytest.mark.parallel
def test_a_pressure_beyond_the_law_ends_the_run(mesh):
    law = coulomb(lambda p: 0.3 / (1.0 + p / 15.0), up_to=15.0)
    result = solve(dragged(mesh, lambda s: np.array([3.0 * s, 0.0]), mu=law), steps=drag_times(1))
    verdict = result.verdict
    assert verdict.kind == "outside a law" and "beyond the 15 up to which mu(p) is given" in verdict.reason
    assert "raise up_to=" in str(verdict) and result.history[-1]["t"] < PRESSED


@pytest.mark.serial
def test_a_pressure_just_beyond_the_law_is_told_apart():
    assert told_apart(0.300004, 0.3) == ("0.300004", "0.3")
    assert told_apart(16.23456, 15.0) == ("16.23", "15")


@pytest.mark.parallel
@pytest.mark.parametrize("angle", [0.0, 25.0, 90.0, 200.0])
def test_two_directions_of_friction(mesh, angle):
    """mu_1 = 0.3 along (2, 1, 0), mu_2 = 0.6 across: N / sqrt((cos/mu_1)^2 + (sin/mu_2)^2) against the way."""
    turn = np.arctan2(1.0, 2.0) + np.radians(angle)
    way = np.array([np.cos(turn), np.sin(turn)])
    law = coulomb(MU, across=0.6, along=(2.0, 1.0, 0.0))
    result = solve(dragged(mesh, lambda s: 3.0 * s * way, "zmin", mu=law), steps=drag_times(3))
    last = force(result)[-1]
    size = last[2] / np.hypot(np.cos(np.radians(angle)) / MU, np.sin(np.radians(angle)) / 0.6)
    np.testing.assert_allclose(last[:2], -size * way, atol=LAW * size)
    work = result.history[-1]["floor_friction_work_Nmm"]  # the force is the same on all of the way that it slides
    slid = 3.0 - size / 4.0 / 1e4
    np.testing.assert_allclose(work, size * slid, rtol=0.2)


FLOORS = {
    "plane": lambda: (rigid_plane(), "nodes"),
    "mesh, nodes": lambda: (meshed_floor(), "nodes"),
    "mesh, Gauss points": lambda: (meshed_floor(), 2),
    "mesh, averages": lambda: (meshed_floor(), "averages"),
}


def meshed_floor():
    return rigid_surface(box.build, "zmax", size=(16.0, 16.0, 1.0), cells=(7, 7, 1), origin=(-8.0, -8.0, -1.0), name="floor")


@pytest.mark.parallel
@pytest.mark.parametrize("name", FLOORS)
@pytest.mark.parametrize("turn", [0.7, 4.0])
def test_two_directions_of_friction_turn_with_the_tool(mesh, name, turn):
    """mu_1 = 0.3 along x, mu_2 = 0.6 across, of a floor that turns beneath the block and is then drawn along x."""
    floor, points = FLOORS[name]()
    scene = Scene(Body(mesh, "box", from_elastic(1000.0, 0.3)))
    for group in ("zmin", "zmax"):
        scene.fix(group, "xy")
    scene.traction("zmax", (0.0, 0.0, -5.0))
    scene.contact("zmin", floor, coulomb(MU, across=0.6, along=(1.0, 0.0, 0.0)), points=points, name="floor")
    stages = [
        Stage("press", steps=1),
        Stage("turn", move={floor: Motion(rz=turn, about=(1.0, 1.0, 0.0))}, steps=8),
        Stage("draw", move={floor: (1.5, 0.0, 0.0)}, steps=3),
    ]
    result = solve(scene, stages=stages)
    last = force(result)[-1]
    size = 20.0 / np.hypot(np.cos(turn) / MU, np.sin(turn) / 0.6)
    np.testing.assert_allclose(last, [size, 0.0, 20.0], atol=LAW * size)
    contact, state = result.system.contact_terms[0], result.system.state
    allowed = result.system.comm.allreduce(float((contact.forces.limits(state) * contact.surface.area).sum()))
    assert allowed == pytest.approx(size, rel=LAW)
    turned = solve(scene, stages=stages[:2]).require()
    drawn = solve(scene, stages=stages[2:], start=turned)
    np.testing.assert_allclose(force(drawn)[-1], last, atol=LAW * size)


@pytest.mark.parametrize(("tangential", "steps"), [(1e4, 8), (1e4, 24), (1e6, 8)])
def test_curved_path(mesh, tangential, steps):
    """Every node of the sole is led along a half circle: all directions agree, so the resultant obeys the law too."""

    def circle(s):
        return 3.0 * np.array([np.sin(np.pi * s), 1.0 - np.cos(np.pi * s)])

    result = solve(dragged(mesh, circle, "zmin", tangential=tangential), steps=drag_times(steps))
    forces = force(result)[1:]
    np.testing.assert_allclose(np.linalg.norm(forces[:, :2], axis=1), MU * forces[:, 2], rtol=LAW)
    # it opposes the chord of the step up to the elastic slip mu p / eps_t (at most 6e-4 mm) and the turn of a step
    s = np.linspace(0.0, 1.0, steps + 1)
    chords = np.diff(np.array([circle(v) for v in s]), axis=0)
    cosines = -np.einsum("ij,ij->i", chords, forces[:, :2])
    cosines /= np.linalg.norm(chords, axis=1) * np.linalg.norm(forces[:, :2], axis=1)
    assert np.all(cosines > np.cos(2e-2))


def test_curved_path_of_the_top(mesh):
    """Driven at its top, the sole deforms freely; node by node the law holds, and the resultant opposes the motion."""

    def circle(s):
        return 3.0 * np.array([np.sin(np.pi * s), 1.0 - np.cos(np.pi * s)])

    result = solve(dragged(mesh, circle), steps=drag_times(20))
    pressure, friction = result.system.contact_terms[0].forces.split_traction(result.system.state)
    np.testing.assert_allclose(np.linalg.norm(friction, axis=-1), MU * pressure, rtol=LAW)
    chord = circle(1.0) - circle(0.95)
    assert force(result)[-1, :2] @ chord < -0.99 * MU * force(result)[-1, 2] * np.linalg.norm(chord)  # cos(8 degrees)


@pytest.mark.parametrize("tangential", [1e3, 1e5])
def test_hysteresis_loop_has_width_of_twice_the_sliding_force(mesh, tangential):
    def back_and_forth(s):
        return np.array([2.0 * (1.0 - abs(2.0 * s - 1.0)), 0.0])

    result = solve(dragged(mesh, back_and_forth, "zmin", tangential=tangential), steps=drag_times(16))
    forces = force(result)[1:]
    forth, back = forces[7, 0], forces[-1, 0]
    assert forth < 0.0 < back
    np.testing.assert_allclose(back - forth, 2 * MU * forces[-1, 2], rtol=LAW)


def test_stick_below_the_limit_is_elastic_and_returns(mesh):
    """A drag shorter than the elastic slip at the limit is undone without loss."""
    scene = dragged(mesh, lambda s: np.array([1e-4 * (1.0 - abs(2.0 * s - 1.0)), 0.0]), "zmin", tangential=1e3)
    result = solve(scene, steps=drag_times(4))
    area, node_force = 4.0, 1e-4 * 1e3  # closed form: eps_t * drag [MPa] on 4 mm^2
    forces = force(result)[1:]
    np.testing.assert_allclose(forces[1, 0], -node_force * area, rtol=1e-8)  # round-off of a prescribed motion
    np.testing.assert_allclose(forces[-1, :2], 0.0, atol=1e-8 * node_force * area)


class Stumbling(Newton):
    """Newton that solves a chosen step to its end once and then reports failure, so that the step is cut back."""

    def __init__(self, linear, at):
        super().__init__(linear)
        self.at = at

    def step(self, system, t):
        report = super().step(system, t)
        if t == self.at:
            self.at = None
            raise StepFailed("on purpose")
        return report


def final_state(scene, times, stumble=None):
    system = scene.system()
    linear = LinearSolver(system)
    verdict = run(system, Newton(linear) if stumble is None else Stumbling(linear, stumble), times, lambda *_: None)
    assert verdict.converged and verdict.cuts == (stumble is not None)
    contact = system.contact_terms[0]
    traction, path = contact.response(system.state).traction, contact.accepted.history.slip_path
    return displacements(system.state.u), of_all(contact.key, traction), of_all(contact.key, path)


@pytest.mark.parallel
def test_a_step_cut_back_equals_the_small_steps(mesh):
    def path(s):
        return np.array([0.5 * s, 0.3 * s**2])

    cut = final_state(dragged(mesh, path), [0.2, 0.6, 1.0], stumble=1.0)
    direct = final_state(dragged(mesh, path), [0.2, 0.6, 0.8, 1.0])
    for one, other in zip(cut, direct, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * max(np.abs(other).max(initial=0.0), 1e-3))


@pytest.mark.parallel
def test_rollback_restores_the_accepted_state(mesh):
    system = dragged(mesh, lambda s: np.array([0.5 * s, 0.3 * s])).system()
    newton = Newton(LinearSolver(system))
    run(system, newton, [0.2, 0.6], lambda *_: None)
    accepted = system.state.u.x.array.copy()
    newton.step(system, 1.0)
    assert np.abs(system.state.u.x.array - accepted).max() > 0.1
    system.trail.rollback()
    np.testing.assert_array_equal(system.state.u.x.array, accepted)
    assert system.state.t == system.trail.last.t == 0.6
    assert system.assemble_residual() <= 1e-8 * system.scales.accepted  # Newton's tolerance: loads and history are back too


@pytest.mark.parallel
def test_evaluation_does_not_change_history(mesh):
    scene = dragged(mesh, lambda s: np.array([0.5 * s, 0.3 * s]))
    system = scene.system()
    run(system, Newton(LinearSolver(system)), [0.2, 0.6], lambda *_: None)
    system.state.u.x.array[:] += 1e-3 * np.sin(np.arange(len(system.state.u.x.array)))  # a trial state in full slip

    def evaluate():
        system.assemble_residual()
        system.assemble_tangent()
        matrix = system.matrix.getValuesCSR()[2]
        return system.residual_vector.array.copy(), matrix.copy(), system.contact_terms[0].response(system.state).traction

    first = evaluate()
    system.state.travel[0] = (0.1, 0.2, 0.0)  # another trial state in between must leave no trace
    evaluate()
    system.state.travel[0] = 0.0
    for one, other in zip(first, evaluate(), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture(scope="module")
def block():
    return read_gmsh(box.build, size=(10.0, 10.0, 5.0), cells=(4, 4, 2), origin=(-5.0, -5.0, -5.0))


def pressed_block(block, push=None, move=None):
    scene = Scene(Body(block, "box", from_elastic(1000.0, 0.3)))
    scene.fix("zmin")
    tool = rigid_punch(half_width=3.0, height=5.0)
    scene.contact("zmax", tool, MU, name="top")
    drive = {"push": {tool: push}} if push is not None else {"move": {tool: move}}
    result = solve(scene, **drive, steps=4, method=Method(tolerance=1e-11))
    assert result.converged, result.verdict.reason
    travel = np.column_stack([result.column(f"punch_travel_{a}_mm") for a in "xyz"])
    return travel, np.column_stack([result.column(f"top_force_{a}_N") for a in "xyz"])


@pytest.mark.parallel
@pytest.mark.parametrize("target", [(0.0, 0.0, -400.0), (40.0, 0.0, -400.0)])
def test_a_pushed_tool_is_in_balance_and_equals_the_moved_one(block, target):
    target = np.array(target)
    travel, forces = pressed_block(block, push=target)
    pushed = np.flatnonzero(target)
    expected = np.outer(np.arange(1, 5) / 4, target)
    # the force of the tool on the body is the external one: to the step's tolerance, 1e-11 of the largest force
    np.testing.assert_allclose(forces[:, pushed], expected[:, pushed], atol=1e-8 * 400)

    def path(t):
        return [np.interp(t, [0, 0.25, 0.5, 0.75, 1.0], [0.0, *travel[:, i]]) for i in range(3)]

    _, moved = pressed_block(block, move=path)
    np.testing.assert_allclose(moved[:, pushed], expected[:, pushed], atol=1e-6 * 400)  # required


@pytest.mark.parallel
@pytest.mark.parametrize("options", [{}, {"penetration": 1e-4}])
def test_nodes_that_come_under_a_sharp_edge_rub_against_the_punch(options):
    """All that touches slides: H = mu V; rows that come in under leading edges rubbed forwards, down to H = 0.133 V."""
    scene = Scene(Body(read_gmsh(box.build, size=(6.0, 4.0, 2.0), cells=(12, 8, 4)), "box", from_elastic(3.0, 0.4)))
    scene.fix("zmin")
    tool = rigid_punch(half_width=1.0, height=2.0, face=(2.0, 1.6, 2.0))
    scene.contact("zmax", tool, 0.15, name="top", **options)
    stages = [Stage("press", move={tool: (0, 0, -0.25)}, steps=2), Stage("drag", move={tool: (1.6, 0.8, 0)}, steps=8)]
    result = solve(scene, stages=stages).require()
    x, y, z = (result.column(f"top_force_{axis}_N")[4:] for axis in "xyz")
    ways = np.hypot(x, y) / np.abs(z)
    assert (ways <= 0.15 * (1 + 1e-6)).all()  # Coulomb's
    assert (ways > 0.15 * 0.999).all()  # where rubber is strained, it slides by a degree or two to the side
