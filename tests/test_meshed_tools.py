"""Meshed rigid tools: they converge to the analytic ones, exact tangent with border, friction, drives, ranks, bad input."""

import json
import os
import subprocess
import sys
from functools import cache

import gmsh
import numpy as np
import pytest
from taylor import forces, orders, remainders

from fenics_contact import (
    Body,
    Displacement,
    Method,
    Motion,
    Penalty,
    Scene,
    SceneError,
    Stage,
    coulomb,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_curve,
    rigid_hub,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    rigid_surface,
    solve,
)
from fenics_contact.kernels.status import CLOSED, SLIP, STICK
from fenics_contact.meshes import box, rectangles, tool_surfaces

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
RADIUS, FRICTION = 10.0, 0.3
NAMES = [f"c_force_{axis}_N" for axis in "xyz"]


def block(tool, friction=0.0, cells=(8, 8, 4), degree=1, **contact):
    """A rubber block 12 x 12 x 6 mm, top at z = 0, bottom fixed, under a tool."""
    mesh = read_gmsh(box.build, size=(12.0, 12.0, 6.0), cells=cells, origin=(-6.0, -6.0, -6.0))
    scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), degree=degree)
    scene.fix("zmin")
    scene.contact("zmax", tool, friction, name="c", **contact)
    return scene


def ball(size, sink=0.0, **parameters):
    centre = (0, 0, RADIUS - sink)
    return rigid_surface(tool_surfaces.ball, "ball", radius=RADIUS, centre=centre, mesh_size=size, **parameters)


def down_and_along(down, along):
    return lambda t: (along * max(2 * t - 1, 0.0), 0.0, -down * min(2 * t, 1.0))


@cache
def finest_force(points, travel):
    """(facets' size, force) of a ball that is smooth, or where averages are taken, which analytic tools do without, fine."""
    size, tool = (0.0, rigid_sphere(RADIUS, (0, 0, RADIUS))) if points == 3 else (0.25, ball(0.25))
    return size, force(tool, down_and_along(*travel), friction=FRICTION, penalty=Penalty(factor=100.0), points=points)


def force(tool, travel=(0.0, 0.0, -1.0), steps=4, **scene):
    result = solve(block(tool, **scene), move={tool: travel}, steps=steps)
    assert result.converged, result.verdict.reason
    return np.array([result.history[-1][name] for name in NAMES])


# ---- against the analytic tools


@pytest.mark.parametrize(
    ("quadrilaterals", "points"),
    [(False, 3), (True, 3), *(pytest.param(quads, "averages", marks=pytest.mark.slow) for quads in (False, True))],
)
def test_ball_converges_to_the_sphere(quadrilaterals, points):
    """Facets with their corners on the sphere lie inside it by up to h^2/8R: the force errs by second order."""
    travel, sizes = (1.0, 0.5), np.array([2.0, 1.0, 0.5])
    # a typed penalty: not raised on the coarsest facets alone
    same = {"friction": FRICTION, "penalty": Penalty(factor=100.0), "points": points}
    finest, exact = finest_force(points, travel)
    meshed = [force(ball(size, quadrilaterals=quadrilaterals), down_and_along(*travel), **same) for size in sizes]
    errors = [np.linalg.norm(f - exact) / np.linalg.norm(exact) for f in meshed]
    # the finest ball lies inside the sphere too: balls differ by h^2 - finest^2 over 8R
    order = np.polyfit(np.log(np.sqrt(sizes**2 - finest**2)), np.log(errors), 1)[0]
    assert order > 1.6  # 2 less what three coarse, irregular meshes scatter
    # mean sagitta h^2/16R of the finest mesh, over the travel, times the exponent 3/2 of Hertz's law: 0.23 %
    assert errors[-1] < 0.01


def test_punch_converges_to_the_filleted_punch():
    """With slave nodes, which seek the closest point on either; Gauss points seek along the body's own normal on one."""
    shape, sizes = {"half_width": 3.0, "height": 4.0, "fillet": 1.5}, np.array([1.5, 0.75, 0.25])
    exact = force(rigid_punch(**shape), points="nodes")
    meshed = [force(rigid_surface(tool_surfaces.punch, "punch", **shape, mesh_size=h), points="nodes") for h in sizes]
    errors = [np.linalg.norm(f - exact) / np.linalg.norm(exact) for f in meshed]
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] > 1.5  # 2 less what coarse meshes scatter
    assert errors[-1] < 0.01  # mean sagitta h^2/16r of the rounding: 0.26 % of the travel, and its edges carry most


@pytest.mark.serial
def test_second_degree_presses_alike():
    """Cells of degree 2 take the force closer to the one of a fine mesh than cells of degree 1 of the same size."""
    fine = force(ball(1.0), cells=(12, 12, 6), steps=2)
    second = force(ball(1.0), cells=(4, 4, 2), degree=2, steps=2)
    coarse = force(ball(1.0), cells=(4, 4, 2), steps=2)
    assert abs(second[2] - fine[2]) < abs(coarse[2] - fine[2])


def tetrahedra(size):
    """A cube of `size` from the origin up, irregular tetrahedra, with the faces it needs named."""
    gmsh.model.occ.addBox(0.0, 0.0, 0.0, size, size, size)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5 * size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5 * size)
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "box")
    for tag, name in ((1, "xmin"), (3, "ymin"), (5, "zmin"), (6, "zmax")):
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [tag]), name)


@pytest.mark.parametrize(
    "cells, degree, points",
    [("hex", 1, "nodes"), ("hex", 1, "averages"), ("tet", 1, "averages"), ("hex", 2, 3), ("tet", 1, 2), ("tet", 2, 3)],
)
def test_flat_tool_squeezes_a_cube_homogeneously(cells, degree, points):
    """Uniaxial stress at stretch 0.9, classical Mooney-Rivlin: closed form -0.1288051 MPa (nominal)."""
    mesh = read_gmsh(tetrahedra, size=4.0) if cells == "tet" else read_gmsh(box.build, size=(4.0,) * 3, cells=(2, 2, 2))
    scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), degree=degree, accept_locking=True)
    for axis in "xyz":
        scene.fix(f"{axis}min", axis)
    tool = rigid_surface(plate, "face", height=4.0, flip=True)
    scene.contact("zmax", tool, name="c", penalty=1000.0, points=points)
    result = solve(scene, move={tool: (0, 0, -0.4)}, steps=2)
    assert result.converged
    pressure, _ = result.system.contact_terms[0].forces.split_traction(result.system.state)
    # the penalty takes 0.129/1000 mm of 0.4 mm; over 0.9 that is 3e-4 of the stress at most
    assert np.abs(pressure / 0.1288051 - 1.0).max(initial=0.0) < 4e-4


# ---- tangent


def pressed(points, friction, shift):
    """A System whose tool is pressed 0.5 mm into a roughened block, committed, then moved on by `shift` [mm]."""
    tool = ball(1.5)
    scene = block(tool, friction, cells=(5, 5, 2), points=points)
    system = scene.system(push={tool: (1.0, 1.0, -1.0)})
    state, contact = system.state, system.contact_terms[0]
    state.u.x.array[:] = 0.02 * np.random.default_rng(1).uniform(-1, 1, len(state.u.x.array))
    state.travel[0] = (0.0, 0.0, -0.5)
    contact.commit(state)
    state.travel[0] += shift
    return system, contact


@pytest.mark.serial
@pytest.mark.parametrize("points", ["nodes", "averages", 2])
@pytest.mark.parametrize(
    "friction, shift, status",
    [
        (0.0, (0.1, 0.05, -0.01), CLOSED),
        (0.05, (0.9, 0.2, -0.01), SLIP),
        (coulomb(lambda p: 0.03 + 0.03 / (1.0 + p), up_to=1e3), (0.9, 0.2, -0.01), SLIP),
        (coulomb(0.05, across=0.02, along=(1.0, 1.0, 0.2)), (0.9, 0.2, -0.01), SLIP),
        (9.0, (0.02, 0.01, -0.01), STICK),
    ],
    ids=["smooth", "slip", "slip, mu(p)", "slip, two directions", "stick"],
)
def test_tangent_and_border_are_the_derivative(points, friction, shift, status):
    system, contact = pressed(points, friction, shift)
    at_start = forces(contact, system.state)
    closed = contact.statuses() > 0
    assert closed.any() and (contact.statuses()[closed] == status).all()
    left = remainders(system, contact, 1e-5, kept=lambda: contact.parts.branches(system.state)[:, :2])
    # nodes on flat facets that neither turn nor slip give a linear residual: nothing is left but rounding
    assert orders(left).min() > 1.98 or left.max() < 1e-12 * np.linalg.norm(at_start)
    # the tool's force balances the body's
    assert np.abs(at_start[:-6].reshape(-1, 3).sum(axis=0) + at_start[-6:-3]).max() < 1e-11 * np.abs(at_start).max()


# ---- friction and drives


def plate(size=3.0, half=9.0, height=0.0):
    """A flat square in the plane z = height of irregular triangles that look up."""
    gmsh.model.occ.addRectangle(-half, -half, height, 2 * half, 2 * half)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(2)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [1]), "face")


def test_sliding_plate_obeys_coulomb():
    """A flat tool keeps its normal, so T = mu N holds for the sums too, once all points slide the way the tool goes."""
    tool = rigid_surface(plate, "face", flip=True)
    scene = block(tool, FRICTION, cells=(4, 4, 2), points="nodes")
    result = solve(scene, move={tool: down_and_along(0.3, 3.0)}, steps=8, method=Method(tolerance=1e-10))
    assert result.converged and result.history[-1]["c_sticking_points"] == 0
    x, _, z = (result.history[-1][name] for name in NAMES)
    assert abs(x / -z - FRICTION) < 1e-6


GROOVED = coulomb(FRICTION, across=0.5, along=(1.0, 2.0, 0.0))


@pytest.mark.serial
@pytest.mark.parametrize("points", ["averages", 2])
def test_a_grooved_plate_is_dragged_at_an_angle(points):
    """At every point of the sole, which deforms as it slides: |T_T| = p / sqrt((cos/mu_1)^2 + (sin/mu_2)^2)."""
    tool = rigid_surface(plate, "face", flip=True)
    scene = block(tool, GROOVED, cells=(4, 4, 2), points=points)
    result = solve(scene, move={tool: down_and_along(0.3, 3.0)}, steps=4, method=Method(tolerance=1e-10))
    assert result.converged and result.history[-1]["c_sticking_points"] == 0
    contact, state = result.system.contact_terms[0], result.system.state
    pressure, friction = contact.forces.split_traction(state)
    lean = 1.0 - contact.forces.normals(state)[..., 2] ** 2  # of the slave's normals, across which its nodes rub
    closed = pressure > 0.0
    pressure, size, part = pressure[closed], np.linalg.norm(friction[closed], axis=-1), friction[closed] @ GROOVED.along
    assert len(size) > 10
    wanted = pressure * size / np.sqrt((part / FRICTION) ** 2 + (size**2 - part**2) / 0.5**2)
    assert np.ptp(part / size) > 1e-3  # the ways differ
    np.testing.assert_allclose(size, wanted, rtol=1e-9 + lean.max())
    assert lean.max() < 1e-3


@pytest.mark.parallel
def test_a_meshed_floor_holds_a_body_alone():
    """A block that lies loose on a rough floor and is pushed down and aside: the flat mesh is as good as the plane."""
    found = []
    for floor in (rigid_plane((0, 0, -6.0)), rigid_surface(plate, "face", height=-6.0)):
        mesh = read_gmsh(box.build, size=(12.0, 12.0, 6.0), cells=(3, 3, 2), origin=(-6.0, -6.0, -6.0))
        scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)))
        scene.contact("zmin", floor, FRICTION, points=3, name="c")
        scene.traction("zmax", (0.005, 0.0, -0.05))
        result = solve(scene, steps=2, method=Method(tolerance=1e-10))
        assert result.converged, result.verdict.reason
        forces = [result.history[-1][name] for name in NAMES]
        np.testing.assert_allclose(forces, (-0.72, 0.0, 7.2), atol=1e-8)  # the load on 144 mm^2, in balance to 1e-10
        found.append([Displacement("zmax", axis, 0.0).distance(scene, result.system)() for axis in "xz"])
    # Gauss points on the plane itself: only the way from a point to it, along the body's normal or the floor's, differs,
    # by the square of the sole's slope: strains of 0.05 / 2.3 make it 5e-4
    np.testing.assert_allclose(*found, rtol=1e-3)


@pytest.mark.parametrize("points", [3, "averages"])
def test_pushed_is_moved(points):
    """Pushed with the forces of a moved tool, step by step, it makes the same travel. It starts 0.05 mm deep, so that a
    Gauss point touches it."""
    tool = ball(1.0, sink=0.05)
    moved = solve(
        block(tool, FRICTION, points=points), move={tool: down_and_along(0.8, 0.4)}, steps=4, method=Method(tolerance=1e-11)
    )
    assert moved.converged
    t, forces = moved.column("t"), np.column_stack([moved.column(name) for name in NAMES])
    drive = {
        tool: lambda time: np.array([np.interp(time, t, f) for f in forces.T])
    }  # the tool presses as the body is pressed
    pushed = solve(block(tool, FRICTION, points=points), push=drive, steps=4, method=Method(tolerance=1e-11))
    assert pushed.converged and pushed.verdict.cuts == 0
    for axis in "xyz":
        name = f"tool_travel_{axis}_mm"
        # forces of 8 N balanced to 1e-11 over a stiffness of 1 N/mm and more
        assert np.abs(pushed.column(name) - moved.column(name)).max() < 1e-8


# ---- ranks


def numbers():
    found = []
    for points in ("nodes", "averages", 2):
        tool = ball(1.5, sink=0.1)
        scene = block(tool, FRICTION, cells=(6, 6, 3), points=points)
        result = solve(scene, push={tool: (0.5, 0.0, -4.0)}, steps=2, method=Method(tolerance=1e-11))
        found += [row[name] for row in result.history for name in (*NAMES, "tool_travel_x_mm", "tool_travel_z_mm")]
        found.append(float(result.converged))
    return [float(value) for value in found]


@pytest.mark.slow
@pytest.mark.serial
def test_ranks_give_the_same_numbers():
    code = (
        "import sys, json; from mpi4py import MPI; sys.path[:0] = ['tests', '.'];"
        "import test_meshed_tools as t; v = t.numbers();"
        "MPI.COMM_WORLD.rank == 0 and print('NUMBERS', json.dumps(v))"
    )
    found = []
    for ranks in (1, 2):
        command = ["mpirun", "-n", str(ranks), sys.executable, "-c", code]
        path = os.pathsep.join([ROOT, os.environ.get("PYTHONPATH", "")])
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path})
        line = [text for text in run.stdout.splitlines() if text.startswith("NUMBERS")]
        assert line, run.stderr
        found.append(np.array(json.loads(line[0][8:])))
    assert found[0][-1] == 1.0
    assert np.abs(found[1] - found[0]).max() < 1e-8  # forces of 4 N balanced to 1e-11, over a stiffness of 4 N/mm


# ---- bad input


def refused(match, action):
    with pytest.raises(ValueError, match=match):
        action()


@pytest.mark.parallel
def test_bad_surfaces_are_refused():
    refused("no surface group 'bowl'.*ball", lambda: rigid_surface(tool_surfaces.ball, "bowl", mesh_size=3.0))
    refused("has no facets", lambda: rigid_surface(lambda: gmsh.model.occ.addPoint(0, 0, 0)))
    refused("cannot be made", lambda: rigid_surface("no_such_file.msh"))
    points = np.linspace(0.0, 1.0, 400).reshape(200, 2)
    refused(r"'array of shape \(200, 2\), from \[0.0, 0.0.*\] to \[.*1.0\]' .* rigid_extrusion", lambda: rigid_curve(points))
    refused("order 1", lambda: rigid_surface(quadratic))
    refused("different ways.*setOutwardOrientation", lambda: rigid_surface(mixed))
    refused("no area", lambda: rigid_surface(needle))


def quadratic():
    plate()
    gmsh.model.mesh.setOrder(2)


def _discrete(points, triangles):
    gmsh.model.addDiscreteEntity(2, 1)
    gmsh.model.mesh.addNodes(2, 1, range(1, len(points) + 1), np.ravel(points))
    gmsh.model.mesh.addElementsByType(1, 2, [], np.ravel(triangles))


def mixed():
    _discrete([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(1, 2, 3), (2, 3, 4)])


def needle():
    _discrete([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0)], [(1, 2, 3), (1, 2, 4)])


@pytest.mark.parallel
def test_normals_that_point_away_are_refused():
    with pytest.raises(SceneError, match="'c'.*point away.*flip"):
        block(ball(3.0, flip=True), cells=(3, 3, 1)).system()
    with pytest.raises(SceneError, match="'c'.*point away.*flip"):
        block(rigid_surface(plate, "face"), cells=(3, 3, 1)).system()


@pytest.mark.parallel
def test_deep_start_and_nodes_of_degree_two_are_refused():
    deep = ball(2.0, sink=2.5)
    with pytest.raises(SceneError, match="'c'.*starts 2.* inside"):
        block(deep, cells=(6, 6, 3)).system()
    with pytest.raises(SceneError, match="'c'.*degree=1"):
        block(ball(3.0), cells=(2, 2, 1), degree=2, points="nodes")


# ---- tools that turn far in a step
def cam():
    """A circle of 80 sides, of radius 2 about (0.4, -2)."""
    geo = gmsh.model.geo
    middle, quarters = geo.addPoint(0.4, -2.0, 0.0), np.arange(4) * np.pi / 2
    points = [geo.addPoint(0.4 + 2.0 * np.cos(a), -2.0 + 2.0 * np.sin(a), 0.0) for a in quarters]
    arcs = [geo.addCircleArc(points[i - 1], middle, points[i]) for i in range(4)]
    for arc in arcs:
        geo.mesh.setTransfiniteCurve(arc, 21)
    geo.synchronize()
    gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, arcs), "cam")
    gmsh.model.mesh.generate(1)


@pytest.mark.parallel
@pytest.mark.parametrize("steps", [1, 8])
def test_a_cam_turns_under_a_follower_that_is_pushed(steps):
    """By 30 degrees in one step, too: what a solve foresees of it is along tangents, and chords would lead it away."""
    mesh = read_gmsh(rectangles.build, rectangles={"follower": ((-2.5, 0.0), (5.0, 1.5), (20, 6))})
    scene = Scene(Body(mesh, "follower", neo_hooke(0.5, 4.0)), plane="strain")
    hub, tool = rigid_hub("hub", (0.0, 1.5, 0.0)), rigid_curve(cam, group="cam", name="cam")
    scene.tie("follower_ymax", hub)
    scene.contact("follower_ymin", tool, 0.0, name="c")
    about, pushed = (0.0, -2.0, 0.0), Motion(force=(0.0, -1.0, 0.0))
    stages = [Stage("down", steps=2, move={hub: Motion(y=-0.25), tool: Motion(about=about, rz=0.0)}),
              Stage("push", steps=2, move={hub: pushed}),
              Stage("turn", steps=steps, move={tool: Motion(about=about, rz=np.pi / 6), hub: pushed})]  # fmt: skip
    result = solve(scene, stages=stages).require()
    assert result.verdict.cuts == 0 and result.column("iterations", "turn").max() <= 6
    # about (0, -2) the circle's middle has risen by 0.4 sin 30 degrees; 80 sides and what lies beneath are the rest
    rise = result.column("hub_travel_y_mm")
    assert rise[-1] - rise[3] == pytest.approx(0.4 * np.sin(np.pi / 6), rel=5e-3)


@pytest.mark.parallel
def test_a_block_between_plates_that_turn_far_sticks():
    """More than a whole turn, 33 degrees a step, about a point off its middle: forces turn with it, else as they were."""

    def plate(y, way):
        def build():
            ends = [gmsh.model.geo.addPoint(x, y, 0.0) for x in (-3.0 * way, 3.0 * way)]
            line = gmsh.model.geo.addLine(*ends)
            gmsh.model.geo.synchronize()
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [line]), "plate")
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.35)
            gmsh.model.mesh.generate(1)

        return build

    mesh = read_gmsh(rectangles.build, rectangles={"block": ((-1.0, 0.0), (2.0, 1.0), (3, 2))})
    scene = Scene(Body(mesh, "block", neo_hooke(1.0, 5.0)), plane="strain")
    below = rigid_curve(plate(0.0, -1.0), group="plate", name="below")
    above = rigid_curve(plate(1.0, 1.0), group="plate", name="above")
    scene.contact("block_ymin", below, 2.0, name="c")
    scene.contact("block_ymax", above, 2.0, name="d")
    turned = lambda t: 7.0 * max(t - 0.1, 0.0) / 0.9  # noqa: E731
    down = lambda t: -0.1 * min(10.0 * t, 1.0)  # noqa: E731
    move = {below: Motion(about=(0.5, 0.5, 0.0), rz=turned)}
    move[above] = Motion(about=(0.5, 0.5, 0.0), rz=turned, x=lambda t: -down(t) * np.sin(turned(t)),
                         y=lambda t: down(t) * np.cos(turned(t)))  # fmt: skip
    result = solve(scene, move=move, steps=[0.1, *(0.1 + 0.9 * np.arange(1, 13) / 12)]).require()
    assert result.verdict.cuts == 0 and result.verdict.iterations <= 5 * 13
    x, y, angle = (result.column(name) for name in ("d_force_x_N", "d_force_y_N", "above_angle_z_rad"))
    assert angle[-1] > 2 * np.pi and (result.column("d_sticking_points") == 4).all()
    np.testing.assert_allclose(np.cos(angle) * y - np.sin(angle) * x, y[0], rtol=1e-5)
