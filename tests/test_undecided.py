"""Contacts that hold bodies between them and have used up their friction: the note that the path may branch, and what is
thrown out between them."""

import gmsh
import numpy as np
import pytest
from drawn import ring, straight

from fenics_contact import (
    Body,
    Method,
    Motion,
    Scene,
    Stage,
    neo_hooke,
    read_gmsh,
    rigid_curve,
    rigid_extrusion,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.assembly.finding import SLIDES
from fenics_contact.meshes import box, rectangles
from fenics_contact.solvers.undecided import ASIDE

pytestmark = pytest.mark.parallel
RUBBER = neo_hooke(mu=0.5, K=2.0)
MU = 0.3


def told(result):
    """The notes of a run that may branch."""
    return [note for note in result.verdict.notes if "the path may branch here" in note]


def block(drag, below=MU, steps=10):
    """A block between a floor and a lid that presses and then goes on by `drag`."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 3.0, 2.0), cells=(4, 3, 2)), "box", RUBBER))
    lid = rigid_plane((0, 0, 2), normal=(0, 0, -1), name="lid")
    scene.contact("zmin", rigid_plane((0, 0, 0), normal=(0, 0, 1), name="floor"), below, name="floor")
    scene.contact("zmax", lid, MU, name="lid")
    stages = [Stage("press", move={lid: (0, 0, -0.1)}, steps=2), Stage("drag", move={lid: drag}, steps=steps)]
    return solve(scene, stages=stages, method=Method(stabilise=True))


@pytest.mark.parametrize(("below", "notes"), [(MU, 1), (1.01 * MU, 1), (1.1 * MU, 0), (2.0 * MU, 0)])
def test_of_two_contacts_as_rough_nothing_says_which_slides(below, notes):
    """With frictions a tenth apart the answer hangs on the steps by 0.1 %, a hundredth apart by 1.4 %."""
    found = told(block((1.0, 0, 0), below))
    assert len(found) == notes
    assert all("contacts 'floor' and 'lid' hold body 'box'" in note for note in found)


def test_nor_which_turns():
    """Points at the centre always stick."""
    assert len(told(block(Motion(about=(2, 1.5, 2), rz=0.5)))) == 1


def stacked(between):
    """Two bodies, one on the other, between a floor and a lid that goes along."""
    mesh = read_gmsh(rectangles.build, rectangles={name: ((-2.0, i), (4.0, 1.0), (6, 2)) for i, name in enumerate("ab")})
    scene = Scene(*(Body(mesh, name, RUBBER) for name in "ab"), plane="strain")
    lid = rigid_plane((0, 2, 0), normal=(0, -1, 0), name="lid")
    scene.contact("a_ymin", rigid_plane((0, 0, 0), normal=(0, 1, 0), name="floor"), MU, name="floor")
    scene.contact("b_ymin", "a_ymax", between, name="between")
    scene.contact("b_ymax", lid, MU, name="lid")
    stages = [Stage("press", move={lid: (0, -0.1, 0)}, steps=2), Stage("drag", move={lid: (1.0, 0, 0)}, steps=10)]
    return solve(scene, stages=stages, method=Method(stabilise=True))


def test_two_bodies_that_stick_together_are_held_as_one():
    found = told(stacked(1.0))
    assert len(found) == 1 and "contacts 'floor' and 'lid' hold body 'a', body 'b'" in found[0]


def chamfered():
    """A block whose left side touches neither floor nor lid."""
    corners = [(0, 0.6), (0.6, 0), (4, 0), (4, 2), (0.6, 2), (0, 1.4)]
    points = [gmsh.model.geo.addPoint(x, y, 0, 0.5) for x, y in corners]
    lines = [gmsh.model.geo.addLine(points[i], points[(i + 1) % 6]) for i in range(6)]
    surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    gmsh.model.geo.synchronize()
    gmsh.option.setNumber("Mesh.RecombineAll", 1)
    gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 1)
    gmsh.model.mesh.generate(2)
    for name, line in (("bottom", lines[1]), ("top", lines[3]), ("left", lines[5])):
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [line]), name)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [surface]), "block")


def test_a_hub_that_nothing_holds_holds_nothing():
    scene = Scene(Body(read_gmsh(chamfered), "block", RUBBER), plane="strain")
    lid, hub = rigid_plane((0, 2, 0), normal=(0, -1, 0), name="lid"), rigid_hub("hub", point=(0, 1, 0))
    scene.contact("bottom", rigid_plane((0, 0, 0), normal=(0, 1, 0), name="floor"), MU, name="floor")
    scene.contact("top", lid, MU, name="lid")
    scene.tie("left", hub)
    along = Motion(free="x y rz")
    stages = [
        Stage("press", move={lid: (0, -0.1, 0), hub: along}, steps=2),
        Stage("drag", move={lid: (1.0, 0, 0), hub: along}, steps=10),
    ]
    found = told(solve(scene, stages=stages))
    assert len(found) == 1 and "contacts 'floor' and 'lid' hold body 'block', tool 'hub'" in found[0]


def bar(steps):
    """A free bar between two pads, of which the upper one goes along."""
    mesh = read_gmsh(rectangles.build, rectangles={"lo": ((-3, 0), (6, 1), (15, 3)), "up": ((-3, 2), (6, 1), (15, 3))})
    scene = Scene(*(Body(mesh, name, RUBBER) for name in ("lo", "up")), plane="strain")
    scene.fix("lo_ymin"), scene.fix("up_ymax")
    corners = [(-1.5, 1, 0.2), (-1.5, 2, 0.2), (1.5, 2, 0.2), (1.5, 1, 0.2)]
    tool = rigid_extrusion(corners, origin=(0, 0, 0), along=(0, 0, -1), up=(0, 1, 0), closed=True, name="bar")
    scene.contact("lo_ymax", tool, MU, name="below")
    scene.contact("up_ymin", tool, MU, name="above")
    stages = [
        Stage("press", move={tool: Motion(free="y")}, prescribe={("up_ymax", "y"): -0.2}, steps=4),
        Stage("drag", move={tool: Motion(free="x y")}, prescribe={("up_ymax", "x"): 1.0}, steps=steps),
    ]
    return solve(scene, stages=stages, method=Method(stabilise=True))


def test_a_free_tool_is_told_and_not_thrown_away():
    """Ten steps threw it out by 3.9 mm, where nothing held it; half of the way is what more steps give."""
    result = bar(10)
    assert "contacts 'below' and 'above' hold tool 'bar'" in told(result)[0]
    assert result.column("bar_travel_x_mm")[-1] == pytest.approx(0.5, abs=0.01)


def test_a_second_pair_of_contacts_has_a_note_of_its_own():
    """Floor and lid let go of the block; two walls have gripped it, and one goes along."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 3.0, 2.0), cells=(4, 3, 2)), "box", RUBBER))
    places = {
        "floor": ("zmin", (0, 0, 0), (0, 0, 1)),
        "lid": ("zmax", (0, 0, 2), (0, 0, -1)),
        "left": ("ymin", (0, -0.1, 0), (0, 1, 0)),
        "right": ("ymax", (0, 3.1, 0), (0, -1, 0)),
    }
    tools = {name: rigid_plane(point, normal=normal, name=name) for name, (_, point, normal) in places.items()}
    for name, (group, _, _) in places.items():
        scene.contact(group, tools[name], MU, name=name)
    stages = [
        Stage("press", move={tools["lid"]: (0, 0, -0.1)}, steps=2),
        Stage("drag", move={tools["lid"]: (0.4, 0, 0)}, steps=4),
        Stage("grip", move={tools["left"]: (0, 0.2, 0), tools["right"]: (0, -0.2, 0)}, steps=2),
        Stage("let go", move={tools["lid"]: (0, 0, 0.5), tools["floor"]: (0, 0, -0.4)}, steps=2),
        Stage("drag along", move={tools["right"]: (1.0, 0, 0)}, steps=10),
    ]
    found = told(solve(scene, stages=stages, method=Method(stabilise=True)))
    assert [next(pair for pair in ("'floor' and 'lid'", "'left' and 'right'") if pair in note) for note in found] == [
        "'floor' and 'lid'",
        "'left' and 'right'",
    ]


def test_contacts_that_resist_the_same_push_must_both_slide():
    """A smooth wall pushes the block between two fixed plates: no choice, no note."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 3.0, 2.0), cells=(4, 3, 2)), "box", RUBBER))
    wall = rigid_plane((0, 0, 0), normal=(1, 0, 0), name="wall")
    lid = rigid_plane((0, 0, 2), normal=(0, 0, -1), name="lid")
    scene.contact("zmin", rigid_plane((0, 0, 0), normal=(0, 0, 1), name="floor"), MU, name="floor")
    scene.contact("zmax", lid, MU, name="lid")
    scene.contact("xmin", wall, name="wall")
    stages = [Stage("press", move={lid: (0, 0, -0.1)}, steps=2), Stage("push", move={wall: (1.0, 0, 0)}, steps=10)]
    result = solve(scene, stages=stages, method=Method(stabilise=True))
    assert not told(result)
    grip = MU * np.array([result.column(f"{name}_load_N")[-1] for name in ("floor", "lid")])
    drag = [abs(result.column(f"{name}_friction_x_N")[-1]) for name in ("floor", "lid")]
    np.testing.assert_allclose(drag, grip, rtol=1e-3)  # both do slide


def arch(stabilise):
    """Half a ring that stands on a rough flat tool, spread by a smooth lid; how far its crown goes aside."""
    mesh = read_gmsh(lambda: ring("arch", 0.0, (4.0, 5.0), (2, 12), ("inside", "back"), ends="feet"))
    scene = Scene(Body(mesh, "arch", neo_hooke(0.5, 5.0)), plane="strain")
    ground = rigid_curve(lambda: straight("flat", (14, 0), (-14, 0), 22), group="flat", name="ground")
    lid = rigid_plane((0, 5, 0), normal=(0, -1, 0), name="lid")
    scene.contact("feet", ground, MU, name="feet")
    scene.contact("back", lid, name="lid")
    crown = {"x": lambda view: view.at((0.0, 5.0, 0.0)).displacement[0]}
    method = Method(stabilise=stabilise)
    result = solve(scene, move={lid: (0, -1.5, 0)}, steps=5, method=method, record=crown)
    return result, np.abs(result.column("x")).max()


def test_nor_which_side_of_one():
    """Both feet slide outwards, and nothing says by how much each: the crown goes aside as the steps happen to fall, both
    slide alike, as they should, or both do in an iterate, in which nothing holds the arch between them: which of these is up
    to rounding, and what goes aside by more than some hundredths of the way is told."""
    result, aside = arch(stabilise=False)
    notes = told(result)
    assert all("contact 'feet' holds body 'arch' between its sides" in note for note in notes)
    if result.converged:
        assert notes or aside < ASIDE * result.system.scales.moved
    else:
        assert result.verdict.kind == SLIDES and "stabilise=True" in result.verdict.remedy
    result, aside = arch(stabilise=True)
    assert result.converged and not told(result) and aside < 1e-6
