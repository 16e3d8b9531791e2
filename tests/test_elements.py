"""Elements that do not lock: consistency, patch test, closed forms and published benchmarks near incompressibility.

Benchmarks: Cook's membrane, a bonded rubber strip, the block under a patch load of Reese & Wriggers, torsion of a rod, and
a rubber cylinder squeezed flat between plates; their values come from independent codes.
"""

import math
from dataclasses import replace

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import minimize
from taylor import change, orders, remainders

from fenics_contact import (
    ArcSteps,
    Body,
    Method,
    Scene,
    SceneError,
    from_elastic,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_plane,
    solve,
    user_energy,
)
from fenics_contact.meshes import box, cook, disc, patch_block, rectangles, rod, sphere_shell, two_blocks
from fenics_contact.output.fields import Fields
from fenics_contact.solid import materials
from fenics_contact.solvers import linear
from fenics_contact.solvers.choice import foreseen_costs
from fenics_contact.solvers.newton import Newton

A1, A2 = 0.1863, 0.0098
MU = 2 * (A1 + A2)
DIRECT = Method(linear="direct")


def rubber(K=5.0):
    return mooney_rivlin(A1, A2, K)


def draw_tetrahedra(size=0.5):
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "box")
    for _, face in gmsh.model.getEntities(2):
        centre = gmsh.model.occ.getCenterOfMass(2, face)
        axis = int(np.argmax(np.abs(np.array(centre) - 0.5)))
        name = "xyz"[axis] + ("min" if centre[axis] < 0.5 else "max")
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), name)


def distorted_cube(cells=(2, 2, 2), tetrahedra=False, comm=MPI.COMM_WORLD):
    """Unit cube whose inner vertices are moved by a smooth field: no cell is a box, the faces stay flat."""
    mesh = read_gmsh(draw_tetrahedra, comm) if tetrahedra else read_gmsh(box.build, comm, cells=cells)
    x = mesh.domain.geometry.x
    bubble = np.prod(np.sin(np.pi * x), axis=1)[:, None]
    x += 0.12 * bubble * np.array([1.0, -0.7, 0.5]) + 0.05 * bubble * np.cos(3 * x[:, [1, 2, 0]])
    return mesh


def reaction(result, axis, at, component):
    """Sum of the solid's nodal forces [force] on the plane X[axis] = at."""
    system = result.system
    forces = np.zeros(len(system.state.u.x.array))
    system.terms[0].add_residual(system.state, forces, None)  # each rank's cells: the sum over ranks is complete
    X = system.space.tabulate_dof_coordinates()
    here = forces.reshape(-1, 3)[np.abs(X[:, axis] - at) < 1e-6, component].sum()
    return system.comm.allreduce(here)


def displacement_at(result, place):
    """u (3,) of the node nearest to a place. Collective."""
    system = result.system
    distance = np.linalg.norm(system.space.tabulate_dof_coordinates() - np.asarray(place), axis=1)
    nearest = int(np.argmin(distance))
    found = system.comm.allgather((float(distance[nearest]), result.u.x.array[3 * nearest : 3 * nearest + 3].copy()))
    return min(found, key=lambda pair: pair[0])[1]


# ---- consistency

TAYLOR = [  # element, degree, tetrahedra, law
    ("mixed", 1, False, rubber()),
    ("mixed", 1, False, neo_hooke(0.4, 50.0, materials.barrier)),
    ("mixed", 2, False, neo_hooke(0.4, 50.0, materials.barrier)),
    ("mixed", 2, True, rubber()),
]


@pytest.mark.serial
@pytest.mark.parametrize(("element", "degree", "tetrahedra", "law"), TAYLOR)
def test_tangent_is_the_derivative_of_the_residual(element, degree, tetrahedra, law):
    scene = Scene(Body(distorted_cube(tetrahedra=tetrahedra), "box", law), degree=degree, element=element)
    scene.fix("zmin")
    system = scene.system()
    X = scene.space.tabulate_dof_coordinates()
    rng = np.random.default_rng(1)
    smooth = np.stack([0.3 * X[:, 0] + 0.2 * X[:, 1] ** 2, -0.2 * X[:, 1] * X[:, 2], 0.25 * np.sin(X[:, 0])], axis=1)
    u, direction = (smooth + 0.02 * rng.uniform(-1, 1, X.shape)).ravel(), rng.uniform(-1, 1, X.size)

    system.state.u.x.array[:] = u
    left = remainders(system, system.terms[0], 2e-3, direction)
    # third-order terms shift the order by about step over cell size, 2e-3 / 0.3, times a few
    assert orders(left).min() > 1.95, left
    assert left[-1] > 1e-9  # not yet rounding
    assert system.matrix.convert("aij", out=PETSc.Mat()).isSymmetric(1e-12 * abs(change(system, direction)).max())


@pytest.mark.parallel
@pytest.mark.parametrize(("element", "degree", "tetrahedra"), [c[:3] for c in TAYLOR if c[3].name == rubber().name])
def test_patch(element, degree, tetrahedra):
    """A linear displacement of the boundary of distorted cells is linear inside, with the stress of the closed form."""
    scene = Scene(Body(distorted_cube((3, 2, 2), tetrahedra), "box", rubber()), degree=degree, element=element)
    F = np.array([[1.3, 0.2, -0.1], [0.05, 0.8, 0.15], [0.1, -0.1, 1.1]])
    for i, letter in enumerate("xyz"):
        faces = tuple(a + end for a in "xyz" for end in ("min", "max"))
        scene.prescribe(faces, letter, lambda X, t, i=i: t * X @ (F - np.eye(3))[i])
    result = solve(scene, steps=2, method=Method(tolerance=1e-12))
    assert result.converged, result.verdict.reason
    X = scene.space.tabulate_dof_coordinates()
    assert np.abs(result.u.x.array.reshape(-1, 3) - X @ (F - np.eye(3)).T).max() < 1e-10  # tolerance times stiffness
    J = np.linalg.det(F)
    B = F @ F.T / J ** (2 / 3)
    tau = 2 * A1 * B + 2 * A2 * (np.trace(B) * B - B @ B)
    sigma = (tau - np.trace(tau) / 3 * np.eye(3)) / J + 5.0 * (J - 1) * np.eye(3)
    fields = Fields(scene, result.system)
    fields.update()
    seen = fields.cauchy_stress.x.array.reshape(-1, 3, 3)
    assert np.abs(seen - sigma).max() < 1e-9


@pytest.mark.serial
@pytest.mark.parametrize(("element", "degree"), [("mixed", 1), ("mixed", 2)])
@pytest.mark.parametrize(("stretch", "nominal"), [(0.5, -1.4045219), (1.5, 0.3910385), (3.0, 0.9819937)])
def test_uniaxial_stress_of_one_element(element, degree, stretch, nominal):
    scene = Scene(Body(read_gmsh(box.build), "box", rubber()), degree=degree, element=element)
    for letter in "xyz":
        scene.fix(letter + "min", letter)
    scene.prescribe("zmax", "z", stretch - 1)
    result = solve(scene, steps=5, method=Method(tolerance=1e-11))
    assert abs(reaction(result, 2, 1.0, 2) - nominal) < 5.1e-8  # targets: seven decimals, and the comparison's rounding


def strip_scene(K, degree=1, cells=8, squeeze=0.1, comm=MPI.COMM_WORLD, element="mixed"):
    """A strip 80 x 10 mm bonded to two plates, plane strain: a quarter, squeezed by a share of its height."""
    mesh = read_gmsh(box.build, comm, size=(40.0, 5.0, 5.0 / cells), cells=(8 * cells, cells, 1))
    scene = Scene(Body(mesh, "box", rubber(K)), degree=degree, element=element)
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    scene.fix(("zmin", "zmax"), "z")
    scene.fix("ymax", "x")
    scene.prescribe("ymax", "y", -5.0 * squeeze)
    return scene


def strip(K, degree=1, cells=8, squeeze=0.1, comm=MPI.COMM_WORLD, element="mixed", steps=10, method=DIRECT):
    """The result of the strip and its force per depth [N/mm]."""
    result = solve(strip_scene(K, degree, cells, squeeze, comm, element), steps=steps, method=method)
    assert result.converged, result.verdict.reason
    return result, -2 * reaction(result, 1, 5.0, 1) / (5.0 / cells)


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
def test_same_numbers_on_one_process_and_on_all(degree):
    options = {"K": 200.0, "degree": degree, "cells": 2, "steps": 2, "method": replace(DIRECT, tolerance=1e-11)}
    (alone, force), (together, same) = strip(comm=MPI.COMM_SELF, **options), strip(**options)
    assert abs(same / force - 1) < 1e-9  # steps end at 1e-11 of the force
    assert abs(together.system.vector.norm() / alone.system.vector.norm() - 1) < 1e-9


@pytest.mark.serial
def test_a_step_cut_back_equals_the_small_step():
    """The pressure that follows the tangent is part of the path: a step given up leaves nothing of it behind."""

    def system():
        mesh = read_gmsh(box.build, cells=(3, 2, 1))
        scene = Scene(Body(mesh, "box", rubber(200.0)), element="mixed")
        scene.fix("zmin")
        scene.fix("zmax", "xy")
        scene.prescribe("zmax", "z", -0.3)
        return scene.system()

    ends = []
    for give_up in (False, True):
        s = system()
        stepper = Newton(linear.LinearSolver(s))
        stepper.step(s, 0.2)
        s.trail.commit()
        if give_up:
            stepper.step(s, 1.0)
            s.trail.rollback()
        report = stepper.step(s, 0.5)
        ends.append((report.residuals, s.state.u.x.array.copy()))
    (direct, u), (again, v) = ends
    assert direct == pytest.approx(again, rel=1e-6, abs=1e-14)  # the same iterates, to rounding amplified by K
    assert np.abs(u - v).max() < 1e-14


@pytest.mark.serial
def test_snes_takes_the_mixed_element_too():
    _, newton = strip(200.0, cells=4, steps=5, method=replace(DIRECT, tolerance=1e-11))
    _, snes = strip(200.0, cells=4, steps=5, method=replace(DIRECT, name="snes", tolerance=1e-11))
    assert abs(snes / newton - 1) < 1e-8  # tolerance


@pytest.mark.serial
def test_the_iterative_solver_begins_later_at_a_large_bulk_modulus():
    """Its iterations grow with the square root of K / mu: by sqrt(1e4 / 20) over a ratio of 10."""
    mesh = read_gmsh(box.build, cells=(8, 8, 4))
    costs = []
    for ratio in (10.0, 1e4):
        scene = Scene(Body(mesh, "box", rubber(ratio * MU)), element="mixed")
        scene.fix("zmin")
        costs.append(foreseen_costs(scene.system()))
    assert costs[0]["direct"] == costs[1]["direct"]
    assert costs[1]["iterative"] / costs[0]["iterative"] == pytest.approx(np.sqrt(1e4 / 20.0))


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_steps_and_iterations_do_not_grow_with_the_bulk_modulus(degree):
    """A bonded strip squeezed by 10 % in two steps."""
    taken = {}
    for ratio in (10.0, 100.0, 1e3, 1e4):
        result, _ = strip(ratio * MU, degree, 8 // degree, steps=2)
        assert result.verdict.cuts == 0, ratio
        taken[ratio] = max(row["iterations"] for row in result.history)
    # the squeezed rubber's flow towards the edge, not K, sets the number once the strip is nearly incompressible
    assert taken[1e4] <= taken[100.0] + 2 and taken[1e4] <= 8, taken


@pytest.mark.serial
def test_output_stress_holds_the_mixed_pressure():
    scene = strip_scene(200.0, cells=2)
    result = solve(scene, steps=2)
    fields = Fields(scene, result.system)
    fields.update()
    mean = np.trace(fields.cauchy_stress.x.array.reshape(-1, 3, 3), axis1=1, axis2=2) / 3
    pressure = result.system.terms[0].pressure.x.array
    assert np.ptp(pressure) > 1.0  # [MPa], from the middle to the edge
    assert np.abs(mean - pressure).max() < 1e-12 * np.abs(pressure).max()
    assert result.summary["scene"]["element"] == "mixed"


# ---- benchmarks


def membrane(law, traction, cells, place, degree=1, element="mixed"):
    """Displacement (3,) [mm] of a corner or mid-side of Cook's membrane under a dead shear traction [MPa]."""
    mesh = read_gmsh(cook.build, cells=cells)
    scene = Scene(Body(mesh, "membrane", law), degree=degree, element=element)
    scene.fix("left")
    scene.fix(("front", "back"), "z")
    scene.traction("right", (0.0, traction, 0.0))
    result = solve(scene, steps=1, method=DIRECT)
    assert result.converged and result.verdict.cuts == 0, result.verdict.reason
    return displacement_at(result, (*place, 0.0))


COOK = 0.4225, 2 * 0.4225 * 1.3 / (3 * 0.4)  # mu, and K from nu = 0.3 [MPa]


@pytest.mark.serial
@pytest.mark.parametrize(("cells", "digits"), [(2, "8.638"), (4, "12.07"), (8, "13.86"), (16, "14.49"), (32, "14.67")])
def test_cook_s_membrane_on_plain_hexahedra(cells, digits):
    law = neo_hooke(*COOK, volumetric=materials.barrier)
    uy = membrane(law, 0.0625, cells, (48, 52), element="displacement")[1]
    assert f"{uy:.4g}" == digits  # the published sequence, as printed


@pytest.mark.serial
@pytest.mark.parametrize(("degree", "cells"), [(1, 32), (2, 8)])
def test_cook_s_membrane(degree, cells):
    """Within one percent at 32 hexahedra per edge of degree 1, and of degree 2 already at 8."""
    uy = membrane(neo_hooke(*COOK, volumetric=materials.barrier), 0.0625, cells, (48, 52), degree)[1]
    assert abs(uy / 14.740 - 1) < 0.01
    u = membrane(rubber(), 0.02, cells, (48, 60), degree)
    assert abs(u[1] / 5.0763 - 1) < 0.01
    assert degree == 1 or abs(u[0] / -4.1432 - 1) < 0.01  # docs/limits.md: degree 1 needs 48 hexahedra per edge for this one


@pytest.mark.serial
def test_the_error_does_not_double_between_a_bulk_modulus_of_1_and_200():
    """Cook's membrane on 8 hexahedra per edge against degree 2 on as many cells, whose own error is a tenth."""
    errors = []
    for K in (1.0, 200.0):
        coarse, fine = (membrane(rubber(K), 0.02, 8, (48, 60), degree)[1] for degree in (1, 2))
        errors.append(abs(coarse / fine - 1))
    assert errors[1] < 2 * errors[0], errors


@pytest.mark.parallel
@pytest.mark.parametrize(("degree", "cells"), [(1, 8), (2, 4)])
@pytest.mark.parametrize(("squeeze", "force"), [(0.02, 7.1191), (0.1, 37.119)])
def test_bonded_strip(degree, cells, squeeze, force):
    _, ours = strip(5.0, degree, cells, squeeze, steps=2)
    assert abs(ours / force - 1) < 0.01


@pytest.mark.serial
@pytest.mark.parametrize(("degree", "cells"), [(1, 12), (2, 6)])
@pytest.mark.parametrize(("load", "compression"), [(20, 0.2197), (40, 0.4249), (60, 0.5857)])
def test_block_under_a_patch_load(degree, cells, load, compression):
    """Reese & Wriggers' block at K / mu = 5000 under 4 MPa times `load`."""
    nu, mu = 0.4999, 80.194
    law = neo_hooke(mu, 2 * mu * (1 + nu) / (3 * (1 - 2 * nu)), volumetric=materials.barrier)
    scene = Scene(Body(read_gmsh(patch_block.build, cells=cells), "block", law), degree=degree, element="mixed")
    scene.fix("bottom", "y")
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_z", "z")
    scene.fix(("patch", "top"), "xz")
    scene.traction("patch", (0.0, -4.0 * load, 0.0))
    result = solve(scene, steps=load // 20, method=DIRECT)
    assert result.converged and result.verdict.cuts == 0, result.verdict.reason
    assert abs(-displacement_at(result, (0, 1, 0))[1] / compression - 1) < 0.003  # the reference's own uncertainty


def torsion_energy(c, twist, stretch=1.0, K=200.0, radius=10.0):
    """Energy per length [N] of a rod twisted by `twist` [1/mm], its radii r = R (c0 + c1 R^2 + c2 R^4 + c3 R^6)."""
    x, w = np.polynomial.legendre.leggauss(24)
    R, w = radius * (x + 1) / 2, radius * w / 2
    powers = (R[:, None] / radius) ** (2 * np.arange(len(c)))
    hoop = powers @ c  # r / R
    radial = powers @ (c * (2 * np.arange(len(c)) + 1))  # dr / dR
    F = np.zeros((len(R), 3, 3))
    F[:, 0, 0], F[:, 1, 1], F[:, 1, 2], F[:, 2, 2] = radial, hoop, R * hoop * twist, stretch
    J = np.linalg.det(F)
    B = np.einsum("qij,qkj->qik", F, F) / J[:, None, None] ** (2 / 3)
    I1, I2 = np.trace(B, axis1=1, axis2=2), np.einsum("qij,qij->q", B, B)
    W = A1 * (I1 - 3) + A2 * ((I1**2 - I2) / 2 - 3) + K / 2 * (J - 1) ** 2
    return 2 * np.pi * (w * R) @ W


@pytest.fixture(scope="module")
def exact_torsion():
    """Radii of the free rod at 50 / m, its moment [N mm] and its force [N]."""
    c = minimize(torsion_energy, [1.0, 0, 0, 0], (0.05,), options={"gtol": 1e-9}).x
    h = 1e-5
    moment = (torsion_energy(c, 0.05 + h) - torsion_energy(c, 0.05 - h)) / (2 * h)
    force = (torsion_energy(c, 0.05, 1 + h) - torsion_energy(c, 0.05, 1 - h)) / (2 * h)
    assert abs(moment - 307.998) < 0.01 and abs(force + 8.0795) < 1e-3  # targets
    return c, moment, force


@pytest.mark.serial
def test_torsion(exact_torsion):
    """Moment and force of a slice whose ends follow the exact field; the polygon's error falls with h^2."""
    c, moment, force = exact_torsion
    seen = []
    for cells in (4, 8):
        scene = Scene(
            Body(read_gmsh(rod.build, height=2.0, cells=cells, layers=cells), "rod", rubber(200.0)), element="mixed"
        )
        for end, z in (("bottom", 0.0), ("top", 2.0)):
            for axis in (0, 1):

                def turned(X, t, axis=axis, z=z):
                    R = np.hypot(X[:, 0], X[:, 1])
                    grown = 1 + t * ((R[:, None] / 10) ** (2 * np.arange(4)) @ c - 1)
                    angle = 0.05 * z * t + (0.0, -np.pi / 2)[axis]  # y is x turned back by a right angle
                    return grown * (X[:, 0] * math.cos(angle) - X[:, 1] * math.sin(angle)) - X[:, axis]

                scene.prescribe(end, "xy"[axis], turned)
            scene.fix(end, "z")
        result = solve(scene, steps=2, method=DIRECT)
        assert result.converged, result.verdict.reason
        system = result.system
        forces = np.zeros(len(system.state.u.x.array))
        system.terms[0].add_residual(system.state, forces, None)
        X = system.space.tabulate_dof_coordinates()
        top = np.abs(X[:, 2] - 2.0) < 1e-9
        f, x = forces.reshape(-1, 3)[top], (X + result.u.x.array.reshape(-1, 3))[top]
        seen.append([(x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum(), f[:, 2].sum()])
    limit = (4 * np.array(seen[1]) - seen[0]) / 3
    assert np.abs(limit / [moment, force] - 1).max() < 0.01, (seen, limit)  # the bound asked of the benchmarks


@pytest.mark.serial
def test_arc_length_passes_the_limit_point_of_an_inflated_shell():
    """K = 200 MPa, the paper's second invariant: the limit point of the exact radial solution is at 5.96192 kPa."""
    mesh = read_gmsh(sphere_shell.build, inner=95.0, thickness=1.0, cells=4, layers=1)
    scene = Scene(Body(mesh, "shell", materials.mooney_paper(A1, A2, 200.0)), element="mixed")
    for axis in "xyz":
        scene.fix(f"symmetry_{axis}", axis)
    scene.pressure("inner", 0.005)
    steps = ArcSteps(until=lambda state: np.abs(state.u.x.array).max() - 60.0, first=0.1, largest=10.0)
    result = solve(scene, steps=steps)
    assert result.converged, result.verdict.reason
    peak = int(np.argmax(result.column("limit_point") == 1))
    # a chord of 0.2 rad lies 0.2^2 / 12 = 0.33 % of the radius inside the sphere on average, and p goes with 1 / radius
    assert abs(0.005 * result.column("t")[peak] / 5.96192e-3 - 1) < 0.005


@pytest.mark.serial
def test_rubber_cylinder_squeezed_flat():
    """R = 0.2 m between frictionless plates at K / mu = 1500, squeezed to half its height."""
    mesh = read_gmsh(disc.build, radius=200.0, depth=10.0, cells=8)
    scene = Scene(Body(mesh, "disc", mooney_rivlin(0.293, 0.177, 1423.93)), element="mixed")
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_z", "z")
    scene.fix(("front", "back"), "y")
    plate = rigid_plane((0, 0, 200.0), (0, 0, -1.0))
    scene.contact("rim", plate, name="rim")
    result = solve(scene, move={plate: (0, 0, -100.0)}, steps=10, method=DIRECT)
    assert result.converged, result.verdict.reason
    force = -2 * result.column("rim_force_z_N")[1::2] / 10.0  # kN/m
    assert np.abs(force / [60.15, 170.61, 362.53, 714.81, 1415.74] - 1).max() < 0.01, force


# ---- stability


def pressed_square(element, triangles=False, cells=4, K=20.0, stretch=0.58, law=None):
    """A square between rollers on three sides, the fourth free, plane strain, which is to be pressed to a stretch."""
    mesh = read_gmsh(rectangles.build, rectangles={"b": ((0, 0), (1, 1), (cells, cells))}, triangles=triangles)
    scene = Scene(Body(mesh, "b", law or neo_hooke(0.7, K)), plane="strain", degree=2, element=element)
    scene.fix("b_xmin", "x")
    scene.fix("b_ymin", "y")
    scene.prescribe("b_ymax", "y", stretch - 1.0)
    return scene


def pressed_cube(mesh, K=20.0, stretch=0.58):
    """The same of hexahedra or tetrahedra."""
    scene = Scene(Body(mesh, "box", neo_hooke(0.7, K)), degree=2, element="mixed")
    scene.fix("xmin", "x")
    scene.fix(("ymin", "ymax"), "y")
    scene.fix("zmin", "z")
    scene.prescribe("zmax", "z", stretch - 1.0)
    return scene


def unstable_from(scene, steps):
    """Number of the first step after which the tangent has a negative pivot, if any."""
    result = solve(scene, steps=steps).require()
    notes = [note for note in result.verdict.notes if "negative pivots" in note]
    return round(steps * float(notes[0].partition(":")[0].rpartition("t = ")[2])) if notes else None


PRESSED = {
    "squares": lambda: pressed_square("mixed"),
    "squares, K / mu = 7": lambda: pressed_square("mixed", K=5.0),
    "squares, K / mu = 1000": lambda: pressed_square("mixed", K=700.0),
    "triangles": lambda: pressed_square("mixed", triangles=True),
    "one hexahedron": lambda: pressed_cube(read_gmsh(box.build)),
    "distorted hexahedra": lambda: pressed_cube(distorted_cube()),
    "tetrahedra, K / mu = 1000": lambda: pressed_cube(read_gmsh(draw_tetrahedra), K=700.0),
    "Yeoh": lambda: pressed_square("mixed", law=materials.yeoh(0.35, -0.02, 0.01, 20.0)),
    "Mooney, second invariant": lambda: pressed_square("mixed", law=materials.mooney_paper(A1, A2, 8.0)),
}


@pytest.mark.serial
@pytest.mark.parametrize("scene", PRESSED)
def test_degree_2_is_stable_in_compression_as_far_as_the_material_is(scene):
    """Biot's surface wrinkles from 0.544 of the height on; fields whose J alternates within a cell must not come before."""
    assert unstable_from(PRESSED[scene](), steps=7) is None


@pytest.mark.serial
@pytest.mark.parametrize("triangles", [False, True])
def test_degree_2_is_unstable_where_the_surface_wrinkles(triangles):
    """An incompressible half space in plane strain at a stretch of 0.544 (Biot 1963, Appl. Sci. Res. A 12, 168)."""
    steps = 25
    first = unstable_from(pressed_square("mixed", triangles, cells=8, stretch=0.5), steps)
    assert 1.0 - 0.5 * first / steps <= 0.544 < 1.0 - 0.5 * (first - 1) / steps + 0.02  # a step is 0.02; cells hold wrinkles


@pytest.mark.serial
def test_degree_2_follows_a_small_load_aside_under_compression():
    ends = []
    for element in ("displacement", "mixed"):
        scene = pressed_square(element)
        scene.traction("b_xmax", lambda X, t: np.c_[0.01 * t * np.cos(4 * np.pi * X[:, 1]), 0 * X[:, 0], 0 * X[:, 0]])
        result = solve(scene, steps=7).require()
        ends.append(result.column("b_ymax_reaction_y_N")[-1])
    assert abs(ends[1] / ends[0] - 1) < 2e-5, ends  # what the plain element's changes by from 4 to 16 cells


# ---- what cannot work is refused


@pytest.mark.parametrize("element", ["enhanced", "reduced"])
def test_an_unknown_element_is_refused_and_the_ones_to_use_are_named(element):
    with pytest.raises(SceneError, match=f"'{element}' is not one of displacement, mixed; use element='mixed' for"):
        Scene(Body(read_gmsh(box.build), "box", rubber()), element=element)


def test_an_energy_without_parts_is_refused_by_mixed_elements():
    law = user_energy(lambda F: 0.2 * ufl.inner(F, F), 0.4, 5.0, name="my law")
    mesh = read_gmsh(box.build)
    with pytest.raises(SceneError, match="'my law'.*element='displacement'"):
        Scene(Body(mesh, "box", law), element="mixed")
    Scene(Body(mesh, "box", law))


@pytest.mark.parametrize(
    ("element", "tetrahedra", "remedy", "allowed"),
    [
        ("displacement", False, "element='mixed'", 50),
        ("mixed", True, "degree=2", 5),
        ("displacement", True, "degree=2", 5),
    ],
)
def test_an_element_that_locks_is_refused_and_another_named(element, tetrahedra, remedy, allowed):
    mesh = read_gmsh(draw_tetrahedra) if tetrahedra else read_gmsh(box.build)
    for ratio in (2000, *([5.1, 20] if tetrahedra else [])):
        body = Body(mesh, "box", rubber(ratio * MU))
        with pytest.raises(SceneError, match=f"K / mu = .*{remedy}"):
            Scene(body, element=element)
        Scene(body, element=element, accept_locking=True)
        Scene(body, element="mixed", degree=2)
    Scene(Body(mesh, "box", rubber(allowed * MU)), element=element)


def cantilever(mesh, nu, element, **section):
    """Deflection of a beam along x of length 10 and depth 1 under an end load, over P L^3 / (3 E' I)."""
    scene = Scene(Body(mesh, "beam", from_elastic(100.0, nu)), degree=2, element=element, **section)
    scene.fix("beam_xmin")
    load = 1e-3
    scene.traction("beam_xmax", (0.0, -load, 0.0))
    result = solve(scene, steps=1, record={"end": lambda view: view.at("beam_xmax").displacement[1]}).require()
    modulus = 100.0 / (1.0 - nu**2) if section else 100.0
    return -result.column("end")[-1] / (load * 10.0**3 / (3.0 * modulus / 12.0))


def beam_of_triangles(through):
    rectangles.build({"beam": ((0.0, 0.0), (10.0, 1.0), (10 * through, through))}, triangles=True)


def beam_of_tetrahedra(through):
    beam = gmsh.model.occ.addBox(0, 0, 0, 10, 1, 1)
    gmsh.model.occ.synchronize()
    for _, edge in gmsh.model.getEntities(1):
        left, _, _, right, _, _ = gmsh.model.getBoundingBox(1, edge)
        gmsh.model.mesh.setTransfiniteCurve(edge, (10 * through if right - left > 5.0 else through) + 1)
    for _, face in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(face)
        left, _, _, right, _, _ = gmsh.model.getBoundingBox(2, face)
        if right - left < 1e-3:
            name = "beam_xmin" if left < 5.0 else "beam_xmax"
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), name)
    gmsh.model.mesh.setTransfiniteVolume(beam)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [beam]), "beam")
    gmsh.model.mesh.generate(3)


@pytest.mark.parametrize(
    ("build", "through", "nu", "off"),
    [
        (beam_of_triangles, 1, 0.3, 0.03),
        (beam_of_triangles, 2, 0.49, 0.05),
        (beam_of_tetrahedra, 1, 0.3, 0.03),
        (beam_of_tetrahedra, 1, 0.49, 0.06),
    ],
)
def test_mixed_simplices_of_degree_2_resist_bending(build, through, nu, off):
    """Against beam theory, with shear: one pressure per cell alone is too soft by 79, 14, 60 and 45 %."""
    section = {"plane": "strain"} if build is beam_of_triangles else {}
    slender = cantilever(read_gmsh(build, through=through), nu, "mixed", **section)
    assert slender == pytest.approx(1.0 + 0.25 * 2.0 * (1.0 + nu) * 1.2 / 10.0**2, abs=off)


def bonded_block(size, degree, ratio):
    """A block 2 x 2 x 1 between two plates, squeezed by a tenth: the force, and the notes of the verdict. Tetrahedra."""
    mesh = read_gmsh(draw_tetrahedra, size=size)
    mesh.domain.geometry.x[:, :2] *= 2.0
    element = "displacement" if degree == 1 else "mixed"
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, ratio)), degree=degree, element=element, accept_locking=True)
    scene.fix("zmin")
    scene.fix("zmax", "xy")
    scene.prescribe("zmax", "z", -0.1)
    result = solve(scene, steps=1).require()
    return reaction(result, 2, 1.0, 2), " ".join(result.verdict.notes)


@pytest.mark.parametrize(("ratio", "least", "most"), [(2.0, 0.0, 0.03), (5.0, 0.05, 0.12), (20.0, 0.3, 0.6)])
def test_what_linear_tetrahedra_lose_is_said(ratio, least, most):
    """The figures beside the bounds in `elements`, on a mesh of as many cells."""
    (linear, said), (quadratic, nothing) = (bonded_block(0.25, degree, ratio) for degree in (1, 2))
    assert least < linear / quadratic - 1 < most
    assert ("tetrahedra of degree 1 lock" in said) == (ratio > 2.0) and not nothing


def test_linear_tetrahedra_have_nothing_to_gain():
    """One dilatation per cell is what they have anyway: the mixed element is the plain one, which is why it is refused."""
    ends = []
    for element in ("displacement", "mixed"):
        scene = Scene(Body(distorted_cube(tetrahedra=True), "box", rubber(20.0)), element=element, accept_locking=True)
        scene.fix("zmin")
        scene.fix("zmax", "xy")
        scene.prescribe("zmax", "z", -0.2)
        ends.append(solve(scene, steps=2, method=Method(tolerance=1e-11)).u.x.array.copy())
    assert np.abs(ends[0] - ends[1]).max() < 1e-9  # tolerance


def sheared_cell(comm, degree, element):
    """The smallest J of a sheared block of one cell, which one process holds."""
    scene = Scene(Body(read_gmsh(box.build, comm), "box", rubber(20 * MU)), degree=degree, element=element)
    scene.fix("zmin")
    scene.fix("zmax", "yz")
    scene.prescribe("zmax", "x", 0.2)
    return scene, solve(scene, steps=1, method=Method(tolerance=1e-11)).require().history[-1]["smallest_J"]


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("element", ["displacement", "mixed"])
def test_a_process_may_have_no_cell(element, degree):
    scene, shared = sheared_cell(MPI.COMM_WORLD, degree, element)
    cells = scene.mesh.comm.allgather(scene.mesh.domain.topology.index_map(3).size_local)
    assert sorted(cells) == [0] * (len(cells) - 1) + [1]
    assert shared == pytest.approx(sheared_cell(MPI.COMM_SELF, degree, element)[1], rel=1e-9)


def two_squeezed_blocks(comm, ranks=None):
    """The smallest J of two blocks of two cells, far from one another and squeezed by 5 and 10 %."""
    cells = {"lower": (1.0,) * 3, "lower_cells": (1, 1, 2), "lower_origin": (0.0,) * 3, "upper": (1.0,) * 3}
    cells |= {"upper_cells": (1, 1, 2), "upper_origin": (0.0, 0.0, 2.0)}
    mesh = read_gmsh(two_blocks.build, comm, ranks=ranks, **cells)
    scene = Scene(*(Body(mesh, name, rubber(20 * MU)) for name in ("lower", "upper")), element="mixed")
    for name, moved in (("lower_bottom", 0.0), ("lower_top", -0.05), ("upper_bottom", 0.0), ("upper_top", -0.1)):
        scene.fix(name, "xy")
        scene.prescribe(name, "z", moved)
    return solve(scene, steps=1, method=Method(tolerance=1e-11)).require().history[-1]["smallest_J"]


@pytest.mark.parallel
def test_a_process_may_be_given_no_body():
    """Four cells, all on one process, whichever it is."""
    alone = two_squeezed_blocks(MPI.COMM_SELF)
    for rank in range(MPI.COMM_WORLD.size):
        assert two_squeezed_blocks(MPI.COMM_WORLD, {"lower": rank, "upper": rank}) == pytest.approx(alone, rel=1e-9)


@pytest.mark.parallel
def test_tetrahedra_of_degree_2_have_gauss_points_by_default():
    """Their corners have no area of their own: nodes that are asked for are refused by the contact's name."""
    scene = Scene(Body(read_gmsh(draw_tetrahedra), "box", rubber()), degree=2)
    scene.contact("zmax", rigid_plane((0, 0, 1.0), (0, 0, -1.0), name="lid"), name="lid")
    assert scene.contacts[0].points == 3
    scene.fix("zmin")
    scene.system()
    with pytest.raises(SceneError, match=r"contact 'again': points=.*points=3"):
        scene.contact("zmax", rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="other"), points="nodes", name="again")
