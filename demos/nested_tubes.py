"""A rubber tube is inflated by a following pressure until it fills a wider one and swells with it.

Plane strain, quarter of both tubes: 80 to 90 mm and 100 to 110 mm, the paper's Mooney material, meshes that do not match.
The reference is the exact solution of the radial problem, which this script computes itself. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/nested_tubes.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fenics_contact import Body, Scene, mooney_paper, read_gmsh, solve
from fenics_contact.output.fields import exterior_surface
from fenics_contact.output.pictures import draw_body
from meshes import tubes

OUT = Path("results/nested_tubes")
A1, A2, K = 0.1863, 0.0098, 5.0
INNER, OUTER = (80.0, 90.0), (100.0, 110.0)
LARGEST = 140.0  # mm, inner radius at which the run ends
TABLE = {90.951: 0.018555, 104.0: 0.045330, 120.0: 0.064815, LARGEST: 0.079361}  # inner radius [mm]: pressure [MPa]


def stress(radial, hoop):
    """Nominal stresses (radial, hoop) [MPa] in plane strain at principal stretches, of Psi in (22)."""
    J = radial * hoop
    B = np.array([radial**2, hoop**2, 1.0 + 0.0 * J]) * J ** (-2 / 3)
    tau = 2 * A1 * (B - B.sum() / 3) + 4 * A2 * (B**2 - (B**2).sum() / 3) + K * J * (J - 1)
    return tau[0] / radial, tau[1] / hoop


def through_wall(tube, inside, radial):
    """Integrate equilibrium dP/dR = (Q - P)/R outwards from deformed radius `inside` and its radial stretch.

    Returns the deformed outer radius [mm], Cauchy's radial stress inside and outside [MPa].
    """

    def slope(R, y):
        hoop, tiny = y[0] / R, 1e-30  # derivatives by a complex step are exact
        P, Q = stress(y[1], hoop)
        by_radial = stress(y[1] + 1j * tiny, hoop)[0].imag / tiny
        by_hoop = stress(y[1], hoop + 1j * tiny)[0].imag / tiny
        return y[1], ((Q - P) / R - by_hoop * (y[1] - hoop) / R) / by_radial

    ends = solve_ivp(slope, tube, (inside, radial), rtol=1e-10, atol=1e-10).y
    cauchy = [stress(s, r / R)[0] * R / r for R, r, s in zip(tube, ends[0, [0, -1]], ends[1, [0, -1]], strict=True)]
    return ends[0, -1], *cauchy


def contact_pressure(radius):
    """Pressure [MPa] that widens the outer tube's inside to `radius`: none is left outside."""
    if radius <= OUTER[0]:
        return 0.0
    free = brentq(lambda s: through_wall(OUTER, radius, s)[2], 0.3, 1.2)
    return -through_wall(OUTER, radius, free)[1]


def exact(m):
    """Pressure inside, interface radius and contact pressure [MPa, mm, MPa] at inner radius m [mm]."""

    def unbalanced(s):
        interface, _, outside = through_wall(INNER, m, s)
        return outside + contact_pressure(interface)

    s = brentq(unbalanced, 0.3, 1.2)
    interface, inside, _ = through_wall(INNER, m, s)
    return -inside, interface, contact_pressure(interface)


def inflate(cells, points, times=15, out=None):
    """Inner radius [mm], pressure, contact pressure [MPa] at the end of each step, and scene and result.

    cells: around inner and outer tube; a fifth of it through the wall.
    """
    depth = 100.0 * np.pi / 2 / max(cells)
    walls = {name: (*tube, n, max(n // 8, 1)) for name, tube, n in zip(("inner", "outer"), (INNER, OUTER), cells, strict=True)}
    mesh = read_gmsh(tubes.build, tubes=walls, depth=depth)
    rubber = mooney_paper(A1, A2, K)
    scene = Scene(Body(mesh, "inner", rubber), Body(mesh, "outer", rubber))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("ends", "z")
    scene.pressure("inner_inside", exact(LARGEST)[0])
    scene.contact("inner_outside", "outer_inside", points=points, name="interface")
    result = solve(scene, steps=times, out=out, progress=False)
    return scene, result
