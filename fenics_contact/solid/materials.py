"""Strain energies per reference volume: one function, one equation.

An isotropic energy is written in the invariants of the paper, taken on the volume-preserving part B^ = J^(-2/3) B of
the left Cauchy-Green tensor: I1 = tr B^, I2 = tr(B^ . B^) and J (paper, section 3). Moduli and the energy itself are in
units of pressure (MPa with lengths in mm and forces in N).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.constantvalue import ConstantValue
from ufl.core.multiindex import MultiIndex
from ufl.corealg.traversal import traverse_unique_terminals

from fenics_contact.solid.powers import power_sum
from fenics_contact.types import Constant, Expr, Function
from fenics_contact.values import SceneError, finite, function, positive, text

CHAINS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)  # of the series of the inverse Langevin function
# volume without stress over that at the start, and the variable that energies have for it
Swelling = tuple[Constant | Function, Expr]


@dataclass(frozen=True)
class Isotropic:
    """Energy psi(I1, I2, J) [pressure] of the paper's invariants, moduli at rest [pressure].

    isochoric(I1, I2), volumetric(J): the two parts whose sum psi is, if it is one; elements that do not lock need them.
    swelling: of a body that swells, see `swollen`.
    """

    name: str
    psi: Callable[[Expr, Expr, Expr], Expr]
    shear_modulus: float
    bulk_modulus: float
    isochoric: Callable[[Expr, Expr], Expr] | None = None
    volumetric: Callable[[Expr], Expr] | None = None
    swelling: Swelling | None = None


@dataclass(frozen=True)
class Hyperelastic:
    """Any energy psi(F) [pressure], a UFL function of the deformation gradient; its moduli at rest scale penalties.
    swelling: of a body that swells, see `swollen`."""

    name: str
    psi: Callable[[Expr], Expr]
    shear_modulus: float
    bulk_modulus: float
    swelling: Swelling | None = None


Material = Isotropic | Hyperelastic
Volumetric = Callable[[Expr, float], Expr]  # energy of J and K [pressure]


def sampled_energy(material: Material) -> list[float]:
    """The energy [pressure] at a few deformations, which tells apart laws of one name; [] where it varies in space."""
    if isinstance(material, Isotropic):
        energies = [material.psi(*(ufl.as_ufl(value) for value in at)) for at in ((3.3, 3.4, 1.1), (3.1, 3.05, 0.9))]
    else:
        energies = [material.psi(ufl.as_matrix([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.2]]))]
    energies = [apply_algebra_lowering(ufl.as_ufl(energy)) for energy in energies]
    if any(not isinstance(end, ConstantValue | MultiIndex) for e in energies for end in traverse_unique_terminals(e)):
        return []
    return [float(energy(())) for energy in energies]


def _positive(law: str, **moduli: float) -> None:
    for name, value in moduli.items():
        positive(value, f"{law}: {name}", more=", a modulus in units of pressure")


def _finite(law: str, **parameters: float) -> None:
    for name, value in parameters.items():
        finite(value, f"{law}: {name}")


def _stable(law: str, shear: float) -> None:
    if not shear > 0.0:
        raise SceneError(f"{law}: the shear modulus at rest is {shear}; choose parameters that make it positive")


def moderate_pressure(J: Expr, K: float) -> Expr:
    """Psi_0 = K/2 (J - 1)^2, (21)."""
    return K / 2 * (J - 1) ** 2


def barrier(J: Expr, K: float) -> Expr:
    """Psi_0 = K/4 (J^2 - 1 - 2 ln J), infinite at J = 0 (Simo & Taylor 1982; Simo & Hughes 1998, Computational
    Inelasticity, (9.2.3))."""
    return K / 4 * (J**2 - 1 - 2 * ufl.ln(J))


def _split(name: str, isochoric: Callable[[Expr, Expr], Expr], volumetric: Volumetric, shear: float, K: float) -> Isotropic:
    """The law isochoric(I1, I2) + volumetric(J, K)."""
    function(volumetric, f"{name}: volumetric", "volumetric(J, K)")

    def volume(J: Expr) -> Expr:
        return volumetric(J, K)

    def psi(I1: Expr, I2: Expr, J: Expr) -> Expr:
        return isochoric(I1, I2) + volume(J)

    law = "" if volumetric is moderate_pressure else f", volume by {volumetric.__name__}"
    return Isotropic(f"{name}, K = {K}{law}", psi, shear, K, isochoric, volume)


def energy_parts(material: Material) -> tuple[Callable[[Expr, Expr], Expr], Callable[[Expr], Expr]]:
    """isochoric(I1, I2) and volumetric(J), whose sum the energy [pressure] is; TypeError where it is not stated so."""
    if not isinstance(material, Isotropic) or material.isochoric is None or material.volumetric is None:
        raise TypeError(f"'{material.name}' is not stated as a sum isochoric(I1, I2) + volumetric(J)")
    return material.isochoric, material.volumetric


def isochoric_energy(material: Material, I1: float, I2: float) -> float:
    """Its value [pressure]; TypeError as of `energy_parts`."""
    return float(ufl.as_ufl(energy_parts(material)[0](I1, I2)))


def at_dilatation(material: Material, theta: Expr, holds: float | None) -> Callable[[Expr, Expr, Expr], Expr]:
    """Energy [pressure] of (I1, I2, J) whose volume follows a dilatation theta of its own; TypeError as of `energy_parts`.

    holds: None, or with (isochoric + holds / 2) (J/theta - 1)^2 [pressure], which keeps J near theta within a cell; zero
    where they are equal.
    """
    isochoric, volumetric = energy_parts(material)
    if holds is None:
        return lambda I1, I2, J: isochoric(I1, I2) + volumetric(theta)

    def energy(I1: Expr, I2: Expr, J: Expr) -> Expr:
        apart = (isochoric(I1, I2) + holds / 2) * (J / theta - 1) ** 2
        return isochoric(I1, I2) + volumetric(theta) + apart

    return energy


def with_pressure(material: Material, p: Expr, theta: Expr, holds: float | None) -> Isotropic:
    """Energy at a dilatation, as of `at_dilatation`, + p J: the volume answers with a pressure p [pressure] that is a field
    of its own."""
    energy = at_dilatation(material, theta, holds)
    moduli = material.shear_modulus, material.bulk_modulus
    parts = energy_parts(material)
    return Isotropic(material.name, lambda I1, I2, J: energy(I1, I2, J) + p * J, *moduli, *parts, material.swelling)


def swollen(material: Material, ratio: Constant | Function) -> Material:
    """The law in a body whose volume without stress is `ratio`, J_s, times that at the start, by temperature or swelling.

    F = J_s^(1/3) F_e and the energy is psi(F_e) per volume without stress, J_s psi(F_e) per reference volume (Lubarda 2004,
    doi:10.1115/1.1591000): isochoric invariants are those of F, J is J_s J_e.
    """
    J_s = ufl.variable(ratio)
    if not isinstance(material, Isotropic):
        return replace(material, psi=lambda F: J_s * material.psi(J_s ** (-1 / 3) * F), swelling=(ratio, J_s))
    isochoric, volumetric = material.isochoric, material.volumetric
    return replace(
        material,
        psi=lambda I1, I2, J: J_s * material.psi(I1, I2, J / J_s),
        isochoric=None if isochoric is None else lambda I1, I2: J_s * isochoric(I1, I2),
        volumetric=None if volumetric is None else lambda J: J_s * volumetric(J / J_s),
        swelling=(ratio, J_s),
    )


def mooney_paper(a1: float, a2: float, K: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Psi = a1 (I1 - 3) + a2 (tr(B^.B^) - 3) + K/2 (J - 1)^2, (22), with the paper's second invariant tr(B^ . B^).

    The shear modulus at rest is 2 a1 + 8 a2.

    a1, a2: moduli [pressure], a2 may be negative; K: bulk modulus at rest [pressure]; volumetric: the energy of the volume
    as a function (J, K), here as in the other laws. ValueError where a1, K or the shear modulus is not positive.
    """
    _positive("mooney_paper", a1=a1, K=K)
    _finite("mooney_paper", a2=a2)
    _stable("mooney_paper", 2 * a1 + 8 * a2)

    def isochoric(I1: Expr, I2: Expr) -> Expr:
        return a1 * (I1 - 3) + a2 * (I2 - 3)

    return _split(f"Mooney, I2 = tr(B.B), a1 = {a1}, a2 = {a2}", isochoric, volumetric, 2 * a1 + 8 * a2, K)


def mooney_rivlin(a1: float, a2: float, K: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Psi = a1 (I1 - 3) + a2 ((I1^2 - tr(B^.B^))/2 - 3) + K/2 (J - 1)^2: classical Mooney (1940, doi:10.1063/1.1712836).

    The shear modulus at rest is 2 a1 + 2 a2.

    a1, a2: moduli [pressure], a2 may be negative; K: bulk modulus at rest [pressure]. ValueError where a1, K or the shear
    modulus is not positive.
    """
    _positive("mooney_rivlin", a1=a1, K=K)
    _finite("mooney_rivlin", a2=a2)
    _stable("mooney_rivlin", 2 * a1 + 2 * a2)

    def isochoric(I1: Expr, I2: Expr) -> Expr:
        return a1 * (I1 - 3) + a2 * ((I1**2 - I2) / 2 - 3)

    return _split(f"Mooney-Rivlin, classical I2, a1 = {a1}, a2 = {a2}", isochoric, volumetric, 2 * (a1 + a2), K)


def neo_hooke(mu: float, K: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Psi = mu/2 (I1 - 3) + K/2 (J - 1)^2 (Treloar 1943, doi:10.1039/TF9433900036; volume term (21)).

    mu, K: shear and bulk modulus at rest [pressure]. ValueError where one is not positive.
    """
    _positive("neo_hooke", mu=mu, K=K)

    def isochoric(I1: Expr, I2: Expr) -> Expr:
        return mu / 2 * (I1 - 3)

    return _split(f"neo-Hooke, mu = {mu}", isochoric, volumetric, mu, K)


def yeoh(c1: float, c2: float, c3: float, K: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Psi = sum c_i (I1 - 3)^i + K/2 (J - 1)^2 (Yeoh 1993, doi:10.5254/1.3538343). The shear modulus at rest is 2 c1.

    c1, c2, c3: moduli [pressure], c2 and c3 may be negative; K: bulk modulus at rest [pressure]. ValueError where c1 or K is
    not positive.
    """
    _positive("yeoh", c1=c1, K=K)
    _finite("yeoh", c2=c2, c3=c3)

    def isochoric(I1: Expr, I2: Expr) -> Expr:
        return c1 * (I1 - 3) + c2 * (I1 - 3) ** 2 + c3 * (I1 - 3) ** 3

    return _split(f"Yeoh, c1 = {c1}, c2 = {c2}, c3 = {c3}", isochoric, volumetric, 2 * c1, K)


def ogden(mu: Sequence[float], alpha: Sequence[float], K: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Psi = sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3) + K/2 (J - 1)^2 of isochoric principal stretches l
    (Ogden 1972, doi:10.1098/rspa.1972.0026), with any exponents; stretches of 0.1 to 10 to 2e-8 (`powers`).

    mu, alpha: lists of moduli [pressure] and exponents, as many of each; the shear modulus at rest is sum mu_p alpha_p / 2;
    K: bulk modulus at rest [pressure]. ValueError where the shear modulus or K is not positive.
    """
    _positive("ogden", K=K)
    moduli, exponents = (finite(values, f"ogden: {name}", (len(np.atleast_1d(values)),)).tolist()
                         for name, values in (("mu", mu), ("alpha", alpha)))  # fmt: skip
    if len(moduli) != len(exponents) or 0.0 in exponents:
        raise SceneError(f"ogden: mu = {moduli} and alpha = {exponents} must be as many, and no exponent zero")
    at_rest = sum(m * a for m, a in zip(moduli, exponents, strict=True)) / 2
    _stable("ogden", at_rest)

    def isochoric(I1: Expr, I2: Expr) -> Expr:
        inverse = (I1**2 - I2) / 2
        return sum(m / a * (power_sum(a / 2, I1, inverse) - 3) for m, a in zip(moduli, exponents, strict=True))

    return _split(f"Ogden, mu = {moduli}, alpha = {exponents}", isochoric, volumetric, at_rest, K)


def arruda_boyce(mu: float, locking: float, K: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Psi = mu sum C_i (I1^i - 3^i) / locking^(2 i - 2) + K/2 (J - 1)^2: eight chains, whose stress grows without bound near
    their locking stretch, in five terms of its series (Arruda & Boyce 1993, doi:10.1016/0022-5096(93)90013-6).

    mu [pressure]: shear modulus of endless chains; the law's own at rest is larger by 1 + 3/(5 locking^2) + ...; locking:
    stretch of a whole chain, sqrt(I1/3), above 1.
    """
    _positive("arruda_boyce", mu=mu, K=K)
    _finite("arruda_boyce", locking=locking)
    if not locking > 1.0:
        raise SceneError(f"arruda_boyce: locking = {locking} must be a stretch above 1")
    factors = [C * locking ** (-2 * i) for i, C in enumerate(CHAINS)]

    def isochoric(I1: Expr, I2: Expr) -> Expr:
        return sum(mu * factor * (I1 ** (i + 1) - 3.0 ** (i + 1)) for i, factor in enumerate(factors))

    at_rest = 2 * mu * sum((i + 1) * factor * 3.0**i for i, factor in enumerate(factors))
    return _split(f"Arruda-Boyce, mu = {mu}, locking stretch {locking}", isochoric, volumetric, at_rest, K)


def from_elastic(E: float, nu: float, volumetric: Volumetric = moderate_pressure) -> Isotropic:
    """Neo-Hooke's law stated by its constants at rest, for comparisons at small strains.

    E: Young's modulus [pressure]; nu: Poisson's ratio, in (-1, 0.5).
    """
    _positive("from_elastic", E=E)
    _finite("from_elastic", nu=nu)
    if not -1.0 < nu < 0.5:
        raise SceneError(f"from_elastic: nu = {nu} must lie in (-1, 0.5)")
    return neo_hooke(E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu)), volumetric)


def user_energy(
    psi: Callable[[Expr], Expr], shear_modulus: float, bulk_modulus: float, name: str = "user energy"
) -> Hyperelastic:
    """A strain energy of the user's own, in UFL.

    psi: function of the deformation gradient F, whose value is a scalar UFL expression [pressure], smooth, without stress at
    F = 1; shear_modulus, bulk_modulus: at rest [pressure], used for default penalties and the choice of elements; name: in
    the output.
    """
    _positive(text(name, "user_energy: name"), shear_modulus=shear_modulus, bulk_modulus=bulk_modulus)
    function(psi, f"{name}: psi", "psi(F)")
    value = psi(ufl.Identity(3))
    if not isinstance(value, ufl.core.expr.Expr | float | int) or getattr(value, "ufl_shape", ()) != ():
        raise TypeError(f"{name}: psi(F) must return a scalar UFL expression of the deformation gradient F")
    return Hyperelastic(name, psi, shear_modulus, bulk_modulus)


def young(material: Material) -> float:
    """Young's modulus at rest [pressure]."""
    mu, K = material.shear_modulus, material.bulk_modulus
    return 9 * K * mu / (3 * K + mu)
