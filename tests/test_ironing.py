"""Shallow ironing (Fischer & Wriggers 2006), its beginning: nothing typed, and the force that no penalty would give."""

import numpy as np
import pytest

from demos import ironing
from fenics_contact import Body, Penalty, Scene, from_elastic, read_gmsh, solve
from meshes import ironing as mesh_script


def pressed_and_drawn(**penalty):
    """Vertical force [N/mm] when pressed by 1 mm and when drawn by 0.25 mm."""
    mesh = read_gmsh(mesh_script.build)
    block, indenter = from_elastic(ironing.BLOCK, ironing.NU), from_elastic(ironing.INDENTER, ironing.NU)
    scene = Scene(Body(mesh, "foundation", block), Body(mesh, "indenter", indenter), plane="strain")
    scene.fix("foundation_bottom")
    scene.prescribe("indenter_top", "x", ironing.path([0, 0, ironing.DRAW, ironing.DRAW]))
    scene.prescribe("indenter_top", "y", ironing.path([0, -ironing.PRESS, -ironing.PRESS, 0]))
    scene.contact("foundation_top", ("indenter_under", "indenter_flanks"), ironing.FRICTION, name="c", **penalty)
    times = np.array([*np.linspace(0.1, 1.0, 10), 1.0125, 1.025]) / 3
    result = solve(scene, steps=times, progress=False)
    assert result.converged, result.verdict.reason
    force = -result.column("c_force_y_N")
    return np.interp(np.array([1.0, 1.025]) / 3, result.column("t"), force)


@pytest.mark.serial
def test_force_at_the_default_penalty_is_that_of_none():
    default, stiffer = pressed_and_drawn(), pressed_and_drawn(penalty=Penalty(factor=300.0))
    # a penalty's error goes with its inverse: what three times the penalty changes is two thirds of it
    unbent = default + 1.5 * (stiffer - default)
    assert np.abs(default / unbent - 1).max() < 0.01  # asked of a default
    assert (default < unbent).all()  # a spring in series makes it softer, never stiffer
