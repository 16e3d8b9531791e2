"""The reported cost of the penalties against the true one: the same scene with greater penalties."""

import json

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import (
    Body,
    Method,
    Penalty,
    Scene,
    Stage,
    Units,
    from_elastic,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box, graded_rectangle, punch_plate, rectangles, two_blocks
from fenics_contact.output.history import penalty_lines

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def punch(penalty, pushed=False):
    mesh = read_gmsh(punch_plate.build, inside=4, outside=3, layers=2, ratio=1.0)
    scene = Scene(Body(mesh, "plate", RUBBER))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    tool = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", tool, 0.3, penalty=penalty, name="c")
    scene.contact("bottom", rigid_plane(name="floor"), 0.2, penalty=penalty, name="bottom")
    return scene, {"push": {tool: (0, 0, -60.0)}} if pushed else {"move": {tool: (0, 0, -1.0)}}


def sphere(penalty):
    scene = Scene(Body(read_gmsh(box.build, size=(10, 10, 5), cells=(7, 7, 4), origin=(0, 0, -5)), "box", RUBBER))
    for group, axis in (("zmin", "xyz"), ("xmin", "x"), ("ymin", "y")):
        scene.fix(group, axis)
    tool = rigid_sphere(10.0, (0, 0, 10.0))
    scene.contact("zmax", tool, 0.3, penalty=penalty, name="c")
    return scene, {"move": {tool: (0, 0, -1.0)}}


def blocks(penalty):
    mesh = read_gmsh(two_blocks.build, lower_cells=(6, 6, 2), upper_cells=(4, 4, 2))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -2.0)
    scene.contact("upper_bottom", "lower_top", 0.3, penalty=penalty, points="corners", name="c")
    return scene, {}


def pair(build, penalty, stiffer, **options):
    """Results at a soft penalty and at one so stiff that what is left of its error, a fiftieth, does not count."""
    results = []
    for factor in (1.0, stiffer):
        scene, drive = build(factor * penalty, **options)
        results.append(solve(scene, **drive, steps=2).require())
    return results


@pytest.mark.parametrize(("build", "penalty", "stiffer"), [(punch, 5.0, 50.0), (sphere, 5.0, 50.0), (blocks, 2.0, 50.0)])
def test_force(build, penalty, stiffer):
    soft, stiff = pair(build, penalty, stiffer)
    true = stiff.history[-1]["c_force_z_N"] - soft.history[-1]["c_force_z_N"]
    said = soft.summary["penalty_error"]["contacts"]["c"]
    assert abs(true) > 0.05 * abs(stiff.history[-1]["c_force_z_N"])  # the penalty is soft enough to matter
    assert 0.5 < said["force_change_N"][2] / true < 2.0  # the bound asked for; first order in 1/penalty
    change = np.linalg.norm(said["force_change_N"])
    np.testing.assert_allclose(said["force_change_over_load"], change / said["load_N"], rtol=1e-9)
    normal = abs(soft.history[-1]["c_force_z_N"])  # the pressure on a flat surface, and friction where it is curved
    assert 0.9 * normal < said["load_N"] < 1.1 * normal


def ring_on_a_shaft(penalty):
    """A ring pressed from outside on a rigid shaft: all forces on the shaft cancel."""
    mesh = read_gmsh(full_ring)
    scene = Scene(Body(mesh, "ring", RUBBER))
    scene.fix("ends", "z")
    scene.pressure("outside", 0.2)
    scene.contact("inside", rigid_cylinder(10.0, (0, 0, 0), (0, 0, 1)), 0.3, penalty=penalty, name="c")
    return scene, {}


def full_ring(inner=10.0, outer=14.0, depth=2.0, around=6, across=2):
    """A ring in four sectors of hexahedra."""
    occ, mesh = gmsh.model.occ, gmsh.model.mesh
    corners = [[occ.addPoint(r * c, r * s, 0) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))] for r in (inner, outer)]
    centre = occ.addPoint(0, 0, 0)
    spokes = [occ.addLine(*ends) for ends in zip(*corners, strict=True)]
    arcs = [[occ.addCircleArc(ring[i - 1], centre, ring[i]) for i in range(4)] for ring in corners]
    loops = [occ.addCurveLoop([spokes[i - 1], arcs[1][i], -spokes[i], -arcs[0][i]]) for i in range(4)]
    sectors = [(2, occ.addPlaneSurface([loop])) for loop in loops]
    occ.synchronize()
    for curves, cells in ((spokes, across), (arcs[0] + arcs[1], around)):
        for curve in curves:
            mesh.setTransfiniteCurve(curve, cells + 1)
    for _, face in sectors:
        mesh.setTransfiniteSurface(face)
        mesh.setRecombine(2, face)
    made = np.array(occ.extrude(sectors, 0, 0, depth, [1], recombine=True))[:, 1].reshape(4, 6).tolist()
    occ.synchronize()
    mesh.generate(3)
    tops, volumes, _, outside, _, inside = zip(*made, strict=True)  # of each sector
    for name, faces in (("ends", [*tops, *(tag for _, tag in sectors)]), ("outside", outside), ("inside", inside)):
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, volumes), "ring")


def test_a_ring_on_a_shaft_has_a_load_and_no_resultant():
    soft, stiff = pair(ring_on_a_shaft, 1.0, 50.0)
    said, at_fifty = (r.summary["penalty_error"]["contacts"]["c"] for r in (soft, stiff))
    assert said["force_change_over_load"] < 1e-6  # Newton's tolerance 1e-8, enlarged by a free turn that friction holds
    true = at_fifty["load_N"] / said["load_N"] - 1.0
    assert true > 0.02
    assert 0.5 < said["load_change_over_load"] / true < 2.0


@pytest.mark.parametrize(
    "peak, words",
    [(0.003, "2 MPa at (0, 1) of the undeformed body, by +0.30%"), (None, "more than a third")],
)
def test_the_line_says_of_what_its_shares_are(peak, words):
    contact = {"load_N": 40.0, "force_change_over_load": 0.001, "load_change_over_load": 0.0017, "peak_pressure_MPa": 2.0}
    contact |= {"peak_pressure_at_mm": [0.0, 1.0], "peak_pressure_change_share": peak}
    (line,) = penalty_lines({"contacts": {"nip": contact}}, Units())
    assert (
        "a load of 40 N" in line and "its force by 0.10% of this load, the load itself by +0.17%" in line and words in line
    )


def test_a_cost_above_a_percent_is_noted(tmp_path, capsys):
    folder, notes = COMM.bcast(tmp_path), []
    for i, penalty in enumerate((5.0, 250.0)):
        scene, drive = punch(penalty)
        result = solve(scene, **drive, steps=2, out=folder / str(i))
        COMM.Barrier()
        notes.append([note for note in result.verdict.notes if "penalties change the force" in note])
        assert json.loads((folder / str(i) / "summary.json").read_text())["verdict"]["notes"] == result.verdict.notes
        printed = capsys.readouterr().err
        assert all(note in printed for note in notes[-1]) or COMM.rank > 0
    assert len(notes[0]) == 2 and not notes[1]
    assert "contact 'c'" in notes[0][0] and "Penalty(factor=...)" in notes[0][0]


def test_a_pushed_tool_too_deep_by_a_percent_is_noted():
    soft, stiff = pair(punch, 5.0, 50.0, pushed=True)
    said = [
        [note for note in r.verdict.notes if note.startswith("tool 'punch': penalties change its travel")]
        for r in (soft, stiff)
    ]
    assert [len(notes) for notes in said] == [1, 0]


def test_of_a_tool_that_has_come_back_the_greatest_travel_counts():
    """The push falls to a fiftieth, and what travel is left is nearly all of the floor's and the tool's penalties."""
    scene, how = punch(5.0, pushed=True)
    (tool,) = how["push"]
    result = solve(
        scene, push={tool: lambda t: np.array([0.0, 0.0, -60.0 * min(2.0 * t, 1.98 - 1.96 * t)])}, steps=4
    ).require()
    left = abs(result.column("punch_travel_z_mm")[-1])
    assert result.summary["penalty_error"]["travel_change"]["punch_mm"][2] > 0.02 * left
    assert not [note for note in result.verdict.notes if "penalties change its travel" in note]


def test_peak_pressure_and_summary(tmp_path):
    folder = COMM.bcast(tmp_path)
    soft, stiff = pair(punch, 5.0, 50.0)
    peaks = [r.summary["penalty_error"]["contacts"]["c"]["peak_pressure_MPa"] for r in (soft, stiff)]
    said = soft.summary["penalty_error"]["contacts"]["c"]["peak_pressure_change_share"]
    assert 0.5 < said / (peaks[1] / peaks[0] - 1.0) < 2.0
    scene, drive = punch(5.0)
    solve(scene, **drive, steps=1, out=folder)
    COMM.Barrier()
    assert "c" in json.loads((folder / "summary.json").read_text())["penalty_error"]["contacts"]


@pytest.mark.parametrize("points", ["nodes", 2])
def test_the_peak_is_the_columns_and_its_change_a_share_of_that(points):
    """At an edge too, where a node's pressure counts over the sides that are pressed."""
    peaks, shares = [], []
    for penalty in (10.0, 500.0):
        mesh = read_gmsh(two_blocks.build, lower_cells=(6, 6, 2), upper_cells=(4, 4, 2))
        scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
        scene.fix("lower_bottom")
        scene.fix("upper_top")
        scene.contact("upper_bottom", "lower_top", 0.3, penalty=penalty, points=points, name="c")
        down, aside = (Stage(axis, prescribe={("upper_top", axis): way}, steps=2) for axis, way in (("z", -2.0), ("x", 3.0)))
        result = solve(scene, stages=[down, aside]).require()
        said = result.summary["penalty_error"]["contacts"]["c"]
        peaks.append(result.column("c_peak_pressure_MPa")[-1])
        shares.append(said["peak_pressure_change_share"])
        assert said["peak_pressure_MPa"] == pytest.approx(peaks[-1], rel=1e-8)
    assert 0.5 < shares[0] / (peaks[1] / peaks[0] - 1.0) < 2.0


def test_a_pushed_tool_goes_less_deep():
    soft, stiff = pair(punch, 5.0, 50.0, pushed=True)
    true = stiff.history[-1]["punch_travel_z_mm"] - soft.history[-1]["punch_travel_z_mm"]
    error = soft.summary["penalty_error"]
    assert 0.5 < error["travel_change"]["punch_mm"][2] / true < 2.0
    assert abs(error["contacts"]["c"]["force_change_N"][2]) < 1e-5 * 60.0  # the force is given; 1e-4 of a linear solve


def test_the_state_is_left_as_it_was():
    scene, drive = sphere(5.0)
    result = solve(scene, **drive, steps=2)
    system, contact = result.system, result.system.contact_terms[0]
    force = -(contact.response(system.state).traction * contact.surface.area[..., None]).sum(axis=(0, 1))
    total = COMM.allreduce(force)
    np.testing.assert_allclose(total[2], result.history[-1]["c_force_z_N"], rtol=1e-9)  # nothing moved but round-off
    assert system.assemble_residual() < 1e-7 * abs(total[2])
    np.testing.assert_array_equal(system.state.u.x.array, system.trail.last.u)


def test_error_of_a_homogeneous_bar():
    """A bar between a support and a plane: the penalty is a spring 1/eps in series, so errors are as 1/eps."""
    said, forces = [], []
    for penalty in (50.0, 100.0, 200.0):
        scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", RUBBER))
        for axis in "xyz":
            scene.fix(f"{axis}min", axis)
        plate = rigid_plane((0, 0, 2.0), (0, 0, -1.0))
        scene.contact("zmax", plate, penalty=penalty, name="c")
        result = solve(scene, move={plate: (0, 0, -0.2)}, steps=1).require()
        said.append(result.summary["penalty_error"]["contacts"]["c"]["force_change_N"][2])
        forces.append(result.history[-1]["c_force_z_N"])
    said, forces = np.array(said), np.array(forces)
    # Richardson: F(inf) = 2 F(2 eps) - F(eps) up to second order; the penetration is 1 % of the squeeze at 50 MPa/mm
    np.testing.assert_allclose(said[:-1], 2.0 * np.diff(forces), rtol=0.05)
    np.testing.assert_allclose(said[:-1] / said[1:], 2.0, rtol=0.05)


@pytest.mark.parametrize("penetration", [1e-2, 3e-2])
def test_what_multipliers_have_left(penetration):
    """An augmented contact against one without penetration: a bar on a plane, squeezed by 0.2 of 2 mm."""
    forces, said = [], None
    for allowed in (penetration, 1e-8):
        scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", RUBBER))
        for axis in "xyz":
            scene.fix(f"{axis}min", axis)
        plate = rigid_plane((0, 0, 2.0), (0, 0, -1.0))
        scene.contact("zmax", plate, penalty=2.0, penetration=allowed, name="c")
        result = solve(scene, move={plate: (0, 0, -0.2)}, steps=1).require()
        forces.append(result.history[-1]["c_force_z_N"])
        said = said or result.summary["penalty_error"]["contacts"]["c"]
    true = forces[1] - forces[0]
    assert abs(true) > 5e-3 * abs(forces[1])  # some error is left, and it is what is said
    assert 0.5 < said["force_change_N"][2] / true < 2.0


@pytest.mark.parametrize("pushed", [False, True])
def test_where_nothing_presses_any_more_the_penalties_cost_nothing(pushed):
    """A lid that is pressed down and let go: what is left are 1e-16 of the force, and no share of them is said."""
    scene = Scene(Body(read_gmsh(box.build, size=(6, 6, 3), cells=(4, 4, 2)), "box", RUBBER))
    scene.fix("zmin")
    lid = rigid_plane((0, 0, 3.0), (0, 0, -1.0), name="lid")
    scene.contact("zmax", lid, 0.2, name="c")
    way = lambda t: (0, 0, -0.5 * np.sin(np.pi * t) if t < 1.0 else 0.0)  # noqa: E731
    result = solve(scene, **{"push" if pushed else "move": {lid: way}}, steps=8, method=Method(stabilise=pushed)).require()
    assert not any("penalties" in note for note in result.verdict.notes), result.verdict.notes
    error = result.summary["penalty_error"]["contacts"]["c"]
    assert error["load_N"] == error["force_change_over_load"] == error["load_change_over_load"] == 0.0


def draw_slot():
    """A block 6 x 2.4 with a slot 0.4 high from its right end to x = 1.5."""
    geo, model = gmsh.model.geo, gmsh.model
    points = [geo.addPoint(0.0, y, 0.0) for y in (-1.2, -0.2, 0.2, 1.2)]
    for i, (low, high, layers) in enumerate(zip(points[:-1], points[1:], (4, 2, 4), strict=True)):
        line = geo.addLine(low, high)
        geo.mesh.setTransfiniteCurve(line, layers + 1)
        end = geo.extrude([(1, line)], 1.5, 0, 0, numElements=[3], recombine=True)[0]
        if i != 1:
            geo.extrude([end], 4.5, 0, 0, numElements=[12], recombine=True)
    geo.synchronize()
    model.setPhysicalName(2, model.addPhysicalGroup(2, [tag for _, tag in model.getEntities(2)]), "body")
    sides = {"left": (-0.1, -2, 0.1, 2), "top": (1.4, 1.1, 7, 1.3), "bot": (1.4, -1.3, 7, -1.1)}
    sides |= {"slot_top": (1.4, 0.1, 7, 0.3), "slot_low": (1.4, -0.3, 7, -0.1)}
    for name, (x, y, right, above) in sides.items():
        curves = model.getEntitiesInBoundingBox(x, y, -1, right, above, 1, 1)
        model.setPhysicalName(1, model.addPhysicalGroup(1, [tag for _, tag in curves]), name)
    model.mesh.generate(2)


def closed_slot(factor):
    """Its arms pressed together; beside the slot's end what facets see is held in the last step."""
    scene = Scene(Body(read_gmsh(draw_slot), "body", neo_hooke(1.0, 5.0)), plane="strain", degree=2)
    scene.fix("left")
    scene.prescribe("top", "x", 0.0)
    scene.prescribe("bot", "x", 0.0)
    scene.prescribe("top", "y", -0.5)
    scene.prescribe("bot", "y", 0.5)
    scene.contact("slot_top", "slot_low", 0.3, penalty=Penalty(factor=factor), name="c")
    return solve(scene, steps=5).require()


def test_a_state_is_varied_with_the_sights_that_it_was_accepted_with():
    soft, stiff = closed_slot(100), closed_slot(200)
    of = soft.summary["penalty_error"]["contacts"]["c"]
    loads = [result.column("c_load_N")[-1] for result in (soft, stiff)]
    assert of["load_N"] == pytest.approx(loads[0], rel=1e-9)
    assert 0.5 * of["load_change_over_load"] == pytest.approx(loads[1] / loads[0] - 1.0, rel=0.1)
    assert of["force_change_over_load"] < 0.01 and not any("penalties change" in note for note in soft.verdict.notes)
    soft.audit()  # goes away from the state and back
    assert soft.system.assemble_residual() < 1e-8 * loads[0]


@pytest.mark.parametrize("penetration", [1e-4, 1e-6])
def test_what_is_left_of_a_load_that_is_gone_has_no_note(penetration):
    """A block that swells in a closed box and shrinks back to where it began."""
    scene = Scene(
        Body(read_gmsh(rectangles.build, rectangles={"b": ((0, 0), (2, 1), (4, 2))}), "b", neo_hooke(1.0, 5.0)),
        plane="strain",
        element="mixed",
        degree=2,
    )
    scene.fix("b_xmin", "x")
    scene.fix("b_ymin", "y")
    scene.contact("b_xmax", rigid_plane((2, 0, 0), (-1, 0, 0), name="a"), name="a", penetration=penetration)
    scene.contact("b_ymax", rigid_plane((0, 1, 0), (0, -1, 0), name="b"), name="b", penetration=penetration)
    scene.swell("b", lambda t: 1.0 + 0.2 * np.sin(np.pi * t))
    result = solve(scene, steps=[0.25, 0.5, 0.75, 1.0]).require()
    assert max(result.column("a_load_N")) == pytest.approx(5.0 * (1.0 - 1.0 / 1.2), rel=1e-3)
    assert result.column("a_load_N")[-1] < 1e-4
    assert not any("penalties change" in note for note in result.verdict.notes)


@pytest.mark.parametrize("way, told", [(1e-5, False), (1e-2, True)])
def test_a_contact_that_barely_touches_is_told_by_what_it_is_of_the_greatest_load(way, told):
    """Two columns of modulus M that cannot widen, one pressed by a tenth of its height, the other by little, on a penalty of
    a sixth of M: infinitely stiff it would carry seven times as much, which of the first one's load is next to nothing."""
    drawn = {name: ((x, 0.0), (1.0, 1.0), (2, 2)) for name, x in (("pressed", 0.0), ("touching", 3.0))}
    modulus = 5.0 + 4.0 / 3.0  # K + 4/3 mu
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 5.0)) for name in drawn), plane="strain")
    floor = rigid_plane((0, 0, 0), (0, 1, 0), name="floor")
    for name, down, penalty in (("pressed", 0.1, None), ("touching", way, modulus / 6.0)):
        scene.fix((f"{name}_xmin", f"{name}_xmax"), "x")
        scene.prescribe(f"{name}_ymax", "y", -down)
        scene.contact(f"{name}_ymin", floor, penalty=penalty, name=name)
    result = solve(scene, steps=2).require()
    pressed, touching = (result.column(f"{name}_load_N")[-1] for name in drawn)
    missing = modulus * way - touching
    assert missing == pytest.approx(6.0 * touching, rel=0.05) and (missing > 1e-4 * pressed) == told
    notes = [note for note in result.verdict.notes if note.startswith("contact 'touching': its penalties change the force")]
    assert bool(notes) == told, result.verdict.notes


@pytest.mark.parametrize("points", [None, 3])
@pytest.mark.parametrize("penetration", [None, 1e-4])
def test_a_contact_that_has_come_to_a_halt_costs_what_it_did_sliding(points, penetration):
    """A cylinder pressed into a pad and dragged over it; in a last step nothing moves, and all points are on their limit."""
    costs = []
    for hold in (False, True):
        mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0, 0), (10, 5), (20, 10))})
        scene = Scene(Body(mesh, "pad", neo_hooke(1.0, 5.0)), plane="strain")
        scene.fix("pad_ymin")
        tool = rigid_cylinder(3.0, (4, 8, 0), (0, 0, 1), name="tool")
        scene.contact("pad_ymax", tool, friction=0.3, points=points, penetration=penetration, name="c")
        stages = [Stage("press", move={tool: (0, -0.5, 0)}, steps=4), Stage("drag", move={tool: (1.0, 0, 0)}, steps=6)]
        result = solve(scene, stages=stages + [Stage("hold", move={tool: (0, 0, 0)}, steps=1)] * hold).require()
        costs.append(result.summary["penalty_error"]["contacts"]["c"]["force_change_over_load"])
    assert costs[1] == pytest.approx(costs[0], rel=0.01, abs=1e-6) and abs(costs[0]) < 0.02


def test_a_change_that_points_would_pull_for_is_not_said():
    """On cells wider than the contact one of two Gauss points opens as the penalty grows: the force changes by 1 %, to first
    order by 8 %."""
    forces = []
    for options in ({}, {"penalty": Penalty(factor=1e4)}):
        mesh = read_gmsh(graded_rectangle.build, width=20.0, height=20.0, mesh_size=1.5, fine=2.0, growth=1.25)
        scene = Scene(Body(mesh, "block", from_elastic(10.0, 0.3)), plane="axisymmetric")
        scene.fix("block_ymin", "y")
        ball = rigid_sphere(5.0, (0.0, 5.0, 0.0), name="ball")
        scene.contact("block_ymax", ball, name="c", points=3, **options)
        result = solve(scene, move={ball: (0.0, -0.15, 0.0)}, steps=1).require()
        forces.append(result.column("c_force_y_N")[-1])
        assert not [note for note in result.verdict.notes if "penalties change" in note], result.verdict.notes
    assert forces[0] == pytest.approx(forces[1], rel=0.02)


@pytest.mark.parallel
def test_what_penalties_cost_is_said_of_stages_that_others_undo():
    """A block pressed on a floor and let go again: in the end nothing presses."""
    notes = []
    for factor in (2.0, 100.0):
        mesh = read_gmsh(rectangles.build, rectangles={"block": ((0, 0), (4, 2), (8, 4))})
        scene = Scene(Body(mesh, "block", neo_hooke(1.0, 5.0)), plane="strain")
        scene.fix("block_ymax")
        floor = rigid_plane((0, 0, 0), (0, 1, 0), name="floor")
        scene.contact("block_ymin", floor, penalty=Penalty(factor=factor), name="c")
        ways = {"press": 0.2, "a little": -0.05, "again": 0.05, "let go": -0.3}
        stages = [Stage(name, move={floor: (0, way, 0)}, steps=2) for name, way in ways.items()]
        notes.append(solve(scene, stages=stages).require().verdict.notes)
    (note,) = (note for note in notes[0] if "its penalties change the force by" in note)  # of three stages alike the first
    assert note.startswith("stage 'press': contact 'c'")
    assert not [note for note in notes[1] if "penalties change" in note]
