"""Supports along any direction, of edges and of points: a scene turned in space, statics, closed forms, and refusals."""

import gmsh
import numpy as np
import pytest
from refusals import refused

from fenics_contact import (
    ArcSteps,
    Body,
    Load,
    Method,
    Scene,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    solve,
)
from fenics_contact.meshes import box, tubes
from fenics_contact.scene.build import build
from fenics_contact.scene.fingerprint import statement
from fenics_contact.scene.stage import Only

pytestmark = pytest.mark.parallel

ANGLE = 0.4
TURN = np.array([[np.cos(ANGLE), 0.0, np.sin(ANGLE)], [0.0, 1.0, 0.0], [-np.sin(ANGLE), 0.0, np.cos(ANGLE)]])
SIZE = (2.0, 2.0, 1.0)


def placed(Q, edges=False, **sizes):
    """A block turned by Q about the origin; edges: the one along z and the corner at the origin are groups."""
    box.build(**sizes)
    if edges:
        for dim, bounds in ((1, (0, 0, 0, 0, 0, SIZE[2])), (0, (0, 0, 0, 0, 0, 0))):
            near = gmsh.model.getEntitiesInBoundingBox(
                *(b - 1e-3 for b in bounds[:3]), *(b + 1e-3 for b in bounds[3:]), dim=dim
            )
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [near[0][1]]), ("corner", "edge")[dim])
    tags, X, _ = gmsh.model.mesh.getNodes()
    for tag, x in zip(tags, X.reshape(-1, 3) @ Q.T, strict=True):
        gmsh.model.mesh.setNode(tag, x, [])


def reactions(result, Q, *groups):
    """Of groups at the end (n, 3), in the block's own axes [N]."""
    return np.array([[result.column(f"{group}_reaction_{axis}_N")[-1] for axis in "xyz"] for group in groups]) @ Q


def pressed(Q, linear="auto", **options):
    """Forces of a rough block with three planes of symmetry that a cylinder presses and draws, turned by Q."""
    mesh = read_gmsh(placed, Q=Q, size=SIZE, cells=(3, 2, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), **options)
    for group in ("xmin", "ymin", "zmin"):
        scene.fix(group, normal=True)
    tool = rigid_cylinder(1.5, Q @ (0.8, 0.0, 2.5), Q @ (0.0, 1.0, 0.0))
    scene.contact("zmax", tool, 0.3, penetration=1e-4, name="roll")
    way = lambda t: Q @ (0.1 * max(2 * t - 1, 0.0), 0.0, -0.1 * min(2 * t, 1.0))  # noqa: E731
    result = solve(scene, move={tool: way}, steps=4, method=Method(linear=linear))
    assert result.converged, result.verdict.reason
    contact = np.column_stack([result.column(f"roll_force_{axis}_N") for axis in "xyz"]) @ Q
    energy = [result.column(name)[-1] for name in ("strain_energy_Nmm", "external_work_Nmm", "roll_friction_work_Nmm")]
    return np.concatenate([contact.ravel(), reactions(result, Q, "xmin", "ymin", "zmin").ravel(), energy])


@pytest.mark.parametrize(
    "options", [{}, {"degree": 2, "element": "mixed"}, {"linear": "iterative"}], ids=["degree 1", "mixed 2", "iterative"]
)
def test_a_scene_turned_in_space(options):
    """Planes of symmetry that lie askew: the same forces and energies, for nodes of one, two and three planes."""
    straight, skew = pressed(np.eye(3), **options), pressed(TURN, **options)
    # Newton's tolerance of 1e-8 of the largest force, an iterative solve's of as much
    np.testing.assert_allclose(skew, straight, rtol=0.0, atol=1e-7 * np.abs(straight).max())


def build_wedge():
    """Over a floor 2 long, its back 1 high, in tetrahedra."""
    gmsh.model.occ.addWedge(0, 0, 0, 2.0, 1.0, 1.0, ltx=0.0)
    gmsh.model.occ.synchronize()
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "wedge")
    groups = {"back": [], "floor": [], "side": [], "skew": []}
    for _, face in gmsh.model.getEntities(2):
        x, y, z = gmsh.model.occ.getCenterOfMass(2, face)
        groups["back" if x < 1e-6 else "floor" if y < 1e-6 else "side" if min(z, 1 - z) < 1e-6 else "skew"].append(face)
    for name, faces in groups.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
    gmsh.model.mesh.generate(3)


def wedge(degree=1):
    """A wedge between two frictionless planes and two walls."""
    scene = Scene(Body(read_gmsh(build_wedge), "wedge", neo_hooke(10.0, 30.0)), degree=degree, accept_locking=True)
    scene.fix("floor", "y")
    scene.fix("side", "z")
    scene.fix("skew", normal=True)
    return scene


@pytest.mark.parametrize("degree", [1, 2])
def test_a_wedge_that_is_pushed(degree):
    """Statics of a body on two frictionless planes: N sin(a) = F of the skew one, N cos(a) of the floor."""
    scene = wedge(degree=degree)
    scene.traction("back", (0.7, 0.0, 0.0))
    result = solve(scene, steps=2)
    assert result.converged, result.verdict.reason
    slope = np.arctan(0.5)
    skew, floor = reactions(result, np.eye(3), "skew", "floor")
    push = 0.7 / np.sin(slope)
    scale = 1e-7 * push  # Newton's tolerance
    np.testing.assert_allclose(skew, -push * np.array([np.sin(slope), np.cos(slope), 0.0]), atol=scale)
    np.testing.assert_allclose(floor, [0.0, push * np.cos(slope), 0.0], atol=scale)
    normal = np.array([np.sin(slope), np.cos(slope), 0.0])
    moved = result.system.state.u.x.array.reshape(-1, 3)[scene.mesh.nodes(scene.space, "skew")] @ normal
    assert np.abs(moved).max(initial=0.0) < 1e-14  # held exactly, not by a penalty
    assert result.column("balance_error_N")[-1] < scale


def test_work_of_a_skew_support_falls_with_the_square_of_the_step():
    errors = []
    for steps in (2, 4, 8):
        scene = wedge()
        scene.fix("back", "x")
        scene.supports = [one for one in scene.supports if one.group != ("skew",)]
        scene.prescribe("skew", value=-0.2, normal=True)
        result = solve(scene, steps=steps)
        assert result.converged, result.verdict.reason
        errors.append(abs(result.column("energy_error_Nmm")[-1]))
    assert np.log2(np.divide(errors[:-1], errors[1:])).min() > 1.9


def test_forces_where_supports_meet():
    """Statements that hold the same share a force, others give one along their own direction, and all add up."""
    mesh = read_gmsh(placed, Q=np.eye(3), size=SIZE, cells=(2, 2, 1))
    along, other, found = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.6, 0.8]), []
    for twice in (False, True):
        scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))
        scene.fix("zmax")
        scene.prescribe("zmin", direction=3 * along, value=0.1)
        scene.prescribe("xmin", direction=other, value=lambda X, t: 0.05 * t * (1.0 - X[:, 2]))
        if twice:
            scene.prescribe("zmin", direction=-along, value=-0.1)
            scene.prescribe(("zmin", "zmin"), direction=along, value=lambda X, t: 0.1 * t)
        result = solve(scene, steps=1)
        assert result.converged, result.verdict.reason
        u = result.system.state.u.x.array.reshape(-1, 3)
        nodes = mesh.nodes(scene.space, "zmin")
        assert np.abs(u[nodes] @ along - 0.1).max(initial=0.0) < 1e-14
        found.append(reactions(result, np.eye(3), "zmin", "xmin", "zmax"))
        assert np.abs(np.cross(found[-1][0], along)).max() < 1e-12
        assert np.linalg.norm(found[-1].sum(axis=0)) < 1e-7 * np.abs(found[-1]).max()
    np.testing.assert_allclose(found[0], found[1], atol=1e-7 * np.abs(found[0]).max())


def test_a_skew_plane_on_the_way_along_an_arc():
    """t of the steps and reactions, as of the scene that lies straight."""
    found = []
    for Q in (np.eye(3), TURN):
        scene = Scene(Body(read_gmsh(placed, Q=Q, size=SIZE, cells=(1, 1, 1)), "box", neo_hooke(1.0, 5.0)))
        for group in ("xmin", "ymin", "zmin"):
            scene.fix(group, normal=True)
        scene.prescribe("zmax", value=0.2, normal=True)
        scene.traction("xmax", Q @ (0.3, 0.0, 0.0))
        result = solve(scene, steps=ArcSteps(until=Load(1.0), first=0.2))
        assert result.converged, result.verdict.reason
        found.append(np.append(result.column("t"), reactions(result, Q, "xmin", "zmax")))
    np.testing.assert_allclose(found[1], found[0], atol=1e-7)


@pytest.mark.parametrize("degree", [1, 2])
def test_edges_and_points(degree):
    """A block pulled between a plane, an edge and a corner that take rigid motions alone: uniaxial, without reactions."""
    mesh = read_gmsh(placed, Q=TURN, edges=True, size=SIZE, cells=(2, 2, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), degree=degree)
    scene.fix("xmin", normal=True)
    scene.fix("edge", direction=(0, 5, 0))
    scene.fix("corner", direction=TURN[:, 2])
    scene.prescribe("xmax", value=0.4, normal=True)
    nodes = mesh.comm.allreduce(int((mesh.nodes(scene.space, "edge") < scene.space.dofmap.index_map.size_local).sum()))
    assert nodes == 2 * degree + 1
    result = solve(scene, steps=1)
    assert result.converged, result.verdict.reason
    pull, edge, corner = reactions(result, TURN, "xmax", "edge", "corner")
    scale = 1e-7 * np.abs(pull).max()
    assert np.abs([edge, corner]).max() < scale and np.abs(pull[1:]).max() < scale
    # the stretch across by which a stress-free side is so, of mu/2 (I1 - 3) + K/2 (J - 1)^2
    stretch, across = 1.2, 1.0
    for _ in range(50):
        J = stretch * across**2
        side = J ** (-5 / 3) * (across**2 - (stretch**2 + 2 * across**2) / 3) + 5.0 * (J - 1.0)
        step = 1e-7
        J_next = stretch * (across + step) ** 2
        ahead = J_next ** (-5 / 3) * ((across + step) ** 2 - (stretch**2 + 2 * (across + step) ** 2) / 3) + 5.0 * (
            J_next - 1.0
        )
        across -= side * step / (ahead - side)
    J = stretch * across**2
    stress = J ** (-5 / 3) * (stretch**2 - (stretch**2 + 2 * across**2) / 3) + 5.0 * (J - 1.0)
    assert abs(pull[0] - stress * across**2 * SIZE[1] * SIZE[2]) < 1e-6


@pytest.fixture(scope="module")
def block():
    return read_gmsh(placed, Q=np.eye(3), edges=True, size=SIZE, cells=(2, 2, 1))


def held(mesh):
    return Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)))


def test_bad_directions(block):
    refused(lambda: held(block).fix("zmin", direction=(0, 0, 0)), "fix 'zmin'", "direction (0, 0, 0)", "no length")
    refused(lambda: held(block).fix("zmin", direction=(0, 1)), "fix 'zmin'", "direction", "three finite numbers")
    refused(lambda: held(block).fix("zmin", direction="z"), "fix 'zmin'", "direction", "'z'")
    refused(lambda: held(block).fix("zmin", "x", normal=True), "fix 'zmin'", "three ways", "give one")
    refused(lambda: held(block).fix("zmin", direction=(1, 1, 0), normal=True), "fix 'zmin'", "three ways")
    refused(lambda: held(block).fix("zmin", normal="yes"), "fix 'zmin'", "normal = 'yes'", "True")
    refused(lambda: held(block).fix("edge", normal=True), "'edge' is no surface", "direction=")
    refused(lambda: held(block).fix("lid"), "'lid'", "edge", "corner", "zmax")
    refused(lambda: held(block).prescribe("zmin", direction=(1, 1, 0)), "'zmin'", "one finite number", "None")
    refused(lambda: held(block).prescribe("zmin", value=0.1), "prescribe 'zmin'", "one of x, y, z")
    tube = read_gmsh(tubes.build, tubes={"tube": (4.0, 6.0, 4, 1)}, depth=1.0)
    curved = Scene(Body(tube, "tube", from_elastic(1.0, 0.3)))
    refused(lambda: curved.fix("tube_outside", normal=True), "'tube_outside' is not flat", "direction=")


def test_directions_that_contradict_each_other(block):
    scene = held(block)
    scene.fix("zmin")
    scene.prescribe("xmin", direction=(1, 0, 1), value=0.1)
    refused(scene.system, "contradict", "zmin along", "xmin along (0.707107, 0, 0.707107)")
    scene = held(block)
    scene.prescribe("xmin", direction=(1, 0, 1), value=0.1)
    scene.prescribe("xmin", direction=(-1, 0, -1), value=0.1)
    refused(scene.system, "contradict", "xmin")


def test_a_body_that_skew_supports_leave_free_is_named(block):
    scene = held(block)
    scene.fix("zmin", direction=(1, 0, 1))
    scene.fix("ymin", "y")
    refused(scene.system, "nothing holds body 'box'", "along")
    scene.fix("xmin", direction=(1, 0, -3))
    scene.system()


def test_a_contact_of_nodes_that_are_led_is_refused(block):
    scene = held(block)
    for direction in ((1, 0, 1), (1, 0, -1), (0, 1, 0)):
        scene.fix("zmin", direction=direction)
    scene.contact("zmin", rigid_plane((0, 0, -0.1)), name="floor")
    refused(scene.system, "floor", "prescribed along the contact's normal")


def test_the_direction_is_part_of_the_statement(block):
    said = []
    for tilt in (1.0, 1.0 + 1e-7):
        scene = held(block)
        scene.fix("zmin")
        scene.fix("xmin", direction=(tilt, 0, 1))
        said.append(statement(scene, build(scene), [Only()], []))
    assert said[0] != said[1]
