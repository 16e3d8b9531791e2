"""Bodies that touch and carry nothing: when one moves aside or off, nothing happens, whatever the friction."""

import gmsh
import numpy as np
import pytest
from drawn import ring

from fenics_contact import (
    Body,
    Motion,
    Output,
    Result,
    Scene,
    Stage,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    rigid_surface,
    solve,
)
from fenics_contact.contact.tools import Tool
from fenics_contact.meshes import box, rectangles

pytestmark = pytest.mark.parallel
QUIET, MU = Output(progress=False), 0.3
TOUCHES = "carries no more than rounding"


def notes(result: Result, words: str) -> list[str]:
    return [note for note in result.verdict.notes if words in note]


def nothing_happens(result: Result, load: str, size: float = 1.0) -> None:
    """In a solve or two a step; size: of a body [length], of a shear modulus of about 1 on it [force/length^2]."""
    assert result.converged and result.verdict.iterations <= 2 * len(result.history)
    assert not notes(result, "cut-back") and not notes(result, "softer penalties") and not notes(result, "nodes carry")
    assert np.abs(result.column(load)).max() < 1e-9 * size**2
    assert result.column("strain_energy_Nmm").max() < 1e-12 * size**3


def floor() -> None:
    """A square of 16 facets in the plane z = 0 that look up."""
    surface = gmsh.model.occ.addRectangle(-4.0, -4.0, 0.0, 8.0, 8.0)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.setTransfiniteSurface(surface)
    for _, curve in gmsh.model.getEntities(1):
        gmsh.model.mesh.setTransfiniteCurve(curve, 5)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [surface]), "floor")
    gmsh.model.mesh.generate(2)


def lidded(size: float = 1.0, degree: int = 1, points: int | str = "nodes") -> tuple[Scene, Tool]:
    """A pad on the ground, ten times `size` wide, and a rough lid that lies on it."""
    shape = {"pad": ((0.0, 0.0), (10.0 * size, 5.0 * size), (8, 4))}
    scene = Scene(
        Body(read_gmsh(rectangles.build, rectangles=shape), "pad", neo_hooke(0.5, 3.0)), plane="strain", degree=degree
    )
    scene.fix("pad_ymin")
    lid = rigid_plane((0.0, 5.0 * size, 0.0), normal=(0, -1, 0), name="lid")
    scene.contact("pad_ymax", lid, friction=MU, name="lid", points=points)
    return scene, lid


@pytest.mark.parametrize("way", [(0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.5, 1e-3, 0.0)])
@pytest.mark.parametrize("kind", [{}, {"points": 3}, {"degree": 2}])
def test_a_lid_that_lies_on_a_pad_slides_and_lifts(kind, way):
    """What touched stuck though friction of no pressure is none, and was dragged: 197 tangents to slide, 10 to lift, and a
    note on Newton's method that failed."""
    scene, lid = lidded(**kind)
    result = solve(scene, move={lid: way}, steps=2, out=QUIET)
    nothing_happens(result, "lid_load_N")
    assert len(notes(result, "never closed")) == 1 and bool(notes(result, TOUCHES)) == (way[1] == 0.0)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e6])
def test_so_it_does_of_any_size(size):
    scene, lid = lidded(size)
    nothing_happens(solve(scene, move={lid: (0.5 * size, 0.0, 0.0)}, steps=2, out=QUIET), "lid_load_N", size)


@pytest.mark.parametrize(
    ("points", "meshed"), [("nodes", False), (3, False), ("nodes", True), (3, True), ("averages", True)]
)
def test_a_floor_slides_beneath_a_box_before_it_presses(points, meshed):
    """2 mm under a box of 3 mm that is held above; then it is pressed in, as it would be without (297 tangents)."""
    mesh, forces = read_gmsh(box.build, size=(3, 3, 1), cells=(4, 4, 2), origin=(-1.5, -1.5, 0)), []
    for slide in ((2.0, 0.0, 0.0), (0.0, 0.0, 0.0)):  # by a facet of the floor, of which averages know
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 3.0)))
        scene.fix("zmax")
        tool = rigid_surface(floor, "floor", name="tool") if meshed else rigid_plane(name="tool")
        scene.contact("zmin", tool, friction=MU, name="c", points=points)
        aside = solve(scene, move={tool: slide}, steps=4, out=QUIET)
        nothing_happens(aside, "c_load_N")
        pressed = solve(scene, move={tool: (0, 0, 0.1)}, steps=2, out=QUIET, start=aside).require()
        assert not notes(pressed, "never closed")
        forces.append([pressed.column(f"c_force_{axis}_N")[-1] for axis in "xyz"])
    assert np.allclose(*forces, rtol=0.0, atol=1e-6 * np.abs(forces).max())


@pytest.mark.parametrize(("degree", "stiffer"), [(1, 1.0), (2, 1.0), (1, 1e4)])
def test_a_block_is_dragged_along_another_that_it_does_not_press(degree, stiffer):
    """Their loads are 1e-13 ... 1e-9 N of rounding: it was said that three nodes carry all of it, or nothing."""
    mesh = read_gmsh(rectangles.build, rectangles={"a": ((0, -1), (3, 1), (9, 3)), "b": ((0.5, 0), (2, 1), (8, 4))})
    bodies = Body(mesh, "a", neo_hooke(1.0, 3.0)), Body(mesh, "b", neo_hooke(stiffer, 3.0 * stiffer))
    scene = Scene(*bodies, plane="strain", degree=degree)
    scene.fix("a_ymin")
    scene.prescribe("b_ymax", "x", 0.4)
    scene.prescribe("b_ymax", "y", 0.0)
    scene.contact("b_ymin", "a_ymax", friction=MU, name="c")
    result = solve(scene, steps=3, out=QUIET)
    assert result.converged and result.verdict.iterations <= 15 and np.abs(result.column("c_load_N")).max() < 1e-9 * stiffer
    assert len(result.verdict.notes) == 1 and notes(result, TOUCHES), result.verdict.notes


def test_a_contact_that_carried_in_the_run_before_is_not_said_never_to_have_closed():
    scene, lid = lidded()
    pressed = solve(scene, move={lid: (0, -0.1, 0)}, steps=2, out=QUIET).require()
    lifted = solve(scene, move={lid: (0, 0.5, 0)}, steps=1, out=QUIET, start=pressed).require()
    assert lifted.column("lid_load_N").max() == 0.0 and not notes(lifted, "never closed")


@pytest.mark.parametrize("weight", [1e-2, 1e-8])
def test_a_light_block_that_only_its_weight_presses_rubs_by_it(weight):
    """It lies on the floor, held sideways at one end, and the floor is drawn away beneath it: T = mu N, however small."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((0.0, 0.0), (4.0, 1.0), (8, 2))})
    scene = Scene(Body(mesh, "b", neo_hooke(1.0, 3.0)), plane="strain")
    scene.fix("b_xmin", "x")
    plane = rigid_plane((0, 0, 0), normal=(0, 1, 0), name="floor")
    scene.contact("b_ymin", plane, friction=MU, name="c")
    scene.body_force((0.0, -weight / 4.0, 0.0))
    result = solve(scene, move={plane: (0.5, 0.0, 0.0)}, steps=4, out=QUIET).require()
    normal, along = result.column("c_force_y_N")[-1], result.column("c_force_x_N")[-1]
    assert not notes(result, "never closed")
    assert normal == pytest.approx(weight, rel=1e-6) and along == pytest.approx(MU * weight, rel=1e-6)


@pytest.mark.parametrize("steps", [1, 2])
def test_a_wheel_that_may_turn_is_carried_over_a_road_that_it_touches(steps):
    """It does not turn (-0.2 and -0.1 rad in 1 and 2 steps, and then as much more or less where it rolls)."""
    mesh = read_gmsh(lambda: ring("tyre", 5.0, (3.0, 5.0), (2, 8), ("bore", "tread")))
    scene = Scene(Body(mesh, "tyre", neo_hooke(0.5, 5.0)), plane="strain")
    hub = rigid_hub("hub", (0.0, 5.0, 0.0))
    scene.tie("bore", hub)
    scene.contact("tread", rigid_plane((0, 0, 0), normal=(0, 1, 0)), friction=MU, name="c")
    stages = [
        Stage("carry", move={hub: Motion(x=1.0, free="rz")}, steps=steps),
        Stage("press", move={hub: Motion(y=-0.3)}, steps=4),
        Stage("roll", move={hub: Motion(x=3.0, free="rz")}, steps=8),
    ]
    result = solve(scene, stages=stages, out=QUIET).require()
    turned = result.column("hub_angle_z_rad")
    assert np.abs(turned[:steps]).max() < 1e-9 and turned[-1] == pytest.approx(-0.5729, rel=1e-3)


@pytest.mark.parametrize("aside", [0.0, 1.0])
def test_what_lies_on_a_floor_without_weight_is_held_by_it_once_it_has_some(aside):
    """Solves of a step without load leave a free body some roundings off the floor, and then nothing held it."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((-5.0, 0.0), (10.0, 5.0), (8, 4))})
    scene = Scene(Body(mesh, "b", neo_hooke(0.5, 5.0)), plane="strain")
    scene.body_force((0.0, 0.0, 0.0))
    plane = rigid_plane((0, 0, 0), normal=(0, 1, 0), name="floor")
    scene.contact("b_ymin", plane, friction=MU, name="c")
    stages = [
        Stage("weightless", move={plane: (aside, 0.0, 0.0)} if aside else {}, steps=2),
        Stage("heavy", body_force=(0.0, -0.02, 0.0), steps=3),
    ]
    assert solve(scene, stages=stages, out=QUIET).require().column("c_force_y_N")[-1] == pytest.approx(1.0, rel=1e-6)
