"""A coarse block under a ball: what folds over a tool or lets it through between nodes is no solution."""

import numpy as np
import pytest

from fenics_contact import (
    Body,
    Scene,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_cone,
    rigid_cylinder,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    rigid_torus,
    solve,
)
from fenics_contact.meshes import box, o_ring, rectangles
from fenics_contact.output.fields import surfaces_of
from fenics_contact.solvers.folding import FOLDS

pytestmark = pytest.mark.parallel

HEIGHT = 3.0


def pressed(tool_of, deep, steps, friction=0.5, points=None):
    """Result of a tool pressed into the top of a block of coarse cells."""
    scene = Scene(Body(read_gmsh(box.build, size=(5.0, 5.0, HEIGHT), cells=(6, 6, 4)), "box", neo_hooke(mu=0.7, K=5.0)))
    scene.fix("zmin")
    tool = tool_of()
    scene.contact("zmax", tool, friction, points=points, name="top")
    return solve(scene, move={tool: (0, 0, -deep)}, steps=steps)


def ball(radius, aside=0.0):
    return lambda: rigid_sphere(radius, (2.5 + aside, 2.5, HEIGHT + radius), name="ball")


def test_a_surface_that_has_folded_over_a_ball_is_no_solution():
    """In large steps there are balances with a fifth of the force and an inner node in the ball, in small ones not."""
    far, near = pressed(ball(1.5), 2.4, 2).require(), pressed(ball(1.5), 2.4, 24).require()
    assert far.column("top_force_z_N")[-1] == pytest.approx(near.column("top_force_z_N")[-1], rel=0.02)
    assert not any("inner node" in note for note in far.verdict.notes)


def bar():
    return rigid_cylinder(0.7, (2.8, 2.5, HEIGHT + 0.7), (0, 1, 0), name="bar")


@pytest.mark.parametrize("tool, deep", [(ball(1.0, 0.1), 1.8), pytest.param(bar, 1.5, marks=pytest.mark.slow)])
def test_a_tool_that_comes_in_between_nodes_is_named_and_gauss_points_hold_it(tool, deep):
    result = pressed(tool, deep, 4, 0.3)
    assert result.verdict.kind == "projection lost" and "take points=3 (Gauss points)" in result.verdict.remedy
    assert any("between nodes the surface hangs" in note for note in result.verdict.notes)
    force = [pressed(tool, deep, steps, 0.3, points=3).require().column("top_force_z_N")[-1] for steps in (4, 20)]
    assert force[0] == pytest.approx(force[1], rel=0.03) and abs(force[1]) > 3.0 * abs(result.column("top_force_z_N")[-1])


def test_penalties_raised_in_vain_are_raised_half_as_far_later():
    """The first step is too large for them, with softer ones on the way to it too."""
    one, many = pressed(ball(1.5, 0.2), 2.4, 1, 0.0, 3).require(), pressed(ball(1.5, 0.2), 2.4, 20, 0.0, 3).require()
    assert sum("penalties stay in this step" in note for note in one.verdict.notes) == 1
    assert sum("penalties raised" in note for note in one.verdict.notes) > 1
    np.testing.assert_allclose(one.column("top_force_z_N")[-1], many.column("top_force_z_N")[-1], rtol=0.05)


def pushed_in(tool, deep, points=None, steps=6):
    """Result of a tool that starts on top, at z = 2, of a block of cells 0.8 wide, with nodes at x, y = 0, 0.8, ..."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(5, 5, 3)), "box", from_elastic(E=5.0, nu=0.3)))
    scene.fix("zmin")
    scene.contact("zmax", tool, points=points, name="top")
    return solve(scene, move={tool: (0, 0, -deep)}, steps=steps)


def small_ball(radius, x, y):
    return rigid_sphere(radius, (x, y, 2.0 + radius), name="tool")


def cone(degrees):
    return rigid_cone(np.radians(degrees), (2.1, 2.05, 2.0), name="tool")


@pytest.mark.parametrize(
    "tool, deep",
    [
        pytest.param(lambda: small_ball(0.3, 2.1, 2.05), 0.44, id="ball between nodes"),
        pytest.param(lambda: small_ball(0.12, 2.0, 2.0), 0.5, id="small ball"),
        pytest.param(lambda: small_ball(0.6, 2.1, 2.05), 0.8, id="ball that nodes press up in the end"),
        pytest.param(lambda: rigid_cylinder(0.3, (2.25, 2.0, 2.3), (0, 1, 0), name="tool"), 0.7, id="bar beside a row"),
        pytest.param(lambda: rigid_torus(0.9, 0.15, (2.0, 2.0, 2.15), (0, 0, 1), name="tool"), 0.4, id="ring"),
        pytest.param(lambda: cone(30), 0.8, id="cone"),
    ],
)
def test_a_tool_that_no_node_holds_is_no_open_contact_and_gauss_points_hold_it(tool, deep):
    lost = pushed_in(tool(), deep)
    assert lost.verdict.kind == "projection lost" and "contact 'top' at (" in lost.verdict.place, lost.verdict.reason
    assert "take points=3" in lost.verdict.remedy and "a finer mesh" in lost.verdict.remedy
    assert (lost.column("top_force_z_N") <= 0.0).all(), "it is never pulled in"
    held = pushed_in(tool(), deep, points=3).require().column("top_force_z_N")
    assert (np.diff(held) < 0.0).all() and held[-1] < 3.0 * lost.column("top_force_z_N").min()


def test_a_tool_between_gauss_points_is_named_too():
    verdict = pushed_in(small_ball(0.12, 2.15, 2.15), 0.5, points=3).verdict
    assert verdict.kind == "projection lost" and "no point holds it" in verdict.reason
    assert "a finer mesh" in verdict.remedy and "points=3" not in verdict.remedy


def test_a_tool_that_ends_between_nodes_is_not_said_to_be_away():
    notes = " ".join(pushed_in(small_ball(0.3, 2.1, 2.05), 0.1, steps=1).require().verdict.notes)
    assert "never closed, though 'tool' lies 0.0" in notes and "take points=3" in notes and "units" not in notes
    away = pushed_in(small_ball(0.3, 2.1, 2.05), -0.1, steps=1).require().verdict.notes
    assert len(away) == 1 and "units" in away[0]


@pytest.mark.parametrize(
    "tool",
    [
        pytest.param(lambda: cone(60), id="cone that four nodes hold"),
        pytest.param(lambda: rigid_punch(half_width=0.5, half_depth=0.5, height=1, face=(2, 2, 2), name="tool"), id="punch"),
        pytest.param(lambda: small_ball(4.0, 2.0, 2.0), id="ball as large as the block"),
        pytest.param(lambda: rigid_plane((0, 0, 2.0), (0, 0, -1), name="tool"), id="plane"),
    ],
)
def test_what_nodes_hold_is_let_through(tool):
    result = pushed_in(tool(), 0.6).require()
    force = result.column("top_force_z_N")
    assert "projection lost" not in result.verdict.causes and (np.diff(force) <= 0.0).all() and force[-1] < -1.0


@pytest.mark.parametrize("z", [1.7, 1.9, 2.2])
def test_a_ball_that_presses_a_wall_beside_its_edge_is_not_in_the_face_above(z):
    """The chord of the edge lies in the ball, and so do places of both faces there."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(5, 5, 3)), "box", from_elastic(E=5.0, nu=0.3)))
    scene.fix("zmin")
    tool = rigid_sphere(2.5, (6.5, 2.1, z), name="tool")
    scene.contact(("zmax", "xmax"), tool, name="side")
    result = solve(scene, move={tool: (-0.5, 0, 0)}, steps=6).require()
    assert "projection lost" not in result.verdict.causes and (np.diff(result.column("side_force_x_N")) < 0.0).all()


def test_a_node_at_which_a_facet_folds_over_has_a_pressure_per_area_of_what_is_around_it():
    """A block pressed evenly between walls; then the middle node of the facet at its end is drawn so near to the corner that
    the facet folds over there. Its depth under the plane, and the facet's length, stay as they were, and so must what the
    corner and the middle are pressed with."""
    mesh = read_gmsh(rectangles.build, rectangles={"r": ((0.0, 0.0), (4.0, 1.0), (4, 2))})
    scene = Scene(Body(mesh, "r", neo_hooke(mu=1.0, K=5.0)), plane="strain", degree=2)
    scene.fix("r_ymin", "y")
    for side in ("r_xmin", "r_xmax"):
        scene.fix(side, "x")
    lid = rigid_plane((0, 1, 0), (0, -1, 0), name="lid")
    scene.contact("r_ymax", lid, name="lid")
    result = solve(scene, move={lid: (0, -0.1, 0)}, steps=1).require()
    before = result.line("lid", "x")["pressure_MPa"]
    assert before == pytest.approx(np.full(9, before[0]), rel=1e-9) and before[0] > 0.1
    u, X = result.system.state.u.x.array.reshape(-1, 3), result.system.space.tabulate_dof_coordinates()
    for x, aside in ((0.5, -0.3), (3.5, 0.3)):
        u[np.linalg.norm(X - (x, 1.0, 0.0), axis=1) < 1e-9, 0] += aside
    (surface,) = surfaces_of(scene, result.system)
    after = surface.at_state()
    on = after.on & np.isin(np.round(X[:, 0], 9), [0.0, 0.5, 1.5, 2.0, 2.5, 3.5, 4.0])
    assert after.pressure[on] == pytest.approx(np.full(on.sum(), before[0]), rel=1e-9)
    assert surface.zone(after).peak_pressure == pytest.approx(before[0], rel=1e-9)


def test_a_roller_between_nodes_is_one_matter():
    """It comes in deeper from step to step: said once, and once where that is worst."""
    mesh = read_gmsh(rectangles.build, rectangles={"floor": ((-3.0, -3.0), (6.0, 3.0), (10, 5))})
    scene = Scene(Body(mesh, "floor", neo_hooke(1.0, 5.0)), plane="strain")
    scene.fix("floor_ymin")
    roller = rigid_cylinder(0.3, (0.02, 0.3, 0.0), (0.0, 0.0, 1.0), name="roller")
    scene.contact("floor_ymax", roller, 0.0, name="c")
    result = solve(scene, move={roller: (0.0, -0.24, 0.0)}, steps=4)
    first, worst = (note for note in result.verdict.notes if "between nodes the surface hangs" in note)
    assert "a third or more" not in first and "where this is worst" in worst and "a third or more" in worst


def rolled(angle, dim):
    """What is said of one cell of degree 2, 2 long, that is rolled up by an angle [rad] from end to end, or twisted."""
    if dim == 2:
        mesh = read_gmsh(rectangles.build, rectangles={"body": ((-1.0, -0.25), (2.0, 0.5), (1, 1))})
        scene = Scene(Body(mesh, "body", neo_hooke(1.0, 10.0)), degree=2, plane="strain")
    else:
        mesh = read_gmsh(box.build, size=(2.0, 0.5, 0.5), cells=(1, 1, 1), origin=(-1.0, -0.25, -0.25), name="body")
        scene = Scene(Body(mesh, "body", neo_hooke(1.0, 10.0)), degree=2)
    scene.fix("xmin" if dim == 3 else "body_xmin")  # asked of every scene; the displacement is none of its balance
    u = scene.system().state.u
    x, y, z = X = scene.space.tabulate_dof_coordinates().T
    turn = 0.5 * angle * x
    c, s = np.cos(turn), np.sin(turn)
    if dim == 2:  # about an axis so far away that the middle line keeps its length
        radius = 2.0 / angle
        places = np.stack([(radius + y) * s, (radius + y) * c - radius, z])
    else:
        places = np.stack([x, c * y - s * z, s * y + c * z])
    u.x.array[:] = (places - X).T.ravel()
    return scene.volume_ratio(u).folded()


@pytest.mark.parametrize(("dim", "within", "beyond"), [(2, 160, 240), (3, 200, 280)])
def test_a_cell_that_is_folded_is_told(dim, within, beyond):
    """By its corners' turns against its middle, half of what both ends turn against each other, from 90 degrees on in the
    plane, from 120 in space."""
    assert rolled(np.radians(within), dim) is None
    assert "a cell is folded" in rolled(np.radians(beyond), dim).text


@pytest.mark.parametrize(("bulk", "push"), [(50.0, 1.5), (500.0, 2.0)])
def test_a_step_that_folds_cells_is_taken_in_shorter_ones(bulk, push):
    """Half a disc squeezed by a smooth lid in one step: in balance its crown hangs half a unit below the lid, turned over, J
    above 0.4 all over; in steps it lies on the lid."""
    mesh = read_gmsh(o_ring.build, radius=5.0, centre=0.0, cells=5)
    results = []
    for steps in (1, 8):
        scene = Scene(Body(mesh, "ring", neo_hooke(1.0, bulk)), plane="strain", degree=2, element="mixed")
        scene.fix("symmetry_y", "y")
        scene.spring("symmetry_y", 1e-6, direction=(1, 0, 0))
        lid = rigid_plane((0, 5, 0), (0, -1, 0), name="lid")
        scene.contact("rim", lid, name="c")
        record = {"crown": lambda view: view.at((0, 5, 0)).displacement[1]}
        results.append(solve(scene, move={lid: (0, -push, 0)}, steps=steps, record=record).require())
    one, many = results
    assert FOLDS in one.verdict.causes and not many.verdict.cuts
    for result in results:
        assert not [note for note in result.verdict.notes if "a cell is folded" in note]
        assert abs(result.column("crown")[-1] + push) < 0.01
    assert one.column("c_force_y_N")[-1] == pytest.approx(many.column("c_force_y_N")[-1], rel=1e-5)
