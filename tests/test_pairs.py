"""Periodic and cyclic pairs of faces: cells against closed forms, sectors against whole rods and rings, refusals."""

from dataclasses import replace

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from refusals import refused

from fenics_contact import (
    ArcSteps,
    Body,
    Load,
    Method,
    Motion,
    Output,
    Penalty,
    Scene,
    Stage,
    neo_hooke,
    read_gmsh,
    rigid_curve,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.meshes import box, rectangles, ring_sector

pytestmark = pytest.mark.parallel

SHEAR, BULK = 1.0, 5.0
GRADIENT = np.array([[0.15, -0.1, 0.4], [0.0, -0.1, 0.0], [0.1, 0.0, 0.0]])  # of the displacement of the cell
SIZE = np.array([2.0, 1.0, 1.0])


def with_point(at, place=None, **sizes):
    """A block with a group of its corner `at`, its nodes then put where place(X) says."""
    box.build(**sizes)
    near = gmsh.model.getEntitiesInBoundingBox(*(np.subtract(at, 1e-3)), *(np.add(at, 1e-3)), dim=0)
    gmsh.model.setPhysicalName(0, gmsh.model.addPhysicalGroup(0, [near[0][1]]), "corner")
    if place is not None:
        tags, X, _ = gmsh.model.mesh.getNodes()
        for tag, x in zip(tags, place(X.reshape(-1, 3)), strict=True):
            gmsh.model.mesh.setNode(tag, x, [])


def cell(at=(0.0, 0.0, 0.0), relative=GRADIENT, cells=(3, 2, 2), **options):
    """A block all of whose faces are paired, held at a corner."""
    mesh = read_gmsh(with_point, at=at, size=tuple(SIZE), cells=cells)
    scene = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK)), **options)
    for axis, letter in enumerate("xyz"):
        scene.periodic(f"{letter}min", f"{letter}max", SIZE[axis] * relative[:, axis])
    scene.fix("corner")
    return scene


def piola(gradient):
    """First Piola-Kirchhoff stress (3, 3) of mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2 [MPa]."""
    F = np.eye(3) + gradient
    J, back = np.linalg.det(F), np.linalg.inv(F).T
    return SHEAR * J ** (-2 / 3) * (F - np.sum(F * F) / 3.0 * back) + BULK * (J - 1.0) * J * back


def pair_forces(result):
    """Force on the second face of each pair (3, 3), by columns [N]."""
    return np.array([[result.column(f"{a}min_{a}max_pair_force_{i}_N")[-1] for a in "xyz"] for i in "xyz"])


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), tuple(SIZE)], ids=["leading corner", "following corner"])
@pytest.mark.parametrize(
    "options", [{}, {"degree": 2, "element": "mixed"}, {"linear": "iterative"}], ids=["degree 1", "mixed 2", "iterative"]
)
def test_a_cell_is_strained_evenly(at, options):
    """u = H X of a cell all of whose faces are paired, and P A on its faces, wherever it is held."""
    options = dict(options)
    linear = options.pop("linear", "direct")
    scene = cell(at, **options)
    result = solve(scene, steps=2, method=Method(linear=linear))
    assert result.converged, result.verdict.reason
    X, u = scene.space.tabulate_dof_coordinates(), result.system.state.u.x.array.reshape(-1, 3)
    # round-off, or where the solver is iterative Newton's tolerance
    allowed = 1e-7 if linear == "iterative" else 1e-12
    np.testing.assert_allclose(u, (X - at) @ GRADIENT.T, atol=allowed)
    np.testing.assert_allclose(pair_forces(result), piola(GRADIENT) * np.prod(SIZE) / SIZE, atol=10 * allowed)
    assert result.column("balance_error_N")[-1] < allowed


def test_the_work_of_the_ways_is_the_energy():
    """The trapezoidal rule's error falls with the third power of the step, times their number."""
    errors = []
    for steps in (2, 4):
        result = solve(cell(), steps=steps)
        errors.append(abs(result.column("energy_error_Nmm")[-1]))
    assert errors[0] < 1e-2 * result.column("strain_energy_Nmm")[-1]
    assert np.log2(errors[0] / errors[1]) > 1.9


def quarter(whole, load, degree=1, method="newton"):
    """A rod 2 x 2 x 1, or the quarter of it at x, y > 0, under a rough plate, which load(scene, plate) drives."""
    low, cells = (-1.0, 4) if whole else (0.0, 2)
    size = (1.0 - low, 1.0 - low, 1.0)
    mesh = read_gmsh(box.build, size=size, cells=(cells, cells, 2), origin=(low, low, 0.0))
    scene = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK)), degree=degree, accept_locking=True)
    scene.fix("zmin")
    plate = rigid_plane((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), name="plate")
    scene.contact("zmax", plate, 0.2, name="top")
    if not whole:
        scene.cyclic("ymin", "xmin")
    result = solve(scene, steps=3, method=method, **load(plate))
    assert result.converged, result.verdict.reason
    return scene, result


def twisted(plate):
    return {"move": {plate: Motion(z=-0.1, rz=0.3)}}


@pytest.mark.parametrize("degree", [1, 2])
def test_a_quarter_of_a_twisted_rod(degree):
    """A square rod that a rough plate presses and twists, sticking in the middle and slipping outside: its section has no
    plane of symmetry under torsion, and the axis is an edge of the quarter."""
    (whole, all_round), (part, sector) = (quarter(of, twisted, degree) for of in (True, False))
    assert sector.column("top_sticking_points")[-1] > 0
    assert sector.column("top_active_points")[-1] > sector.column("top_sticking_points")[-1]
    for column in ("top_force_z_N", "top_moment_z_Nmm", "strain_energy_Nmm", "top_friction_work_Nmm"):
        # Newton's tolerance
        np.testing.assert_allclose(4 * sector.column(column), all_round.column(column), rtol=1e-7)
    turned = part.space.tabulate_dof_coordinates(), sector.system.state.u.x.array.reshape(-1, 3)
    same_displacement(turned, (whole.space.tabulate_dof_coordinates(), all_round.system.state.u.x.array.reshape(-1, 3)))
    about = np.cross(*(point_and(sector, "zmin", of) for of in ("point", "force")))[2]
    torque = about + sector.column("zmin_reaction_moment_z_Nmm")[-1]
    np.testing.assert_allclose(torque, -sector.column("top_moment_z_Nmm")[-1], rtol=1e-6)


def point_and(result, group, what):
    column = {"point": "{}_reaction_point_{}_mm", "force": "{}_reaction_{}_N"}[what]
    return np.array([result.column(column.format(group, axis))[-1] for axis in "xyz"])


def same_displacement(part, whole, tolerance=1e-7):
    """Displacements of two runs agree at the places (X, u) of the first one's nodes."""
    places, values = (np.concatenate(parts) for parts in zip(*MPI.COMM_WORLD.allgather(whole), strict=True))
    X, u = part
    nearest = [int(((places - x) ** 2).sum(axis=1).argmin()) for x in X]
    assert np.abs(places[nearest] - X).max(initial=0.0) < 1e-9
    np.testing.assert_allclose(u, values[nearest], rtol=0.0, atol=tolerance * np.abs(values).max())


def bent(radii, angle):
    """Blocks (r, angle, z) of unit sizes into a sector of a tube."""

    def place(X):
        r, phi = radii[0] + X[:, 0] * (radii[1] - radii[0]), X[:, 1] * angle
        return np.column_stack([r * np.cos(phi), r * np.sin(phi), X[:, 2]])

    return place


def tube(sectors, of, through=3, around=3, cyclic=True, radii=(1.0, 2.0)):
    """Sectors of a tube of `of` ones, of unit depth; all of them share their nodes where they meet."""
    place = bent(radii, 2 * np.pi * sectors / of)

    def build_tube():
        with_point((0.0, 0.0, 0.0), place, cells=(through, sectors * around, 1))
        if sectors == of:
            gmsh.model.mesh.removeDuplicateNodes()

    scene = Scene(Body(read_gmsh(build_tube), "box", neo_hooke(SHEAR, BULK)))
    scene.fix(("zmin", "zmax"), "z")
    if sectors < of:
        scene.cyclic("ymin", "ymax")
    return scene


def test_a_sector_of_a_bush():
    """A bush that a torque by tractions and a pressure of six waves load, none of which a plane of symmetry would allow: a
    sixth of it moves as the whole ring does, at the tenth of a cell's size and more."""
    scenes = tube(6, 6), tube(1, 6)
    results = []
    for scene in scenes:
        scene.fix("xmax", "xy")
        waves = lambda X, t: t * (0.3 + 0.2 * np.sin(6 * np.arctan2(X[:, 1], X[:, 0])))  # noqa: E731
        scene.pressure("xmin", waves)
        scene.traction("xmin", lambda X, t: 0.2 * t * np.column_stack([-X[:, 1], X[:, 0], 0.0 * X[:, 2]]))
        results.append(solve(scene, steps=2).require())
    ring, sector = results
    nodes = [(s.space.tabulate_dof_coordinates(), r.system.state.u.x.array.reshape(-1, 3))
             for s, r in zip(scenes, results, strict=True)]  # fmt: skip
    same_displacement(nodes[1], nodes[0])
    np.testing.assert_allclose(6 * sector.column("strain_energy_Nmm"), ring.column("strain_energy_Nmm"), rtol=1e-7)


def test_the_torque_of_a_bush():
    """tau = T/(2 pi r^2 L) and tau = mu r dphi/dr give T = 4 pi mu L phi/(1/a^2 - 1/b^2) at small angles phi: of an eighth
    of the ring, with an error that falls with the square of the cell."""
    phi, errors = 1e-3, []
    exact = 4 * np.pi * SHEAR * phi / (1.0 - 1.0 / 4.0)
    for cells in (2, 4):
        scene = tube(1, 8, cells, cells)
        scene.fix("xmax", "xy")
        scene.prescribe("xmin", "x", lambda X, t: X[:, 0] * (np.cos(phi * t) - 1.0) - X[:, 1] * np.sin(phi * t))
        scene.prescribe("xmin", "y", lambda X, t: X[:, 1] * (np.cos(phi * t) - 1.0) + X[:, 0] * np.sin(phi * t))
        result = solve(scene, steps=1).require()
        torques = [
            result.column(f"{group}_reaction_moment_z_Nmm")[-1]
            + np.cross(point_and(result, group, "point"), point_and(result, group, "force"))[2]
            for group in ("xmin", "xmax")
        ]
        np.testing.assert_allclose(torques[0], -torques[1], rtol=1e-9)
        errors.append(abs(8 * torques[0] / exact - 1.0))
    assert errors[1] < 0.02
    assert np.log2(errors[0] / errors[1]) > 1.8


def tread(blocks):
    """A row of blocks on a base, by its ends the first of endlessly many, that a rough road carries along; the base is held
    below, the groove between two blocks is part of a cell."""
    mesh = read_gmsh(box.build, size=(2.0 * blocks, 1.0, 1.0), cells=(3 * blocks, 1, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK)))
    scene.fix("zmin")
    scene.fix("ymin", "y")
    scene.periodic("xmin", "xmax")
    road = rigid_plane((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), name="road")
    scene.contact("zmax", road, 0.5, penetration=1e-4, name="top")
    scene.body_force(
        lambda X, t: 0.2 * t * np.column_stack([np.sin(np.pi * X[:, 0]), 0.0 * X[:, 0], np.cos(np.pi * X[:, 0])])
    )
    way = lambda t: (0.3 * max(2 * t - 1, 0.0), 0.0, -0.1 * min(2 * t, 1.0))  # noqa: E731
    return scene, solve(scene, move={road: way}, steps=4).require()


def test_a_row_of_blocks_is_one_block():
    """Contact with multipliers up to the edges of the pair: three cells bear three times what one bears."""
    (long, row), (short, block) = tread(3), tread(1)
    for column in ("top_force_x_N", "top_force_z_N", "zmin_reaction_x_N", "strain_energy_Nmm", "top_friction_work_Nmm"):
        scale = np.abs(row.column(column)).max()
        np.testing.assert_allclose(3 * block.column(column), row.column(column), rtol=0.0, atol=1e-6 * scale)
    nodes = [(s.space.tabulate_dof_coordinates(), r.system.state.u.x.array.reshape(-1, 3))
             for s, r in ((short, block), (long, row))]  # fmt: skip
    same_displacement(*nodes, 1e-6)


def test_the_tangent_of_pairs():
    """Taylor remainders of every block, and Newton's order, with friction across a cyclic pair."""
    _, result = quarter(False, twisted)
    assert result.audit().right, result.audit()


def test_pairs_and_pushed_plates():
    """A plate that a force and a moment drive: border columns meet the pair; the quarter's are a quarter of the whole's."""

    def pushed(share):
        return lambda plate: {"stages": [
            Stage("press", move={plate: Motion(z=-0.1)}, steps=2),
            Stage("push", move={plate: Motion(force=(0, 0, share * -0.9), moment=(0, 0, share * 0.1))}, steps=2),
        ]}  # fmt: skip

    (_, all_round), (_, sector) = quarter(True, pushed(1.0)), quarter(False, pushed(0.25))
    for column in ("plate_travel_z_mm", "plate_angle_z_rad"):
        np.testing.assert_allclose(sector.column(column), all_round.column(column), rtol=1e-6)


def test_a_hub_turns_a_sector():
    """A hub tied to the bore up to the pair's faces, turned and drawn along the axis, then pushed by a force and a moment:
    a sixth of the bush and of the loads moves as the whole does and bears a sixth."""
    results = []
    for sectors in (6, 1):
        scene, hub = tube(sectors, 6), rigid_hub("hub", (0.0, 0.0, 0.0))
        scene.supports.clear()
        scene.fix("xmax")
        scene.tie("xmin", hub)
        share = sectors / 6
        loads = Motion(force=(0, 0, 0.3 * share), moment=(0, 0, 4.0 * share))
        stages = [Stage("turn", move={hub: Motion(rz=0.4, z=0.1)}, steps=2), Stage("push", move={hub: loads}, steps=2)]
        results.append(solve(scene, stages=stages).require())
    ring, sector = results
    for column in ("hub_force_z_N", "hub_moment_z_Nmm", "strain_energy_Nmm"):
        np.testing.assert_allclose(6 * sector.column(column), ring.column(column), rtol=1e-9)
    for column in ("hub_angle_z_rad", "hub_travel_z_mm"):
        np.testing.assert_allclose(sector.column(column), ring.column(column), rtol=1e-9)
    assert ring.column("hub_angle_z_rad")[-1] == pytest.approx(0.225, rel=1e-3)  # let back by the moment
    assert sector.audit().right, sector.audit()


def test_a_hub_on_the_axis_of_a_quarter():
    """Nodes on the axis belong to both faces: a plate that is tied to the top of a quarter of a rod turns it as a whole."""
    torques = []
    for whole in (True, False):
        size, cells = ((2.0, 2.0, 2.0), (4, 4, 2)) if whole else ((1.0, 1.0, 2.0), (2, 2, 2))
        mesh = read_gmsh(box.build, size=size, cells=cells, origin=(-1.0, -1.0, 0.0) if whole else (0.0, 0.0, 0.0))
        scene, plate = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK))), rigid_hub("plate", (0.0, 0.0, 2.0))
        scene.fix("zmin")
        scene.tie("zmax", plate)
        if not whole:
            scene.cyclic("ymin", "xmin")
        turned = solve(scene, move={plate: Motion(rz=0.5, free="z")}, steps=2).require()
        torques.append([turned.column(name)[-1] for name in ("plate_moment_z_Nmm", "strain_energy_Nmm")])
        travel = turned.column("plate_travel_z_mm")[-1]
        if not whole:
            leaning = {plate: Motion(rx=0.1)}
            refused(lambda: solve(scene, move=leaning), "'plate'", "tied", "leads")  # noqa: B023
    np.testing.assert_allclose(torques[0], 4 * np.array(torques[1]), rtol=1e-8)
    assert travel != 0.0


def test_a_plate_bonded_to_a_row_of_blocks():
    """Three cells under one plate bear three times what one does; where the plate holds all of the pair nothing is led."""
    forces = []
    for blocks in (3, 1):
        mesh = read_gmsh(box.build, size=(2.0 * blocks, 1.0, 1.0), cells=(3 * blocks, 1, 2))
        scene, plate = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK))), rigid_hub("plate", (0.0, 0.0, 1.0))
        scene.fix("zmin")
        scene.periodic("xmin", "xmax")
        scene.tie("zmax", plate)
        pressed = Motion(x=0.3, force=(0, 0, -0.2 * blocks))
        result = solve(scene, move={plate: pressed}, steps=2).require()
        forces.append([result.column(f"plate_force_{axis}_N")[-1] / blocks for axis in "xz"])
        height = result.column("plate_travel_z_mm")[-1]
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-8)
    assert forces[1][1] == pytest.approx(-0.2)
    assert height < -0.01
    block, hub = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK))), rigid_hub("hub")
    block.fix("zmin", "z")
    block.periodic("xmin", "xmax")
    block.tie(("xmin", "xmax"), hub)
    solve(block, move={hub: (0.1, 0.0, 0.0)}, steps=1).require()


def held_by(groups, at_end=False):
    """A cell, paired along x and moved along x and z at the end of `groups`, which carry a load for it."""
    mesh = read_gmsh(box.build, size=(2.0, 1.0, 1.0), cells=(3, 2, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK)))
    scene.periodic("xmin", "xmax", (0.2, 0.0, 0.1))
    scene.fix("ymin", "y")
    for group in groups:
        further = (0.2, 0.1) if group == "xmax" else (0.0, 0.0)
        scene.prescribe(group, "x", lambda X, t, way=further[0]: t * (way + 0.1 * X[:, 2]))
        scene.prescribe(group, "z", lambda X, t, way=further[1]: t * (way - 0.1 * X[:, 1]))
    scene.body_force((0.3, 0.0, 0.2))
    return solve(scene, steps=2).require()


def test_supports_of_following_nodes_are_those_of_leading_ones():
    """Held at the first face, at the second one, or at both: the same cell, and forces and moments in balance."""
    runs = {groups: held_by(groups) for groups in (("xmin",), ("xmax",), ("xmin", "xmax"))}
    lead = runs[("xmin",)]
    pull = np.array([2.2, 0.0, 0.1])  # from a leading node to the one that follows
    forces, moments, on_pair = [], [], []
    for groups, result in runs.items():
        np.testing.assert_allclose(result.system.state.u.x.array, lead.system.state.u.x.array, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(result.column("external_work_Nmm"), lead.column("external_work_Nmm"), rtol=1e-8)
        assert result.column("balance_error_N")[-1] < 1e-8
        forces.append(sum(point_and(result, group, "force") for group in groups))
        on_pair.append([result.column(f"xmin_xmax_pair_force_{axis}_N")[-1] for axis in "xyz"])
        moment = np.cross(pull, on_pair[-1])
        for group in groups:
            moment += [result.column(f"{group}_reaction_moment_{axis}_Nmm")[-1] for axis in "xyz"]
            moment += np.cross(point_and(result, group, "point"), point_and(result, group, "force"))
        moments.append(moment)
    np.testing.assert_allclose(forces, [forces[0]] * 3, atol=1e-8)
    np.testing.assert_allclose(moments, [moments[0]] * 3, atol=1e-8)
    # what led the second face is its supports' now, where it has any
    np.testing.assert_allclose(np.subtract(on_pair[0], on_pair[1])[[0, 2]], forces[1][[0, 2]], atol=1e-8)


def test_functions_see_all_nodes_of_their_group():
    """Those of an end that follows and those in between, at once: what they make of all places is one thing."""
    scene, seen = Scene(Body(read_gmsh(box.build, cells=(3, 2, 2)), "box", neo_hooke(SHEAR, BULK))), set()
    scene.periodic("xmin", "xmax")
    scene.fix("zmin")

    def lifted(X, t):
        seen.add(len(X))
        return 0.1 * t * (X[:, 1] - X[:, 1].mean())

    scene.prescribe("zmax", "z", lifted)
    solve(scene, steps=1).require()
    assert seen == {12}


def test_two_pieces_that_a_pair_joins():
    """A cell cut through by a gap: what a pair alone holds is held, and goes along without strain."""

    def build_pieces():
        for i, x in enumerate((0.0, 1.5)):
            tag = gmsh.model.occ.addBox(x, 0, 0, 1.0, 1.0, 1.0)
            gmsh.model.occ.synchronize()
            gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), f"piece {i}")
        for _, face in gmsh.model.getEntities(2):
            x = gmsh.model.occ.getCenterOfMass(2, face)[0]
            for end, at in (("left", 0.0), ("right", 2.5), ("inside", 1.0)):
                if abs(x - at) < 1e-6:
                    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), end)
        gmsh.model.mesh.setTransfiniteAutomatic()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
        gmsh.model.mesh.generate(3)

    mesh = read_gmsh(build_pieces)
    scene = Scene(*(Body(mesh, f"piece {i}", neo_hooke(SHEAR, BULK)) for i in range(2)), accept_locking=True)
    scene.fix("inside")
    scene.periodic("left", "right", (0.0, 0.2, 0.1))
    result = solve(scene, steps=1).require()
    X, u = scene.space.tabulate_dof_coordinates(), result.system.state.u.x.array.reshape(-1, 3)
    np.testing.assert_allclose(u, np.where(X[:, :1] > 1.2, (0.0, 0.2, 0.1), 0.0), atol=1e-12)


def test_a_plane_cell():
    """Plane strain: the same words, a cell paired along x between two plates that shear it."""
    sides = {"cell": ((0.0, 0.0), (2.0, 1.0), (3, 2))}
    scene = Scene(Body(read_gmsh(rectangles.build, rectangles=sides), "cell", neo_hooke(SHEAR, BULK)), plane="strain")
    scene.periodic("cell_xmin", "cell_xmax", (0.2, 0.0, 0.0))
    scene.fix("cell_ymin", "y")
    scene.prescribe("cell_ymax", "y", -0.1)
    for group, way in (("cell_ymin", 0.0), ("cell_ymax", 0.3)):
        scene.prescribe(group, "x", lambda X, t, way=way: t * (way + 0.1 * X[:, 0]))
    result = solve(scene, steps=2).require()
    gradient = np.array([[0.1, 0.3, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.0]])
    X, u = scene.space.tabulate_dof_coordinates(), result.system.state.u.x.array.reshape(-1, 3)
    np.testing.assert_allclose(u, X @ gradient.T, atol=1e-12)
    force = point_and_plane(result, "cell_ymax")
    np.testing.assert_allclose(force, 2.0 * piola(gradient)[:2, 1], atol=1e-10)


def point_and_plane(result, group):
    return [result.column(f"{group}_reaction_{axis}_N")[-1] for axis in "xy"]


def test_a_sector_in_a_plane():
    """A quarter of a ring in a stiff sleeve under a pressure of four waves, in the plane; without it, it is free to turn."""
    mesh = read_gmsh(ring_sector.build, cells=(3, 6))
    scene = Scene(Body(mesh, "ring", neo_hooke(SHEAR, BULK)), plane="strain")
    scene.cyclic("ymin", "xmin")
    refused(lambda: solve(scene), "nothing keeps body 'ring' from turning about the axis", "cyclic pair")
    scene.fix("outer")
    scene.pressure("inner", lambda X, t: t * (0.3 + 0.2 * np.sin(4 * np.arctan2(X[:, 1], X[:, 0]))))
    result = solve(scene, steps=2).require()
    X, x = scene.space.tabulate_dof_coordinates(), result.system.state.u.x.array.reshape(-1, 3)
    x = np.concatenate(MPI.COMM_WORLD.allgather(x + X)), np.concatenate(MPI.COMM_WORLD.allgather(X))
    for place in np.column_stack([np.linspace(1.0, 2.0, 4), np.zeros((4, 2))]):
        one, other = (x[0][((x[1] - p) ** 2).sum(axis=1).argmin()] for p in (place, place[[1, 0, 2]]))
        np.testing.assert_allclose(other, (-one[1], one[0], 0.0), atol=1e-12)
        assert abs(one[1]) > 1e-3 or place[0] == 2.0  # no plane of symmetry, but for the side that is held


# -- continuations, checkpoints, stages -------------------------------------------------------------------------------
def test_an_arc_leads_the_ways():
    """Along the arc as by load steps to the same t, and the limit that is asked for is met."""
    arc = solve(cell(), steps=ArcSteps(until=Load(1.0), first=0.1)).require()
    steps = solve(cell(), steps=list(arc.column("t"))).require()
    np.testing.assert_allclose(arc.system.state.u.x.array, steps.system.state.u.x.array, atol=1e-8)
    np.testing.assert_allclose(pair_forces(arc), piola(GRADIENT) * np.prod(SIZE) / SIZE, atol=1e-6)


def test_a_run_with_pairs_is_resumed(tmp_path):
    """From a checkpoint on; of another way of the pair it is refused, and another run's start knows how far it has gone."""
    folder = MPI.COMM_WORLD.bcast(tmp_path) / "run"

    def dying(view):
        if view.t > 0.6:
            raise RuntimeError("killed")
        return 0.0

    kept = Output(folder, checkpoint=True)
    refused(lambda: solve(cell(), steps=4, record={"kill": dying}, out=kept), "killed")
    on = {"steps": 4, "record": {"kill": lambda view: 0.0}, "out": replace(kept, resume=True)}
    refused(lambda: solve(cell(relative=1.1 * GRADIENT), **on), "relative displacement of the")
    whole = solve(cell(), steps=4)
    resumed = solve(cell(), **on).require()
    np.testing.assert_allclose(resumed.system.state.u.x.array, whole.system.state.u.x.array, atol=1e-12)
    still = cell(relative=0.0 * GRADIENT)
    started = solve(still, start=whole, steps=1).require()
    np.testing.assert_allclose(started.system.state.u.x.array, 0.0 * whole.system.state.u.x.array, atol=1e-12)
    same = solve(cell(), start=whole, steps=1).require()
    np.testing.assert_allclose(same.system.state.u.x.array, whole.system.state.u.x.array, atol=1e-12)


def test_ways_stay_in_later_stages():
    scene = cell()
    scene.body_force((0.0, 0.0, 0.0))
    stages = [Stage("strain", steps=2), Stage("wait", body_force=(0.1, 0.0, 0.0), steps=1)]
    result = solve(scene, stages=stages).require()
    u = result.system.state.u.x.array
    held = result.system.supports
    np.testing.assert_allclose(held.held(u), held.values(2.0), atol=1e-12)
    np.testing.assert_allclose(held.pairs.ways(2.0), (SIZE * GRADIENT).T, atol=1e-15)


def test_ways_of_later_stages():
    """A cell stretched in one stage and sheared in the next by a function of s is where it is when both are done at once."""
    stretch, shear = GRADIENT * np.eye(3), GRADIENT * (1.0 - np.eye(3))
    scene = cell(relative=stretch)
    faces = {(f"{letter}min", f"{letter}max"): SIZE[i] * shear[:, i] for i, letter in enumerate("xyz")}
    ways = {pair: (lambda s, way=way: s * s * way) for pair, way in faces.items()}
    stages = [Stage("stretch", steps=1), Stage("shear", relative=ways, steps=2)]
    stages.append(Stage("back", relative={pair: -way for pair, way in faces.items()}, steps=1))
    result = solve(scene, stages=stages[:2]).require()
    area = np.prod(SIZE) / SIZE
    np.testing.assert_allclose(pair_forces(result) / area, piola(GRADIENT), atol=1e-8)
    assert result.column("external_work_Nmm")[-1] == pytest.approx(result.column("strain_energy_Nmm")[-1], rel=0.02)
    back = solve(scene, stages=stages[2:], start=result).require()
    np.testing.assert_allclose(pair_forces(back) / area, piola(stretch), atol=1e-8)
    wrong = {"xmax": (0, 0, 0)}, {("xmin", "zmax"): (0, 0, 0.1)}, {("xmin", "xmax"): lambda s: (0.1 + s, 0, 0)}
    for relative, *words in zip(wrong, ("the faces of a pair", "no such periodic pair", "starts 0.1 away"), strict=True):
        run = lambda relative=relative: solve(scene, stages=[stages[0], Stage("b", relative=relative)])  # noqa: E731
        refused(run, "stage 'b'", *words)


@pytest.mark.parametrize("way", [0.05, 0.6])
def test_a_body_that_slides_out_of_its_cell_is_named(way):
    """Nothing comes in at the other end: the row of eight such cells keeps 0.65 N per cell, one loses a quarter of it."""
    mesh = read_gmsh(
        rectangles.build, rectangles={"low": ((0.0, 0.0), (1.0, 0.5), (4, 2)), "up": ((0.0, 0.5), (1.0, 0.5), (5, 2))}
    )
    scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 5.0)) for name in ("low", "up")), plane="strain")
    for name in ("low", "up"):
        scene.periodic(f"{name}_xmin", f"{name}_xmax")
    scene.fix("low_ymin")
    scene.prescribe("up_ymax", "y", lambda X, t: np.full(len(X), -0.1 * min(2.0 * t, 1.0)))
    scene.prescribe("up_ymax", "x", lambda X, t: np.full(len(X), way * max(2.0 * t - 1.0, 0.0)))
    scene.contact("up_ymin", "low_ymax", 0.3, name="c")
    result = solve(scene, steps=10).require()
    kept = result.column("c_force_y_N")[-1] / result.column("c_force_y_N")[4]
    notes = [note for note in result.verdict.notes if "contact 'c'" in note and "reaches past these faces" in note]
    assert (bool(notes), kept > 0.99) == ((False, True) if way < 0.1 else (True, False)), (notes, kept)


def rolled_strip(at, image=False, body=False):
    """A strip, 8 long, of a row of such, with a roller or a block pressed into it at x = `at`, and the roller's image one
    cell back."""
    drawn = {"s": ((0.0, 0.0), (8.0, 2.0), (32, 8))} | ({"b": ((at - 1.0, 2.05), (2.0, 1.0), (8, 4))} if body else {})
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 5.0)) for name in drawn), plane="strain")
    scene.periodic("s_xmin", "s_xmax")
    scene.fix("s_ymin")
    if body:
        scene.fix("b_ymax", "x")
        scene.prescribe("b_ymax", "y", -0.4)
        scene.contact("s_ymax", "b_ymin", name="c0")
        return solve(scene, steps=4).require()
    rollers = [rigid_cylinder(1.0, (x, 3.0, 0.0), (0, 0, 1), name=f"r{x:g}") for x in ([at, at - 8.0] if image else [at])]
    for i, roller in enumerate(rollers):
        scene.contact("s_ymax", roller, name=f"c{i}")
    return solve(scene, move={roller: (0.0, -0.4, 0.0) for roller in rollers}, steps=4).require()


def pressed(result):
    """Sum of the contacts' forces on the strip [N], and the notes on what reaches past its faces."""
    force = sum(result.column(name)[-1] for name in result.history[0] if name[:1] == "c" and name.endswith("_force_y_N"))
    return force, [note for note in result.verdict.notes if "neighbour" in note]


def test_what_reaches_past_faces_is_named():
    """Contact ends at the faces of a pair: a roller over them presses as one at the middle where its image is stated."""
    middle, silent = pressed(rolled_strip(4.0))
    both, silent_too = pressed(rolled_strip(8.0, image=True))
    assert both == pytest.approx(middle, rel=1e-8) and not silent + silent_too
    assert pressed(rolled_strip(7.3)) == (pytest.approx(pressed(rolled_strip(3.3))[0], rel=1e-8), [])
    half, notes = pressed(rolled_strip(8.0))
    assert abs(half) < 0.7 * abs(middle) and len(notes) == 1 and "second tool" in notes[0], notes
    force, notes = pressed(rolled_strip(9.5))
    assert force == 0.0 and "100% of the area" in notes[0], notes


@pytest.mark.parametrize("stretch", [0.0, 0.2])
@pytest.mark.parametrize("way", [(0.0, -0.4), (0.1, -0.4), (0.0, 0.0)])
@pytest.mark.parametrize("changed", [{}, {"friction": 0.1}, {"penalty": Penalty(factor=300)}, {"at": 3.0}, {"radius": 0.9}])
def test_images_that_do_not_go_alike_are_told(stretch, way, changed):
    """A roller over the end of a strip, and its image, or another one: images press as one roller in the middle does,
    where they move alike and have one law."""
    stated = {"friction": 0.3, "penalty": None, "at": 0.0, "radius": 1.0} | changed

    def rolled(rollers):
        mesh = read_gmsh(rectangles.build, rectangles={"s": ((0.0, 0.0), (8.0, 2.0), (32, 8))})
        scene, move = Scene(Body(mesh, "s", neo_hooke(1.0, 5.0)), plane="strain"), {}
        scene.periodic("s_xmin", "s_xmax", (stretch, 0.0, 0.0))
        scene.fix("s_ymin", "y")
        scene.fix("s_xmin", "x")
        for i, (at, radius, friction, penalty, along) in enumerate(rollers):
            roller = rigid_cylinder(radius, (at, 2.0 + radius, 0.0), (0, 0, 1), name=f"r{i}")
            scene.contact("s_ymax", roller, friction, penalty=penalty, name=f"c{i}")
            move[roller] = (*along, 0.0)
        result = solve(scene, move=move, steps=8).require()
        return sum(result.column(f"c{i}_force_y_N")[-1] for i in range(len(rollers))), result.verdict.notes

    second = stated["at"], stated["radius"], stated["friction"], stated["penalty"], way
    force, notes = rolled([(8.0, 1.0, 0.3, None, (stretch, -0.4)), second])
    image = "at" not in changed and "radius" not in changed
    moved = [note for note in notes if "'r0'" in note and "'r1'" in note and "otherwise than that" in note]
    unlike = [note for note in notes if "'c0' and 'c1'" in note and "alike" in note]
    assert bool(moved) == (image and way != (0.0, -0.4)), notes
    assert bool(unlike) == ("friction" in changed or "penalty" in changed), notes
    if image and not unlike:
        middle, _ = rolled([(4.0, 1.0, 0.3, None, (0.5 * stretch, -0.4))])
        assert (abs(force / middle - 1.0) < 1e-6) != bool(moved), (force, middle)


def test_a_block_past_faces_is_named():
    """The neighbour of a block that reaches past them lies in the strip."""
    middle, silent = pressed(rolled_strip(4.0, body=True))
    half, notes = pressed(rolled_strip(8.0, body=True))
    assert abs(half) < 0.7 * abs(middle) and not silent
    assert any("deep in 'b_ymin'" in note for note in notes) and any(
        "node of body 'b', (9, 2.05, 0)" in note for note in notes
    )


def bulged(paired, down=-0.7, planes=(), points=None):
    """A block of 3.6 pressed on a base of 4, whose ends are a pair, or held along x; sides that planes in them meet."""
    drawn = {"base": ((0.0, 0.0), (4.0, 1.0), (8, 2)), "top": ((0.2, 1.0), (3.6, 2.0), (8, 6))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 50.0)) for name in drawn), plane="strain")
    if paired:
        scene.periodic("base_xmin", "base_xmax")
    else:
        scene.fix("base_xmin", "x")
        scene.fix("base_xmax", "x")
    scene.fix("base_ymin", "y")
    scene.contact("top_ymin", "base_ymax", 1.0, name="c")
    for side in planes:
        x, inward = (0.0, 1.0) if side == "top_xmin" else (4.0, -1.0)
        scene.contact(side, rigid_plane((x, 0.0, 0.0), (inward, 0.0, 0.0), name=f"at{x:g}"), points=points, name=f"at{x:g}")
    scene.fix("top_ymax", "x")
    scene.prescribe("top_ymax", "y", down)
    return solve(scene, steps=5).require()


@pytest.mark.parametrize("points", [None, 3])
def test_a_plane_between_neighbours_has_no_note(points):
    """Blocks that bulge between planes, each of which stands for the next one: as if planes of symmetry ended the base."""
    forces = []
    for paired in (True, False):
        result = bulged(paired, planes=("top_xmin", "top_xmax"), points=points)
        assert not [note for note in result.verdict.notes if "neighbour" in note]
        assert result.column("at4_load_N")[-1] > 0.1
        forces.append(result.column("c_force_y_N")[-1])
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)


@pytest.mark.parametrize("down, meets", [(-0.1, False), (-0.7, True)])
def test_a_body_that_grows_into_its_neighbour_is_told(down, meets):
    """A block that bulges by a quarter as it is pressed."""
    notes = [note for note in bulged(True, down).verdict.notes if "neighbour" in note]
    assert bool(notes) == meets and (not meets or "inside another part of itself" in notes[0]), notes


def test_a_tool_past_the_sides_of_a_sector_is_named():
    """A quarter of a ring: a roller on its middle, one on its side, and the latter with its image a quarter on."""
    forces = []
    for angles in ([np.pi / 4], [0.0], [0.0, np.pi / 2]):
        mesh = read_gmsh(ring_sector.build, radii=(1.0, 2.0), cells=(4, 16))
        scene = Scene(Body(mesh, "ring", neo_hooke(1.0, 5.0)), plane="strain")
        scene.cyclic("ymin", "xmin", axis=(0, 0, 1))
        scene.fix("inner")
        move = {}
        for angle in angles:
            way = np.array([np.cos(angle), np.sin(angle), 0.0])
            roller = rigid_cylinder(0.5, 2.5 * way, (0, 0, 1), name=f"at{angle:.1f}")
            scene.contact("outer", roller, name=f"c{len(move)}")
            move[roller] = -0.2 * way
        result = solve(scene, move=move, steps=2).require()
        loads = [result.column(f"c{i}_load_N")[-1] for i in range(len(angles))]
        forces.append((sum(loads), ["neighbour" in note for note in result.verdict.notes].count(True)))
    (middle, silent), (half, told), (both, silent_too) = forces
    assert (
        both == pytest.approx(middle, rel=1e-6) and half < 0.8 * middle and (silent, told, silent_too) == (0, 1, 0)
    ), forces


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("meshed", [False, True])
def test_images_in_a_sector_are_turned(turned, meshed):
    """A roller on a side of a quarter of a ring, and its image: pressed towards the axis both, or one way both."""
    mesh = read_gmsh(ring_sector.build, radii=(1.0, 2.0), cells=(4, 16))
    scene = Scene(Body(mesh, "ring", neo_hooke(1.0, 5.0)), plane="strain")
    scene.cyclic("ymin", "xmin", axis=(0, 0, 1))
    scene.fix("inner")
    move = {}
    for i, angle in enumerate((0.0, np.pi / 2)):
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        roller = rigid_cylinder(0.5, 2.5 * way, (0, 0, 1), name=f"r{i}")
        if meshed:
            roller = rigid_curve(circle, centre=2.5 * way, angle=angle, name=f"r{i}")
        scene.contact("outer", roller, name=f"c{i}")
        move[roller] = -0.2 * (way if turned else np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0]))
    result = solve(scene, move=move, steps=4).require()
    loads = [result.column(f"c{i}_load_N")[-1] for i in range(2)]
    notes = [note for note in result.verdict.notes if "'r0'" in note and "'r1'" in note and "otherwise than that" in note]
    assert min(loads) > 0.0 and bool(notes) != turned, (loads, result.verdict.notes)


def circle(centre, angle, radius=0.5, cells=40):
    geo, angles = gmsh.model.geo, angle + np.arange(4) * np.pi / 2
    middle, at = geo.addPoint(*centre), [centre + radius * np.array([np.cos(a), np.sin(a), 0.0]) for a in angles]
    points = [geo.addPoint(*place) for place in at]
    for i, point in enumerate(points):
        geo.mesh.setTransfiniteCurve(geo.addCircleArc(point, middle, points[i - 3]), cells // 4 + 1)
    geo.synchronize()
    gmsh.model.mesh.generate(1)


# -- bad input --------------------------------------------------------------------------------------------------------
def test_wrong_pairs_are_refused():
    mesh = read_gmsh(box.build, size=(2.0, 1.0, 1.0), cells=(3, 2, 2))

    def scene():
        return Scene(Body(mesh, "box", neo_hooke(SHEAR, BULK)))

    def solved(*pairs, fix=("zmin",), before=lambda scene: None):
        stated = scene()
        for group in fix:
            stated.fix(group)
        for word, *rest in pairs:
            getattr(stated, word)(*rest)
        before(stated)
        return lambda: solve(stated)

    pair = ("periodic", "xmin", "xmax")
    refused(lambda: scene().periodic("xmin", "nowhere"), "nowhere")
    refused(lambda: scene().periodic("xmin", "xmin"), "both faces are 'xmin'")
    refused(lambda: scene().periodic("xmin", "xmax", (0.0, 1.0)), "relative", "three finite numbers")
    refused(lambda: scene().cyclic("xmin", "ymin", axis=(0, 0, 0)), "cyclic pair", "no length")
    refused(lambda: scene().cyclic("xmin", "ymin", point=(0, 0)), "point", "three finite numbers")
    ring = read_gmsh(rectangles.build, rectangles={"pad": ((1.0, 0.0), (1.0, 1.0), (2, 2))})
    turning = Scene(Body(ring, "pad", neo_hooke(SHEAR, BULK)), plane="axisymmetric")
    turning.periodic("pad_xmin", "pad_xmax")
    refused(lambda: solve(turning), "periodic pair", "lie apart along x")
    refused(solved(("periodic", "xmin", "ymin")), "9 nodes", "12", "mesh both alike")
    refused(solved(("periodic", "ymin", "zmin")), "do not match", "lies 0.", "setPeriodic")
    refused(solved(("cyclic", "ymin", "xmin")), "12 nodes", "9")
    refused(solved(("cyclic", "ymin", "zmin", (1, 0, 0), (0, 0.1, 0))), "do not match", "turned onto the second face")
    refused(solved(("cyclic", "xmin", "xmax", (1, 0, 0), (0, 0.1, 0.1))), "no angle between the faces")
    refused(solved(("cyclic", "xmin", "xmax", (1, 0, 0), (0, 0.5, 0.5))), "the middle of a face lies on the axis")
    refused(
        solved(pair, ("periodic", "xmax", "xmin", (0.1, 0.0, 0.0))),
        "periodic pair 'xmax' - 'xmin'",
        "two places",
        "let their ways agree",
    )
    refused(solved((*pair, (0.1, 0.0, 0.0))), "contradict each other", "zmin along x, of paired faces")
    refused(
        solved(pair, fix=(), before=lambda s: s.tie("xmin", rigid_hub("hub"))),
        "tie to 'hub'", "belongs in the periodic pair 'xmin' - 'xmax'", "nothing ties the latter", "both faces",
    )  # fmt: skip

    def two_hubs(stated):
        stated.tie("xmin", rigid_hub("one"))
        stated.tie("xmax", rigid_hub("two"))

    refused(solved(pair, fix=(), before=two_hubs), "tie to 'one'", "'two' leads the latter")
    for motion, *words in (
        (Motion(ry=0.1), "leads them otherwise than the pair does", "turn about the way from face to face alone"),
        (Motion(z=-0.1, free="ry"), "may lead them otherwise", "turn about the way"),
    ):
        bonded, hub = scene(), rigid_hub("hub", (1.0, 0.5, 1.0))
        bonded.fix("zmin")
        bonded.periodic("xmin", "xmax")
        bonded.tie("zmax", hub)
        run = lambda bonded=bonded, move={hub: motion}: solve(bonded, move=move)  # noqa: E731
        refused(run, "'hub'", "periodic pair 'xmin' - 'xmax'", *words)
    stretched, hub = scene(), rigid_hub("hub")
    stretched.fix("zmin", "z")
    stretched.periodic("xmin", "xmax", (0.1, 0.0, 0.0))
    stretched.tie("zmax", hub)
    refused(lambda: solve(stretched, move={hub: (0, 0, 0.1)}), "'hub'", "a rigid body does not stretch")
    loose = scene()
    loose.periodic("xmin", "xmax")
    refused(lambda: solve(loose), "nothing holds body 'box' along x, y, z")
    square = Scene(Body(read_gmsh(box.build, cells=(2, 2, 2)), "box", neo_hooke(SHEAR, BULK)))
    square.cyclic("ymin", "xmin")
    refused(lambda: solve(square), "nothing holds body 'box' along z")
    turned = Scene(Body(read_gmsh(box.build, cells=(2, 2, 2)), "box", neo_hooke(SHEAR, BULK)))
    turned.cyclic("ymin", "xmin")
    turned.fix("zmin")
    turned.moment("zmax", (0, 0, 1.0))
    refused(lambda: solve(turned), "moment on 'zmax'", "goes on behind them", "tie it to a hub")
    square.fix("zmin", "z")
    square.cyclic("xmin", "ymax", (0, 0, 1), (0.0, 1.0, 0.0))
    square.cyclic("ymax", "xmax", (0, 0, 1), (1.0, 1.0, 0.0))
    refused(lambda: solve(square), "round to itself, turned")
    sides = {"cell": ((0.0, 0.0), (2.0, 1.0), (3, 2))}
    flat = Body(read_gmsh(rectangles.build, rectangles=sides), "cell", neo_hooke(SHEAR, BULK))
    plane, turned = Scene(flat, plane="strain"), Scene(flat, plane="axisymmetric")
    refused(lambda: plane.periodic("cell_xmin", "cell_xmax", (0.0, 0.0, 1.0)), "a plane mesh cannot be led so")
    refused(lambda: plane.cyclic("cell_xmin", "cell_ymin", axis=(1, 0, 0)), "turned about z alone")
    refused(lambda: turned.cyclic("cell_xmin", "cell_ymin"), "in axisymmetric ones not at all")
