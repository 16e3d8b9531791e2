"""Bodies that are too stiff by their cells, in bending or by locking: told, against cells that are not."""

import pytest
import ufl
from drawn import ring
from mpi4py import MPI

from fenics_contact import Body, Scene, Stage, neo_hooke, read_gmsh, rigid_plane, solve, user_energy
from fenics_contact.meshes import box, rectangles, ring_sector, sphere_shell


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


def locks(result):
    """The share of energy in the note on a body that locks, and by how much it is too stiff at least, None without one."""
    notes = [note for note in result.verdict.notes if "cells of displacement alone lock" in note]
    if not notes:
        return None
    (note,) = notes
    share = float(note.split(": ")[1].split("% of its energy")[0]) / 100
    return share, float(note.split("stiff by about ")[1].split("%")[0]) / 100 if "stiff by about" in note else share


def arch(cells, degree, element, ratio, law=neo_hooke):
    """A flat tool presses the crown of half a ring that is clamped: the load and the result."""
    mesh = read_gmsh(lambda: ring("arch", 0.0, (9.0, 10.0), cells, ("inside", "back"), ends="feet"))
    scene = Scene(Body(mesh, "arch", law(0.5, 0.5 * ratio)), plane="strain", degree=degree, element=element)
    scene.fix("feet")
    lid = rigid_plane((0, 10, 0), normal=(0, -1, 0), name="lid")
    scene.contact("back", lid, name="lid")
    result = solve(scene, move={lid: (0, -1.5, 0)}, steps=3).require()
    return result.column("lid_load_N")[-1], result


@pytest.mark.parallel
@pytest.mark.parametrize(("cells", "ratio"), [((4, 48), 5.0), ((4, 48), 12.75), ((2, 24), 12.75), ((4, 48), 50.0)])
def test_an_arch_of_degree_1_is_told_to_lock_by_as_much_as_it_does(cells, ratio):
    exact, mixed = arch((4, 48), 2, "mixed", ratio)
    load, result = arch(cells, 1, "displacement", ratio)
    _, least = locks(result)
    assert locks(mixed) is None and least < load / exact - 1.0 < 1.25 * least + 0.01


@pytest.mark.parallel
@pytest.mark.parametrize(("cells", "ratio"), [((1, 6), 12.75), ((1, 12), 12.75), ((1, 12), 50.0)])
def test_one_of_degree_2_by_up_to_six_times_its_share(cells, ratio):
    exact, _ = arch((4, 48), 2, "mixed", ratio)
    load, result = arch(cells, 2, "displacement", ratio)
    share, _ = locks(result)
    assert share < load / exact - 1.0 < 6.0 * share


@pytest.mark.parallel
def test_cells_that_are_fine_enough_or_compressible_enough_are_not_told():
    exact, _ = arch((4, 48), 2, "mixed", 2.0)
    for cells, degree in (((1, 12), 2), ((8, 96), 1)):
        load, result = arch(cells, degree, "displacement", 2.0)
        assert locks(result) is None and load / exact - 1.0 < 0.03


def inflated(axisymmetric, degree, element, ratio=30.0):
    """How far the inner wall of a thick sphere goes out, a ring's quarter turned or one eighth in space, and the result."""
    if axisymmetric:
        mesh = read_gmsh(ring_sector.build, radii=(50.0, 100.0), cells=(2, 6))
        scene = Scene(Body(mesh, "ring", neo_hooke(0.4, 0.4 * ratio)), plane="axisymmetric", degree=degree, element=element)
        scene.fix("ymin", "y")
    else:
        mesh = read_gmsh(sphere_shell.build, inner=50.0, thickness=50.0, cells=4, layers=2)
        scene = Scene(Body(mesh, *mesh.volumes, neo_hooke(0.4, 0.4 * ratio)), degree=degree, element=element)
        for axis in "xyz":
            scene.fix(f"symmetry_{axis}", axis)
    scene.pressure("inner", 0.02)
    result = solve(scene, steps=1, record={"way": lambda view: float(view.at((50.0, 0.0, 0.0)).displacement[0])}).require()
    return result.column("way")[-1], result


@pytest.mark.parallel
@pytest.mark.parametrize("axisymmetric", [False, True])
def test_a_thick_sphere_gives_way_by_less_than_one_that_does_not_lock(axisymmetric):
    """To the first order of a load that is given: what is left out, over all."""
    exact, none = inflated(axisymmetric, 1, "mixed")
    way, result = inflated(axisymmetric, 1, "displacement")
    share, least = locks(result)
    assert (
        locks(none) is None
        and 0.8 * share < 1.0 - way / exact < 1.25 * share
        and least == pytest.approx(share / (1 - share), abs=2e-3)
    )


@pytest.mark.parallel
def test_a_law_without_a_part_for_the_volume_takes_degree_2():
    """Kept near its volume by a penalty of the user's own."""

    def law(mu, K):
        return user_energy(
            lambda F: mu / 2 * (ufl.det(F) ** (-2 / 3) * ufl.inner(F, F) - 3) + K / 2 * (ufl.det(F) - 1) ** 2, mu, K
        )

    _, result = arch((2, 24), 1, "displacement", 12.75, law)
    (note,) = (note for note in result.verdict.notes if "alone lock" in note)
    assert note.endswith("take degree=2") and locks(result) == locks(arch((2, 24), 1, "displacement", 12.75)[1])
