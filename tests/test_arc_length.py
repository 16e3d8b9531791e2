"""Continuation: limit points with exact answers, the sphere's curve, contact with friction, legs and targets."""

import importlib.util
import json
from pathlib import Path
from types import SimpleNamespace

import gmsh
import numpy as np
import pytest
from by_node import displacements
from mpi4py import MPI
from scipy.optimize import brentq, minimize_scalar
from test_steppers import on_ranks

from fenics_contact import (
    ArcSteps,
    Body,
    Branch,
    Displacement,
    Load,
    Method,
    Scene,
    SceneError,
    Stage,
    Travel,
    from_elastic,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_extrusion,
    rigid_hub,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box, dome, rectangles, sphere_shell
from fenics_contact.solvers import continuation
from fenics_contact.solvers.arc_length import Arc, ArcLength, OffThePath
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.locating import Arrival, Sought, located
from fenics_contact.solvers.softness import soft_motion
from fenics_contact.solvers.verdict import StepFailed

ROOT = Path(__file__).resolve().parent.parent


def demo(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "demos" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SPHERE = demo("inflated_sphere")


# -- Rivlin's cube ----------------------------------------------------------------------------------------------------
BIAS = -1e-3  # the tension along x over that along y and z, less 1: leads the path onto the branch of flat cubes
STIFF = 1e4  # K / mu


def cube():
    """A neo-Hookean cube of mu = 1 under dead tensions t on all faces: one element per process."""
    mesh = read_gmsh(box.build, cells=(MPI.COMM_WORLD.size, 1, 1))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, STIFF)), element="mixed")
    for axis, letter in enumerate("xyz"):
        scene.fix(f"{letter}min", letter)
        scene.traction(f"{letter}max", np.eye(3)[axis] * (1 + BIAS if letter == "x" else 1.0))
    return scene


def tension(wide):
    """Dead tension at which the cube's equal stretches along y and z are `wide`: homogeneous, compressible, exact."""

    def nominal(x, y):
        J, I1 = x * y**2, x**2 + 2 * y**2
        return [J ** (-2 / 3) * (s - I1 / (3 * s)) + STIFF * (J - 1) * J / s for s in (x, y)]

    def unbalanced(x):
        along_x, along_y = nominal(x, wide)
        return along_x - (1 + BIAS) * along_y

    x = brentq(unbalanced, 0.99 * wide**-2, 1.01 * wide**-2, xtol=1e-15)
    return nominal(x, wide)[1]


def exact_folds():
    """Largest tension near the symmetric state and the least one on the branch, by minimisation."""
    options = {"xatol": 1e-7}
    largest = minimize_scalar(lambda w: -tension(w), bounds=(1.001, 1.15), method="bounded", options=options)
    least = minimize_scalar(tension, bounds=(1.15, 1.5), method="bounded", options=options)
    return -largest.fun, least.fun


@pytest.fixture(scope="module")
def cube_there_and_back():
    """Past both folds to a stretch of 1.8 and back to no load."""
    steps = ArcSteps(until=Displacement("ymax", "y", 0.8), back=Load(0.0), first=0.2, largest=0.1)
    result = solve(cube(), steps=steps)
    assert result.converged, result.verdict.reason
    return result


@pytest.mark.parallel
def test_folds_of_rivlins_cube_are_located_in_both_directions(cube_there_and_back):
    points = cube_there_and_back.summary["limit_points"]
    assert [p["kind"][:3] for p in points] == ["max", "min", "min", "max"]
    largest, least = exact_folds()
    # 1e-6 is what is promised; Newton's own 1e-8 of the force lies below
    np.testing.assert_allclose([p["t"] for p in points], [largest, least, least, largest], rtol=1e-6)
    # incompressible and without bias the branch folds at 3 / 2^(2/3): both shift it by no more than their size
    assert abs(points[1]["t"] / (3 / 2 ** (2 / 3)) - 1) < 2 * abs(BIAS)


@pytest.mark.parallel
def test_an_elastic_path_leads_back_to_where_it_began(cube_there_and_back):
    assert abs(cube_there_and_back.history[-1]["t"]) < 1e-5  # the target's tolerance on a path of loads up to 2
    assert np.abs(cube_there_and_back.u.x.array).max() < 1e-5


def test_history_marks_the_limit_points(cube_there_and_back):
    marks = cube_there_and_back.column("limit_point")
    t = cube_there_and_back.column("t")
    inner = np.flatnonzero(marks)
    assert list(marks[inner]) == [1, -1, -1, 1]
    for i in inner:  # an extremum among its neighbours
        assert np.all(marks[i] * (t[i] - t[[i - 1, i + 1]]) >= 0.0)


def test_the_last_step_lands_on_its_target():
    for target, reached in ((0.3, lambda r: r.history[-1]["t"]), (0.7, lambda r: r.history[-1]["t"])):
        result = solve(cube(), steps=ArcSteps(until=[Displacement("ymax", "y", 5.0), Load(target)], first=0.1))
        assert result.converged and "load" in result.verdict.reason
        assert abs(reached(result) - target) <= 1e-6 * target


# -- the sphere -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("reading", "table"),
    [
        # p [kPa] at u = 1.9, 19, 38, 57, 95, 190 mm and at the limit, K = 5: from another script
        ("A", [0.917799, 4.750417, 5.446230, 5.304173, 4.684156, 3.585209, 5.450763]),
        ("B", [0.812040, 4.281276, 4.916432, 4.750428, 4.087572, 2.928653, 4.918205]),
    ],
)
@pytest.mark.serial
def test_exact_sphere(reading, table):
    exact = [SPHERE.exact_pressure(reading, 5.0, u) for u in (1.9, 19.0, 38.0, 57.0, 95.0, 190.0)]
    limit, _ = SPHERE.exact_limit(reading, 5.0)
    np.testing.assert_allclose(1e3 * np.array([*exact, limit]), table, rtol=0, atol=2e-6)  # the table's digits


@pytest.mark.parallel
def test_sphere_converges_with_the_square_of_the_cells(monkeypatch):
    monkeypatch.setattr(SPHERE, "LAST", 60.0)
    exact, _ = SPHERE.exact_limit("A", 5.0)
    errors = []
    for cells, layers in ((3, 1), (6, 2)):
        mesh = read_gmsh(sphere_shell.build, cells=cells, layers=layers)
        u, p, peak, _ = SPHERE.inflate(mesh, "A", 5.0)
        errors.append(p[peak] / exact - 1)
        assert abs(u[-1] - 60.0) < 1e-4  # lands on its target: 1e-6 of the way
    assert abs(np.log2(errors[0] / errors[1]) - 2) < 0.1, errors
    assert abs(errors[1]) < 3e-3


def test_newton_on_the_arc_is_quadratic():
    """Through the sphere's limit point, follower pressure and all."""
    scene = Scene(
        Body(read_gmsh(sphere_shell.build, cells=3, layers=1), "shell", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0))
    )
    for axis in "xyz":
        scene.fix(f"symmetry_{axis}", axis)
    scene.pressure("inner", 0.005)
    radial = SPHERE.inner_radial(scene)
    steps = ArcSteps(until=lambda state: radial(state) - 95.0, first=0.5)
    result = solve(scene, steps=steps, method=Method(tolerance=1e-10))
    assert result.converged and len(result.summary["limit_points"]) == 1
    pairs = [(a, b) for r in result.verdict.residuals for a, b in zip(r, r[1:], strict=False) if a < 0.1 and b > 1e-11]
    # shares of the force: where they are small, what is left is of the order of the square of what was left before
    assert len(pairs) > 5 and all(b < 10 * a**2 for a, b in pairs), pairs


# -- contact ----------------------------------------------------------------------------------------------------------
def pressed(drive, friction=0.4):
    """A block under a rough ball; drive: "push" or "move"."""
    mesh = read_gmsh(box.build, size=(8.0, 8.0, 4.0), cells=(4, 4, 3))
    scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)))
    scene.fix("zmin")
    ball = rigid_sphere(5.0, (4.0, 4.0, 9.0), name="ball")
    scene.contact("zmax", ball, friction, name="top")
    way = {"push": (0.0, 0.0, -4.0), "move": (0.4, 0.0, -1.2)}[drive]
    return scene, {drive: {ball: way}}


def columns(result):
    names = ["ball_travel_x_mm", "ball_travel_z_mm", *(f"top_force_{axis}_N" for axis in "xyz")]
    return np.array([result.column(name) for name in names])


@pytest.mark.parallel
@pytest.mark.parametrize("drive", [pytest.param("move", marks=pytest.mark.slow), "push"])
def test_same_states_as_load_control(drive):
    """At the loads of the continuation's own steps Newton finds its states: the same friction history."""
    scene, way = pressed(drive)
    arc = solve(scene, **way, steps=ArcSteps(until=Load(1.0), first=0.2), method=Method(tolerance=1e-11))
    assert arc.converged and len(arc.history) > 3 and not arc.summary["limit_points"]
    assert max(arc.column("top_sticking_points")) > 0
    loads = arc.column("t")
    newton = solve(scene, **way, steps=[*loads[:-1], 1.0], method=Method(tolerance=1e-11))
    assert newton.verdict.cuts == 0
    expected = columns(newton)
    # the last load is 1 to the target's tolerance of 1e-6
    np.testing.assert_allclose(columns(arc), expected, rtol=0, atol=2e-6 * np.abs(expected).max())
    np.testing.assert_allclose(columns(arc)[:, :-1], expected[:, :-1], rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parallel
def test_a_dropped_trial_leaves_no_trace():
    """A step after a longer one that was rolled back is the same step taken directly, friction included."""
    states = []
    for trials in ((0.2,), (0.6, 0.2)):
        scene, way = pressed("push")
        system = scene.system(**way)
        arc = ArcLength(LinearSolver(system), tolerance=1e-11)  # rounding leaves 2e-12 on some partitions
        rate = arc.start(system)
        arc.step(system, Arc(0.1, rate))
        system.trail.commit()
        for length in trials:
            arc.step(system, Arc(length, rate))
            dt = arc.made(system).dt
            if length != trials[-1]:
                system.trail.rollback()
        system.trail.commit()
        states.append((displacements(system.state.u), system.state.travel.copy(), system.state.t, dt))
    for one, other in zip(*states, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10)


def snapped(drive=None, travels=None):
    """A coarse rough dome pushed through its snap, or moved through the same travels."""
    mesh = read_gmsh(dome.build, thickness=2.0, boss=5.0, cells=4)
    scene = Scene(Body(mesh, "dome", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), degree=2)
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("rim")
    ball = rigid_sphere(8.0, (0, 0, 49.0), name="ball")
    scene.contact("outer", ball, 0.3, name="top")
    if travels is not None:
        return solve(scene, move={ball: (0, 0, travels[-1])}, steps=travels / travels[-1])
    steps = ArcSteps(until=Travel(ball, "z", -17.0), first=0.1, largest=1.5)
    return solve(scene, push={ball: (0, 0, -1.0)}, steps=steps)


@pytest.mark.slow
def test_pushed_through_a_snap_with_friction():
    pushed = snapped()
    assert pushed.converged, pushed.verdict.reason
    assert [p["kind"][:3] for p in pushed.summary["limit_points"]] == ["max", "min"]
    travels = pushed.column("ball_travel_z_mm")
    assert abs(travels[-1] + 17.0) < 1e-6 * 17.0
    moved = snapped(travels=travels)
    assert moved.verdict.cuts == 0
    force = pushed.column("top_force_z_N")
    # the same states, so the same friction history; both balance to 1e-8 of the largest force
    np.testing.assert_allclose(moved.column("top_force_z_N"), force, rtol=0, atol=1e-6 * np.abs(force).max())
    t = pushed.column("t")
    np.testing.assert_allclose(-force, t, rtol=0, atol=1e-7 * t.max())  # the ball's balance


def arch(thickness):
    """A roller on half an arch of radius 20, clamped at its foot."""
    across = ((0.0, -thickness / 2), (np.radians(35.0), thickness))

    def build():
        rectangles.build(rectangles={"arch": (*across, (24, 2))})
        gmsh.model.mesh.setOrder(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, (angle, y, _) in zip(tags, places.reshape(-1, 3), strict=True):
            gmsh.model.mesh.setNode(tag, (20.0 + y) * np.array([np.sin(angle), np.cos(angle), 0.0]), [])

    scene = Scene(Body(read_gmsh(build), "arch", neo_hooke(1.0, 20.0)), plane="strain", degree=2, element="mixed")
    scene.fix("arch_xmax")
    scene.fix("arch_xmin", "x")
    roller = rigid_cylinder(4.0, (0, 24.0 + thickness / 2, 0), (0, 0, 1), name="roller")
    scene.contact("arch_ymax", roller, 0.3, name="top")
    return scene, roller


@pytest.mark.parametrize("thickness", [0.8, 0.4])
def test_a_thin_arch_is_pushed_past_its_limit_load(thickness):
    """Against a roller that contact grips it is a hundred thousand times softer from the start: at its limit point less is
    left than of what meets no resistance at all. The same path with the roller moved."""
    scene, roller = arch(thickness)
    touch = Stage("touch", move={roller: (0, -0.3, 0)}, steps=2)
    forces, points = [], []
    for way in ({"move": {roller: (0, -5.7, 0)}}, {"push": {roller: (0, -0.02, 0)}}):
        stations = [Travel(roller, "y", -y) for y in (1.0, 2.0, 3.0, 4.0, 5.0)]
        steps = ArcSteps(until=Travel(roller, "y", -6.0), first=0.1, largest=0.4, stations=stations)
        onward = Stage("onward", **way, steps=steps)
        result = solve(scene, stages=[touch, onward]).require()
        assert result.verdict.cuts == 0, result.verdict.notes
        forces.append(result.column("top_force_y_N")[[i for i, at in enumerate(result.column("station")) if at > 0]])
        points.append([p["kind"][:3] for p in result.summary["limit_points"]])
    assert points == [[], ["max", "min"]]
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-5)


def test_no_part_of_an_arch_is_loose_at_its_limit_load():
    """Its softest motion is resisted by nothing, and strains the arch."""
    scene, roller = arch(0.8)
    touch = Stage("touch", move={roller: (0, -0.3, 0)}, steps=2)
    most = 12
    for _ in range(2):  # the second run ends at the limit point
        steps = ArcSteps(until=Travel(roller, "y", -6.0), first=0.1, most=most)
        onward = Stage("onward", push={roller: (0, -0.02, 0)}, steps=steps)
        result = solve(scene, stages=[touch, onward])
        most = result.summary["limit_points"][0]["step"] - 2
    assert result.history[-1]["limit_point"] == 1
    found = soft_motion(result.system)
    assert found.kind == "limit point" and "tool 'roller'" in found.place, found
    # a limit point stops no path: where no arc was off it the cause is what kept them from their balance
    left = StepFailed("15 iterations left 1e-7 of the force out of balance")
    off = OffThePath("the path does not meet the arc")
    stopped = continuation.cause(result.system, left, [left, left])
    assert stopped.kind == "no convergence" and stopped.reason.startswith("15 iterations left"), stopped
    assert "penalty= of contact 'top' far below" in stopped.remedy and "softest motion" in stopped.reason, stopped
    stopped = continuation.cause(result.system, left, [off, left])
    assert stopped.kind == "limit point" and "keep the arcs shorter" in stopped.remedy, stopped


def numbers():
    """The path of the pushed ball, there and back."""
    scene, way = pressed("push")
    steps = ArcSteps(until=Load(1.0), back=Load(0.5), first=0.2)
    result = solve(scene, **way, steps=steps, method=Method(tolerance=1e-11))
    columns = [
        result.column(n) for n in ("t", "ball_travel_z_mm", "top_force_z_N", "top_penetration_mm", "top_sticking_points")
    ]
    return [[float(x) for x in column] for column in columns]


@pytest.mark.slow
@pytest.mark.serial
def test_same_path_on_one_and_two_ranks():
    one, two = np.array(numbers()), on_ranks(2, __file__)
    size = np.abs(one).max(axis=1, keepdims=True)
    # each row against its own largest entry; steps end at 1e-11
    np.testing.assert_allclose(two / size, one / size, rtol=0, atol=1e-9)


# -- ends and wrong statements ----------------------------------------------------------------------------------------
@pytest.mark.parallel
def test_a_target_out_of_reach_ends_with_its_reason():
    result = solve(cube(), steps=ArcSteps(until=Load(3.0), first=0.2, most=12))
    assert not result.converged and len(result.history) == 12
    assert "12 steps" in result.verdict.reason and "load t = 3" in result.verdict.reason


def loose_block(force, floor=0.0):
    """A block on a rough floor under a body force along z, a function of t; nothing else holds it."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", neo_hooke(0.4, 2.0)))
    scene.contact("zmin", rigid_plane((0, 0, floor)), 0.3, name="c")
    scene.body_force(lambda t: (0.0, 0.0, force(t)))
    return scene


def fades(t):
    """Presses most at t = 0.25, and from t = 0.5 on lifts."""
    return -0.2 * (t - 2.0 * t**2)


@pytest.mark.parallel
def test_a_body_that_its_contacts_let_go_is_named():
    failed = solve(loose_block(fades), steps=ArcSteps(until=Load(1.0), first=0.1))
    assert failed.verdict.kind == "rigid-body motion" and "body 'box'" in failed.verdict.place, failed.verdict.reason
    assert "about to let go" in failed.verdict.reason and 0.49 < failed.verdict.t < 0.5
    assert "end the path before" in failed.verdict.remedy
    solve(loose_block(fades), steps=ArcSteps(until=Load(0.45), first=0.1)).require()


@pytest.mark.parallel
def test_a_remedy_that_does_not_go_with_arcs_is_one_for_load_steps():
    failed = solve(loose_block(lambda t: -0.02 * t, floor=-0.1), steps=ArcSteps(until=Load(1.0), first=0.1))
    assert "solve(..., steps=20, method=Method(stabilise=True))" in failed.verdict.remedy, failed.verdict.reason
    scene = loose_block(lambda t: -0.02 * t, floor=-0.1)
    result = solve(scene, method=Method("newton", stabilise=True), steps=2).require()
    np.testing.assert_allclose(result.history[-1]["c_force_z_N"], 8.0 * 0.02, rtol=1e-6)


@pytest.mark.parallel
def test_a_path_that_does_not_start_in_balance_is_named():
    failed = solve(loose_block(lambda t: -0.02 * (1.0 + t)), steps=ArcSteps(until=Load(1.0), first=0.01, largest=1e-4))
    assert "let the functions of the loads start from 0" in failed.verdict.remedy, failed.verdict.reason
    solve(loose_block(lambda t: -0.04 * t), steps=ArcSteps(until=Load(1.0), first=0.1)).require()


def refused(action, *words):
    """The action raises SceneError with all words in its message, the same on every rank."""
    with pytest.raises(SceneError) as caught:
        action()
    assert all(word in str(caught.value) for word in words), caught.value
    assert len(set(MPI.COMM_WORLD.allgather(str(caught.value)))) == 1


@pytest.mark.parallel
def test_wrong_statements_are_refused():
    scene, way = pressed("push")
    ball = next(iter(way["push"]))
    refused(lambda: solve(scene, **way, method="arc_length"), "give steps=ArcSteps(until=...)")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=Load(1.0)), method="snes"), "go by arc length", "'snes'")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=None)), "ArcSteps needs until")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=Displacement("lid", "z", 1.0))), "'lid'", "zmax")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=Displacement("zmax", "r", 1.0))), "'r'", "x, y, z")
    refused(
        lambda: solve(scene, **way, steps=ArcSteps(until=Travel(rigid_plane(name="other"), "z", 1.0))),
        "'other'",
        "no contact",
    )
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=Travel(ball, "z", np.nan))), "finite")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until="far")), "'far'", "Load")
    refused(lambda: solve(scene, **way, steps=[0.5, 1.0], method="arc_length"), "ArcSteps")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=Load(1.0), first=0.0)), "first")
    refused(lambda: solve(scene, **way, steps=ArcSteps(until=Load(1.0), most=0)), "most")


@pytest.mark.parallel
@pytest.mark.parametrize("plane", [False, True])
def test_a_surface_that_cannot_go_there_is_no_target(plane):
    """Along an axis that supports hold, or across a plane mesh. One that supports lead there is a target."""
    if plane:
        mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0, 0), (1, 1), (1, 2))})
        scene = Scene(Body(mesh, "pad", neo_hooke(1.0, 5.0)), plane="strain")
    else:
        mesh = read_gmsh(box.build, size=(1, 1, 1), cells=(1, 2, 1))
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
    low, high, side = ("pad_ymin", "pad_ymax", "pad_xmin") if plane else ("ymin", "ymax", "xmin")
    scene.fix(low)
    scene.fix(side, "x")
    scene.prescribe(high, "y", 0.3)

    def run(until, **more):
        return solve(scene, steps=ArcSteps(until=until, first=0.5, **more))

    held = [(low, "y"), (low, "x"), (side, "x"), *([(high, "z")] if plane else [])]
    for group, axis in held:
        refused(lambda: run(Displacement(group, axis, 0.1)), f"'{group}' along {axis}", "neither free nor led")  # noqa: B023
        refused(lambda: run(Load(1.0), branch=Branch(group, axis)), f"'{group}' cannot move along {axis}")  # noqa: B023
    refused(lambda: run(Load(1.0), stations=[Displacement(low, "y", 0.1)]), "neither free nor led")
    reached = run(Displacement(high, "y", 0.15))
    assert reached.converged and reached.history[-1]["t"] == pytest.approx(0.5, abs=1e-6)
    assert run(Displacement(side, "y", 0.05)).converged


@pytest.mark.parallel
def test_nothing_that_depends_on_the_load_is_refused():
    scene, _ = pressed("push")
    refused(lambda: solve(scene, steps=ArcSteps(until=Load(1.0), first=0.1)), "without a load to scale", "push a tool")


if __name__ == "__main__":
    values = numbers()
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(values))


@pytest.mark.parallel
def test_steps_land_on_every_station_there_and_back():
    """A pulled block: at each station the state is that of load control, each time the path passes it."""
    mesh = read_gmsh(box.build, cells=(2, 2, 2))

    def scene():
        stated = Scene(Body(mesh, "box", neo_hooke(1.0, 10.0)))
        stated.fix("zmin")
        stated.traction("zmax", (0.1, 0.0, 0.5))
        return stated

    end = lambda view: view.at("zmax").displacement[2]  # noqa: E731
    plain = solve(scene(), steps=[0.25, 0.6, 1.0], record={"end": end}).require()
    middle = 0.5 * (plain.column("end")[0] + plain.column("end")[1])
    stations = [Load(0.25), Load(0.6), Displacement("zmax", "z", middle)]
    steps = ArcSteps(until=Load(1.0), back=Load(0.0), first=0.11, stations=stations)
    result = solve(scene(), steps=steps, record={"end": end}).require()
    station, t, ends = (result.column(name) for name in ("station", "t", "end"))
    assert station[station > 0].tolist() == [1, 3, 2, 2, 3, 1]
    for number, load in ((1, 0.25), (2, 0.6)):
        np.testing.assert_allclose(t[station == number], load, atol=2e-6)
        np.testing.assert_allclose(ends[station == number], plain.column("end")[number - 1], rtol=1e-5)
    assert result.column("t").max() == pytest.approx(1.0, abs=2e-6) and len(t) > 8
    with pytest.raises(SceneError, match="give a Load"):
        solve(scene(), steps=ArcSteps(until=Load(1.0), stations=[0.3]))


# -- over an edge -----------------------------------------------------------------------------------------------------
def snap_fit(friction):
    """An arm with a hub at one end, whose other end runs up a ramp of 27 degrees with a crest rounded by 0.4."""
    arm = {"arm": ((0.0, 0.0), (20.0, 1.0), (20, 2))}
    scene = Scene(Body(read_gmsh(rectangles.build, rectangles=arm), "arm", from_elastic(100.0, 0.3)), plane="strain")
    profile = [(20.5, -1.0), (20.5, 0.0), (22.5, 1.0, 0.4), (26.0, 1.0)]
    catch = rigid_extrusion(profile, along=(0, 0, -1), up=(0, 1, 0), name="catch")
    scene.contact(("arm_xmax", "arm_ymin"), catch, friction=friction, name="snap")
    hub = rigid_hub("hub", point=(0, 0.5, 0))
    scene.tie("arm_xmin", hub)
    return scene, hub


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_pushed_part_goes_over_an_edge_where_the_load_falls_at_once(friction):
    """The corner of the arm comes from the ramp to the round crest: the force falls 15 times as steeply as it rose. Against
    the travel prescribed."""
    found = {}
    for way in (1.6, 1.7):
        scene, hub = snap_fit(friction)
        touch = Stage("touch", move={hub: (0.8, 0, 0)}, steps=4)
        found[way] = solve(scene, stages=[touch, Stage("drive", move={hub: (way, 0, 0)}, steps=40)])
    arcs = ArcSteps(until=Travel(hub, "x", 2.5), first=0.1, largest=0.3)
    push = Stage("push", push={hub: (0.05, 0, 0)}, steps=arcs)
    result = solve(scene, stages=[touch, push]).require()
    force, travel = result.column("hub_force_x_N"), result.column("hub_travel_x_mm")
    (limit,) = result.summary["limit_points"]
    at_limit = force[limit["step"] - 1]
    assert limit["kind"] == "maximum of the load" and (np.diff(travel) > 0.0).all()
    assert at_limit == pytest.approx(force.max()) and 2.4 < travel[limit["step"] - 1] < 2.41
    # no coarser than the steps of the drive, beside the edge
    assert at_limit == pytest.approx(found[1.6].column("hub_force_x_N").max(), rel=1e-2)
    # it lands on its target to 1e-6 of the way, where the force falls by 12 times itself in a millimetre
    assert force[-1] == pytest.approx(found[1.7].column("hub_force_x_N")[-1], rel=1e-3 if friction else 3e-5)


def cap(half) -> None:
    """A section of a cap that reaches so many degrees from its axis, of radius 10, 0.5 thick."""
    rectangles.build(rectangles={"cap": ((0.0, 0.0), (1.0, 1.0), (int(0.6 * half), 2))}, order=2)
    tags, places, _ = gmsh.model.mesh.getNodes()
    for tag, (along, through, _) in zip(tags, places.reshape(-1, 3), strict=True):
        angle, r = np.radians(half * along), 9.75 + 0.5 * through
        gmsh.model.mesh.setNode(tag, [r * np.sin(angle), r * np.cos(angle), 0.0], [])


def lidded(half, law, element, penalty, end):
    """A cap under a smooth lid that is pushed down to a travel of `end`; the crown's way down is recorded."""
    scene = Scene(Body(read_gmsh(cap, half=half), "cap", law), plane="axisymmetric", degree=2, element=element)
    scene.fix("cap_xmax")
    lid = rigid_plane((0, 10.25, 0), (0, -1, 0), name="lid")
    scene.contact("cap_ymax", lid, name="c", **penalty)
    touch = Stage("touch", move={lid: (0, -0.05, 0)}, steps=2)
    arcs = ArcSteps(until=Travel(lid, "y", -end), first=0.1, largest=0.3)
    crown = {"crown": lambda view: -view.at((0, 10.25, 0)).displacement[1]}
    return solve(scene, stages=[touch, Stage("push", push={lid: (0, -1.0, 0)}, steps=arcs)], record=crown)


LIDDED = {  # with multipliers, and where a limit point is located at the kink, or is not
    "multipliers": (35.0, neo_hooke(1.0, K=100.0), "mixed", {"penetration": 1e-5}, 1.15),
    "default": (40.0, mooney_rivlin(a1=0.3, a2=0.05, K=10.0), "displacement", {}, 1.25),
    "penalty": (40.0, mooney_rivlin(a1=0.3, a2=0.05, K=10.0), "displacement", {"penalty": 100.0}, 1.2),
}


@pytest.mark.parametrize("kind", LIDDED)
def test_a_path_goes_on_where_it_turns_straight_back(kind):
    """The flat contact of a crown gives way to a ring: a node lets go, load and lid go back, nearly along the way that they
    came, and then the crown on. That looked like a bifurcation, and the path led down again to no load, or ended."""
    result = lidded(*LIDDED[kind]).require()
    crown, travel = result.column("crown"), -result.column("lid_travel_y_mm")
    turned = int(np.argmax(np.diff(travel) < 0.0))  # where the lid's way was longest
    assert turned and not result.column("bifurcation").any()
    assert crown[turned:].min() > 0.7 * crown[turned] and crown[-1] > 1.3 * travel[-1]


def test_a_path_that_leads_back_along_itself_is_not_followed(monkeypatch):
    """Where it is not found out that the load has turned."""
    monkeypatch.setattr(continuation, "_load_turned", lambda path, arrival: False)
    result = lidded(*LIDDED["multipliers"])
    travel = -result.column("lid_travel_y_mm")
    assert result.converged or (travel[-1] > 0.95 * travel.max() and "arcs shorter" in result.verdict.remedy), travel


class Gone:
    """An Increment of a path with one coordinate, along which the load is a function."""

    def __init__(self, s, dt):
        self.s, self.dt = s, dt

    def times(self, share):
        return Gone(share * self.s, share * self.dt)

    def add(self, other, share):
        self.s, self.dt = self.s + share * other.s, self.dt + share * other.dt


LOADS = {  # and their rates, on 0 <= s <= 1
    "kink": (lambda s: min(3.0 * s, 1.2 + 0.9 * (0.4 - s)), lambda s: 3.0 if s < 0.4 else -0.9),
    "bent kink": (
        lambda s: min(2.0 * s - s**2, 0.51 - 4.0 * (s - 0.3) - 5.0 * (s - 0.3) ** 2),
        lambda s: 2.0 - 2.0 * s if s < 0.3 else -4.0 - 10.0 * (s - 0.3),
    ),
    "kink at the end": (lambda s: min(s, 2.0 - 1.002 * s), lambda s: 1.0 if s < 2.0 / 2.002 else -1.002),
    "parabola": (lambda s: s * (1.4 - s), lambda s: 1.4 - 2.0 * s),
    "smooth": (lambda s: np.sin(2.0 * s), lambda s: 2.0 * np.cos(2.0 * s)),
}


@pytest.mark.parametrize("name", LOADS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_few_arcs_find_a_limit_point_smooth_or_not(name, side):
    """Bisection takes 20 to a millionth; the arc ends before the kink, by no more than is asked."""
    load, rate = (lambda s, f=f: side * f(s) for f in LOADS[name])
    lengths, bound = [], 1e-6

    def arrive(s, near):
        assert near is None or abs(near.s - s) < 1e-12
        lengths.append(s)
        return Arrival(s, Gone(s, load(s)), Gone(1.0, rate(s)), SimpleNamespace(iterations=1), 1.0)

    whole = arrive(1.0, None)
    sought = Sought(lambda a: a.rate.dt, lambda dt, left: left <= bound and dt * side > -0.01, 0.5 * bound)
    found = located(arrive, whole, (rate(0.0), Gone(1.0, rate(0.0))), sought, lambda a, b: a.s * b.s)
    top = {"kink": 0.4, "bent kink": 0.3, "kink at the end": 2.0 / 2.002, "parabola": 0.7, "smooth": np.pi / 4}[name]
    assert abs(found.length - top) < 2.0 * bound and side * found.rate.dt > -0.01
    assert len(lengths) <= (5 if name in ("parabola", "smooth") else 10), lengths
    assert found.report.iterations == len(lengths)
