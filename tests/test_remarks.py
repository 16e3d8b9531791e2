"""Of what a run says at its end: a body inside another one where no contact keeps it out, a contact that few nodes carry."""

import math

import gmsh
import numpy as np
import pytest

from fenics_contact import (
    Body,
    Method,
    Motion,
    Scene,
    Stage,
    Units,
    coulomb,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_cone,
    rigid_hub,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    solve,
)
from fenics_contact.assembly.finding import CYCLING, INVERTED, UNKNOWN, Finding, Remark
from fenics_contact.meshes import box, graded_rectangle, rectangles, ring_sector, two_blocks
from fenics_contact.output.carrying import Carriers, sparse_notes
from fenics_contact.solvers.verdict import OVERLAPS, Verdict

pytestmark = pytest.mark.parallel
SOFT, SIZES = neo_hooke(0.5, 2.0), {"lower_cells": (4, 4, 2), "upper_cells": (3, 3, 2)}
LOWER = ((-2.0, -2.0), (4.0, 2.0), (8, 4))


def in_space(cells):
    if cells == "hexahedra":
        return read_gmsh(
            two_blocks.build, lower=(4, 4, 2), lower_origin=(-2, -2, -2), upper=(2, 2, 2), upper_origin=(-1, -1, 0), **SIZES
        ), "z"

    def boxes():
        for name, corner, size in (("lower", (-2, -2, -2), (4, 4, 2)), ("upper", (-1, -1, 0), (2, 2, 2))):
            volume = gmsh.model.occ.addBox(*corner, *size)
            gmsh.model.occ.synchronize()
            gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
            for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
                height = gmsh.model.occ.getCenterOfMass(2, face)[2]
                if height in (corner[2], corner[2] + size[2]):
                    end = "bottom" if height == corner[2] else "top"
                    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), f"{name}_{end}")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.8)
        gmsh.model.mesh.generate(3)

    return read_gmsh(boxes), "z"


def in_plane(cells, order=1):
    upper = ((-1.0, 0.0), (2.0, 2.0), (3, 3))
    drawn = {"rectangles": {"lower": LOWER, "upper": upper}, "triangles": cells == "triangles", "order": order}
    return read_gmsh(rectangles.build, **drawn), "y"


def pressed(mesh, axis, deep, degree=1, **options):
    """The upper body moved down by `deep`; contacts: of which pairs of surfaces."""
    bottom, top, below, above = {
        "z": ("lower_bottom", "upper_top", "upper_bottom", "lower_top"),
        "y": ("lower_ymin", "upper_ymax", "upper_ymin", "lower_ymax"),
    }[axis]
    plane = {"plane": "strain"} if axis == "y" else {}
    scene = Scene(Body(mesh, "lower", SOFT), Body(mesh, "upper", SOFT), degree=degree, **plane)
    scene.fix(bottom)
    scene.fix(top, "xyz".replace(axis, "") if axis == "z" else "x")
    scene.prescribe(top, axis, -deep)
    if options.get("contact"):
        scene.contact(below, above, name="c")
    return [note for note in solve(scene, steps=2).require().verdict.notes if "inside body" in note]


MESHES = {
    "hexahedra": lambda: in_space("hexahedra"),
    "tetrahedra": lambda: in_space("tetrahedra"),
    "quadrilaterals": lambda: in_plane("quadrilaterals"),
    "triangles": lambda: in_plane("triangles"),
}


@pytest.mark.parametrize("cells", MESHES)
def test_a_body_inside_another_one_is_told(cells):
    """As deep as it has been moved, in words; not where a contact of the two keeps it out."""
    mesh, axis = MESHES[cells]()
    first, last = pressed(mesh, axis, 0.3)
    assert first.startswith("step 1 to t = 0.5: a node of body") and "body 'upper'" in first and "body 'lower'" in first
    assert "lies 0.15 inside" in first and "state a contact" in first
    assert last.startswith("step 2 to t = 1, where this is worst") and "lies 0.3 inside" in last
    assert not pressed(mesh, axis, 0.3, contact=True)


def test_a_run_that_fails_once_bodies_lie_in_each_other_asks_for_their_contact_first():
    """Not where what failed has another cause: a squeezed body grows into itself on its way."""
    for kind, told, first in (
        (CYCLING, True, True),
        (UNKNOWN, True, True),
        (CYCLING, False, False),
        (INVERTED, True, False),
    ):
        verdict = Verdict()
        if told:
            verdict.remark_on(OVERLAPS, {"a": Remark(0.1, "a node of body 'a' lies inside body 'b': state a contact")})
        verdict.stop(Finding(kind, "why", "where", "take more steps"), 1.0)
        assert verdict.remedy.startswith("state the contact without which") == first
        assert verdict.remedy.endswith("take more steps") and verdict.reason.endswith(verdict.remedy)


@pytest.mark.parametrize("turn", [0.0, 30.0, 45.0])
def test_each_pair_of_bodies_that_lie_in_each_other_is_told_however_it_is_turned(turn):
    """Blocks of one cell; what one pair says hides nothing of another, and a cell is as wide as its sides are long."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))

    def draw():
        corners = {"a": (0.0, 0.0), "b": (0.0, 1.1), "c": (4.0, 0.0), "d": (4.0, 1.1)}
        rectangles.build({name: (corner, (1.0, 1.0), (1, 1)) for name, corner in corners.items()})
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, (x, y, _) in zip(tags, places.reshape(-1, 3), strict=True):
            gmsh.model.mesh.setNode(tag, [c * x - s * y, s * x + c * y, 0.0], [])

    scene = Scene(*(Body(read, name, SOFT) for read in [read_gmsh(draw)] for name in "abcd"), plane="strain")
    for name in "ac":
        scene.fix(f"{name}_ymin")
    for name, deep in (("b", 0.3), ("d", 0.06)):
        x, y = 0.3, -0.1 - deep
        scene.prescribe(f"{name}_ymin", "x", c * x - s * y)
        scene.prescribe(f"{name}_ymin", "y", s * x + c * y)
    notes = [note for note in solve(scene, steps=1).require().verdict.notes if "where a cell is" in note]
    assert len(notes) == 2
    for note, (one, other, deep) in zip(sorted(notes), (("a", "b", 0.3), ("c", "d", 0.06)), strict=True):
        assert f"'{one}'" in note and f"'{other}'" in note and f"lies {deep:g} inside" in note and "is 1 wide" in note


def test_with_curved_cells_of_degree_2():
    mesh, axis = in_plane("quadrilaterals", order=2)
    _, last = pressed(mesh, axis, 0.3, degree=2)
    assert "lies 0.3 inside" in last
    assert not pressed(mesh, axis, 0.3, degree=2, contact=True)


# two legs, and three parts of the back between them: corner and size
CLIP = [((0.0, 0.0), (4.0, 1.0)), ((0.0, 1.5), (4.0, 1.0)), ((-1.0, 0.0), (1.0, 1.0)), ((-1.0, 1.0), (1.0, 0.5))]
CLIP += [((-1.0, 1.5), (1.0, 1.0))]


def clip(solid):
    """Two legs on a back, one body: quadrilaterals, or hexahedra as deep as they are wide."""
    occ, mesh = gmsh.model.occ, gmsh.model.mesh
    parts = [(2, occ.addRectangle(*corner, 0.0, *size)) for corner, size in CLIP]
    occ.fragment(parts[:1], parts[1:])
    dim = 3 if solid else 2
    if solid:
        occ.extrude(occ.getEntities(2), 0.0, 0.0, 0.5, [1], recombine=True)
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    gmsh.option.setNumber("Mesh.RecombineAll", 1)
    for _, surface in occ.getEntities(2):
        mesh.setTransfiniteSurface(surface)
    mesh.generate(dim)
    sides = {"below": (1, 0.0), "above": (1, 2.5), "inner_below": (1, 1.0), "inner_above": (1, 1.5)}
    occ_groups(dim, sides | ({"front": (2, 0.0)} if solid else {}))


def occ_groups(dim, places):
    """Names for the body, and for its sides by where they lie along an axis, inside the clip where that is said."""
    name = gmsh.model.setPhysicalName
    name(dim, gmsh.model.addPhysicalGroup(dim, [tag for _, tag in gmsh.model.getEntities(dim)]), "clip")
    sides = gmsh.model.getBoundary(gmsh.model.getEntities(dim), combined=True, oriented=False)
    middles = {tag: gmsh.model.occ.getCenterOfMass(dim - 1, tag) for _, tag in sides}
    for side, (axis, at) in places.items():
        found = [tag for tag, middle in middles.items() if abs(middle[axis] - at) < 1e-6]
        name(dim - 1, gmsh.model.addPhysicalGroup(dim - 1, found), side)


@pytest.mark.parametrize("solid", [False, True], ids=["plane", "solid"])
@pytest.mark.parametrize("held", [False, True], ids=["no contact", "contact"])
def test_a_body_inside_itself_is_told(solid, held):
    """The legs of a clip pressed together by more than there is room between them."""
    scene = Scene(Body(read_gmsh(clip, solid=solid), "clip", SOFT), **({} if solid else {"plane": "strain"}))
    scene.fix("below")
    if solid:
        scene.fix("front", "z")
    lid = rigid_plane((0, 2.5, 0), (0, -1, 0), name="lid")
    scene.contact("above", lid, name="lid")
    if held:
        scene.contact("inner_above", "inner_below", name="inner")
    result = solve(scene, move={lid: (0, -0.8, 0)}, steps=4)
    notes = [note for note in result.verdict.notes if "another part of itself" in note]
    assert bool(notes) != held and (held or "node of body 'clip'" in notes[0])


@pytest.mark.parametrize("cells", [(1, 1), (6, 4)])
def test_a_contact_that_few_nodes_carry_is_told(cells):
    """A block pressed onto another one by the two nodes of its side, and by seven."""
    drawn = {"lower": LOWER, "upper": ((-1.0, 0.0), (2.0, 2.0), cells)}
    scene = Scene(
        *(Body(mesh, name, SOFT) for mesh in [read_gmsh(rectangles.build, rectangles=drawn)] for name in drawn),
        plane="strain",
    )
    scene.fix("lower_ymin")
    scene.fix("upper_ymax", "x")
    scene.prescribe("upper_ymax", "y", -0.1)
    scene.contact("upper_ymin", "lower_ymax", name="c")
    notes = [note for note in solve(scene, steps=1).require().verdict.notes if "greatest load" in note]
    assert len(notes) == (cells == (1, 1)) and all("'c': 2 slave nodes carry" in note for note in notes)


@pytest.mark.parametrize(("way", "told"), [(1e-9, 0), (1e-3, 1)])
def test_a_contact_that_carries_next_to_nothing_is_not_said_to_be_carried_by_few_nodes(way, told):
    ways = {"pressed": 0.1, "touched": way}
    drawn = {"pressed": ((0.0, 0.0), (2.0, 2.0), (4, 4)), "touched": ((5.0, 0.0), (2.0, 2.0), (1, 1))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(*(Body(mesh, name, SOFT) for name in drawn), plane="strain")
    lids = {name: rigid_plane((0, 2, 0), (0, -1, 0), name=name) for name in drawn}
    for name, lid in lids.items():
        scene.fix(f"{name}_ymin")
        scene.contact(f"{name}_ymax", lid, name=name, points="nodes")
    result = solve(scene, move={lid: (0, -ways[name], 0) for name, lid in lids.items()}, steps=1).require()
    assert result.history[-1]["touched_load_N"] > 0.0
    assert sum("'touched': 2 slave nodes carry" in note for note in result.verdict.notes) == told


@pytest.mark.parametrize(("cells", "told"), [(4, True), (24, False)])
def test_a_ball_on_less_than_a_facet_of_gauss_points_is_told(cells, told):
    """On cells of 2 its force is 54 % too great, on those of a third 4 % (0.870 and 0.585 N beside 0.564 of degree 2)."""
    pad = {"pad": ((0.0, 0.0), (8.0, 8.0), (cells, cells))}
    scene = Scene(Body(read_gmsh(rectangles.build, rectangles=pad), "pad", SOFT), plane="axisymmetric")
    scene.fix("pad_ymin")
    ball = rigid_sphere(2.0, (0.0, 10.0, 0.0), name="ball")
    scene.contact("pad_ymax", ball, name="c", points=3)
    notes = solve(scene, move={ball: (0.0, -0.3, 0.0)}, steps=3).require().verdict.notes
    assert any("of its greatest load" in note and "Gauss point" in note for note in notes) == told, notes


def test_contacts_that_few_nodes_carry_are_one_note():
    row = {f"{name}_{of}": 2.0 for name in ("top", "bot") for of in ("load_N", "active_points", "peak_pressure_MPa")}
    (note,) = sparse_notes([row], {"top": Carriers(1.0, 3), "bot": Carriers(1.0, 3)}, Units())
    assert all(f"contact '{name}': 2 slave nodes carry" in note for name in ("top", "bot"))
    assert note.count("mesh more finely") == 1


def round_on_pad(cells, of_pad):
    """Half a round body, `cells` across, that touches a pad of cells 4 / of_pad wide."""
    rectangles.build({"body": ((0.0, 0.0), (1.0, 1.0), (cells, 4)), "pad": ((0.0, -4.0), (4.0, 4.0), (of_pad, of_pad))})
    body = gmsh.model.getPhysicalGroups(2)
    for group in body:
        if gmsh.model.getPhysicalName(*group) == "body":
            tags, x = gmsh.model.mesh.getNodesForPhysicalGroup(*group)
            for tag, place in zip(tags, x.reshape(-1, 3), strict=True):
                gmsh.model.mesh.setNode(tag, place + [0.0, place[0] ** 2 / 4.0, 0.0], [])


@pytest.mark.parametrize(
    ("cells", "of_pad", "stiff", "told"),
    [(16, 8, 100.0, True), (4, 24, 100.0, False), (16, 8, 1.0, False)],
    ids=["coarse master", "fine master", "as soft"],
)
def test_a_stiff_slave_on_facets_as_wide_as_the_contact_is_told(cells, of_pad, stiff, told):
    mesh = read_gmsh(round_on_pad, cells=cells, of_pad=of_pad)
    bodies = Body(mesh, "body", neo_hooke(stiff, 2.0 * stiff)), Body(mesh, "pad", neo_hooke(1.0, 2.0))
    scene = Scene(*bodies, plane="strain")
    for name in ("body", "pad"):
        scene.fix(f"{name}_xmin", "x")
    scene.fix("pad_ymin", "y")
    scene.prescribe("body_ymax", "y", -0.1)
    scene.contact("body_ymin", "pad_ymax", name="c")
    result = solve(scene, steps=1).require()
    notes = [note for note in result.verdict.notes if "within facets of the master" in note]
    assert bool(notes) == told, (result.verdict.notes, result.column("c_peak_pressure_MPa"), result.line("c", "x"))


@pytest.mark.parametrize("cells, said", [(10, 1), (40, 0)])
def test_a_master_narrower_than_the_slave_s_cells_is_told(cells, said):
    """A stiff pin 0.8 wide on a pad: with cells of 1 the force is 10 % too great, with cells of 0.25 5 %."""
    drawn = {"pad": ((0.0, -4.0), (10.0, 4.0), (cells, 8)), "pin": ((4.6, 0.0), (0.8, 1.0), (2, 2))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(Body(mesh, "pad", neo_hooke(1.0, 3.0)), Body(mesh, "pin", neo_hooke(100.0, 300.0)), plane="strain")
    scene.fix("pad_ymin")
    scene.fix("pin_ymax", "x")
    scene.prescribe("pin_ymax", "y", -0.1)
    scene.contact("pad_ymax", "pin_ymin", name="c")
    result = solve(scene, steps=1).require()
    assert len([note for note in result.verdict.notes if "3 slave nodes carry" in note]) == said, result.verdict.notes


@pytest.mark.parametrize("plane", [None, "strain"])
def test_nodes_on_edges_of_the_slave_are_told_where_the_law_asks_for_pressures(plane):
    """Their areas are those of both faces: the limit of shear holds over 131 % of the area in space."""
    told = {}
    for walls, law in ((True, coulomb(0.8, shear_limit=0.05)), (False, coulomb(0.8, shear_limit=0.05)), (True, 0.8)):
        if plane:
            mesh = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (6.0, 2.0), (6, 2))})
            names, up = ("box_ymin", "box_xmin", "box_xmax", "box_ymax"), (0, 1, 0)
        else:
            mesh = read_gmsh(box.build, size=(6.0, 6.0, 2.0), cells=(6, 6, 2))
            names, up = ("zmin", "xmin", "xmax", "zmax"), (0, 0, 1)
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane=plane)
        scene.fix(names[-1])
        floor = rigid_plane((3, 3 * (plane is None), 0), up, name="floor")
        scene.contact(names[:3] if walls else names[0], floor, law, name="c")
        drag = Stage("drag", move={floor: (4, 0, 0)}, steps=4)
        stages = [Stage("press", move={floor: tuple(0.2 * n for n in up)}, steps=3), drag]
        result = solve(scene, stages=stages).require()
        told[walls, law == 0.8] = any("nodes at edges between faces of the slave" in n for n in result.verdict.notes)
    assert told == {(True, False): True, (False, False): False, (True, True): False}


@pytest.mark.parametrize("how", ["tool", "support"])
def test_a_path_that_turns_within_a_step_is_told(how):
    """Led to 0.8 at t = 0.5 and back: five steps end at 0.64 before and after that, which ten do not."""
    notes = []
    for steps in (5, 10):
        mesh = read_gmsh(rectangles.build, rectangles={"box": ((0, 0), (2, 2), (2, 2))})
        scene, move = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane="strain"), {}
        scene.fix("box_ymin")
        if how == "tool":
            scene.tie("box_ymax", hub := rigid_hub("hub"))
            move = {hub: Motion(x=lambda t: 0.8 - 1.6 * abs(t - 0.5))}
        else:
            scene.prescribe("box_ymax", "x", lambda X, t: np.full(len(X), 0.8 - 1.6 * abs(t - 0.5)))
        notes.append(solve(scene, move=move, steps=steps).require().verdict.notes)
    rounds = Motion(x=lambda t: 0.3 * (math.cos(9 * t) ** 2 + math.sin(9 * t) ** 2) - 0.3)
    if move:
        assert not any("turns" in note for note in solve(scene, move={hub: rounds}, steps=5).require().verdict.notes)
    told = "its path turns about t = 0.5, within a step from t = 0.4 to 0.6, and goes back by 20% of its way"
    assert sum(told in note for note in notes[0]) == 1 and not any("turns" in note for note in notes[1])


# -- rounding is nothing to remark on ---------------------------------------------------------------------------------
def under_a_lid():
    mesh = read_gmsh(rectangles.build, rectangles={"lower": ((0.0, -4.0), (10.0, 4.0), (10, 4))})
    scene = Scene(Body(mesh, "lower", neo_hooke(1.0, 3.0)), plane="strain")
    scene.fix("lower_ymin")
    lid = rigid_plane((0.0, 0.0, 0.0), (0.0, -1.0, 0.0), name="lid")
    scene.contact("lower_ymax", lid, 0.3, name="c")
    return scene, lid


def test_a_stage_in_which_nothing_moves_jumps_nowhere():
    scene, lid = under_a_lid()
    moves = [((0, -0.6, 0), 3), ((0.5, 0, 0), 3), ((0, 0, 0), 4)]
    stages = [Stage(name, move={lid: way}, steps=steps) for name, (way, steps) in zip("pdh", moves, strict=True)]
    result = solve(scene, stages=stages)
    force = result.column("c_force_x_N")
    assert result.verdict.converged and force[-1] == pytest.approx(force[5], rel=1e-9)
    assert not [note for note in result.verdict.notes if "snap" in note or "jump" in note], result.verdict.notes


def test_a_body_at_rest_misses_no_energy():
    """A lid lies on it, or slides along it, and nothing presses."""
    scene, lid = under_a_lid()
    for way in (0.0, 0.5):
        result = solve(scene, move={lid: (way, 0, 0)}, steps=2)
        assert result.verdict.converged
        assert not [note for note in result.verdict.notes if "energy" in note], result.verdict.notes


def test_a_body_that_turns_without_strain_misses_no_energy():
    mesh = read_gmsh(rectangles.build, rectangles={"lower": LOWER})
    scene = Scene(Body(mesh, "lower", neo_hooke(1.0, 5.0)), plane="strain")
    hub = rigid_hub("hub", (-2.0, -1.0, 0.0))
    scene.tie("lower_xmin", hub)
    result = solve(scene, move={hub: Motion(rz=4 * math.pi)}, steps=24)
    assert result.verdict.converged and abs(result.column("hub_moment_z_Nmm")[-1]) < 1e-9
    assert not [note for note in result.verdict.notes if "energy" in note], result.verdict.notes


def test_a_contact_that_touches_by_rounding_alone_never_closed():
    """The lower end of the bow lies on the plane and slides along it; nothing presses it there."""
    mesh = read_gmsh(ring_sector.build, radii=(5.0, 6.0), cells=(2, 12), order=2)
    scene = Scene(Body(mesh, "ring", neo_hooke(1.0, 10.0)), plane="strain", degree=2, element="mixed")
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    lid, middle = rigid_plane((0, 6.0, 0), (0, -1, 0), name="lid"), rigid_plane((0, 0, 0), (0, 1, 0), name="middle")
    scene.contact("outer", lid, name="l")
    scene.contact("inner", middle, name="m")
    result = solve(scene, move={lid: (0, -0.5, 0)}, steps=2)
    assert result.verdict.converged and result.column("m_load_N")[-1] < 1e-12
    said = [note for note in result.verdict.notes if "'m'" in note or "supports prescribe" in note]
    assert len(said) == 1 and "never closed" in said[0], result.verdict.notes


@pytest.mark.parametrize("degree", [1, 2])
def test_a_block_that_swells_evenly_in_a_closed_box_is_told_nothing(degree):
    """Its multipliers take over the steps' pressures; with nodes of degree 1 three carry a wall's, the same each."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((0, 0), (2, 1), (4, 2))})
    scene = Scene(Body(mesh, "b", neo_hooke(1.0, 5.0)), plane="strain", element="mixed", degree=degree)
    scene.fix("b_xmin", "x")
    scene.fix("b_ymin", "y")
    walls = {"a": ((2, 0, 0), (-1, 0, 0), "b_xmax"), "b": ((0, 1, 0), (0, -1, 0), "b_ymax")}
    for name, (point, normal, side) in walls.items():
        scene.contact(side, rigid_plane(point, normal, name=name), name=name, penetration=1e-8)
    scene.swell("b", 1.2)
    result = solve(scene, steps=[0.25, 0.5, 0.75, 1]).require()
    assert result.column("a_load_N")[-1] == pytest.approx(5.0 * (1.0 - 1.0 / 1.2), rel=1e-6)  # K (1 - 1/J)
    assert result.verdict.notes == []


# -- a remedy is more than what is there ------------------------------------------------------------------------------
def test_cells_that_a_ball_comes_in_between_are_told_the_size_that_holds_it():
    """With cells of a third of its radius, which a ball that tilts the surface beside it still comes in between."""
    told = []
    for cells in (6, 9):
        mesh = read_gmsh(box.build, size=(4, 4, 2), cells=(cells, cells, 3))
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
        scene.fix("zmin")
        ball = rigid_sphere(2.0, (1.6, 2.2, 4), name="ball")
        scene.contact("zmax", ball, 0.5, name="c")
        turn = Stage("turn", move={ball: Motion(x=0.3, rx=0.4, rz=0.8)}, steps=4)
        stages = [Stage("press", move={ball: (0, 0, -0.5)}, steps=2), turn]
        notes = solve(scene, stages=stages).require().verdict.notes
        told.append([note for note in notes if "between nodes the surface hangs" in note])
    assert len(told[0]) == 1 and told[0][0].endswith("mesh it more finely, cells of 0.49 there") and not told[1]


def test_work_missed_on_turns_is_told_from_work_that_is_lost():
    """Two blocks that stick are turned together: nothing slides, and what is missing falls with the square of the turns, to
    what friction does on the way between a node and its place in the master."""
    missing, told = [], []
    for steps in (12, 24, 48):
        drawn = {"low": ((0, 0), (6, 2), (9, 3)), "up": ((1.2, 2.0), (3, 2), (7, 4))}
        mesh = read_gmsh(rectangles.build, rectangles=drawn)
        scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 5.0)) for name in drawn), plane="strain")
        hubs = [rigid_hub(name, (0, 0, 0)) for name in ("one", "other")]
        scene.tie("low_ymin", hubs[0])
        scene.tie("up_ymax", hubs[1])
        scene.contact("up_ymin", "low_ymax", 0.4, name="c")
        press = Stage("press", move={hubs[1]: Motion(y=-0.3)}, steps=6)
        shear = Stage("shear", move={hubs[1]: Motion(x=0.3)}, steps=6)
        turn = Stage("turn", move={hubs[0]: Motion(rz=3.0), hubs[1]: Motion(rz=3.0, **AROUND)}, steps=steps)
        result = solve(scene, stages=[press, shear, turn]).require()
        told.append([note for note in result.verdict.notes if note.startswith("energy")])
        missing.append(np.diff(result.column("energy_error_Nmm")[11:]).sum())
    assert "most of that in steps that turn a tool by up to 14 degrees" in told[0][0] and not told[2]
    assert (missing[0] - missing[1]) / (missing[1] - missing[2]) == pytest.approx(4.0, rel=0.05)


def test_work_that_one_of_several_turns_loses_is_not_said_to_be_lost_on_arcs():
    """The first turn begins to slip, the others slide on."""
    scene = Scene(
        Body(read_gmsh(box.build, size=(4, 4, 2), cells=(8, 8, 3), origin=(-2, -2, 0)), "box", neo_hooke(0.5, 2.0))
    )
    scene.fix("zmax")
    floor = rigid_plane((0, 0, 0), (0, 0, 1), name="floor")
    scene.contact("zmin", floor, 0.2, name="c")
    stages = [Stage("press", move={floor: (0, 0, 0.2)}, steps=1), Stage("turn", move={floor: Motion(rz=1.5)}, steps=6)]
    (note,) = (note for note in solve(scene, stages=stages).require().verdict.notes if note.startswith("energy"))
    assert "in step 2 to t = " in note and "arc" not in note


# how far a point goes that has come to (0.3, -0.3) when all turns about the origin
AROUND = {
    "x": lambda s: 0.3 * (np.cos(3.0 * s) - 1.0 + np.sin(3.0 * s)),
    "y": lambda s: 0.3 * (np.sin(3.0 * s) - np.cos(3.0 * s) + 1.0),
}


def test_a_cone_pressed_in_one_step_misses_no_energy_but_the_trapezoid_s():
    """A third of the work done, and a little more at large strain: force grows with the square of the way."""
    mesh = read_gmsh(graded_rectangle.build, width=20.0, height=20.0, mesh_size=0.3, fine=2.0, growth=1.25)
    scene = Scene(Body(mesh, "block", from_elastic(10.0, 0.3)), plane="axisymmetric")
    scene.fix("block_ymin", "y")
    cone = rigid_cone(half_angle=math.radians(80.0), apex=(0, 0, 0), direction=(0, -1, 0), name="cone")
    scene.contact("block_ymax", cone, name="c")
    result = solve(scene, move={cone: (0.0, -0.4, 0.0)}, steps=1).require()
    assert result.summary["energy"]["error_share"] > 1 / 3
    assert not [note for note in result.verdict.notes if note.startswith("energy")], result.verdict.notes


def test_a_run_that_fails_tells_what_its_steps_have_missed():
    """A sharp punch is led off a block's side, which takes its edge no force, and then through what is left of it."""
    mesh = read_gmsh(rectangles.build, rectangles={"block": ((-4, 0), (8, 3), (16, 6))})
    scene = Scene(Body(mesh, "block", neo_hooke(1.0, 5.0)), plane="strain")
    scene.fix("block_ymax")
    punch = rigid_punch(half_width=3, height=3, face=(0, 0, 0), direction=(0, 1, 0), fillet=0.0, name="punch")
    scene.contact("block_ymin", punch, name="c")
    stages = [Stage(name, move={punch: way}, steps=5) for name, way in (("press", (0, 0.3, 0)), ("lead", (3, 0, 0)))]
    crush = Stage("crush", move={punch: (0, 6.0, 0)}, steps=1)
    result = solve(scene, stages=[*stages, crush], method=Method(smallest_step=1.0))
    assert not result.converged and result.summary["energy"]["error_share"] > 0.1
    assert any(note.startswith("energy:") for note in result.verdict.notes), result.verdict.notes


def test_work_that_steps_miss_is_not_put_down_to_penalties():
    """A block is sheared in twice as many steps: what pairs of these miss is what half as many do. A ball is pressed into it
    in steps that are too long: the note asks for more of them, not for multipliers, with which as much is missing."""

    def sheared(steps):
        scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", SOFT))
        scene.fix("zmin")
        scene.prescribe("zmax", "x", 0.8)
        scene.pressure("ymax", 0.05)
        return solve(scene, steps=steps).require().summary["energy"]

    def pressed_in(steps, **options):
        scene = Scene(Body(read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(6, 6, 3)), "box", SOFT))
        scene.fix("zmin")
        ball = rigid_sphere(4.0, (2.0, 2.0, 6.0), name="ball")
        scene.contact("zmax", ball, 0.3, name="top", **options)
        result = solve(scene, move={ball: (0, 0, -0.6)}, steps=steps).require()
        return result.summary["energy"], [note for note in result.verdict.notes if note.startswith("energy: ")]

    coarse, fine = sheared(8), sheared(16)
    assert fine["error_growth"] == pytest.approx(coarse["error_Nmm"] / fine["error_Nmm"], rel=0.05)
    long = [*np.arange(0.02, 0.2, 0.02), 0.6, 1.0]
    (penalties, (note,)), (multipliers, (other,)) = pressed_in(long), pressed_in(long, penetration=1e-4)
    assert multipliers["error_share"] > 0.99 * penalties["error_share"]
    for text, found in ((note, penalties), (other, multipliers)):
        assert "penetration=" not in text and "take more steps there (steps twice as long miss" in text
        assert found["error_growth"] > 2.0
