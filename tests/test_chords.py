"""What straight cells cut off round surfaces: against closed forms, and what it does to loads against curved cells."""

from types import SimpleNamespace

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Scene, compat, from_elastic, read_gmsh, rigid_cylinder, rigid_surface, solve
from fenics_contact.contact.chords import cut_off
from fenics_contact.contact.master import MasterSurface, ToolSurface
from fenics_contact.meshes import ring_sector, tool_surfaces, tubes
from fenics_contact.output.history import chord_notes
from fenics_contact.units import Units

E, NU, BORE, DEEP = 1e3, 0.3, 2.0, 0.25


# -- the distances ------------------------------------------------------------------------------------------------------
def polygon(count, outwards):
    """A closed polygon in a circle of radius 2 as the sides of plane cells, seen from outside or from within."""
    angles = 2.0 * np.pi * np.arange(count) / count
    X = np.column_stack([2.0 * np.cos(angles), 2.0 * np.sin(angles), 0.0 * angles])
    first, second = np.arange(count), (np.arange(count) + 1) % count
    ends = [first, second] if outwards else [second, first]
    return SimpleNamespace(corners=(np.stack([*ends, *ends[::-1]], axis=1), np.full(count, 2)), X=X)


@pytest.mark.parametrize("outwards", [True, False])
def test_sides_of_a_polygon_lie_within_its_circle(outwards):
    """Mean distance of an arc from its chord: the segment's area over the chord; that of a parabola is a square short."""
    errors = []
    for count in (20, 40):
        turn = 2.0 * np.pi / count
        exact = 0.5 * 4.0 * (turn - np.sin(turn)) / (4.0 * np.sin(turn / 2.0)) * (1.0 if outwards else -1.0)
        errors.append(np.abs(cut_off(polygon(count, outwards)) / exact - 1.0).max())
    assert errors[0] < (np.pi / 10) ** 2 / 12 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_facets_of_a_ball_leave_out_what_its_volume_lacks(quadrilaterals):
    """Over half a ball area times distance is the volume between it and the polyhedron, to first order in that."""
    half = {"radius": 3.0, "centre": (0, 0, 0), "reach": 1.0}
    tool = rigid_surface(tool_surfaces.ball, "ball", mesh_size=0.3, quadrilaterals=quadrilaterals, **half)
    X = tool.X[tool.nodes]
    first, second, third = (X[:, i] - X[:, 0] for i in (1, 2, 3))
    halves = 0.5 * np.stack([np.cross(first, second), np.cross(second, third)])
    under = np.einsum("fc,hfc->", X[:, 0], halves) / 3.0  # of cones from the centre
    missing = 2.0 / 3.0 * np.pi * 27.0 - under
    found = np.linalg.norm(halves, axis=2).sum(axis=0) @ cut_off(ToolSurface(tool, 0))
    assert found == pytest.approx(missing, rel=0.1)  # around the open rim normals are those of one side


@pytest.mark.parallel
@pytest.mark.parametrize("tetrahedra", [False, True])
def test_middles_of_straight_cells_lie_within_a_ball_by_the_height_of_their_arcs(tetrahedra):
    """Against the mesh's own sphere; normals around a corner are means, and differ by the unevenness of its facets."""

    def draw():
        gmsh.model.occ.addSphere(0.0, 0.0, 0.0, 3.0)
        gmsh.model.occ.synchronize()
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "ball")
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [1]), "skin")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
        if not tetrahedra:
            gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
        gmsh.model.mesh.generate(3)

    mesh = read_gmsh(draw)
    surface = MasterSurface(compat.lagrange_space(mesh.domain, 2, (3,)), mesh.facets("skin"), whole=True)
    within = 3.0 - np.linalg.norm(surface.X, axis=1)
    assert within.max() > 0.005 and len(surface.X) > 500
    assert surface.arches.sum() == pytest.approx(within.sum(), rel=0.1)
    assert np.abs(surface.arches - within).mean() < 0.2 * within.mean()


def test_flat_surfaces_and_creases_cut_off_nothing():
    """A cube's facets meet at right angles; a plane's in one."""
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    rings = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    assert np.abs(cut_off(SimpleNamespace(corners=(rings, np.full(6, 4)), X=corners))).max() == 0.0


def test_a_ridge_beside_flat_facets_is_no_arc():
    """One end of a side leans, the other does not; of an arc between flats all sides but the first and the last are its."""
    angles = np.radians([0.0, 0.0, 0.0, 20.0, 20.0])
    X = np.cumsum([[0.0, 0.0, 0.0], *np.column_stack([3.0 * np.cos(angles), -3.0 * np.sin(angles), 0.0 * angles])], axis=0)

    def drawn(X):
        first = np.arange(len(X) - 1)
        ends = [first + 1, first]
        return SimpleNamespace(corners=(np.stack([*ends, *ends[::-1]], axis=1), np.full(len(first), 2)), X=X)

    assert np.abs(cut_off(drawn(X))).max() < 1e-15
    turns = np.radians([0.0, 0.0, *np.arange(2.5, 90.0, 5.0), 90.0, 90.0])  # sides of an arc of radius 2 between flats
    length = 4.0 * np.sin(np.radians(2.5))
    X = np.cumsum([[0.0, 0.0, 0.0], *(length * np.column_stack([np.cos(turns), -np.sin(turns), 0.0 * turns]))], axis=0)
    found = cut_off(drawn(X))
    np.testing.assert_allclose(found[3:-3], length**2 / 8.0 / 2.0 * 2.0 / 3.0, rtol=2e-3)
    assert np.abs(found[[0, 1, -2, -1]]).max() < 1e-15


# -- what they do to loads ----------------------------------------------------------------------------------------------
def fit(cells, interference, order=1, swap=False, deep=False, degree=None, points=None):
    """A shaft grown into a hub by an interference (quarter, plane strain); cells around of both; deep: a layer in space;
    degree: that of their cells unless given."""

    def draw():
        around = {"shaft": (1.0, BORE + interference, cells[0]), "hub": (BORE, 4.0, cells[1])}
        for name, (inner, outer, count) in around.items():
            ring_sector.build(radii=(inner, outer), cells=(6, count), name=name, prefix=f"{name}_", order=order)
        gmsh.model.geo.synchronize()

    def layer():
        tubes.build({"shaft": (1.0, BORE + interference, cells[0], 6), "hub": (BORE, 4.0, cells[1], 6)}, depth=DEEP)

    mesh = read_gmsh(layer if deep else draw)
    law = from_elastic(E, NU)
    plane = {} if deep else {"plane": "strain"}
    scene = Scene(Body(mesh, "shaft", law), Body(mesh, "hub", law), degree=degree or order, **plane)
    if deep:
        for group, axis in (("symmetry_y", "y"), ("symmetry_x", "x"), ("ends", "z")):
            scene.fix(group, axis)
    else:
        for body in ("shaft", "hub"):
            scene.fix(f"{body}_ymin", "y")
            scene.fix(f"{body}_xmin", "x")
    sides = ("shaft_outside", "hub_inside") if deep else ("shaft_outer", "hub_inner")
    slave, master = sides[::-1] if swap else sides
    scene.contact(slave, master, name="fit", points=points)
    return solve(scene, steps=1).require()


def load(result, deep=1.0):
    return result.history[-1]["fit_load_N"] / deep


def said(result, name="fit"):
    return result.summary["chord_error"].get(name, {}).get("load_change_over_load", 0.0)


def notes(result):
    return [note for note in result.verdict.notes if "round as their straight cells" in note]


@pytest.mark.parallel
@pytest.mark.parametrize(
    "cells, interference, swap",
    [((12, 16), 0.01, False), ((16, 12), 0.01, False), ((12, 16), 0.01, True), ((24, 32), 0.002, False)],
)
def test_rings_that_interfere_are_told_what_their_chords_do_to_the_load(cells, interference, swap):
    """Against curved cells, by which the load is exact to 0.2 % (Lame); what is said is so to first order."""
    straight, curved = fit(cells, interference, swap=swap), fit(cells, interference, order=2, swap=swap)
    true = load(curved) / load(straight) - 1.0
    assert abs(true) > 0.08
    assert 0.6 < said(straight) / true < 1.4
    assert len(notes(straight)) == 1 and f"{said(straight):+.0%}" in notes(straight)[0]
    assert not notes(curved) and said(curved) == 0.0


def test_a_change_of_many_times_the_load_is_not_given_as_a_figure():
    """A strap's load hardly depends on its drum's chords, and its rate with them, had they no friction, is endless."""
    found = {"load_change_over_load": 70.36, "cut_off_mm": 1e-3}
    (note,) = chord_notes({"strap": found}, Units())
    assert "70" not in note and "no first order tells" in note
    (note,) = chord_notes({"strap": found | {"load_change_over_load": 0.7}}, Units())
    assert "+70%" in note


def test_a_contact_whose_own_surfaces_are_not_off_is_told_whose_are():
    """A tube crushed flat on itself between lids: what its bore's chords take from that contact the lids feel."""
    own = {"load_change_over_load": -0.28, "cut_off_mm": 0.011}
    lid = {"load_change_over_load": -0.2, "cut_off_mm": 0.0}
    of_lid, of_self = chord_notes({"lid": lid, "self": own}, Units())
    assert of_lid.startswith("contact 'lid': were the surfaces of 'self' as round") and "by 0.011 mm" in of_lid
    assert of_self.startswith("contact 'self': were its surfaces as round") and "by 0.011 mm" in of_self
    of_lid, _ = chord_notes({"lid": lid | {"cut_off_mm": 1e-4}, "self": own}, Units())
    assert "were the surfaces of 'lid', 'self' as round" in of_lid


def test_the_interference_that_chords_hide_is_told_and_the_finer_cells_that_are_named_cure_it():
    """0.002 of a radius of 2 on 12 and 16 cells: six tenths of the load are missing."""
    coarse, exact = fit((12, 16), 0.002), load(fit((12, 16), 0.002, order=2))
    assert load(coarse) < 0.5 * exact and said(coarse) > 1.0
    finer = 7
    assert f"sides of 1/{finer} of their length" in notes(coarse)[0]
    fine = fit((finer * 12, finer * 16), 0.002)
    assert load(fine) == pytest.approx(exact, rel=0.03) and not notes(fine)


def test_chords_that_match_cost_nothing():
    result = fit((12, 12), 0.002)
    assert abs(said(result)) < 5e-3 and not notes(result)


def test_a_layer_is_told_the_same():
    flat, deep = fit((12, 16), 0.01), fit((12, 16), 0.01, deep=True)
    assert load(deep, DEEP) == pytest.approx(load(flat), rel=1e-9)
    # a derivative from differences over 1e-4, in which the penalties' round-off of 1e-10 is left: 1e-6 of it
    assert said(deep) == pytest.approx(said(flat), rel=1e-5)
    assert len(notes(deep)) == 1


@pytest.mark.parametrize("cells", [(12, 16), (16, 12)])
@pytest.mark.parametrize("swap", [False, True])
def test_gauss_points_of_degree_2_are_told_what_chords_do_where_they_touch(cells, swap):
    """They press where the chords of one body are nearest to those of the other: of 12 on 16 cells that is as deep as the
    circles, of 16 on 12 a fifth of the load deeper."""
    straight = fit(cells, 0.01, degree=2, points=3, swap=swap)
    true = load(fit(cells, 0.01, order=2, swap=swap)) / load(straight) - 1.0
    assert (abs(true) > 0.15) == bool(notes(straight)) == (cells == (16, 12))
    assert not [note for note in straight.verdict.notes if "nodes lie up to" in note]  # chords alone put them there
    assert said(straight) == pytest.approx(true, abs=0.03)  # what is told of at all


def test_gauss_points_of_a_layer_of_degree_2_are_told_the_same():
    flat, deep = (fit((16, 12), 0.01, degree=2, points=3, deep=deep) for deep in (False, True))
    assert load(deep, DEEP) == pytest.approx(load(flat), rel=1e-3)
    assert said(deep) == pytest.approx(said(flat), rel=0.02)


@pytest.mark.parametrize("points, off", [("nodes", False), (3, True)])
def test_a_bore_of_straight_cells_on_a_round_pin(points, off):
    """Its corners lie on the circle, and nodes press there rightly; Gauss points lie on the chords, deeper in the pin."""
    loads = []
    for order in (1, 2):
        mesh = read_gmsh(ring_sector.build, radii=(BORE, 4.0), cells=(6, 12), order=order, name="hub", prefix="hub_")
        scene = Scene(Body(mesh, "hub", from_elastic(E, NU)), plane="strain", degree=order)
        scene.fix("hub_ymin", "y")
        scene.fix("hub_xmin", "x")
        pin = rigid_cylinder(BORE + 0.02, (0, 0, 0), (0, 0, 1), name="pin")
        scene.contact("hub_inner", pin, name="fit", points=points)
        result = solve(scene, steps=1).require()
        loads.append(load(result))
        if order == 1:
            change, noted = said(result), notes(result)
    true = loads[1] / loads[0] - 1.0
    assert bool(noted) == off
    if off:
        assert abs(true) > 0.1 and 0.5 < change / true < 1.5  # the mean over facets, of which points touch the deepest parts
    else:
        assert change == 0.0 and abs(true) < 0.02


@pytest.mark.parametrize("points", ["nodes", 3])
def test_middles_of_degree_2_on_straight_cells_are_off_by_the_height_of_the_arc(points):
    """They are what touches in a bore, at nodes as at Gauss points: no mean over the facet."""
    mesh = read_gmsh(ring_sector.build, radii=(BORE, 4.0), cells=(3, 12), order=1, name="hub", prefix="hub_")
    scene = Scene(Body(mesh, "hub", from_elastic(E, NU)), plane="strain", degree=2)
    scene.fix("hub_ymin", "y")
    scene.fix("hub_xmin", "x")
    pin = rigid_cylinder(BORE + 1e-3, (0, 0, 0), (0, 0, 1), name="pin")
    scene.contact("hub_inner", pin, name="fit", points=points)
    found = solve(scene, steps=1).require().summary["chord_error"]["fit"]["cut_off_mm"]
    assert found == pytest.approx(BORE * (1.0 - np.cos(np.pi / 4.0 / 12)), rel=0.02)
