"""Bodies of degree 2 on both sides of a contact, straight and curved, in space and in the plane: exact tangents, loads of a
constant pressure, round bodies against closed forms."""

import gmsh
import numpy as np
import pytest
from drawn import quadrilateral
from refusals import refused
from taylor import orders, random_way, remainders
from test_two_bodies import turned_about

from fenics_contact import (
    Body,
    Method,
    Penalty,
    Scene,
    Stage,
    compat,
    from_elastic,
    mooney_paper,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    solve,
)
from fenics_contact.assembly.pose import rotation
from fenics_contact.kernels.facets import corner
from fenics_contact.kernels.quadratic import LINE, QUADRILATERAL, TRIANGLE, quadratic_shape
from fenics_contact.kernels.status import CLOSED, SLIP, STICK
from fenics_contact.meshes import o_ring, rectangles, ring_sector, two_blocks
from fenics_contact.studies.exact import Radial

RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


# -- shape functions ------------------------------------------------------------------------------------------------------
@pytest.mark.serial
@pytest.mark.parametrize("m", [LINE, TRIANGLE, QUADRILATERAL])
def test_shape_functions(m):
    """One at their own node and zero at the others; their slopes are their derivatives."""
    corners = {LINE: 2, TRIANGLE: 3, QUADRILATERAL: 4}[m]
    ends = np.array([(2.0 * i - 1.0, 0.0) if m == LINE else corner(corners, i) for i in range(corners)])
    sides = corners if m > LINE else 1
    places = [*ends, *(0.5 * (ends + np.roll(ends, -1, axis=0)))[:sides], ends.mean(axis=0)][:m]
    N, other = np.zeros((3, m)), np.zeros((3, m))
    for i, (s, t) in enumerate(places):
        quadratic_shape(m, s, t, N)
        assert N[0] == pytest.approx(np.eye(m)[i], abs=1e-15)
    quadratic_shape(m, 0.3, 0.2, N)
    for way, (ds, dt) in enumerate([(1e-3, 0.0), (0.0, 1e-3)][: 1 if m == LINE else 2]):
        slope = 0.0
        for sign in (1.0, -1.0):
            quadratic_shape(m, 0.3 + sign * ds, 0.2 + sign * dt, other)
            slope = slope + sign * other[0] / 2e-3
        assert N[1 + way] == pytest.approx(slope, abs=1e-11)  # of quadratic functions central differences are exact


# -- scenes: two bodies, how their first is pressed into the other and led along it ----------------------------------------
def occ_box(name, lowest, size):
    """A box named so with its lowest and highest faces; returns its tag."""
    tag = gmsh.model.occ.addBox(*lowest, *size)
    gmsh.model.occ.synchronize()
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), name)
    for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False):
        if abs(gmsh.model.getNormal(face, [0.5, 0.5])[2]) > 0.9:
            side = "top" if gmsh.model.occ.getCenterOfMass(2, face)[2] > lowest[2] + 1 else "bottom"
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), f"{name}_{side}")
    return tag


def tetrahedra():
    for name, lowest, size in (("lower", (0, 0, -10), (40, 40, 10)), ("upper", (5, 10, 0), (20, 20, 10))):
        occ_box(name, lowest, size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 12.0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 12.0)
    gmsh.model.mesh.generate(3)


def rings(cells=(6, 8), radii=(0.2, 0.6, 1.0), through=2, triangles=False):
    """A ring in another one, each with cells of its own."""
    for name, wall, around in zip(("shaft", "hub"), (radii[:2], radii[1:]), cells, strict=True):
        ring_sector.build(wall, (through, around), 2, triangles, name, f"{name}_")
        gmsh.model.geo.synchronize()


def pair(kind, friction, points=3):
    """Mesh, scene, slave body, what presses it, what leads it along, a length of it."""
    if kind == "rings":
        mesh, sides = read_gmsh(rings), ("shaft", "shaft_outer", "hub_inner")
        held, plane, turn = ("shaft_inner", "hub_outer"), {"plane": "strain"}, np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
        ways = (lambda X: 0.03 * X, lambda X: 0.05 * X @ turn.T, 0.1)
    elif kind == "rectangles":
        mesh = read_gmsh(
            rectangles.build,
            rectangles={"lower": ((0, -10), (40.0, 10.0), (6, 1)), "upper": ((5, 0), (20.0, 10.0), (4, 1))},
            triangles=True,
        )
        sides, held, plane = ("upper", "upper_ymin", "lower_ymax"), ("lower_ymin", "upper_ymax"), {"plane": "strain"}
        ways = (lambda X: np.tile([0.0, -0.3, 0.0], (len(X), 1)), lambda X: np.tile([1.5, -0.02, 0.0], (len(X), 1)), 10.0)
    else:
        cells = {"lower_cells": (4, 4, 1), "upper_cells": (3, 3, 1)}
        mesh = read_gmsh(tetrahedra) if kind == "tetrahedra" else read_gmsh(two_blocks.build, **cells)
        sides, held, plane = ("upper", "upper_bottom", "lower_top"), ("lower_bottom", "upper_top"), {}
        ways = (lambda X: np.tile([0.0, 0.0, -0.3], (len(X), 1)), lambda X: np.tile([1.5, 0.3, -0.02], (len(X), 1)), 10.0)
    names = ("shaft", "hub") if kind == "rings" else ("lower", "upper")
    scene = Scene(*(Body(mesh, name, RUBBER) for name in names), degree=2, **plane)
    for side in held:
        scene.fix(side)
    scene.contact(*sides[1:], friction, points=points, name="c")
    return mesh, scene, sides[0], *ways


def pressed(kind, friction, led, points=3):
    """System and contact of a pair, pressed into each other and roughened, committed, then led on by a share of its way."""
    mesh, scene, slave, press, lead, size = pair(kind, friction, points)
    system = scene.system()
    state, contact = system.state, system.contact_terms[0]
    cells = mesh.cell_tags.indices[mesh.cell_tags.values == mesh.volume_tag(slave)]
    nodes = np.unique(compat.cell_dofs(scene.space)[cells])
    X = scene.space.tabulate_dof_coordinates()
    u = 0.005 * size * np.random.default_rng(1).uniform(-1, 1, X.shape)
    if scene.section is not None:
        u[:, 2] = 0.0
    u[nodes] += press(X[nodes])
    state.u.x.array[:] = u.ravel()
    contact.commit(state)
    u[nodes] += led * lead(X[nodes])
    state.u.x.array[:] = u.ravel()
    return system, contact, size


STATES = [(0.0, 0.3, CLOSED), (0.1, 1.0, SLIP), (5.0, 0.02, STICK)]


@pytest.mark.serial
@pytest.mark.parametrize("friction, led, status", STATES)
@pytest.mark.parametrize("kind", ["hexahedra", "tetrahedra", "rectangles", "rings"])
@pytest.mark.parametrize("points", [3, "averages"])
def test_tangent_is_the_derivative_of_the_residual(kind, friction, led, status, points):
    system, contact, size = pressed(kind, friction, led, points)
    state = system.state
    start = state.u.x.array.copy()
    contact.response(state)
    before = contact.statuses()
    assert (before == status).sum() > 0.9 * len(before)
    way = random_way(system)
    if kind in ("rectangles", "rings"):
        way[2::3] = 0.0
    assert orders(remainders(system, contact, 1e-4 * size, way)).min() > 1.99
    if points == "averages":  # foresees tractions
        return
    gaps = []  # the gaps that it foresees are as exact
    for step in (1e-4 * size, 5e-5 * size):
        state.u.x.array[:] = start
        feet = contact.places.feet(state)
        state.u.x.array[:] = start + step * way
        there, paired = contact.places.feet(state), feet.projection[1] != 0
        foreseen = contact.partner.foreseen(there, feet, contact.trial)
        gaps.append(np.abs(foreseen[paired] - there.projection[4][paired]).max())
    assert np.log2(gaps[0] / gaps[1]) > 1.95


@pytest.mark.serial
@pytest.mark.parametrize("friction, led, status", STATES[1:])
@pytest.mark.parametrize("kind", ["hexahedra", "tetrahedra", "rectangles"])
def test_the_tangent_is_exact_where_samples_press_along_the_masters_normals(kind, friction, led, status):
    """Beside the slave's ends, once the samples have been taken where the bodies lie; forces are in balance there."""
    system, contact, size = pressed(kind, friction, led, "averages")
    system.foresight.resample(system.state)
    slaves = contact.places.feet(system.state).samples.slaves
    assert np.abs(slaves.aside).max() > 1e-3 / size
    contact.response(system.state)
    assert (contact.statuses() == status).sum() > 0.9 * len(contact.statuses())
    way = random_way(system)
    if kind == "rectangles":
        way[2::3] = 0.0
    # so short that no sample passes the edge of a facet, nor of its share, on the way
    assert orders(remainders(system, contact, 3e-6 * size, way)).min() > 1.99
    turns = [rotation(np.array([0.0, 0.0, 2 * np.pi * step / 8])) for step in range(1, 9)]
    turned_about(system, contact, turns)


@pytest.mark.serial
@pytest.mark.parametrize("kind, points", [("hexahedra", 3), ("rings", 3), ("tetrahedra", "averages"), ("rings", "averages")])
def test_forces_balance_and_a_turn_of_everything_changes_no_traction(kind, points):
    system, contact, _ = pressed(kind, 5.0, 0.02, points)
    turns = [rotation(np.array([0.0, 0.0, 2 * np.pi * step / 8])) for step in range(1, 9)]
    assert (turned_about(system, contact, turns) == STICK).any()


# -- loads of a constant pressure ----------------------------------------------------------------------------------------
@pytest.mark.serial
@pytest.mark.parametrize("lower, upper", [(4, 4), (5, 3)])
@pytest.mark.parametrize("points", [3, "averages"])
def test_a_constant_pressure_loads_both_sides(lower, upper, points):
    """With one gap everywhere both sides feel 1/6, 4/6, 1/6 of each side's force: the slave, and a matching master, to
    round-off; force and moment of any master, too."""
    cells = {"lower": ((0, -1), (2.0, 1.0), (lower, 1)), "upper": ((0, 0), (2.0, 1.0), (upper, 1))}
    mesh = read_gmsh(rectangles.build, rectangles=cells)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), degree=2, plane="strain")
    scene.fix("lower_ymin"), scene.fix("upper_ymax")
    scene.contact("upper_ymin", "lower_ymax", penalty=10.0, points=points, name="c")
    system = scene.system()
    state, contact = system.state, system.contact_terms[0]
    X, u = scene.space.tabulate_dof_coordinates(), np.zeros((len(state.u.x.array) // 3, 3))
    bodies = mesh.cell_tags.values == mesh.volume_tag("upper")
    slave = np.unique(compat.cell_dofs(scene.space)[mesh.cell_tags.indices[bodies]])
    u[slave, 1] = -0.01
    state.u.x.array[:] = u.ravel()
    force = np.zeros(u.size)
    contact.add_residual(state, force, np.zeros((0, 3)))
    force = force.reshape(-1, 3)[:, 1]
    above = np.isin(np.arange(len(u)), slave)
    for nodes, count, sign in ((above, upper, -1.0), (~above, lower, 1.0)):
        on = np.flatnonzero(nodes & (np.abs(X[:, 1]) < 1e-12))
        on = on[np.argsort(X[on, 0])]
        h, exact = 2.0 / count, np.zeros(2 * count + 1)
        for c in range(count):
            exact[2 * c : 2 * c + 3] += sign * 10.0 * 0.01 * h * np.array([1.0, 4.0, 1.0]) / 6.0
        if lower == upper or sign < 0.0:
            assert force[on] == pytest.approx(exact, abs=1e-11)  # gmsh places nodes to 1e-12
        assert [force[on].sum(), force[on] @ X[on, 0]] == pytest.approx([exact.sum(), exact @ X[on, 0]], abs=1e-11)


@pytest.mark.serial
@pytest.mark.parametrize("triangles", [False, True])
@pytest.mark.parametrize("points, scatter", [(3, 1.0), ("averages", 5e-3)])
def test_squeezed_blocks(triangles, points, scatter):
    """Two smooth blocks, 10 %: matching ones have one pressure to round-off, others the force to 2e-4, what the samples see
    of the kinks between facets; averages have the pressure to half a percent, where stiff points scatter."""
    found = []
    for upper in (4, 3):
        cells = {"lower": ((0, -10), (20.0, 10.0), (4 if upper == 4 else 5, 2)), "upper": ((0, 0), (20.0, 10.0), (upper, 2))}
        mesh = read_gmsh(rectangles.build, rectangles=cells, triangles=triangles)
        scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), plane="strain", degree=2)
        for body in ("lower", "upper"):
            scene.fix(f"{body}_xmin", "x")
        scene.fix("lower_ymin", "y")
        scene.prescribe("upper_ymax", "y", -2.0)
        scene.contact("upper_ymin", "lower_ymax", penalty=500.0, points=points, name="c")
        result = solve(scene, steps=2).require()
        pressure = result.system.contact_terms[0].forces.split_traction(result.system.state)[0]
        found.append((result.history[-1]["c_force_y_N"], np.ptp(pressure) / pressure.mean()))
    assert found[0][1] < 1e-9
    assert found[1][0] == pytest.approx(found[0][0], rel=2e-4)
    assert found[1][1] < scatter


# -- edges ----------------------------------------------------------------------------------------------------------------
@pytest.mark.serial
def test_a_block_lets_go_at_mu_n():
    """Pressed on a larger one by a dead load and drawn along by another: sliding on, it leaves the energy of the large one
    as it is, so that friction alone resists, but for how the large one's surface is strained, and for the cells."""
    cells = {"lower": ((0, -8), (30.0, 8.0), (10, 3)), "upper": ((10, 0), (10.0, 5.0), (4, 2))}
    mesh = read_gmsh(rectangles.build, rectangles=cells)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), degree=2, plane="strain")
    scene.fix("lower_ymin")
    scene.contact("upper_ymin", "lower_ymax", 0.3, name="c")
    scene.traction("upper_ymax", lambda X, t: [[0.018 * max(t - 0.3, 0.0) / 0.7, -0.05 * min(t / 0.3, 1.0), 0.0]] * len(X))
    result = solve(scene, steps=20, method=Method(smallest_step=1e-3))
    assert result.verdict.kind == "friction used up"
    row = result.history[-1]
    assert abs(row["c_force_x_N"] / row["c_force_y_N"]) == pytest.approx(0.3, rel=0.015)


def unlike_tetrahedra():
    """Cells of 4 below, of 2.5 above."""
    for name, lowest, size, cell in (("lower", (0, 0, -8), (20, 20, 8), 4.0), ("upper", (5, 5, 0), (10, 10, 6), 2.5)):
        tag = occ_box(name, lowest, size)
        gmsh.model.mesh.setSize(gmsh.model.getBoundary([(3, tag)], recursive=True), cell)
    gmsh.model.mesh.generate(3)


@pytest.mark.serial
def test_a_master_ends_on_triangles():
    """A tenth of its height into the larger block, the slave, whose samples pass the master's edges as that bulges."""
    mesh = read_gmsh(unlike_tetrahedra)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), degree=2)
    scene.fix("lower_bottom"), scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -0.6)
    scene.contact("lower_top", "upper_bottom", name="c")
    result = solve(scene, steps=4).require()
    assert result.verdict.cuts == 0 and result.verdict.iterations <= 4 * 4


# -- round bodies --------------------------------------------------------------------------------------------------------
@pytest.mark.serial
def test_a_round_slave_in_a_rigid_bore():
    """A tube blown up in a bore that it fills: the force on curved cells of degree 2 converges as h^4."""
    forces = []
    for cells in ((2, 4), (4, 8), (8, 16)):
        mesh = read_gmsh(ring_sector.build, radii=(1.0, 2.0), cells=cells, order=2)
        scene = Scene(Body(mesh, "ring", RUBBER), plane="strain", degree=2)
        scene.fix("ymin", "y"), scene.fix("xmin", "x")
        scene.pressure("inner", 0.02)
        bore = rigid_cylinder(2.0, (0, 0, 0), (0, 0, 1), hollow=True, name="bore")
        scene.contact("outer", bore, points=3, name="c", penalty=1e4)
        forces.append(solve(scene, steps=1).require().history[-1]["c_force_x_N"])
    assert (forces[1] - forces[0]) / (forces[2] - forces[1]) > 12.0, forces


@pytest.mark.parallel
@pytest.mark.parametrize("triangles", [False, True], ids=["quadrilaterals", "triangles"])
@pytest.mark.parametrize("points", [3, "averages"])
def test_a_tube_of_two_rings(triangles, points):
    """Blown up by a third, with curved cells of its own on either side of the joint, it is no less exact than a whole tube
    of the coarser cells (straight ones err six times as much)."""
    wall, middle, inside, law = (1.0, 2.0), 1.4, 1.3, mooney_paper(0.1863, 0.0098, 5.0)
    pressure, outside = Radial("tube", 5.0).solve(wall, inside)

    def error(scene, names, blown):
        for name in names:
            scene.fix(f"{name}ymin", "y"), scene.fix(f"{name}xmin", "x")
        scene.pressure(blown, pressure)
        record = {f"{R:g}_mm": lambda view, R=R: R + view.at((R, 0.0, 0.0)).displacement[0] for R in wall}
        row = solve(scene, steps=3, record=record).require().history[-1]
        return abs(row["1_mm"] - inside) / (inside - 1.0) + abs(row["2_mm"] - outside) / (outside - 2.0)

    mesh = read_gmsh(ring_sector.build, radii=wall, cells=(6, 8), order=2, triangles=triangles)
    whole = error(Scene(Body(mesh, "ring", law), plane="strain", degree=2), ("",), "inner")
    mesh = read_gmsh(rings, cells=(12, 8), radii=(wall[0], middle, wall[1]), through=3, triangles=triangles)
    scene = Scene(Body(mesh, "shaft", law), Body(mesh, "hub", law), plane="strain", degree=2)
    scene.contact("shaft_outer", "hub_inner", name="c", penalty=Penalty(factor=1e3), points=points)
    assert error(scene, ("shaft_", "hub_"), "shaft_inner") < whole


@pytest.mark.parallel
@pytest.mark.parametrize("swapped", [False, True])
def test_two_rings_under_an_uneven_pressure(swapped):
    """Lame's solution with a part cos 2 theta, on cells of its own on either side: the pressure at every node to 0.5 %."""
    law, mesh = from_elastic(1e3, 0.2), read_gmsh(rings, cells=(16, 20), through=3)
    scene = Scene(Body(mesh, "shaft", law), Body(mesh, "hub", law), plane="strain", degree=2)
    for body in ("shaft", "hub"):
        scene.fix(f"{body}_ymin", "y"), scene.fix(f"{body}_xmin", "x")
    scene.pressure("hub_outer", lambda X, t: t * (0.1 + 1e-3 * np.cos(2.0 * np.arctan2(X[:, 1], X[:, 0]))))
    sides = ("hub_inner", "shaft_outer") if swapped else ("shaft_outer", "hub_inner")
    scene.contact(*sides, name="fit")
    line = solve(scene, steps=1).require().line("fit", along=lambda X: np.arctan2(X[:, 1], X[:, 0]))
    angle = np.arctan2(line["y_reference_mm"], line["x_reference_mm"])
    assert len(angle) == (21 if swapped else 17)
    assert line["pressure_MPa"] == pytest.approx(9.259259e-2 + 1.35718e-3 * np.cos(2.0 * angle), rel=5e-3)


@pytest.mark.parallel
def test_points_of_degree_one_on_curved_cells_are_refused():
    def stated(degree, points):
        mesh = read_gmsh(rings)
        scene = Scene(Body(mesh, "shaft", RUBBER), Body(mesh, "hub", RUBBER), degree=degree, plane="strain")
        scene.contact("shaft_outer", "hub_inner", points=points, name="fit")

    refused(lambda: stated(1, "averages"), "'fit'", "order 2", "degree=2")
    refused(lambda: stated(2, 1), "'fit'", "one point", "points=2 or 3")
    refused(lambda: stated(2, "corners"), "'fit'", "corners", "degree=1", "points=3")


# -- pressures of several times mu ----------------------------------------------------------------------------------------
def ring_under_lid():
    o_ring.build(radius=1.5, cells=6)
    quadrilateral("lid", [(-2.5, 1.5), (2.5, 1.5), (2.5, 2.5), (-2.5, 2.5)], [16, 8], ["below", "right", "above", "left"])


def squeezed_ring(friction, swapped=False):
    """Half a mixed ring of degree 2, K/mu = 100, squeezed by a half, to 3 mu, by a lid of E = 16 mu."""
    mesh = read_gmsh(ring_under_lid)
    bodies = Body(mesh, "ring", neo_hooke(4.0, 400.0)), Body(mesh, "lid", from_elastic(E=200.0, nu=0.3))
    scene = Scene(*bodies, plane="strain", degree=2, element="mixed")
    scene.fix("symmetry_y", "y")
    scene.spring("symmetry_y", 0.03, direction=(1, 0, 0))
    scene.fix("above")
    scene.contact(*(("below", "rim") if swapped else ("rim", "below")), friction, name="c")
    return solve(scene, stages=[Stage("press", prescribe={("above", "y"): -0.75}, steps=10)]).require()


@pytest.mark.serial
@pytest.mark.parametrize("friction, most", [(0.1, 80), (0.3, 85), (0.8, 100)])
def test_nodes_between_those_with_pressures_make_no_waves(friction, most):
    """Their surface would give way under pressures along normals that do not turn with it; as the master it cannot."""
    result, swapped = squeezed_ring(friction), squeezed_ring(friction, swapped=True)
    forces = [abs(one.column("c_force_y_N")[-1]) for one in (result, swapped)]
    assert forces[0] == pytest.approx(forces[1], rel=0.02) and result.column("iterations").sum() <= most
    assert result.line("c", "x")["pressure_MPa"].max() > 2.5 * 4.0


@pytest.mark.serial
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("cells", [(9, 6), (6, 9), (7, 7), (12, 5)])
def test_confined_blocks_of_degree_2_have_smooth_pressures(cells, friction):
    """K/mu = 300, between smooth walls, pressed unevenly, by 9 ... 10 mu: the force of degree 1."""
    forces = []
    for degree in (1, 2):
        drawn = {"a": ((0.0, 0.0), (4.0, 2.0), (cells[0], 3)), "b": ((0.0, 2.0), (4.0, 2.0), (cells[1], 4))}
        mesh = read_gmsh(rectangles.build, rectangles=drawn)
        bodies = [Body(mesh, name, neo_hooke(1.0, 300.0)) for name in drawn]
        scene = Scene(*bodies, plane="strain", degree=degree, element="mixed")
        scene.fix("a_ymin", "y")
        scene.fix("b_ymax", "y")
        for name in drawn:
            for side in ("xmin", "xmax"):
                scene.fix(f"{name}_{side}", "x")
        scene.contact("a_ymax", "b_ymin", friction, name="c")
        led = {("b_ymax", "y"): lambda X, t: -t / 7.5 * (1.0 + 0.5 * np.cos(0.25 * np.pi * X[:, 0]))}
        result = solve(scene, stages=[Stage("press", prescribe=led, steps=5)]).require()
        assert not result.verdict.cuts and not any("resists" in note for note in result.verdict.notes)
        forces.append(result.column("c_force_y_N")[-1])
    assert forces[1] == pytest.approx(forces[0], rel=0.01)
    x, pressure = (result.line("c", "x")[name] for name in ("x_mm", "pressure_MPa"))
    smooth = np.polyval(np.polyfit(x, pressure, min(6, len(x) - 2)), x)
    assert pressure.max() > 9.5 and np.abs(pressure - smooth).max() < 0.005 * pressure.max()
