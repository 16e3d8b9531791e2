"""Multipliers on rubber that can hardly be compressed and cannot escape: forces, and ways slid, are those of the motion."""

import numpy as np
import pytest

from fenics_contact import Body, Penalty, Scene, Stage, from_elastic, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box, rectangles, two_blocks
from fenics_contact.solvers.augmented import Augmented
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.verdict import StepFailed

pytestmark = pytest.mark.parallel
DOWN = 0.04  # of a height of 2 [mm]


def beside_a_tool(bulk, **options):
    """A cube between planes of symmetry and a rough wall, its top led down along that."""
    scene = Scene(Body(read_gmsh(box.build, size=(2, 2, 2), cells=(2, 2, 2)), "box", neo_hooke(1.0, bulk)), element="mixed")
    for side in ("xmin", "ymin", "ymax", "zmin"):
        scene.fix(side, side[0])
    scene.prescribe("zmax", "z", -DOWN)
    scene.contact("xmax", rigid_plane((2, 0, 0), (-1, 0, 0)), friction=0.3, name="wall", **options)
    return scene


def beside_a_body(bulk, degree=1, **options):
    """The same, lying: the wall is a body that hardly gives way, below; it ends beyond the side that is led."""
    shape = {"lower": (2.6, 2, 0.5), "upper": (2, 2, 2), "lower_origin": (-0.3, 0, -0.5), "upper_origin": (0, 0, 0)}
    mesh = read_gmsh(two_blocks.build, **shape, lower_cells=(3, 1, 1), upper_cells=(2, 1, 2))
    bodies = Body(mesh, "upper", neo_hooke(1.0, bulk)), Body(mesh, "lower", from_elastic(1e5, 0.3))
    scene = Scene(*bodies, degree=degree, element="mixed")
    for side, axis in (("xmin", "x"), ("ymin", "y"), ("ymax", "y"), ("top", "z")):
        scene.fix(f"upper_{side}", axis)
    scene.fix("lower_bottom")
    scene.prescribe("upper_xmax", "x", -DOWN)
    scene.contact("upper_bottom", "lower_top", friction=0.3, name="wall", **options)
    return scene


CASES = {
    "nodes": (beside_a_tool, {}, DOWN),  # the top's
    "Gauss points": (beside_a_tool, {"points": 2}, (1 + 3**-0.5) / 2 * DOWN),  # of the cells that the top moves
    "averages": (beside_a_body, {}, None),
    "Gauss points on facets": (beside_a_body, {"points": 1}, None),
    "Gauss points on facets of degree 2": (beside_a_body, {"points": 2, "degree": 2}, None),
}


@pytest.mark.parametrize("case", CASES)
def test_ways_slid_are_those_of_the_motion(case):
    """Each augmentation presses more, and what sticks in one slips in the next: whatever they do on the way, points have
    slid as far as they are led, in any number of steps, and friction has taken what is left of the work."""
    beside, options, led = CASES[case]
    slips, allowed = [], 1e-5
    for steps in (1, 4, 16):
        scene = beside(1000.0, penetration=allowed, **options)
        result = solve(scene, steps=steps).require()
        row = result.history[-1]
        assert not any("is not kept" in note for note in result.verdict.notes), result.verdict.notes
        slips.append(row["wall_greatest_slip_mm"])
        # a force grows with the way but for the allowance's share of that
        missing, work = row["energy_error_Nmm"], row["external_work_Nmm"]
        assert abs(missing) < allowed / DOWN * work and row["wall_friction_work_Nmm"] > 0.03 * work
    np.testing.assert_allclose(slips, slips[0] if led is None else led, atol=allowed)


def box_of(bulk, mu, **options):
    """A cube in the corner of three planes of symmetry and three walls, of which the lid comes down; its drive."""
    scene = Scene(Body(read_gmsh(box.build, size=(2, 2, 2), cells=(3, 3, 3)), "box", neo_hooke(1.0, bulk)), element="mixed")
    tools = []
    for i, axis in enumerate("xyz"):
        scene.fix(f"{axis}min", axis)
        tools.append(rigid_plane(2.0 * np.eye(3)[i], -np.eye(3)[i], name=f"{axis}_wall"))
        scene.contact(f"{axis}max", tools[-1], friction=mu, name=axis, **options)
    return scene, {tools[2]: (0, 0, -DOWN)}


def boxed(*args, **options):
    """(force on the lid, result) of such a box."""
    scene, move = box_of(*args, **options)
    result = solve(scene, move=move, steps=4).require()
    return -result.history[-1]["z_force_z_N"], result


def test_rubber_that_cannot_escape_is_held_as_the_closed_form_says():
    """Its bulk modulus makes it 5000 / 3 times as stiff as Young's modulus tells the penalty: an augmentation gains 6 %, and
    on the way multipliers on a penalty so soft would turn it aside."""
    bulk, J, allowed = 5000.0, 1.0 - DOWN / 2.0, 1e-6
    # psi = mu/2 (J^-2/3 I1 - 3) + K/2 (J - 1)^2 under diag(1, 1, J), mu = 1
    shear = J ** (1 / 3) - (2.0 + J**2) / 3.0 * J ** (-5 / 3)
    force, result = boxed(bulk, 0.0, penetration=allowed)
    # three pairs of walls, each nearer by as much as is allowed
    np.testing.assert_allclose(force, -4.0 * (shear + bulk * (J - 1.0)), rtol=3.0 * allowed / DOWN)
    assert not result.verdict.cuts and any("raised to 100 times the default" in note for note in result.verdict.notes)


def test_rubber_that_cannot_escape_rubs_as_on_stiff_penalties():
    force, result = boxed(5000.0, 0.3, penetration=1e-6)
    stiff, _ = boxed(5000.0, 0.3, penalty=Penalty(factor=1e5), penetration=1e-5)
    np.testing.assert_allclose(force, stiff, rtol=3e-5 / DOWN)
    assert max(result.history[-1][f"{axis}_penetration_mm"] for axis in "xyz") <= 1e-6
    assert abs(result.history[-1]["energy_error_Nmm"]) < 1e-3 * result.history[-1]["external_work_Nmm"]


def test_typed_penalties_stay_under_multipliers():
    _, result = boxed(1000.0, 0.0, penalty=Penalty(factor=100.0), penetration=1e-4)
    assert result.verdict.augmentations > 20  # though they gain little
    assert all(contact["penalty_raised"] == 1.0 for contact in result.summary["scene"]["contacts"])


def test_what_ends_far_from_its_penetration_does_not_vouch_for_its_force():
    """On typed penalties so soft that multipliers turn the cube aside the force is a third off; the remedy is run above."""
    force, result = boxed(5000.0, 0.3, penalty=Penalty(factor=100.0), penetration=1e-6)
    assert force < 0.9 * boxed(5000.0, 0.3, penetration=1e-6)[0]
    said = [note for note in result.verdict.notes if "its force may be far off" in note]
    assert len(said) == 3 and all("leave its penalty= out" in note for note in said)
    for axis in "xyz":  # the first step that ends so is a note, and how many more do
        first, more = (note for note in result.verdict.notes if f"contact '{axis}': penetration= is not kept" in note)
        assert "leave its penalty= out" in first and " more step" in more
    assert not any("change the force by" in note for note in result.verdict.notes)


def test_a_penalty_softer_than_the_body_says_what_it_costs():
    """Springs in series: of a penalty that carries a fraction of the load the first order tells three quarters of that."""
    soft, result = boxed(5000.0, 0.0)
    stiff, _ = boxed(5000.0, 0.0, penetration=1e-6)
    (note,) = (note for note in result.verdict.notes if note.startswith("contact 'z': its penalties change the force by"))
    said = float(note.split("about ")[1].split("%")[0]) / 100.0
    np.testing.assert_allclose(said, stiff / soft - 1.0, rtol=0.1)


def pushed_to_and_fro(steps, **options):
    """A block that friction alone holds, under dead loads: pressed, and pushed by 0.4 of that to and fro, twice. Returns the
    result, and how far its top is off at the end of each of these stages."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((-2.0, 0.0), (4.0, 1.0), (8, 4))})
    scene = Scene(Body(mesh, "b", neo_hooke(1.0, 3.0)), plane="strain")
    scene.traction("b_ymax", (0, 0, 0))
    scene.contact("b_ymin", rigid_plane((0, 0, 0), (0, 1, 0), name="floor"), friction=0.5, name="c", **options)
    stages = [Stage("press", tractions={"b_ymax": (0, -0.2, 0)}, steps=steps)]
    stages += [Stage(f"push {i}", tractions={"b_ymax": (0.08 * (-1) ** i, -0.2, 0)}, steps=steps) for i in range(4)]
    top = {"top": lambda view: view.at("b_ymax").displacement[0]}
    result = solve(scene, stages=stages, record=top).require()
    assert not any("is not kept" in note for note in result.verdict.notes), result.verdict.notes
    assert not any("cut-back" in note for note in result.verdict.notes), result.verdict.notes
    np.testing.assert_allclose(result.column("c_force_x_N")[-1], 0.32, rtol=1e-6)  # by statics
    return result, np.array(result.column("top"))[2 * steps - 1 :: steps]


@pytest.mark.parametrize("allowed", [1e-3, 1e-5])
def test_a_block_that_friction_alone_holds_does_not_fly(allowed):
    """What multipliers take over acts twice at first: beyond friction's limit, where it holds by four fifths of that."""
    _, stiff = pushed_to_and_fro(3, penalty=Penalty(factor=1e5))  # by which the elastic slip is some 1e-6
    for steps in (3, 6):
        np.testing.assert_allclose(pushed_to_and_fro(steps, penetration=allowed)[1], stiff, atol=allowed)


@pytest.mark.parametrize("steps", [3, 6])
@pytest.mark.parametrize("penalty", [None, Penalty(factor=1e3)])
def test_penalties_do_not_change_a_force_that_statics_give(steps, penalty):
    """Points come back to where they were when they slipped last: they stick there, on their limit of friction."""
    result, _ = pushed_to_and_fro(steps, penalty=penalty)
    assert result.summary["penalty_error"]["contacts"]["c"]["force_change_over_load"] < 1e-6
    assert not any("change the force" in note for note in result.verdict.notes)


class Stumbling(Newton):
    """Fails in the first solve with greater penalties."""

    raised = 0

    def settle(self, system, t):
        self.raised += 1
        if self.raised == 1:
            system.state.u.x.array[:] += 1.0
            raise StepFailed("stumbled")
        return super().settle(system, t)


def test_a_raise_that_cannot_be_solved_is_forgone():
    """Multipliers go on from where they were, on the penalties that they had; later steps may raise these less."""
    scene, move = box_of(1000.0, 0.0, penetration=1e-4)
    system = scene.system(move=move)
    stepper = Augmented(Stumbling(LinearSolver(system)))
    report = stepper.step(system, 0.25)
    assert stepper.stepper.raised == 1 and report.misfits[-1] <= 1.0 and not report.said
    assert all(contact.penalties.raise_factor(system.state) == 1.0 for contact in system.contact_terms)
    assert all(contact.penalties.room(system.state) == 100.0 for contact in system.contact_terms)
