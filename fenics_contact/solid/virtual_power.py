"""The solid's virtual power (19) and its rate linearisation (25), pulled back to the reference mesh, in UFL.

With tau = J sigma, h = grad v F^-1 and dOmega = J dX the power of the stresses is tau : delta h dX, and its rate is
(Dtau - tau h^T) : delta h dX.

Fields have three components on any mesh. On a plane one, see Section, the third is zero, F and h have a third stretch, 1 or
1 + u_x / X, and integrals the depth of the bodies behind the plane for a factor.
"""

from collections.abc import Callable

import ufl

from fenics_contact.assembly.section import Section
from fenics_contact.solid.materials import Isotropic, Material
from fenics_contact.types import Expr, Form, Function, Measure, Mesh


def deviator(A: Expr) -> Expr:
    """A - tr A / 3 I of a tensor (3, 3)."""
    return A - ufl.tr(A) / 3 * ufl.Identity(3)


def gradient(v: Expr, section: Section | None) -> Expr:
    """grad v (3, 3) of a vector; in a section with the rate of the way round in its last place."""
    if section is None:
        return ufl.grad(v)
    slope = ufl.grad(v)
    hoop = v[0] / ufl.SpatialCoordinate(v.ufl_domain())[0] if section.axisymmetric else 0
    return ufl.as_tensor([[slope[0, 0], slope[0, 1], 0], [slope[1, 0], slope[1, 1], 0], [0, 0, hoop]])


def place(mesh: Mesh) -> Expr:
    """Reference position X (3,)."""
    X = ufl.SpatialCoordinate(mesh)
    return X if len(X) == 3 else ufl.as_vector((X[0], X[1], 0))


def integral(measure: Measure, section: Section | None) -> "Measure | Deep":
    """Over volumes or their surfaces; from those of a plane mesh, with what is behind it."""
    if section is None:
        return measure
    R = ufl.SpatialCoordinate(measure.ufl_domain())[0]
    return Deep(measure, 2.0 * ufl.pi * R if section.axisymmetric else section.thickness)


def deformation_gradient(u: Function, section: Section | None = None) -> Expr:
    """F = I + grad u (3, 3) of a displacement [length].

    What has gone through the axis of turning has a negative way round, and det F would not show it where the plane is turned
    over as well: its way round is none, so that det F is zero, and stresses are not finite.
    """
    F = ufl.Identity(3) + gradient(u, section)
    if section is None or not section.axisymmetric:
        return F
    around = 0.5 * (F[2, 2] + abs(F[2, 2]))
    return ufl.as_tensor([[F[0, 0], F[0, 1], 0], [F[1, 0], F[1, 1], 0], [0, 0, around]])


def kirchhoff_and_rate(material: Material, F: Expr, h: Expr) -> tuple[Expr, Expr]:
    """Kirchhoff stress tau(F) and its rate under the velocity gradient h, both (3, 3) UFL tensors [pressure]."""
    if isinstance(material, Isotropic):
        return _isotropic(material.psi, F, h)
    return _from_deformation_gradient(material.psi, F, h)


def _isotropic(psi: Callable[[Expr, Expr, Expr], Expr], F: Expr, h: Expr) -> tuple[Expr, Expr]:
    """(20) and the rate of J sigma for psi(I1, I2, J): tau = 2 psi_1 dev B^ + 4 psi_2 dev B^2 + J psi_J I."""
    one = ufl.Identity(3)
    det = ufl.det(F)
    B = det ** (-2 / 3) * ufl.dot(F, F.T)
    B2 = ufl.dot(B, B)
    invariants = [ufl.variable(ufl.tr(B)), ufl.variable(ufl.tr(B2)), ufl.variable(det)]
    J = invariants[2]
    energy = psi(*invariants)
    slope = [ufl.diff(energy, i) for i in invariants]

    dI1, dI2 = 2 * deviator(B), 4 * deviator(B2)  # 2 B . dI/dB of the first two invariants
    tau = slope[0] * dI1 + slope[1] * dI2 + J * slope[2] * one

    rate = [ufl.inner(dI1, h), ufl.inner(dI2, h), J * ufl.tr(h)]
    dslope = [sum(ufl.diff(s, i) * r for i, r in zip(invariants, rate, strict=False)) for s in slope]
    hd = deviator(h)
    dB = ufl.dot(hd, B) + ufl.dot(B, hd.T)
    dB2 = ufl.dot(dB, B) + ufl.dot(B, dB)
    dtau = dslope[0] * dI1 + 2 * slope[0] * deviator(dB) + dslope[1] * dI2 + 4 * slope[1] * deviator(dB2)
    return tau, dtau + (rate[2] * slope[2] + J * dslope[2]) * one


def _from_deformation_gradient(psi: Callable[[Expr], Expr], F: Expr, h: Expr) -> tuple[Expr, Expr]:
    """tau = P F^T with P = dpsi/dF, and its rate under dF = h F."""
    F = ufl.variable(F)
    P = ufl.diff(psi(F), F)
    dF = ufl.dot(h, F)
    i, j, k, m = ufl.indices(4)
    dP = ufl.as_tensor(ufl.diff(P, F)[i, j, k, m] * dF[k, m], (i, j))
    return ufl.dot(P, F.T), ufl.dot(dP, F.T) + ufl.dot(P, dF.T)


def stress_power(material: Material, u: Function, v: Expr, dx: Measure, section: Section | None = None) -> Form:
    """The first integral of (19) [power per unit velocity, force]."""
    F = deformation_gradient(u, section)
    tau, _ = kirchhoff_and_rate(material, F, ufl.Identity(3))
    return ufl.inner(tau, ufl.dot(gradient(v, section), ufl.inv(F))) * dx


def stress_power_rate(
    material: Material, u: Function, du: Expr, v: Expr, dx: Measure, section: Section | None = None
) -> Form:
    """The first integral of (25): (Dtau - tau h^T) : delta h."""
    F = deformation_gradient(u, section)
    Finv = ufl.inv(F)
    h = ufl.dot(gradient(du, section), Finv)
    tau, dtau = kirchhoff_and_rate(material, F, h)
    return ufl.inner(dtau - ufl.dot(tau, h.T), ufl.dot(gradient(v, section), Finv)) * dx


def dilatation_rate(u: Function, v: Expr, section: Section | None = None) -> Expr:
    """Rate of J = det F under the velocity v: J div_x v."""
    F = deformation_gradient(u, section)
    return ufl.det(F) * ufl.tr(ufl.dot(gradient(v, section), ufl.inv(F)))


def cauchy_stress(material: Material, u: Function, section: Section | None = None) -> Expr:
    """(20): sigma = tau / J."""
    F = deformation_gradient(u, section)
    tau, _ = kirchhoff_and_rate(material, F, ufl.Identity(3))
    return tau / ufl.det(F)


def dead_traction_power(traction: Expr, v: Expr, ds: Measure) -> Form:
    """Power of a traction [pressure] fixed in direction, per reference area."""
    return ufl.inner(traction, v) * ds


def _area_vector(F: Expr, u: Function) -> Expr:
    """Current area vector over reference area, cof F N, by Nanson's formula."""
    N = ufl.FacetNormal(u.function_space.mesh)
    N = N if len(N) == 3 else ufl.as_vector((N[0], N[1], 0))
    return ufl.det(F) * ufl.dot(ufl.inv(F).T, N)


def follower_pressure_power(pressure: Expr, u: Function, v: Expr, ds: Measure, section: Section | None = None) -> Form:
    """Power of a pressure [per current area] that pushes against the outward normal of the deformed surface, (19)."""
    return -pressure * ufl.inner(_area_vector(deformation_gradient(u, section), u), v) * ds


def follower_pressure_power_rate(
    pressure: Expr, u: Function, du: Expr, v: Expr, ds: Measure, section: Section | None = None
) -> Form:
    """Its rate at constant pressure: the load tangent of (25), with d(n da)/dt = (tr h I - h^T) n da."""
    F = deformation_gradient(u, section)
    area = _area_vector(F, u)
    h = ufl.dot(gradient(du, section), ufl.inv(F))
    return -pressure * ufl.inner(ufl.tr(h) * area - ufl.dot(h.T, area), v) * ds


def body_force_power(force: Expr, v: Expr, dx: Measure) -> Form:
    """Power of a force per reference volume, the last integral of (19)."""
    return ufl.inner(force, v) * dx


def energy_density(material: Material, u: Function, section: Section | None = None) -> Expr:
    """Strain energy per reference volume [pressure]."""
    F = deformation_gradient(u, section)
    if not isinstance(material, Isotropic):
        return material.psi(F)
    return material.psi(*invariants(F))


def invariants(F: Expr) -> tuple[Expr, Expr, Expr]:
    """I1 = tr B^, I2 = tr(B^ . B^) and J."""
    J = ufl.det(F)
    B = J ** (-2 / 3) * ufl.dot(F, F.T)
    return ufl.tr(B), ufl.tr(ufl.dot(B, B)), J


def projected_power(weight: Expr, projector: Expr, moved: Expr, v: Expr, dx: Measure) -> Form:
    """Power of forces `weight` times the part of `moved` that a symmetric projector (3, 3) leaves, per reference volume or
    area: centrifugal ones, weight = density speed^2 [force/length^4], springs along a direction [pressure/length]."""
    return weight * ufl.inner(ufl.dot(projector, moved), v) * dx


def spring_power(stiffness: Expr, moved: Expr, v: Expr, dx: Measure) -> Form:
    """Springs of `stiffness` per reference volume [pressure/length^2] that are stretched by `moved`."""
    return stiffness * ufl.inner(moved, v) * dx


class Deep:
    """An integral over the plane mesh of a Section, over all the depth behind it: integrand * Deep(...) is a form."""

    def __init__(self, measure: Measure, depth: Expr | float) -> None:
        self._measure, self._depth = measure, depth

    def __rmul__(self, integrand: Expr) -> Form:
        return (self._depth * integrand) * self._measure
