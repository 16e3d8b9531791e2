"""Fields and tools in files: what the Functions are, in one order on any number of ranks, and readable elsewhere."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import cKDTree
from test_elements import draw_tetrahedra
from vtu_files import read_pvd, read_vtu

from fenics_contact import (
    Body,
    Scene,
    Stage,
    Units,
    compat,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.assembly.pose import Pose
from fenics_contact.meshes import box, two_blocks
from fenics_contact.output.fields import Fields, surfaces_of
from fenics_contact.output.series import FieldFiles, file_names
from fenics_contact.output.vtu import GridFile

COMM = MPI.COMM_WORLD
KINDS = [("hexahedra", 1), ("hexahedra", 2), ("tetrahedra", 1), ("tetrahedra", 2)]
TYPES = {("hexahedra", 1): 12, ("hexahedra", 2): 29, ("tetrahedra", 1): 10, ("tetrahedra", 2): 24}  # VTK's codes
# as the manual of vtkTriQuadraticHexahedron draws it (faces x-, x+, y-, y+, z-, z+), and that of vtkQuadraticTetra
BETWEEN = {"hexahedra": "01 12 23 30 45 56 67 74 04 15 26 37 0473 1265 0154 3267 0123 4567 01234567",
           "tetrahedra": "01 12 20 03 13 23"}  # fmt: skip
ROUND = 1e-12


@pytest.fixture
def folder(tmp_path):
    return COMM.bcast(tmp_path)


def scene_of(kind, degree, comm=COMM, element="displacement", units=None):
    hexahedra = {"size": (3.0, 2.0, 1.0), "cells": (3, 2, 2)}
    mesh = read_gmsh(box.build, comm, **hexahedra) if kind == "hexahedra" else read_gmsh(draw_tetrahedra, comm)
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), degree=degree, element=element, units=units or Units())
    scene.fix("zmin")
    scene.contact("zmax", rigid_sphere(4.0, (1.0, 1.0, 5.0), name="ball"), name="c", points=3)
    scene.contact("xmax", rigid_plane((3.5, 0, 0), (-1, 0, 0), name="wall"), name="d", points=3)
    return scene


def bent(x):
    """A field of degree 2 in x (3, n)."""
    return np.array([x[0] * x[1], x[1] ** 2 - x[2], x[2] * x[0] + 0.5 * x[2] ** 2])


def straight(x):
    return 2.0 + x[0] - 3.0 * x[1] + 0.5 * x[2]


def torn(x):
    """NaN on one side."""
    return np.where(x[0] > 0.4, straight(x), np.nan)


def example(scene):
    """{name: Function} of every sort that there is."""
    mesh = scene.mesh.domain
    u = compat.Function(scene.space)
    vector, flat = compat.lagrange_space(mesh, 1, (3,)), compat.lagrange_space(mesh, 1)
    force, pressure, part = compat.Function(vector), compat.Function(flat), compat.Function(flat)
    stress, J = compat.Function(compat.constant_space(mesh, (3, 3))), compat.Function(compat.constant_space(mesh))
    u.interpolate(bent)
    force.interpolate(lambda x: np.array([straight(x), 0.0 * x[0], -straight(x)]))
    pressure.interpolate(straight)
    part.interpolate(torn)
    corners = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    middle = corners.mean(axis=1)
    J.x.array[:] = middle[:, 0]
    stress.x.array[:] = (middle[:, :, None] * middle[:, None, :]).ravel()
    return {"u": u, "force <a&b>": force, "pressure": pressure, "part": part, "stress": stress, "J": J}


def travelled(ways):
    """Poses of tools that have gone these ways (tools, 3) without turning."""
    return [Pose(np.zeros(3), np.array(way), np.eye(3), np.eye(3), 1.0) for way in ways]


def written(scene, folder, steps=(0,), last=0):
    folder.mkdir(exist_ok=True)
    files = FieldFiles(folder, scene, last)
    travel = np.array([[0.0, 0.0, -0.5], [0.25, 0.0, 0.0]])
    for step in steps:
        files.write(step, example(scene), travelled(step * travel), 0.5 * step, 0.1 * step)
    scene.mesh.comm.Barrier()
    return read_vtu(folder / "steps" / f"{steps[0]:06d}.vtu")


@pytest.mark.parallel
@pytest.mark.parametrize(("kind", "degree"), KINDS)
def test_a_file_holds_what_the_functions_are(folder, kind, degree):
    scene = scene_of(kind, degree)
    grid = written(scene, folder)
    X = grid["Points"]["Points"]
    assert len(X) == scene.space.dofmap.index_map.size_global
    assert cKDTree(X).query(scene.space.tabulate_dof_coordinates())[0].max() < ROUND
    at = grid["PointData"]
    assert list(at) == ["u", "force <a&b>", "pressure", "part"] and list(grid["CellData"]) == ["body", "stress", "J"]
    np.testing.assert_allclose(at["u"], bent(X.T).T, atol=ROUND)
    np.testing.assert_allclose(at["pressure"], straight(X.T), atol=ROUND)
    np.testing.assert_allclose(at["force <a&b>"], straight(X.T)[:, None] * [1.0, 0.0, -1.0], atol=ROUND)
    cells = grid["Cells"]["connectivity"].reshape(len(grid["Cells"]["types"]), -1)
    assert set(grid["Cells"]["types"]) == {TYPES[kind, degree]} and len(np.unique(cells)) == len(X)
    corners = X[cells[:, : 8 if kind == "hexahedra" else 4]]
    middle = corners.mean(axis=1)
    np.testing.assert_allclose(grid["CellData"]["J"], middle[:, 0], atol=ROUND)
    np.testing.assert_allclose(
        grid["CellData"]["stress"].reshape(-1, 3, 3), middle[:, :, None] * middle[:, None, :], atol=ROUND
    )
    assert set(grid["CellData"]["body"]) == {0} and grid["FieldData"]["body_box"].tolist() == [0]
    edges = corners[:, [1, 3, 4] if kind == "hexahedra" else [1, 2, 3]] - corners[:, :1]
    volume = np.linalg.det(edges).sum() / (1 if kind == "hexahedra" else 6)
    np.testing.assert_allclose(volume, np.ptp(X, axis=0).prod(), rtol=1e-9)  # corners in VTK's order
    # NaN at corners stays there, and goes to what lies between them and others
    np.testing.assert_allclose(at["part"][~np.isnan(at["part"])], straight(X.T)[~np.isnan(at["part"])], atol=ROUND)
    corner = np.isin(np.arange(len(X)), cells[:, : corners.shape[1]])
    np.testing.assert_array_equal(np.isnan(at["part"])[corner], ~(X[corner, 0] > 0.4))
    beyond = X[:, 0] > (1.0 if kind == "hexahedra" else 0.9) + ROUND
    assert np.isnan(at["part"][X[:, 0] < 0.4]).all() and not np.isnan(at["part"][beyond]).any()


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "degree"), KINDS)
def test_nodes_between_corners_lie_where_vtk_says(tmp_path, kind, degree):
    grid = written(scene_of(kind, degree), tmp_path)
    X, cells = grid["Points"]["Points"], grid["Cells"]["connectivity"].reshape(len(grid["Cells"]["types"]), -1)
    between = BETWEEN[kind].split() if degree == 2 else []
    for place, corners in enumerate(between, 8 if kind == "hexahedra" else 4):
        of_corners = X[cells[:, [int(corner) for corner in corners]]]
        np.testing.assert_allclose(X[cells[:, place]], of_corners.mean(axis=1), atol=ROUND)


@pytest.mark.parallel
@pytest.mark.parametrize(("kind", "degree"), KINDS)
def test_one_order_on_any_number_of_ranks(folder, kind, degree):
    together = written(scene_of(kind, degree), folder / "together")
    alone = written(scene_of(kind, degree, MPI.COMM_SELF), folder / f"alone_{COMM.rank}")
    for section, arrays in alone.items():
        assert list(arrays) == list(together[section])
        for name, values in arrays.items():
            # what another partition changes is round-off of places
            np.testing.assert_allclose(together[section][name], values, rtol=0, atol=ROUND if values.dtype == float else 0)
    for tool in ("ball", "wall"):
        one, other = (read_vtu(folder / f / "tools" / f"{tool}_000000.vtu") for f in ("together", f"alone_{COMM.rank}"))
        np.testing.assert_allclose(one["Points"]["Points"], other["Points"]["Points"], atol=ROUND)
        np.testing.assert_array_equal(one["Cells"]["connectivity"], other["Cells"]["connectivity"])


@pytest.mark.parallel
def test_bodies_by_number_and_name(folder):
    mesh = read_gmsh(two_blocks.build)
    scene = Scene(Body(mesh, "upper", neo_hooke(1.0, 5.0)), Body(mesh, "lower", neo_hooke(1.0, 5.0)))
    FieldFiles(folder, scene).write(0, {"u": compat.Function(scene.space)}, [], 0.0, 0.0)
    COMM.Barrier()
    grid = read_vtu(folder / "steps" / "000000.vtu")
    assert (grid["FieldData"]["body_upper"], grid["FieldData"]["body_lower"]) == (0, 1)
    cells = grid["Cells"]["connectivity"].reshape(-1, 8)
    nodes = [np.unique(cells[grid["CellData"]["body"] == number]) for number in (0, 1)]
    assert not set(nodes[0]) & set(nodes[1]), "nodes that lie on one another stay apart"
    height = [grid["Points"]["Points"][of_body, 2] for of_body in nodes]
    assert height[0].mean() > height[1].mean() and len(nodes[0]) + len(nodes[1]) == len(grid["Points"]["Points"])
    assert not (folder / "tools").exists(), "there are none"


@pytest.mark.parallel
def test_later_steps_are_dropped_and_the_tables_taken_up(folder):
    scene = scene_of("hexahedra", 1)
    written(scene, folder, range(4))
    written(scene, folder, (2,), last=1)
    for index, start in (("results.pvd", "steps/"), ("tools/ball.pvd", "tools/ball_"), ("tools/wall.pvd", "tools/wall_")):
        files = [folder / f"{start}{step:06d}.vtu" for step in range(3)]
        assert read_pvd(folder / index) == [(0.1 * step, file) for step, file in enumerate(files)]
        assert all(file.exists() for file in files) and not (folder / f"{start}000003.vtu").exists()
    COMM.Barrier()


@pytest.mark.parallel
def test_tools_are_where_they_have_travelled(folder):
    written(scene_of("hexahedra", 1), folder, range(3))
    for stamp, file in read_pvd(folder / "tools" / "ball.pvd"):
        grid = read_vtu(file)
        centre = np.array([1.0, 1.0, 5.0 - 5.0 * stamp])
        np.testing.assert_allclose(np.linalg.norm(grid["Points"]["Points"] - centre, axis=1), 4.0, rtol=1e-12)
        np.testing.assert_allclose(grid["FieldData"]["travel_mm"], [[0.0, 0.0, -5.0 * stamp]])
    for stamp, file in read_pvd(folder / "tools" / "wall.pvd"):
        points = read_vtu(file)["Points"]["Points"]
        np.testing.assert_allclose(points[:, 0], 3.5 + 2.5 * stamp, rtol=1e-12)
        assert np.all(points.min(axis=0)[1:] < 0.0) and np.all(points.max(axis=0)[1:] > (2.0, 1.0))


@pytest.mark.parallel
def test_what_is_drawn_of_an_endless_tool_stays_on_it(folder):
    """A body that slides along a wall at rest: the same part of the wall, until the body comes to its end."""
    scene = scene_of("hexahedra", 1)
    u = compat.Function(scene.space)
    folder.mkdir(exist_ok=True)
    files = FieldFiles(folder, scene)
    for step, way in enumerate((0.0, 0.5, 0.9, 12.0)):
        u.x.array.reshape(-1, 3)[:] = [0.0, way, -0.5 * way]
        poses = travelled([[0.0, 0.0, -0.5], [0.0, way if step == 2 else 0.0, 0.0]])
        files.write(step, {"u": u}, poses, 1.0, step)
    COMM.Barrier()
    wall = [read_vtu(folder / "tools" / f"wall_{step:06d}.vtu")["Points"]["Points"] for step in range(4)]
    np.testing.assert_allclose(wall[1], wall[0], atol=ROUND)
    np.testing.assert_allclose(wall[2], wall[0] + [0.0, 0.9, 0.0], atol=ROUND)  # it has travelled itself
    np.testing.assert_allclose(wall[3].mean(axis=0), wall[0].mean(axis=0), atol=ROUND)
    assert np.all(wall[3].min(axis=0)[1:] < (0.0, -6.0)) and np.all(wall[3].max(axis=0)[1:] > (14.0, 1.0))


@pytest.mark.parallel
@pytest.mark.parametrize(("kind", "degree", "element"), [("hexahedra", 1, "mixed"), ("hexahedra", 2, "displacement"),
                                                         ("hexahedra", 2, "mixed"), ("tetrahedra", 2, "mixed")])  # fmt: skip
def test_a_run_writes_its_fields(folder, kind, degree, element):
    scene = scene_of(kind, degree, element=element, units=Units("m", "kN", "kPa"))
    result = solve(scene, move={scene.tools[0]: (0, 0, -0.05)}, steps=1, out=folder / "run").require()
    COMM.Barrier()
    grid = read_vtu(read_pvd(folder / "run" / "results.pvd")[-1][1])
    fields = Fields(scene, result.system)
    fields.update()
    assert {f.name for f in fields.all} | {"body"} == {*grid["PointData"], *grid["CellData"]}
    assert {"displacement_m", "contact_pressure_kPa", "friction_traction_kPa", "gap_m"} < set(grid["PointData"])
    named = ET.parse(folder / "run" / "steps" / "000001.vtu").getroot().iterfind(".//*[@Name='cauchy_stress_kPa']")
    assert [[one.get(f"ComponentName{i}") for i in (0, 5, 8)] for one in named] == [["XX", "YZ", "ZZ"]]  # for ParaView
    assert {"cauchy_stress_kPa", "J"} < set(grid["CellData"]) and grid["CellData"]["cauchy_stress_kPa"].shape[1] == 9
    nodes = cKDTree(grid["Points"]["Points"]).query(scene.space.tabulate_dof_coordinates())[1]
    np.testing.assert_allclose(grid["PointData"]["displacement_m"][nodes].ravel(), result.u.x.array, atol=1e-14)
    assert (
        COMM.allreduce(abs(result.u.x.array).max(), MPI.MAX) > 0.01
        and COMM.allreduce(np.ptp(fields.J.x.array), MPI.MAX) > 0.0
    )
    for name, function in (("J", fields.J), ("cauchy_stress_kPa", fields.cauchy_stress)):
        owned = scene.mesh.domain.topology.index_map(3).size_local
        order = compat.original_cells(scene.mesh.domain)[:owned]
        here = function.x.array.reshape(-1, function.function_space.dofmap.index_map_bs)[:owned]
        np.testing.assert_allclose(grid["CellData"][name].reshape(-1, here.shape[1])[order], here, atol=1e-14)
    assert grid["FieldData"]["t"] == 1.0
    # contact fields: what the slave surface's nodes have, at all of its corners and between them
    ball = surfaces_of(scene, result.system)[0].at_state()
    pressure, status, gap = (grid["PointData"][f"c_{name}"] for name in ("contact_pressure_kPa", "contact_status", "gap_m"))
    corners = grid["Cells"]["connectivity"].reshape(len(grid["Cells"]["types"]), -1)[:, : 8 if kind == "hexahedra" else 4]
    corner = np.isin(nodes, corners)
    top = np.abs(grid["Points"]["Points"][:, 2] - 1.0) < ROUND
    assert not np.isnan(pressure[top]).any() and np.isnan(pressure[~top]).all() and np.nanmax(pressure) > 0.0
    for values, of_nodes in ((pressure, ball.pressure), (status, ball.status), (gap, ball.gap)):
        np.testing.assert_array_equal(values[nodes[ball.on]], of_nodes[ball.on])
    assert ball.on[corner & top[nodes]].all()


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("kind", "degree", "points"), [("hexahedra", 1, 3), ("hexahedra", 2, 3), ("hexahedra", 2, "nodes"), ("tetrahedra", 2, 3)]
)
def test_a_ball_that_is_dragged_slips_wherever_it_presses(folder, kind, degree, points):
    """Nodes have the status of the points that press around them, those between corners too, and the file the peak."""
    draw = {"size": (4.0, 4.0, 2.0), "cells": (5, 5, 2), "origin": (-2.0, -2.0, -1.0), "name": "box"}
    mesh = read_gmsh(box.build, COMM, **draw) if kind == "hexahedra" else read_gmsh(draw_tetrahedra, COMM, size=0.35)
    scene = Scene(Body(mesh, "box", neo_hooke(0.5, 2.0)), degree=degree)
    scene.fix("zmin")
    middle = (0.0, 0.0, 1.0) if kind == "hexahedra" else (0.5, 0.5, 1.0)
    radius = 2.0 if kind == "hexahedra" else 0.5
    ball = rigid_sphere(radius, (*middle[:2], middle[2] + radius), name="ball")
    scene.contact("zmax", ball, 0.2, name="c", points=points)
    stages = [
        Stage("down", move={ball: (0, 0, -0.15 * radius)}, steps=2),
        Stage("drag", move={ball: (0.25 * radius, 0, 0)}, steps=3),
    ]
    result = solve(scene, stages=stages, out=folder / "drag").require()
    last = result.history[-1]
    assert last["c_sticking_points"] == 0 < last["c_active_points"]
    COMM.Barrier()
    data = read_vtu(read_pvd(folder / "drag" / "results.pvd")[-1][1])["PointData"]
    status, pressure = data["contact_status"], data["contact_pressure_MPa"]
    on = ~np.isnan(status)
    assert set(status[on]) == {0.0, 3.0}
    assert (status[on & (pressure > 0.0)] == 3.0).all() and (pressure[on & (status == 0.0)] <= 0.0).all()
    assert np.nanmax(pressure) == pytest.approx(last["c_peak_pressure_MPa"], rel=1e-12)
    drawn = result.drawing("status")
    if drawn is not None:
        assert set(np.unique(drawn.body.values[np.isfinite(drawn.body.values)])) == {0.0, 3.0}
        values = result.drawing().body.values if COMM.size == 1 else None
        assert values is None or np.nanmax(values) == pytest.approx(last["c_peak_pressure_MPa"], rel=1e-12)


@pytest.mark.parallel
def test_a_hub_is_a_point_that_is_drawn(folder):
    """One cell, for a grid without cells is nothing on a screen."""
    mesh = read_gmsh(box.build, size=(1.0, 1.0, 1.0), cells=(1, 1, 1))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix("zmin")
    hub = rigid_hub("hub", (0.5, 0.5, 1.0))
    scene.tie("zmax", hub)
    solve(scene, move={hub: (0.1, 0, 0)}, steps=1, out=folder / "hub").require()
    COMM.Barrier()
    grid = read_vtu(read_pvd(folder / "hub" / "tools" / "hub.pvd")[-1][1])
    np.testing.assert_allclose(grid["Points"]["Points"], [[0.6, 0.5, 1.0]])
    assert grid["Cells"]["types"].tolist() == [1] and grid["Cells"]["connectivity"].tolist() == [0]


@pytest.mark.serial
def test_names_of_files():
    assert file_names(["ball", "Ball", "my tool/1", "../up", "", "Walze ü"]) == [
        "ball", "Ball_2", "my_tool_1", "_up", "_", "Walze_ü"]  # fmt: skip
    long = file_names(["x" * 300, "x" * 300, "плита" * 60])
    assert len(set(long)) == 3 and all(len(name.encode()) < 200 for name in long)


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "degree"), KINDS)
def test_other_readers(tmp_path, kind, degree):
    """meshio and VTK, where they are installed."""
    grid = written(scene_of(kind, degree), tmp_path)
    cells = grid["Cells"]["connectivity"].reshape(len(grid["Cells"]["types"]), -1)
    read = 0
    try:
        import meshio
    except ImportError:
        pass
    else:
        read += 1
        mesh = meshio.read(tmp_path / "steps" / "000000.vtu")
        np.testing.assert_array_equal(mesh.cells[0].data, cells)
        for name, values in grid["PointData"].items():
            np.testing.assert_array_equal(mesh.point_data[name], values)
        for name, values in grid["CellData"].items():
            np.testing.assert_array_equal(mesh.cell_data[name][0], values)
        assert meshio.read(tmp_path / "tools" / "ball_000000.vtu").points.shape[1] == 3
    try:
        import pyvista
    except ImportError:
        pass
    else:
        read += 1
        reader = pyvista.get_reader(tmp_path / "results.pvd")
        assert reader.time_values == [0.0]
        mesh = reader.read()[0]
        np.testing.assert_array_equal(mesh.cells.reshape(len(cells), -1)[:, 1:], cells)
        for part, data in (("PointData", mesh.point_data), ("CellData", mesh.cell_data)):
            for name, values in grid[part].items():
                np.testing.assert_array_equal(data[name], values)
        corners = {TYPES[kind, 1]: cells[:, : 8 if kind == "hexahedra" else 4]}  # VTK 9.3 finds no volume of 27 nodes
        volume = pyvista.UnstructuredGrid(corners, mesh.points).compute_cell_sizes()["Volume"]
        assert volume.min() > 0.0
        np.testing.assert_allclose(volume.sum(), np.ptp(mesh.points, axis=0).prod(), rtol=1e-9)
        assert pyvista.get_reader(tmp_path / "tools" / "ball.pvd").read()[0].n_cells > 100
    if not read:
        pytest.skip("neither meshio nor pyvista is installed")


@pytest.mark.serial
def test_names_that_xml_cannot_hold(tmp_path):
    file = GridFile(np.zeros((1, 3)), np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64), np.ones(1))
    file.write(tmp_path / "a.vtu", {'a"<&>\x00\n\ud800ü': np.ones(1)}, {}, {})
    assert list(read_vtu(tmp_path / "a.vtu")["PointData"]) == ['a"<&>   ü']
