"""Round sides as slaves, of which few nodes touch: their normals lean, friction is that of what they touch all the same."""

import gmsh
import numpy as np
import pytest
from drawn import ring, straight
from mpi4py import MPI
from taylor import orders, remainders

from fenics_contact import (
    Body,
    Motion,
    Output,
    Scene,
    Stage,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_curve,
    rigid_hub,
    solve,
)
from fenics_contact.kernels.status import SLIP
from fenics_contact.meshes import rectangles

RADIUS = 0.3  # mm, in cells of 0.12


def finger(degree, tilt):
    """With a round tip as wide as it is, tilted [degrees] about that; just below is a flat road at the height 0."""
    geo, (s, c) = gmsh.model.geo, (f(np.radians(tilt)) for f in (np.sin, np.cos))

    def turned(x, y):
        return geo.addPoint(x * c - (y - RADIUS) * s, 0.005 + RADIUS + x * s + (y - RADIUS) * c, 0.0)

    middle = turned(0.0, RADIUS)
    around = [(-RADIUS, 1.0), (-RADIUS, RADIUS), (0.0, 0.0), (RADIUS, RADIUS), (RADIUS, 1.0)]
    p = [turned(*place) for place in around]
    arcs = [geo.addCircleArc(a, middle, b) for a, b in zip(p[1:3], p[2:4], strict=True)]
    skin = [geo.addLine(p[0], p[1]), *arcs, geo.addLine(p[3], p[4])]
    tip = geo.addPlaneSurface([geo.addCurveLoop([*skin, held := geo.addLine(p[4], p[0])])])
    q = [geo.addPoint(x, y, 0.0) for x, y in ((-3.0, -1.0), (3.0, -1.0), (3.0, 0.0), (-3.0, 0.0))]
    lines = [geo.addLine(a, b) for a, b in zip(q, q[1:] + q[:1], strict=True)]
    slab = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    for line, n in zip(lines, (40, 4, 40, 4), strict=True):
        geo.mesh.setTransfiniteCurve(line, n + 1)
    geo.mesh.setTransfiniteSurface(slab)
    geo.synchronize()
    groups = {"finger": (2, [tip]), "road": (2, [slab])}
    groups |= {"held": (1, [held]), "skin": (1, skin), "bed": (1, lines[:1]), "top": (1, lines[2:3])}
    for name, (dim, tags) in groups.items():
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.12)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.12)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(degree)


def dragged(friction, tilt=8.0, press=0.02, degree=2, drag=0.6, stages=3, swapped=False, out=None):
    """Of a run that presses it on, drags it along in two stages, and holds it; stages: how many of the four."""
    mesh = read_gmsh(lambda: finger(degree, tilt))
    bodies = Body(mesh, "finger", from_elastic(10.0, 0.3)), Body(mesh, "road", from_elastic(5e3 if swapped else 50.0, 0.3))
    scene = Scene(*bodies, plane="strain", degree=degree)
    scene.fix("held")
    scene.fix("bed")
    scene.contact(*(("top", "skin") if swapped else ("skin", "top")), friction, name="c")
    every = [
        Stage("press", prescribe={("held", "y"): -press}, steps=2),
        *(Stage(name, prescribe={("held", "x"): 0.5 * drag}, steps=3) for name in ("drag", "on")),
        Stage("hold", prescribe={("held", "x"): 0.0}, steps=4),
    ]
    return solve(scene, stages=every[:stages], out=out or Output()).require()


@pytest.mark.parallel
@pytest.mark.parametrize(
    "friction, how",
    [
        (0.5, {"tilt": 8.0}),
        (0.5, {"tilt": -8.0}),
        (0.2, {"tilt": 12.0}),
        (0.5, {"tilt": 0.0, "press": 0.05}),
        (0.5, {"tilt": 0.0, "press": 0.05, "degree": 1}),
        (0.5, {"tilt": 12.0, "press": 0.05, "drag": -0.6}),
    ],
)
def test_what_slides_on_a_flat_road_has_the_coefficients_friction(friction, how):
    """Along their own normals, which lean by as much as the finger is tilted, H/V would be 0.012, 0.30 ... 0.57."""
    result = dragged(friction, **how)
    last = result.history[-1]
    assert last["c_sticking_points"] == 0 < last["c_active_points"] <= 2
    assert abs(last["c_force_x_N"] / last["c_force_y_N"]) == pytest.approx(friction, rel=0.02)


@pytest.mark.serial
def test_a_flat_slave_keeps_its_own_normals():
    """The facets of a round master are off by half of what it bends from one to the next."""
    last = dragged(0.5, tilt=0.0, press=0.05, swapped=True).history[-1]
    assert last["c_sticking_points"] == 0
    assert abs(last["c_force_x_N"] / last["c_force_y_N"]) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.serial
@pytest.mark.parametrize("degree, off", [(1, 0.002), (2, 0.005)])
def test_a_flat_wall_is_the_same_in_one_facet_or_many(degree, off):
    """A strip's edge folds as it slides: its normals lean across the wall's ends, however far off these are."""
    ratios = []
    for cells in (1, 8):
        mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (1.5, 2.0), (6, 12))})
        scene = Scene(Body(mesh, "strip", neo_hooke(0.5, 4.0)), plane="strain", degree=degree)
        wall = rigid_curve(lambda n=cells: straight("wall", (0.0, -7.0), (0.0, 9.0), n), group="wall", name="wall")
        scene.contact("strip_xmin", wall, friction=0.3, name="c")
        scene.fix("strip_xmax")
        press = Stage("press", prescribe={("strip_xmax", "x"): -0.1}, steps=2)
        drag = Stage("drag", prescribe={("strip_xmax", "y"): 1.2}, steps=6)
        result = solve(scene, stages=[press, drag]).require()
        assert result.history[-1]["c_sticking_points"] == 0
        ratios.append(np.abs(result.column("c_force_y_N") / result.column("c_force_x_N"))[2:])
    np.testing.assert_allclose(ratios[0], ratios[1], rtol=1e-5)
    np.testing.assert_allclose(ratios[0][-1], 0.3, rtol=off)


@pytest.mark.serial
def test_what_acts_aside_at_walls_that_face_each_other_does_not_cancel():
    """Two strips with their outer sides on two walls, drawn up and down, in one contact and in one each."""
    told = []
    for sides in ([("left_xmin", "right_xmax")], ["left_xmin", "right_xmax"]):
        cells = {"left": ((0.0, 0.0), (1.5, 2.0), (6, 12)), "right": ((3.0, 0.0), (1.5, 2.0), (6, 12))}
        mesh = read_gmsh(rectangles.build, rectangles=cells)
        law = neo_hooke(0.5, 4.0)
        scene = Scene(Body(mesh, "left", law), Body(mesh, "right", law), plane="strain", degree=2)

        def walls():
            geo = gmsh.model.geo
            places = (((0.0, -7.0), (0.0, 9.0)), ((4.5, 9.0), (4.5, -7.0)))
            lines = [geo.addLine(*(geo.addPoint(*place, 0.0) for place in ends)) for ends in places]
            geo.synchronize()
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, lines), "walls")
            gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
            gmsh.model.mesh.generate(1)

        tool = rigid_curve(walls, group="walls", name="walls")
        for side in sides:
            scene.contact(side, tool, friction=0.3)
        inner = ("left_xmax", "right_xmin")
        for side in inner:
            scene.fix(side)
        press = Stage("press", prescribe={(side, "x"): way for side, way in zip(inner, (-0.17, 0.17), strict=True)}, steps=2)
        drag = Stage("drag", prescribe={(side, "y"): way for side, way in zip(inner, (0.6, -0.6), strict=True)}, steps=3)
        notes = solve(scene, stages=[press, drag]).require().verdict.notes
        told.append([float(note.split("and ")[1].split(" of the load")[0]) for note in notes if "acts aside" in note])
    assert len(told[0]) == 1 and len(told[1]) == 2
    np.testing.assert_allclose(told[0], np.mean(told[1]), rtol=0.1)
    assert told[0][0] > 0.005


@pytest.mark.serial
def test_a_slight_ridge_changes_nothing_on_the_flat_facets_beside_it():
    """However long these are: their normals do not turn on the way to it, and no arc is cut off."""
    ratios = []
    for slope, cells in ((0.0, 1), (0.4, 1), (0.57, 4)):
        mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (1.5, 2.0), (6, 12))})
        scene = Scene(Body(mesh, "strip", neo_hooke(0.5, 4.0)), plane="strain")

        def wall(slope=slope, cells=cells):  # the strip begins 0.3 below the ridge and is drawn down
            geo = gmsh.model.geo
            points = [geo.addPoint(*place, 0.0) for place in ((0.0, -5.7), (0.0, 2.3), (-slope, 3.3))]
            lines = [geo.addLine(*pair) for pair in zip(points, points[1:], strict=False)]
            for line, count in zip(lines, (cells, 1), strict=True):
                geo.mesh.setTransfiniteCurve(line, count + 1)
            geo.synchronize()
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, lines), "wall")
            gmsh.model.mesh.generate(1)

        scene.contact("strip_xmin", rigid_curve(wall, group="wall", name="wall"), friction=0.3, name="c")
        scene.fix("strip_xmax")
        press = Stage("press", prescribe={("strip_xmax", "x"): -0.04}, steps=2)
        drag = Stage("drag", prescribe={("strip_xmax", "y"): -1.2}, steps=8)
        result = solve(scene, stages=[press, drag]).require()
        assert not any("lean from" in note or "as round as" in note for note in result.verdict.notes), result.verdict.notes
        ratios.append((result.column("c_force_y_N") / result.column("c_force_x_N"))[2:])
    np.testing.assert_allclose(np.abs(ratios), 0.3, rtol=2e-3)


@pytest.mark.serial
def test_what_comes_to_rest_stays_there():
    """The master's normals are those where the last step ended: forces settle with them."""
    result = dragged(0.5, tilt=0.0, press=0.05, stages=4)
    changes = np.abs(np.diff(result.column("c_force_x_N")[-5:]))
    assert (changes[1:] < 0.5 * changes[:-1]).all()
    work = result.column("c_friction_work_Nmm")
    assert np.diff(work)[-1] < 1e-3 * np.diff(work)[-5]
    assert not any("snap" in note for note in result.verdict.notes)


@pytest.mark.serial
def test_tangent_where_round_sides_press_along_the_masters_normals():
    system = dragged(0.5, tilt=0.0, press=0.05).system
    contact, state = system.contact_terms[0], system.state
    state.u.x.array[:] += 1e-6 * np.random.default_rng(3).uniform(-1, 1, len(state.u.x.array))
    system.foresight.resample(state)
    around, slaves = contact.places.around, contact.places.samples.slaves
    assert (slaves.leans[~around.tips] > 0.1).any()
    assert (contact.response(state).status == SLIP).any()
    assert orders(remainders(system, contact, 1e-7)).min() > 1.98


@pytest.mark.parallel
def test_a_run_is_resumed_with_what_presses_aside(tmp_path):
    out = MPI.COMM_WORLD.bcast(tmp_path)
    dragged(0.5, stages=2, out=Output(out, checkpoint=True))
    resumed, whole = dragged(0.5, out=Output(out, checkpoint=True, resume=True)), dragged(0.5)
    for key in ("c_force_x_N", "c_force_y_N"):
        np.testing.assert_allclose(resumed.column(key), whole.column(key), rtol=1e-7)


@pytest.mark.parallel
def test_a_wheel_that_spins_on_facets_is_told_by_how_much_its_friction_is_off():
    """At each step nodes come to the road that have not slid yet, and press along their own normals."""
    mesh = read_gmsh(lambda: ring("tyre", 0.0, (4.0, 8.0), (3, 12), ("inside", "outside")))
    scene = Scene(Body(mesh, "tyre", neo_hooke(1.0, 5.0)), plane="strain")
    hub = rigid_hub("hub")
    scene.tie("inside", hub)
    road = rigid_curve(lambda: straight("road", (20, -8.01), (-20, -8.01), 60), group="road", name="road")
    scene.contact("outside", road, 0.4, name="c")
    stages = [
        Stage("down", move={hub: Motion(y=-0.2)}, steps=1),
        Stage("press", move={hub: Motion(force=(0, -4.0, 0))}, steps=2),
        Stage("spin", move={hub: Motion(x=6.0, force=(0, -4.0, 0), rz=-1.6)}, steps=12),
    ]
    result = solve(scene, stages=stages, out=Output(progress=False)).require()
    excess = (np.abs(result.column("hub_force_x_N")) / 4.0 - 0.4)[-6:]
    assert excess.max() > 0.035
    (note,) = (note for note in result.verdict.notes if "its tangential force may be off by up to" in note)
    share = float(note.split("up to ")[1].split()[0])
    assert share == pytest.approx(excess.max(), rel=0.1)
