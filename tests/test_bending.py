"""Bodies that bend across few cells of degree 1: told where they are too stiff, against cells of degree 2."""

import pytest
from mpi4py import MPI

from fenics_contact import Body, Scene, Stage, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box, rectangles


def led_aside(cells, degree=1, element="displacement", length=10.0):
    """Force and notes on cells of a strip of height 1, clamped at one end and led aside by 1 at its other one."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (length, 1.0), cells)})
    scene = Scene(Body(mesh, "strip", neo_hooke(1.0, 5.0)), plane="strain", degree=degree, element=element)
    scene.fix("strip_xmin")
    scene.fix("strip_xmax", "y")
    result = solve(scene, stages=[Stage("aside", prescribe={("strip_xmax", "y"): 1.0}, steps=2)]).require()
    return result.column("strip_xmax_reaction_y_N")[-1], [note for note in result.verdict.notes if "varies within" in note]


@pytest.mark.parallel
@pytest.mark.parametrize("cells", [(10, 1), (20, 2), (10, 2), (10, 4), (5, 2)])
def test_a_strip_of_few_cells_is_told_to_be_too_stiff_by_its_share_or_more(cells):
    force, notes = led_aside(cells)
    exact, none = led_aside((20, 2), degree=2)
    (note,) = notes
    assert force / exact - 1.0 > float(note.split("'strip': ")[1].split(" of its")[0]) > 0.2 and not none
    assert "degree=2" in note and "at (" in note


@pytest.mark.parallel
@pytest.mark.parametrize(("cells", "element"), [((30, 3), "displacement"), ((40, 4), "displacement"), ((20, 2), "mixed")])
def test_a_strip_that_is_off_by_a_fifth_at_most_has_no_note(cells, element):
    force, notes = led_aside(cells, element=element)
    assert abs(force / led_aside((20, 2), degree=2)[0] - 1.0) < 0.2 and not notes


@pytest.mark.parallel
def test_long_mixed_cells_that_bend_are_told():
    force, (note,) = led_aside((5, 2), element="mixed")
    assert force / led_aside((20, 2), degree=2)[0] > 2.0 and "off there by about that share or more" in note


@pytest.mark.parallel
def test_what_bends_is_told_whatever_its_modulus_and_a_block_that_is_pressed_is_not():
    """In space, of cells twice as long as high."""
    found = []
    for modulus in (1.0, 1e-4):
        mesh = read_gmsh(box.build, size=(4.0, 1.0, 0.5), cells=(4, 2, 1))
        scene = Scene(Body(mesh, "box", neo_hooke(modulus, 5.0 * modulus)))
        scene.fix("xmin")
        scene.fix("xmax", "z")
        result = solve(scene, stages=[Stage("aside", prescribe={("xmax", "z"): 0.5}, steps=2)]).require()
        found.append([note.split(", most at")[0] for note in result.verdict.notes if "varies within" in note])
    assert len(found[0]) == 1 and found[0] == found[1]  # of cells that are alike rounding says which is the first
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(3, 3, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
    scene.fix("zmin")
    lid = rigid_plane((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), name="lid")
    scene.contact("zmax", lid, 0.5, name="c")
    notes = solve(scene, move={lid: (0.0, 0.0, -0.2)}, steps=2).require().verdict.notes
    assert not any("varies within" in note for note in MPI.COMM_WORLD.bcast(notes))
