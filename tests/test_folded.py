"""A coarse block under a ball: what folds over a tool or lets it through between nodes is no solution."""

import numpy as np
import pytest

from fenics_contact import Body, Scene, neo_hooke, read_gmsh, rigid_cylinder, rigid_sphere, solve
from fenics_contact.meshes import box

pytestmark = pytest.mark.parallel

HEIGHT = 3.0


def pressed(tool_of, deep, steps, friction=0.5, points=None):
    """Result of a tool pressed into the top of a block of coarse cells."""
    scene = Scene(Body(read_gmsh(box.build, size=(5.0, 5.0, HEIGHT), cells=(6, 6, 4)), "box", neo_hooke(mu=0.7, K=5.0)))
    scene.fix("zmin")
    tool = tool_of()
    scene.contact("zmax", tool, friction, points=points, name="top")
    return solve(scene, move={tool: (0, 0, -deep)}, steps=steps, progress=False)


def ball(radius, aside=0.0):
    return lambda: rigid_sphere(radius, (2.5 + aside, 2.5, HEIGHT + radius), name="ball")


def test_a_surface_that_has_folded_over_a_ball_is_no_solution():
    """In large steps there are balances with a fifth of the force and an inner node in the ball, in small ones not."""
    far, near = pressed(ball(1.5), 2.4, 2).require(), pressed(ball(1.5), 2.4, 24).require()
    assert far.column("top_force_z_N")[-1] == pytest.approx(near.column("top_force_z_N")[-1], rel=0.02)
    assert not any("inner node" in note for note in far.verdict.notes)


def bar():
    return rigid_cylinder(0.7, (2.8, 2.5, HEIGHT + 0.7), (0, 1, 0), name="bar")


@pytest.mark.parametrize("tool, deep", [(ball(1.0, 0.1), 1.8), (bar, 1.5)])
def test_a_tool_that_comes_in_between_nodes_is_named_and_gauss_points_hold_it(tool, deep):
    result = pressed(tool, deep, 4, 0.3)
    assert result.verdict.kind == "projection lost" and "take points=3 (Gauss points)" in result.verdict.remedy
    assert any("between nodes the surface hangs" in note for note in result.verdict.notes)
    force = [pressed(tool, deep, steps, 0.3, points=3).require().column("top_force_z_N")[-1] for steps in (4, 20)]
    assert force[0] == pytest.approx(force[1], rel=0.03) and abs(force[1]) > 3.0 * abs(result.column("top_force_z_N")[-1])


def test_penalties_raised_in_vain_are_raised_half_as_far_later():
    """The first step is too large for them, with softer ones on the way to it too."""
    one, many = pressed(ball(1.5, 0.2), 2.0, 1, 0.0, 3).require(), pressed(ball(1.5, 0.2), 2.0, 20, 0.0, 3).require()
    assert sum("penalties stay in this step" in note for note in one.verdict.notes) == 1
    assert sum("penalties raised" in note for note in one.verdict.notes) > 1
    np.testing.assert_allclose(one.column("top_force_z_N")[-1], many.column("top_force_z_N")[-1], rtol=0.05)
