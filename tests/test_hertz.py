"""Smooth contact with known answers: Hertz's sphere and cylinder on a half-space, and a rubber cylinder between plates."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Scene, mooney_rivlin, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.kernels.status import OPEN
from fenics_contact.meshes import disc
from fenics_contact.studies import hertz as study
from fenics_contact.studies.hertz import DEPTH, STAR, A, hertz, indented


def error(tool, cells):
    """Signed relative error of the force."""
    found = hertz(tool, cells, degree=1, points="nodes", factor=100.0, method="newton", steps=2, linear="direct")
    assert found["converged"], found["verdict"]
    exact = STAR * A**3 / (3 * study.R) if tool == "sphere" else DEPTH * np.pi * STAR * A**2 / (8 * study.R)
    return found["value"] / exact - 1


@pytest.mark.parametrize(("tool", "coarse", "fine"), [("sphere", 4, 8), ("cylinder", 4, 20)])
def test_force_within_one_percent_of_hertz_and_converging(tool, coarse, fine):
    first, last = error(tool, coarse), error(tool, fine)
    assert abs(last) < 0.01, (first, last)  # what Hertz's theory itself neglects is a tenth of that
    assert abs(last) < 0.7 * abs(first), (first, last)


@pytest.mark.parametrize("cells", [6, 12])
def test_ends_and_peak_of_the_pressure_under_a_cylinder(cells):
    """The line says where the contact ends to a tenth of a cell, which is a quarter or an eighth of its half-width A."""
    result, _ = indented("cylinder", cells)
    ((start, end),) = result.require().widths("top", "x", {"y": 0.0})
    assert start == 0.0 and abs(end - A) < 0.1 * 1.5 * A / cells
    p0 = STAR * A / (2 * study.R)
    assert abs(result.history[-1]["top_peak_pressure_MPa"] / p0 - 1) < 1e-3
    line = result.line("top", "x", {"y": 0.0})
    inside = line["x_reference_mm"] < 0.7 * A
    exact = p0 * np.sqrt(1 - line["x_reference_mm"][inside] ** 2)
    np.testing.assert_allclose(line["pressure_MPa"][inside], exact, atol=0.01 * p0)


@pytest.mark.parametrize("cells", [4, 6])
def test_cone_on_a_half_space(cells):
    """Sneddon: F = 2/pi E* d^2 tan(half-angle), contact radius 2/pi d tan(half-angle) = A."""
    result, exact = indented("cone", cells)
    last = result.require().history[-1]
    assert abs(-last["top_force_z_N"] / exact - 1) < 0.01  # cells of a third of the radius; strains of 1/300
    # a node counts with the square of one spacing around it: a quarter disc of nodes is known to a spacing
    assert abs(np.sqrt(4 * last["top_area_mm2"] / np.pi) - A) < 1.5 * A / cells
    # the pressure p = E*/2 cot arcosh(a/r) has no bound at the apex; its mean over the node's share there, about 3/2 E* cot,
    # sinks by 0.01 h/a of the travel pi/2 a cot under 100 E/h
    assert last["top_penetration_mm"] < 2 * 0.01 / cells * 1.5 * np.pi / 2 * A**2 / study.R


def test_balance_where_the_tool_is_far_larger_than_its_dent(monkeypatch):
    """A ball of 2 m sinks in by half a micrometre: its gap is known to half a unit in the last place of its radius."""
    small = error("sphere", 4)
    monkeypatch.setattr(study, "R", 2000.0)
    assert abs(error("sphere", 4) - small) < A / 300.0  # the same dent on the same mesh: but for the strains of the first


def squeezed_cylinder(cells):
    """Force per depth [N/mm] of a rubber cylinder squeezed by 6.4 mm in all, and the result."""
    scene = Scene(
        Body(read_gmsh(disc.build, radius=20.0, depth=1.0, cells=cells), "disc", mooney_rivlin(0.1863, 0.0098, 5.0))
    )
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_z", "z")
    scene.fix(("front", "back"), "y")
    plate = rigid_plane((0, 0, 20.0), (0, 0, -1.0))
    scene.contact("rim", plate, name="rim")
    result = solve(scene, move={plate: (0, 0, -3.2)}, steps=8)
    assert result.converged, result.verdict.reason
    return -2 * result.history[-1]["rim_force_z_N"]  # both halves of the contact


def test_rubber_cylinder_between_plates():
    coarse, fine = squeezed_cylinder(6), squeezed_cylinder(16)
    assert abs(fine / 4.5622 - 1) < 0.01, (coarse, fine)  # the reference of an independent code
    assert abs(fine - 4.5622) < abs(coarse - 4.5622), (coarse, fine)


def half_ball(size):
    """A quarter of a half ball of curved tetrahedra on a plane, pressed by 0.03 of its radius."""

    def script():
        occ, tags = gmsh.model.occ, {}
        ball = occ.addSphere(0, 0, 0, 1.0, angle1=-np.pi / 2, angle2=0, angle3=np.pi / 2)
        occ.synchronize()
        for _, face in gmsh.model.getEntities(2):
            x, _, z = np.abs(occ.getCenterOfMass(2, face))
            flat = "top" if z < 1e-6 else "x0" if x < 1e-6 else "y0"
            tags["skin" if gmsh.model.getType(2, face) == "Sphere" else flat] = face
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [ball]), "ball")
        for name, face in tags.items():
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), name)
        field = gmsh.model.mesh.field
        graded = field.add("MathEval")
        field.setString(graded, "F", f"{size}+0.35*Max(0,Sqrt(x*x+y*y+(z+1)*(z+1))-0.25)")
        field.setAsBackgroundMesh(graded)
        for option in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)

    scene = Scene(Body(read_gmsh(script), "ball", neo_hooke(1.0, K=3.0)), degree=2)
    scene.fix("x0", "x")
    scene.fix("y0", "y")
    scene.prescribe("top", "z", -0.03)
    scene.contact("skin", rigid_plane((0, 0, -1), (0, 0, 1), name="floor"), 0.1, name="c")
    return solve(scene, steps=3).require()


@pytest.mark.parallel
@pytest.mark.parametrize("size", [0.08, 0.13])
def test_gauss_points_show_the_area_gap_and_slip_of_those_that_press(size):
    """2.2 and 1.4 cells per radius of the contact. By nodes that any pressure reaches its area was 40 % too large; means
    over points that press and open ones beside them showed gaps where the ball presses, and less slip than the columns."""
    result = half_ball(size)
    row, comm, surface = result.history[-1], result.system.comm, result.measured.surfaces[0]
    stiff = 2.7 / (1.0 - 0.35**2)
    radius = (0.75 * 4.0 * row["c_force_z_N"] / stiff) ** (1 / 3)
    assert row["c_area_mm2"] == pytest.approx(np.pi * radius**2 / 4.0, rel=0.1)
    at = surface.at_state()
    gaps = np.where(at.status != OPEN, at.gap, -1e-300)
    assert max(comm.allgather(gaps.max(initial=-1.0))) < 0.0
    depth = -min(comm.allgather(gaps.min(initial=0.0)))
    assert 0.5 * row["c_penetration_mm"] < depth <= row["c_penetration_mm"] * (1.0 + 1e-14)
    slip = max(comm.allgather(at.slip.max(initial=0.0)))
    assert 0.5 * row["c_greatest_slip_mm"] < slip <= row["c_greatest_slip_mm"]
