"""Parts that stand for a whole: what does not go with their planes of symmetry, or with what repeats, is told."""

import pytest
from test_pairs import bulged

from fenics_contact import Body, Motion, Scene, neo_hooke, read_gmsh, rigid_cylinder, rigid_plane, solve
from fenics_contact.meshes import box, rectangles

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


@pytest.mark.parametrize("along", [False, True])
def test_a_load_across_the_axis_of_a_sector_is_told(along):
    scene = quarter((2, 2, 1))
    scene.body_force((0.0, 0.0 if along else 0.01, -0.01))
    scene.traction("zmax", lambda X, t: 0.01 * t * X * [1.0, 1.0, 0.0])  # away from the axis
    notes = notes_of(solve(scene, steps=1).require(), "acts across the axis")
    assert [note.startswith("body force acts") for note in notes] == [True] * (not along), notes
