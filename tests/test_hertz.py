"""Smooth contact with known answers: Hertz's sphere and cylinder on a half-space, and a rubber cylinder between plates."""

import numpy as np
import pytest

from fenics_contact import Body, Scene, mooney_rivlin, read_gmsh, rigid_plane, solve
from fenics_contact.studies.hertz import DEPTH, STAR, A, R, hertz
from meshes import disc


def error(tool, cells):
    """Signed relative error of the force."""
    found = hertz(tool, cells, degree=1, points="nodes", factor=100.0, method="newton", steps=2, linear="direct")
    assert found["converged"], found["verdict"]
    exact = 4 / 3 * STAR * A**3 / R / 4 if tool == "sphere" else DEPTH * np.pi * STAR * A**2 / (4 * R) / 2
    return found["value"] / exact - 1


@pytest.mark.parametrize(("tool", "coarse", "fine"), [("sphere", 4, 8), ("cylinder", 4, 20)])
def test_force_within_one_percent_of_hertz_and_converging(tool, coarse, fine):
    first, last = error(tool, coarse), error(tool, fine)
    assert abs(last) < 0.01, (first, last)  # the bound
    assert abs(last) < 0.7 * abs(first), (first, last)


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
    result = solve(scene, move={plate: (0, 0, -3.2)}, steps=8, progress=False)
    assert result.converged, result.verdict.reason
    return -2 * result.history[-1]["rim_force_z_N"]  # both halves of the contact


def test_rubber_cylinder_between_plates():
    coarse, fine = squeezed_cylinder(6), squeezed_cylinder(16)
    assert abs(fine / 4.5622 - 1) < 0.01, (coarse, fine)  # the reference of an independent code
    assert abs(fine - 4.5622) < abs(coarse - 4.5622), (coarse, fine)
