"""Friction of averages is linear between nodes: what it loses where a body slides this way and that is told."""

import functools

import numpy as np
import pytest

from fenics_contact import Body, Scene, Stage, neo_hooke, read_gmsh, solve
from fenics_contact.contact.turning import add_rubbing
from fenics_contact.meshes import rectangles

pytestmark = pytest.mark.parallel
SAID = "friction is linear from node to node"


def packer(cells, steps=4, way=0.0, half=False, points=None):
    """A rubber sleeve, its bore held, that swells into a longer rough casing, which is then led along by a way, if any."""
    low, high = (0.0 if half else -4.0), 4.0
    drawn = {
        "rubber": ((6.0, low), (3.7, high - low), (3 * cells, int(high - low) // 2 * cells)),
        "casing": ((9.8, 1.5 * low), (2.2, 1.5 * (high - low)), (2 * cells, int(1.5 * (high - low)) // 2 * cells)),
    }
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    bodies = Body(mesh, "rubber", neo_hooke(1.0, 50.0)), Body(mesh, "casing", neo_hooke(5.0, 200.0))
    scene = Scene(*bodies, plane="axisymmetric", degree=2, element="mixed")
    scene.fix("rubber_xmin")
    scene.fix("casing_xmax", "x")
    scene.fix("casing_xmax", "y")
    if half:
        for name in ("rubber_ymin", "casing_ymin"):
            scene.fix(name, "y")
    scene.swell("rubber", 1.25)
    scene.contact("rubber_xmax", "casing_xmin", friction=0.3, points=points, name="c")
    stages = [Stage("swell", steps=steps)]
    stages += [Stage("pull", prescribe={("casing_xmax", "y"): way}, steps=steps)] if way else []
    return solve(scene, stages=stages).require()


@functools.cache
def swollen(cells, **how):
    """(load, its change that is said, notes) of a packer."""
    result = packer(cells, **how)
    notes = [note for note in result.verdict.notes if SAID in note]
    said = result.summary["friction_error"].get("c", {"load_change_over_load": 0.0})["load_change_over_load"]
    return result.column("c_load_N")[-1], said, notes


@pytest.mark.parametrize("steps", [4, 16])
def test_friction_that_turns_round_between_nodes_is_told(steps):
    """It slides out both ways from the middle node, on which no friction acts, nor all of it within a cell beside that;
    Gauss points on the same cells have all of it."""
    (load, said, (note,)), (finer, less, none) = swollen(1, steps=steps), swollen(2)
    np.testing.assert_allclose(said, swollen(1, points=6)[0] / load - 1.0, rtol=0.05)
    assert 0.025 < finer / load - 1.0 < said
    assert f"the load would change by {said:+.1%}" in note
    assert 0.0 < less < 0.3 * said and not none


def test_half_of_it_is_told_the_same():
    (load, said, _), (half, of_half, (note,)) = swollen(1), swollen(1, half=True)
    np.testing.assert_allclose([2.0 * half, of_half], [load, said], rtol=1e-4)
    assert "around (9.7, 0, 0)" in note


def test_friction_of_one_way_has_nothing_between_nodes():
    """Pulled, all of it slides along; what was lost as it swelled is told of that stage."""
    result = packer(1, way=2.0)
    assert abs(result.summary["friction_error"]["c"]["load_change_over_load"]) < 1e-3
    (note,) = (note for note in result.verdict.notes if SAID in note)
    assert note.startswith("stage 'swell'")
    (leans,) = (note for note in result.verdict.notes if "lean" in note)
    of_load, of_friction = (float(leans.split(words)[0].split()[-1]) for words in (" of the load", " of the friction"))
    np.testing.assert_allclose(of_friction, of_load / 0.3, rtol=0.1)  # all of it slides


def test_what_rubs_more_acts_on_both_bodies():
    """By the friction's law: no more than its limit, outward from the middle, and as much on the casing as on the rubber."""
    result = packer(1)
    (contact,), state, comm = result.system.contact_terms, result.system.state, result.system.comm
    more, sizes = contact.findings.between_nodes(state)
    feet = contact.places.feet(state)
    forces = np.zeros_like(feet.coords)
    add_rubbing(feet, contact.places.facets[0], more, forces)
    first = contact.places.first
    rubber, casing = comm.allreduce(np.array([forces[:first].sum(axis=0), forces[first:].sum(axis=0)]))
    np.testing.assert_allclose(rubber + casing, 0.0, atol=1e-9)
    total, limit, outward = comm.allreduce(
        np.array([sizes.sum(), contact.forces.grip(state)[1], (more[:, 1] * np.sign(feet.points[:, 1])).sum()])
    )
    assert 0.9 * total < outward <= total < limit


def pad(cells, friction, squeeze, steps=4, said=SAID, bulk=10.0, element="displacement", points=None):
    """A rubber pad 10 x 4 between rough plates, which are squeezed together by a share of its height."""
    drawn = {
        "pad": ((-5.0, 0.0), (10.0, 4.0), (cells, 4)),
        "lower": ((-7.0, -1.5), (14.0, 1.5), (cells + 2, 2)),
        "upper": ((-7.0, 4.0), (14.0, 1.5), (cells + 2, 2)),
    }
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    plates = (Body(mesh, name, neo_hooke(200.0, 400.0)) for name in ("lower", "upper"))
    scene = Scene(Body(mesh, "pad", neo_hooke(1.0, bulk)), *plates, plane="strain", degree=2, element=element)
    scene.fix("lower_ymin")
    scene.fix("upper_ymax", "x")
    scene.prescribe("upper_ymax", "y", -4.0 * squeeze)
    scene.contact("pad_ymin", "lower_ymax", friction=friction, points=points, name="below")
    scene.contact("pad_ymax", "upper_ymin", friction=friction, points=points, name="above")
    result = solve(scene, steps=steps).require()
    share = result.summary["friction_error"].get("below", {"load_change_over_load": 0.0})["load_change_over_load"]
    return result.column("below_load_N")[-1], share, [note for note in result.verdict.notes if said in note]


@pytest.mark.parametrize("friction", [1.0, 10.0])
def test_what_sticks_altogether_has_nothing_between_nodes(friction):
    """Places between nodes of degree 2 move a little, held by nothing; by their own ways they were said to rub with all the
    friction there is: 26 and 263 % more load, of which 1 % is missing."""
    _, said, notes = pad(4, friction, 0.2)
    assert abs(said) < 0.01 and not notes


@pytest.mark.parametrize("steps", [4, [0.25, 0.5, 0.75, 0.99, 1.0]], ids=["even", "a short one last"])
def test_a_pad_that_spreads_both_ways_is_told(steps):
    """With 16 cells it has 11 % more load, and with Gauss points on its own ones as much as is said. However short the last
    step, in which places go next to no way of their own."""
    load, said, notes = pad(2, 0.3, 0.15, steps)
    np.testing.assert_allclose(said, pad(2, 0.3, 0.15, points=6)[0] / load - 1.0, rtol=0.05)
    assert 0.1 < pad(16, 0.3, 0.15)[0] / load - 1.0 < said and len(notes) == 2


@pytest.mark.parametrize("steps", [2, 8])
def test_where_a_part_sticks_no_more_is_told_than_can_be_missing(steps):
    """By places' own ways -13 ... +4 %, by the steps; 1.3 % is missing."""
    _, said, _ = pad(4, 0.3, 0.15, steps)
    assert -0.02 < said < 0.05


def test_a_pad_of_which_all_slides_is_said_to_be_held_by_nothing():
    """No node lies in its middle, where what spreads sticks: it may go aside as it is, and there is no other path."""
    _, _, notes = pad(5, 0.3, 0.1, said="determinant", bulk=50.0, element="mixed")
    assert all("body 'pad' moves along x nearly as a rigid one" in note for note in notes) and len(notes) == 1
