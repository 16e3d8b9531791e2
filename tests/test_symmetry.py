"""Parts that stand for a whole: what does not go with their planes of symmetry, or with what repeats, is told."""

import gmsh
import numpy as np
import pytest
from test_pairs import bulged, tube

from fenics_contact import (
    Body,
    Motion,
    Scene,
    Stage,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_punch,
    rigid_surface,
    solve,
)
from fenics_contact.meshes import box, rectangles, tubes
from fenics_contact.scene.build import build

pytestmark = pytest.mark.parallel


def notes_of(result, *words):
    return [note for note in result.verdict.notes if all(word in note for word in words)]


@pytest.mark.parametrize("free", ["", "x"])
def test_a_tool_that_goes_aside_on_half_a_block_is_told(free):
    """A rough lid pushed down: on the whole it stays in the middle, on a half what spreads takes it along."""
    found = []
    for half in (True, False):
        mesh = read_gmsh(
            rectangles.build,
            rectangles={"pad": ((0.0 if half else -5.0, 0.0), (5.0 * (2 - half), 5.0), (20 * (2 - half), 12))},
        )
        scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 5.0)), plane="strain")
        scene.fix("pad_ymin")
        if half:
            scene.fix("pad_xmin", "x")
        lid = rigid_plane((0.0, 5.0, 0.0), (0.0, -1.0, 0.0), name="lid")
        scene.contact("pad_ymax", lid, 0.3, name="c")
        result = solve(scene, move={lid: Motion(force=(0.0, -6.0 / (1 + half), 0.0), free=free)}, steps=4).require()
        found.append((result.column("lid_travel_y_mm")[-1], len(notes_of(result, "'lid'", "plane of symmetry"))))
    (part, told), (whole, untold) = found
    assert untold == 0 and (told > 0) == (abs(part / whole - 1.0) > 1e-6) == (free == "x"), found


@pytest.mark.parametrize("way, told", [((0.0, -0.4, 0.0), False), ((0.3, -0.4, 0.0), True)])
def test_a_tool_that_is_moved_aside_on_half_a_block_is_told(way, told):
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (6.0, 4.0), (18, 8))})
    scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 5.0)), plane="strain")
    scene.fix("pad_ymin")
    scene.fix("pad_xmin", "x")
    roller = rigid_cylinder(2.0, (0.0, 6.0, 0.0), (0, 0, 1), name="roller")
    scene.contact("pad_ymax", roller, 0.5, name="c")
    notes = notes_of(solve(scene, move={roller: way}, steps=4).require(), "'roller'", "plane of symmetry")
    assert bool(notes) == told, notes


def half_or_whole(half, free):
    """Half a block, y > 0, or the whole, under a plate that is pushed beside its middle and may turn about some axes."""
    size, cells = ((10.0, 5.0, 4.0), (4, 2, 2)) if half else ((10.0, 10.0, 4.0), (4, 4, 2))
    mesh = read_gmsh(box.build, size=size, cells=cells, origin=(-5.0, 0.0 if half else -5.0, 0.0), name="block")
    scene = Scene(Body(mesh, "block", neo_hooke(0.5, 4.0)))
    scene.fix("zmin")
    if half:
        scene.fix("ymin", "y")
    plate = rigid_punch(half_width=15, height=3, face=(0, 0, 4), name="plate")
    scene.contact("zmax", plate, 0.3, name="lid")
    return scene, {plate: Motion(about=(0.5, 0, 4), force=(0, 0, -10.0 if half else -20.0), free=free)}


def test_half_a_block_under_a_plate_that_turns_about_the_normal_of_its_plane():
    parts = []
    for half in (True, False):
        scene, move = half_or_whole(half, "ry")
        result = solve(scene, move=move, steps=2).require()
        assert not notes_of(result, "may turn about")
        parts.append(result.column("strain_energy_Nmm")[-1])
    assert 2.0 * parts[0] == pytest.approx(parts[1], rel=1e-7)


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("free", ["rx", "rx ry rz"])
def test_a_plate_free_to_tilt_out_of_a_plane_of_symmetry_is_told(half, free):
    """Before the run, which finds limit points that no whole has."""
    scene, move = half_or_whole(half, free)
    notes = build(scene, [Stage("push", move=move, steps=1)]).notes
    assert (
        any("'plate' may turn about x" in note and "'ymin'" in note and 'free="ry"' in note for note in notes) == half
    ), notes


def roller(x):
    return rigid_cylinder(2.0, (x, 6.0, 0.0), (0, 0, 1), name="tool")


def punch(x):
    return rigid_punch(2.0, 2.0, (x, 4.0, 0.0), direction=(0, -1, 0), fillet=0.3, name="tool")


def lid(tilt):
    return rigid_plane((0.0, 4.0, 0.0), (tilt, -1.0, 0.0), name="tool")


@pytest.mark.parametrize(
    "tool, at, turn, compared",
    [
        *((roller, at, 0.0, both) for at, both in ((0.0, True), (0.1, True), (0.3, True), (-0.3, True), (2.5, False))),
        *((punch, at, 0.0, both) for at, both in ((0.0, True), (0.3, True), (1.0, True), (2.0, False), (2.2, False))),
        *((lid, 0.0, turn, True) for turn in (0.0, 0.05)),
        (lid, 0.1, 0.0, False),
    ],
)
def test_a_tool_that_reaches_across_a_plane_unlike_its_mirror_image_is_told(tool, at, turn, compared):
    """Half a block has half of the whole's force under tools that are symmetric about its plane; what ends there, or is half
    of a wedge, is no tool for the whole."""
    forces, notes = [], []
    for whole in (False, True)[: 1 + compared]:
        drawn = {"pad": ((-6.0 * whole, 0.0), (6.0 + 6.0 * whole, 4.0), (24 * (1 + whole), 12))}
        scene = Scene(Body(read_gmsh(rectangles.build, rectangles=drawn), "pad", neo_hooke(0.5, 5.0)), plane="strain")
        scene.fix("pad_ymin")
        if not whole:
            scene.fix("pad_xmin", "x")
        one = tool(at)
        scene.contact("pad_ymax", one, name="c")
        result = solve(scene, move={one: Motion(y=-0.3, rz=turn)}, steps=3).require()
        forces.append(result.column("c_force_y_N")[-1] / (1 + whole))
        notes.append(len(notes_of(result, "'tool'", "mirror image")))
    alike = not compared or abs(forces[0] / forces[1] - 1.0) < 1e-6
    assert (notes[0] > 0) != alike and not sum(notes[1:]), (notes, forces)


@pytest.mark.parametrize("friction, stretch", [(0.0, 0.1), (0.5, 0.0), (0.5, 0.1)])
def test_a_rough_lid_at_rest_over_a_strip_that_is_stretched_is_told(friction, stretch):
    """A cell of any length is the same strip; beneath a rough lid, which the next cell has farther on, it is not."""
    forces, notes = [], []
    for length in (3.0, 6.0):
        mesh = read_gmsh(rectangles.build, rectangles={"s": ((0.0, 0.0), (length, 2.0), (round(2 * length), 4))})
        scene = Scene(Body(mesh, "s", neo_hooke(1.0, 5.0)), plane="strain")
        scene.periodic("s_xmin", "s_xmax", (stretch * length, 0.0, 0.0))
        scene.fix("s_ymin", "y")
        scene.fix("s_xmin", "x")
        lid = rigid_plane((0.0, 2.0, 0.0), (0.0, -1.0, 0.0), name="lid")
        scene.contact("s_ymax", lid, friction, name="c")
        result = solve(scene, move={lid: (0.0, -0.2, 0.0)}, steps=4).require()
        notes.append(bool(notes_of(result, "'lid'", "otherwise than what repeats")))
        forces.append(result.column("s_xmin_s_xmax_pair_force_x_N")[-1])
    alike = abs(forces[1] - forces[0]) < 1e-6
    assert notes == [not alike] * 2 and alike == (friction == 0.0 or stretch == 0.0), (notes, forces)


@pytest.mark.parametrize("around", [4, 8])
@pytest.mark.parametrize("slave, master", [("inner_outside", "outer_inside"), ("outer_inside", "inner_outside")])
def test_a_round_side_goes_on_across_its_planes_of_symmetry(slave, master, around):
    """A quarter tube in another: its facets lean from the planes by up to 11 degrees. Its ends along the axis are ends."""
    drawn = {"inner": (1.0, 2.0, around, 1), "outer": (2.05, 3.0, around + 1, 1)}
    mesh = read_gmsh(tubes.build, tubes=drawn, depth=3.0, layers=3)
    law = neo_hooke(1.0, 5.0)
    scene = Scene(Body(mesh, "inner", law), Body(mesh, "outer", law))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("inner_inside", "z")
    scene.fix("outer_outside")
    scene.contact(slave, master, 0.2, name="c")
    contact = build(scene).system.contact_terms[0]
    places, X = contact.places.around, contact.places.skin.X
    z = X[places.corners][..., 2]
    np.testing.assert_array_equal(places.tips, np.isclose(z, 0.0) | np.isclose(z, 3.0))


@pytest.mark.parametrize("plane", [False, True])
def test_a_half_that_grows_through_its_plane_is_told(plane):
    """A block on a wider base, the planes of symmetry of which it reaches as it is pressed."""
    result = bulged(paired=False, planes=("top_xmin", "top_xmax") if plane else ())
    notes = notes_of(result, "plane of symmetry", "beyond the plane of 'base_x")
    assert bool(notes) != plane, notes


def quarter(cells):
    """Of a block about its middle, that stands on the ground."""
    scene = Scene(Body(read_gmsh(box.build, size=(1.0, 1.0, 0.5), cells=cells), "box", neo_hooke(1.0, 5.0)))
    scene.cyclic("ymin", "xmin", axis=(0, 0, 1))
    scene.fix("zmin")
    return scene


@pytest.mark.parametrize("turns", [False, True])
def test_a_lid_that_does_not_repeat_with_its_sector_is_told(turns):
    """A quarter of a block about its middle under a rough lid that turns about that, or about a corner."""
    scene = quarter((4, 4, 2))
    lid = rigid_plane((0.0, 0.0, 0.5) if turns else (1.0, 1.0, 0.5), (0.0, 0.0, -1.0), name="lid")
    scene.contact("zmax", lid, 0.5, name="c")
    spin = Motion(z=-0.05, rz=0.1)
    notes = notes_of(solve(scene, move={lid: spin}, steps=2).require(), "'lid'", "otherwise than what repeats")
    assert bool(notes) != turns, notes


def build_shaft(cells=12):
    """Of radius 1 about z, in four quarters."""
    geo, angles = gmsh.model.geo, np.arange(4) * np.pi / 2
    centre, points = geo.addPoint(0, 0, -1), [geo.addPoint(np.cos(a), np.sin(a), -1) for a in angles]
    arcs = [geo.addCircleArc(one, centre, points[i - 3]) for i, one in enumerate(points)]
    for arc in arcs:
        geo.mesh.setTransfiniteCurve(arc, cells + 1)
    geo.extrude([(1, arc) for arc in arcs], 0, 0, 3, numElements=[3], recombine=True)
    geo.synchronize()
    gmsh.model.mesh.generate(2)


@pytest.mark.parametrize("spin, aside", [(0.1, 0.0), (0.0, 0.05), (0.0, 0.15)])
@pytest.mark.parametrize("meshed", [False, True])
def test_a_shaft_that_leaves_the_axis_of_its_sector_is_told(spin, aside, meshed):
    """A bush that swells around a shaft: a quarter of it has a quarter of the energy while that stays on the axis, but for
    normals at its faces, which are means of one side; the farther it goes, the sooner it lets go of one face."""
    energies, notes = [], []
    for sectors in (4, 1):
        scene = tube(sectors, 4, around=4)
        scene.fix("xmax", "xy")
        scene.swell("box", 1.2)
        shaft = (
            rigid_surface(build_shaft, name="shaft") if meshed else rigid_cylinder(1.0, (0, 0, 0), (0, 0, 1), name="shaft")
        )
        scene.contact("xmin", shaft, 0.3, name="c")
        result = solve(scene, move={shaft: Motion(x=aside, rz=spin)}, steps=4).require()
        energies.append(result.column("strain_energy_Nmm")[-1] / sectors)
        notes.append([len(notes_of(result, "'shaft'", *words)) for words in (("what repeats",), ("second tool",))])
    alike = abs(energies[1] / energies[0] - 1.0) < 5e-3
    assert notes[0] == [0, 0] and notes[1][1] == 0, notes
    assert alike == (aside == 0.0) == (notes[1][0] == 0), (energies, notes)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("tilt", [0.0, 0.02, 0.1])
def test_a_lid_that_tilts_over_a_periodic_strip_is_told(friction, tilt):
    """Of one cell, or of two, which then have another force per cell; the more it tilts, the more of a face it lets go."""
    forces, notes = [], []
    for length in (3.0, 6.0):
        mesh = read_gmsh(rectangles.build, rectangles={"s": ((0.0, 0.0), (length, 2.0), (round(4 * length), 4))})
        scene = Scene(Body(mesh, "s", neo_hooke(1.0, 5.0)), plane="strain")
        scene.periodic("s_xmin", "s_xmax")
        scene.fix("s_ymin")
        lid = rigid_plane((0.5 * length, 2.0, 0.0), (0.0, -1.0, 0.0), name="lid")
        scene.contact("s_ymax", lid, friction, name="c")
        result = solve(scene, move={lid: Motion(y=-0.1, rz=tilt)}, steps=4).require()
        notes.append((bool(notes_of(result, "'lid'", "otherwise than what repeats")), len(notes_of(result, "second tool"))))
        forces.append(result.column("c_force_y_N")[-1] / length)
    alike = abs(forces[1] / forces[0] - 1.0) < 1e-6
    assert notes == [(not alike, 0)] * 2 and alike == (tilt == 0.0), (notes, forces)


@pytest.mark.parametrize("along", [False, True])
def test_a_load_across_the_axis_of_a_sector_is_told(along):
    scene = quarter((2, 2, 1))
    scene.body_force((0.0, 0.0 if along else 0.01, -0.01))
    scene.traction("zmax", lambda X, t: 0.01 * t * X * [1.0, 1.0, 0.0])  # away from the axis
    notes = notes_of(solve(scene, steps=1).require(), "acts across the axis")
    assert [note.startswith("body force acts") for note in notes] == [True] * (not along), notes


def test_a_face_that_a_stage_pulls_out_is_no_plane_of_symmetry():
    """Held along its normal in the scene, moved along it by a stage."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (9.0, 1.0), (18, 2))})
    scene = Scene(Body(mesh, "strip", neo_hooke(1.0, 20.0)), plane="strain")
    scene.fix("strip_xmax", "x")
    scene.fix("strip_xmin")
    result = solve(scene, stages=[Stage("pull", prescribe={("strip_xmax", "x"): 0.9}, steps=4)]).require()
    assert not notes_of(result, "beyond the plane of 'strip_xmax'")
