"""Smooth contact with known answers: Hertz's sphere and cylinder on a half-space, and a rubber cylinder between plates.

The half-space of Hertz is the block plus what lies outside it: the far faces are led along the displacement of a point
(Boussinesq) or line (Flamant) load of Hertz's force, the exact far field up to O((a / far)^2) of itself.
"""

import numpy as np
import pytest

from fenics_contact import (
    Body,
    Scene,
    from_elastic,
    mooney_rivlin,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_sphere,
    solve,
)
from meshes import disc, graded_block

E, NU = 1000.0, 0.3  # MPa
STAR = E / (1 - NU**2)
R, A = 100.0, 1.0  # tool radius and half-width of the contact [mm]: strains of A / R = 1 %
FAR = 8.0  # [mm], eight half-widths


def boussinesq(P):
    """Displacement (n, 3) of a half-space z < 0 under a point load P pressing down at the origin (Johnson 1985, 3.18)."""
    G = E / (2 * (1 + NU))

    def field(X):
        x, y, z = X[:, 0], X[:, 1], -X[:, 2]
        rho = np.sqrt(x**2 + y**2 + z**2)
        radial = z / rho**3 - (1 - 2 * NU) / (rho * (rho + z))
        down = z**2 / rho**3 + 2 * (1 - NU) / rho
        return P / (4 * np.pi * G) * np.column_stack([x * radial, y * radial, -down])

    return field


def flamant(P):
    """Displacement of a half-space z < 0 under a line load P per length along y (Johnson 1985, 2.19, C1 = C2 = C3 = 0)."""
    big, small = P * (1 - NU**2) / (np.pi * E), P * (1 + NU) / (np.pi * E)

    def field(X):
        x, z = X[:, 0], -X[:, 2]
        rho, angle = np.hypot(x, z), np.arctan2(x, z)
        ur = -2 * big * np.cos(angle) * np.log(rho) - small * (1 - 2 * NU) * angle * np.sin(angle)
        ut = 2 * big * np.sin(angle) * np.log(rho) + small * (
            2 * NU * np.sin(angle) - (1 - 2 * NU) * (angle * np.cos(angle) - np.sin(angle))
        )
        side = ur * np.sin(angle) + ut * np.cos(angle)
        down = ur * np.cos(angle) - ut * np.sin(angle)
        return np.column_stack([side, 0 * side, -down])

    return field


def pressed(mesh, tool, depth, field, faces):
    """Force [N] of a tool moved down by `depth` on a block whose far faces follow the field."""
    scene = Scene(Body(mesh, "block", from_elastic(E, NU)))
    scene.fix("xmin", "x")
    scene.fix("ymin", "y")
    if "ymax" not in faces:
        scene.fix("ymax", "y")
    for face in faces:
        for axis, letter in enumerate("xyz"):
            if letter == "y" and "ymax" not in faces:
                continue  # plane strain
            scene.prescribe(face, letter, lambda X, t, axis=axis: t * field(X)[:, axis])
    scene.contact("zmax", tool, name="top")
    result = solve(scene, move={tool: (0, 0, -depth)}, steps=2, progress=False)
    assert result.converged, result.verdict.reason
    return -result.history[-1]["top_force_z_N"]


def sphere_error(cells):
    depth = A**2 / R
    exact = 4 / 3 * STAR * np.sqrt(R) * depth**1.5 / 4  # a quarter
    mesh = read_gmsh(graded_block.build, fine=1.5 * A, cells=cells, far=FAR, growth=1.35)
    tool = rigid_sphere(R, (0, 0, R))
    return pressed(mesh, tool, depth, boussinesq(4 * exact), ("xmax", "ymax", "zmin")) / exact - 1


def cylinder_error(cells):
    P = np.pi * STAR * A**2 / (4 * R)  # a = 2 sqrt(P R / (pi E*))
    # the depth against the same far field: Hertz's pressure folded with Flamant's surface displacement
    depth = 2 * P / (np.pi * STAR) * (0.5 - np.log(A / 2)) - P * (1 + NU) / (np.pi * E)
    mesh = read_gmsh(graded_block.build, fine=1.5 * A, cells=cells, far=FAR, growth=1.2, depth=0.1)
    force = pressed(mesh, rigid_cylinder(R, (0, 0, R)), depth, flamant(P), ("xmax", "zmin"))
    return force / (0.1 * P / 2) - 1  # half of the cylinder


@pytest.mark.parametrize(("error", "coarse", "fine"), [(sphere_error, 4, 8), (cylinder_error, 4, 20)])
def test_force_within_one_percent_of_hertz_and_converging(error, coarse, fine):
    first, last = error(coarse), error(fine)
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
    assert abs(fine / 4.5622 - 1) < 0.01, (coarse, fine)  # the bound; targets.md
    assert abs(fine - 4.5622) < abs(coarse - 4.5622), (coarse, fine)
