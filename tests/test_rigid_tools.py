"""Bores, profiles and unions as tools of scenes: against a closed form, and against the same tool said otherwise."""

import numpy as np
import pytest

from fenics_contact import (
    Body,
    Scene,
    from_elastic,
    read_gmsh,
    rigid_cylinder,
    rigid_extrusion,
    rigid_plane,
    rigid_revolution,
    rigid_sphere,
    rigid_union,
    solve,
)
from meshes import box, tubes

pytestmark = pytest.mark.parallel

INNER, OUTER, E, NU, P = 4.0, 6.0, 1000.0, 0.3, 0.1
ALONG = {"axis": (0.0, 0.0, 1.0)}
BORES = {
    "hollow cylinder": rigid_cylinder(OUTER, (0, 0, 0), (0, 0, 1), hollow=True),
    "turned profile": rigid_revolution([(OUTER, 0), (OUTER, 1)]),
    "union": rigid_union(rigid_cylinder(OUTER, (0, 0, 0), (0, 0, 1), hollow=True), rigid_sphere(1.0, (0, 0, 99))),
}


def pressed_into(bore, around):
    """Quarter of a tube, inflated in a bore that it fills: mean contact pressure [MPa]."""
    mesh = read_gmsh(tubes.build, tubes={"tube": (INNER, OUTER, around, around // 2)}, depth=1.0)
    scene = Scene(Body(mesh, "tube", from_elastic(E, NU)))
    for group, axis in (("symmetry_x", "x"), ("symmetry_y", "y"), ("ends", "z")):
        scene.fix(group, axis)
    scene.pressure("tube_inside", P)
    scene.contact("tube_outside", bore, penetration=1e-9, name="bore")
    result = solve(scene, steps=1, progress=False)
    assert result.converged, result.verdict.reason
    return result.column("bore_load_N")[-1] / (0.5 * np.pi * OUTER)


def test_tube_inflated_in_a_bore():
    """Against Lame's tube whose outside cannot move, which presses by 2 (1 - nu) p / (1 + (1 - 2 nu) b^2 / a^2)."""
    exact = 2.0 * (1.0 - NU) * P / (1.0 + (1.0 - 2.0 * NU) * (OUTER / INNER) ** 2)
    coarse, fine = (pressed_into(BORES["hollow cylinder"], around) / exact - 1.0 for around in (6, 12))
    # chords: second order, 4 under halving; strains of 1e-4 leave as much of a small-strain formula
    assert abs(fine) < 5e-3 and 3.5 < coarse / fine < 4.5
    for name in ("turned profile", "union"):
        assert abs(pressed_into(BORES[name], 6) / exact - 1.0 - coarse) < 1e-8, name  # Newton's tolerance


def test_a_flat_profile_is_a_plane():
    """A rough block pressed and drawn, forces and slips by Newton's tolerance."""
    mesh, found = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1)), []
    for tool in (rigid_plane(), rigid_extrusion([(-1, 0), (1, 0)], (0.3, 0, 0), along=(0.6, 0.8, 0.0))):
        scene = Scene(Body(mesh, "box", from_elastic(E, NU)))
        scene.fix("zmax")
        scene.contact("zmin", tool, 0.3, name="floor")
        way = lambda t: (0.1 * max(t - 0.5, 0.0), 0.0, 0.02 * min(2 * t, 1.0))  # noqa: E731
        result = solve(scene, move={tool: way}, steps=4, progress=False)
        assert result.converged, result.verdict.reason
        found.append(
            np.column_stack([result.column(f"floor_{what}") for what in ("force_x_N", "force_z_N", "mean_slip_mm")])
        )
    np.testing.assert_allclose(found[0], found[1], atol=1e-8 * np.abs(found[0]).max())
    assert found[0][-1, 2] > 0.0
