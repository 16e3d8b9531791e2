"""Friction works where something slides, and nowhere else."""

import numpy as np
import pytest

from fenics_contact import Body, Method, Scene, mooney_rivlin, read_gmsh, solve
from fenics_contact.assembly.pose import rotation
from fenics_contact.meshes import two_blocks

RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)

# times at which a pair has been pressed, slid, held still, and turned by 90 degrees
PRESSED, SLID, HELD, TURNED = 0.2, 0.4, 0.6, 1.0
TIMES = [
    0.1,
    PRESSED,
    *np.linspace(PRESSED, SLID, 5)[1:],
    *np.linspace(SLID, HELD, 21)[1:],
    *np.linspace(HELD, TURNED, 7)[1:],
]


def slid_pair(degree, points, **contact):
    """Two blocks, one pressed by 1.5 mm and dragged over the other by 6 mm, then held, then turned as they are about an
    oblique axis."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(4, 4, 1), upper_cells=(3, 3, 1))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), degree=degree)

    def moved(X, t, leads):
        place = X + leads * np.array([6.0 * np.clip((t - PRESSED) / (SLID - PRESSED), 0, 1), 0, -1.5 * min(t / PRESSED, 1)])
        turn = rotation(0.5 * np.pi * max(t - HELD, 0.0) / (TURNED - HELD) * np.array([1.0, 2.0, 2.0]) / 3.0)
        return place @ turn.T - X

    for face, leads in (("lower_bottom", 0.0), ("upper_top", 1.0)):
        for i, axis in enumerate("xyz"):
            scene.prescribe(face, axis, lambda X, t, i=i, leads=leads: moved(X, t, leads)[:, i])
    scene.contact("upper_bottom", "lower_top", 0.5, name="c", points=points, **contact)
    return solve(scene, steps=TIMES, method=Method(tolerance=1e-10))


@pytest.mark.parametrize(
    ("degree", "points", "contact"), [(1, 3, {}), (1, "corners", {}), (2, 3, {}), (1, 2, {"penetration": 1e-3})]
)
def test_what_is_held_or_turned_as_it_is_does_not_slide(degree, points, contact):
    """Anchors of points whose normal is not their facet's trail along it, too: each step accepted counted that as slip, and
    friction's work and the greatest slip grew without any motion."""
    result = slid_pair(degree, points, **contact)
    assert result.converged
    t = result.column("t")
    for name in ("c_friction_work_Nmm", "c_greatest_slip_mm"):
        column = result.column(name)
        slid = column[np.isclose(t, SLID)][0]
        assert slid > 0.0
        assert np.abs(column[t > SLID] - slid).max() < 1e-6 * slid
