"""Strain energies per reference volume: one function, one equation.

An isotropic energy is written in the invariants of the paper, taken on the volume-preserving part B^ = J^(-2/3) B of
the left Cauchy-Green tensor: I1 = tr B^, I2 = tr(B^ . B^) and J (paper, section 3). Moduli and the energy itself are in
units of pressure (MPa with lengths in mm and forces in N).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import ufl


@dataclass(frozen=True)
class Isotropic:
    """Energy psi(I1, I2, J) [pressure] of the paper's invariants; `moduli` are (shear, bulk) at rest [pressure]."""

    name: str
    psi: Callable
    shear_modulus: float
    bulk_modulus: float


@dataclass(frozen=True)
class Hyperelastic:
    """Any energy psi(F) [pressure], a UFL function of the deformation gradient; its moduli at rest scale penalties."""

    name: str
    psi: Callable
    shear_modulus: float
    bulk_modulus: float


def _positive(law, **moduli):
    for name, value in moduli.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{law}: {name} = {value} must be a positive modulus in units of pressure")


def _finite(law, **parameters):
    for name, value in parameters.items():
        if not math.isfinite(value):
            raise ValueError(f"{law}: {name} = {value} must be a finite number in units of pressure")


def _stable(law, shear):
    if not shear > 0.0:
        raise ValueError(f"{law}: the shear modulus at rest is {shear}; choose parameters that make it positive")


def moderate_pressure(J, K):
    """Psi_0 = K/2 (J - 1)^2, (21)."""
    return K / 2 * (J - 1) ** 2


def mooney_paper(a1, a2, K):
    """Psi = a1 (I1 - 3) + a2 (tr(B^.B^) - 3) + K/2 (J - 1)^2, (22), with the paper's second invariant tr(B^ . B^).

    The shear modulus at rest is 2 a1 + 8 a2. All parameters in units of pressure; ValueError if not positive.
    """
    _positive("mooney_paper", a1=a1, K=K)
    _finite("mooney_paper", a2=a2)
    _stable("mooney_paper", 2 * a1 + 8 * a2)

    def psi(I1, I2, J):
        return a1 * (I1 - 3) + a2 * (I2 - 3) + moderate_pressure(J, K)

    return Isotropic(f"Mooney, I2 = tr(B.B), a1 = {a1}, a2 = {a2}, K = {K}", psi, 2 * a1 + 8 * a2, K)


def mooney_rivlin(a1, a2, K):
    """Psi = a1 (I1 - 3) + a2 ((I1^2 - tr(B^.B^))/2 - 3) + K/2 (J - 1)^2: classical Mooney (1940, doi:10.1063/1.1712836).

    The shear modulus at rest is 2 a1 + 2 a2. All parameters in units of pressure; ValueError if not positive.
    """
    _positive("mooney_rivlin", a1=a1, K=K)
    _finite("mooney_rivlin", a2=a2)
    _stable("mooney_rivlin", 2 * a1 + 2 * a2)

    def psi(I1, I2, J):
        return a1 * (I1 - 3) + a2 * ((I1**2 - I2) / 2 - 3) + moderate_pressure(J, K)

    return Isotropic(f"Mooney-Rivlin, classical I2, a1 = {a1}, a2 = {a2}, K = {K}", psi, 2 * (a1 + a2), K)


def neo_hooke(mu, K):
    """Psi = mu/2 (I1 - 3) + K/2 (J - 1)^2 (Treloar 1943, doi:10.1039/TF9433900036; volume term (21)), moduli in pressure."""
    _positive("neo_hooke", mu=mu, K=K)

    def psi(I1, I2, J):
        return mu / 2 * (I1 - 3) + moderate_pressure(J, K)

    return Isotropic(f"neo-Hooke, mu = {mu}, K = {K}", psi, mu, K)


def yeoh(c1, c2, c3, K):
    """Psi = sum c_i (I1 - 3)^i + K/2 (J - 1)^2 (Yeoh 1993, doi:10.5254/1.3538343), parameters in pressure, 2 c1 at rest."""
    _positive("yeoh", c1=c1, K=K)
    _finite("yeoh", c2=c2, c3=c3)

    def psi(I1, I2, J):
        return c1 * (I1 - 3) + c2 * (I1 - 3) ** 2 + c3 * (I1 - 3) ** 3 + moderate_pressure(J, K)

    return Isotropic(f"Yeoh, c1 = {c1}, c2 = {c2}, c3 = {c3}, K = {K}", psi, 2 * c1, K)


def from_elastic(E, nu):
    """Neo-Hooke with Young's modulus E [pressure] and Poisson's ratio nu at rest, for small-strain comparisons."""
    if not 0.0 < E < math.inf or not -1.0 < nu < 0.5:
        raise ValueError(f"from_elastic: E = {E} must be positive and nu = {nu} lie in (-1, 0.5)")
    return neo_hooke(E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu)))


def user_energy(psi, shear_modulus, bulk_modulus, name="user energy"):
    """A user's own UFL energy psi(F) [pressure]; the moduli at rest [pressure] are used for penalties only."""
    _positive(name, shear_modulus=shear_modulus, bulk_modulus=bulk_modulus)
    value = psi(ufl.Identity(3))
    if not isinstance(value, ufl.core.expr.Expr | float | int) or getattr(value, "ufl_shape", ()) != ():
        raise TypeError(f"{name}: psi(F) must return a scalar UFL expression of the deformation gradient F")
    return Hyperelastic(name, psi, shear_modulus, bulk_modulus)
