"""A half or a quarter of rough bodies, held on planes of symmetry, has its part of what the whole has."""

import numpy as np
import pytest
from drawn import straight
from mpi4py import MPI
from taylor import orders, random_way, remainders

from fenics_contact import Body, Motion, Output, Penalty, Scene, Stage, neo_hooke, read_gmsh, rigid_curve, solve
from fenics_contact.contact.mirrors import kept
from fenics_contact.kernels.status import SLIP, STICK
from fenics_contact.meshes import rectangles, two_blocks

COMM = MPI.COMM_WORLD
BOW = 0.02  # of what is bent, over the square of how far it is from the middle [1/mm]
EXACT = {"rtol": 1e-6}  # forces are in balance to 1e-8 of the greatest, which press ten times as much as they rub


def measured(scene, parts, **options):
    """Force, strain energy and friction's work of the whole, of whose parts the scene is one, after each step."""
    result = solve(scene, steps=4, out=Output(progress=False), **options).require()
    load, energy, work = (result.column(f"{name}") for name in ("c_load_N", "strain_energy_Nmm", "c_friction_work_Nmm"))
    return parts * np.array([load, energy, work]), result


def plane_scene(whole, slave, degree=1, turn=0.0, **contact):
    """A bowed pad on a wider bed, all turned about z [rad]."""
    first, times = (-1.0, 2) if whole else (0.0, 1)
    drawn = {
        "pad": ((3.0 * first, 0.0), (3.0 * times, 2.0), (4 * times, 3)),
        "bed": ((4.0 * first, -2.0), (4.0 * times, 2.0), (3 * times, 3)),
    }
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    x = mesh.domain.geometry.x
    x[:, 1] += BOW * x[:, 0] ** 2
    (c, s) = np.cos(turn), np.sin(turn)
    x[:, :2] = x[:, :2] @ [[c, s], [-s, c]]
    across, along = (c, s, 0.0), (-s, c, 0.0)
    scene = Scene(
        Body(mesh, "pad", neo_hooke(0.5, 2.5)), Body(mesh, "bed", neo_hooke(1.0, 5.0)), plane="strain", degree=degree
    )
    scene.fix("bed_ymin")
    scene.fix("pad_ymax", direction=across)
    scene.prescribe("pad_ymax", direction=along, value=-0.4)
    for side, sign in () if whole else (("pad_xmin", 1.0), ("bed_xmin", -1.0)):
        scene.fix(side, direction=sign * np.array(across))
    sides = ("pad_ymin", "bed_ymax") if slave == "pad" else ("bed_ymax", "pad_ymin")
    scene.contact(*sides, 0.1, name="c", **contact)
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize("slave", ["pad", "bed"])
@pytest.mark.parametrize(
    "how",
    [{}, {"degree": 2}, {"turn": 0.5}, {"penalty": Penalty(factor=30.0), "penetration": 1e-5}],
    ids=["degree 1", "degree 2", "turned", "multipliers"],
)
def test_half_of_a_rough_pad_has_half_of_the_force(slave, how):
    """What slides along the plane's node to one side does so on the other: 1e-4 ... 2e-3 of the force were lost."""
    (half, _), (whole, _) = (measured(plane_scene(one, slave, **how), 1 if one else 2) for one in (False, True))
    np.testing.assert_allclose(half, whole, **EXACT)


ROUGH = ((4.0, 4.0, 2.0), (3, 3, 2)), ((3.0, 2.5, 1.5), (3, 2, 2))  # lower and upper: sizes of a quarter, and its cells


def blocks(whole, slave, drawn=ROUGH, laws=((1.0, 5.0), (0.5, 2.5)), bow=BOW, press=0.3, friction=0.1, degree=1, **contact):
    first, times = (-1.0, 2) if whole else (0.0, 1)
    shape = {}
    for name, (size, cells) in zip(("lower", "upper"), drawn, strict=True):
        shape[name], shape[f"{name}_cells"] = ((*(times * a for a in of[:2]), of[2]) for of in (size, cells))
        shape[f"{name}_origin"] = (first * size[0], first * size[1], -size[2] if name == "lower" else 0.0)
    mesh = read_gmsh(two_blocks.build, **shape)
    x = mesh.domain.geometry.x
    x[:, 2] += bow * (x[:, :2] ** 2).sum(axis=1)
    bodies = (Body(mesh, name, neo_hooke(*law)) for name, law in zip(("lower", "upper"), laws, strict=True))
    scene = Scene(*bodies, degree=degree)
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -press)
    for body in () if whole else ("lower", "upper"):
        scene.fix(f"{body}_xmin", "x")
        scene.fix(f"{body}_ymin", "y")
    sides = ("upper_bottom", "lower_top") if slave == "upper" else ("lower_top", "upper_bottom")
    scene.contact(*sides, friction, name="c", **contact)
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_a_quarter_of_rough_blocks_has_a_quarter_of_the_force(slave):
    """On the line where two planes meet nothing slides."""
    (quarter, result), (whole, _) = (measured(blocks(one, slave), 1 if one else 4) for one in (False, True))
    # the whole is off its own mirror image by 5e-5 of its ways: parts of bent facets are cut up from one of their corners on
    np.testing.assert_allclose(quarter, whole, rtol=1e-4)
    places = result.system.contact_terms[0].places
    rank = np.round(np.trace(places.feet(result.system.state).kept, axis1=1, axis2=2)).astype(int)
    on = np.abs(places.surface.X[:, 0, :2]) < 1e-9
    np.testing.assert_array_equal(rank, 3 - on.sum(axis=1))


@pytest.mark.parallel
@pytest.mark.parametrize("penalty", [None, 300.0])
def test_a_quarter_has_the_samples_of_the_whole(penalty):
    """Edges of both blocks lie on the planes of symmetry: seen along normals that lean, those of the whole cross by what is
    between them, and cut off slivers that the quarter has not."""
    drawn, alike = (((8.0, 8.0, 4.0), (3, 3, 1)), ((4.0, 4.0, 4.0), (2, 2, 1))), ((1.0, 10.0),) * 2
    flat = {"bow": 0.0, "press": 0.8, "friction": 0.0, "degree": 2, "penalty": penalty}
    forces = []
    for whole in (False, True):
        scene = blocks(whole, "lower", drawn, alike, **flat)
        result = solve(scene, steps=3, out=Output(progress=False)).require()
        forces.append(result.column("c_force_z_N")[-1] / (4 if whole else 1))
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)


@pytest.mark.parallel
@pytest.mark.parametrize("way, symmetric", [((0.0, -0.4), True), ((0.3, -0.4), False)])
def test_half_of_a_rough_pad_under_a_meshed_tool(way, symmetric):
    """A bar that goes down is its own image; what a bar that goes aside draws along slides over the plane."""
    found = []
    for whole in (False, True)[: 1 + symmetric]:
        first, times = (-1.0, 2) if whole else (0.0, 1)
        drawn = {"pad": ((4.0 * first, 0.0), (4.0 * times, 2.0), (5 * times, 3))}
        mesh = read_gmsh(rectangles.build, rectangles=drawn)
        mesh.domain.geometry.x[:, 1] -= BOW * mesh.domain.geometry.x[:, 0] ** 2
        scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 2.5)), plane="strain")
        scene.fix("pad_ymin")
        if not whole:
            scene.fix("pad_xmin", "x")
        bar = rigid_curve(lambda: straight("bar", (-6.0, 2.0), (6.0, 2.0), 16), group="bar", name="bar")
        scene.contact("pad_ymax", bar, 0.1, name="c", points="averages")
        values, result = measured(scene, 1 if whole else 2, move={bar: Motion(x=way[0], y=way[1])})
        found.append(values)
        system = result.system
        feet = system.contact_terms[0].places.feet(system.state)
        told = COMM.allreduce(int((np.trace(feet.kept, axis1=1, axis2=2) < 2.5).sum()))
        assert told == (symmetric and not whole)
    if symmetric:
        np.testing.assert_allclose(*found, **EXACT)


@pytest.mark.parallel
@pytest.mark.parametrize("how", ["still", "led", "free", "clamped"])
def test_a_guide_is_no_plane_of_symmetry(how):
    """Beside which a master is free, or that moves with the slave: on its nodes friction acts across it."""
    drawn = {"pad": ((0.0, 0.0), (3.0, 2.0), (4, 3)), "bed": ((0.0, -2.0), (4.0, 2.0), (3, 3))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 2.5)), Body(mesh, "bed", neo_hooke(1.0, 5.0)), plane="strain")
    scene.fix("bed_ymin", "x")
    scene.prescribe("bed_ymin", "y", 0.1)
    scene.fix("pad_ymax", "y")
    scene.fix("pad_xmin", "xy" if how == "clamped" else "x")
    if how != "free":
        scene.fix("bed_xmin", "x")
    scene.contact("pad_ymin", "bed_ymax", 0.3, name="c")
    shift = {("pad_xmin", "x"): 0.2} if how == "led" else {}
    system = solve(scene, stages=[Stage("on", prescribe=shift, steps=1)], out=Output(progress=False)).system
    feet = system.contact_terms[0].places.feet(system.state)
    held = COMM.allreduce(int((np.trace(feet.kept, axis1=1, axis2=2) < 2.5).sum()))
    assert held == (how == "still")


@pytest.mark.parallel
@pytest.mark.parametrize("friction", [0.0, 0.02])
def test_a_tool_that_goes_straight_across_a_guide_inclined_is_no_mirror_image(friction):
    """Between smooth walls a pad slides on a tilted line: the line pushes along its normal, and rubs by its friction."""
    turn = np.radians(12.0)
    c, s = np.cos(turn), np.sin(turn)
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (2.0, 2.0), (4, 4))})
    x = mesh.domain.geometry.x
    x[:, 1] += s / c * x[:, 0] * (1.0 - x[:, 1] / 2.0)
    scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 2.5)), plane="strain")
    scene.fix("pad_xmin", "x")
    scene.fix("pad_xmax", "x")
    scene.fix("pad_ymax")
    bar = rigid_curve(lambda: straight("bar", (5 * c, 5 * s), (-5 * c, -5 * s), 7), group="bar", name="bar")
    scene.contact("pad_ymin", bar, friction, points="averages", name="c")
    result = solve(scene, move={bar: (0.0, 0.4, 0.0)}, steps=4).require()
    fx, fy = (result.column(f"c_force_{axis}_N")[-1] for axis in "xy")
    assert abs((c * fx + s * fy) / (c * fy - s * fx) - friction) < 2e-3  # was 0.05


@pytest.mark.parallel
@pytest.mark.parametrize(("cells", "end"), [(6, 6.0), (13, 7.3), (16, 6.0)])
def test_a_tool_at_rest_has_not_gone_across(cells, end):
    """A flat one, drawn far over the plane: by rounding alone nodes on it are elsewhere."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (2.0, 2.0), (4, 4))})
    scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 2.5)), plane="strain")
    scene.fix("pad_xmin", "x")
    scene.prescribe("pad_ymax", "y", -0.2)
    bar = rigid_curve(lambda: straight("bar", (end, 0.0), (-1.1, 0.0), cells), group="bar", name="bar")
    scene.contact("pad_ymin", bar, name="c")
    assert not any("gone" in note for note in solve(scene, steps=2).require().verdict.notes)


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slave", ["pad", "bed"])
def test_nothing_slides_on_the_axis_of_bodies_of_revolution(degree, slave):
    drawn = {"pad": ((0.0, 0.0), (3.0, 2.0), (4, 3)), "bed": ((0.0, -2.0), (4.0, 2.0), (3, 3))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    mesh.domain.geometry.x[:, 1] += BOW * mesh.domain.geometry.x[:, 0] ** 2
    bodies = Body(mesh, "pad", neo_hooke(0.5, 2.5)), Body(mesh, "bed", neo_hooke(1.0, 5.0))
    scene = Scene(*bodies, plane="axisymmetric", degree=degree)
    scene.fix("bed_ymin")
    scene.prescribe("pad_ymax", "y", -0.3)
    sides = ("pad_ymin", "bed_ymax") if slave == "pad" else ("bed_ymax", "pad_ymin")
    scene.contact(*sides, 0.1, name="c")
    result = solve(scene, steps=2, out=Output(progress=False)).require()
    contact, state = result.system.contact_terms[0], result.system.state
    friction = contact.response(state).split[1][:, 0]
    on_axis = contact.places.surface.X[:, 0, 0] < 1e-9
    assert COMM.allreduce(int(on_axis.sum())) == 1
    sizes = [max(COMM.allgather(np.linalg.norm(friction[of], axis=1).max(initial=0.0))) for of in (on_axis, ~on_axis)]
    assert sizes[0] < 1e-12 < sizes[1], sizes


@pytest.mark.serial
@pytest.mark.parametrize(
    "friction, shift, status", [(0.02, (0.5, 0.2, -0.02), SLIP), (9.0, (0.03, 0.01, -0.02), STICK)], ids=["slip", "stick"]
)
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_tangent_on_planes_of_symmetry(slave, friction, shift, status):
    """Of nodes on one plane and on two."""
    scene = blocks(False, slave)
    scene.contacts.clear()
    sides = ("upper_bottom", "lower_top") if slave == "upper" else ("lower_top", "upper_bottom")
    scene.contact(*sides, friction, name="c")
    system = scene.system()
    state, contact = system.state, system.contact_terms[0]
    X = scene.space.tabulate_dof_coordinates()
    upper = np.setdiff1d(np.arange(len(X)), scene.mesh.nodes(scene.space, "lower_top"))
    upper = upper[X[upper, 2] >= BOW * (X[upper, :2] ** 2).sum(axis=1) - 1e-9]
    u, held = 0.03 * np.random.default_rng(1).uniform(-1, 1, X.shape), np.abs(X[:, :2]) < 1e-9
    u[:, :2][held] = 0.0
    u[upper, 2] -= 0.3
    state.u.x.array[:] = u.ravel()
    contact.commit(state)
    u[upper] += shift
    u[:, :2][held] = 0.0
    state.u.x.array[:] = u.ravel()
    rank = np.trace(contact.places.feet(state).kept, axis1=1, axis2=2)
    statuses = contact.response(state).status.ravel()
    assert {round(of) for of in rank[statuses == status]} >= {2, 3}
    way = random_way(system).reshape(-1, 3)
    way[:, :2][held] = 0.0
    assert orders(remainders(system, contact, 2e-5, way.ravel())).min() > 1.98


@pytest.mark.serial
def test_what_a_plane_keeps():
    """Of vectors on planes at 60 degrees, that along the line where they meet; a crease keeps all."""
    way = np.array([[1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])
    up, steep = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    mirrors = [(way[0], np.array([True, True, True, False])), (way[1], np.array([False, False, True, False]))]
    found = kept(np.array([up, steep, up, up]), mirrors)
    expected = [np.diag([0.0, 1.0, 1.0]), np.eye(3), np.diag([0.0, 0.0, 1.0]), np.eye(3)]
    np.testing.assert_allclose(found, expected, atol=1e-15)
