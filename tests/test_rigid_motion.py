"""Rigid bodies with six degrees of freedom: tools that turn, exact tangents, torques, work, free rolling, bad input."""

import gmsh
import numpy as np
import pytest
from refusals import refused
from taylor import change, forces, left_over, orders, random_way, remainders

from fenics_contact import (
    ArcSteps,
    Body,
    Load,
    Method,
    Motion,
    Scene,
    Stage,
    Travel,
    coulomb,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cone,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    rigid_surface,
    solve,
)
from fenics_contact.assembly.pose import Pose, Poses, rotation, skew, spin_rate
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.meshes import box, rectangles, tool_surfaces

STRAIGHT, OBLIQUE = np.eye(3), rotation(np.array([0.5, -0.8, 1.3]))


def turned_box(turn=STRAIGHT, **parameters):
    """A block as in meshes/box.py, turned about the origin."""

    def build():
        box.build(**parameters)
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, place in zip(tags, places.reshape(-1, 3) @ turn.T, strict=True):
            gmsh.model.mesh.setNode(tag, place, [])

    return read_gmsh(build)


def rubber(tool, friction, size=(6.0, 6.0, 3.0), cells=(5, 5, 2), turn=STRAIGHT, **contact):
    """A block with its top at z = 0 and its bottom fixed, under a tool."""
    mesh = turned_box(turn, size=size, cells=cells, origin=(-size[0] / 2, -size[1] / 2, -size[2]))
    scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)))
    scene.fix("zmin")
    scene.contact("zmax", tool, friction, name="c", **contact)
    return scene


# ---- rotations


def test_rates_of_rotations():
    rng = np.random.default_rng(1)
    for size in (0.0, 1e-3, 0.09, 0.11, 2.0, 6.0, 40.0):
        vector, way = size * rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        turn, h = rotation(vector), 1e-5
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
        rate = (rotation(vector + h * way) - rotation(vector - h * way)) / (2 * h)
        # central differences: h^2 and round-off of 1e-16 / h
        np.testing.assert_allclose(rate, skew(spin_rate(vector) @ way) @ turn, atol=1e-9)
    for angle in (0.05, 0.0999999, 0.1000001):  # series and formula meet
        assert abs(spin_rate(np.array([0.0, 0.0, angle]))[0, 0] - np.sin(angle) / angle) < 1e-14


@pytest.mark.parametrize("spherical", [False, True])
def test_poses_asked_for_by_turns_are_worked_out_once(spherical):
    """Measures of a step ask for those of its ends; where rotations are counted anew from its end they are other ones."""
    poses = Poses(np.zeros((1, 3)), 2.0, lambda: np.array([spherical]))
    start, end = np.zeros((1, 6)), np.full((1, 6), 0.3)
    known = [poses.at(0, q[0]) for q in (start, end)]
    assert all(poses.at(0, q[0]) is pose for _ in range(2) for q, pose in zip((start, end), known, strict=True))
    poses.accept(end)
    assert (poses.at(0, start[0]) is known[0]) == (not spherical)
    np.testing.assert_allclose(poses.at(0, end[0]).turn, known[1].turn, atol=1e-15)


def test_free_rotations_know_no_whole_turn():
    """Spins of 50 degrees about changing axes, taken up one by one, against their product; and the chart's round-off."""
    poses, q, turn = Poses(np.zeros((1, 3)), 2.0, lambda: np.array([True])), np.zeros((1, 6)), np.eye(3)
    for i in range(500):
        way = 0.9 * np.array([np.cos(i), np.sin(2 * i), 1.0]) / 1.5
        q[0, 3:] += 2.0 * way
        turn = rotation(way) @ turn
        np.testing.assert_allclose(poses.at(0, q[0]).turn, turn, atol=1e-12)
        poses.accept(q)
    pose = Pose(np.ones(3), np.array([1.0, 2.0, 3.0]), turn, np.eye(3), 1.0)
    X = np.arange(12.0).reshape(4, 3)
    np.testing.assert_allclose(pose.before(pose.placed(X)), X, atol=1e-13)


# ---- tangent

TOOLS = {
    "plane": rigid_plane(normal=(0, 0, -1.0)),
    "box": rigid_punch(2.5, 2.0, fillet=0.5),
    "cylinder": rigid_cylinder(4.0, (0, 0, 4.0)),
    "cone": rigid_cone(1.45, (0, 0, 0), tip=1.0),
}


def placed(name, points, friction, shift, spin):
    """A System whose tool, all of whose components are free, is pressed 0.4 mm into a roughened block and turned,
    committed, then moved on by `shift` [mm] and `spin` [rad]."""
    tool = (
        TOOLS[name]
        if name in TOOLS
        else rigid_surface(tool_surfaces.ball, "ball", radius=5.0, centre=(0, 0, 5.0), mesh_size=0.8)
    )
    motion = Motion(about=(0.5, -0.3, 1.0), force=(1.0, 1.0, -1.0), moment=(1.0, 1.0, 1.0))
    system = rubber(tool, friction, points=points).system(move={tool: motion})
    state, contact = system.state, system.contact_terms[0]
    state.u.x.array[:] = 0.01 * np.random.default_rng(1).uniform(-1, 1, len(state.u.x.array))
    state.q[0] = np.append([0.0, 0.0, -0.4], system.tools.lever * np.array([0.01, -0.02, 0.7]))
    contact.commit(state)
    state.q[0] += np.append(shift, system.tools.lever * np.asarray(spin))
    return system, contact


@pytest.mark.serial
@pytest.mark.parametrize(
    "name, points",
    [(name, "nodes") for name in TOOLS] + [("cylinder", 2), ("ball", "nodes"), ("ball", 2), ("ball", "averages")],
)
@pytest.mark.parametrize(
    "friction, shift, spin, status",
    [
        (0.0, (0.1, 0.05, -0.02), (0.01, 0.02, 0.3), CLOSED),
        (0.05, (0.6, 0.5, -0.02), (0.01, 0.02, 0.3), SLIP),
        (9.0, (0.01, 0.01, -0.02), (0.002, 0.001, 0.01), STICK),
        (coulomb(0.05, across=0.1, along=(1.0, 2.0, 0.5)), (0.6, 0.5, -0.02), (0.01, 0.02, 0.3), SLIP),
    ],
)
def test_tangent_and_border_of_a_turning_tool(name, points, friction, shift, spin, status):
    system, contact = placed(name, points, friction, shift, spin)
    state, at_start = system.state, forces(contact, system.state)
    assert (contact.statuses() == status).sum() > 3 and (contact.statuses() == OPEN).any() != (name == "plane")
    left = remainders(system, contact, 4e-5, kept=lambda: contact.parts.branches(state))
    # a plane without friction gives a residual that is linear but for its turns
    assert orders(left).min() > 1.97 or left.max() < 1e-12 * np.linalg.norm(at_start)
    # forces and torques about the reference point: tool and body together are in balance
    x = system.space.tabulate_dof_coordinates() + state.u.x.array.reshape(-1, 3)
    wrench = state.pose(0).wrench(x, at_start[:-6].reshape(-1, 3))
    np.testing.assert_allclose(wrench, -at_start[-6:], atol=1e-12 * np.abs(at_start).max())


# ---- prescribed rotation


def vectors(result, name, unit):
    """(steps, 3) columns of a history."""
    assert result.converged, result.verdict.reason
    return np.column_stack([result.column(f"{name}_{axis}_{unit}") for axis in "xyz"])


AXES = ("x", "y", "z", "rx", "ry", "rz")


def rolled(turn, method="newton", steps=6):
    """A cylinder pressed into a block, then rolled on with some slip, all of it turned about the origin."""
    cylinder = rigid_cylinder(4.0, turn @ (0, 0, 4.0), turn @ (0, 1.0, 0))
    ways = [lambda t, a=a: (turn @ (1.2 * max(t - 0.4, 0.0), 0, -0.6 * min(2.5 * t, 1.0)))[a] for a in range(3)]
    spins = [lambda t, a=a: (turn @ (0, 0.9 * max(t - 0.4, 0.0), 0))[a] for a in range(3)]
    motion = Motion(**dict(zip(AXES, ways + spins, strict=True)))
    scene = rubber(cylinder, 0.3, cells=(6, 3, 2), turn=turn, points=2)
    return solve(scene, move={cylinder: motion}, method=method, steps=steps)


@pytest.mark.parallel
def test_a_turned_scene_gives_turned_forces():
    """Also: rotations about an oblique axis are those of their rotation vector."""
    here, there = rolled(np.eye(3)), rolled(OBLIQUE)
    for name, unit in (("c_force", "N"), ("c_friction", "N"), ("c_moment", "Nmm"), ("cylinder_angle", "rad")):
        one, other = vectors(here, name, unit), vectors(there, name, unit)
        # converged to 1e-8 of the forces, with a lever of some radii
        np.testing.assert_allclose(other, one @ OBLIQUE.T, atol=1e-6 * np.abs(one).max())
    assert here.column("c_sticking_points")[-1] < here.column("c_active_points")[-1]
    np.testing.assert_allclose(here.column("cylinder_angle_y_rad")[-1], 0.54, atol=1e-12)


def test_a_stuck_block_turns_with_its_plates():
    """By more than a whole turn about an axis off its middle: forces turn with it and are else as they were."""
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(1, 1, 1), origin=(-1.0, -1.0, 0.0))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
    below, above = rigid_plane(name="below"), rigid_plane((0, 0, 1.0), (0, 0, -1.0), name="above")
    scene.contact("zmin", below, 2.0)
    scene.contact("zmax", above, 2.0)
    turned = lambda t: 7.0 * max(t - 0.1, 0.0) / 0.9  # noqa: E731
    move = {below: Motion(about=(0.5, 0, 0.5), ry=turned)}
    move[above] = Motion(about=(0.5, 0, 0.5), z=lambda t: -0.1 * min(10 * t, 1.0) * np.cos(turned(t)), ry=turned,
                         x=lambda t: -0.1 * min(10 * t, 1.0) * np.sin(turned(t)))  # fmt: skip
    result = solve(scene, move=move, steps=[0.1, *(0.1 + 0.9 * np.arange(1, 13) / 12)])
    force = vectors(result, "zmax_on_above_force", "N")
    angle = result.column("above_angle_y_rad")
    turns = np.array([rotation(np.array([0.0, a, 0.0])) for a in angle])
    assert angle[-1] > 2 * np.pi and abs(force[0, 2]) > 0.1
    np.testing.assert_allclose(np.einsum("tji,tj->ti", turns, force), np.tile(force[0], (len(force), 1)), atol=1e-7)
    assert (result.column("zmax_on_above_sticking_points") == 4).all()


@pytest.mark.parallel
@pytest.mark.parametrize("method", ["newton", "snes"])
def test_torque_of_a_shaft_that_slides_on_a_pad(method):
    """mu * integral p r dA, r being the distance of the rubbing points from the shaft's middle."""
    shaft = rigid_cylinder(4.0, (0, 0, 4.0), name="shaft")
    scene = rubber(shaft, 0.3, cells=(6, 2, 2))
    motion = Motion(z=lambda t: -0.5 * min(2 * t, 1.0), ry=lambda t: 1.2 * max(2 * t - 1.0, 0.0))
    result = solve(scene, move={shaft: motion}, method=method, steps=8)
    assert result.converged and result.column("c_sticking_points")[-1] == 0
    contact, state = result.system.contact_terms[0], result.system.state
    pressure, surface = contact.forces.split_traction(state)[0], contact.surface
    x = (surface.X + state.u.x.array.reshape(-1, 3)[surface.nodes])[:, 0]
    r = np.linalg.norm((x - state.pose(0).place)[:, [0, 2]], axis=1)
    torque = result.system.comm.allreduce(0.3 * float((pressure[:, 0] * r * surface.area[:, 0]).sum()))
    # balance to 1e-8 of the forces, which are a hundred times the friction's
    np.testing.assert_allclose(abs(result.column("c_moment_y_Nmm")[-1]), torque, rtol=1e-6)


@pytest.mark.parallel
def test_work_of_turning_tools_is_accounted_for():
    """Hardly any energy is left over, also where nodes open and come in, and what a tool's torque works is much of it."""
    errors = []
    for steps in (10, 20):
        result = rolled(np.eye(3), steps=steps)
        errors.append(abs(result.column("energy_error_Nmm")[-1]))
    work = result.column("external_work_Nmm")[-1]
    torque, angle = result.column("c_moment_y_Nmm"), result.column("cylinder_angle_y_rad")
    spun = abs(np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(angle)))
    # 80 steps leave 8e-4
    assert max(errors) < 1e-3 * work and work < 10.0 * spun, (errors, work, spun)


# ---- pushed and free


@pytest.mark.parallel
def test_a_roller_rolls_freely_without_torque():
    """A roller pressed by a force, carried along by its hub and free to turn, on a pad that it sticks to: no torque, and,
    as rubber gives all work back, no mean drag over a facet of the pad, along which the energy is periodic."""
    roller = rigid_cylinder(6.0, (-2.0, 0, 6.0), name="roller")
    scene = rubber(roller, 2.0, size=(20.0, 1.0, 3.0), cells=(40, 1, 4))
    scene.fix("ymin", "y")
    scene.fix("ymax", "y")
    way = lambda t: 2.0 * max(t - 0.2, 0.0) / 0.8  # four facets [mm]  # noqa: E731
    motion = Motion(x=way, force=lambda t: (0, 0, -0.5 * min(5 * t, 1.0)), free="ry")
    result = solve(scene, move={roller: motion}, steps=[0.1, 0.2, *(0.2 + 0.05 * np.arange(1, 17))])
    force, moment = vectors(result, "c_force", "N"), vectors(result, "c_moment", "Nmm")
    np.testing.assert_allclose(force[1:, 2], -0.5, rtol=1e-7)
    assert np.abs(moment[:, 1]).max() < 1e-7 * 0.5 * 6.0  # out of balance by 1e-8 of the force, on the radius
    # what is lost is rubbed off where points come into contact and leave it, 0.14 % of the force times the way
    rubbed = np.diff(result.column("c_friction_work_Nmm")[[-9, -1]])[0]
    assert np.abs(force[-8:, 0]).max() < 0.01 * 0.5 and abs(force[-8:, 0].mean()) < rubbed / 1.0 < 2e-3 * 0.5
    angle = result.column("roller_angle_y_rad")
    rate = (angle[-1] - angle[-9]) * 6.0 / 1.0  # over two facets, the last of four
    assert abs(rate - 1.0) < 0.05  # it rolls on a surface that is stretched by some percent


def test_a_ball_pressed_and_twisted_sticks_in_the_middle():
    """By a moment of half the full one: a ring slips around a core that sticks; at last torque = mu * integral p r dA."""
    ball = rigid_sphere(6.0, (0, 0, 6.0), name="ball")
    scene = rubber(ball, 0.4, cells=(11, 11, 3))
    press = lambda t: -0.5 * min(2 * t, 1.0)  # noqa: E731
    result = solve(scene, move={ball: Motion(z=press, rz=lambda t: 0.12 * max(2 * t - 1, 0.0))}, steps=4)
    system = result.system
    contact, state = system.contact_terms[0], system.state
    status, surface = contact.response(state).status.ravel(), contact.surface
    r = np.linalg.norm(contact.spots()[:, :2], axis=1)
    r, status = (np.concatenate(system.comm.allgather(part)) for part in (r, status))
    assert result.converged and (status == STICK).sum() >= 5 and (status == SLIP).sum() >= 5
    assert r[status == STICK].max() < r[status == SLIP].min() + 1e-9
    torque = abs(result.column("c_moment_z_Nmm")[-1])
    pressure = contact.forces.split_traction(state)[0].ravel()
    x = (surface.X + state.u.x.array.reshape(-1, 3)[surface.nodes])[:, 0, :2]
    most = system.comm.allreduce(0.4 * float((pressure * np.linalg.norm(x, axis=1) * surface.area.ravel()).sum()))
    assert 0.2 * most < torque < 0.98 * most
    # the same torque as a load gives the same angle, but for the steps in which the ring grows
    pushed = Motion(z=press, moment=lambda t: (0, 0, torque * max(2 * t - 1, 0.0)))
    again = solve(scene, move={ball: pushed}, steps=4, method=Method(stabilise=True))
    np.testing.assert_allclose(vectors(again, "ball_angle", "rad")[-1], (0, 0, 0.12), atol=0.12 * 0.01)


@pytest.mark.parallel
def test_a_free_ball_turns_about_all_axes():
    """Its wrench is what pushes it; a mirrored moment turns it the mirrored way."""
    angles = []
    for side in (1.0, -1.0):
        ball = rigid_sphere(6.0, (0, 0, 6.0), name="ball")
        scene = rubber(ball, 0.5)
        motion = Motion(
            x=lambda t, side=side: 0.1 * side * t, about=(0, 0, 7.0), free="rx ry",
            force=lambda t: (0, 0, -0.4 * min(2 * t, 1.0)), moment=lambda t, side=side: (0, 0.0, 0.02 * side * t),
        )  # fmt: skip
        result = solve(scene, move={ball: motion}, steps=4, method=Method(stabilise=True))
        force, moment = vectors(result, "c_force", "N")[-1], vectors(result, "c_moment", "Nmm")[-1]
        np.testing.assert_allclose(force[2], -0.4, rtol=1e-7)
        np.testing.assert_allclose(moment, (0, 0, 0.02 * side), atol=1e-6)
        angles.append(vectors(result, "ball_angle", "rad")[-1])
    assert abs(angles[0][1]) > 0.01 and abs(angles[0][2]) > 1e-4
    np.testing.assert_allclose(angles[0], angles[1] * (1, -1, -1), atol=1e-6)


@pytest.mark.parallel
def test_arc_length_turns_a_shaft():
    """Up to an angle that it is asked for, at which load steps find the same, all points sliding."""
    shaft = rigid_cylinder(4.0, (0, 0, 4.0), name="shaft")
    scene, move = rubber(shaft, 0.1, cells=(6, 2, 2)), {shaft: Motion(ry=0.8, force=(0, 0, -2.0))}
    until = Travel(shaft, "ry", 0.4)
    along = solve(scene, move=move, steps=ArcSteps(until=until, first=0.1))
    assert along.converged and str(until) == "rotation of 'shaft' about y = 0.4"
    there = solve(scene, move=move, steps=list(along.column("t")))
    assert there.column("c_sticking_points")[-1] == along.column("c_sticking_points")[-1] == 0
    np.testing.assert_allclose(along.column("shaft_angle_y_rad")[-1], 0.4, rtol=1e-6)
    for name in ("c_moment_y_Nmm", "shaft_travel_z_mm", "c_force_z_N"):
        np.testing.assert_allclose(along.column(name), there.column(name), rtol=1e-6)


@pytest.mark.parametrize("points", ["averages", 2])
def test_a_meshed_ball_is_twisted(points):
    """By a moment: the contact's is its opposite, and forces, torques and rates are right on any number of ranks."""
    ball = rigid_surface(tool_surfaces.ball, "ball", radius=8.0, centre=(0, 0, 8.0), mesh_size=1.0, name="ball")
    motion = Motion(z=lambda t: -0.4 * min(2 * t, 1.0), moment=lambda t: (0, 0, 0.1 * max(2 * t - 1, 0.0)))
    scene = rubber(ball, 0.5, points=points)
    result = solve(scene, move={ball: motion}, steps=2, method=Method(stabilise=True))
    # springs that pull by 1e-7 of the force have let go; a turn counts by the bodies' size
    atol = 2e-7 * result.column("c_load_N")[-1] * result.system.tools.lever
    np.testing.assert_allclose(vectors(result, "c_moment", "Nmm")[-1][2], 0.1, atol=atol, rtol=0)
    assert result.column("ball_angle_z_rad")[-1] > 1e-3
    assert (audit := result.audit()).right, audit


def test_what_penalties_cost_an_angle():
    """A plate pushed off its middle: how much it would tilt with penalties without bound, against a hundred times them."""
    tilts, change = [], 0.0
    for penalty in (2.0, 200.0):
        plate = rigid_plane(normal=(0, 0, -1.0), name="plate")
        motion = Motion(force=(0, 0, -3.0), moment=(1.0, 0, 0))
        result = solve(rubber(plate, 0.0, cells=(3, 3, 2), penalty=penalty), move={plate: motion}, steps=2)
        tilts.append(vectors(result, "plate_angle", "rad")[-1][0])
        change = change or result.summary["penalty_error"]["angle_change"]["plate_rad"][0]
    # of first order: the springs in series are 14 % of the whole, whose square is left
    assert abs(change) > 0.05 * tilts[0]
    np.testing.assert_allclose(tilts[0] + change, tilts[1], rtol=0.02)


# ---- ties


def shaken(hub, floor=None, friction=0.0, turn=STRAIGHT, size=(2.0, 2.0, 1.0), cells=(2, 2, 2)):
    """A block tied to a hub by its top, on a floor if so asked."""
    mesh = turned_box(turn, size=size, cells=cells, origin=(-size[0] / 2, -size[1] / 2, 0.0))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
    scene.tie("zmax", hub)
    if floor is None:
        scene.fix("zmin")
    else:
        scene.contact("zmin", floor, friction, name="c")
    return scene


@pytest.mark.serial
@pytest.mark.parametrize("to", ["hub", "floor"])
def test_the_tangent_carries_along_what_is_tied(to):
    """To a hub, beside a floor that moves too, or to that floor; all components are free."""
    floor = rigid_plane(name="floor")
    scene = shaken(rigid_hub("hub", (0.3, 0.1, 2.0)) if to == "hub" else floor, floor, 0.3)
    loads = {"force": (1.0, 1.0, -1.0), "moment": (1.0, 1.0, 1.0)}
    system = scene.system(move={tool: Motion(**loads) for tool in scene.tools})
    state, ties = system.state, system.supports.ties
    state.u.x.array[:] = 0.02 * np.random.default_rng(1).uniform(-1, 1, len(state.u.x.array))
    state.q[:] = 0.1 * np.random.default_rng(3).uniform(-1, 1, state.q.shape)
    state.q[0, 2] = 0.1
    ties.place(state.poses, state.q, state.u.x.array)
    system.trail.commit()
    state.q[:] += 0.05 * np.random.default_rng(4).uniform(-1, 1, state.q.shape)
    free = np.ones(len(state.u.x.array))
    free[system.supports.dofs] = 0.0

    def residual():
        ties.place(state.poses, state.q, state.u.x.array)
        system.assemble_residual()
        return np.concatenate([system.residual_vector.array, system.tool_residual.ravel()])

    residual()
    assert (system.contact_terms[0].statuses() != OPEN).any()
    system.assemble_tangent()
    way, free = random_way(system), np.append(free, np.ones(state.q.size))
    slope = free * change(system, free * way)
    left = left_over(system, residual, slope, way, 4e-5, system.contact_terms[0].statuses)
    assert orders(left).min() > 1.97, left


@pytest.mark.parallel
@pytest.mark.parametrize("method", ["newton", "snes"])
def test_a_hub_leads_what_is_tied_to_it(method):
    """As the same motion stated node by node; the wrench that it takes, as a load, leads to the same motion."""
    end, about = np.array([0.1, -0.05, 0.2, 0.2, -0.3, 0.5]), np.array([0.2, 0.1, 1.5])
    hub = rigid_hub("hub", about)
    led = solve(shaken(hub), move={hub: Motion(**dict(zip(AXES, end, strict=True)))}, steps=3, method=method)
    force, moment = vectors(led, "hub_force", "N"), vectors(led, "hub_moment", "Nmm")

    def placed(X, t):
        return (X - about) @ (rotation(t * end[3:]) - np.eye(3)).T + t * end[:3]

    scene = shaken(hub)
    scene.ties.clear()
    for i, axis in enumerate("xyz"):
        scene.prescribe("zmax", axis, lambda X, t, i=i: placed(X, t)[:, i])
    stated = solve(scene, steps=3)
    np.testing.assert_allclose(force, vectors(stated, "zmax_reaction", "N"), atol=1e-7 * np.abs(force).max())
    np.testing.assert_allclose(led.system.strain_energy(), stated.system.strain_energy(), rtol=1e-8)
    works = [result.column("external_work_Nmm") for result in (led, stated)]  # both by the trapezoidal rule
    np.testing.assert_allclose(works[0], works[1], rtol=0.02)

    loads = [np.concatenate([np.zeros((1, 3)), part]) for part in (force, moment)]

    def load(part):
        return lambda t: np.array([np.interp(3 * t, range(4), part[:, i]) for i in range(3)])

    pushed = Motion(force=load(loads[0]), moment=load(loads[1]))
    back = solve(shaken(hub), move={hub: pushed}, steps=3, method=method)
    np.testing.assert_allclose(vectors(back, "hub_travel", "mm"), vectors(led, "hub_travel", "mm"), atol=1e-6)
    turn = back.system.state.pose(0).turn
    np.testing.assert_allclose(turn, rotation(end[3:]), atol=1e-6)
    works = [result.column("external_work_Nmm")[-1] for result in (led, back)]
    np.testing.assert_allclose(works[0], works[1], rtol=0.02)


@pytest.mark.parallel
@pytest.mark.parametrize("stabilise", [False, True])
def test_what_nothing_turns_stays_and_what_nothing_holds_is_said(stabilise):
    """A ball without friction resists no turn: without a moment it rests, and no pivot of round-off is a bifurcation."""
    ball = rigid_sphere(6.0, (0, 0, 6.0), name="ball")
    scene = rubber(ball, 0.0)
    press, kept = lambda t: -0.4 * min(2 * t, 1.0), {"steps": 4, "method": Method(stabilise=stabilise)}
    resting = solve(scene, move={ball: Motion(z=press, free="rz")}, **kept).require()
    assert np.abs(resting.column("ball_angle_z_rad")).max() < 1e-9
    assert not any("bifurcation" in note for note in resting.verdict.notes)
    twisted = lambda t: (0, 0, 0.1 * max(2 * t - 1, 0.0))  # noqa: E731
    failed = solve(scene, move={ball: Motion(z=press, moment=twisted)}, **kept)
    verdict = failed.verdict
    assert (verdict.kind, verdict.place, verdict.t) == ("rigid-body motion", "tool 'ball'", 0.5)
    assert "turns about z without resistance" in verdict.reason and "prescribe that component" in verdict.remedy
    assert np.abs(failed.column("ball_angle_z_rad")).max() < 1e-9
    solve(scene, move={ball: Motion(z=press, rz=0.3)}, **kept).require()  # the one remedy; the other one:
    solve(rubber(ball, 0.3), move={ball: Motion(z=press, moment=twisted)}, **kept).require()


@pytest.mark.parallel
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_moment_on_a_wheel_in_the_air(friction):
    """Nothing resists it, with the tread that is tied to it: said, with what lets it go on."""
    floor, hub = rigid_plane((0, 0, -0.1), name="floor"), rigid_hub("hub", (0, 0, 4.0))
    scene = shaken(hub, floor, friction, size=(4.0, 0.5, 1.0), cells=(12, 1, 2))
    scene.supports.clear()

    def run(start):
        motion = Motion(z=lambda t: -0.2 * min(2 * t, 1.0), moment=lambda t: (0, 0.01 * max(t - start, 0.0), 0))
        return solve(scene, move={hub: motion}, steps=10)

    verdict = run(0.0).verdict
    assert (verdict.kind, verdict.place, verdict.t) == ("rigid-body motion", "tool 'hub'", 0.0)
    assert "turns about y" in verdict.reason and "let the moment begin once friction holds it" in verdict.remedy
    if friction > 0.0:
        assert run(0.5).require().column("hub_angle_y_rad")[-1] > 1e-5


@pytest.mark.parallel
def test_a_body_on_a_hub_turns_without_force():
    hub = rigid_hub("hub", (4.0, 0, 0))
    scene = shaken(hub)
    scene.supports.clear()
    result = solve(scene, move={hub: Motion(ry=12.0, z=3.0)}, steps=24)
    assert np.abs(vectors(result, "hub_force", "N")).max() < 1e-8
    assert abs(result.column("hub_angle_y_rad")[-1] - 12.0) < 1e-12
    said = [note for note in result.verdict.notes if "cut-back" not in note]
    assert not said  # the work of what balance leaves is none that steps could account for


def test_a_block_pushed_up_an_incline():
    """Weight G on its hub, pushed by a horizontal F: F/G = (tan a + mu) / (1 - mu tan a) up, and down the other way."""
    slope, mu, ratios = np.radians(20.0), 0.3, []
    turn = rotation(np.array([0.0, -slope, 0.0]))
    for way in (1.0, -1.0):
        floor, hub = rigid_plane(normal=turn @ (0, 0, 1.0), name="floor"), rigid_hub("hub", turn @ (0, 0, 0.5))
        path = lambda t, way=way: 0.5 * way * max(t - 0.2, 0.0)  # noqa: E731
        motion = Motion(x=path, force=lambda t: (0, 0, -0.4 * min(5 * t, 1.0)))
        result = solve(shaken(hub, floor, mu, turn), move={hub: motion}, steps=5)
        assert result.column("c_sticking_points")[-1] == 0
        force = vectors(result, "hub_force", "N")[-1]
        np.testing.assert_allclose(force[2], -0.4, rtol=1e-7)
        ratios.append(force[0] / 0.4)
    up, down = (np.tan(slope) + sign * mu for sign in (1.0, -1.0))
    exact = up / (1 - mu * np.tan(slope)), down / (1 + mu * np.tan(slope))
    np.testing.assert_allclose(ratios, exact, atol=1e-6)


def test_a_wheel_rolls_freely():
    """A rubber tread tied to a roller that is pressed by a force, carried along, and free to turn: no torque."""
    floor, hub = rigid_plane(name="floor"), rigid_hub("hub", (0, 0, 4.0))
    scene = shaken(hub, floor, 1.0, size=(4.0, 0.5, 1.0), cells=(12, 1, 2))
    scene.fix("ymin", "y")
    refused(lambda: solve(scene, move={hub: Motion(y=1.0)}), "'hub', to which", "support of ymin along y")
    scene.supports.clear()
    motion = Motion(x=lambda t: 0.4 * max(t - 0.2, 0.0), force=lambda t: (0, 0, -0.2 * min(5 * t, 1.0)), free="ry")
    result = solve(scene, move={hub: motion}, steps=10)
    moment, force = vectors(result, "hub_moment", "Nmm"), vectors(result, "hub_force", "N")
    np.testing.assert_allclose(force[1:, 2], -0.2, rtol=1e-7)
    assert np.abs(moment[:, 1]).max() < 1e-7 * 0.2 * 4.0
    assert result.column("hub_angle_y_rad")[-1] > 0.01 and (result.column("c_sticking_points") > 0).all()
    assert result.audit().right


def half_of_a_tied_block(whole):
    """A block that a hub on its top pushes and tilts, or the half of it behind its plane of symmetry x = 0."""
    low = -1.0 if whole else 0.0
    mesh = read_gmsh(box.build, size=(1.0 - low, 1.0, 1.0), cells=(4 if whole else 2, 2, 2), origin=(low, 0.0, 0.0))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
    hub, floor = rigid_hub("hub", (0.0, 0.2, 1.0)), rigid_plane(name="floor")
    scene.tie("zmax", hub)
    scene.contact("zmin", floor, 0.3, name="c")
    if not whole:
        scene.fix("xmin", normal=True)
    share = 1.0 if whole else 0.5
    stages = [
        Stage("press", move={hub: Motion(z=-0.1)}, steps=2),
        Stage("push", move={hub: Motion(force=(0, 0.05 * share, -0.5 * share), moment=(0.02 * share, 0, 0))}, steps=2),
    ]
    return solve(scene, stages=stages).require()


@pytest.mark.parallel
def test_a_plane_of_symmetry_through_what_is_tied():
    """Half a block bears half the loads of the whole, in which the tied nodes on the plane count as the hub's."""
    whole, half = half_of_a_tied_block(True), half_of_a_tied_block(False)
    for name, unit in (("hub_travel", "mm"), ("hub_angle", "rad")):
        np.testing.assert_allclose(vectors(half, name, unit), vectors(whole, name, unit), atol=1e-8)
    for column in ("hub_force_z_N", "hub_moment_x_Nmm", "c_force_y_N", "external_work_Nmm", "c_friction_work_Nmm"):
        scale = np.abs(whole.column(column)).max()
        np.testing.assert_allclose(2 * half.column(column), whole.column(column), rtol=0.0, atol=1e-7 * scale)
    assert np.abs(vectors(whole, "hub_angle", "rad")[-1, 0]) > 1e-3 and half.column("balance_error_N").max() < 1e-8


def strip(plane, hub):
    """A block tied to a hub by its top in plane strain, or a layer in space between two planes."""
    if plane:
        sides = {"box": ((0.0, 0.0), (2.0, 1.0), (4, 2))}
        mesh, name = read_gmsh(rectangles.build, rectangles=sides), "box_{}"
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane="strain", thickness=0.5)
    else:
        mesh, name = read_gmsh(box.build, size=(2.0, 1.0, 0.5), cells=(4, 2, 1)), "{}"
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
        scene.fix(("zmin", "zmax"), "z")
    scene.tie(name.format("ymax"), hub)
    scene.fix(name.format("ymin"), "xy")
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize("steps", [3, ArcSteps(until=Load(1.0), first=0.1)], ids=["load steps", "arcs"])
def test_a_hub_in_plane_strain(steps):
    """Pushed, and turning freely under a moment: the same as a layer of the thickness in space."""
    runs = []
    for plane in (True, False):
        hub = rigid_hub("hub", (1.2, 1.0, 0.0))
        move = {hub: Motion(force=(0.2, -0.3, 0.0), moment=(0.0, 0.0, 0.1))}
        runs.append(solve(strip(plane, hub), move=move, steps=steps).require())
    columns = [
        "hub_travel_x_mm",
        "hub_travel_y_mm",
        "hub_angle_z_rad",
        "hub_force_x_N",
        "hub_moment_z_Nmm",
        "external_work_Nmm",
    ]
    for column in columns:
        np.testing.assert_allclose(runs[0].column(column)[-1], runs[1].column(column)[-1], rtol=1e-6)
    assert abs(runs[0].column("hub_angle_z_rad")[-1]) > 0.02
    assert "hub_moment_x_Nmm" not in runs[0].history[0] and runs[0].column("balance_error_N")[-1] < 1e-6


@pytest.mark.parallel
def test_a_hub_on_an_axis():
    """A bonded disc all the way round, its axis tied too, drawn by a force: as by the way that this gives, stated."""
    sides = {"disc": ((0.0, 0.0), (2.0, 1.0), (4, 2))}

    def disc():
        scene = Scene(Body(read_gmsh(rectangles.build, rectangles=sides), "disc", neo_hooke(1.0, 5.0)), plane="axisymmetric")
        scene.fix("disc_ymin")
        return scene

    hub, scene = rigid_hub("hub"), disc()
    scene.tie("disc_ymax", hub)
    drawn = solve(scene, move={hub: Motion(force=(0.0, 5.0, 0.0))}, steps=2).require()
    way, scene = drawn.column("hub_travel_y_mm"), disc()
    scene.fix("disc_ymax", "x")
    scene.prescribe("disc_ymax", "y", lambda X, t: np.interp(2 * t, range(3), [0.0, *way]))
    stated = solve(scene, steps=2).require()
    np.testing.assert_allclose(stated.column("disc_ymax_reaction_y_N"), [2.5, 5.0], rtol=1e-7)
    np.testing.assert_allclose(drawn.column("strain_energy_Nmm"), stated.column("strain_energy_Nmm"), rtol=1e-7)
    scene = disc()
    scene.tie("disc_ymax", hub)
    refused(lambda: solve(scene, move={hub: Motion(x=0.1)}), "'hub' is driven along x")


def test_arc_length_turns_a_hub():
    """Twisted by a growing moment and pulled by a force, along the arc as by load steps to the same loads."""
    hub = rigid_hub("hub", (0, 0, 1.0))
    drive = {"move": {hub: Motion(force=(0.1, 0, 0.5), moment=(0, 0.1, 2.0), free="rx y")}}
    along = solve(shaken(hub), **drive, steps=ArcSteps(until=Travel(hub, "rz", 0.5), first=0.1))
    steps = solve(shaken(hub), **drive, steps=list(along.column("t")))
    angle, same = vectors(along, "hub_angle", "rad"), vectors(steps, "hub_angle", "rad")
    assert abs(angle[-1][2] - 0.5) < 1e-6 and abs(angle[-1][1]) > 0.01
    np.testing.assert_allclose(angle, same, atol=1e-6)
    np.testing.assert_allclose(vectors(along, "hub_moment", "Nmm"), np.outer(along.column("t"), (0, 0.1, 2.0)), atol=1e-6)


# ---- bad input


@pytest.mark.parallel
@pytest.mark.parametrize(
    "motion, words",
    [
        ({"z": -1.0, "force": (0, 0, -1.0)}, ("'shaft'", "z is both moved and pushed")),
        ({"ry": 1.0, "moment": (0, 1.0, 0)}, ("ry is both moved and pushed",)),
        ({"x": 1.0, "free": "x"}, ("x is both moved and free",)),
        ({"free": "xy"}, ("free = 'xy'", "x, y, z, rx, ry, rz")),
        ({"free": 3}, ("free = 3",)),
        ({"ry": 1.0, "free": "rx"}, ("rx may move freely", "let all three be free")),
        ({"free": "rx rz"}, ("rx and rz may move freely",)),
        ({"about": (0, 1)}, ("about", "three finite numbers")),
        ({"rz": (0, 1)}, ("rz", "one finite number")),
        ({"moment": 1.0}, ("moment", "three finite numbers")),
        ({"ry": lambda t: 1.0 + t}, ("'shaft'", "t = 0", "start from 0")),
        ({"ry": lambda t: np.nan}, ("ry at t",)),
    ],
)
def test_a_wrong_motion_is_refused(motion, words):
    shaft = rigid_cylinder(4.0, (0, 0, 4.0), name="shaft")
    refused(lambda: solve(rubber(shaft, 0.3), move={shaft: Motion(**motion)}), *words)


@pytest.mark.parallel
def test_a_target_that_a_tool_cannot_reach_is_refused():
    shaft = rigid_cylinder(4.0, (0, 0, 4.0), name="shaft")
    along = ArcSteps(until=Travel(shaft, "rz", 0.1))
    move = {shaft: Motion(ry=0.8, force=(0, 0, -2.0))}
    refused(lambda: solve(rubber(shaft, 0.1), move=move, steps=along), "'shaft' about z = 0.1", "neither moves nor is free")


@pytest.mark.parallel
def test_a_motion_is_stated_once():
    shaft = rigid_cylinder(4.0, (0, 0, 4.0), name="shaft")
    scene, motion = rubber(shaft, 0.3), Motion(z=-1.0)
    refused(lambda: solve(scene, move={shaft: motion}, push={shaft: (1.0, 0, 0)}), "both moved and pushed", "one Motion")
    refused(lambda: solve(scene, push={shaft: motion}), "push of 'shaft'", "move=")


@pytest.mark.parallel
def test_a_hub_that_leaves_a_support_at_some_step_alone_is_refused():
    """At all quarters of the way it is where the support holds the nodes; in the second stage where the first has led."""
    hub = rigid_hub("hub")
    shake = Motion(x=0.1, z=lambda s: 0.1 * np.sin(8 * np.pi * s))
    scene = shaken(hub)
    scene.supports.clear()
    scene.fix("xmin", "z")
    run, words = {"steps": [0.3, 1.0]}, ("xmin along z", "leads them off")
    refused(lambda: solve(scene, move={hub: shake}, **run), "t = 0.3", *words)
    stages = [Stage("along", move={hub: Motion(x=0.1)}, steps=1), Stage("shake", move={hub: shake})]
    refused(lambda: solve(scene, stages=stages, **run), "stage 'shake'", "t = 1.3", *words)


@pytest.mark.parallel
def test_a_hub_goes_on_with_a_support_of_tied_nodes_from_another_run():
    """Both have come as far there; what the support prescribes counts from there, too."""
    hub = rigid_hub("hub")
    scene = shaken(hub)
    scene.supports.clear()
    scene.prescribe("xmin", "z", 0.2)
    run = {"steps": 2}
    lifted = solve(scene, move={hub: Motion(z=0.2)}, **run).require()
    further = Stage("further", move={hub: Motion(z=0.1)}, prescribe={("xmin", "z"): 0.1})
    result = solve(scene, stages=[further, Stage("along", move={hub: Motion(x=0.3)})], start=lifted, **run).require()
    np.testing.assert_allclose(result.column("hub_travel_z_mm"), [0.25, 0.3, 0.3, 0.3], rtol=1e-12)
    along = solve(scene, stages=[Stage("along", move={hub: Motion(x=0.3)})], start=lifted, **run).require()
    np.testing.assert_allclose(along.column("hub_travel_z_mm"), 0.2, rtol=1e-12)
    wrong = Stage("wrong", move={hub: Motion(z=lambda s: 0.1 * np.sin(4 * np.pi * s))}, steps=[0.3, 1.0])
    refused(lambda: solve(scene, stages=[wrong], start=lifted), "t = 0.3", "xmin along z", "leads them off")


@pytest.mark.parallel
def test_a_load_on_a_component_that_is_not_free_is_refused():
    """A function that vanishes at t = 0.5 and 1 lets nothing go, and would do nothing."""
    hub = rigid_hub("hub")
    scene = shaken(hub)
    swing = lambda t: (0.0, 0.0, t * (1 - t) * (0.5 - t))  # noqa: E731
    run = {"steps": 4}
    refused(lambda: solve(scene, move={hub: Motion(force=swing)}, **run), "'hub': force at t = 0.25", "component z", "free=")
    turned = Motion(x=0.1, moment=swing)
    refused(lambda: solve(scene, move={hub: turned}, **run), "'hub': moment at t = 0.25", "component z", "free=")
    both = lambda t: (-t, 0.0, t * (1 - t) * (0.5 - t))  # noqa: E731
    refused(lambda: solve(scene, push={hub: both}, **run), "push of 'hub' at t = 0.25", "component z", "free=")
    assert solve(scene, move={hub: Motion(force=swing, free="z")}, **run).converged


@pytest.mark.parallel
def test_wrong_ties_are_refused():
    hub, other = rigid_hub("hub"), rigid_hub("other")
    drive = {"move": {hub: Motion(z=0.1)}}
    scene = shaken(hub)
    scene.tie("zmin", other)
    led = {"move": {hub: Motion(z=0.1), other: Motion(x=0.1)}}
    refused(lambda: solve(scene, **led), "'other', to which", "support of zmin along x", "leads them off", "leave one")
    led["move"][other] = Motion(free="z")
    refused(lambda: solve(scene, **led), "'other', to which", "support of zmin along z", "may leave")
    turned = shaken(hub)
    turned.fix("xmin", "x")
    stages = [Stage("up", move={hub: Motion(z=0.1)}), Stage("turn", move={hub: Motion(ry=0.1)})]
    refused(lambda: solve(turned, stages=stages), "stage 'turn'", "support of xmin along x")
    scene = shaken(hub)
    scene.tie("xmin", other)
    scene.supports.clear()
    refused(lambda: solve(scene, **drive), "tie of 'xmin' to 'other'", "tie of 'zmax' to 'hub'")
    scene = shaken(hub)
    refused(lambda: scene.tie("zmax", "hub"), "'hub' is no rigid body", "rigid_hub")
    refused(lambda: scene.tie("nowhere", hub), "nowhere")
    refused(lambda: scene.tie("zmax", rigid_hub("hub")), "two tools are named 'hub'")
    refused(lambda: solve(scene, move={other: Motion(z=0.1)}), "'other'", "in no contact or tie")
    refused(lambda: rigid_hub("hub", (0, 1)), "point", "three finite numbers")
    refused(lambda: rigid_hub(""), "name of a rigid hub")
    refused(lambda: scene.contact("xmin", hub), "hub", "no surface")


# -- a tool that slid, and is let go -------------------------------------------------------------------------------------
def roller_on_a_block():
    """A roller pressed into a plane block and dragged until it slides, past the greatest force that this takes."""
    mesh = read_gmsh(rectangles.build, rectangles={"block": ((0.0, 0.0), (20.0, 5.0), (32, 8))})
    scene = Scene(Body(mesh, "block", neo_hooke(1.0, 5.0)), plane="strain")
    scene.fix("block_ymin")
    tool = rigid_cylinder(3.0, (8.0, 8.0, 0.0), (0, 0, 1), name="tool")
    scene.contact("block_ymax", tool, 0.5, name="c")
    return scene, tool, [{"y": -1.0}, {"x": 1.25, "force": (0, -3.0, 0)}], {"force": (0.3, -3.0, 0)}, {"x": -0.85}


def plane_under_a_block():
    """All points of a flat tool slide: nothing but friction holds it."""
    mesh = read_gmsh(rectangles.build, rectangles={"block": ((0.0, 0.0), (10.0, 5.0), (10, 5))})
    scene = Scene(Body(mesh, "block", neo_hooke(1.0, 5.0)), plane="strain")
    scene.fix("block_ymax")
    tool = rigid_plane(normal=(0, 1, 0), name="tool")
    scene.contact("block_ymin", tool, 0.3, name="c")
    return scene, tool, [{"y": 0.3}, {"x": 2.0, "force": (0, 2.5, 0)}], {"force": (0.2, 2.5, 0)}, {"x": -1.0}


def ball_on_a_block():
    scene = Scene(Body(read_gmsh(box.build, size=(10.0, 7.0, 3.0), cells=(10, 7, 3)), "box", neo_hooke(1.0, 5.0)))
    scene.fix("zmin")
    tool = rigid_sphere(4.0, (5.0, 3.5, 7.0), name="tool")
    scene.contact("zmax", tool, 0.5, points=3, name="c")
    return scene, tool, [{"z": -0.8}, {"x": 0.8, "force": (0, 0, -10.0)}], {"force": (1.0, 0, -10.0)}, {"x": -0.6}


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("of", "steps"),
    [
        (roller_on_a_block, 3),
        (roller_on_a_block, 10),
        (plane_under_a_block, 3),
        pytest.param(ball_on_a_block, 3, marks=pytest.mark.slow),
    ],
)
def test_a_tool_that_slid_and_is_pushed_less_springs_back(of, steps):
    """To where it has that force when it is moved back, in any number of steps; it is not thrown off, nor goes on."""
    ends = []
    for name, count in (("let go", steps), ("back", 40)):
        scene, tool, (press, drag), released, back = of()
        last = released if name == "let go" else {**back, "force": drag["force"]}
        ways = ("press", press, 4), ("drag", drag, 10), (name, last, count)
        stages = [Stage(stage, move={tool: Motion(**way)}, steps=n) for stage, way, n in ways]
        ends.append(solve(scene, stages=stages).require())
    ended, path = ends
    force, travel = (path.column(f"{name}_x_{unit}", "back") for name, unit in (("c_force", "N"), ("tool_travel", "mm")))
    right = np.interp(released["force"][0], force[::-1], travel[::-1])
    assert ended.column("c_force_x_N")[-1] == pytest.approx(released["force"][0], rel=1e-6)
    assert ended.column("tool_travel_x_mm")[-1] == pytest.approx(right, abs=2e-3)
