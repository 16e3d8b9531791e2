"""Frictional contact with rigid planes against published and independent references."""

import numpy as np
import pytest

from fenics_contact import Body, Scene, from_elastic, mooney_rivlin, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box

pytestmark = pytest.mark.serial


def bottom(result, height):
    """Coordinates (n,) [mm] along the line y = height, z = 0, rising, and displacements (n, 3) there."""
    X = result.u.function_space.tabulate_dof_coordinates()
    here = np.flatnonzero((np.abs(X[:, 1] - height) < 1e-9) & (np.abs(X[:, 2]) < 1e-9))
    here = here[np.argsort(X[here, 0])]
    return X[here, 0], result.u.x.array.reshape(-1, 3)[here]


# x [mm] and slip [mm] (GRECO; code_aster V6.04.128, SSNV128)
PLATE = {0.0: 2.86e-2, 1.25: 2.72e-2, 5.0: 2.28e-2, 7.5: 1.98e-2, 11.25: 1.5e-2}


@pytest.mark.parametrize(("cells", "steps"), [(16, 1), (32, 1), (48, 1), (48, 4)])
def test_plate_pressed_on_a_rough_floor_and_pushed_from_the_side(cells, steps):
    """Sticking, slipping and lifted parts at once, loaded from nothing: no step is small enough to spare Newton the search.

    A second proportional step only goes on: points that slipped slip at its start.
    """
    mesh = read_gmsh(box.build, size=(40.0, 40.0, 40.0 / cells), cells=(cells, cells, 1))
    scene = Scene(Body(mesh, "box", from_elastic(1.3e5, 0.2)))
    scene.fix("xmax", "x")
    scene.fix(("zmin", "zmax"), "z")
    scene.traction("ymax", (0.0, -50.0, 0.0))
    scene.traction("xmin", (150.0, 0.0, 0.0))
    scene.contact("ymin", rigid_plane((0, 0, 0), (0, 1, 0)), friction=1.0, name="floor")
    result = solve(scene, steps=steps).require()
    x, u = bottom(result, 0.0)
    for place, slip in PLATE.items():
        assert abs(np.interp(place, x, u[:, 0]) / slip - 1) < 0.05, place  # the published tolerance
    assert result.verdict.cuts == 0
    assert all(row["iterations"] <= 5 for row in result.history[1:])


@pytest.mark.parametrize(("friction", "squeeze", "force"), [(0.1, 0.025, 0.8298), (0.1, 0.05, 1.7312), (0.0, 0.1, 3.40456)])
def test_block_between_two_plates(friction, squeeze, force):
    """Plane strain, 20 x 10 mm, a quarter: force per depth [N/mm]; without friction the closed form, 10 % of 20 mm."""
    mesh = read_gmsh(box.build, size=(10.0, 5.0, 0.25), cells=(40, 20, 1))
    scene = Scene(Body(mesh, "box", mooney_rivlin(0.1863, 0.0098, 5.0)))
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    scene.fix(("zmin", "zmax"), "z")
    plate = rigid_plane((0, 5.0, 0), (0, -1, 0), name="plate")
    scene.contact("ymax", plate, friction, name="plate")
    result = solve(scene, move={plate: (0, -5.0 * squeeze, 0)}, steps=4).require()
    ours = -2 * result.history[-1]["plate_force_y_N"] / 0.25
    assert abs(abs(ours) / force - 1) < 0.01
