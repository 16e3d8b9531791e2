"""Jumps of the load path, a snap and a blade that lets go: damped motion carries the bodies to where they rest."""

from dataclasses import replace
from functools import partial
from itertools import product
from types import SimpleNamespace

import gmsh
import numpy as np
import pytest
from by_node import displacements
from mpi4py import MPI

from fenics_contact import (
    ArcSteps,
    Body,
    Load,
    Method,
    Output,
    Penalty,
    Scene,
    SceneError,
    Stage,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_surface,
    run,
    solve,
)
from fenics_contact.assembly.finding import CYCLING
from fenics_contact.assembly.stages import Stages
from fenics_contact.assembly.tool_motion import ToolMotion
from fenics_contact.meshes import box, dome, rectangles, ring_sector, tool_surfaces
from fenics_contact.scene.build import build
from fenics_contact.solvers import control
from fenics_contact.solvers.augmented import misfit
from fenics_contact.solvers.damped import jump
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.snaps import snapped
from fenics_contact.solvers.softness import arcs
from fenics_contact.solvers.touching import TOUCHES
from fenics_contact.solvers.verdict import StepFailed

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def loaded_dome(element="displacement"):
    """A dome under a dead load of eight times what it bears."""
    scene = Scene(Body(read_gmsh(dome.build, thickness=2.0, boss=0.0, cells=3), "dome", RUBBER), element=element)
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("rim")
    scene.traction("outer", (0, 0, -0.05))
    return scene


def arch():
    """Half of a flat arch of span 20 and rise 2, clamped at its foot, under a hundred times the pressure that it bears."""

    def draw():
        geo, half = gmsh.model.geo, np.arcsin(10.0 / 26.0)
        centre = geo.addPoint(0.0, -24.0, 0.0)
        low, high = ([geo.addPoint(r * np.sin(a), r * np.cos(a) - 24.0, 0.0) for a in (0.0, half)] for r in (25.7, 26.3))
        crown, foot = geo.addLine(low[0], high[0]), geo.addLine(low[1], high[1])
        under, top = geo.addCircleArc(low[0], centre, low[1]), geo.addCircleArc(high[0], centre, high[1])
        face = geo.addPlaneSurface([geo.addCurveLoop([under, foot, -top, -crown])])
        for curve, cells in (under, 12), (top, 12), (crown, 2), (foot, 2):
            geo.mesh.setTransfiniteCurve(curve, cells + 1)
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
        geo.synchronize()
        for dim, tag, name in (2, face, "arch"), (1, crown, "crown"), (1, foot, "foot"), (1, top, "top"):
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
        gmsh.model.mesh.generate(2)

    scene = Scene(Body(read_gmsh(draw), "arch", neo_hooke(1.0, 10.0)), plane="strain", degree=2)
    scene.fix("crown", "x")
    scene.fix("foot")
    scene.pressure("top", 0.05)
    return scene


def blade(**options):
    """A blade clamped at its top, pressed on a rough floor and drawn over it: it leans, its foot lets go and flips."""
    mesh = read_gmsh(box.build, size=(0.74, 1.0, 7.87), cells=(3, 2, 7))
    scene = Scene(Body(mesh, "box", RUBBER))
    scene.prescribe("zmax", "z", lambda X, t: np.full(len(X), -0.99 * min(t / 0.2, 1.0)))
    scene.prescribe("zmax", "x", lambda X, t: np.full(len(X), 13.3 * max(t - 0.2, 0.0)))
    scene.fix("zmax", "y")
    scene.contact("zmin", rigid_plane(), 1.06, name="floor", **options)
    return scene


def stumbling(smallest, friction=0.3, press=0.3, drag=4.0):
    """A tall block dragged over a rough floor in long steps: two nodes of its sole lift when they touch, and fall back."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 4.0), cells=(4, 4, 4)), "box", RUBBER))
    scene.prescribe("zmax", "z", lambda X, t: np.full(len(X), -press * min(t / 0.2, 1.0)))
    scene.prescribe("zmax", "x", lambda X, t: np.full(len(X), drag * max(t - 0.2, 0.0)))
    scene.fix("zmax", "y")
    scene.contact("zmin", rigid_plane(), friction, penalty=Penalty(share=1.0), name="floor")
    return scene, {"method": Method(smallest_step=smallest)}


def past_the_end(way=-6.0):
    """A meshed ball moved down at the end of a cantilever, which bends, lets the ball past its end and springs back."""
    scene = Scene(Body(read_gmsh(box.build, size=(8.0, 2.0, 1.0), cells=(8, 2, 2), origin=(0.0, -1.0, -1.0)), "box", RUBBER))
    scene.fix("xmin")
    ball = rigid_surface(tool_surfaces.ball, "ball", mesh_size=0.6, radius=1.5, centre=(7.5, 0.0, 1.5), name="ball")
    scene.contact("zmax", ball, 0.3, name="c")
    return scene, {ball: (0, 0, way)}


def door_seal(friction=0.01, half=False, tilt=0.0):
    """A hollow seal with a glued foot, or its half x > 0, and a door that comes down on it by 7; such friction does not keep
    it upright. tilt: of the door's normal along x. No half of the whole has its cells."""

    def draw():
        occ, mesh = gmsh.model.occ, gmsh.model.mesh
        foot, tube, hole = (
            occ.addRectangle(-6, -2, 0, 12, 2.5), *(occ.addDisk(0, 5.5, 0, r, r) for r in (6.0, 4.8)),
        )  # fmt: skip
        whole, _ = occ.fuse([(2, tube)], [(2, foot)])
        seal, _ = occ.cut(whole, [(2, hole)])
        if half:
            seal, _ = occ.intersect(seal, [(2, occ.addRectangle(0, -3, 0, 9, 20))])
        line = occ.addLine(occ.addPoint(-7, 5.5, 0), occ.addPoint(7, 5.5, 0))
        parts, _ = occ.fragment(seal, [(1, line)])
        occ.synchronize()
        faces = [(dim, tag) for dim, tag in parts if dim == 2]
        groups: dict[str, list[int]] = {"foot": [], "skin": [], "inside": []} | ({"middle": []} if half else {})
        for _, curve in gmsh.model.getBoundary(faces, combined=True, oriented=False):
            low, high = gmsh.model.getParametrizationBounds(1, curve)
            x, y, _ = gmsh.model.getValue(1, curve, [0.5 * (low[0] + high[0])])
            inside = np.hypot(x, y - 5.5) < 4.9 and y > 0.0
            side = "middle" if half and abs(x) < 1e-6 else "inside" if inside else "skin"
            groups["foot" if y < -1.99 else side].append(curve)
        for dim, tags, name in (2, [tag for _, tag in faces], "seal"), *((1, tags, name) for name, tags in groups.items()):
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
        for option, value in ("MeshSizeMin", 0.8), ("MeshSizeMax", 0.8), ("RecombineAll", 1), ("SubdivisionAlgorithm", 1):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        mesh.generate(2)

    scene = Scene(Body(read_gmsh(draw), "seal", neo_hooke(0.5, 5.0)), plane="strain", element="mixed")
    scene.fix("foot")
    if half:
        scene.fix("middle", "x")
    door = rigid_plane((0, 12.0, 0), (tilt, -1, 0), name="door")
    scene.contact("skin", door, friction, name="door")
    return scene, {door: (0, -7.0, 0)}


def test_a_snap_is_told_with_springs_that_nothing_needs():
    """Its supports hold the arch: the springs' many solves are no reason to look at none of its steps."""
    result = solve(arch(), steps=10, method=Method(stabilise=True)).require()
    assert any("it has passed through a snap" in note for note in result.verdict.notes)


def test_the_way_of_the_drive_is_no_jump():
    """A block whose support is drawn aside, nothing in its way, follows: it has not jumped."""
    scene = Scene(Body(read_gmsh(box.build, size=(1.0, 1.0, 2.0), cells=(2, 2, 3)), "box", RUBBER))
    scene.prescribe("zmax", "x", 0.7)
    scene.fix("zmax", "yz")
    scene.contact("zmin", rigid_plane(point=(0, 0, -1.0)), name="floor")
    system = build(scene, damping=True).system
    report = jump(system, 1.0, Newton(LinearSolver(system)))
    displacement = system.state.u.x.array.reshape(-1, 3)
    np.testing.assert_allclose(displacement, [[0.7, 0.0, 0.0]] * len(displacement), atol=1e-6)
    assert "jumped by" in report.notes[0]
    assert float(report.notes[0].split("jumped by ")[1].split()[0]) < 1e-5


@pytest.mark.parametrize(
    ("stated", "steps"), [(lambda: (loaded_dome(), {}), 4), pytest.param(door_seal, 24, marks=pytest.mark.slow)]
)
def test_the_verdict_names_damping_and_damping_cures(stated, steps):
    scene, move = stated()
    failed = solve(scene, move=move, steps=steps, method=Method(smallest_step=1e-3))
    assert not failed.converged and "solve(..., method=Method(damping=True))" in failed.verdict.remedy, failed.verdict.reason
    cured = solve(scene, move=move, steps=steps, method=Method(damping=True))
    assert cured.converged, cured.verdict.reason
    assert any("jumped" in note for note in cured.verdict.notes)
    assert max(row["residual"] for row in cured.history) <= 1e-8  # in balance without damping
    work = cured.column("damping_work_Nmm")
    assert cured.summary["damping"]["jumps"] >= np.count_nonzero(work) > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("snapping", "steps"), [*product([past_the_end], [9, 10, 12, 15, 20]), *product([lambda: (blade(), {})], [10, 20, 40])]
)
def test_no_steps_go_past_a_snap_without_a_word(snapping, steps):
    """Off the end of a cantilever, or as the foot of a blade flips at T = mu N: Newton's method fails, with the remedy, or
    comes over it and says so."""
    scene, move = snapping()
    result = solve(scene, move=move, steps=steps, method=Method(smallest_step=1e-3))
    said = result.verdict.notes if result.converged else [result.verdict.remedy]
    assert any("solve(..., method=Method(damping=True))" in words for words in said), said


@pytest.mark.parametrize("moved", [False, True], ids=["load", "drive"])
def test_a_load_or_drive_that_jumps_is_no_snap(moved):
    """A beam pulled or moved on a little, and at once by ten times as much."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 1.0, 1.0), cells=(8, 2, 2)), "box", RUBBER))
    scene.fix("xmin")
    if moved:
        scene.prescribe("xmax", "z", lambda X, t: np.full(len(X), 0.1 * t + (t > 0.55)))
    else:
        scene.traction("xmax", lambda t: (0, 0, 0.001 * t + 0.01 * (t > 0.55)))
    notes = solve(scene, steps=10).require().verdict.notes
    assert any("loads or drives jump near t = 0.55" in note for note in notes)
    assert not any("snap" in note for note in notes)


@pytest.mark.slow
def test_a_ball_goes_past_the_end_of_a_cantilever():
    scene, move = past_the_end()
    cured = solve(scene, move=move, steps=10, method=Method(damping=True)).require()
    assert cured.column("c_active_points")[-1] == 0  # the ball is past it
    assert np.abs(cured.u.x.array).max() < 1e-6  # and the cantilever straight again; steps end at 1e-8 of the force
    scene, move = past_the_end(-2.4)
    assert solve(scene, move=move, steps=4).converged  # a path that ends before needs none


@pytest.mark.parametrize(("element", "method"), [("displacement", "newton"), ("displacement", "snes"), ("mixed", "newton")])
def test_the_state_after_a_snap_is_the_one_beyond_the_limit_point(element, method):
    """Past the jump a dead load has one stable state: that of any other steps, at all its loads, by any method."""
    ends = []
    for steps, way in ((4, method), (10, "newton")):
        result = solve(loaded_dome(element), steps=steps, method=Method(way, damping=True)).require()
        assert result.summary["damping"]["jumps"] == 1
        ends.append(displacements(result.u))
    np.testing.assert_allclose(*ends, atol=1e-6 * np.abs(ends[0]).max())  # steps end at 1e-8 of the force


@pytest.mark.parametrize(
    ("scene", "times", "stated", "method"),
    [
        (loaded_dome, [0.25, 0.5], {}, "newton"),
        (loaded_dome, [0.25, 0.5], {"element": "mixed"}, "snes"),
        pytest.param(blade, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], {"penetration": 1e-4}, "newton", marks=pytest.mark.slow),
    ],
)
def test_a_run_resumed_after_a_jump_equals_a_continuous_one(scene, times, stated, method, tmp_path):
    """Its history, what its jumps took, and the notes; stopped before the last time, after the jump."""
    if COMM.size > 1 and scene is blade:
        pytest.skip("which solves fail as it flips is round-off, and MUMPS adds up in another order each time")
    folder = COMM.bcast(tmp_path)
    damped, kept = Method(method, tolerance=1e-11, damping=True), Output(folder / "parts", checkpoint=True)
    whole = solve(scene(**stated), steps=times, method=damped, out=Output(folder / "whole", checkpoint=True)).require()
    begun = solve(scene(**stated), steps=times[:-1], method=damped, out=kept).require()
    assert begun.summary["damping"]["jumps"] > 0
    parts = solve(scene(**stated), steps=times, method=damped, out=replace(kept, resume=True)).require()
    # on several processes MUMPS adds up in another order each time: behind a jump solves may be some more or fewer
    for name in ("t", "damping_work_Nmm", *(["iterations"] if COMM.size == 1 else [])):
        np.testing.assert_allclose(parts.column(name), whole.column(name), rtol=1e-9)  # steps end at 1e-11 of the force
    assert parts.system.vector.norm() == pytest.approx(whole.system.vector.norm(), rel=1e-9)
    assert parts.summary["damping"] == pytest.approx(whole.summary["damping"], rel=1e-9)
    told = [[note for note in run.verdict.notes if COMM.size == 1 or "the state jumped" in note] for run in (parts, whole)]
    assert told[0] == told[1] and told[0]


@pytest.mark.slow
def test_the_blade_slides_on_as_with_other_steps():
    """Behind the jump it slides, and has forgotten where it let go."""
    force = [solve(blade(), steps=n, method=Method(damping=True)).require().history[-1] for n in (10, 20)]
    names = [f"floor_force_{axis}_N" for axis in "xz"]
    one, other = ([row[name] for name in names] for row in force)
    np.testing.assert_allclose(one, other, rtol=1e-6)  # steps end at 1e-8 of the force, once ten times as great


def test_work_is_what_the_jump_lets_go():
    """Of the dead load's work what is not in the strain energy."""
    scene = loaded_dome()
    system = scene.system()
    system.begin_step(1.0)
    system.assemble_residual()
    load = -system.residual_vector.array_r.copy()

    def work(state):
        """Of the loads of t = 1 against the displacement."""
        return COMM.allreduce(float(load @ state.u.x.array[: len(load)]))

    result = solve(scene, steps=40, method=Method(damping=True), record={"work": work}).require()
    t, work_of_load = np.append(0.0, result.column("t")), np.append(0.0, result.column("work"))
    taken = result.column("damping_work_Nmm")
    jump, mean = int(taken.argmax()), 0.5 * (t[1:] + t[:-1])
    let_go = float(np.sum(mean * np.diff(work_of_load))) - result.system.strain_energy()
    assert taken[jump] == pytest.approx(let_go, rel=5e-3)


def test_a_snap_within_a_step_is_said():
    """One step of the whole load ends in balance beyond the limit point, which it has at 0.1169 of it."""
    result = solve(loaded_dome(), steps=1).require()
    (note,) = (note for note in result.verdict.notes if "passed through a snap" in note)
    assert "follow the path by arc length, or take shorter steps; where one fails, let damping carry it on" in note
    assert "damping=True" in note and 0.1169 - 1 / 64 < float(note.split("near t = ")[1].split()[0]) < 0.1169
    moderate = solve(loaded_dome(), steps=[0.05, 0.1]).require()
    assert not [
        note for note in moderate.verdict.notes if "steps= go to t = 0.1" not in note and "cells of degree 1" not in note
    ]


def beyond():
    """The system of a dome at rest, put into balance at t = 0.1 of its load beyond its snap, which steps do not lead to."""
    system = loaded_dome().system()
    newton = Newton(LinearSolver(system))
    newton.step(system, 1.0)
    newton.settle(system, 0.1)
    return system


def no_balance(self, system, t):
    raise StepFailed("no balance")


def test_a_snap_is_told_where_steps_under_the_penalties_before_end_elsewhere():
    """Penalties were raised: not where a step to this t would end is looked at, but the state that the run has come to."""
    system = beyond()
    inverted = system.state.u.x.array.copy()
    told = snapped(system, 0.1, raised=True)
    Newton(LinearSolver(system)).step(system, 0.1)
    gone = max(COMM.allgather(np.abs(inverted - system.state.u.x.array).max()))
    assert told is not None and "it has passed through a snap" in told
    assert float(told.split("jumped by ")[1].split(",")[0]) == pytest.approx(gone, rel=1e-2)  # a sixty-fourth of the step


@pytest.mark.parametrize("raised", [False, True])
def test_a_snap_that_no_shorter_step_follows_is_told_as_one_that_may_be(raised, monkeypatch):
    """Where all halves fail the path's rate tells: it leads to where an even path ends, and not beyond the snap."""

    system, even = beyond(), loaded_dome().system()
    Newton(LinearSolver(even)).step(even, 0.03)
    monkeypatch.setattr(Newton, "step", no_balance)
    told = snapped(system, 0.1, raised)
    assert told is not None and "it may have passed through a snap: no shorter step past t = 0 finds a state" in told
    assert "body 'dome' at (" in told and "solve(..., method=Method(damping=True))" in told
    assert snapped(even, 0.03, raised) is None


def test_a_snap_is_told_as_one_that_may_be_where_old_penalties_hold_no_balance(monkeypatch):
    system = beyond()

    monkeypatch.setattr(Newton, "settle", no_balance)
    told = snapped(system, 0.1, raised=True)
    assert told is not None and "it may have passed through a snap" in told


def test_damped_motion_ends_no_farther_on_than_it_may_go():
    """What it comes to is in balance without damping too, and there Newton's method must not lead it through a snap."""
    inverted = beyond().state.u.x.array.copy()
    system = build(loaded_dome(), damping=True).system
    newton = Newton(LinearSolver(system))

    def through(system, t):
        system.state.u.x.array[:] = inverted
        return newton.settle(system, t)

    over = SimpleNamespace(settle=through)
    with pytest.raises(StepFailed, match="did not come to rest"):
        jump(system, 0.1, over, farthest=10.0)
    assert not system.state.u.x.array.any() and system.state.t == 0.0
    assert jump(system, 0.1, newton, farthest=10.0).way < 10.0
    system.trail.rollback()
    assert jump(system, 0.1, over).way > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("steps", [12, 24, 36])
def test_a_hollow_seal_tips_over_by_damping_alone(steps):
    """Its crown goes aside by 4 ... 6 once a friction of 0.01 no longer holds it up; with 0.05 it stays up, see
    test_turning_slip.py. Statuses of a node may repeat in front of the limit point, and say so: what damping does unasked
    goes by less than a cell."""
    scene, move = door_seal()
    failed = solve(scene, move=move, steps=steps)
    assert not failed.converged and "Method(damping=True)" in failed.verdict.remedy, failed.verdict.reason
    crown = {"x": lambda view: view.at((0, 11.5, 0)).displacement[0]}
    tipped = solve(scene, move=move, steps=steps, record=crown, method=Method(damping=True)).require()
    jump = int(np.abs(np.diff(tipped.column("x"))).argmax()) + 2
    assert any(note.startswith(f"step {jump} ") and "the state jumped" in note for note in tipped.verdict.notes)
    assert abs(tipped.column("x")[-1]) == pytest.approx(7.79, rel=1e-3)  # either way, as without friction: 7.8


def test_no_arc_length_is_named_where_springs_are_asked_for():
    named = [arcs(build(loaded_dome(), stabilise=stabilise).system) for stabilise in (True, False)]
    assert named == [[], ["follow the path by arc length"]]


def steps_taken(monkeypatch):
    """The t that Newton's steps go to from now on."""
    taken, step = [], Newton.step
    monkeypatch.setattr(Newton, "step", lambda self, system, t: taken.append(t) or step(self, system, t))
    return taken


def test_a_step_that_is_looked_at_is_not_solved_twice(monkeypatch):
    """The state beyond the snap is taken up again by the solves that its last balance needs."""
    taken = steps_taken(monkeypatch)
    looked = solve(loaded_dome(), steps=1).require()
    assert taken.count(1.0) == 1 and len(taken) > 1
    monkeypatch.setattr(control, "wandered", lambda system, report: False)
    plain = solve(loaded_dome(), steps=1).require()
    ends = [displacements(result.u) for result in (looked, plain)]
    np.testing.assert_allclose(*ends, atol=1e-8 * np.abs(ends[1]).max())  # steps end at 1e-8 of the force


def test_one_half_tells_that_an_even_path_does_not_jump(monkeypatch):
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 1.0, 1.0), cells=(4, 2, 2)), "box", RUBBER))
    scene.fix("xmin")
    scene.traction("xmax", (1e-4, 0, 0))
    system = scene.system()
    Newton(LinearSolver(system)).step(system, 1.0)
    taken = steps_taken(monkeypatch)
    assert snapped(system, 1.0, raised=False) is None and taken == [0.5]


def test_a_stage_by_arc_length_may_come_before_one_with_damping():
    """The dome is led along its path to close below the limit point, and then loaded on, over it: one run."""
    limit = solve(loaded_dome(), steps=40, method=Method(damping=True)).require()
    jumps = np.count_nonzero(limit.column("damping_work_Nmm") > 1e-3)
    stages = [
        Stage("arcs", steps=ArcSteps(until=Load(0.1), first=0.1)),
        Stage("on", tractions={"outer": (0, 0, -0.05)}, steps=20),
    ]
    both = solve(loaded_dome(), stages=stages, method=Method(damping=True)).require()
    assert jumps == np.count_nonzero(both.column("damping_work_Nmm") > 1e-3) == 1
    assert both.system.strain_energy() == pytest.approx(limit.system.strain_energy(), rel=1e-6)


def test_wrong_methods_are_refused():
    for method, steps in (("incremental", 10), ("newton", ArcSteps(until=Load(1.0), first=0.1))):
        with pytest.raises(SceneError, match="damping"):
            solve(loaded_dome(), steps=steps, method=Method(method, damping=True))


def test_where_a_jump_ends_multipliers_have_taken_over(monkeypatch):
    scene, built = blade(penetration=1e-4), []
    monkeypatch.setattr(run, "build", lambda *stated: built.append(build(*stated)) or built[0])
    record = {"misfit": lambda state: misfit(built[0].system)}
    result = solve(scene, steps=np.arange(1, 6) / 10, method=Method(damping=True), record=record).require()
    assert result.summary["damping"]["jumps"] > 0
    # deepest point, slip in stick and pressure across a gap, over 1e-4 mm
    assert result.column("misfit").max() <= 1.0


class Creeping:
    """A system, its trail and stepper, that no step carries on, only a jump."""

    damping = damped = True
    terms, fluids, contact_terms, stages = (), (), (), Stages(("",), (1.0,), 0)
    holds, comm = SimpleNamespace(reliant=[]), MPI.COMM_SELF
    supports = SimpleNamespace(ties=SimpleNamespace(of=lambda tool: ()))
    tools = ToolMotion(stages, ((), ()), (), [np.zeros((0, 6), dtype=bool)], (), (1.0, 1.0))

    def __init__(self, rests):
        self.state, self.rests, self.jumps, self.steps = SimpleNamespace(t=0.0), rests, [], 0
        self.trail, self.last = self, SimpleNamespace(t=0.0)

    def step(self, system, t):
        self.steps += 1
        raise StepFailed("stumbled")

    def jump(self, system, goal, stepper, farthest):
        self.jumps.append(goal - self.last.t)
        if not self.rests:
            raise StepFailed("damped motion did not come to rest")
        self.state.t = goal
        return StepReport(residuals=[0.0], jumped=True)

    def commit(self):
        self.last = SimpleNamespace(t=self.state.t)

    def rollback(self):
        pass


@pytest.mark.parametrize("rests", [True, False])
def test_jumps_grow_where_they_come_to_rest_and_end_where_they_do_not(monkeypatch, rests):
    system = Creeping(rests)
    monkeypatch.setattr(control, "jump", system.jump)
    monkeypatch.setattr(control, "diagnose", lambda _, failure, goal: failure.finding)
    verdict = control.run(system, system, [1.0], lambda *_: None)
    assert verdict.converged == rests
    if rests:  # four halvings before the first, none after it
        assert system.steps == 4 + len(system.jumps) and len(system.jumps) <= 6
        assert all(b <= 2.0 * a for a, b in zip(system.jumps, system.jumps[1:], strict=False))
    else:
        assert len(system.jumps) == control.JUMPS and verdict.cuts == 13


def test_steps_in_which_no_jump_is_tried_use_none_up(monkeypatch):
    """Not asked for, damping is tried where statuses cycle alone: steps that fail otherwise before leave it its tries."""
    system, others = Creeping(True), 4 + control.JUMPS
    system.damped, system.contact_terms = False, [SimpleNamespace(surface=SimpleNamespace(cell_height=1.0), rough=False)]

    def step(system, t):
        system.steps += 1
        raise StepFailed("20 iterations") if system.steps <= others else StepFailed("statuses repeat", CYCLING)

    def jump(*given):
        report = system.jump(*given)
        report.notes = ["the state jumped"]
        return report

    system.step = step
    monkeypatch.setattr(control, "jump", jump)
    monkeypatch.setattr(control, "in_corner", lambda *_: False)
    monkeypatch.setattr(control, "diagnose", lambda _, failure, goal: failure.finding)
    assert control.run(system, system, [1.0], lambda *_: None).converged and system.jumps


def squashed(points, **options):
    """Result of a rubber cylinder, axisymmetric, between rough plates, which its barrel comes to meet."""
    mesh = read_gmsh(rectangles.build, rectangles={"rubber": ((0.0, 0.0), (10.0, 10.0), (16, 16))})
    scene = Scene(Body(mesh, "rubber", neo_hooke(0.5, 5.0)), plane="axisymmetric")
    scene.fix("rubber_xmin", "x")
    lid, floor = rigid_plane((0, 10, 0), (0, -1, 0), name="lid"), rigid_plane((0, 0, 0), (0, 1, 0), name="floor")
    scene.contact(("rubber_ymax", "rubber_xmax"), lid, 0.3, points=points, name="lid")
    scene.contact(("rubber_ymin", "rubber_xmax"), floor, 0.3, points=points, name="floor")
    return solve(scene, move={lid: (0.0, -5.0, 0.0)}, **options)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [33, 40])
def test_nodes_that_find_no_state_jump_to_where_they_stick_and_it_is_said(steps):
    """A node that touches again beside the rim slips, and that lifts it off; Gauss points, which do not, tell the force."""
    jumped, smooth = squashed("nodes", steps=steps).require(), squashed(3, steps=40).require()
    said = [note for note in jumped.verdict.notes if "in short steps too; the state jumped by" in note]
    assert len(said) == 1 and "contact 'floor' at (9.375, 0, 0)" in said[0]
    assert not any("state jumped" in note for note in smooth.verdict.notes)
    assert jumped.column("lid_force_y_N")[-1] == pytest.approx(smooth.column("lid_force_y_N")[-1], rel=5e-3)
    more = [int(note.split()[0]) for note in jumped.verdict.notes if ": the state jumped, by " in note]
    assert jumped.summary["damping"]["jumps"] == len(said) + sum(more) and jumped.summary["damping"]["work_share"] < 2e-3
    assert "damping_work_Nmm" not in jumped.history[-1]  # its work is part of the energy that is not accounted for
    error, work = (np.abs(jumped.column(f"{name}_Nmm")[-1]) for name in ("energy_error", "external_work"))
    assert error < 2e-3 * work


def slotted():
    """A block with a slot that goes through it, its walls the groups upper and lower."""
    occ = gmsh.model.occ
    block, slot = occ.addBox(0, 0, 0, 4, 1, 2), occ.addBox(1, -0.1, 0.95, 2, 1.2, 0.1)
    occ.cut([(3, block)], [(3, slot)])
    occ.synchronize()
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)]), "block")
    places = {"zmin": (2, 0.0), "zmax": (2, 2.0), "ymin": (1, 0.0), "ymax": (1, 1.0), "upper": (2, 1.05), "lower": (2, 0.95)}
    for name, (axis, place) in places.items():
        faces = [f for _, f in gmsh.model.getEntities(2) if abs(occ.getCenterOfMass(2, f)[axis] - place) < 1e-6]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.25)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.25)
    gmsh.model.mesh.generate(3)


@pytest.mark.slow
@pytest.mark.parallel
def test_a_slot_that_a_pressure_closes_takes_no_jump():
    """At its end a sample misses two facets by as little: it keeps the one that it has where statuses repeat."""
    scene = Scene(Body(read_gmsh(slotted), "block", neo_hooke(mu=1.0, K=4.0)), accept_locking=True)
    scene.fix("zmin")
    for side in ("ymin", "ymax"):
        scene.fix(side, "y")
    scene.pressure("zmax", 0.8)
    scene.contact("upper", "lower", 0.5, name="slot")
    result = solve(scene, steps=[0.1, 0.2, 0.3, 0.4, 0.45]).require()
    assert "damping" not in result.summary or not result.summary["damping"]
    assert set(result.verdict.causes) <= {TOUCHES} and not any("jumped" in note for note in result.verdict.notes)
    assert result.column("balance_error_N")[-1] < 1e-6 * result.column("slot_load_N")[-1]


STUMBLES = [0.2, 0.4, 0.6, 0.7, 0.8, 0.9]  # the block, in one step of these


def test_a_run_resumed_after_an_unasked_jump_equals_a_continuous_one(tmp_path):
    folder, times = COMM.bcast(tmp_path), STUMBLES
    tight, kept = Method(tolerance=1e-11), Output(folder / "parts", checkpoint=True)
    whole = solve(stumbling(None)[0], steps=times, method=tight, out=Output(folder / "whole", checkpoint=True)).require()
    begun = solve(stumbling(None)[0], steps=times[:-1], method=tight, out=kept).require()
    parts = solve(stumbling(None)[0], steps=times, method=tight, out=replace(kept, resume=True)).require()
    assert begun.summary["damping"]["jumps"] == 1
    assert parts.summary["damping"] == pytest.approx(whole.summary["damping"], rel=1e-9)
    for name in ("t", "floor_force_x_N", "energy_error_Nmm"):
        np.testing.assert_allclose(parts.column(name), whole.column(name), rtol=1e-8, atol=1e-12)


def test_a_jump_of_more_than_a_cell_is_not_taken_unasked(monkeypatch):
    monkeypatch.setattr(control, "jump", partial(jump_by, control.jump, 1e-4))
    ended = solve(stumbling(None)[0], steps=STUMBLES)
    assert not ended.converged and "solve(..., method=Method(damping=True))" in ended.verdict.remedy
    assert not ended.summary["damping"]


def jump_by(jump, share, system, goal, stepper, farthest):
    """A jump of no more than a share of what is allowed."""
    return jump(system, goal, stepper, share * farthest)


def test_damped_motion_that_finds_no_rest_leaves_no_friction_work():
    """A tool drawn over a rough strip until a point finds no state: friction takes no more than what has been done."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (12.0, 3.0), (24, 4))})
    scene = Scene(Body(mesh, "strip", neo_hooke(1.0, 5.0)), plane="strain")
    scene.fix("strip_ymin")
    tool = rigid_cylinder(1.5, (4, 4.5, 0), (0, 0, 1), name="tool")
    scene.contact("strip_ymax", tool, 0.75, name="c")
    stages = [Stage("press", move={tool: (0, -0.8, 0)}, steps=2), Stage("drag", move={tool: (4, 0, 0)}, steps=20)]
    result = solve(scene, stages=stages)
    work, strain, friction = (result.column(f"{name}_Nmm") for name in ("external_work", "strain_energy", "c_friction_work"))
    assert not result.converged  # in vain
    assert np.all(friction <= 1.02 * (work - strain) + 1e-3 * work[-1])


def test_greater_penalties_are_no_snap():
    """A ring swells in a rigid housing: the way there is even, and penalties are raised on it twice."""
    mesh = read_gmsh(ring_sector.build, radii=(10.0, 15.0), cells=(4, 12))
    scene = Scene(Body(mesh, "ring", neo_hooke(1.0, 50.0)), plane="strain", element="mixed")
    scene.fix("inner")
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    housing = rigid_cylinder(15.0 + 1e-6, (0, 0, 0), (0, 0, 1), hollow=True, name="housing")
    scene.contact("outer", housing, 0.4, name="c")
    scene.swell("ring", 1.45)
    notes = solve(scene, steps=40).require().verdict.notes
    assert sum("penalties raised" in note for note in notes) == 2 == len(notes)
