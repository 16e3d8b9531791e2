"""The solid as one term of a System, by element: plain displacement, reduced volumetric integration, or mixed u-p."""

import numpy as np
import ufl

from fenics_contact import compat, materials
from fenics_contact import virtual_power as vp
from fenics_contact.assembly.condensed import CondensedPressure
from fenics_contact.assembly.system import FormTerm
from fenics_contact.checks import SceneError

ELEMENTS = ("displacement", "reduced", "mixed")
# K / mu above which an element of degree 1 without treatment is refused: Cook's membrane is then half as soft as it is
# on 32 cells per edge (demos/locking.py).
LOCKS = 1000.0


def refuse_element(element, degree, tetrahedra, materials_by_body, accept_locking):
    """An element must be known, fit its materials, and not lock; a locking one may be asked for."""
    if element not in ELEMENTS:
        raise SceneError(f"element '{element}' is not one of {', '.join(ELEMENTS)}")
    for body, material in materials_by_body.items():
        if element != "displacement" and getattr(material, "volumetric", None) is None:
            raise SceneError(
                f"element '{element}' needs an energy isochoric(I1, I2) + volumetric(J), but '{material.name}' of body "
                f"'{body}' is not stated as such a sum; use element='displacement' with degree=2"
            )
        ratio = material.bulk_modulus / material.shear_modulus
        locks = degree == 1 and (element == "displacement" or tetrahedra)
        if locks and ratio > LOCKS and not accept_locking:
            cells = "tetrahedra of degree 1 (whatever their pressure)" if tetrahedra else "hexahedra of degree 1"
            remedy = "element='mixed' with degree=2" if tetrahedra else "element='mixed'"
            raise SceneError(
                f"body '{body}' has K / mu = {ratio:.3g}: {cells} with element '{element}' lock above {LOCKS:g}; use "
                f"{remedy}, or accept_locking=True to see it"
            )


def quadrature_degree(degree, reduced=False):
    """Full: 2 x 2 x 2 points in hexahedra of degree 1, 3 x 3 x 3 of degree 2; reduced: one less per direction."""
    return 2 * (degree - 1) if reduced else 2 * degree + 1


def solid_term(element, u, parts, loads_power, degree):
    """The term of a solid under dead loads, and its stress laws.

    parts: [(material, dx)] of the bodies, dx(quadrature degree) their measure; loads_power(v): the loads' virtual power.
    Returns the term and, per body, the material whose cauchy_stress is the element's.
    """
    space = u.function_space
    v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
    full, less = quadrature_degree(degree), quadrature_degree(degree, reduced=True)
    if element == "mixed":
        return _mixed(u, v, du, parts, loads_power, degree)
    rules = [[(material, dx(full)) for material, dx in parts]]
    if element == "reduced":
        rules = [
            [(materials.isochoric_part(material), dx(full)) for material, dx in parts],
            [(materials.volumetric_part(material), dx(less)) for material, dx in parts],
        ]
    powers = [sum(vp.stress_power(material, u, v, dx) for material, dx in rule) for rule in rules]
    rates = [sum(vp.stress_power_rate(material, u, du, v, dx) for material, dx in rule) for rule in rules]
    powers[0] -= loads_power(v)
    return FormTerm("solid", powers, rates), [material for material, _ in parts]


def _mixed(u, v, du, parts, loads_power, degree):
    mesh = u.function_space.mesh
    space, value = pressure_space(mesh, degree)
    q, dq = ufl.TestFunction(space), ufl.TrialFunction(space)
    pressure, predicted, dilatation = (compat.Function(space) for _ in range(3))
    measured = [(material, dx(quadrature_degree(degree))) for material, dx in parts]

    def summed(integrand):
        return sum(integrand(material) * dx for material, dx in measured)

    J = ufl.det(vp.deformation_gradient(u))
    theta = ufl.variable(value(dilatation))
    forms = {
        "volume": summed(lambda m: value(q) * J),
        "law": summed(lambda m: value(q) * ufl.diff(m.volumetric(theta), theta)),
        "stiffness": summed(lambda m: value(q) * value(dq) * ufl.diff(ufl.diff(m.volumetric(theta), theta), theta)),
        "mass": summed(lambda m: value(q) * value(dq)),
        "coupling": summed(lambda m: value(q) * vp.dilatation_rate(u, du)),
    }
    forms = {name: compat.compile_form(form) for name, form in forms.items()}
    stressed = [(materials.with_pressure(material, value(pressure)), dx) for material, dx in measured]
    ahead = [(materials.with_pressure(material, value(predicted)), dx) for material, dx in measured]
    power = sum(vp.stress_power(material, u, v, dx) for material, dx in stressed)
    rate = sum(vp.stress_power_rate(material, u, du, v, dx) for material, dx in ahead)
    term = CondensedPressure("solid", power - loads_power(v), rate, forms, u, pressure, predicted, dilatation)
    return term, [material for material, _ in stressed]


def pressure_space(mesh, degree):
    """Space of pressures for displacements of a degree, and value(q): the UFL scalar of one of its functions.

    Degree 1: one value per cell; degree 2: linear in X in each cell, in the reference position itself and not the
    parent cell's coordinates, which distorted cells would spoil.
    """
    if degree == 1:
        return compat.constant_space(mesh), lambda q: q
    vectors = compat.constant_space(mesh, (3,))
    centre, size = compat.Function(vectors), compat.Function(vectors)
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    centre.x.array[:], size.x.array[:] = x.mean(axis=1).ravel(), np.ptp(x, axis=1).ravel()
    X = ufl.SpatialCoordinate(mesh)
    place = [(X[i] - centre[i]) / size[i] for i in range(3)]
    return compat.constant_space(mesh, (4,)), lambda q: q[0] + sum(q[i + 1] * place[i] for i in range(3))
