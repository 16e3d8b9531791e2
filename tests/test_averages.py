"""One pressure per slave node, averaged over samples of the facets around it, between deformable bodies."""

import gmsh
import numpy as np
import pytest
from drawn import ring
from mpi4py import MPI
from taylor import foreseen_left, orders, random_way, remainders
from test_two_bodies import EXACT, RUBBER, blocks, deformed, roughened, stacked

from demos import ironing
from fenics_contact import (
    Body,
    Motion,
    Output,
    Penalty,
    Scene,
    SceneError,
    Stage,
    coulomb,
    from_elastic,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.compat import geometry_dofmap
from fenics_contact.contact.leaning import ASIDE
from fenics_contact.contact.node_laws import JUDGED
from fenics_contact.contact.samples import samples_for
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.meshes import ironing as mesh_script
from fenics_contact.meshes import rectangles, two_blocks

COMM = MPI.COMM_WORLD


# ---- patch test
@pytest.mark.serial
@pytest.mark.parametrize("lower, upper", [((5, 5, 2), (3, 3, 2)), ((3, 3, 2), (5, 5, 2))])
def test_blocks_that_do_not_match(lower, upper):
    """The force, and a pressure that Gauss points scatter by a fifth of the mean and more."""
    force, spread = stacked("averages", 500.0, lower, upper)
    assert abs(force / EXACT - 1.0) < 2e-4  # the compliance of the penalty costs 1.5e-4
    assert spread < 1e-8  # parts of rectangles are integrated exactly
    assert stacked(3, 500.0, lower, upper)[1] > 0.2


@pytest.mark.serial
def test_a_slave_much_coarser_than_its_master():
    """Samples see all that the master does between the slave's nodes; 3 x 3 Gauss points lose 1.8 % of the force."""
    force, spread = stacked("averages", 500.0, (12, 12, 2), (3, 3, 2))
    assert abs(force / EXACT - 1.0) < 2e-4 and spread < 1e-8
    assert samples_for(4.0, 1.0) == 6 and samples_for(1.0, 1.0) == samples_for(1.0, 4.0) == 3


SIDE, HIGH = 12.0, 6.0  # of the blocks [mm]
STACK = {"lower": (SIDE, SIDE, HIGH), "lower_origin": (0, 0, -HIGH), "upper": (SIDE, SIDE, HIGH), "upper_origin": (0, 0, 0)}


def uneven(lower, upper):
    """Mesh of two blocks whose columns of nodes, but for those on their sides, are moved by up to a fifth of a cell."""
    mesh = read_gmsh(two_blocks.build, **STACK, lower_cells=(*lower, 2), upper_cells=(*upper, 2))
    x, rng = mesh.domain.geometry.x, np.random.default_rng(3)
    cells_nodes = geometry_dofmap(mesh.domain)
    above = np.isin(np.arange(len(x)), cells_nodes[x[cells_nodes, 2].mean(axis=1) > 0.0])
    for body, cells in ((~above, lower), (above, upper)):
        moves = np.zeros((cells[0] + 1, cells[1] + 1, 2))
        moves[1:-1, 1:-1] = rng.uniform(-0.2, 0.2, (cells[0] - 1, cells[1] - 1, 2)) * SIDE / cells[0]
        at = np.rint(x[body, :2] * cells / SIDE).astype(int)
        x[body, :2] += moves[at[:, 0], at[:, 1]]
    return mesh


def squeezed(mesh, slave, master):
    """Two frictionless blocks squeezed by 10 %: vertical force [N], half the range of the pressure over its mean."""
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    for body in ("lower", "upper"):
        scene.fix(f"{body}_xmin", "x")
        scene.fix(f"{body}_ymin", "y")
    scene.fix("lower_bottom", "z")
    scene.prescribe("upper_top", "z", -0.1 * 2 * HIGH)
    scene.contact(slave, master, name="c", penalty=500.0)
    result = solve(scene, steps=2).require()
    pressure = result.system.contact_terms[0].forces.split_traction(result.system.state)[0]
    return abs(result.history[-1]["c_force_z_N"]), 0.5 * np.ptp(pressure) / pressure.mean()


@pytest.mark.serial
@pytest.mark.parametrize("lower, upper", [((5, 5), (3, 3)), ((3, 3), (5, 5)), ((8, 8), (3, 3))])
def test_uneven_blocks_that_do_not_match_feel_one_pressure(lower, upper):
    """Beside the penalty's compliance, as matching ones have it; of distorted cells the rule's error in parts is left."""
    force, spread = squeezed(uneven(lower, upper), "upper_bottom", "lower_top")
    matching = read_gmsh(two_blocks.build, **STACK, lower_cells=(3, 3, 2), upper_cells=(3, 3, 2))
    exact, even = squeezed(matching, "upper_bottom", "lower_top")
    assert even < 1e-9 and spread < 1e-3 and abs(force / exact - 1.0) < 1e-6


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("plane", ["strain", "axisymmetric"])
@pytest.mark.parametrize("lower, upper", [(5, 3), (3, 5), (12, 3)])
def test_sides_that_do_not_match_feel_one_pressure(plane, degree, lower, upper):
    """In the plane parts are segments, on which all is polynomial: to the solver's tolerance."""
    found = []
    for cells in ((lower, upper), (4, 4)):
        drawn = {"lower": ((0.0, 0.0), (10.0, 10.0), (cells[0], 3)), "upper": ((0.0, 10.0), (10.0, 10.0), (cells[1], 3))}
        mesh = read_gmsh(rectangles.build, rectangles=drawn)
        if cells != (4, 4):
            x = mesh.domain.geometry.x
            x[:, 0] += 0.1 * np.sin(0.7 * x[:, 0] * (10.0 - x[:, 0]))
        scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), plane=plane, degree=degree)
        for body in ("lower", "upper"):
            scene.fix(f"{body}_xmin", "x")
        scene.fix("lower_ymin", "y")
        scene.prescribe("upper_ymax", "y", -2.0)
        scene.contact("upper_ymin", "lower_ymax", name="c", penalty=500.0)
        result = solve(scene, steps=2).require()
        pressure = result.system.contact_terms[0].forces.split_traction(result.system.state)[0].ravel()
        pressure = np.concatenate(COMM.allgather(pressure))
        found.append(result.history[-1]["c_force_y_N"])
        assert np.ptp(pressure) < 1e-8 * pressure.mean()
    np.testing.assert_allclose(*found, rtol=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize(
    "friction, shift, status",
    [(0.0, (1.2, 0.4, -0.02), CLOSED), (0.02, (1.2, 0.4, -0.02), SLIP), (9.0, (0.03, 0.01, -0.02), STICK)],
)
@pytest.mark.parametrize("whole", [True, False])
def test_tangent_with_samples_of_parts(friction, shift, status, whole):
    """They are held, so it stays exact; what nodes have slid is not changed by taking them."""
    system, contact = deformed("averages", friction, shift) if whole else overhanging("lower_top", friction, shift)
    state, few = system.state, contact.places.samples
    before = contact.response(state)
    system.foresight.resample(state)
    feet, after = contact.places.feet(state), contact.response(state)
    assert (np.diff(feet.samples.slaves.first) != 9).sum() > 2 and (after.status == status).sum() > 6
    size = np.abs(before.traction).max()
    assert 0.0 < np.abs(after.traction - before.traction).max() < 0.2 * size  # the samples' errors
    assert orders(remainders(system, contact, 2e-5)).min() > 1.98
    system.trail.rollback()
    assert contact.places.samples is few


# ---- tangent where the slave has an edge, on tetrahedra
def boxes():
    """Two boxes of irregular tetrahedra, one on the other."""
    occ = gmsh.model.occ
    volumes = [occ.addBox(0, 0, -2, 6, 5, 2), occ.addBox(1, 1, 0, 3, 3, 2)]
    occ.synchronize()
    for name, volume in zip(("lower", "upper"), volumes, strict=True):
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
        for face, (axis, place) in {"zmin": (2, 0), "zmax": (2, 3), "xmax": (0, 3)}.items():
            box = gmsh.model.getBoundingBox(3, volume)
            level = box[axis + (3 if place else 0)]
            tags = [t for _, t in gmsh.model.getBoundary([(3, volume)], oriented=False)]
            mine = [t for t in tags if abs(gmsh.model.occ.getCenterOfMass(2, t)[axis] - level) < 1e-5]
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, mine), f"{name}_{face}")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.9)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1.1)
    gmsh.model.mesh.generate(3)


@pytest.mark.serial
@pytest.mark.parametrize(
    "friction, shift, status",
    [(0.0, (0.4, 0.1, -0.02), CLOSED), (0.02, (1.2, 0.4, -0.02), SLIP), (9.0, (0.03, 0.01, -0.02), STICK)],
)
def test_tangent_on_tetrahedra_with_an_edge_among_the_slaves(friction, shift, status):
    mesh = read_gmsh(boxes)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), accept_locking=True)
    scene.fix("lower_zmin")
    scene.fix("upper_zmax")
    scene.contact(("upper_zmin", "upper_xmax"), "lower_zmax", friction, points="averages", name="c")
    system, contact = roughened(mesh, scene, 0.03, shift)
    state, start = system.state, system.state.u.x.array.copy()
    before = contact.response(state).status.ravel()
    touching = before[before != OPEN]
    assert set(touching) <= {status, CLOSED} and (touching == status).sum() > 10  # what has just been met has no anchor yet
    assert (before == OPEN).any()
    way, facets, longest = random_way(system), contact.parts.branches(state), 2e-4
    state.u.x.array[:] = start + longest * way
    while (
        not np.array_equal(contact.parts.branches(state), facets) and longest > 1e-6
    ):  # no sample may pass an edge on the way
        longest *= 0.5
        state.u.x.array[:] = start + longest * way
    state.u.x.array[:] = start
    assert orders(remainders(system, contact, longest, way)).min() > 1.98


# ---- tangent where samples lie in part over the master
def overhanging(master, friction, shift):
    """A System and contact of rough blocks, the upper one over two ends of the lower one."""
    mesh, scene = blocks(
        lower=(10, 8, 4),
        lower_cells=(5, 4, 2),
        lower_origin=(0, 0, -4),
        upper=(6, 6, 2),
        upper_cells=(4, 3, 1),
        upper_origin=(6.2, 4.1, 0),
    )
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact("upper_bottom", master, friction, points="averages", name="c")
    return roughened(mesh, scene, 0.03, shift)


@pytest.mark.serial
@pytest.mark.parametrize("master", ["lower_top", ("lower_top", "lower_xmax", "lower_ymax")])
@pytest.mark.parametrize(
    "friction, shift, status",
    [
        (0.0, (0.1, 0.05, -0.02), CLOSED),
        (0.02, (0.5, 0.2, -0.02), SLIP),
        (coulomb(lambda p: 0.01 + 0.02 / (1.0 + p), up_to=1e3), (0.5, 0.2, -0.02), SLIP),
        (9.0, (0.03, 0.01, -0.02), STICK),
    ],
    ids=["smooth", "slip", "slip, mu(p)", "stick"],
)
def test_tangent_over_the_ends_of_the_master(master, friction, shift, status):
    system, contact = overhanging(master, friction, shift)
    state = system.state
    feet = contact.places.feet(state)
    partly = (feet.met[6] > 0.0) & (feet.met[6] < 1.0)
    assert partly.sum() >= 6 and (contact.response(state).status == status).sum() > 6
    assert orders(remainders(system, contact, 2e-5)).min() > 1.98


@pytest.mark.serial
@pytest.mark.parametrize("friction, shift", [(0.0, (0.1, 0.05, -0.02)), (9.0, (0.03, 0.01, -0.02))], ids=["smooth", "stick"])
def test_gaps_foreseen_over_the_ends_of_the_master_are_linear_in_the_motion(friction, shift):
    """As the tangent has them: by the turns of the normals, too, samples come off the master."""
    system, contact = overhanging("lower_top", friction, shift)
    assert orders(foreseen_left(system, contact, random_way(system), 1e-5, closed_alone=True)).min() > 1.98


# ---- history
@pytest.mark.serial
@pytest.mark.parametrize("whole", [True, False])
def test_what_slips_goes_on_from_the_traction_it_had(whole):
    """On rough, bent faces: the means of directions that differ are shorter than their parts; and over the master's ends."""
    slid = (1.5, 0.3, -0.02)
    system, contact = deformed("averages", 0.1, slid) if whole else overhanging("lower_top", 0.1, slid)
    before = contact.response(system.state)
    contact.commit(system.state)
    after = contact.response(system.state)
    assert (before.status == SLIP).all() if whole else set(before.status.ravel()) == {OPEN, SLIP}
    np.testing.assert_array_equal(after.status, before.status)
    assert whole or ((before.cover < 0.99) & (before.status == SLIP)).any()
    np.testing.assert_allclose(after.traction, before.traction, atol=1e-10 * np.abs(before.traction).max())


# ---- slip is tangential to the node
@pytest.mark.serial
@pytest.mark.parametrize("whole", [True, False])
def test_ways_are_tangential_to_the_nodes_and_foreseen(whole):
    """On rough, bent faces that stretch; what is foreseen leaves the square of the motion."""
    moved = (0.03, 0.01, -0.02)
    system, contact = deformed("averages", 9.0, moved) if whole else overhanging("lower_top", 9.0, moved)
    state, start, way, left = system.state, system.state.u.x.array.copy(), random_way(system), []
    sticks = contact.response(state).status.ravel() == STICK
    assert sticks.sum() > 10

    def ways():
        feet = contact.places.feet(state)
        return feet, contact.partner.anchors._laws.averages(feet, contact.trial.history.anchors)[1][sticks]

    feet, found = ways()
    around = contact.places.around
    normals = np.empty((len(sticks), 3))
    normals[around.number] = feet.normals[around.group]  # one at each node: there are no creases
    assert np.abs((found * normals[sticks]).sum(axis=1)).max() < 1e-14 < 1e-4 < np.linalg.norm(found, axis=1).min()
    for step in 1e-5 / 2.0 ** np.arange(4):
        state.u.x.array[:] = start
        system.assemble_tangent()
        state.u.x.array[:] = start + step * way
        system.foresight.foresee(state)
        foreseen = contact.trial.judged.reshape(-1, JUDGED)[sticks, 1:4]
        system.foresight.release()
        left.append(np.linalg.norm(foreseen - ways()[1]))
    assert orders(np.array(left)).min() > 1.98


@pytest.mark.parallel
@pytest.mark.parametrize("stiff", [{"penalty": Penalty(factor=1e4)}, {"penetration": 1e-5}], ids=["penalty", "multipliers"])
def test_what_the_master_bends_as_it_stretches_does_not_slip(stiff):
    """A block pressed straight down on a wider one: its edges slide out, between them it sticks, in its middle without any
    friction. What stretches there had a slip along the normals, which penalties so stiff brought to the limit."""
    sides = {"low": ((0.0, -2.0), (8.0, 2.0), (16, 4)), "up": ((3.0, 0.0), (2.0, 1.5), (6, 3))}
    mesh, rubber = read_gmsh(rectangles.build, rectangles=sides), neo_hooke(0.5, K=500.0)
    scene = Scene(Body(mesh, "low", rubber), Body(mesh, "up", rubber), plane="strain", element="mixed")
    scene.fix("low_ymin")
    scene.fix("up_ymax", "x")
    scene.prescribe("up_ymax", "y", -0.3)
    scene.contact("up_ymin", "low_ymax", friction=0.3, name="c", **stiff)
    result = solve(scene, steps=4, out=Output(progress=False)).require()
    line = result.line("c", along="x")
    rubs = np.hypot(line["friction_x_MPa"], line["friction_y_MPa"]) / (0.3 * line["pressure_MPa"])
    assert line["status"].tolist() == [SLIP, *[STICK] * 5, SLIP]
    np.testing.assert_allclose(rubs[[0, -1]], 1.0, rtol=1e-3)  # of a bent patch
    assert rubs[1:-1].max() < 0.8 and rubs[3] < 1e-6
    assert not any("bent along it" in note for note in result.verdict.notes)


# ---- Newton's method
DEPTH = 0.125  # of a layer [mm]


def ironed(press, draw, swapped=False, **contact):
    """The ironing of demos/ironing.py, pressed and drawn by 0.5 mm; swapped: the stiff indenter is the slave."""
    mesh = read_gmsh(mesh_script.build, depth=DEPTH, **ironing.QUICK)
    block, indenter = from_elastic(ironing.BLOCK, ironing.NU), from_elastic(ironing.INDENTER, ironing.NU)
    scene = Scene(Body(mesh, "foundation", block), Body(mesh, "indenter", indenter))
    scene.fix("foundation_bottom")
    scene.fix("ends", "y")
    scene.fix("indenter_top", "xz")
    sides = "foundation_top", ("indenter_under", "indenter_flanks")
    scene.contact(*(sides[::-1] if swapped else sides), points="averages", name="c", **contact)
    stages = [
        Stage("press", prescribe={("indenter_top", "z"): -ironing.PRESS}, steps=press),
        Stage("draw", prescribe={("indenter_top", "x"): ironing.SHORT}, steps=draw),
    ]
    result = solve(scene, stages=stages).require()
    return result, np.array([result.history[-1][f"c_force_{axis}_N"] for axis in "xz"])


@pytest.mark.parallel
def test_ironing_takes_few_solves_and_twice_the_steps_give_the_same():
    result, force = ironed(10, 4, friction=0.3)
    assert result.verdict.cuts == 0 and result.verdict.iterations <= 6 * 14  # facet points: 20 cut-backs, 200
    _, finer = ironed(20, 8, friction=0.3)
    assert np.abs(finer / force - 1).max() < 2e-3  # slip in part: the step's own error


@pytest.mark.parallel
def test_a_foot_that_comes_and_goes_beside_a_crease_of_the_master():
    """A slave node at the indenter's corner: with its flank in sight of a sample or not the node's mean gap jumps, and no
    state was in balance under what that state saw."""
    result, force = ironed(10, 10, friction=0.3)
    assert result.verdict.cuts == 0
    np.testing.assert_allclose(force, ironed(10, 8, friction=0.3)[1], rtol=1e-4)  # whose steps pass over that place


@pytest.mark.serial
def test_solves_do_not_grow_with_the_penalty():
    counts = [ironed(10, 4, friction=0.3, penalty=Penalty(factor=f))[0].verdict for f in (100.0, 10000.0)]
    assert counts[1].cuts == 0 and counts[1].iterations <= 2 * counts[0].iterations


def test_slave_and_master_may_be_swapped():
    plain, force = ironed(10, 4, friction=0.3)
    swapped, other = ironed(10, 4, swapped=True, friction=0.3)
    assert swapped.verdict.cuts == plain.verdict.cuts == 0
    assert plain.verdict.iterations <= 2 * 14 and swapped.verdict.iterations <= 3 * 14  # tangents a step
    assert np.abs(other / force + 1).max() < 0.02  # the forces' other way; the discretisation's error


@pytest.mark.parallel
def test_a_steady_step_begins_on_the_curve_through_the_last():
    """Blocks pressed at a steady pace, sticking and slipping: from the third step on one tangent is enough."""
    size = {"lower": (9, 9, 1), "lower_origin": (-4.5, -4.5, -1), "upper": (2, 2, 1), "upper_origin": (-1, -1, 0)}
    _, scene = blocks(**size, lower_cells=(5, 5, 1), upper_cells=(2, 2, 1))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -0.1)
    scene.contact("upper_bottom", "lower_top", friction=0.05, name="c")
    result = solve(scene, steps=5).require()
    assert 0 < result.history[-1]["c_sticking_points"] < result.history[-1]["c_active_points"]
    assert (result.column("iterations")[2:] == 1).all()


# ---- the slave beyond the master's end
@pytest.mark.parallel
def test_a_slave_is_pushed_over_the_end_of_its_master():
    """Half of it hangs over at last; pressures stay pressures, friction keeps to their share, and forces are in balance."""
    size = {"lower": (10, 6, 4), "lower_origin": (0, 0, -4), "upper": (4, 4, 2), "upper_origin": (5, 1, 0)}
    mesh, scene = blocks(**size, lower_cells=(10, 4, 4), upper_cells=(5, 4, 2))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -0.3 * min(4 * t, 1)))
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 3.0 * max(t - 0.25, 0) / 0.75))
    scene.contact("upper_bottom", "lower_top", 0.3, points="averages", name="c")
    result = solve(scene, steps=16).require()
    force = result.column("c_force_z_N")
    assert result.verdict.cuts == 0 and 0.4 * force.max() < force[-1] < 0.7 * force.max()
    # 2 x 4 of 16 mm2 lie over the master, and by how much the sole lags behind its top; all of it is wider by now
    sole = result.measured.surfaces[0].at_state()
    stretch = COMM.allreduce(sole.area[: mesh.domain.geometry.index_map().size_local].sum()) / 16.0
    assert 1.0 < stretch < 1.2 and 8.0 < result.history[-1]["c_area_mm2"] / stretch < 10.0
    assert result.history[-1]["c_penetration_mm"] > 0.0
    contact, state = result.system.contact_terms[0], result.system.state
    pressure, along = contact.forces.split_traction(state)
    most = COMM.allreduce(pressure.max(initial=0.0), op=MPI.MAX)
    assert pressure.min(initial=0.0) > -1e-9 * most
    assert (np.linalg.norm(along, axis=2) - 0.3 * pressure).max(initial=0.0) < 1e-12 * most  # though its normals differ
    out = np.zeros(len(state.u.x.array))
    contact.add_residual(state, out, np.zeros((0, 3)))
    owned = 3 * scene.space.dofmap.index_map.size_local
    total = COMM.allreduce(out[:owned].reshape(-1, 3).sum(axis=0))
    assert np.abs(total).max() < 1e-10 * force[-1]


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize(("sharp", "slave"), [(100.0, 0), (100.0, 1), (1.0, 0), (1.0, 1)])
def test_a_sharp_block_is_led_over_another_and_off_its_end(sharp, slave):
    """A stiff block on a soft one or a soft one on a stiff one, either the slave: its edges pass over sample after sample;
    where these counted whole or not at all, Newton's method cycled."""
    size = {"lower": (10, 0.5, 4), "lower_origin": (0, 0, -4), "upper": (4, 0.5, 2), "upper_origin": (3, 0, 0)}
    mesh = read_gmsh(two_blocks.build, **size, lower_cells=(20, 1, 6), upper_cells=(11, 1, 5))
    scene = Scene(Body(mesh, "lower", from_elastic(100.0 / sharp, 0.3)), Body(mesh, "upper", from_elastic(sharp, 0.3)))
    scene.fix("lower_bottom")
    scene.fix(("lower_ymin", "lower_ymax", "upper_ymin", "upper_ymax"), "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -0.3 * min(4 * t, 1)))
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 7.5 * max(t - 0.25, 0) / 0.75))
    sides = "lower_top", "upper_bottom"
    scene.contact(sides[slave], sides[1 - slave], 0.3, points="averages", name="c")
    result = solve(scene, steps=60).require()
    force = np.abs(result.column("c_force_z_N"))
    assert result.verdict.iterations <= 4.5 * 60
    assert result.verdict.cuts <= 2 or (sharp, slave) == (1.0, 0)  # there they count by the solves they cost alone
    assert force[-1] == 0.0
    if slave == 1 or sharp > 1.0:  # else a soft edge passes the nodes of a stiff slave, whose pressures it has one by one
        assert np.diff(force[20:]).max() < 0.01 * force.max()  # drawn along, and off the end from t = 0.55


@pytest.mark.serial
@pytest.mark.parametrize("steps", [1, 10])
def test_multipliers_over_an_end_are_the_limit_of_the_penalty(steps):
    """All closed nodes are covered in part: they keep the body's spring, in friction too, from where they came to rest."""
    force = []
    for contact in ({"penetration": 1e-6}, {"penalty": Penalty(factor=1e6)}):
        size = {"lower": (8, 6, 4), "lower_origin": (0, 0, -4), "upper": (4, 4, 2), "upper_origin": (7.1, 1.3, 0)}
        mesh = read_gmsh(two_blocks.build, **size, lower_cells=(8, 6, 3), upper_cells=(5, 5, 2))
        scene = Scene(*(Body(mesh, name, from_elastic(1.0, 0.3)) for name in ("lower", "upper")))
        scene.fix("lower_bottom")
        scene.fix("upper_top", "xy")
        scene.prescribe("upper_top", "z", -0.2)
        scene.contact("lower_top", "upper_bottom", 0.3, points="averages", name="c", **contact)
        result = solve(scene, steps=steps).require()
        assert 0.0 < result.history[-1]["c_penetration_mm"] < 1e-6
        force.append([result.history[-1][f"c_force_{axis}_N"] for axis in "xyz"])
    # of the whole: sideways there is a hundredth of it, and samples lie where the surfaces of the penalties' own balance do
    penalty, limit = np.array(force)
    assert np.linalg.norm(penalty - limit) < 5e-4 * np.linalg.norm(limit)


def test_a_tool_has_no_averages():
    mesh = read_gmsh(two_blocks.build, lower_cells=(2, 2, 1), upper_cells=(2, 2, 1))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    with pytest.raises(SceneError, match="averages meet facets; an analytic tool"):
        scene.contact("upper_top", rigid_plane((0, 0, 9)), points="averages")


# ---- an edge that is drawn along
def sliding_ratios(result):
    """|H/V| of the steps that end with all nodes slipping."""
    slides = (result.column("c_sticking_points") == 0) & (result.column("c_force_x_N") != 0.0)
    return np.abs(result.column("c_force_x_N") / result.column("c_force_y_N"))[slides]


def share_aside(notes):
    """The greatest share of the load by which notes say that the tangential force is off."""
    return max(float(note.split("and ")[1].split(" of the load")[0]) for note in notes)


def square_blade(master, steps=12):
    """A blade with square edges, pressed on a stiffer sheet, or on a rigid plane, and drawn along in so many steps: force
    ratios |H/V|, notes on its edge."""
    sheet = {"sheet": ((-2.0, -2.0), (8.0, 2.0), (32, 4))} if master == "sheet_ymax" else {}
    mesh = read_gmsh(rectangles.build, rectangles={"blade": ((0.0, 0.0), (1.0, 4.0), (4, 16)), **sheet})
    blade = Body(mesh, "blade", mooney_rivlin(0.3, 0.1, 8.0))
    bodies = [blade, Body(mesh, "sheet", mooney_rivlin(1.5, 0.5, 40.0))] if sheet else [blade]
    scene = Scene(*bodies, plane="strain")
    if sheet:
        scene.fix("sheet_ymin")
    scene.fix("blade_ymax")
    scene.contact("blade_ymin", master, friction=0.5, name="c")
    stages = [
        Stage("press", prescribe={("blade_ymax", "y"): -0.1}, steps=2),
        Stage("drag", prescribe={("blade_ymax", "x"): 2.0}, steps=steps),
    ]
    result = solve(scene, stages=stages).require()
    edge = result.system.contact_terms[0].findings.pressing_edge(result.system.state)  # what a verdict would name
    return sliding_ratios(result), [note for note in result.verdict.notes if "lean" in note], edge


@pytest.mark.parallel
def test_an_edge_of_the_slave_that_presses_aside_is_named():
    """Its facet leans by some 18 degrees: it presses and rubs as the master lay there when the step began, and turns on in
    it until it slides. More steps mend that; the tool's normals are right."""
    ratio, notes, edge = square_blade("sheet_ymax")
    np.testing.assert_allclose(ratio[-1], 0.5, rtol=2e-3)
    assert all("round the edge" in note and "contact 'c'" in note for note in notes)
    assert "where this is worst" in notes[-1]
    assert share_aside(notes) > 0.5 - ratio.min() > 0.02 and edge is None
    ratio, notes, edge = square_blade("sheet_ymax", 48)
    np.testing.assert_allclose(ratio[1:], 0.5, rtol=0.01)
    assert not notes and edge is None
    ratio, notes, edge = square_blade(rigid_plane((0, 0, 0), (0, 1, 0)))
    np.testing.assert_allclose(ratio, 0.5, rtol=1e-6)
    assert not notes and edge is None


def dragged_block(slave, degree=1):
    """A block pressed on a softer pad by a tenth of that and drawn over it: |H/V| where all slides, notes on its edge."""
    sizes = {"pad": ((0.0, -5.0), (20.0, 5.0), (20, 5)), "block": ((4.0, 0.0), (8.0, 3.0), (7, 3))}
    mesh = read_gmsh(rectangles.build, rectangles=sizes)
    bodies = Body(mesh, "pad", neo_hooke(1.0, 10.0)), Body(mesh, "block", neo_hooke(3.0, 10.0))
    scene = Scene(*bodies, plane="strain", degree=degree)
    scene.fix("pad_ymin")
    scene.fix("block_ymax")
    scene.contact(slave, {"block_ymin": "pad_ymax", "pad_ymax": "block_ymin"}[slave], friction=0.4, name="c")
    stages = [
        Stage("press", prescribe={("block_ymax", "y"): -0.5}, steps=4),
        Stage("drag", prescribe={("block_ymax", "x"): 2.0}, steps=16),
    ]
    result = solve(scene, stages=stages).require()
    ratio = np.abs(result.column("c_force_x_N") / result.column("c_force_y_N"))
    return ratio[-6:], [note for note in result.verdict.notes if "lean" in note]


@pytest.mark.parametrize("degree", [1, 2])
def test_a_sharp_block_that_slides_presses_along_the_masters_normals(degree):
    """With edges rounded by 0.5 to 2 it has 0.416, either the slave, to 1 %: the energies balance there."""
    ratio, notes = dragged_block("block_ymin", degree)
    assert abs(ratio.mean() - 0.416) < (0.002 if degree == 1 else 0.01)
    np.testing.assert_allclose(share_aside(notes), np.abs(ratio - 0.416).max(), atol=0.005)


@pytest.mark.parametrize(
    "degree, press, friction, told", [(1, 0.2, 0.2, False), (1, 0.2, 0.4, True), (2, 0.2, 0.2, False), (2, 0.3, 0.2, True)]
)
def test_a_block_whose_edge_folds_is_told_how_far_its_friction_is_off(degree, press, friction, told):
    """Pressed on what is flat and a thousand times as stiff: there H/V is the coefficient of friction."""
    boxes = {"block": ((-2.0, 0.0), (4.0, 1.0), (12, 4)), "plate": ((-4.0, -1.0), (8.0, 1.0), (24, 3))}
    mesh = read_gmsh(rectangles.build, rectangles=boxes)
    bodies = Body(mesh, "block", neo_hooke(1.0, 3.0)), Body(mesh, "plate", neo_hooke(1e3, 3e3))
    scene = Scene(*bodies, plane="strain", degree=degree)
    scene.fix("plate_ymin")
    scene.fix("block_ymax")
    scene.contact("block_ymin", "plate_ymax", friction=friction, name="c")
    stages = [
        Stage("press", prescribe={("block_ymax", "y"): -press}, steps=5),
        Stage("drag", prescribe={("block_ymax", "x"): 0.6}, steps=5),
    ]
    result = solve(scene, stages=stages).require()
    off, notes = friction - sliding_ratios(result).min(), [note for note in result.verdict.notes if "lean" in note]
    assert (off > ASIDE) == told == bool(notes)
    if notes:
        np.testing.assert_allclose(share_aside(notes), off, rtol=0.1)


def test_a_sharp_block_that_digs_into_the_slave_is_told_how_far_its_friction_is_off():
    ratio, notes = dragged_block("pad_ymax")
    np.testing.assert_allclose(ratio, 0.416, rtol=5e-3)
    assert not notes
    ratio, (note,) = dragged_block("pad_ymax", 2)
    assert 0.002 < np.abs(ratio - 0.416).max() < 0.006 < float(note.split("up to ")[1].split(" of the load")[0])
    assert "an edge of which digs in" in note and "round the edge" in note


@pytest.mark.parametrize("half", [False, True])
def test_edges_of_a_block_that_is_pressed_alone_are_no_matter(half):
    """What acts aside at both of its edges cancels, in half a block against the plane of symmetry, where it sticks."""
    pad, block = (((0, -5), (10, 5), (10, 5)), ((0, 0), (4, 3), (4, 3))) if half else (
        ((0, -5), (20, 5), (20, 5)), ((6, 0), (8, 3), (7, 3)))  # fmt: skip
    mesh = read_gmsh(rectangles.build, rectangles={"pad": pad, "block": block})
    bodies = Body(mesh, "pad", neo_hooke(1.0, 10.0)), Body(mesh, "block", neo_hooke(3.0, 10.0))
    scene = Scene(*bodies, plane="strain", degree=2)
    scene.fix("pad_ymin")
    for name in ("pad_xmin", "block_xmin") if half else ("block_ymax",):
        scene.fix(name, "x")
    scene.contact("block_ymin", "pad_ymax", friction=0.05, name="c")
    scene.prescribe("block_ymax", "y", -0.8)
    result = solve(scene, steps=4).require()
    assert result.history[-1]["c_sticking_points"] < result.history[-1]["c_active_points"]
    assert not [note for note in result.verdict.notes if "lean" in note]


@pytest.mark.serial
def test_a_frictionless_indenter_is_drawn_along():
    """Its flanks, bent by the load, look past the block's samples from an edge on that is no crease."""
    mesh, draw = read_gmsh(mesh_script.build), 41
    bodies = Body(mesh, "foundation", from_elastic(689.6, 0.32)), Body(mesh, "indenter", from_elastic(6896.0, 0.32))
    scene = Scene(*bodies, plane="strain", thickness=1.0)
    scene.fix("foundation_bottom")
    scene.fix("indenter_top")
    scene.contact("foundation_top", ("indenter_under", "indenter_flanks"), name="c")
    stages = [
        Stage("press", prescribe={("indenter_top", "y"): -1.0}, steps=10),
        Stage("draw", prescribe={("indenter_top", "x"): draw * 10.0 / 81}, steps=draw),
    ]
    result = solve(scene, stages=stages).require()
    late = result.column("t") > 1.4  # more than its width from where it began
    # what it has left behind is not what would keep it from going on
    assert result.system.contact_terms[0].findings.trouble(result.system.state) is None
    along, down = (result.column(f"c_force_{axis}_N")[late] for axis in "xy")
    assert np.abs(along / down).max() < 0.01


def press_fit(cells, **options):
    """A ring of so many curved cells along a quarter swells in a stiff one; that one's rim."""

    def draw():
        ring("inner", 0.0, (0.5, 1.0), (3, cells[0]), ("bore", "outside"))
        ring("outer", 0.0, (1.0, 1.5), (3, cells[1]), ("inside", "rim"), turn=0.1)
        gmsh.model.mesh.setOrder(2)

    inner, outer = neo_hooke(1.0, 3.0), neo_hooke(1e4, 3e4)
    mesh = read_gmsh(draw)
    scene = Scene(Body(mesh, "inner", inner), Body(mesh, "outer", outer), plane="strain", degree=2)
    hub, rim = rigid_hub("hub", (0, 0, 0)), rigid_hub("rim", (0, 0, 0))
    scene.tie("bore", hub)
    scene.tie("rim", rim)
    scene.swell("inner", 1.06)
    scene.contact("outside", "inside", friction=0.3, name="c", **options)
    return scene, rim


@pytest.mark.parallel
@pytest.mark.parametrize("cells, told", [((2, 3), True), ((3, 4), True), ((6, 8), False)])
def test_torque_that_bent_patches_of_nodes_lose_is_told(cells, told):
    """The stiff ring turns: M = mu N r, less 1 - (sin x / x)^2, x = pi/n, of n facets."""
    scene, rim = press_fit(cells)
    stages = [Stage("fit", steps=2), Stage("turn", move={rim: Motion(rz=0.3)}, steps=2)]
    result = solve(scene, stages=stages, out=Output(progress=False)).require()
    load, area, moment = (result.column(name)[-1] for name in ("c_load_N", "c_area_mm2", "rim_moment_z_Nmm"))
    x = np.pi / (4 * cells[0])
    lost = 1.0 - (np.sin(x) / x) ** 2
    assert abs(moment) / (0.3 * load * area / (2.0 * np.pi)) == pytest.approx(1.0 - lost, rel=2e-3)
    said = [float(note.split("bent along it: ")[1].split()[0]) for note in result.verdict.notes if "bent along it" in note]
    assert said == ([pytest.approx(lost, rel=0.03)] if told else [])


@pytest.mark.parallel
def test_what_curved_facets_overlap_as_drawn_is_no_snap():
    """Pushed out in the first part of a first step, however short, of which Gauss points take many solves."""
    result = solve(press_fit((3, 4), points=3)[0], steps=2, out=Output(progress=False)).require()
    assert result.column("iterations")[0] > 10
    assert not any("snap" in note for note in result.verdict.notes)
