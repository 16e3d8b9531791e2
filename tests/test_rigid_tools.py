"""Bores, profiles and unions as tools of scenes: against a closed form, and against the same tool said otherwise."""

import gmsh
import numpy as np
import pytest
from refusals import refused

from fenics_contact import (
    Body,
    Method,
    Scene,
    SceneError,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_extrusion,
    rigid_plane,
    rigid_punch,
    rigid_revolution,
    rigid_sphere,
    rigid_torus,
    rigid_union,
    solve,
)
from fenics_contact.meshes import box, o_ring, rectangles, tubes

pytestmark = pytest.mark.parallel

INNER, OUTER, E, NU, P = 4.0, 6.0, 1000.0, 0.3, 0.1
ALONG = {"axis": (0.0, 0.0, 1.0)}
BORES = {
    "hollow cylinder": rigid_cylinder(OUTER, (0, 0, 0), (0, 0, 1), hollow=True),
    "turned profile": rigid_revolution([(OUTER, 0), (OUTER, 1)]),
    "union": rigid_union(rigid_cylinder(OUTER, (0, 0, 0), (0, 0, 1), hollow=True), rigid_sphere(1.0, (0, 0, 99))),
}


def pressed_into(bore, around):
    """Quarter of a tube, inflated in a bore that it fills: mean contact pressure [MPa]."""
    mesh = read_gmsh(tubes.build, tubes={"tube": (INNER, OUTER, around, around // 2)}, depth=1.0)
    scene = Scene(Body(mesh, "tube", from_elastic(E, NU)))
    for group, axis in (("symmetry_x", "x"), ("symmetry_y", "y"), ("ends", "z")):
        scene.fix(group, axis)
    scene.pressure("tube_inside", P)
    scene.contact("tube_outside", bore, penetration=1e-9, name="bore")
    result = solve(scene, steps=1)
    assert result.converged, result.verdict.reason
    return result.column("bore_load_N")[-1] / (0.5 * np.pi * OUTER)


def test_tube_inflated_in_a_bore():
    """Against Lame's tube whose outside cannot move, which presses by 2 (1 - nu) p / (1 + (1 - 2 nu) b^2 / a^2)."""
    exact = 2.0 * (1.0 - NU) * P / (1.0 + (1.0 - 2.0 * NU) * (OUTER / INNER) ** 2)
    coarse, fine = (pressed_into(BORES["hollow cylinder"], around) / exact - 1.0 for around in (6, 12))
    # chords: second order, 4 under halving; strains of 1e-4 leave as much of a small-strain formula
    assert abs(fine) < 5e-3 and 3.5 < coarse / fine < 4.5
    for name in ("turned profile", "union"):
        assert abs(pressed_into(BORES[name], 6) / exact - 1.0 - coarse) < 1e-8, name  # Newton's tolerance


def test_a_flat_profile_is_a_plane():
    """A rough block pressed and drawn, forces and slips by Newton's tolerance."""
    mesh, found = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1)), []
    for tool in (rigid_plane(), rigid_extrusion([(-1, 0), (1, 0)], (0.3, 0, 0), along=(0.6, 0.8, 0.0))):
        scene = Scene(Body(mesh, "box", from_elastic(E, NU)))
        scene.fix("zmax")
        scene.contact("zmin", tool, 0.3, name="floor")
        way = lambda t: (0.1 * max(t - 0.5, 0.0), 0.0, 0.02 * min(2 * t, 1.0))  # noqa: E731
        result = solve(scene, move={tool: way}, steps=4)
        assert result.converged, result.verdict.reason
        found.append(
            np.column_stack([result.column(f"floor_{what}") for what in ("force_x_N", "force_z_N", "mean_slip_mm")])
        )
    np.testing.assert_allclose(found[0], found[1], atol=1e-8 * np.abs(found[0]).max())
    assert found[0][-1, 2] > 0.0


ASKEW = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])


def over_a_groove(tool_of, Q):
    """Forces, in its own axes, of a rough rubber block pressed over the rims of a groove and drawn along it, turned by Q."""

    def placed():
        box.build(size=(2.0, 1.0, 0.5), cells=(8, 2, 2), origin=(-1.0, 0.0, 0.0))
        tags, X, _ = gmsh.model.mesh.getNodes()
        for tag, x in zip(tags, X.reshape(-1, 3) @ Q.T, strict=True):
            gmsh.model.mesh.setNode(tag, x, [])

    scene = Scene(Body(read_gmsh(placed), "box", neo_hooke(1.0, 5.0)))
    scene.fix("zmax")
    tool = tool_of(Q)
    scene.contact("zmin", tool, 0.3, name="floor")
    way = lambda t: Q @ (0.0, 0.1 * max(2 * t - 1, 0.0), 0.15 * min(2 * t, 1.0))  # noqa: E731
    result = solve(scene, move={tool: way}, steps=4)
    assert result.converged, result.verdict.reason
    assert len(result.column("t")) == 4, "cut back"
    return np.column_stack([result.column(f"floor_force_{axis}_N") for axis in "xyz"]) @ Q


def groove(Q):
    """Sides 0.5 from the middle, rims of 0.2 and corners of 0.3, out of reach."""
    points = [(-9, 0), (-0.5, 0, 0.2), (-0.5, -2, 0.3), (0.5, -2, 0.3), (0.5, 0, 0.2), (9, 0)]
    return rigid_extrusion(points, along=Q[:, 1], up=Q[:, 2])


def two_bars(Q):
    """The same rims as those of two round bars."""
    bars = [
        rigid_punch(4.0, 4.0, Q @ (side * 4.5, 0.0, 0.0), half_depth=9.0, direction=Q[:, 2], fillet=0.2) for side in (-1, 1)
    ]
    return rigid_union(*bars)


def test_a_block_over_a_groove():
    """The same forces by a profile and by a union of bars, straight and turned in space; nothing along x by symmetry."""
    straight = over_a_groove(groove, np.eye(3))
    size = 1e-7 * np.abs(straight).max()  # Newton's tolerance
    assert np.abs(straight[:, 0]).max() < size and straight[-1, 1] > 0.1 * abs(straight[-1, 2])
    for tool_of, Q in ((two_bars, np.eye(3)), (groove, ASKEW), (two_bars, ASKEW)):
        np.testing.assert_allclose(over_a_groove(tool_of, Q), straight, rtol=0.0, atol=size)


# the wall goes on through the right block, and what is outside of the bore holds a part of the left one
WALLS = {
    "left": rigid_plane((4.1, 0.0, 0.0), (-1.0, 0.0, 0.0), name="wall"),
    "right": rigid_cylinder(6.0, (8.35, 2.0, 0.0), (0.0, 0.0, 1.0), hollow=True, name="bore"),
}


def squeezed(*names):
    """Blocks between plates, of which one side of each bulges against a tool of its own."""
    drawn = {name: ((10.0 * (name == "right"), 0.0), (4.0, 4.0), (6, 6)) for name in names}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 10.0)) for name in names), plane="strain")
    for name in names:
        scene.fix(f"{name}_ymin")
        scene.fix(f"{name}_ymax", "x")
        scene.prescribe(f"{name}_ymax", "y", -1.5)
        scene.contact(f"{name}_xmax", WALLS[name], name=name)
    return solve(scene, steps=4).require()


def test_a_body_that_a_tool_does_not_meet_may_lie_in_it():
    """Each block is as it is alone."""
    both = squeezed("left", "right")
    for name in WALLS:
        force, alone = both.column(f"{name}_force_x_N"), squeezed(name).column(f"{name}_force_x_N")
        assert alone[-1] < -0.1
        np.testing.assert_allclose(force, alone, rtol=0.0, atol=1e-6 * abs(alone[-1]))
    assert not any("is no slave" in note or "an inner node" in note for note in both.verdict.notes), both.verdict.notes


@pytest.mark.parametrize(("start", "told"), [(4.3, "lies 0.1 inside 'wall'"), (3.0, None)])
def test_a_body_that_comes_into_a_tool_is_told(start, told):
    """Two blocks led into a wall that has one of them as slave; that one may not start in the wall, and is named."""
    drawn = {name: ((0.0, y), (4.0, 4.0), (4, 4)) for name, y in (("met", 0.0), ("other", 6.0))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 10.0)) for name in drawn), plane="strain")
    for name in drawn:
        scene.fix((f"{name}_xmin", f"{name}_ymin"), "y")
        scene.prescribe(f"{name}_xmin", "x", 0.4)
    scene.contact("met_xmax", rigid_plane((start, 0.0, 0.0), (-1.0, 0.0, 0.0), name="wall"), name="c")
    if told:
        notes = [note for note in solve(scene, steps=2).require().verdict.notes if "a node that is no slave" in note]
        assert len(notes) == 1 and "contact 'c' at (4, " in notes[0] and told in notes[0], notes
    else:
        with pytest.raises(SceneError, match="starts 1 inside body 'met', where"):
            scene.system()


def test_shapes_that_cannot_be_are_refused_as_all_statements_are():
    plane = rigid_plane()
    wrong = {
        "closes a ring": lambda: rigid_torus(1.0, 2.0, (0, 0, 0)),
        "two or more": lambda: rigid_union(plane),
        "a union itself": lambda: rigid_union(rigid_union(plane, rigid_sphere(1.0, (0, 0, 3))), plane),
        "zero vector": lambda: rigid_plane((0, 0, 0), (0, 0, 0)),
        "make it smaller": lambda: rigid_punch(1.0, 1.0, (0, 0, 0), fillet=2.0),
    }
    for words, action in wrong.items():
        refused(action, words, kind=SceneError)


def ring_in(tools):
    """Half of a frictionless ring of radius 1.5 around (8, 0), on its plane of symmetry and in these tools, the first one of
    which is to move down by 0.4."""
    mesh = read_gmsh(o_ring.build, radius=1.5, centre=8.0, cells=5)
    scene = Scene(Body(mesh, "ring", neo_hooke(4.0, 40.0)), plane="strain")
    scene.fix("symmetry_y", "y")
    for tool in tools:
        scene.contact("rim", tool, name=tool.name)
    return scene, {"move": {tools[0]: (0.0, -0.4, 0.0)}, "steps": 2, "method": Method(stabilise=True)}


@pytest.mark.parametrize("gap", [0.05, 1.0])
def test_a_groove_of_one_tool_holds_what_its_walls_hold(gap):
    """It was refused: nothing holds the ring along x, for the tool's normal at the place nearest to it is along y. The same
    groove of three planes is the truth, here where the corners between them meet nothing."""
    left, right = 6.5 - gap, 9.5 + gap
    lid = rigid_plane((0, 1.5, 0), (0, -1, 0), name="lid")
    walls = [rigid_plane((x, 0, 0), (normal, 0, 0), name=f"wall {x}") for x, normal in ((left, 1.0), (right, -1.0))]
    corners = [(right, -5.0), (right, 1.5, 0.04), (left, 1.5, 0.04), (left, -5.0)]
    groove = rigid_extrusion(corners, along=(0, 0, -1), up=(0, 1, 0), name="lid")
    forces = []
    for tools in ([lid, *walls], [groove]):
        scene, run = ring_in(tools)
        forces.append(solve(scene, **run).require().column("lid_force_y_N")[-1])
    assert forces[1] == pytest.approx(forces[0], rel=1e-9)


def test_along_what_no_wall_stops_it_a_body_is_loose_as_before():
    """On a flat tool, said as a profile, under a step of it that lies beyond the ring's own size, and on a convex one."""
    flat = rigid_extrusion([(20.0, 1.5), (0.0, 1.5)], along=(0, 0, -1), up=(0, 1, 0), name="lid")
    far = rigid_extrusion([(40.0, -5.0), (40.0, 1.5, 0.1), (0.0, 1.5)], along=(0, 0, -1), up=(0, 1, 0), name="lid")
    for tool in (flat, far, rigid_cylinder(2.0, (8.0, 3.5, 0.0), (0, 0, 1), name="lid")):
        refused(ring_in([tool])[0].system, "nothing holds body 'ring' along x")


@pytest.mark.parametrize("push", [(0.06, -0.06), (0.1, -0.04)])
def test_a_body_in_an_inner_corner_of_a_union_is_told_to_take_two_contacts(push):
    """Of the two planes that hold its node in the corner the union has the nearer one alone."""
    results = []
    for united in (True, False):
        mesh = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (1.0, 1.0), (4, 4))})
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane="strain")
        floor, wall = rigid_plane((0, -0.02, 0), (0, 1, 0), name="floor"), rigid_plane((1.02, 0, 0), (-1, 0, 0), name="wall")
        if united:
            scene.contact(("box_ymin", "box_xmax"), rigid_union(floor, wall, name="corner"), 0.2, name="c")
        else:
            scene.contact("box_ymin", floor, 0.2, name="c")
            scene.contact("box_xmax", wall, 0.2, name="w")
        scene.prescribe("box_xmin", "x", push[0])
        scene.prescribe("box_ymax", "y", push[1])
        results.append(solve(scene, steps=5))
    one, two = (result.verdict for result in results)
    assert two.converged and not one.converged, one.reason
    assert "a point lies in an inner corner of 'corner'" in one.reason and "at (1, 0, 0)" in one.place
    assert "contacts of their own" in one.remedy


def test_a_body_drawn_in_an_inner_corner_of_a_union_is_told_so_soon():
    """No step is so short that its node leaves the corner: it took 13 cut-backs, down to the shortest step."""
    mesh = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (1.0, 1.0), (4, 4))})
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane="strain")
    floor, wall = rigid_plane((0, 0, 0), (0, 1, 0), name="floor"), rigid_plane((1, 0, 0), (-1, 0, 0), name="wall")
    scene.contact(("box_ymin", "box_xmax"), rigid_union(floor, wall, name="corner"), 0.2, name="c")
    scene.prescribe("box_xmin", "x", 0.06)
    scene.prescribe("box_ymax", "y", -0.06)
    verdict = solve(scene, steps=5).verdict
    assert "a point lies in an inner corner of 'corner'" in verdict.reason and "at (1, 0, 0)" in verdict.place
    assert verdict.cuts <= 4
