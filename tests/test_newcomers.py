"""Slave nodes that come under the master within a step rub with the rest: they have slid on it since the step began."""

import numpy as np
import pytest

from fenics_contact import Body, Scene, Stage, neo_hooke, read_gmsh, solve
from fenics_contact.meshes import rectangles, two_blocks

pytestmark = pytest.mark.parallel
FRICTION = 0.3


def dragged(steps, space=False, degree=1, triangles=False, points=None):
    """A block that is the master, pressed on a long pad and dragged over it."""
    if space:
        mesh = read_gmsh(two_blocks.build, lower=(4, 1.5, 0.8), lower_cells=(16, 3, 2), lower_origin=(0, -0.25, -0.8),
                         upper=(1.2, 1, 0.8), upper_cells=(4, 3, 2), upper_origin=(0.5, 0, 0))  # fmt: skip
        names, down = ("lower_bottom", "upper_top", "lower_top", "upper_bottom"), "z"
    else:
        drawn = {"lower": ((0.0, -0.8), (4.0, 0.8), (32, 4)), "upper": ((0.5, 0.0), (1.2, 0.8), (5, 3))}
        mesh = read_gmsh(rectangles.build, rectangles=drawn, triangles=triangles)
        names, down = ("lower_ymin", "upper_ymax", "lower_ymax", "upper_ymin"), "y"
    scene = Scene(
        Body(mesh, "lower", neo_hooke(0.5, 2.0)),
        Body(mesh, "upper", neo_hooke(2.0, 8.0)),
        degree=degree,
        plane=None if space else "strain",
    )
    bottom, top, slave, master = names
    scene.fix(bottom)
    scene.fix(top)
    scene.contact(slave, master, friction=FRICTION, points=points, name="c")
    stages = [Stage("press", prescribe={(top, down): -0.05}, steps=2)]
    stages += [Stage("drag", prescribe={(top, "x"): 1.6}, steps=steps)]
    return solve(scene, stages=stages).require()


CASES = {
    "2-D": {},
    "triangles": {"triangles": True},
    "degree 2": {"degree": 2},
    "3-D": {"space": True},
    "nodes": {"space": True, "points": "nodes"},
    "Gauss points": {"space": True, "points": 1},
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
@pytest.mark.parametrize("steps", [4, 8])
def test_what_comes_under_a_sliding_block_rubs_in_the_same_step(steps, case):
    """All slides: friction is its share of the pressures, of which a step of 0.4 brings a third anew."""
    result = dragged(steps, **case)
    rubs, presses = result.column("c_friction_x_N"), result.column("c_load_N")
    sliding = slice(2 + steps // 4, None)
    np.testing.assert_allclose(np.abs(rubs / presses)[sliding], FRICTION, rtol=0.01)


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_the_way_through_the_air_is_no_slip(slave):
    """A block that falls straight on a pad within one step, from however far beyond what is searched, presses alike."""

    def dropped(gap):
        drawn = {"lower": ((0.0, -2.0), (8.0, 2.0), (12, 4)), "upper": ((2.0, gap), (4.0, 3.0), (5, 4))}
        mesh = read_gmsh(rectangles.build, rectangles=drawn)
        bodies = (Body(mesh, name, neo_hooke(0.5, 2.5)) for name in ("lower", "upper"))
        scene = Scene(*bodies, plane="strain")
        scene.fix("lower_ymin")
        scene.fix("upper_ymax", "x")
        scene.prescribe("upper_ymax", "y", -gap - 0.4)
        sides = ("upper_ymin", "lower_ymax") if slave == "upper" else ("lower_ymax", "upper_ymin")
        scene.contact(*sides, friction=1.0, name="c")
        return solve(scene, steps=1).require().history[-1]

    near, far = dropped(3.0), dropped(12.0)
    assert near["c_sticking_points"] == far["c_sticking_points"] > 0
    np.testing.assert_allclose(far["c_load_N"], near["c_load_N"], rtol=2e-3)  # was 4 % less
    assert far["c_friction_work_Nmm"] < 1e-3 * far["c_load_N"]
