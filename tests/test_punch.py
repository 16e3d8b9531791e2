"""The quarter plate under a square punch: parity with other codes, the sharp edge, fillet, refinement and Newton."""

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import Body, Method, Scene, mooney_paper, mooney_rivlin, read_gmsh, rigid_plane, rigid_punch, solve
from fenics_contact.meshes import punch_plate
from fenics_contact.solvers import corrections
from fenics_contact.solvers.control import run
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton

MOONEY = {"a1": 0.1863, "a2": 0.0098, "K": 5.0}  # MPa
# Five codes on the 20 x 20 x 5 mesh with a fixed list of nodes
PARITY = [13.682973, 27.925831, 42.772727, 58.273222, 74.483030, 91.464841, 109.289233, 128.035718, 147.793924, 168.664975]
# Graded second-order references of a real, sharp punch, 145 +- 1.5 N
SHARP = np.array([12.95, 26.1, 39.5, 53.2, 67.5, 82.3, 97.0, 112.5, 128.2, 145.0])
UNIFORM = {"inside": 10, "outside": 10, "layers": 5, "ratio": 1.0}
GRADED = {"inside": 12, "outside": 10, "layers": 6, "ratio": 1.1}
COARSE = {"inside": 6, "outside": 5, "layers": 3, "ratio": 1.1}


def plate(mesh, material=mooney_rivlin, floor=None):
    """Quarter plate on symmetry planes; its bottom held in z, or resting on a unilateral plane with friction `floor`."""
    scene = Scene(Body(mesh, "plate", material(**MOONEY)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    if floor is None:
        scene.fix("bottom", "z")
    else:
        scene.contact("bottom", rigid_plane(name="floor"), floor, name="bottom")
    return scene


def punched(parameters, friction=0.0, fillet=0.0, depth=2.0, steps=10, tolerance=1e-8, **options):
    scene = plate(read_gmsh(punch_plate.build, **parameters), **options)
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10), fillet=fillet)
    scene.contact("top", punch, friction, name="top")
    result = solve(scene, move={punch: (0, 0, -depth)}, steps=steps, method=Method(tolerance=tolerance))
    assert result.converged, result.verdict.reason
    return result


def forces(result):
    return -result.column("top_force_z_N")


def rise_at(system, point):
    """Vertical displacement of the node at a reference point [mm]; the same on all ranks."""
    X = system.space.tabulate_dof_coordinates()
    near = np.flatnonzero(np.linalg.norm(X - point, axis=1) < 1e-6)
    values = [v for part in system.comm.allgather(system.state.u.x.array[3 * near + 2].tolist()) for v in part]
    assert values, f"no node at {point}"
    return values[0]


@pytest.mark.parallel
def test_parity_with_five_codes_to_all_printed_digits():
    scene = plate(read_gmsh(punch_plate.build, **UNIFORM, patch=True))
    scene.prescribe("under_punch", "z", -2.0)
    system = scene.system()
    X = system.space.tabulate_dof_coordinates()
    dofs = system.supports.dofs
    pressed = (dofs % 3 == 2) & (X[dofs // 3][:, 2] > 9.0) & np.isin(dofs, system.supports.owned)
    measured = []

    def on_step(*_):
        measured.append(-system.comm.allreduce(system.reactions[pressed].sum(), op=MPI.SUM))

    # 1e-11 of the largest force, so that the nine digits printed do not depend on where Newton stopped
    assert run(system, Newton(LinearSolver(system), tolerance=1e-11), np.arange(1, 11) / 10, on_step).converged
    np.testing.assert_allclose(measured, PARITY, rtol=0, atol=6e-7)  # half a unit of the last digit, and round-off
    assert round(rise_at(system, (40, 40, 10)), 5) == 0.02520
    assert round(rise_at(system, (30, 0, 10)), 5) == -0.22159


@pytest.fixture(scope="module")
def graded():
    return punched(GRADED)


@pytest.fixture(scope="module")
def uniform():
    return punched(UNIFORM)


def test_sharp_punch_on_the_uniform_mesh(uniform):
    np.testing.assert_allclose(forces(uniform)[-1], SHARP[-1], rtol=0.03)  # required
    assert_smooth(forces(uniform))


def test_sharp_punch_on_the_graded_mesh(graded):
    np.testing.assert_allclose(forces(graded)[-1], SHARP[-1], rtol=0.03)  # required
    np.testing.assert_allclose(forces(graded), SHARP, rtol=0.06)  # a mesh of degree 1 is stiff by up to 6 % (parity)
    assert_smooth(forces(graded))


def assert_smooth(sequence):
    """Increments vary from step to step no more than the reference's own, whose digits are rounded."""
    allowed = np.abs(np.diff(SHARP, n=2, prepend=0.0)[1:]).max()
    changes = np.diff(sequence, n=2, prepend=0.0)[1:]
    assert np.abs(changes).max() < allowed, changes


def test_fine_steps_show_no_jump():
    """Forty steps while a row of nodes slides out: no increment of the force strays from the mean of its neighbours."""
    result = punched({"inside": 16, "outside": 6, "layers": 3, "ratio": 1.0}, steps=40)
    active = result.column("top_active_points")
    assert active[-1] < active[0]  # nodes did lose contact
    increments = np.diff(forces(result), prepend=0.0)
    strays = np.abs(increments[1:-1] - 0.5 * (increments[:-2] + increments[2:]))
    # the edge row carries tens of N: dropped node by node it would change increments (3.8 N) by their own size
    assert strays.max() < 0.05 * increments.mean(), strays.max() / increments.mean()


def test_refinement_approaches_the_reference(graded, uniform):
    coarse, medium, fine = (abs(forces(run)[-1] - SHARP[-1]) for run in (punched(COARSE), uniform, graded))
    assert medium < 0.5 * coarse  # cells at the edge 2.6 and 2 mm wide
    assert fine < max(medium, 1.5)  # 1.5 N: the reference's own uncertainty


def test_fillet_lowers_the_first_force_and_is_named(graded):
    rounded = punched(GRADED, fillet=1.0, depth=0.2, steps=1)
    assert 0.05 < 1.0 - forces(rounded)[0] / forces(graded)[0] < 0.13  # two codes: 8 to 10 %, here on a coarse mesh
    edges = [result.summary["scene"]["contacts"][0]["tool_edge"] for result in (graded, rounded)]
    assert edges[0] == "sharp" and edges[1].startswith("filleted")


@pytest.mark.slow
def test_corner_lifts_off_a_frictionless_floor():
    result = punched(GRADED, floor=0.0)
    assert 2.4 <= rise_at(result.system, (40, 40, 0)) <= 2.9  # two codes


@pytest.mark.parallel
@pytest.mark.parametrize("case", [(0.0, 0.0), (0.3, 0.0), (1.0, 0.0), (0.0, 1.0)])
def test_newton_is_quadratic_in_the_demos_cases(case, monkeypatch):
    # each residual is what a tangent of its own left
    monkeypatch.setattr(corrections, "CORRECTED", dict.fromkeys(corrections.CORRECTED, (0.0, 0.0)))
    result = punched(COARSE, friction=case[0], floor=case[1], material=mooney_paper, tolerance=1e-11)
    assert result.column("iterations").mean() <= 6.0
    for residuals in result.summary["residuals_per_step"]:
        falls = [(a, b) for a, b in zip(residuals, residuals[1:], strict=False) if a < 1e-2][-2:]
        for before, after in falls:
            # shares of the force: the constant is 0.02 to 200 here, where a tangent off by a hundredth gives 1e4 and
            # more near the end; 1e-12: round-off
            assert after <= 1e3 * before**2 + 1e-12, residuals
        assert falls and residuals[-1] <= 1e-11, residuals
