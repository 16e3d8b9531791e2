"""Friction along two directions of a master that deforms: its ellipse turns and shears with the facets, tangent and all."""

import gmsh
import numpy as np
import pytest
from taylor import orders, remainders

from fenics_contact import (
    Body,
    Output,
    Penalty,
    Scene,
    Stage,
    coulomb,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.kernels.status import SLIP
from fenics_contact.meshes import box, two_blocks

ALONG, ACROSS = 0.3, 0.6  # coefficients of friction
PRESS = 5.0  # [MPa] on a block of 4 mm^2
LAW = 1e-6  # required of T = mu N
CHOICES = {"averages": (1, "averages"), "corners": (1, "corners"), "nodes": (1, "nodes"), "Gauss points": (1, 2),
           "degree 2, averages": (2, "averages"), "degree 2, Gauss points": (2, 3)}  # fmt: skip


@pytest.fixture(scope="module")
def aslant():
    return read_gmsh(tetrahedra)


@pytest.fixture(scope="module")
def mesh():
    """A block of 2 x 2 x 1 over the middle of a sheet of 9 x 9 x 1."""
    return read_gmsh(
        two_blocks.build, lower=(9, 9, 1), lower_cells=(5, 5, 1), lower_origin=(-4.5, -4.5, -1), upper=(2, 2, 1),
        upper_cells=(2, 2, 1), upper_origin=(-1, -1, 0),
    )  # fmt: skip


def tetrahedra(lower=9.0, upper=(-1.0, -1.0, 0.0), edge=2.0):
    """The same of tetrahedra, at other places if so asked."""
    sheet = (-0.5 * lower, -0.5 * lower, -1.0), (lower, lower, 1.0)
    for name, (low, size) in {"lower": sheet, "upper": (upper, (2.0, 2.0, 1.0))}.items():
        volume = gmsh.model.occ.addBox(*low, *size)
        gmsh.model.occ.synchronize()
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
        for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
            z = gmsh.model.occ.getCenterOfMass(2, face)[2]
            if abs(z - low[2] - 0.5 * size[2]) > 0.1:
                side = f"{name}_{'top' if z > low[2] + 0.1 else 'bottom'}"
                gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), side)
    gmsh.option.setNumber("Mesh.MeshSizeMin", edge)
    gmsh.option.setNumber("Mesh.MeshSizeMax", edge)
    gmsh.model.mesh.generate(3)


def led(motion):
    """Functions of (X, t) for `prescribe` of x, y, z: places motion(X, t) less X."""
    return [lambda X, t, axis=axis: (motion(X, t) - X)[:, axis] for axis in range(3)]


def drawn(mesh, friction, sheet, way, points, degree):
    """The block is pressed down on the sheet, all of whose nodes go to sheet(X, s), s = 0 ... 1 first, and then drawn by a
    way in x and y."""
    scene = Scene(
        Body(mesh, "lower", from_elastic(4000.0, 0.3)), Body(mesh, "upper", from_elastic(4000.0, 0.3)), degree=degree
    )  # so stiff that the underside hardly bends: T = mu N is off by the square of that
    for group in ("lower_bottom", "lower_top"):
        for axis, value in zip("xyz", led(lambda X, t: sheet(X, min(2.0 * t, 1.0))), strict=True):
            scene.prescribe(group, axis, value)
    for group in ("upper_bottom", "upper_top"):
        for axis, end in zip("xy", way, strict=True):
            scene.prescribe(group, axis, lambda X, t, end=end: np.full(len(X), max(2.0 * t - 1.0, 0.0) * end))
    scene.traction("upper_top", lambda t: (0.0, 0.0, -PRESS * min(10.0 * t, 1.0)))
    scene.contact("upper_bottom", "lower_top", friction, points=points, penalty=Penalty(1e5, 1e4), name="joint")
    return solve(scene, steps=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0]).require()


def turned_and_sheared(turn, shear):
    """x = R F X of a sheet, F = I + shear e_x e_y."""
    c, s = np.cos(turn), np.sin(turn)
    turning, F = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.eye(3)
    F[0, 1] = shear
    return turning @ F


@pytest.mark.parallel
@pytest.mark.parametrize("name", CHOICES)
@pytest.mark.parametrize(
    ("cells", "turn", "shear"), [("hex", 0.0, 0.0), ("hex", 2.1, 0.0), ("hex", 0.6, 0.4), ("tet", 0.6, 0.4)]
)
def test_directions_turn_and_shear_with_the_body(mesh, aslant, name, cells, turn, shear):
    """N / sqrt((cos/mu_1)^2 + (sin/mu_2)^2) against the way, from the direction R F a on."""
    degree, points = CHOICES[name]
    a, way = np.array([2.0, 1.0, 0.0]), np.array([0.4, 0.2, 0.0])

    def sheet(X, s):
        return X @ turned_and_sheared(s * turn, s * shear).T

    result = drawn(mesh if cells == "hex" else aslant, directed(a), sheet, way[:2], points, degree)
    there = turned_and_sheared(turn, shear) @ a
    between = np.arctan2(way[1], way[0]) - np.arctan2(there[1], there[0])
    last = np.array([result.history[-1][f"joint_force_{axis}_N"] for axis in "xyz"])
    size = last[2] / np.hypot(np.cos(between) / ALONG, np.sin(between) / ACROSS)
    assert last[2] == pytest.approx(4.0 * PRESS, rel=LAW)
    np.testing.assert_allclose(last[:2], -size * way[:2] / np.linalg.norm(way), atol=LAW * size)
    contact, state = result.system.contact_terms[0], result.system.state
    allowed = result.system.comm.allreduce(float((contact.forces.limits(state) * contact.surface.area).sum()))
    assert allowed == pytest.approx(size, rel=LAW)


# ---- soft bodies


def directed(along):
    return coulomb(ALONG, across=ACROSS, along=along)


def rubbed(mesh, way, along, points, law=directed):
    """A soft block is pressed into a soft sheet, 0.1 mm, and drawn along it."""
    scene = Scene(Body(mesh, "lower", neo_hooke(1.0, 5.0)), Body(mesh, "upper", neo_hooke(1.0, 5.0)))
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -0.1 * min(2.0 * t, 1.0)))
    for axis, end in zip("xy", way, strict=True):
        scene.prescribe("upper_top", axis, lambda X, t, end=end: np.full(len(X), max(2.0 * t - 1.0, 0.0) * end))
    scene.contact("upper_bottom", "lower_top", law(along), points=points, name="joint")
    return solve(scene, steps=10)


def joint(result):
    return np.column_stack([result.require().column(f"joint_force_{axis}_N") for axis in "xyz"])


@pytest.mark.parallel
@pytest.mark.parametrize("points", ["averages", "nodes", 2])
def test_forces_turn_with_way_and_direction(mesh, points):
    """By a quarter of a turn, under which the mesh is the same; less along the direction than across it."""
    found = joint(rubbed(mesh, (0.8, 0.2), (2.0, 1.0, 0.0), points))
    turned = joint(rubbed(mesh, (-0.2, 0.8), (-1.0, 2.0, 0.0), points))
    size = np.abs(found).max()
    np.testing.assert_allclose(turned @ [[0, -1, 0], [1, 0, 0], [0, 0, 1]], found, atol=2e-6 * size)
    across = joint(rubbed(mesh, (0.8, 0.2), (-1.0, 2.0, 0.0), points))
    ratio = np.linalg.norm(found[-1, :2]) / found[-1, 2], np.linalg.norm(across[-1, :2]) / across[-1, 2]
    assert 0.9 * ALONG < ratio[0] < 1.1 * ALONG and 0.8 * ACROSS < ratio[1] < 1.05 * ACROSS, ratio


@pytest.mark.parallel
def test_newton_keeps_its_order(mesh):
    """Once all slides, a step takes as many solves as with one coefficient."""
    found = [rubbed(mesh, (1.6, 0.4), (1.0, 1.0, 0.0), "averages", law) for law in (lambda along: ALONG, directed)]
    one, two = (result.require() for result in found)
    assert max(two.column("iterations")[-3:]) <= max(one.column("iterations")[-3:]) <= 4


# ---- tangent


def slipping(cells, degree, points, friction):
    """A System of two roughened blocks, one pressed into the other, committed, of which the upper one then slides on."""
    size = {"lower": (3, 3, 1), "lower_origin": (-1.5, -1.5, -1), "upper": (2, 2, 1), "upper_origin": (-1.1, -0.9, 0)}
    if cells == "tet":
        mesh = read_gmsh(tetrahedra, lower=3.0, upper=(-1.1, -0.9, 0.01), edge=1.0)
    else:
        mesh = read_gmsh(two_blocks.build, **size, lower_cells=(3, 3, 1), upper_cells=(2, 2, 1))
    scene = Scene(Body(mesh, "lower", neo_hooke(1.0, 5.0)), Body(mesh, "upper", neo_hooke(1.0, 5.0)), degree=degree)
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact("upper_bottom", "lower_top", friction, points=points, name="joint")
    system = scene.system()
    state, contact = system.state, system.contact_terms[0]
    u, upper = state.u.x.array.reshape(-1, 3), dict(system.bodies)["upper"]
    u[:] = 0.03 * np.random.default_rng(1).uniform(-1, 1, u.shape)
    u[upper] -= [0.0, 0.0, 0.1]
    contact.commit(state)
    u[upper] += [0.3, 0.1, -0.01]
    return system, contact


@pytest.mark.serial
@pytest.mark.parametrize("cells", ["hex", "tet"])
@pytest.mark.parametrize("name", CHOICES)
@pytest.mark.parametrize("along", [(1.0, 0.2, 0.1), (-0.3, 1.0, 0.0)])
def test_tangent_is_the_derivative(cells, name, along):
    degree, points = CHOICES[name]
    system, contact = slipping(cells, degree, points, coulomb(0.05, across=0.02, along=along))
    left = remainders(system, contact, 1e-5, kept=lambda: contact.parts.branches(system.state))
    closed = contact.statuses() > 0
    assert closed.any() and (contact.statuses()[closed] == SLIP).all()
    assert orders(left).min() > 1.98, left


@pytest.mark.parallel
@pytest.mark.parametrize("steps", [1, 4])
def test_work_is_friction_times_slip(steps):
    """A pad drawn aslant by 1 and 0.3, its face loaded alike all along: in the step in which sticking turns to sliding the
    direction of friction that stuck does not count (0.302 and 0.229 N mm in 1 and 4 steps)."""
    mesh = read_gmsh(box.build, size=(3.0, 3.0, 1.0), cells=(4, 4, 2), origin=(-1.5, -1.5, 0.0))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=1.0, K=2 / 3)))
    hub = rigid_hub("hub", point=(0.0, 0.0, 1.0))
    scene.tie("zmax", hub)
    scene.contact("zmin", rigid_plane(), friction=coulomb(0.1, across=0.5, along=(0.8, 0.6, 0.0)), name="c")
    stages = [Stage("press", move={hub: (0, 0, -0.1)}, steps=2), Stage("draw", move={hub: (1.0, 0.3, 0.0)}, steps=steps)]
    result = solve(scene, stages=stages, out=Output(progress=False)).require()
    friction = np.linalg.norm([result.column(f"c_friction_{axis}_N")[-1] for axis in "xyz"])
    way = result.column("c_mean_slip_mm")[-1]
    assert result.column("c_friction_work_Nmm")[-1] == pytest.approx(friction * way, rel=2e-3)
