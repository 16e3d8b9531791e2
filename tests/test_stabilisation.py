"""Bodies and tools that nothing holds at first find their contact, and the springs that help are gone when they have."""

import numpy as np
import pytest
from by_node import displacements

from fenics_contact import (
    Body,
    Method,
    Scene,
    SceneError,
    Stage,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.assembly.grounding import SHARE
from fenics_contact.assembly.term import FormTerm
from fenics_contact.meshes import box, rectangles, ring, two_blocks
from fenics_contact.scene.build import build
from fenics_contact.solvers.held import LONGEST, Following, Held
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.verdict import StepFailed

pytestmark = pytest.mark.parallel
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
ENERGY = 1e-6  # of the strain energy: the bound asked for


def block(gap, friction, force=0.01):
    """A block of 2 x 2 x 2 that its weight drops on a plane `gap` below."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2), origin=(0.0, 0.0, gap)), "box", RUBBER))
    if friction == 0.0:
        scene.fix("xmin", "x")
        scene.fix("ymin", "y")
    scene.contact("zmin", rigid_plane(), friction, name="c")
    scene.body_force((0, 0, -force))
    return scene


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("gap", "force"), [(1.0, 1e-2), (1.0, 1e-4), (1e-2, 1e-2)])
def test_a_free_block_is_dropped(friction, gap, force):
    result = solve(block(gap, friction, force), steps=2, method=Method(stabilise=True)).require()
    row = result.history[-1]
    # its weight; the springs may carry ALLOWED = 1e-7 of it, Newton leaves 1e-8
    np.testing.assert_allclose(row["c_force_z_N"], 8.0 * force, rtol=2e-7)
    assert 0.0 <= result.summary["stabilisation"]["energy_share"] < ENERGY
    assert not solve(block(gap, friction, force), steps=1).converged  # it needs the springs


def test_it_comes_to_rest_as_if_it_had_stood_there():
    dropped, stood = (
        solve(block(gap, 0.0), steps=2, method=Method(tolerance=1e-11, stabilise=gap > 0.0)).require() for gap in (0.5, 0.0)
    )
    u, other = (displacements(r.u) for r in (dropped, stood))
    # 1e-7 of the weight left on the springs compresses by 1e-7 of the compression, which is below 0.1
    np.testing.assert_allclose(u + [0.0, 0.0, 0.5], other, atol=2e-8)
    assert stood.summary["stabilisation"] == {}


def test_a_pushed_tool_crosses_a_gap():
    travel = []
    for gap in (1.0, 0.0):
        mesh = read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(4, 4, 2), origin=(-2.0, -2.0, -2.0))
        scene = Scene(Body(mesh, "box", RUBBER))
        scene.fix("zmin")
        ball = rigid_sphere(2.0, (0, 0, 2.0 + gap), name="ball")
        scene.contact("zmax", ball, name="c")
        result = solve(scene, push={ball: (0, 0, -0.5)}, steps=2, method=Method(tolerance=1e-11, stabilise=True)).require()
        np.testing.assert_allclose(result.history[-1]["c_force_z_N"], -0.5, rtol=2e-7)
        assert result.summary["stabilisation"]["energy_share"] < ENERGY
        travel.append(result.history[-1]["ball_travel_z_mm"] + gap)
    np.testing.assert_allclose(*travel, rtol=1e-6)


def test_a_gripper_carries_a_block_away():
    """Half a block that a finger presses on the plane of symmetry, lifted by far more than friction could take of springs
    to where it was: once the grip is settled all moves as one body, which hardly takes solves."""
    blocks = {"upper": (2, 2, 1), "upper_cells": (3, 3, 2), "upper_origin": (0.5, 0.5, 0), "lower_cells": (3, 3, 1)}
    mesh = read_gmsh(two_blocks.build, lower=(3, 3, 1), lower_origin=(0, 0, -1), **blocks)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("upper_top", "z")
    scene.fix("lower_bottom")
    scene.body_force((-2e-3, 0, 0))
    scene.contact("upper_bottom", "lower_top", 0.5, name="grip")
    stages = [
        Stage("close", prescribe={("lower_bottom", "z"): 0.05}, steps=2),
        Stage("lift", prescribe={("lower_bottom", "x"): 12.0}, steps=4),
    ]
    result = solve(scene, stages=stages, method=Method(stabilise=True)).require()
    lifted = result.column("upper_top_reaction_point_x_mm")[-3:]
    np.testing.assert_allclose(result.column("grip_force_x_N")[-4:], 8e-3, rtol=1e-6)
    np.testing.assert_allclose(np.diff(lifted), 3.0, rtol=1e-6)
    assert result.column("iterations")[-2:].max() <= 3


def test_springs_to_where_contact_has_carried_a_body_take_no_tangents():
    """A ring that rolls between plates, which hold it: the springs' far ends follow by corrections alone."""
    tangents = []
    for stabilise in (False, True):
        scene = Scene(Body(read_gmsh(ring.build, inner=4.0, outer=8.0, width=1.0, cells=(32, 3, 1)), "ring", RUBBER))
        scene.fix(("left", "right"), "y")
        floor = rigid_plane((0, 0, -8.0), name="floor")
        lid = rigid_plane((0, 0, 8.0), (0, 0, -1), name="lid")
        for tool in (floor, lid):
            scene.contact("outside", tool, 0.8, name=f"on {tool.name}")
        stages = [Stage("press", move={lid: (0, 0, -1.0)}, steps=3), Stage("roll", move={lid: (10.0, 0, 0)}, steps=10)]
        result = solve(scene, stages=stages, method=Method(stabilise=stabilise)).require()
        tangents.append(result.verdict.iterations)
    assert tangents[1] <= 1.2 * tangents[0], tangents  # 1.7 times as many, did each following take some


def test_what_meets_nothing_is_said_to_be_loose():
    scene = block(1.0, 0.3, -0.01)  # lifted away from the plane
    result = solve(scene, steps=1, method=Method(smallest_step=0.5, stabilise=True))
    assert not result.converged and result.verdict.kind == "rigid-body motion"
    assert "no contact that has been met holds" in result.verdict.reason


def test_a_step_that_ends_out_of_balance_is_refused():
    with pytest.raises(SceneError, match="stabilise"):
        solve(block(1.0, 0.3), steps=1, method=Method("incremental", stabilise=True))


def rolled(steps):
    """A block on another one, which a side pressure bulges beneath it before a ball comes down, presses it and drags it."""
    lower = {"lower": (7, 6, 2.5), "lower_cells": (5, 4, 2), "lower_origin": (0, 0, -2.5)}
    upper = {"upper": (4, 4, 2), "upper_cells": (3, 3, 2), "upper_origin": (1.2, 0.9, 0)}
    mesh = read_gmsh(two_blocks.build, **lower, **upper)
    scene = Scene(Body(mesh, "lower", mooney_rivlin(0.3, 0.05, 6.0)), Body(mesh, "upper", neo_hooke(0.5, 3.0)))
    scene.fix("lower_bottom")
    scene.pressure("lower_xmax", 0.06)
    scene.contact("upper_bottom", "lower_top", 0.4, name="joint")
    ball = rigid_sphere(5.0, (3.1, 3.0, 7.0), name="ball")
    scene.contact("upper_top", ball, 0.5, name="top")

    def path(t):
        aside = max(t - 0.4, 0.0)
        return 0.7 * aside, 0.14 * aside, -0.5 * min(t / 0.4, 1.0)

    return solve(scene, move={ball: path}, steps=steps)


@pytest.mark.parametrize("steps", [20, pytest.param(30, marks=pytest.mark.slow), pytest.param(200, marks=pytest.mark.slow)])
def test_a_body_that_has_lost_its_contact_stays(steps):
    """In short first steps nothing presses the upper block: any place is in balance, and Newton's method would throw it
    away. The answer is the one of long steps, to what a step more or less changes of the friction's path (0.17 % from 16
    to 200 steps)."""
    result, long = rolled(steps).require(), rolled(16).require()
    force, expected = (r.history[-1]["joint_force_z_N"] for r in (result, long))
    assert abs(force - expected) < 2e-3 * expected
    loose = [note for note in result.verdict.notes if "nothing held body 'upper'" in note]
    assert len(loose) == 1 and result.summary["stabilisation"] != {}
    if steps > 10:
        assert result.summary["stabilisation"]["energy_share"] < ENERGY


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_plate_stays_where_a_punch_leaves_it(friction):
    """Pressed on a floor that alone holds it, and let go: it lies there without strain, and says that nothing holds it."""
    mesh = read_gmsh(box.build, size=(4.0, 4.0, 1.0), cells=(4, 4, 2), origin=(-2.0, -2.0, 0.0))
    scene = Scene(Body(mesh, "box", RUBBER))
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    ball = rigid_sphere(3.0, (0, 0, 4.0), name="ball")
    scene.contact("zmax", ball, friction, name="top")
    scene.contact("zmin", rigid_plane(), friction, name="floor")
    way = {ball: lambda t: (0, 0, -min(t, 0.85 - t))}
    result = solve(scene, move=way, steps=10).require()
    forces, u = result.column("floor_force_z_N"), result.u.x.array.reshape(-1, 3)
    assert forces.max() > 0.1 and abs(forces[-1]) < 1e-6 * forces.max()
    assert any("nothing held body 'box'" in note for note in result.verdict.notes)
    # friction holds some of what slid while it was pressed
    assert np.abs(u).max(initial=0.0) < (1e-6 if friction == 0.0 else 0.05)


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("plane", ["axisymmetric", "strain"])
def test_what_supports_or_hoops_take_is_no_load_on_a_free_body(plane, friction):
    """Hoop stresses of a cylinder, or the pressure on the side of a half that its plane of symmetry holds, have a resultant
    along x; along y, where a lid is lifted off, nothing pulls."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((0.0, 0.0), (3.0, 2.0), (6, 4))})
    scene = Scene(Body(mesh, "b", neo_hooke(1.0, 3.0)), plane=plane)
    if plane == "strain":
        scene.fix("b_xmin", "x")
    scene.pressure("b_xmax", 0.05)
    lid = rigid_plane((0, 2, 0), normal=(0, -1, 0), name="lid")
    scene.contact("b_ymin", rigid_plane((0, 0, 0), normal=(0, 1, 0), name="floor"), friction, name="low")
    scene.contact("b_ymax", lid, friction, name="top")
    stages = [Stage("down", move={lid: (0, -0.4, 0)}, steps=4), Stage("up", move={lid: (0, 0.6, 0)}, steps=8)]
    result = solve(scene, stages=stages).require()
    force = result.column("low_force_y_N")
    assert np.abs(force).max() > 0.1 and abs(force[-1]) < 1e-6 * np.abs(force).max()
    assert any("nothing held body 'b' along y" in note for note in result.verdict.notes)


class Stumbling(Newton):
    """Newton's method that fails where the springs are softer than at first, after it has pressed the bodies together."""

    def __init__(self, system):
        super().__init__(LinearSolver(system))
        self.calls = 0

    def step(self, system, t):
        return self.settle(system, t)

    def settle(self, system, t):
        self.calls += 1
        if system.grounding.share >= SHARE:
            return super().settle(system, t)
        system.begin_step(t)
        system.state.u.x.array.reshape(-1, 3)[:, 2] -= 1e-2
        system.assemble_residual()
        raise StepFailed("stumbled")

    settle_near = settle


def test_the_first_step_takes_springs_where_what_failed_pressed():
    """Nothing pressed before, though the iterate that failed does."""
    system = block(0.0, 0.3, 0.0).system(None, None)
    report = Held(Following(Stumbling(system))).step(system, 1.0)
    assert "nothing held body 'box' along x, y, z (stumbled)" in report.notes[0] and system.grounding.engaged


def test_an_iterate_gone_astray_tells_nothing_of_what_holds():
    """Back in the accepted state forces and motions are compared with its own again, and the plane holds the block."""
    system = block(0.0, 0.3).system(None, None, stabilise=True)
    Following(Newton(LinearSolver(system))).step(system, 1.0)
    system.trail.commit()
    balance, far = system.scales.balance, system.new_vector()
    far.array_w[::3] = 1e6 * np.arange(1.0, 1.0 + len(far.array_r[::3]))
    system.update(far, np.zeros_like(system.state.q))
    system.assemble_residual()
    assert system.scales.balance > 1e6 * balance
    system.trail.rollback()
    assert system.scales.balance == balance and not system.acceptance.loose()


def test_the_note_says_along_which_axes_nothing_holds():
    """A block between smooth plates: they press it along z, and the wall that it may lean on is far away along y."""
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1))
    scene = Scene(Body(mesh, "box", RUBBER))
    scene.fix("xmin", "x")
    lid = rigid_plane((0, 0, 1.0), (0, 0, -1), name="lid")
    scene.contact("zmin", rigid_plane(), name="floor")
    scene.contact("zmax", lid, name="top")
    scene.contact("ymin", rigid_plane((0, -0.5, 0), (0, 1, 0), name="side"), name="wall")
    result = solve(scene, move={lid: (0, 0, -0.05)}, steps=3).require()
    (note,) = (note for note in result.verdict.notes if "nothing held" in note)
    assert "nothing held body 'box' along y" in note, note


def test_springs_that_are_too_soft_to_solve_with_become_stiffer():
    """A block that falls with a constant pull: the springs soften, Newton's method fails, and they go on as they were."""
    system = block(10.0, 0.3, 0.01).system(None, None, stabilise=True)
    stepper = Stumbling(system)
    report = Following(stepper).step(system, 1.0)
    assert stepper.calls == report.augmentations + 2  # the first solve, and the one that failed
    contact = system.contact_terms[0]
    np.testing.assert_allclose(contact.forces.measures(system.state)["force"][2], 0.08, rtol=2e-7)


def test_springs_that_would_pull_too_long_are_given_up_at_once():
    """A block that flies off: by the softest springs that can be solved with it would be for ever on its way."""
    system = block(1.0, 0.3, -1e-6).system(None, None, stabilise=True)
    stepper = Stumbling(system)
    with pytest.raises(StepFailed, match="springs of the stabilisation still pull"):
        Following(stepper).step(system, 1.0)
    assert stepper.calls < 10 < LONGEST


@pytest.mark.parametrize("points", ["a tool", "nodes", "corners", "averages", 2])
def test_what_is_drawn_in_contact_touches_and_does_not_pull(points):
    """Surfaces drawn with hardly a gap between them are closed at first; opened by as much they let go."""
    far = 2e-12  # a hundred times the round-off of these coordinates
    if points != "a tool":
        mesh = read_gmsh(two_blocks.build, lower_cells=(3, 3, 1), upper_cells=(2, 2, 1), upper_origin=(5.0, 5.0, far))
        scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
        scene.fix("lower_bottom")
        scene.contact("upper_bottom", "lower_top", 0.3, points=points)
        system, above = scene.system(None, None), 0.0
    else:
        scene = block(far, 0.3)
        system, above = scene.system(None, None), -1.0
    contact, u = system.contact_terms[0], system.state.u.x.array.reshape(-1, 3)
    drawn = contact.response(system.state)
    u[scene.space.tabulate_dof_coordinates()[:, 2] > above + 0.5 * far, 2] += far
    opened = contact.response(system.state)
    pull = contact.trial.law.eps_n.max(initial=0.0) * far  # what the gap would do
    assert (drawn.status != 0).all() and np.abs(drawn.traction).max(initial=0.0) <= 1e-12 * pull
    assert (opened.status == 0).all() and not opened.traction.any()


def test_springs_are_faint_while_the_accepted_state_is_looked_at():
    result = solve(block(0.1, 0.3), steps=2, method=Method(stabilise=True))
    system, share = result.system, result.system.grounding.share
    with system.as_accepted():
        assert system.grounding.share < 1e-3 * share
    assert system.grounding.share == share


def test_the_energy_at_rest_is_taken_once(monkeypatch):
    """By the system, with what it says of which the springs compare theirs."""
    own, asked = FormTerm.strain_energy, []
    monkeypatch.setattr(FormTerm, "strain_energy", lambda term: asked.append(term.name) or own(term))
    built = build(block(0.1, 0.3), stabilise=True)
    assert built.system.grounding is not None and asked == ["solid"]
