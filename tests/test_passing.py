"""Analytic tools that a step would carry through a thin body: refused, so that the force is that of many small steps."""

import numpy as np
import pytest

from fenics_contact import (
    Body,
    Scene,
    Stage,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_extrusion,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.assembly.pose import rotation
from fenics_contact.contact.passing import Facets, depths_passed
from fenics_contact.meshes import box, rectangles

pytestmark = pytest.mark.parallel

ALONG_Z = {"along": (0.0, 0.0, -1.0), "up": (0.0, 1.0, 0.0), "closed": True}
HARD, SOFT = neo_hooke(mu=20.0, K=60.0), neo_hooke(mu=1.0, K=5.0)


def roller(radius=1.0, x=0.0, y=1.6, hollow=False):
    return rigid_cylinder(radius, (x, y, 0.0), (0, 0, 1), hollow=hollow, name="tool")


def blade():
    """Lying on its broad side."""
    return rigid_extrusion([(-2, 0.6, 0.3), (-2, 1.3, 0.3), (2, 1.3, 0.3), (2, 0.6, 0.3)], name="tool", **ALONG_Z)


def wedge():
    """On its tip: all that passes it enters and leaves through walls that are steep."""
    corners = [(-0.5, 1.8, 0.1), (0, 3, 0.1), (0.5, 1.8, 0.1), (0, 0.6, 0.1)]
    return rigid_extrusion(corners, name="tool", **ALONG_Z)


def over_a_strip(tool, drop, steps, points=None, touched=0.0, cells=(40, 2)):
    """A tool that comes down on a strip held at its ends, which it has touched before where that is asked for."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((-10, 0), (20, 0.5), cells)})
    scene = Scene(Body(mesh, "b", HARD), plane="strain")
    scene.fix("b_xmin")
    scene.fix("b_xmax")
    scene.contact("b_ymax", tool, friction=0.1, points=points, name="c")
    before = [
        Stage("touch", move={tool: (0, -touched, 0)}, steps=2),
        Stage("lift", move={tool: (0, 2 * touched, 0)}, steps=1),
    ]
    drop = Stage("drop", move={tool: (0, -drop, 0)}, steps=steps)
    return solve(scene, stages=[*(before if touched else []), drop])


def beside_a_finger(steps, way):
    """A roller that comes from the left, and passes or bends a thin finger on its foot."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((-0.2, 0), (0.4, 4), (2, 16))})
    scene = Scene(Body(mesh, "b", SOFT), plane="strain")
    scene.fix("b_ymin")
    tool = roller(0.5, -0.8, 3.0)
    scene.contact(("b_xmin", "b_ymax"), tool, friction=0.1, name="c")
    return solve(scene, move={tool: way}, steps=steps)


def over_a_plate(steps, points=None):
    """A ball that comes down on a plate held at two ends."""
    scene = Scene(Body(read_gmsh(box.build, size=(8.0, 3.0, 0.3), cells=(16, 6, 2)), "box", HARD))
    scene.fix("xmin")
    scene.fix("xmax")
    tool = rigid_sphere(1.0, (4, 1.5, 1.4), name="tool")
    scene.contact("zmax", tool, friction=0.1, points=points, name="c")
    return solve(scene, move={tool: (0, 0, -2.9)}, steps=steps)


@pytest.mark.parametrize(
    "run, many, axis",
    [
        pytest.param(lambda n: over_a_strip(roller(), 4.0, n, touched=0.15), 8, "y", id="roller"),
        pytest.param(lambda n: over_a_strip(blade(), 2.0, n, points=2), 8, "y", id="blade"),
        pytest.param(lambda n: over_a_strip(wedge(), 4.0, n, cells=(80, 3)), 16, "y", id="wedge", marks=pytest.mark.slow),
        pytest.param(lambda n: beside_a_finger(n, (1.6, 0, 0)), 8, "x", id="finger"),
        pytest.param(over_a_plate, 10, "z", id="ball", marks=pytest.mark.slow),
    ],
)
def test_one_step_that_would_pass_through_ends_with_the_force_of_many(run, many, axis):
    one, steady = run(1).require(), run(many).require()
    force = [result.column(f"c_force_{axis}_N")[-1] for result in (one, steady)]
    assert "projection lost" in one.verdict.causes and abs(force[1]) > 1e-3
    assert force[0] == pytest.approx(force[1], rel=2e-3)  # friction remembers the way: 6e-5 for the ball, else 1e-9
    assert not any("never closed" in note for note in one.verdict.notes)


def under_a_foil(**options):
    """A tool that is nowhere deep is pressed on a block."""
    foil = rigid_extrusion([(-9, 0.6), (-9, 0.62), (9, 0.62), (9, 0.6)], name="foil", **ALONG_Z)
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((-5, 0), (10, 0.5), (20, 2))})
    scene = Scene(Body(mesh, "b", HARD), plane="strain")
    scene.fix("b_ymin")
    scene.contact("b_ymax", foil, name="c", **options)
    return solve(scene, move={foil: (0, -0.3, 0)}, steps=3)


def test_a_tool_that_no_step_holds_is_named_and_the_remedy_holds_it():
    verdict = under_a_foil(penalty=0.5).verdict
    assert verdict.kind == "projection lost" and "come out behind the surface" in verdict.reason
    assert "contact 'c' at (" in verdict.place and "raise the penalty" in verdict.remedy
    feeble = under_a_foil(penalty=1e-2).verdict  # told as such, and with what came of it
    assert feeble.kind == "penalty too soft" and "come out behind the surface" in feeble.reason
    assert under_a_foil(penalty=3e4).require().column("c_force_y_N")[-1] < 0.0


def test_a_tool_led_round_a_finger_does_not_touch_it():
    """Up, across and down in one step: the straight way between its ends leads through the finger, and no short one does."""

    def way(t):
        return (6.0 * min(max(t - 0.3, 0.0), 0.4), 9.0 * min(t, 0.3, 1.0 - t), 0.0)

    result = beside_a_finger(1, way).require()
    assert np.abs(result.column("c_force_x_N")).max() == 0.0 and result.column("tool_travel_x_mm")[-1] == pytest.approx(2.4)
    assert set(result.verdict.causes) <= {"projection lost"}


def test_a_block_dragged_far_along_a_plane_is_not_held_up():
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((0, 0), (2, 1), (4, 2))})
    scene = Scene(Body(mesh, "b", SOFT), plane="strain")
    scene.fix("b_ymax")
    floor = rigid_plane(normal=(0, 1, 0), name="floor")
    scene.contact(("b_ymin", "b_xmin", "b_xmax"), floor, friction=0.3, name="c")
    stages = [Stage("press", move={floor: (0, 0.1, 0)}, steps=1), Stage("drag", move={floor: (50, 0, 0)}, steps=1)]
    result = solve(scene, stages=stages).require()
    assert "projection lost" not in result.verdict.causes and result.column("c_force_x_N")[-1] > 0.0


# -- ways of a straight piece of a surface, in the tool's frame --------------------------------------------------------
def depth(tool, then, now):
    """Greatest depth [length] for an even facet between two places (2, 2), then and now, with the body on its left."""
    t = np.linspace(0.05, 0.95, 19)[:, None]
    a, gradients = np.hstack([1.0 - t, t]), np.broadcast_to([[-1.0, 1.0]], (19, 1, 2))
    ends = [np.pad(np.array([x], dtype=float), ((0, 0), (0, 0), (0, 1))) for x in (then, now)]
    facets = Facets(a[None], gradients[None], ends[0])
    frame = tool.kind, tool.shape, tool.origin, tool.axes, np.zeros(3)
    return float(depths_passed(facets, *ends, frame, 0.1)[0].max(initial=0.0))


def turned(places, degrees):
    return np.array(places) @ rotation(np.radians([0.0, 0.0, degrees])).T[:2, :2]


BELOW, ABOVE = [(0.5, -1.1), (-0.5, -1.1)], [(0.5, 3.0), (-0.5, 3.0)]  # a top side, whose body is beneath it


def test_what_comes_out_behind_the_surface_was_passed_through():
    tool = roller(y=0.0)
    assert depth(tool, BELOW, ABOVE) == pytest.approx(1.0, rel=1e-2)
    assert depth(tool, BELOW, [(0.5, 0.8), (-0.5, 0.8)]) > 0.9, "pressed from behind by what it has not left yet"
    assert depth(tool, turned(BELOW, 40), turned(ABOVE, 40)) > 0.9
    far = [(x, y - 100.0) for x, y in BELOW], [(x, y + 50.0) for x, y in ABOVE]
    assert depth(tool, *far) > 0.9 and depth(blade(), *far) == pytest.approx(0.35, rel=1e-2)
    assert depth(wedge(), *far) > 0.2


@pytest.mark.parametrize(
    "tool, then, now",
    [
        pytest.param(roller(y=0.0), ABOVE, BELOW, id="comes back through its body"),
        pytest.param(roller(y=0.0), turned(BELOW, -60), turned(BELOW, 60), id="slides round a roller"),
        pytest.param(roller(y=0.0), turned(BELOW, -85), turned(BELOW, 85), id="turns round a pin"),
        pytest.param(roller(y=0.0), [(9, -0.7), (8, -0.7)], [(-8, -0.9), (-9, -0.9)], id="rolled over by a wheel"),
        pytest.param(roller(y=0.0), BELOW, [(0.5, -1.3), (-0.5, -1.3)], id="leaves"),
        pytest.param(roller(4.0, y=0.0, hollow=True), BELOW, ABOVE, id="within a bore"),
        pytest.param(rigid_plane(normal=(0, 1, 0)), [(8, 0), (9, 0)], [(-8, 0), (-7, 0)], id="along a plane"),
        pytest.param(rigid_plane(normal=(0, 1, 0)), [(8, 9), (9, 9)], [(-8, -1), (-7, -1)], id="sunk into a plane"),
        pytest.param(wedge(), [(-8, 2.9), (-7, 2.9)], [(7, 2.9), (8, 2.9)], id="over a ridge"),
    ],
)
def test_what_turns_its_front_to_the_tool_as_it_leaves_was_not(tool, then, now):
    assert depth(tool, then, now) == 0.0
