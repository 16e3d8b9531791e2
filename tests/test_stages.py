"""Stages: hand-written paths, back to rest, force after displacement, arc length past a corner, resumed inside of one."""

import json
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from refusals import refused
from scipy.optimize import brentq
from test_arc_length import BIAS, cube, exact_folds, tension
from test_directions import TURN, placed
from test_restart import ROOT, alone, apart, mpirun, numbers

from fenics_contact import (
    ArcSteps,
    Body,
    Displacement,
    Load,
    Method,
    Motion,
    Output,
    Penalty,
    Scene,
    Stage,
    Travel,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.assembly.pose import rotation
from fenics_contact.meshes import box, rectangles
from fenics_contact.output.history import widest_turn
from fenics_contact.restart import last_state
from fenics_contact.scene.start import drives_left

COMM = MPI.COMM_WORLD
CLOSE = Method(tolerance=1e-11)
TIGHT = {"method": CLOSE}
LAW = neo_hooke(0.4, 2.0)


@pytest.fixture
def folder(tmp_path):
    return COMM.bcast(tmp_path)


@cache
def block():
    return read_gmsh(box.build, size=(8.0, 8.0, 4.0), cells=(4, 4, 2))


def pressed(friction=0.3, **exactly):
    """A block under a ball that starts on its top."""
    scene = Scene(Body(block(), "box", LAW))
    scene.fix("zmin")
    ball = rigid_sphere(5.0, (4.0, 4.0, 9.0), name="ball")
    scene.contact("zmax", ball, friction, name="top", **exactly)
    return scene, ball


def press_drag_lift(ball, steps=(3, 4, 2)):
    ways = {"press": (0, 0, -1.0), "drag": (1.5, 0, 0), "lift": (0, 0, 2.0)}
    return [Stage(name, move={ball: way}, steps=n) for (name, way), n in zip(ways.items(), steps, strict=True)]


def same(staged, plain, bound=1e-9):
    """All columns but the stage's and what Newton's way may differ in."""
    skip = ("stage", "seconds", "residual", "iterations")
    one, other = (
        {name: column for name, column in result.table().items() if name not in skip} for result in (staged, plain)
    )
    assert apart(one, other) < bound


# -- stages and hand-written paths ------------------------------------------------------------------------------------
@pytest.mark.parallel
def test_press_drag_lift_is_the_run_with_the_same_paths_written_by_hand():
    scene, ball = pressed()
    staged = solve(scene, stages=press_drag_lift(ball), **TIGHT).require()
    corners = [(0, 0, 0), (0, 0, -1.0), (1.5, 0, -1.0), (1.5, 0, 1.0)]
    path = lambda t: [np.interp(t, range(4), [c[i] for c in corners]) for i in range(3)]  # noqa: E731
    times = np.concatenate([i + np.arange(1, n + 1) / n for i, n in enumerate((3, 4, 2))])
    plain = solve(scene, move={ball: path}, steps=times, **TIGHT).require()
    assert staged.verdict.cuts == plain.verdict.cuts == 0
    same(staged, plain)
    assert list(staged.column("stage")) == ["press"] * 3 + ["drag"] * 4 + ["lift"] * 2
    assert len(staged.column("t", "drag")) == 4 and len(staged.table("lift")["t"]) == 2
    assert [one["steps"] for one in staged.summary["stages"]] == [[1, 3], [4, 7], [8, 9]]


@pytest.mark.parallel
def test_supports_and_loads_of_stages_are_the_same_written_by_hand():
    """What is not named stays as it is, what the scene states is of the first stage; functions get the stage's own s."""
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2))

    def scene(by_hand):
        stated = Scene(Body(mesh, "box", LAW))
        stated.fix("zmin")
        hand = lambda *values: (lambda t: np.interp(t, (0, 1, 3, 4), values)) if by_hand else None  # noqa: E731
        z, p, f = hand(0, -0.2, -0.2 - 0.1, -0.3), hand(0, 0.02, 0.02, 0.05), hand(0, 0, 0.03, 0)
        stated.prescribe("zmax", "z", (lambda X, t: z(t)) if by_hand else -0.2)
        stated.pressure("xmax", p or 0.02)
        stated.traction("ymax", (lambda t: (0, f(t), 0)) if by_hand else (0, 0, 0))
        stated.body_force((lambda t: (0, 0.01 * min(t, 1), 0)) if by_hand else (0, 0.01, 0))
        return stated

    plain = solve(scene(True), steps=[0.5, 1, 2, 3, 3.5, 4], **TIGHT).require()
    stages = [
        Stage("start"),
        Stage("on", prescribe={("zmax", "z"): -0.1}, tractions={"ymax": lambda s: (0, 0.03 * s, 0)}, duration=2.0),
        Stage("off", pressures={"xmax": 0.05}, tractions={"ymax": (0, 0, 0)}),
    ]
    same(solve(scene(False), stages=stages, steps=2, **TIGHT).require(), plain)


@pytest.mark.parallel
def test_unloaded_without_friction_all_is_at_rest_and_with_it_work_is_lost():
    scene, ball = pressed(0.0)
    back = solve(
        scene, stages=[Stage("in", move={ball: (0, 0, -1)}), Stage("out", move={ball: (0, 0, 1.01)})], steps=2, **TIGHT
    )
    assert back.require().column("top_force_z_N", "in")[-1] < -1.0
    assert max(COMM.allgather(np.abs(back.u.x.array).max())) < 1e-9  # mm, of 1 mm
    errors = []
    for n in (1, 2):
        scene, ball = pressed()
        rough = solve(scene, stages=press_drag_lift(ball, (3 * n, 4 * n, 2)), **TIGHT).require()
        work, strain, penalty = (
            rough.column(f"{name}_Nmm") for name in ("top_friction_work", "strain_energy", "penalty_energy")
        )
        assert np.all(np.diff(work) > -1e-12) and work[-1] > 0.5 and rough.column("external_work_Nmm")[-1] > 0.5
        assert abs(strain[-1]) + abs(penalty[-1]) < 1e-12  # nothing but friction has taken any
        errors.append(np.abs(np.concatenate([rough.column("energy_error_Nmm", one) for one in ("press", "drag")])).max())
    assert errors[1] < 0.5 * errors[0], errors  # a quarter where all is smooth


# -- tools that turn, all kinds of loads, supports along any direction -------------------------------------------------
def after(first, last):
    """A function of t: 0 to `first` in the first of two stages, from there to `last` in the second."""
    return lambda t: np.interp(t, (0, 1, 2), (0.0, first, last))


@pytest.mark.parallel
def test_a_tool_turned_in_a_second_stage_is_one_motion_written_by_hand():
    scene, ball = pressed()
    stages = [
        Stage("press", move={ball: (0, 0, -1.0)}, steps=2),
        Stage("twist", move={ball: Motion(x=0.3, rz=0.4, ry=0.1)}, steps=3),
    ]
    staged = solve(scene, stages=stages, **TIGHT).require()
    way = Motion(x=after(0, 0.3), z=after(-1.0, -1.0), rz=after(0, 0.4), ry=after(0, 0.1))
    times = np.concatenate([[0.5, 1.0], 1 + np.arange(1, 4) / 3])
    same(staged, solve(scene, move={ball: way}, steps=times, **TIGHT).require())
    assert staged.column("ball_angle_z_rad")[-1] == pytest.approx(0.4) and abs(staged.column("top_moment_z_Nmm")[-1]) > 1.0


@pytest.mark.parallel
def test_a_turn_about_another_point_than_the_reference_point():
    """The way of the reference point that goes with it makes it the same turn, in a later stage too."""
    c, p, angle = np.array((4.0, 4.0, 8.8)), np.array((3.0, 4.0, 8.8)), 0.5

    def way(i):
        return lambda s: ((rotation(np.array((0, 0, s * angle))) - np.eye(3)) @ (c - p))[i]

    ends = []
    for about, ways in ((p, {}), (c, {"x": way(0), "y": way(1)})):
        scene, ball = pressed()
        stages = [Stage("press", move={ball: Motion(z=-0.3, about=about)}, steps=2),
                  Stage("turn", move={ball: Motion(rz=angle, about=about, **ways)}, steps=3)]  # fmt: skip
        result = solve(scene, stages=stages, **TIGHT).require()
        ends.append([result.column(name)[-1] for name in ("top_force_x_N", "top_force_y_N", "top_friction_work_Nmm")])
    assert np.abs(ends[0]).min() > 1e-3
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-7)


@pytest.mark.parallel
def test_a_function_after_an_arc_of_a_load_that_the_arc_left_alone():
    scene, ball = pressed()
    scene.pressure("xmax", 0.0)
    stages = [Stage("press", move={ball: (0, 0, -0.2)}, steps=ArcSteps(until=Load(1.0))),
              Stage("load", pressures={"xmax": lambda s: 0.01 * s * s}, steps=2)]  # fmt: skip
    numbers = [stages[0], Stage("load", pressures={"xmax": 0.01}, steps=2)]
    ends = [solve(scene, stages=one, **TIGHT).require().column("zmin_reaction_x_N")[-1] for one in (stages, numbers)]
    assert abs(ends[0]) > 1e-3
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)


@pytest.mark.parallel
def test_what_is_free_differs_from_stage_to_stage():
    """Pressed by a force, then rolled while it may turn; the one run may turn from the start, where nothing turns it."""
    scene, ball = pressed()
    stages = [
        Stage("press", push={ball: (0, 0, -3.0)}, steps=2),
        Stage("roll", move={ball: Motion(x=0.4, force=(0, 0, -3.0), free="ry")}, steps=3),
    ]
    staged = solve(scene, stages=stages, **TIGHT).require()
    way = Motion(x=after(0, 0.4), force=lambda t: (0, 0, -3.0 * min(t, 1.0)), free="ry")
    times = np.concatenate([[0.5, 1.0], 1 + np.arange(1, 4) / 3])
    plain = solve(scene, move={ball: way}, steps=times, **TIGHT).require()
    for name in ("ball_travel_z_mm", "ball_angle_y_rad", "top_force_z_N"):
        np.testing.assert_allclose(staged.column(name), plain.column(name), rtol=1e-8, atol=1e-9)
    angle = staged.column("ball_angle_y_rad")
    assert abs(angle[1]) < 1e-9 and angle[-1] > 0.05
    np.testing.assert_allclose(staged.column("top_moment_y_Nmm")[-1], 0.0, atol=1e-8)
    held = solve(scene, stages=[*stages, Stage("hold", move={ball: (0.1, 0, 0)}, steps=1)], **TIGHT).require()
    np.testing.assert_allclose(held.column("ball_angle_y_rad")[-1], angle[-1], rtol=1e-9)
    assert abs(held.column("top_moment_y_Nmm")[-1]) > 1e-3


@pytest.mark.parallel
def test_a_reference_point_is_named_in_the_first_stage_that_turns_at_the_latest(folder):
    """Named later, it moved the loads of the stages before: refused, but its remedies, and the tool's own point, are not."""

    def run(first, then, last, **options):
        scene, ball = pressed()
        stages = [Stage("sink", move={ball: Motion(z=-0.6, rz=0.0, **first)}),
                  Stage("load", move={ball: Motion(force=(0, 0, -5.0), free="ry", **then)}),
                  Stage("back", move={ball: Motion(z=0.1, **last)})]  # fmt: skip
        return solve(scene, stages=stages, steps=1, **options, **TIGHT)

    there, own = {"about": (4.5, 4, 9)}, {"about": (4, 4, 9 + 1e-14)}
    late = "'ball': about = [4.5, 4.0, 9.0] in stage 'back', but not in stage 'load' before it"
    refused(lambda: run({}, {}, there), late)
    ways = [({}, {}, {}), ({}, {}, own), ({}, there, {}), ({}, there, there), (there, {}, {})]
    angles = [run(*way).require().column("ball_angle_y_rad") for way in ways]
    np.testing.assert_allclose(angles[1], angles[0], atol=1e-9)
    np.testing.assert_allclose(angles[3:], [angles[2]] * 2, atol=1e-9)
    assert abs(angles[2][1]) > 0.01 + abs(angles[0][1])
    # added to a run that has turned it, it is refused as well; a run that starts from that one's end may have another one
    scene, ball = pressed()
    turns = Stage("turn", move={ball: Motion(z=-0.6, ry=0.1)}, steps=1)
    later = Stage("later", move={ball: Motion(ry=0.1, **there)}, steps=1)
    kept = Output(folder, checkpoint=True)
    first = solve(scene, stages=[turns], out=kept, **TIGHT).require()
    again = replace(kept, resume=True)
    refused(lambda: solve(scene, stages=[turns, later], out=again, **TIGHT), "in stage 'later', but not in stage 'turn'")
    solve(scene, stages=[later], start=first, **TIGHT).require()


@pytest.mark.parallel
def test_turns_about_several_axes_follow_one_another(folder):
    """Each stage turns what it finds; so does a run that starts from another one, about another point too."""
    scene, ball = pressed(0.0)
    turns = [Stage(name, move={ball: Motion(**{name: 0.6})}, steps=2) for name in ("rx", "rz", "ry")]
    whole = solve(scene, stages=turns, out=Output(folder / "whole", checkpoint=True), **TIGHT).require()
    products = rotation(np.array([0, 0.6, 0])) @ rotation(np.array([0, 0, 0.6])) @ rotation(np.array([0.6, 0, 0]))
    np.testing.assert_allclose(whole.system.state.pose(0).turn, products, atol=1e-14)
    kept = Output(folder / "killed", checkpoint=True)
    with pytest.raises(Killed):
        solve(scene, stages=turns, record=dying(4), out=kept, **TIGHT)
    resumed = solve(scene, stages=turns, record=dying(100), out=replace(kept, resume=True), **TIGHT).require()
    np.testing.assert_allclose(resumed.system.state.pose(0).turn, products, atol=1e-14)
    first = solve(scene, stages=turns[:2], out=Output(folder / "first", checkpoint=True), **TIGHT).require()
    for start in (first, folder / "first"):
        result = solve(scene, move={ball: Motion(about=(4, 4, 4), ry=0.6)}, steps=2, start=start, **TIGHT).require()
        pose = result.system.state.pose(0)
        np.testing.assert_allclose(pose.turn, products, atol=1e-14)
        kept = np.array([[4.0, 4.0, 4.0]])  # where that point of the tool has gone, it stays
        np.testing.assert_allclose(pose.placed(kept), first.system.state.pose(0).placed(kept), atol=1e-12)
    np.testing.assert_allclose(result.column("ball_angle_z_rad"), 0.6, atol=1e-14)


@pytest.mark.parallel
def test_the_work_of_turns_one_after_another_is_counted():
    """Rotations count from where their stage begins: at that corner too the error is the trapezoidal rule's."""
    mesh, left = read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), []
    for n in (2, 4):
        scene, hub = Scene(Body(mesh, "box", LAW)), rigid_hub("hub", (1, 1, 2.0))
        scene.fix("zmin")
        scene.tie("zmax", hub)
        ways = {"bend": Motion(rx=0.5, x=0.2), "twist": Motion(rz=0.6, ry=0.3)}
        result = solve(scene, stages=[Stage(name, move={hub: way}) for name, way in ways.items()], steps=n, **TIGHT)
        error = {name: result.require().column("energy_error_Nmm", name)[-1] for name in ways}
        left.append(abs(error["twist"] - error["bend"]))
    assert left[0] / left[1] > 3.8 and left[1] < 1e-3 * result.column("external_work_Nmm")[-1], left


@pytest.mark.parallel
def test_all_kinds_of_loads_through_two_stages():
    """Restated in the second one, held, or a function of places there; the swelling is none of a stage's business."""
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 3.0), cells=(2, 2, 3))
    half = lambda X, t: 0.01 * np.minimum(t, 1.0) * X[:, 2]  # noqa: E731

    def scene(by_hand):
        stated = Scene(Body(mesh, "box", LAW))
        stated.fix("zmin")
        stated.moment("zmax", (lambda t: (0, 0.1 * min(t, 1.0), 0)) if by_hand else (0, 0, 0))
        stated.spin(after(0, 0.2) if by_hand else 0.0, 1.0, point=(1.0, 1.0, 0.0))
        stated.swell("box", (lambda t: 1.0 + 0.1 * min(t, 1.0)) if by_hand else 1.1)
        stated.force("xmax", (lambda t: (after(0.05, -0.05)(t), 0, 0)) if by_hand else (0.05, 0, 0))
        stated.pressure("ymax", half)
        late = lambda X, t: np.outer(max(t - 1.0, 0.0) * X[:, 0], (0, 0.01, 0))  # noqa: E731
        stated.traction("ymin", late if by_hand else (0, 0, 0))
        return stated

    stages = [
        Stage("bend", moments={"zmax": (0, 0.1, 0)}),
        Stage("turn", spin=0.2, forces={"xmax": lambda s: (0.05 - 0.1 * s, 0, 0)},
              tractions={"ymin": lambda X, s: np.outer(s * X[:, 0], (0, 0.01, 0))}),
    ]  # fmt: skip
    plain = solve(scene(True), steps=[0.5, 1, 1.5, 2], **TIGHT).require()
    same(solve(scene(False), stages=stages, steps=2, **TIGHT).require(), plain)
    let = Stage("let", swell={"box": 1.0}, pressures={"ymax": 0.0}, moments={"zmax": (0, 0, 0)}, spin=0.0,
                forces={"xmax": (0, 0, 0)}, tractions={"ymin": (0, 0, 0)})  # fmt: skip
    back = solve(scene(False), stages=[*stages, let], steps=2, **TIGHT).require()
    assert max(COMM.allgather(np.abs(back.u.x.array).max())) < 1e-9  # mm: all is at rest again


@pytest.mark.parallel
def test_a_fluid_through_two_stages():
    """Squeezed on a plane, then the fluid at its side comes in beneath and goes back."""
    mesh = read_gmsh(box.build, size=(4.0, 0.5, 1.0), cells=(6, 1, 2))

    def scene(p, z):
        stated = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
        for group, axis in (("xmin", "x"), ("ymin", "y"), ("ymax", "y")):
            stated.fix(group, axis)
        stated.prescribe("zmax", "z", z)
        stated.contact("zmin", rigid_plane(), name="floor")
        stated.pressure(("zmin", "xmax"), p, where="open", from_="xmax")
        return stated

    by_hand = scene(lambda t: 1.5 * np.interp(t, (0, 1, 2, 3), (0, 0, 1, 0.5)), lambda X, t: -0.1 * min(t, 1.0))
    plain = solve(by_hand, steps=np.concatenate([[0.5, 1.0], 1 + np.arange(1, 11) / 5]), **TIGHT).require()
    stages = [
        Stage("squeeze", steps=2),
        Stage("press", pressures={("zmin", "xmax"): 1.5}, steps=5),
        Stage("less", pressures={("zmin", "xmax"): lambda s: 1.5 - 0.75 * s}, steps=5),
    ]
    same(solve(scene(0.0, -0.1), stages=stages, **TIGHT).require(), plain)
    sides = [plain.column("floor_force_z_N")[i] for i in (1, 6, 11)]
    assert sides[0] > 2 * sides[1] >= 0.0, sides  # it has come in
    refused(lambda: solve(scene(0.0, -0.1), stages=[stages[0], Stage("pull", pressures={("zmin", "xmax"): -1.0})], **TIGHT),
            "must not be negative")  # fmt: skip


@pytest.mark.parallel
def test_a_turned_support_through_two_stages():
    """A block turned in space, its lid moved along its normal, then back along the opposite direction, and a side too."""
    mesh = read_gmsh(placed, Q=TURN, size=(2.0, 2.0, 1.0), cells=(2, 2, 2))

    def scene(lid, side):
        stated = Scene(Body(mesh, "box", LAW))
        for group in ("xmin", "ymin", "zmin"):
            stated.fix(group, normal=True)
        for group, value in (("zmax", lid), ("ymax", side)):
            stated.fix(group, normal=True) if value is None else stated.prescribe(group, None, value, normal=True)
        return stated

    stages = [
        Stage("press", prescribe={("zmax", "normal"): -0.2}),
        Stage("pull", prescribe={("zmax", tuple(-TURN[:, 2])): -0.1, ("ymax", "y"): lambda X, s: 0.1 * s}),
    ]
    plain = scene(lambda X, t: after(-0.2, -0.1)(t), lambda X, t: after(0.0, 0.1)(t))
    staged = solve(scene(None, None), stages=stages, steps=2, **TIGHT).require()
    same(staged, solve(plain, steps=[0.5, 1.0, 1.5, 2.0], **TIGHT).require())
    lid = lambda result: np.linalg.norm([result.history[-1][f"zmax_reaction_{a}_N"] for a in "xyz"])  # noqa: E731
    # a run from the end of the first stage, where the scene says of the lid what it said there
    first = solve(scene(None, None), stages=stages[:1], steps=2, **TIGHT).require()
    later = solve(scene(None, None), stages=stages[1:], steps=2, start=first, **TIGHT).require()
    np.testing.assert_allclose(lid(later), lid(staged), rtol=1e-9)
    for key, *words in ((("zmax", "x"), "stage 'a'", "'zmax' along x", "scene.fix"),
                        (("zmax", (0.0, 0.0, 0.0)), "no length"), (("nowhere", "normal"), "normal=True")):  # fmt: skip
        refused(lambda key=key: solve(scene(None, None), stages=[Stage("a", prescribe={key: 0.1})]), *words)
    twice = {("zmax", "normal"): 0.1, ("zmax", tuple(TURN[:, 2])): 0.1}
    refused(lambda: solve(scene(None, None), stages=[Stage("a", prescribe=twice)]), "named", "already")


# -- force and displacement in turn -----------------------------------------------------------------------------------
@pytest.mark.parallel
def test_force_after_displacement_goes_on_from_the_force_reached():
    scene, ball = pressed()
    deep = solve(scene, move={ball: (0, 0, -1.2)}, steps=6, **TIGHT).require().history[-1]["top_force_z_N"]
    stages = [
        Stage("press", move={ball: (0, 0, -1.0)}, steps=5),
        Stage("push", push={ball: (0, 0, deep)}, steps=5),
        Stage("lift", move={ball: (0, 0, 0.4)}, steps=2),
    ]
    result = solve(scene, stages=stages, **TIGHT).require()
    force, travel = result.column("top_force_z_N"), result.column("ball_travel_z_mm")
    np.testing.assert_allclose(force[4:10], np.linspace(force[4], deep, 6), rtol=1e-9)  # no jump: steps of one size
    np.testing.assert_allclose(travel[9], -1.2, atol=1e-5)  # friction's history differs by the steps' ends
    np.testing.assert_allclose(travel[10:], travel[9] + np.array([0.2, 0.4]), atol=1e-12)


@pytest.mark.parallel
def test_what_was_pushed_stays_pushed_and_can_be_let_go():
    scene, ball = pressed()
    stages = [
        Stage("push", push={ball: (0, 0, -3.0)}, steps=3),
        Stage("drag", move={ball: (0.1, 0, 0)}, steps=1),
        Stage("less", push={ball: lambda s: (0, 0, -3.0 + 2 * s)}, steps=2),
    ]
    refused(
        lambda: solve(scene, stages=stages, **TIGHT), "stage 'less'", "force on 'ball'", "known only there", "as numbers"
    )
    result = solve(scene, stages=[stages[0], stages[2]], **TIGHT).require()
    np.testing.assert_allclose(result.column("top_force_z_N"), [-1, -2, -3, -2, -1], rtol=1e-8)


# -- loads taken back to zero -----------------------------------------------------------------------------------------
def under_a_lid():
    """A block in plane strain under a rigid plane, with friction."""
    mesh = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (10.0, 4.0), (5, 2))})
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 3.0)), plane="strain")
    scene.fix("box_ymin")
    lid = rigid_plane((0, 4, 0), (0, -1, 0), name="lid")
    scene.contact("box_ymax", lid, 0.3, name="top")
    return scene, lid, Stage("touch", move={lid: (0, -0.1, 0)}, steps=1)


def under_a_ball():
    scene, ball = pressed()
    return scene, ball, Stage("touch", move={ball: (0, 0, -0.6)}, steps=1)


TAKEN_BACK = {  # each stage's force; where it is zero the tool is free as before
    "plane": (under_a_lid, [(0.5, -3.0, 0), (0, -3.0, 0), (0, -1.0, 0)]),
    "space": (under_a_ball, [(0.4, 0.2, -3.0), (0, 0.2, -3.0), (0, 0, -2.0)]),
}


@pytest.mark.parallel
@pytest.mark.parametrize("where", TAKEN_BACK)
def test_a_force_taken_back_by_a_motion_is_that_taken_back_by_push(where, folder):
    """In one run, in one that starts from where the force acts, and in one resumed there."""
    build, forces = TAKEN_BACK[where]
    scene, tool, touch = build()
    names = ["load", "shear off", "less"]
    pushed = [Stage(name, push={tool: force}, steps=2) for name, force in zip(names, forces, strict=True)]
    moved = [Stage(name, move={tool: Motion(force=force)}, steps=2) for name, force in zip(names, forces, strict=True)]
    whole = solve(scene, stages=[touch, *pushed], **TIGHT).require()
    one = solve(scene, stages=[touch, *moved], **TIGHT).require()
    same(one, whole)
    for name, force in zip(names, forces, strict=True):
        for axis, of in zip("xyz", force, strict=True):
            if (column := f"top_force_{axis}_N") in one.history[0]:
                np.testing.assert_allclose(one.column(column, name)[-1], of, atol=1e-8)
    first = solve(scene, stages=[touch, moved[0]], out=Output(folder, checkpoint=True), **TIGHT).require()
    for start in (first, folder):
        assert goes_on(solve(scene, stages=moved[1:], start=start, **TIGHT).require(), whole)
    resumed = solve(scene, stages=[touch, *moved], out=Output(folder, checkpoint=True, resume=True), **TIGHT).require()
    same(resumed, whole, 1e-8)


def bent():
    """A strip in plane strain on a hub that may turn, its other end on springs."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((-5.0, -0.5), (10.0, 1.0), (8, 1))})
    scene, hub = Scene(Body(mesh, "strip", LAW), plane="strain"), rigid_hub("hub", (-5, 0, 0))
    scene.tie("strip_xmin", hub)
    scene.spring("strip_xmax", 0.01, direction=(0, 1, 0))
    return scene, hub, (0, 0, 0.02), "rz"


def twisted():
    """A block whose top is tied to a hub that may turn about all axes."""
    scene, hub = Scene(Body(block(), "box", LAW)), rigid_hub("hub", (4, 4, 4.0))
    scene.fix("zmin")
    scene.tie("zmax", hub)
    return scene, hub, (0.5, 1.0, 2.0), "rx ry rz"


@pytest.mark.parallel
@pytest.mark.parametrize("build", [bent, twisted])
def test_a_moment_taken_back_is_that_of_a_hub_that_is_said_to_be_free(build, folder):
    scene, hub, moment, free = build()
    on = Stage("on", move={hub: Motion(moment=moment)}, steps=2)
    named = Stage("off", move={hub: Motion(moment=(0, 0, 0), free=free)}, steps=2)
    off = Stage("off", move={hub: Motion(moment=(0, 0, 0))}, steps=2)
    whole, one = (solve(scene, stages=[on, last], **TIGHT).require() for last in (named, off))
    same(one, whole)
    assert abs(one.column("hub_angle_z_rad", "on")[-1]) > 1e-3
    assert max(abs(one.history[-1][f"hub_moment_{axis[1]}_Nmm"]) for axis in free.split()) < 1e-8
    first = solve(scene, stages=[on], out=Output(folder, checkpoint=True), **TIGHT).require()
    for start in (first, folder):
        assert goes_on(solve(scene, stages=[off], start=start, **TIGHT).require(), whole)


@pytest.mark.parallel
def test_a_force_of_zero_on_what_is_held_or_moved():
    """What was held stays so, and so does what the motion itself names; where a stage states nothing else it is refused."""
    scene, ball = pressed()
    press, pushed = Stage("press", move={ball: (0, 0, -0.6)}, steps=1), Stage("push", push={ball: (0, 0, -3.0)}, steps=1)
    aside = Stage("aside", move={ball: Motion(x=0.2, z=0.0, force=(0, 0, 0))}, steps=1)
    result = solve(scene, stages=[press, pushed, aside], **TIGHT).require()
    z = result.column("ball_travel_z_mm")
    np.testing.assert_allclose([result.column("ball_travel_x_mm")[-1], z[-1]], [0.2, z[-2]], atol=1e-12)
    assert result.column("top_force_z_N")[-1] < -1.0
    off = Stage("off", move={ball: Motion(force=(0, 0, 0))}, steps=2)
    result = solve(scene, stages=[press, pushed, off], **TIGHT).require()
    np.testing.assert_allclose(result.column("top_force_z_N", "off"), [-1.5, 0.0], atol=1e-6)


# -- arc length as a stage --------------------------------------------------------------------------------------------
def faces(tension):
    return {f"{a}max": tension * np.eye(3)[i] * (1 + BIAS if a == "x" else 1.0) for i, a in enumerate("xyz")}


def on_the_branch(dead):
    """Stretch along y of the flat cube under a dead tension."""
    return brentq(lambda wide: tension(wide) - dead, 1.5, 2.5)


def cube_in_stages():
    return [
        Stage("load", tractions=faces(1.5), steps=3),
        Stage("past the limits", tractions=faces(2.5), duration=2.0,
              steps=ArcSteps(until=Displacement("ymax", "y", 0.8), first=0.1, largest=0.1)),
        Stage("more", tractions=faces(2.2), steps=2),
    ]  # fmt: skip


@pytest.mark.parallel
def test_arc_length_goes_on_where_load_steps_end_and_they_where_it_ends(folder):
    result = solve(cube(), stages=cube_in_stages(), out=folder / "whole", **TIGHT).require()
    assert result.verdict.reason == "converged"  # and not the target that the arcs have reached
    t, stage = result.column("t"), result.column("stage")
    dead = lambda t: 1.5 + 0.5 * (t - 1)  # noqa: E731 - from 1.5 to 2.5 over a duration of 2
    points = result.summary["limit_points"]
    assert [p["kind"][:3] for p in points] == ["max", "min"]
    np.testing.assert_allclose([dead(p["t"]) for p in points], exact_folds(), rtol=1e-6)
    end = t[stage == "past the limits"][-1]
    np.testing.assert_allclose(dead(end), tension(1.8), rtol=1e-5)
    np.testing.assert_allclose(t[stage == "more"], end + np.array([0.5, 1.0]), rtol=1e-12)
    mean = Displacement("ymax", "y", 0.0).distance(result.scene, result.system)
    np.testing.assert_allclose(mean(), on_the_branch(2.2) - 1, rtol=1e-6)


@pytest.mark.parallel
def test_a_load_target_of_a_stage_is_its_own_s():
    scene, ball = pressed()
    stages = [
        Stage("press", move={ball: (0, 0, -0.5)}, steps=2),
        Stage("follow", move={ball: (0.2, 0, 0)}, steps=ArcSteps(until=Load(1.0), back=Travel(ball, "x", 0.1), first=0.25)),
    ]
    result = solve(scene, stages=stages, **TIGHT).require()
    np.testing.assert_allclose([result.column("t").max(), result.column("t")[-1]], [2.0, 1.5], atol=2e-6)


# -- resumed ----------------------------------------------------------------------------------------------------------
class Killed(BaseException):
    """Of a run in the middle."""


def dying(step):
    """A column whose function ends the run in a step."""

    def count(view):
        count.seen += 1
        if count.seen == step:
            raise Killed
        return 1.0

    count.seen = 0
    return {"one": count}


def pushed_in_stages(out, last=100, resume=False):
    scene, ball = pressed()
    stages = [
        Stage("press", move={ball: (0, 0, -1.0)}, steps=2),
        Stage("push", push={ball: (1.0, 0, -6.0)}, steps=3),
        Stage("follow", push={ball: (2.0, 0, -7.0)}, steps=ArcSteps(until=Load(1.0), first=1 / 3)),
        Stage("lift", move={ball: (0, 0, 1.0)}, steps=2),
    ]
    kept = out and Output(out, checkpoint=True, resume=resume)
    return solve(scene, stages=stages, out=kept, record=dying(last), **TIGHT)


@cache
def pushed_at_once():
    return pushed_in_stages(None).require()


STOPS = (2, 4, 7)  # steps that are not accepted any more: at a stage's end, within one of load steps, within one of arcs


@pytest.mark.parallel
@pytest.mark.parametrize("stop", STOPS)
def test_a_run_resumed_in_a_stage_equals_a_continuous_one(folder, stop):
    whole = pushed_at_once()
    assert stop < len(whole.history)
    with pytest.raises(Killed):
        pushed_in_stages(folder / "parts", stop + 1)
    resumed = pushed_in_stages(folder / "parts", resume=True).require()
    assert list(resumed.column("stage")) == list(whole.column("stage"))
    same(resumed, whole, 1e-8)  # Newton's last iterations start elsewhere; steps end at 1e-11 of the force


@pytest.mark.slow
@pytest.mark.serial
def test_resumed_on_two_ranks_in_a_stage(tmp_path):
    with pytest.raises(Killed):
        pushed_in_stages(tmp_path, 5)
    command = [*mpirun(2), sys.executable, __file__, tmp_path]
    done = subprocess.run(command, env=alone(), cwd=ROOT, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr[-2000:]
    assert apart(json.loads(done.stdout.strip().splitlines()[-1]), figures(pushed_at_once())) < 1e-8


def figures(result):
    return {key: values for key, values in numbers(result).items() if key != "stage"}


@pytest.mark.parallel
@pytest.mark.parametrize("every", [2, 20])
def test_a_folder_has_the_last_state_however_rarely_it_is_written(every, folder):
    """Of a run that has come to its end, and of one that could not go on."""
    scene, ball = pressed()
    press, drag, _ = press_drag_lift(ball, (3, 2, 1))
    through = Stage("through", move={ball: (0, 0, -1e3)}, steps=1)  # the block
    whole = solve(scene, stages=[press, drag], **TIGHT).require()
    kept = Output(folder, checkpoint=every, overwrite=True)
    for ends in ([press], [press, through]):
        before = solve(scene, stages=ends, out=kept, method=replace(CLOSE, smallest_step=0.5))
        assert len(before.history) == 3 and before.converged is (len(ends) == 1)
        assert goes_on(solve(scene, stages=[drag], start=folder, **TIGHT).require(), whole)
    resumed = solve(scene, stages=[press, drag], out=replace(kept, overwrite=False, resume=True), **TIGHT).require()
    same(resumed, whole, 1e-8)


@pytest.mark.parallel
def test_a_folder_has_the_end_of_arcs_whose_next_stage_fails_at_once(folder):
    """Arcs end at any t, before or behind the full length of their stage."""
    scene, ball = pressed()
    follow = Stage("follow", move={ball: (0, 0, -1.0)}, steps=ArcSteps(until=Travel(ball, "z", -0.5), first=0.3))
    through = Stage("through", move={ball: (0, 0, -1e3)}, steps=1)  # the block
    before = solve(
        scene, stages=[follow, through], out=Output(folder, checkpoint=20), method=replace(CLOSE, smallest_step=0.5)
    )
    assert not before.converged and len(before.history) > 1
    np.testing.assert_allclose(last_state(folder, COMM).tools["ball"].q[2], -0.5, rtol=1e-5)


@pytest.mark.parallel
def test_stages_to_come_may_be_changed_those_behind_not(folder):
    scene, ball = pressed()
    first, second, third = press_drag_lift(ball, (1, 1, 1))
    kept = Output(folder, checkpoint=True)
    solve(scene, stages=[first, second], out=kept, **TIGHT).require()
    on = {"out": replace(kept, resume=True), **TIGHT}
    result = solve(scene, stages=[first, second, third], **on).require()
    assert list(dict.fromkeys(result.column("stage"))) == ["press", "drag", "lift"]
    other = Stage("drag", move={ball: (1.0, 0, 0)}, steps=1)
    refused(lambda: solve(scene, stages=[first, other, third], **on), "stage 'drag': move of 'ball'")
    refused(lambda: solve(scene, stages=[first], **on), "another scene", "stage 'drag'")
    refused(lambda: solve(scene, move={ball: (0, 0, -1)}, steps=1, **on), "another scene")


def with_a_stage(last, out=None):
    """A ball pressed in and, by a stage that may come later, dragged, turned or followed by arc length."""
    scene, ball = pressed()
    ways = {
        "turn": Stage("turn", move={ball: Motion(rz=0.2)}, steps=1),
        "free": Stage("free", move={ball: Motion(force=(0, 0, -6.0), moment=(0, 0, 0.1), free="rz")}, steps=1),
        "arc": Stage("arc", push={ball: (0.3, 0, -6.0)}, steps=ArcSteps(until=Load(1.0), first=1)),
    }
    stages = [Stage("press", move={ball: (0, 0, -0.6)}, steps=1), *([ways[last]] if last else [])]
    record = {"tilt": lambda view: 1.0}
    return solve(scene, stages=stages, record=record, out=out and Output(out, checkpoint=True, resume=True), **TIGHT)


@pytest.mark.parallel
@pytest.mark.parametrize("last", ["turn", "free", "arc"])
def test_a_stage_added_on_restart_brings_its_columns(folder, last):
    with_a_stage(None, folder).require()
    resumed, whole = with_a_stage(last, folder).require(), with_a_stage(last).require()
    assert list(resumed.history[0]) == list(resumed.history[1]) == list(whole.history[0])
    same(resumed, whole, 1e-8)
    if COMM.rank == 0:
        head, *rows = (folder / "history.csv").read_text().splitlines()
        assert head.split(",") == list(whole.history[0]) and len(rows) == 2
    again = with_a_stage(last, folder).require()  # a run that is through goes on from its end: nothing is left to do
    assert len(again.history) == 2


@pytest.mark.parallel
def test_a_stage_left_out_on_restart_takes_its_columns_along(folder):
    scene, ball = pressed()
    press = Stage("press", move={ball: (0, 0, -0.6)}, steps=1)
    turn = Stage("turn", move={ball: Motion(rz=0.2)}, steps=1)
    with pytest.raises(Killed):
        solve(scene, stages=[press, turn], record=dying(2), out=Output(folder, checkpoint=True), **TIGHT)
    drag = Stage("drag", move={ball: (0.2, 0, 0)}, steps=1)
    resumed = solve(scene, stages=[press, drag], record=dying(9), out=Output(folder, resume=True), **TIGHT).require()
    assert len(resumed.table()["t"]) == 2 and "ball_angle_z_rad" not in resumed.history[0]


@pytest.mark.parallel
def test_a_stage_that_was_not_reached_is_told_from_one_that_is_not_stated(folder):
    scene, ball = pressed()
    out = Stage("out", move={ball: lambda s: (0, 0, -1e3 * s)}, steps=1)  # through the block
    stages = [Stage("press", move={ball: (0, 0, -0.2)}, steps=1), out]
    result = solve(scene, stages=stages, method=replace(CLOSE, smallest_step=0.5))
    assert not result.converged
    with pytest.raises(KeyError, match="stage 'out' has no accepted step, the history has: press; the run has ended: "):
        result.column("t", "out")


# -- started from another run -----------------------------------------------------------------------------------------
def goes_on(result, whole):
    """Whether a run that starts from another one has given what the last stages of one run of both did."""
    skip = (
        "step",
        "t",
        "stage",
        "seconds",
        "residual",
        "iterations",
        "external_work_Nmm",
        "work_done_Nmm",
        "energy_error_Nmm",
    )
    names = [
        name
        for name in whole.history[0]
        if name not in skip and not name.endswith(("friction_work_Nmm", "normal_work_error_Nmm"))
    ]
    steps = len(result.history)
    return apart(*({name: one.column(name)[-steps:] for name in names} for one in (result, whole))) < 1e-9


@pytest.mark.parallel
@pytest.mark.parametrize("way", ["result", "folder"])
def test_a_run_started_from_another_equals_one_run_of_both(way, folder):
    """History of friction, pushed tools, loads that stay: as in stages of one run."""
    scene, ball = pressed()
    scene.pressure("xmax", 0.01)
    press = Stage("press", push={ball: (0, 0, -5)}, steps=2)
    later = [Stage("drag", move={ball: (1.0, 0, 0)}, steps=2), Stage("push", push={ball: (0, 0, -6)}, steps=2)]
    whole = solve(scene, stages=[press, *later], **TIGHT).require()
    first = solve(scene, stages=[press], out=Output(folder / "first", checkpoint=True), **TIGHT).require()
    start = first if way == "result" else folder / "first"
    result = solve(scene, stages=later, start=start, **TIGHT).require()
    assert goes_on(result, whole)
    assert not [note for note in result.verdict.notes if "without a history" in note]
    np.testing.assert_allclose(result.column("t"), [0.5, 1, 1.5, 2])
    error = whole.column("energy_error_Nmm")[-1] - whole.column("energy_error_Nmm", "press")[-1]
    np.testing.assert_allclose(result.column("energy_error_Nmm")[-1], error, rtol=1e-6)


def beside():
    """A block under one ball and beside another."""
    scene, ball = pressed()
    side = rigid_sphere(5.0, (13.0, 4.0, 2.0), name="side")
    scene.contact("xmax", side, 0.3, name="flank")
    return scene, ball, side


FORCE = np.array((0.0, 0.0, -5.0))
PUSHED = {
    "push": {"push": FORCE},
    "force": {"move": Motion(x=0.5, force=FORCE)},
    "one turn": {"move": Motion(about=(4, 4, 5), force=FORCE, moment=(0, 2.0, 0))},
    "all turns": {"move": Motion(force=FORCE, moment=(0, 2.0, 0), free="rx rz")},
}


@pytest.mark.parallel
@pytest.mark.parametrize("what", PUSHED)
def test_a_tool_that_another_run_has_pushed_stays_so_until_it_is_named(what, folder):
    """What is free there is free here, whether in the first stage, all along, or when a force is then stated anew."""
    scene, ball, side = beside()
    load = {word: {ball: of} for word, of in PUSHED[what].items()}
    first = [Stage("sink", move={ball: (0, 0, -0.6)}), Stage("load", **load)]
    later = [Stage("flank", move={side: (-0.4, 0, 0)}), Stage("more", push={ball: lambda s: (1 + 0.2 * s) * FORCE})]
    run = {"steps": 2, **TIGHT}
    whole = solve(scene, stages=first + later, **run).require()
    start = solve(scene, stages=first, out=Output(folder, checkpoint=True), **run).require()
    error = whole.column("energy_error_Nmm")
    for one in (start, folder):
        result = solve(scene, stages=later, start=one, **run).require()
        assert goes_on(result, whole) and list(result.history[0]) == list(whole.history[0])
        np.testing.assert_allclose(result.column("energy_error_Nmm")[-1], error[-1] - error[-5], rtol=1e-6)
    force = solve(scene, move={side: (-0.4, 0, 0)}, start=start, **run).require().column("top_force_z_N")
    np.testing.assert_allclose(force, -5.0, rtol=1e-8)
    jumps = [later[0], Stage("jumps", push={ball: lambda s: (0, 0, -4.0 - s)})]
    refused(lambda: solve(scene, stages=jumps, start=start, **run), "stage 'jumps': the force on 'ball'", "z -5")


@pytest.mark.parallel
def test_a_hub_that_another_run_has_pushed_keeps_its_force(folder):
    """Also where springs hold it and the material is another one, which would take another force to hold it."""

    def scene(stiffer=1.0):
        stated, hub = Scene(Body(block(), "box", neo_hooke(0.4 * stiffer, 2.0 * stiffer))), rigid_hub("hub", (4, 4, 4.0))
        stated.fix("zmin")
        stated.tie("zmax", hub)
        stated.spring("xmin", 3.0)
        stated.pressure("xmax", 0.0)
        return stated, hub

    stated, hub = scene()
    pushed = Stage("push", move={hub: Motion(force=(1.0, 0, -3.0), moment=(0, 0.5, 0), free="rx rz")})
    later = Stage("press", pressures={"xmax": 0.02})
    run = {"steps": 2, **TIGHT}
    whole = solve(stated, stages=[pushed, later], **run).require()
    first = solve(stated, stages=[pushed], out=Output(folder, checkpoint=True), **run).require()
    for start in (first, folder):
        assert goes_on(solve(stated, stages=[later], start=start, **run).require(), whole)
    stiffer, its = scene(2.0)
    result = solve(stiffer, stages=[later], start=first, **run).require()
    direct = solve(stiffer, stages=[Stage("both", move={its: pushed.move[hub]}, pressures=later.pressures)], **run).require()
    for name in ("hub_force_x_N", "hub_force_z_N", "hub_travel_x_mm", "hub_travel_z_mm", "hub_angle_y_rad"):
        np.testing.assert_allclose(result.column(name)[-1], direct.column(name)[-1], rtol=1e-8)


@pytest.mark.parallel
def test_a_tool_that_turns_freely_keeps_the_point_about_which_it_does(folder, monkeypatch):
    """A dead force acts there: about another one the same moment would not go on. Nor is it known of older checkpoints."""
    scene, ball, side = beside()
    turned = {ball: Motion(about=(4, 4, 5), z=-0.6, moment=(0, 2.0, 0))}
    first = solve(scene, move=turned, steps=1, **TIGHT).require()
    away = Stage("away", move={ball: Motion(about=(4, 4, 9), ry=0.1)}, steps=1)
    later = [Stage("flank", move={side: (-0.4, 0, 0)}, steps=1), away]
    refused(lambda: solve(scene, stages=later, start=first, **TIGHT), "'ball' turns freely about [4.0, 4.0, 5.0]", "about=")
    solve(scene, stages=[away], start=first, **TIGHT).require()

    def older(*state):
        left = drives_left(*state)
        return left | {"tools": {name: tool[:4] for name, tool in left["tools"].items()}}

    monkeypatch.setattr("fenics_contact.run.drives_left", older)
    solve(scene, move=turned, steps=1, out=Output(folder, checkpoint=True), **TIGHT).require()
    refused(lambda: solve(scene, stages=later, start=folder, **TIGHT), "older version", "run it again")


@pytest.mark.parallel
def test_loads_of_another_run_stay_or_go_to_what_is_stated_anew(folder):
    def scene(pressure, z):
        stated = Scene(Body(block(), "box", LAW))
        stated.fix("zmin")
        stated.prescribe("zmax", "z", z)
        stated.pressure("xmax", pressure)
        stated.pressure("xmax", 0.01)
        return stated

    first = solve(scene(0.02, -0.2), steps=2, **TIGHT).require()
    force = lambda result: result.column("zmax_reaction_z_N")  # noqa: E731
    same = solve(scene(0.02, -0.2), stages=[Stage("x", pressures={})], steps=1, start=first, **TIGHT).require()
    np.testing.assert_allclose(force(same), force(first)[-1], rtol=1e-9)
    other = solve(scene(0.03, -0.3), steps=2, start=first, **TIGHT).require()
    direct = solve(scene(0.03, -0.3), steps=2, **TIGHT).require()
    np.testing.assert_allclose(force(other)[-1], force(direct)[-1], rtol=1e-9)
    assert 0.3 < (force(other)[0] - force(first)[-1]) / (force(other)[-1] - force(first)[-1]) < 0.7


def sheared(lid=True, held=True, friction=0.4, stiffness=3.0):
    """A block that a rough lid has pressed and sheared, its sides on springs: scene and lid."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((0.0, 0.0), (3.0, 2.0), (6, 4))})
    scene = Scene(Body(mesh, "b", LAW), plane="strain")
    scene.fix("b_ymin")
    if held:
        scene.fix("b_xmin", "x")
    if stiffness:
        scene.spring("b_xmax", stiffness, direction=(1, 0, 0))
    tool = rigid_plane((0, 2, 0), normal=(0, -1, 0), name="lid" if lid else "other")
    scene.contact("b_ymax", tool, friction, name="top" if lid else "new")
    return scene, tool


DIFFERENT = [
    ({"held": False}, "support of b_xmin along x is not stated"),
    ({"lid": False}, "tool 'lid' is not stated; contact 'top' is not stated"),
    ({"friction": 0.0}, "contact 'top', friction is 0.0 and was 0.4"),
    ({"stiffness": 9.0}, "spring 1 on b_xmax is 9.0 and was 3.0"),
    ({"stiffness": 0.0}, "spring 1 on b_xmax is not stated"),
]


@pytest.mark.parallel
@pytest.mark.parametrize("steps", [2, 8])
@pytest.mark.parametrize(("change", "words"), DIFFERENT, ids=[next(iter(change)) for change, _ in DIFFERENT])
def test_what_another_scene_lets_go_at_once_is_named_and_no_steps_are_asked_for(change, words, steps):
    scene, lid = sheared()
    stages = [Stage("press", move={lid: (0, -0.3, 0)}, steps=2), Stage("shear", move={lid: (0.3, 0, 0)}, steps=3)]
    first = solve(scene, stages=stages).require()
    scene, lid = sheared(**change)
    rest = [Stage("rest", move={lid: (0, -1e-6, 0)}, steps=steps)]
    notes = solve(scene, stages=rest, start=first).require().verdict.notes
    (jump,) = (note for note in notes if "out of balance in this scene" in note)
    assert f"({words})" in jump, jump
    assert not any("take more steps" in note for note in notes), notes
    assert any("100% of that in step 1, which starts out of balance" in note for note in notes), notes
    scene, lid = sheared()
    same = solve(scene, stages=[Stage("rest", move={lid: (0, -1e-6, 0)}, steps=2)], start=first).require()
    assert not any("out of balance" in note for note in same.verdict.notes), same.verdict.notes


@pytest.mark.parallel
def test_a_turn_taken_over_is_none_of_the_first_step():
    """A rough roller has turned by a turn and more; then it is lifted."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((-2.0, -1.0), (4.0, 1.0), (8, 2))})
    scene = Scene(Body(mesh, "b", LAW), plane="strain")
    scene.fix("b_ymin")
    roller = rigid_cylinder(1.5, (0, 1.5, 0), (0, 0, 1), name="roller")
    scene.contact("b_ymax", roller, 0.3, name="c")
    stages = [Stage("press", move={roller: (0, -0.3, 0)}, steps=3), Stage("spin", move={roller: Motion(rz=7.0)}, steps=4)]
    first = solve(scene, stages=stages).require()
    turned = {"roller": np.array([0.0, 0.0, 7.0])}
    on = solve(scene, stages=[Stage("on", move={roller: Motion(rz=3.0)}, steps=4)], start=first).require()
    assert widest_turn(on.history, scene.units, turned) == pytest.approx(0.75)  # arcs leave as much in each of these
    result = solve(scene, stages=[Stage("lift", move={roller: (0, 0.3, 0)}, steps=2)], start=first).require()
    np.testing.assert_allclose(result.column("roller_angle_z_rad"), 7.0, rtol=1e-12)
    assert widest_turn(result.history, scene.units, turned) == 0.0


@pytest.mark.parallel
def test_a_turned_tool_and_loads_that_differ_from_place_to_place_are_taken_over(folder):
    """As in stages of one run, the forces and the moment that hold the ball too; then nothing but numbers is known of it."""

    def scene(load):
        stated, ball = pressed()
        stated.pressure("xmax", load)
        return stated, ball

    stated, ball = scene(lambda X, t: 0.01 * t * X[:, 2])
    stages = [
        Stage("twist", move={ball: Motion(z=-0.8, rz=0.2)}, steps=2),
        Stage("push", move={ball: Motion(rz=0.1, force=(0, 0, -4.0))}, steps=1),
        Stage("let", move={ball: Motion(force=(0, 0, -4.0), free="rz")}, pressures={"xmax": 0.02}, steps=2),
    ]
    whole = solve(stated, stages=stages, **TIGHT).require()
    solve(stated, stages=stages[:2], out=Output(folder / "first", checkpoint=True), **TIGHT).require()
    result = solve(stated, stages=stages[2:], start=folder / "first", **TIGHT).require()
    assert goes_on(result, whole)
    before, moment = whole.column("top_moment_z_Nmm", "push")[-1], whole.column("top_moment_z_Nmm", "let")
    np.testing.assert_allclose(moment, before * (3.0 - whole.column("t", "let")), rtol=1e-7, atol=1e-9)  # it is let go
    other, its = scene(0.01)
    start = {"start": folder / "first", **TIGHT}
    refused(lambda: solve(other, move={its: (0, 0, -0.1)}, **start), "pressure on 'xmax'", "value(X, t)")
    jumps = Stage("jumps", push={ball: lambda s: (0, 0, -5.0)})
    refused(lambda: solve(stated, stages=[jumps], **start), "stage 'jumps': push of 'ball' starts 1 away")


@pytest.mark.parallel
def test_a_start_that_does_not_fit_is_refused(folder):
    scene, ball = pressed()
    first = solve(scene, move={ball: (0, 0, -0.2)}, steps=1, out=folder / "no checkpoint", **TIGHT).require()
    refused(lambda: solve(scene, move={ball: (1, 0, 0)}, start=folder / "no checkpoint", **TIGHT), "holds no checkpoint")
    refused(lambda: solve(scene, move={ball: (1, 0, 0)}, start=3, **TIGHT), "start = 3", "result")
    jumps = {ball: lambda t: (1 + t, 0, 0)}
    refused(lambda: solve(scene, move=jumps, start=first, **TIGHT), "move of 'ball' starts 1 away")
    for size, cells in (((8.0, 8.0, 4.1), (4, 4, 2)), ((8.0, 8.0, 4.0), (4, 4, 3))):
        other = Scene(Body(read_gmsh(box.build, size=size, cells=cells), "box", LAW))
        other.fix("zmin")
        other.prescribe("zmax", "z", -0.1)
        refused(lambda: solve(other, start=first, **TIGHT), "start = the result does not fit", "the same mesh")  # noqa: B023
    plane = read_gmsh(rectangles.build, rectangles={"b": ((0.0, 0.0), (2.0, 1.0), (2, 1))})
    thin, thick = (Scene(Body(plane, "b", LAW), plane="strain", thickness=thickness) for thickness in (1.0, 5.0))
    for one in (thin, thick):
        one.fix("b_ymin")
        one.prescribe("b_ymax", "y", -0.1)
    flat = solve(thin, steps=1, **TIGHT).require()
    refused(lambda: solve(thick, start=flat, **TIGHT), "thickness=1.0) and this one thickness=5.0", "the same thickness")
    finer = Scene(Body(block(), "box", LAW), degree=2)
    finer.fix("zmin")
    finer.prescribe("zmax", "z", -0.1)
    refused(lambda: solve(finer, start=first, **TIGHT), "degree=1) and this one degree=2", "the same degree in both")
    tied, hub = Scene(Body(block(), "box", LAW)), rigid_hub("hub", (4, 4, 4.0))
    tied.fix("zmin")
    tied.tie("zmax", hub)
    refused(lambda: solve(tied, move={hub: Motion(rz=0.1)}, start=first, **TIGHT), "what is tied here has moved")
    turned = solve(tied, move={hub: Motion(rz=0.1)}, steps=1, **TIGHT).require()
    more = solve(tied, move={hub: Motion(rx=0.1)}, steps=1, start=turned, **TIGHT).require()
    assert more.column("hub_angle_z_rad")[-1] == pytest.approx(0.1)
    renamed = Scene(Body(block(), "box", LAW))
    renamed.fix("zmin")
    renamed.contact("zmax", ball, 0.3, name="another")
    result = solve(renamed, move={ball: (0, 0, -0.1)}, steps=1, start=first, **TIGHT).require()
    assert any("'another' starts without a history" in note for note in result.verdict.notes)


@pytest.mark.parallel
def test_multipliers_take_over_from_a_run_by_penalties():
    """Such a run has none; friction goes on all the same, where the contact was said to have no history and slid anew."""

    def ended(start=None, **exactly):
        scene, ball = pressed(**exactly)
        if start is not None:
            return solve(scene, move={ball: (0, 0, -1e-9)}, steps=1, start=start, **TIGHT).require()
        ways = {"press": (0, 0, -1.0), "drag": (0.3, 0, 0)}
        stages = [Stage(name, move={ball: way}, steps=3) for name, way in ways.items()]
        return solve(scene, stages=stages, **TIGHT).require()

    stiff = ended(penalty=Penalty(factor=1e3))  # the default ones lack 3 % of the friction themselves
    exact, taken = ended(penetration=1e-5), ended(stiff, penetration=1e-5)
    assert taken.column("top_force_x_N")[-1] == pytest.approx(exact.column("top_force_x_N")[-1], rel=0.01)
    assert not any("without a history" in note for note in taken.verdict.notes)


@pytest.mark.parallel
def test_what_a_start_leaves_out_is_noted():
    """A tool by another name is where it was stated, not where it went, and a load that is not stated ends at once."""
    scene, ball = pressed()
    scene.traction("xmax", (0.01, 0, 0))
    first = solve(scene, move={ball: (0, 0, -0.2)}, steps=1, **TIGHT).require()
    again, same = pressed()
    again.traction("xmax", (0.01, 0, 0))
    kept = solve(again, move={same: (0, 0, -0.1)}, steps=1, start=first, **TIGHT).require()
    assert not any("stated" in note for note in kept.verdict.notes)
    bare = Scene(Body(block(), "box", LAW))
    bare.fix("zmin")
    other = rigid_sphere(5.0, (4, 4, 8.8), name="other")
    bare.contact("zmax", other, 0.3, name="top")
    notes = solve(bare, move={other: (0, 0, -0.1)}, steps=1, start=first, **TIGHT).verdict.notes
    assert any("tool 'other' starts where the scene states it" in note and "'ball'" in note for note in notes)
    assert any("traction on 'xmax', with which the result ends" in note for note in notes)
    assert not any("pushed" in note for note in notes)
    pushed = solve(scene, push={ball: (0, 0, -5)}, steps=1, start=first, **TIGHT).require()
    notes = solve(bare, move={other: (0, 0, -0.1)}, steps=1, start=pushed, **TIGHT).verdict.notes
    assert any("tool 'ball', pushed where the result ends, is in no contact or tie" in note for note in notes)


# -- pictures ---------------------------------------------------------------------------------------------------------
@pytest.mark.serial
def test_pictures_and_curves_name_the_stages():
    scene, ball = pressed()
    result = solve(scene, stages=press_drag_lift(ball, (1, 1, 1))[:2], **TIGHT).require()
    assert result.drawing().title.startswith("drag, t = 2")
    figure = result.plot_history("ball_travel_x_mm", "top_force_z_N")
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["press", "drag"]
    figure.canvas.draw()
    assert legend.get_window_extent().y0 >= figure.axes[0].get_window_extent().y1  # off the curves
    with pytest.raises(KeyError, match="no stage 'lift' in the history; it has: press, drag"):
        result.column("t", "lift")


# -- wrong statements -------------------------------------------------------------------------------------------------
def wrong(stages, *words, **options):
    scene, ball = pressed()
    scene.pressure("xmax", 0.01)
    scene.contact("ymax", rigid_plane((0, 20, 0), (0, -1, 0), name="wall"), name="side")
    return refused(lambda: solve(scene, stages=stages(ball), **options, **TIGHT), *words)


WRONG = {
    "no list": (lambda b: Stage("a", move={b: (0, 0, -1)}), "give a list of Stage"),
    "none": (lambda b: [], "give a list of Stage"),
    "lost": (
        lambda b: [Stage("a", move={b: (0, 0, -1)}, duration=1e6), Stage("b", move={b: (1, 0, 0)}, duration=1e-4)],
        "stage 'b': duration = 0.0001 is lost in rounding beside the 1e+06 of all stages",
    ),
    "twice": (lambda b: [Stage("a", move={b: (0, 0, -1)}), Stage("a", move={b: (1, 0, 0)})], "two stages are named 'a'"),
    "no name": (lambda b: [Stage("", move={b: (0, 0, -1)})], "name"),
    "idle": (lambda b: [Stage("a", move={b: (0, 0, -1)}), Stage("rest")], "stage 'rest'", "nothing to do"),
    "steps": (lambda b: [Stage("a", move={b: (0, 0, -1)}, steps=0)], "stage 'a'", "steps"),
    "list of s": (lambda b: [Stage("a", move={b: (0, 0, -1)}, steps=[0.5, 0.5])], "stage 'a'", "increasing"),
    "part of s": (lambda b: [Stage("a", move={b: (0, 0, -1)}, steps=[0.5])], "stage 'a'", "ends at s = 1"),
    "method": (lambda b: [Stage("a", move={b: (0, 0, -1)}, method="magic")], "stage 'a'", "magic"),
    "duration": (lambda b: [Stage("a", move={b: (0, 0, -1)}, duration=0.0)], "stage 'a'", "duration"),
    "group": (lambda b: [Stage("a", pressures={"lid": 0.1})], "stage 'a'", "'lid'", "xmax"),
    "unstated load": (lambda b: [Stage("a", tractions={"xmax": (1, 0, 0)})], "traction on 'xmax'", "the scene states none"),
    "unsupported": (lambda b: [Stage("a", prescribe={("zmax", "z"): -1.0})], "'zmax' along z", "scene.fix"),
    "axis": (lambda b: [Stage("a", prescribe={("zmin", "r"): -1.0})], "'r'", "x, y, z"),
    "key": (lambda b: [Stage("a", prescribe={"zmin": -1.0})], "prescribe names 'zmin'", '("group", "z")'),
    "not a mapping": (lambda b: [Stage("a", pressures=0.1)], "stage 'a'", "pressures = 0.1"),
    "tool": (lambda b: [Stage("a", move={rigid_plane(name="other"): (0, 0, 1)})], "stage 'a'", "'other'", "no contact"),
    "both": (lambda b: [Stage("a", move={b: (0, 0, 1)}, push={b: (0, 0, 1)})], "stage 'a'", "both moved and pushed"),
    "not finite": (lambda b: [Stage("a", move={b: (0, 0, float("nan"))})], "stage 'a': move of 'ball'", "finite"),
    "late in a function": (
        lambda b: [Stage("a", steps=1), Stage("b", move={b: lambda s: (0, 0, -s if s < 1 else float("nan"))}, steps=1)],
        "stage 'b': move of 'ball' at t = 1", "finite",
    ),
    "a motion that jumps": (
        lambda b: [Stage("a", move={b: (0, 0, -1)}), Stage("b", move={b: lambda s: (0, 0, -1 - s)})],
        "stage 'b': move of 'ball' starts 1 away", "where the stage before ends",
    ),
    "a load that jumps": (
        lambda b: [Stage("a", move={b: (0, 0, -1)}), Stage("b", pressures={"xmax": lambda s: 0.02 * s})],
        "stage 'b': pressure on 'xmax' starts 0.01 away",
    ),
    "a support that jumps": (
        lambda b: [Stage("a"), Stage("b", prescribe={("zmin", "z"): lambda X, s: 0.1 + s})],
        "stage 'b': prescribed displacement of zmin along z starts 0.1 away",
    ),
    "no force": (lambda b: [Stage("a"), Stage("b", push={b: (0, 0, 0)})], "stage 'b': push of 'ball' has no force"),
    "two points": (
        lambda b: [Stage("a", move={b: Motion(rz=1.0)}), Stage("b", move={b: Motion(about=(0, 0, 0), rx=1.0)}),
                   Stage("c", move={b: Motion(about=(0, 0, 1), rx=1.0)})],
        "motion of 'ball': about = [0.0, 0.0, 0.0] in one stage and [0.0, 0.0, 1.0] in another", "(R - 1)(c - p)",
    ),
    "a point named late": (
        lambda b: [Stage("a", move={b: Motion(rz=1.0)}), Stage("b", move={b: Motion(about=(0, 0, 1), rx=1.0)})],
        "motion of 'ball': about = [0.0, 0.0, 1.0] in stage 'b', but not in stage 'a' before it", "name about in stage 'a'",
        "(R - 1)(c - p)",
    ),
    "a point named after free turns": (
        lambda b: [Stage("a", move={b: Motion(z=-0.6, free="rx")}), Stage("b", pressures={"xmax": 0.02}),
                   Stage("c", push={b: (0, 0, -1.0)}), Stage("d", move={b: Motion(about=(0, 0, 1), z=-0.1)})],
        "in stage 'd', but not in stage 'a' and stage 'b' and stage 'c' before it", "its own, [4.0, 4.0, 9.0]",
    ),
    "a rotation that jumps": (
        lambda b: [Stage("a", move={b: Motion(rz=1.0)}), Stage("b", move={b: Motion(rz=lambda s: 0.5 + s)})],
        "stage 'b': rotation of 'ball' starts 0.5 away",
    ),
    "a moment from nowhere": (
        lambda b: [Stage("a", move={b: Motion(rz=1.0)}), Stage("b", move={b: Motion(moment=lambda s: (0, 0, 1 + s))})],
        "stage 'b': the moment on 'ball' is a function of s that starts from x 0, y 0, z 1", "component z",
        "at the end of stage 'a'", "moved or held that way", "at the end of 'b' as numbers",
    ),
    "a force that jumps": (
        lambda b: [Stage("a", push={b: (0, 0, -0.9)}), Stage("b", push={b: lambda s: (0, 0, -s)})],
        "stage 'b': the force on 'ball' is a function of s that starts from x 0, y 0, z 0, but stage 'a' ends with "
        "x 0, y 0, z -0.9", "let the function start from there", "as numbers",
    ),
    "a force in a direction that was held": (
        lambda b: [Stage("a", push={b: (0, 0, -0.9)}), Stage("b", push={b: lambda s: (0.1 * s, 0, -0.9)})],
        "stage 'b': the force on 'ball'", "its component x is at the end of stage 'a'", "as numbers",
    ),
    "a force after arcs": (
        lambda b: [Stage("a", push={b: (0, 0, -0.9)}, steps=ArcSteps(until=Load(1.0))),
                   Stage("b", push={b: lambda s: (0, 0, -0.9 - s)})],
        "stage 'b': the force on 'ball'", "component z", "arc length may end anywhere", "as numbers",
    ),
    "no force on what is held": (
        lambda b: [Stage("a", move={b: (0, 0, -0.6)}), Stage("b", move={b: Motion(force=(0, 0, 0))})],
        "stage 'b': motion of 'ball' has no force in any direction", 'free="y"',
    ),
    "no moment on what does not turn": (
        lambda b: [Stage("a", move={b: Motion(x=1.0, moment=(0, 0, 0))})],
        "stage 'a': motion of 'ball' has no moment in any direction", 'free="rz"',
    ),
    "a turn taken back under another one": (
        lambda b: [Stage("a", move={b: Motion(z=-0.6, moment=(0, 0, 1.0))}),
                   Stage("b", move={b: Motion(moment=(1.0, 0, 0))})],
        "rx and rz may move freely", "rz was free before", "rz=0",
    ),
    "a motion in push": (lambda b: [Stage("a", push={b: Motion(rz=1.0)})], "stage 'a'", "give it in move="),
    "mixed rotations": (lambda b: [Stage("a", move={b: Motion(rz=1.0, free="rx")})], "stage 'a': motion of 'ball'", "order"),
    "no spin": (lambda b: [Stage("a", spin=1.0)], "stage 'a': speed of the spin", "the scene states none"),
    "no swelling": (lambda b: [Stage("a", swell={"box": 1.1})], "stage 'a': swelling of 'box'", "the scene states none"),
    "arc without an end": (lambda b: [Stage("a", method="arc_length")], "stage 'a'", "give steps=ArcSteps(until=...)"),
    "arcs in steps": (
        lambda b: [Stage("a", steps=ArcSteps(until=Load(1.0)), method="newton")], "stage 'a'", "not by method 'newton'",
    ),
    "a function after arcs": (
        lambda b: [Stage("a", steps=ArcSteps(until=Load(1.0))), Stage("b", pressures={"xmax": lambda s: 0.01})],
        "stage 'b': pressure on 'xmax'", "after stage 'a', whose arc may end anywhere", "give a number", "before this one",
    ),
}  # fmt: skip


@pytest.mark.parallel
@pytest.mark.parametrize("name", WRONG)
def test_wrong_stages_are_refused(name, folder):
    stages, *words = WRONG[name]
    wrong(stages, *words, out=folder / "results")
    assert not (folder / "results").exists() or not list((folder / "results").iterdir())


@pytest.mark.parallel
def test_stages_go_alone():
    scene, ball = pressed()
    stages = press_drag_lift(ball)
    refused(lambda: solve(scene, stages=stages, move={ball: (0, 0, -1)}), "stages= beside move")
    refused(lambda: solve(scene, stages=stages, push={ball: (0, 0, -1)}), "stages= beside")
    corner = Scene(Body(read_gmsh(box.build, cells=(2, 2, 2)), "box", LAW))
    corner.fix("zmin")
    corner.fix("xmin")
    apart = [Stage("a", prescribe={("xmin", "z"): 0.1})]
    refused(lambda: solve(corner, stages=apart), "stage 'a'", "contradict", "zmin along z", "xmin along z")


if __name__ == "__main__":
    found = figures(pushed_in_stages(Path(sys.argv[1]), resume=True).require())
    if COMM.rank == 0:
        print(json.dumps({key: np.asarray(value).tolist() for key, value in found.items()}))
