"""Bodies and meshed tools that come in between the points of a slave, and slave nodes that means hide, are named."""

import re
from functools import partial

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Scene, neo_hooke, read_gmsh, rigid_curve, rigid_surface, solve
from fenics_contact.meshes import box, rectangles
from fenics_contact.scene.build import build

pytestmark = pytest.mark.parallel
SOFT, HARD = neo_hooke(1.0, 5.0), neo_hooke(1e4, 5e4)
FLOOR = ((-3.0, -3.0), (6.0, 3.0))


def wedge(wide=1.0, high=1.0):
    """The two sides of a wedge whose edge is the origin."""
    x = ((-wide, high), (0.0, 0.0), (wide, high))
    points = [gmsh.model.geo.addPoint(*place, 0.0) for place in x]
    lines = [gmsh.model.geo.addLine(*pair) for pair in zip(points[:-1], points[1:], strict=True)]
    gmsh.model.geo.synchronize()
    for line in lines:
        gmsh.model.mesh.setTransfiniteCurve(line, 7)
    gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, lines), "wedge")
    gmsh.model.mesh.generate(1)


def edge_and_floor(cells, wide=1.0):
    """A floor of 6 x 3 under a body on its edge in the origin."""
    g = gmsh.model.geo
    points = [g.addPoint(*x, 0.0) for x in ((0.0, 0.0), (wide, 1.0), (0.0, 2.0), (-wide, 1.0))]
    lines = [g.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    surface = g.addPlaneSurface([g.addCurveLoop(lines)])
    for line in lines:
        g.mesh.setTransfiniteCurve(line, 7)
    g.mesh.setTransfiniteSurface(surface)
    g.mesh.setRecombine(2, surface)
    g.synchronize()
    for dim, tags, name in ((2, [surface], "wedge"), (1, [lines[0], lines[3]], "sides"), (1, lines[1:3], "held")):
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
    rectangles.build({"floor": (*FLOOR, (cells, max(5, cells // 4)))})


def pressed(kind, cells=9, down=0.4, steps=4, degree=1, wide=1.0, swapped=False, laws=(SOFT, HARD), **options):
    """An edge, a body's or a tool's, pressed into a floor, which is the slave unless swapped; laws: of floor and body."""
    scene_of = {"plane": "strain", "degree": degree}
    if kind == "tool":
        mesh = read_gmsh(rectangles.build, rectangles={"floor": (*FLOOR, (cells, max(5, cells // 4)))})
        scene, tool = Scene(Body(mesh, "floor", SOFT), **scene_of), rigid_curve(wedge, wide=wide)
        scene.contact("floor_ymax", tool, 0.0, name="c", **options)
        more = {"move": {tool: (0.0, -down, 0.0)}}
    else:
        mesh = read_gmsh(edge_and_floor, cells=cells, wide=wide)
        scene, more = Scene(*map(partial(Body, mesh), ("floor", "wedge"), laws), **scene_of), {}
        scene.prescribe("held", "y", -down)
        scene.fix("held", "x")
        sides = "sides", "floor_ymax"
        scene.contact(*(sides if swapped else sides[::-1]), 0.0, name="c", **options)
    scene.fix("floor_ymin")
    record = {"top": lambda view: view.at((0.0, 0.0, 0.0)).displacement[1]} if kind == "tool" else None
    return solve(scene, steps=steps, record=record, **more)


def said(result, words):
    return [note for note in result.verdict.notes if words in note]


def depth(note):
    return float(re.search(r"lies ([\d.e-]+) inside", note)[1])


@pytest.mark.parametrize(("kind", "degree"), [("body", 1), ("body", 2), ("tool", 1), ("tool", 2)])
def test_an_edge_between_nodes_is_named_with_how_deep_it_lies(kind, degree):
    result = pressed(kind, degree=degree).require()
    # the same edge in a floor of 60 cells, where forces settle: 0.58 (of 240 cells 0.576)
    assert abs(result.column("floor_ymin_reaction_y_N")[-1]) < (0.3 if degree == 1 else 0.5)
    note = said(result, "inside the slave between its nodes")[-1]
    assert "100% of the force acts there" in note and "may be off by" in said(result, "in the end its load")[0]
    if degree == 1:
        assert "step 4 " in note and said(result, "off by as much as itself")
    if kind == "tool" and degree == 1:  # it is 0.4 lower, and so is the facet's middle by what its nodes have gone down
        assert depth(note) == pytest.approx(0.4 + result.column("top")[-1], abs=2e-3)


def missed(result):
    """By how much of itself the load of contact c would change, by the last state's tangent, and the notes that say so."""
    return result.summary["node_error"].get("c", {}).get("load_change_over_load", 0.0), said(result, "may be off by")


def test_of_what_two_nodes_carry_most_is_said_to_be_lost():
    """They have 71 % less than a floor of 60 cells, where the edge lies a quarter of a facet deep."""
    coarse, fine = (pressed("tool", cells=cells, down=0.26, wide=2.0, steps=2).require() for cells in (7, 60))
    forces = [result.column("floor_ymin_reaction_y_N")[-1] for result in (coarse, fine)]
    assert forces[0] / forces[1] < 0.5 and said(coarse, "inside the slave between its nodes")
    share, notes = missed(coarse)
    assert share > 0.5 * (forces[1] / forces[0] - 1.0) and len(notes) == 1 and "as much as itself" in notes[0]


def chamfered(cells, c=0.05):
    """A block 2 x 1 on a floor of 6 x 1, its lower edges cut by c at 45 degrees: the outer third of its columns is below
    these."""
    rectangles.build(
        {
            "floor": ((-3.0, -1.0), (6.0, 1.0), (9 * cells, 3 * cells)),
            "pad": ((-1.0, 0.0), (2.0, 1.0), (3 * cells, 2 * cells)),
        }
    )
    tags, X, _ = gmsh.model.mesh.getNodes()
    (group,) = (tag for _, tag in gmsh.model.getPhysicalGroups(2) if gmsh.model.getPhysicalName(2, tag) == "pad")
    (pad,) = gmsh.model.getEntitiesForPhysicalGroup(2, group)
    of_pad = set(gmsh.model.mesh.getNodes(2, pad, includeBoundary=True)[0])
    for tag, (x, y, _) in zip(tags, X.reshape(-1, 3), strict=True):
        if tag in of_pad:
            x = np.interp(x, (-1.0, -1 / 3, 1 / 3, 1.0), (-1.0, c - 1.0, 1.0 - c, 1.0))
            gmsh.model.mesh.setNode(tag, (x, y + max(c - 1.0 + abs(x), 0.0) * (1.0 - y), 0.0), [])


def test_a_small_chamfer_is_said_to_cost_what_it_does():
    """Three nodes carry a block whose chamfers lie deep beside their own size: a few percents, and not most, are missing."""
    found = []
    for cells in (1, 4):
        mesh = read_gmsh(chamfered, cells=cells)
        scene = Scene(Body(mesh, "floor", SOFT), Body(mesh, "pad", SOFT), plane="strain")
        scene.fix("floor_ymin")
        scene.fix("pad_ymax", "x")
        scene.prescribe("pad_ymax", "y", -0.07)
        scene.contact("pad_ymin", "floor_ymax", 0.3, name="c")
        found.append(solve(scene, steps=4).require())
    coarse, fine = (result.column("floor_ymin_reaction_y_N")[-1] for result in found)
    share, notes = missed(found[0])
    off = abs(coarse / fine - 1.0)  # 4 %, of which what lies inside is the most; to first order all of the overlap counts
    assert off < 0.1 and 0.5 * off < share < 4.0 * off
    assert said(found[0], "a slave node lies") and "most of itself" not in " ".join(found[0].verdict.notes)
    assert len(notes) == (share > 0.05)


@pytest.mark.parametrize("kind", ["body", "tool"])
def test_what_lies_between_nodes_that_do_not_reach_it_is_not_said_to_end_away(kind):
    """A blunt edge in the middle of a facet, whose mean gap is open."""
    result = pressed(kind, cells=3, down=0.1, wide=4.0).require()
    assert not result.column("c_load_N").any()
    (note,) = said(result, "never closed")
    assert depth(note) == pytest.approx(0.1, abs=1e-6) and "away" not in note


def test_the_remedy_helps_and_says_no_more_at_the_end():
    result = pressed("body", cells=60, steps=8).require()
    assert abs(result.column("floor_ymin_reaction_y_N")[-1]) == pytest.approx(0.576, rel=0.03)
    assert all(int(re.search(r"step (\d+)", note)[1]) < 4 for note in said(result, "inside the slave"))


def test_a_blade_that_no_pressure_holds_has_come_in():
    result = pressed("body", down=0.8, steps=8, wide=0.3)
    assert result.verdict.kind == "projection lost"
    assert "between its nodes, where no pressure holds it" in result.verdict.reason
    # of the facets' size, 0.667, three quarters
    assert 0.8 * result.column("t")[-1] == pytest.approx(0.5, abs=0.01)


def test_an_edge_of_the_slave_that_means_hide_is_named():
    note = said(pressed("body", swapped=True).require(), "a slave node lies")[0]
    assert "let the side without an edge there be the slave" in note


def test_notes_do_not_ask_for_one_side_and_then_for_the_other():
    """A soft edge on a stiffer floor: the edge is not to be the slave, and so the softer body is not either."""
    laws = neo_hooke(4.0, 20.0), SOFT
    edge, floor = (pressed("body", cells=24, swapped=swapped, laws=laws).require() for swapped in (True, False))
    assert all("the side without" in note for note in said(edge, "be the slave")) and said(edge, "be the slave")
    assert not any("'sides' be the slave" in note for note in floor.verdict.notes)
    (stiffer,) = said(floor, "the softer body as the slave")
    assert stiffer.endswith("unless an edge of it digs in")


@pytest.mark.parametrize("points", [3, "averages"])
def test_a_spike_of_a_tool_in_space_is_named(points):
    def spike():
        x = (0.2, 0.2, 0.0), (0.4, 0.2, 1.0), (0.1, 0.37, 1.0), (0.1, 0.03, 1.0)
        tip, *rim = (gmsh.model.geo.addPoint(*place) for place in x)
        rays = [gmsh.model.geo.addLine(tip, point) for point in rim]
        around = [gmsh.model.geo.addLine(rim[i], rim[(i + 1) % 3]) for i in range(3)]
        loops = [gmsh.model.geo.addCurveLoop([rays[i], around[i], -rays[(i + 1) % 3]]) for i in range(3)]
        faces = [gmsh.model.geo.addPlaneSurface([loop]) for loop in loops]
        gmsh.model.geo.synchronize()
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), "spike")
        gmsh.option.setNumber("Mesh.MeshSizeMin", 2.0)
        gmsh.model.mesh.generate(2)

    mesh = read_gmsh(box.build, size=(3.0, 3.0, 2.0), cells=(3, 3, 2), origin=(-1.5, -1.5, -2.0))
    # it comes down beside the middle of a facet, where a Gauss point is
    scene, tool = Scene(Body(mesh, "box", SOFT)), rigid_surface(spike, flip=True)
    scene.fix("zmin")
    scene.contact("zmax", tool, 0.0, name="c", points=points)
    result = solve(scene, move={tool: (0.0, 0.0, -0.4)}, steps=2)
    assert depth(said(result, "inside the slave between its nodes")[0]) >= 0.15


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_that_supports_lead_into_a_body_are_named_as_the_cause(degree):
    sides = {"pad": ((0.001, 0.0), (3.0, 3.0), (6, 6)), "wall": ((-1.0, -1.0), (1.0, 5.0), (3, 12))}
    mesh = read_gmsh(rectangles.build, rectangles=sides)
    scene = Scene(Body(mesh, "pad", SOFT), Body(mesh, "wall", HARD), plane="strain", degree=degree)
    scene.fix("pad_ymax", "y")
    scene.prescribe("pad_ymax", "x", -0.2)
    scene.fix("wall_xmin")
    scene.contact("pad_xmin", "wall_xmax", 0.0, name="c")
    result = solve(scene, steps=3)  # of degree 2 no state has the nearest places of the surface outside of the wall
    assert result.verdict.converged == (degree == 1)
    (note,) = said(result, "where supports prescribe the slave")
    assert "(0.001, 3, 0): a slave node lies" in note and "inside 'wall_xmax'" in note
    assert not said(result, "between its nodes")  # which follows from it


def test_what_lies_as_it_should_is_passed_over():
    sides = {"pad": ((0.0, 0.0), (3.0, 1.0), (7, 3)), "block": ((0.6, 1.0), (1.0, 1.0), (4, 4))}
    mesh = read_gmsh(rectangles.build, rectangles=sides)
    scene = Scene(Body(mesh, "pad", SOFT), Body(mesh, "block", SOFT), plane="strain")
    scene.fix("pad_ymin")
    scene.fix("block_ymax", "x")
    scene.prescribe("block_ymax", "y", -0.15)
    scene.contact("pad_ymax", "block_ymin", 0.3, name="c")
    result = solve(scene, steps=3).require()
    assert not said(result, " inside ") and np.abs(result.column("c_force_y_N")[-1]) > 0.1


LEDGES = {"under": ("left_ymin", "right_ymin"), "over": ("left_ymax", "right_ymax")}
FREE = {"lower": ("lower_xmin", "lower_xmax"), "upper": ("upper_xmin", "upper_xmax")}


def bearing(up=4):
    """Two layers of 2 x 0.5, so many cells up, bonded to a plate between them that juts out by 0.25."""
    drawn = {name: ((-1.0, y), (2.0, 0.5), (6, up)) for name, y in (("lower", 0.0), ("upper", 0.7))}
    drawn |= {"plate": ((-1.0, 0.5), (2.0, 0.2), (6, 1))}
    drawn |= {name: ((x, 0.5), (0.25, 0.2), (2, 1)) for name, x in (("left", -1.25), ("right", 1.0))}
    rectangles.build(drawn)
    gmsh.model.mesh.removeDuplicateNodes()


def held_bearing(pairs, degree, mu=50.0, **cells):
    """Contacts as they are stated of the layers' free sides and the plate's ledges."""
    mesh, plate = read_gmsh(bearing, **cells), neo_hooke(mu, 2.0 * mu)
    bodies = [Body(mesh, name, SOFT if name in FREE else plate) for name in ("lower", "upper", "left", "plate", "right")]
    scene = Scene(*bodies, plane="strain", degree=degree)
    scene.fix("lower_ymin")
    for i, pair in enumerate(pairs):
        scene.contact(*pair, 0.3, name=f"c{i}")
    return scene


def sheared(pairs, degree, down=0.3, aside=1.2, **bearing):
    """So far that nothing touches yet."""
    scene = held_bearing(pairs, degree, **bearing)
    scene.prescribe("upper_ymax", "y", -down)
    scene.prescribe("upper_ymax", "x", aside)
    return solve(scene, steps=4).require()


SIDES, BOTH = FREE["lower"] + FREE["upper"], LEDGES["under"] + LEDGES["over"]
STATED = {
    "as one": [(SIDES, BOTH)],
    "the other way round": [(BOTH, SIDES)],
    "by which way ledges look": [(SIDES, LEDGES["under"]), (SIDES, LEDGES["over"])],
}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pairs", [pytest.param(pairs, id=name) for name, pairs in STATED.items()])
def test_a_node_bonded_to_a_plate_is_not_in_it_from_its_other_side(pairs, degree):
    """Its side leans back over the plate, so that it looks through it at the ledge on its other side."""
    bare, result = sheared([], degree), sheared(pairs, degree)
    assert result.verdict.causes == bare.verdict.causes and not said(result, " inside ")
    for axis in "xy":
        force = [one.column(f"upper_ymax_reaction_{axis}_N")[-1] for one in (bare, result)]
        assert force[0] == pytest.approx(force[1], rel=1e-8)
    assert all(result.history[-1][f"c{i}_load_N"] == 0.0 for i in range(len(pairs)))


def test_a_ledge_does_not_press_on_what_lies_beyond_its_plate():
    """Behind itself it looks through the plate and the air beyond at the side of the other layer, which folds over there."""
    layers = [(LEDGES[ledge], FREE[layer]) for ledge, layer in (("under", "lower"), ("over", "upper"))]
    found, bare = [], sheared([], 2, 0.4, 1.0, mu=5.0, up=2)
    for pairs in ([(BOTH, SIDES)], layers):
        result = sheared(pairs, 2, 0.4, 1.0, mu=5.0, up=2)
        assert result.verdict.causes == bare.verdict.causes
        assert all(result.history[-1][f"c{i}_load_N"] == 0.0 for i in range(len(pairs)))
        found.append([result.column(f"upper_ymax_reaction_{axis}_N")[-1] for axis in "xy"])
    np.testing.assert_allclose(*found, rtol=1e-8)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair", [pytest.param((SIDES, BOTH), id="slave"), pytest.param((BOTH, SIDES), id="master")])
def test_a_node_that_comes_into_a_plate_from_below_is_found(pair, degree):
    """The lower layer's side is drawn up into it, and aside."""
    system = build(held_bearing([pair], degree)).system
    state, x = system.state, system.space.tabulate_dof_coordinates()
    assert not (system.contact_terms[0].places.crossing.found(state).depth > 1e-9).any()
    below = np.where(np.isclose(x[:, 0], -1.0), 0.5 - x[:, 1], 0.0)
    some = (below > 1e-9) & (below < 0.26)
    state.u.x.array.reshape(-1, 3)[some, :2] = np.stack([-0.4 * below, 0.03 + below], axis=1)[some]
    found = system.contact_terms[0].places.crossing.found(state)
    deep = state.comm.allgather(found.depth.max(initial=0.0))
    assert max(deep) == pytest.approx(0.03, rel=1e-9)
