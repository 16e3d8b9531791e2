"""Shallow ironing (Fischer & Wriggers 2006), its beginning: nothing typed, and the force that no penalty would give."""

import numpy as np
import pytest

from demos import ironing
from fenics_contact import Body, Penalty, Scene, Stage, from_elastic, read_gmsh, solve
from fenics_contact.meshes import ironing as mesh_script


def pressed_and_drawn(**penalty):
    """Vertical force [N/mm] when pressed by 1 mm and when drawn by 0.25 mm."""
    mesh = read_gmsh(mesh_script.build)
    block, indenter = from_elastic(ironing.BLOCK, ironing.NU), from_elastic(ironing.INDENTER, ironing.NU)
    scene = Scene(Body(mesh, "foundation", block), Body(mesh, "indenter", indenter), plane="strain")
    scene.fix("foundation_bottom")
    scene.fix("indenter_top")
    scene.contact("foundation_top", ("indenter_under", "indenter_flanks"), ironing.FRICTION, name="c", **penalty)
    press = Stage("press", prescribe={("indenter_top", "y"): -ironing.PRESS}, steps=10)
    draw = Stage("draw", prescribe={("indenter_top", "x"): 0.25}, steps=2)
    result = solve(scene, stages=[press, draw])
    assert result.converged, result.verdict.reason
    return -np.array([result.column("c_force_y_N", stage)[-1] for stage in ("press", "draw")])


@pytest.mark.serial
def test_force_at_the_default_penalty_is_that_of_none():
    default, stiffer = pressed_and_drawn(), pressed_and_drawn(penalty=Penalty(factor=300.0))
    # a penalty's error goes with its inverse: what three times the penalty changes is two thirds of it
    unbent = default + 1.5 * (stiffer - default)
    assert np.abs(default / unbent - 1).max() < 0.01  # asked of a default
    assert (default < unbent).all()  # a spring in series makes it softer, never stiffer
