"""Friction as the user states it: Coulomb's coefficient, a number or one that depends on the pressure, and a shear limit."""

import numbers

import numpy as np

from fenics_contact.kernels.law import Friction, friction_limits
from fenics_contact.types import Floats

__all__ = ["Friction", "allowed", "coulomb", "friction_of"]


def coulomb(mu: float, exponent: float = 0.0, reference: float = 1.0, shear_limit: float | None = None) -> Friction:
    """|T_T| <= mu(p) p with mu(p) = mu (p/reference)^exponent, and |T_T| <= shear_limit [pressure] where one is given.

    exponent: 0 for Coulomb's constant mu; -1/3 for smooth rubber, whose true area of contact grows as p^(2/3) (Hertz);
    above -1, so that more pressure allows more friction; reference: the pressure at which mu(p) = mu [pressure].
    ValueError for other numbers.
    """
    if not (np.isfinite(mu) and mu >= 0.0):
        raise ValueError(f"friction = {mu} must be zero or positive")
    if not (np.isfinite(exponent) and exponent > -1.0):
        raise ValueError(f"friction: exponent = {exponent} must be greater than -1")
    if not (np.isfinite(reference) and reference > 0.0):
        raise ValueError(f"friction: reference = {reference} must be a positive pressure")
    if shear_limit is not None and not (np.isfinite(shear_limit) and shear_limit > 0.0):
        raise ValueError(f"friction: shear_limit = {shear_limit} must be a positive pressure")
    return Friction(float(mu), float(reference), float(exponent), float(shear_limit or 0.0))


def friction_of(stated: object) -> Friction:
    """The Friction of a number, Coulomb's mu, or of what `coulomb` gives. ValueError for anything else."""
    if isinstance(stated, Friction):
        return stated
    if not isinstance(stated, numbers.Real):
        raise ValueError(f"friction = {stated!r} must be a number, Coulomb's mu, or coulomb(...)")
    return coulomb(float(stated))


def allowed(friction: Friction, pressure: Floats) -> Floats:
    """Largest friction tractions [pressure] under pressures of any shape."""
    limits = np.empty(pressure.size)
    friction_limits(friction, pressure.ravel(), limits)
    return limits.reshape(pressure.shape)
