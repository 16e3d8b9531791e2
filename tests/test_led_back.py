"""Points that slip are led back or aside: with multipliers their friction goes with the slip, at any penalty."""

import numpy as np
import pytest

from fenics_contact import Body, Penalty, Scene, Stage, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.contact.partner import strayed
from fenics_contact.meshes import box, rectangles, two_blocks

pytestmark = pytest.mark.parallel
ALLOWED = 1e-5  # [mm]
SOFT = Penalty(factor=100.0, share=0.001)  # in stick so soft that multipliers carry nearly all of what there is
RUBBER, YOUNG = neo_hooke(0.5, K=1.0), 9.0 * 0.5 / 3.5
CELL, WIDTH = 1.0 / 3.0, 2.0
# a sole that lies elsewhere by what is allowed strains the cells above it, and all of them at most
FORCE = YOUNG * ALLOWED / CELL * WIDTH


def strip(below, **options):
    """A block of rubber on a rough floor: a tool, or a body a hundred times as stiff."""
    parts = {"b": ((0.0, 0.0), (2.0, 1.0), (6, 3))}
    if below == "body":
        parts["l"] = ((-1.0, -1.0), (4.0, 1.0), (10, 2))
    mesh = read_gmsh(rectangles.build, rectangles=parts)
    bodies = [Body(mesh, "b", RUBBER)] + [Body(mesh, "l", neo_hooke(50.0, K=100.0))] * (below == "body")
    scene = Scene(*bodies, plane="strain")
    scene.fix("b_ymax")
    if below == "body":
        scene.fix("l_ymin")
    floor = "l_ymax" if below == "body" else rigid_plane((0, 0, 0), (0, 1, 0), name="floor")
    scene.contact("b_ymin", floor, friction=0.3, name="c", penetration=ALLOWED, **options)
    return scene


def led(scene, top, *ways):
    """Steps of a run that leads the top along ways, each in one step."""
    stages = [
        Stage(f"w{i}", prescribe={(top, axis): w for axis, w in zip("xyz", way, strict=False)}, steps=1)
        for i, way in enumerate(ways)
    ]
    return solve(scene, stages=stages).require()


@pytest.mark.parametrize(
    ("below", "options"),
    [("tool", {}), ("tool", {"points": 1}), ("body", {})],
    ids=["nodes", "Gauss points", "averages"],
)
def test_friction_works_on_nothing_that_is_led_back(below, options):
    """Dragged, then lifted and led back in one step: the limit falls below the friction that there was, which must not take
    its points along. They stick, as on stiff penalties."""
    ways, results = ((0.0, -0.1), (0.4, 0.0), (-0.12, 0.05)), {}
    for name, penalty in (("default", None), ("soft", SOFT)):
        result = led(strip(below, penalty=penalty, **options), "b_ymax", *ways)
        work, limit = result.column("c_friction_work_Nmm"), 0.3 * result.column("c_force_y_N")[-1]
        assert work[-1] - work[-2] >= -limit * ALLOWED  # no more than on what is allowed
        assert result.column("c_sticking_points")[-1] > 0.5 * result.column("c_active_points")[-1]
        results[name] = result.column("c_force_x_N")[-1]
    assert abs(results["soft"] - results["default"]) < FORCE and results["soft"] > 0.0


def cube(below, degree=1, **options):
    """A cube of rubber with a rough sole on a tool or a stiffer body."""
    if below == "tool":
        mesh, top, sole, floor = read_gmsh(box.build, size=(2, 2, 1), cells=(2, 2, 2)), "zmax", "zmin", rigid_plane()
        scene = Scene(Body(mesh, "box", RUBBER))
    else:
        shape = {"lower": (4, 4, 1), "upper": (2, 2, 1), "lower_origin": (-1, -1, -1), "upper_origin": (0, 0, 0)}
        mesh = read_gmsh(two_blocks.build, **shape, lower_cells=(4, 4, 1), upper_cells=(2, 2, 2))
        top, sole, floor = "upper_top", "upper_bottom", "lower_top"
        scene = Scene(Body(mesh, "upper", RUBBER), Body(mesh, "lower", neo_hooke(50.0, K=100.0)), degree=degree)
        scene.fix("lower_bottom")
    scene.fix(top)
    scene.contact(sole, floor, friction=0.3, name="c", penetration=ALLOWED, **options)
    return scene, top


@pytest.mark.parametrize(
    ("below", "options"),
    [("tool", {}), ("body", {}), ("body", {"points": 1}), ("body", {"points": 2, "degree": 2})],
    ids=["nodes", "averages", "Gauss points on facets", "Gauss points on facets of degree 2"],
)
def test_friction_turns_with_what_is_led_aside(below, options):
    """Dragged along x, then along y, then lifted and led back: the force turns as far as on stiffer penalties."""
    ways, forces = ((0.0, 0.0, -0.1), (0.3, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, -0.05, 0.05)), []
    for penalty in (None, Penalty(factor=100.0, share=0.01)):
        scene, top = cube(below, penalty=penalty, **options)
        result = led(scene, top, *ways)
        forces.append([result.column(f"c_force_{axis}_N") for axis in "xy"])
    np.testing.assert_allclose(*forces, atol=YOUNG * ALLOWED / 0.5 * WIDTH**2)


def test_what_strays_is_all_but_what_is_along_friction():
    pulled = np.array([[2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    slip = np.array([[3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [-3.0, 4.0, 0.0], [1.0, 2.0, 0.0]])
    np.testing.assert_array_equal(np.linalg.norm(strayed(pulled, slip), axis=1), [0.0, 4.0, 5.0, np.sqrt(5.0)])
