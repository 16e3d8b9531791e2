"""What a run leaves behind: history, summary, fields and picture; and that the fields in them are right."""

import csv
import json

import dolfinx.fem
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.optimize import brentq
from vtu_files import times_of_fields

from fenics_contact import Body, Method, Scene, Units, mooney_rivlin, read_gmsh, rigid_plane, rigid_punch, solve
from fenics_contact.meshes import box, punch_plate
from fenics_contact.output.fields import Fields
from fenics_contact.timing import STAGES

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
A1, A2, K = 0.1863, 0.0098, 5.0  # MPa
STEPS = 3


def punch_scene(friction):
    mesh = read_gmsh(punch_plate.build, inside=4, outside=3, layers=2, ratio=1.0)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(A1, A2, K)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, friction, name="top")
    scene.contact("bottom", rigid_plane(name="floor"), name="bottom")
    return scene, punch


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = COMM.bcast(tmp_path_factory.mktemp("output")) / "deeper" / "run"
    scene, punch = punch_scene(0.3)
    result = solve(scene, move={punch: (0, 0, -1.0)}, steps=STEPS, out=folder)
    COMM.Barrier()
    return scene, result, folder


def test_history_has_a_row_per_step_and_units_in_its_names(run):
    _, result, folder = run
    with open(folder / "history.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(result.history) == STEPS
    wanted = {"step", "t", "iterations", "residual", "seconds", "smallest_J", "balance_error_N"}
    wanted |= {f"{e}_Nmm" for e in ("external_work", "work_done", "strain_energy", "penalty_energy", "energy_error")}
    wanted |= {f"{tool}_travel_{a}_mm" for tool in ("punch", "floor") for a in "xyz"}
    for name in ("top", "bottom"):
        wanted |= {f"{name}_force_{a}_N" for a in "xyz"} | {f"{name}_moment_{a}_Nmm" for a in "xyz"}
        wanted |= {f"{name}_area_mm2", f"{name}_active_points", f"{name}_sticking_points", f"{name}_penetration_mm"}
        wanted |= {f"{name}_{what}_{a}_mm" for what in ("peak", "width", "point") for a in "xyz"}
        wanted |= {f"{name}_load_N", f"{name}_peak_pressure_MPa", f"{name}_normal_work_error_Nmm"}
    wanted |= {f"top_friction_{a}_N" for a in "xyz"} | {f"top_{s}_slip_mm" for s in ("greatest", "mean")}
    wanted |= {"top_friction_work_Nmm"}  # the floor has no friction
    for group in ("symmetry_x", "symmetry_y"):
        wanted |= {f"{group}_reaction_{a}_N" for a in "xyz"} | {f"{group}_reaction_moment_{a}_Nmm" for a in "xyz"}
        wanted |= {f"{group}_reaction_point_{a}_mm" for a in "xyz"}
    assert set(rows[0]) == wanted
    for row, kept in zip(rows, result.history, strict=True):
        for key, value in row.items():
            if key == "seconds" and COMM.rank > 0:
                continue  # every rank has its own clock; the file holds that of rank 0
            np.testing.assert_allclose(float(value), kept[key], rtol=1e-11)  # the file keeps 12 digits
    np.testing.assert_allclose([float(r["punch_travel_z_mm"]) for r in rows], -np.arange(1, STEPS + 1) / STEPS, rtol=1e-11)


def test_vertical_forces_balance(run):
    _, result, _ = run
    last = result.history[-1]
    # nothing but the two tools acts vertically
    assert last["top_force_z_N"] < -1.0
    np.testing.assert_allclose(last["top_force_z_N"], -last["bottom_force_z_N"], rtol=1e-6)  # Newton stops at 1e-8


def test_summary(run):
    scene, result, folder = run
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["verdict"]["converged"] is True and summary["verdict"]["t"] == 1.0
    assert summary["scene"]["units"] == {"length": "mm", "force": "N", "pressure": "MPa"}
    assert "classical" in summary["scene"]["materials"]["plate"]  # every result says which I2 it used
    top, bottom = summary["scene"]["contacts"]
    assert (top["name"], top["master"], top["tool_edge"], top["friction"]) == ("top", "punch", "sharp", 0.3)
    assert (bottom["name"], bottom["friction"]) == ("bottom", 0.0)
    assert [(r["name"], r["moment_about"]) for r in summary["scene"]["reactions"]] == [
        (f"symmetry_{axis}", "the present centroid of the group") for axis in "xy"
    ]
    assert top["slave_points"] == 64 and 0.0 < top["penalty_MPa_per_mm"][0] <= top["penalty_MPa_per_mm"][1]
    assert summary["sizes"]["cells"] == 7 * 7 * 2 and summary["sizes"]["unknowns"] == 3 * 8 * 8 * 3
    assert summary["sizes"]["supported_unknowns"] == 2 * 8 * 3
    assert summary["ranks"] == COMM.size and summary["versions"]["dolfinx"]
    assert summary["iterations"] == sum(row["iterations"] for row in result.history)
    assert [len(r) for r in summary["residuals_per_step"]] == [row["iterations"] for row in result.history]
    assert summary["last_step"]["top_force_z_N"] == pytest.approx(result.history[-1]["top_force_z_N"], rel=1e-12)
    stages = summary["seconds"]
    assert set(STAGES) <= set(stages) and min(stages.values()) >= 0.0
    assert sum(v for k, v in stages.items() if k != "total") == pytest.approx(stages["total"], rel=1e-12)  # by definition
    for stage in ("compile", "contact kernel", "insertion", "bulk tangent", "residual", "factorisation", "solve", "output"):
        assert stages[stage] > 0.0, stage
    assert summary["seconds_before_first_step"] < stages["total"]
    assert not list(folder.glob("*.part"))


def test_fields_and_picture(run):
    _, _, folder = run
    fields = times_of_fields(folder)
    wanted = {"displacement_mm", "cauchy_stress_MPa", "J", "contact_pressure_MPa", "friction_traction_MPa", "gap_mm"}
    wanted |= {"contact_status", "body", "tool punch", "tool floor"}
    assert wanted <= set(fields), set(fields)
    for name in wanted:  # the start and every step
        np.testing.assert_allclose(fields[name], np.arange(STEPS + 1) / STEPS, atol=1e-12)
    assert sorted(path.name for path in (folder / "steps").iterdir()) == [f"{step:06d}.vtu" for step in range(STEPS + 1)]
    names = [f"{tool}_{step:06d}.vtu" for tool in ("floor", "punch") for step in range(STEPS + 1)]
    assert sorted(path.name for path in (folder / "tools").glob("*.vtu")) == names
    picture = (folder / "body.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 5000


def integral(scene, u, integrand, group):
    """Integral over the current area of a surface: da = |cof F N| dA."""
    F = ufl.Identity(3) + ufl.grad(u)
    N = ufl.FacetNormal(scene.mesh.domain)
    stretch = ufl.det(F) * ufl.sqrt(ufl.dot(ufl.inv(F).T * N, ufl.inv(F).T * N))
    ds = ufl.Measure("ds", scene.mesh.domain, subdomain_data=scene.mesh.facet_tags, metadata={"quadrature_degree": 8})
    form = dolfinx.fem.form(integrand * stretch * ds(scene.mesh.surfaces[group]))
    return COMM.allreduce(dolfinx.fem.assemble_scalar(form))


@pytest.fixture(scope="module")
def fields(run):
    scene, result, _ = run
    fields = Fields(scene, result.system)
    fields.update()
    return fields


def test_contact_pressure_integrates_to_the_normal_force(run, fields):
    scene, result, _ = run
    last = result.history[-1]
    p, friction = fields.of("").pressure.copy(), fields.of("").friction.copy()
    for function in (p, friction):  # off the slave surfaces they are not numbers
        function.x.array[:] = np.nan_to_num(function.x.array)
    for name in ("top", "bottom"):
        total = integral(scene, result.u, p, name)
        # both tools' faces are flat and level; 1e-3: nodal forces over areas of quadrature degree 3, here 8
        np.testing.assert_allclose(total, abs(last[f"{name}_force_z_N"]), rtol=1e-3)
    for axis, letter in enumerate("xy"):
        total = integral(scene, result.u, friction[axis], "top")
        np.testing.assert_allclose(total, last[f"top_force_{letter}_N"], rtol=1e-3)
        assert abs(total) > 0.1


def test_status_field(run, fields):
    scene, result, _ = run
    last = result.history[-1]
    X = fields.of("").status.function_space.tabulate_dof_coordinates()
    owned = fields.of("").status.function_space.dofmap.index_map.size_local
    status, gap, pressure = (f.x.array[:owned] for f in (fields.of("").status, fields.of("").gap, fields.of("").pressure))
    top, bottom = (np.abs(X[:owned, 2] - z) < 1e-6 for z in (10.0, 0.0))

    def count(where):
        return COMM.allreduce(int(where.sum()))

    assert count(top & (status == 2)) == last["top_sticking_points"]
    assert count(top & (status >= 2)) == last["top_active_points"] > 0
    assert count(bottom & (status == 1)) == last["bottom_active_points"] > 0
    assert count(status == 0) > 0
    assert np.all(pressure[status == 0] == 0.0) and np.all(pressure[status > 0] >= 0.0)
    assert np.all(gap[(top | bottom) & (status == 0)] > 0.0) and np.all(gap[status > 0] <= 1e-9)


def uniaxial(stretch):
    """J and Cauchy stress of a uniaxial bar of the compressible Mooney-Rivlin, from its principal stretches."""

    def cauchy(one, two, three):
        J = one * two * three
        b = np.array([one, two, three]) ** 2 * J ** (-2 / 3)
        # t_i = J^-1 l_i dW/dl_i with W = a1 (I1 - 3) + a2 (I2 - 3) + K/2 (J - 1)^2, I2 = sum of products b_i b_j
        first = 2 * A1 * (b - b.mean())
        pairs = b.sum() ** 2 - (b**2).sum()
        second = 2 * A2 * (b * (b.sum() - b) - pairs / 3)
        return J, (first + second) / J + K * (J - 1)

    side = brentq(lambda s: cauchy(stretch, s, s)[1][1], 0.5, 2.0, xtol=1e-14)
    J, stress = cauchy(stretch, side, side)
    return J, stress[0], side


def test_oracle_against_the_table():
    _, stress, side = uniaxial(0.9)
    np.testing.assert_allclose(stress * side**2, -0.1288051, atol=6e-8)  # seven digits of the closed form


def test_homogeneous_compression(tmp_path):
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", mooney_rivlin(A1, A2, K)))
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    scene.prescribe("zmax", "z", -0.2)
    scene.contact("zmin", rigid_plane(name="floor"), name="bottom")
    result = solve(scene, steps=2, method=Method(tolerance=1e-12), out=COMM.bcast(tmp_path))
    assert result.converged
    sunk = result.history[-1]["bottom_penetration_mm"]
    J, stress, side = uniaxial((2.0 - 0.2 + sunk) / 2.0)  # the penalty's own compliance lengthens the bar
    fields = Fields(scene, result.system)
    fields.update()
    exact = np.zeros((3, 3))
    exact[2, 2] = stress
    # 1e-9: Newton stops at 1e-12 of the force, over a bulk modulus 13 times the shear modulus
    np.testing.assert_allclose(fields.J.x.array, J, atol=1e-9)
    cells = fields.cauchy_stress.x.array.reshape(-1, 9)
    np.testing.assert_allclose(cells, np.broadcast_to(exact.ravel(), cells.shape), atol=1e-9)
    force = result.history[-1]["bottom_force_z_N"]
    np.testing.assert_allclose(force, -stress * (2.0 * side) ** 2, rtol=1e-8)
    bottom = np.abs(fields.of("").status.function_space.tabulate_dof_coordinates()[:, 2]) < 1e-9
    np.testing.assert_allclose(fields.of("").pressure.x.array[bottom], -stress, rtol=1e-8)
    assert np.isnan(fields.of("").pressure.x.array[~bottom]).all()  # no slave nodes
    assert set(np.unique(fields.of("").status.x.array[bottom])) <= {1.0}


def test_own_units_name_the_columns(tmp_path):
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2))
    scene = Scene(Body(mesh, "box", mooney_rivlin(A1, A2, K)), units=Units("m", "kN", "kPa"))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 2), (0, 0, -1), name="lid")
    scene.contact("zmax", plate, name="top")
    result = solve(scene, move={plate: (0, 0, -0.1)}, steps=1)
    assert {"lid_travel_z_m", "top_force_z_kN", "top_moment_x_kNm", "top_area_m2"} <= set(result.history[0])
    with pytest.raises(KeyError, match="top_force_z_kN"):
        result.column("top_force_z_N")
