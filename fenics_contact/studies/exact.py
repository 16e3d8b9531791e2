"""Exact solutions that studies compare with: radial problems of rubber, half-spaces under point, line and Hertz loads."""

from collections.abc import Callable
from typing import Any

import numpy as np

from fenics_contact.packages import require
from fenics_contact.types import Floats

require("scipy")
from scipy.integrate import solve_ivp  # noqa: E402 - after its package has been asked for
from scipy.optimize import brentq  # noqa: E402

A1, A2 = 0.1863, 0.0098  # Mooney's constants of the paper [MPa]
TINY = 1e-30  # derivatives by a complex step this small are exact

Field = Callable[[Floats], Floats]  # displacements (n, 3) at places (n, 3) [mm]


class Radial:
    """Spheres and, in plane strain, tubes of the paper's Mooney energy (22) that deform radially.

    kind: "sphere" or "tube"; K: bulk modulus [MPa]; reading: "A", I2 = tr(B.B), the paper's, or "B", the classical I2.
    Lengths in mm, stresses in MPa.
    """

    def __init__(self, kind: str, K: float, reading: str = "A") -> None:
        self.hoops, self.K, self.classical = {"sphere": 2, "tube": 1}[kind], K, {"A": False, "B": True}[reading]

    def nominal(self, radial: complex, hoop: complex) -> tuple[Any, Any]:
        """Nominal stresses (radial, hoop) at principal stretches."""
        other = hoop if self.hoops == 2 else 1.0
        J = radial * hoop * other
        B = np.array([radial**2, hoop**2, other**2 + 0.0 * J]) * J ** (-2 / 3)
        second = B.sum() * B - B**2 if self.classical else 2 * B**2  # half of B dI2/dB
        tau = 2 * A1 * (B - B.sum() / 3) + 2 * A2 * (second - second.sum() / 3) + self.K * J * (J - 1)
        return tau[0] / radial, tau[1] / hoop

    def through(self, wall: tuple[float, float], inside: float, radial: float) -> tuple[float, float, float]:
        """Integrate dP/dR = hoops (Q - P) / R over the wall (inner, outer radius) from the deformed inner radius and the
        radial stretch there: deformed outer radius and the Cauchy radial stress at both surfaces."""

        def slope(R: float, y: Floats) -> tuple[float, float]:
            hoop = y[0] / R
            P, Q = self.nominal(y[1], hoop)
            by_radial = self.nominal(y[1] + 1j * TINY, hoop)[0].imag / TINY
            by_hoop = self.nominal(y[1], hoop + 1j * TINY)[0].imag / TINY
            return y[1], (self.hoops * (Q - P) - by_hoop * (y[1] - hoop)) / (R * by_radial)

        ends = solve_ivp(slope, wall, (inside, radial), rtol=1e-10, atol=1e-12).y[:, [0, -1]]
        cauchy = [self.nominal(s, r / R)[0] * (R / r) ** self.hoops for R, (r, s) in zip(wall, ends.T, strict=True)]
        return ends[0, 1], *cauchy

    def solve(
        self, wall: tuple[float, float], inside: float, outer_pressure: Callable[[float], float] = lambda outside: 0.0
    ) -> tuple[float, float]:
        """(pressure inside, deformed outer radius) at a deformed inner radius; outer_pressure: function of outer radius."""

        def unbalanced(radial: float) -> float:
            outside, _, stress = self.through(wall, inside, radial)
            return stress + outer_pressure(outside)

        membrane = brentq(lambda s: self.nominal(s, inside / wall[0])[0], 0.05, 1.5)  # of a wall without thickness
        outside, stress, _ = self.through(wall, inside, brentq(unbalanced, 0.75 * membrane, 1.2 * membrane, xtol=1e-13))
        return -stress, outside


def boussinesq(P: float, E: float, nu: float) -> Field:
    """Displacement (n, 3) of a half-space z < 0 under a point load P pressing down at the origin (Johnson 1985, 3.18)."""
    G = E / (2 * (1 + nu))

    def field(X: Floats) -> Floats:
        x, y, z = X[:, 0], X[:, 1], -X[:, 2]
        rho = np.sqrt(x**2 + y**2 + z**2)
        radial = z / rho**3 - (1 - 2 * nu) / (rho * (rho + z))
        down = z**2 / rho**3 + 2 * (1 - nu) / rho
        return P / (4 * np.pi * G) * np.column_stack([x * radial, y * radial, -down])

    return field


def flamant(P: float, E: float, nu: float) -> Field:
    """Displacement of a half-space z < 0 under a line load P per length along y (Johnson 1985, 2.19, C1 = C2 = C3 = 0)."""
    big, small = P * (1 - nu**2) / (np.pi * E), P * (1 + nu) / (np.pi * E)

    def field(X: Floats) -> Floats:
        x, z = X[:, 0], -X[:, 2]
        rho, angle = np.hypot(x, z), np.arctan2(x, z)
        ur = -2 * big * np.cos(angle) * np.log(rho) - small * (1 - 2 * nu) * angle * np.sin(angle)
        ut = 2 * big * np.sin(angle) * np.log(rho) + small * (
            2 * nu * np.sin(angle) - (1 - 2 * nu) * (angle * np.cos(angle) - np.sin(angle))
        )
        side = ur * np.sin(angle) + ut * np.cos(angle)
        down = ur * np.cos(angle) - ut * np.sin(angle)
        return np.column_stack([side, 0 * side, -down])

    return field


def under_hertz(field: Field, a: float, line: bool = False) -> Field:
    """Displacement of a half-space under Hertz's pressure, p0 sqrt(1 - (r/a)^2), from `field`, that under its resultant.

    line: along y, as under a cylinder, else over a disc. Away from the contact the sums converge as (a/distance)^8.
    """
    if line:  # Gauss-Chebyshev, second kind
        angle = np.arange(1, 5) * np.pi / 5
        places, shares = a * np.column_stack([np.cos(angle), 0 * angle, 0 * angle]), 0.4 * np.sin(angle) ** 2
        return lambda X: sum(share * field(X - place) for place, share in zip(places, shares, strict=True))
    # a ring at r has the force 3 q^2 dq
    return _under_rings(field, a, 4, lambda q: 3 * q**2)


def under_cone(field: Field, a: float) -> Field:
    """The same under a cone's pressure, p proportional to arcosh(a/r) (Sneddon 1965, doi:10.1016/0020-7225(65)90019-4).

    A ring at r has the force 2 q artanh(q) dq, endless but integrable at the apex.
    """
    return _under_rings(field, a, 16, lambda q: 2 * q * np.arctanh(q))


def _under_rings(field: Field, a: float, count: int, force: Callable[[Floats], Floats]) -> Field:
    """Displacement under rings of the radii a sqrt(1 - q^2) that have the share force(q) dq of the load, 0 < q < 1."""
    points, halves = np.polynomial.legendre.leggauss(count)
    q, weights, turn = (1 + points) / 2, halves / 2, (np.arange(8) + 0.5) * np.pi / 4
    r, shares = a * np.sqrt(1 - q**2)[:, None], force(q) * weights
    places = np.stack([r * np.cos(turn), r * np.sin(turn), 0 * r * turn], axis=-1).reshape(-1, 3)
    shares = np.repeat(shares / (8 * shares.sum()), 8)
    return lambda X: sum(share * field(X - place) for place, share in zip(places, shares, strict=True))
