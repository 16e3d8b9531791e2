"""The solid as one term of a System, by element: plain displacement, or mixed u-p.

"displacement"  every part of the power at all points. It locks: at K / mu = 10, 100, 1000 Cook's membrane of 16 hexahedra
    per edge loses 7, 28, 59 % of its deflection, 1, 4, 5 % with 8 of degree 2, and at 1000 a thick sphere with two layers
    of degree 2 half of it (demos/locking.py).
"mixed"  the recommended one for rubber, K / mu from 10 to 1e4 and beyond: errors, steps and Newton iterations do not grow
    with it. A pressure per cell, linear in hexahedra of degree 2, condensed out. The tangent costs 1.9 to 2.3 times the
    plain one in degree 1, three times in degree 2; the linear solve stays the same. Degree 1 (mean dilatation) has pressure
    modes that alternate from cell to cell, seen in the stress and not in the displacement, is stiff in bending on coarse
    meshes, and may hourglass where cells are pressed to a small fraction of their height. Degree 2 has no such modes and
    is the most exact per unknown. In compression it would lose stability before the material does (a plane square at a
    stretch of 0.65 instead of 0.54): an energy that holds J near its projection, `materials.at_dilatation`, keeps it.
    Simplices of degree 2 take one pressure per cell (the linear one has no stable answer), and a bulk modulus of HELD mu
    within it, without which they hardly resist bending; of degree 1 they gain nothing from a pressure, and lock from
    K / mu of 5.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import ufl

from fenics_contact import compat
from fenics_contact.assembly.condensed import CondensedPressure
from fenics_contact.assembly.section import Section
from fenics_contact.assembly.term import Energy, FormTerm
from fenics_contact.solid import materials
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.materials import Isotropic, Material
from fenics_contact.types import Expr, Form, Function, Measure, Mesh, Space
from fenics_contact.values import SceneError

Parts = Sequence[tuple[Material, Callable[[int], Measure]]]  # of each body: dx(quadrature degree)

ELEMENTS = ("displacement", "mixed")
# K / mu above which an element of degree 1 without treatment is refused: Cook's membrane then loses 28 % of its deflection
# with 16 cells per edge (demos/locking.py), the flattened rubber cylinder is 10 % stiff on 6 (studies: map_locking).
LOCKS = 100.0
# The same of tetrahedra of degree 1, and where the verdict notes it. With 4 cells across, against degree 2, a
# block 20 x 20 x 10 bonded to two plates is 2.4, 11, 25, 48 % too stiff at K / mu = 2, 5, 10, 20, and a bush of radii 10 and
# 20 moved sideways 2.9, 9, 19, 38 %; with 6 cells they are 1.5, 7, 15, 28 and 1.8, 5.5, 11, 22 %. Cook's membrane, free to
# bend, loses 3, 4, 5, 7 % with 16 cells per edge.
LOCKS_TETRAHEDRA, NOTED_TETRAHEDRA = 5.0, 2.0
# Of mu, K at most: what holds J near the one value of a simplex of degree 2. In bending the volume changes linearly through
# a cell: with none a cantilever of one or two triangles of nu = 0.49 through its height gives way 104 and 14 % too far, and
# with this 16 and 3 %, as one with K where that is less; a bonded strip is 3.3, 2.0, 1.0 % too stiff with 2, 4, 8 over half
# its height at K / mu = 500, without it 1.8, 1.0, 0.3 %, with 10 mu 4.7, 2.8, 1.6 %.
HELD = 3.0
BRICKS = {"tetrahedra": "hexahedra", "triangles": "quadrilaterals"}  # what does not lock in their place


def refuse_element(
    element: str, degree: int, simplices: str, materials_by_body: Mapping[str, Material], accept_locking: bool
) -> None:
    """An element must be known, fit its materials, and not lock; a locking one may be asked for. simplices: a key of BRICKS
    where cells are such, else empty."""
    if element not in ELEMENTS:
        raise SceneError(
            f"element '{element}' is not one of {', '.join(ELEMENTS)}; use element='mixed' for rubber with K / mu above "
            "10 and element='displacement' below"
        )
    for body, material in materials_by_body.items():
        if element != "displacement" and (not isinstance(material, Isotropic) or material.volumetric is None):
            raise SceneError(
                f"element '{element}' needs an energy isochoric(I1, I2) + volumetric(J), but '{material.name}' of body "
                f"'{body}' is not stated as such a sum; use element='displacement' with degree=2"
            )
        ratio, limit = _bulk_over_shear(material), LOCKS_TETRAHEDRA if simplices else LOCKS
        locks = degree == 1 and (element == "displacement" or bool(simplices))
        if locks and ratio > limit and not accept_locking:
            cells = f"{simplices} of degree 1 (whatever their pressure)" if simplices else "hexahedra of degree 1"
            remedy = f"element='mixed' with degree=2 or with {BRICKS[simplices]}" if simplices else "element='mixed'"
            raise SceneError(
                f"body '{body}' has K / mu = {ratio:.3g}: {cells} with element '{element}' lock above {limit:g}; use "
                f"{remedy}, or accept_locking=True to see it"
            )


def locking_notes(element: str, degree: int, simplices: str, materials_by_body: Mapping[str, Material]) -> list[str]:
    """What a verdict must say of bodies whose cells are stiffer than their material by more than about 3 %, whatever they
    do."""
    ratios = {body: _bulk_over_shear(material) for body, material in materials_by_body.items()}
    if degree == 2 and element == "displacement":
        return [
            f"body '{body}', K / mu = {ratio:.3g}: cells of displacement alone lock, of degree 2 by some percent where it "
            "is confined or bends across few of them; take element='mixed'"
            for body, ratio in ratios.items()
            if ratio > LOCKS
        ]
    if degree != 1 or not simplices:
        return []
    return [
        f"body '{body}', K / mu = {ratio:.3g}: its {simplices} of degree 1 lock: with 4 cells across a bonded part it is "
        "too stiff by 3 % at K / mu of 2, 10 % at 5, 20 % at 10, across one that bends by 15 ... 25 % at any K / mu; take "
        "degree=2, with element='mixed' from K / mu = 10 on"
        for body, ratio in ratios.items()
        if ratio > NOTED_TETRAHEDRA
    ]


def _bulk_over_shear(material: Material) -> float:
    return material.bulk_modulus / material.shear_modulus


def quadrature_degree(degree: int) -> int:
    """Full integration: 2 x 2 x 2 points in hexahedra of degree 1, 3 x 3 x 3 of degree 2."""
    return 2 * degree + 1


def solid_term(
    element: str,
    u: Function,
    parts: Parts,
    loads_power: Callable[[Expr], Form],
    degree: int,
    section: Section | None = None,
) -> CondensedPressure | FormTerm:
    """The term of a solid under dead loads; section: what a plane mesh stands for.

    parts: [(material, dx)] of the bodies, dx(quadrature degree) their measure; loads_power(v): the loads' virtual power.
    Its laws are, per body, the material whose cauchy_stress is the element's.
    """
    if element == "mixed":
        return _mixed(u, parts, loads_power, degree, section)
    v, du = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
    measured = [(material, dx(quadrature_degree(degree))) for material, dx in parts]
    power = sum(vp.stress_power(material, u, v, dx, section) for material, dx in measured)
    rate = sum(vp.stress_power_rate(material, u, du, v, dx, section) for material, dx in measured)
    energy = _energy([(material, vp.energy_density(material, u, section), dx) for material, dx in measured])
    return FormTerm("solid", [power - loads_power(v)], [rate], laws=[material for material, _ in parts], energy=energy)


def _mixed(
    u: Function, parts: Parts, loads_power: Callable[[Expr], Form], degree: int, section: Section | None
) -> CondensedPressure:
    v, du, mesh = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space), u.function_space.mesh
    space, value = pressure_space(mesh, degree)
    q, dq = ufl.TestFunction(space), ufl.TrialFunction(space)
    fields = pressure, predicted, dilatation = (compat.Function(space), compat.Function(space), compat.Function(space))
    measured = [(material, dx(quadrature_degree(degree))) for material, dx in parts]

    def summed(integrand: Callable[[Material], Expr]) -> Form:
        return sum(integrand(material) * dx for material, dx in measured)

    def density(material: Material) -> Expr:
        return materials.at_dilatation(material, theta, held(material))(*vp.invariants(F))

    def stressed(p: Function) -> list[tuple[Isotropic, Measure]]:
        theta = value(dilatation)
        return [(materials.with_pressure(material, value(p), theta, held(material)), dx) for material, dx in measured]

    def held(material: Material) -> float | None:
        if degree == 1:
            return None
        return 0.0 if linear else min(HELD * material.shear_modulus, material.bulk_modulus)

    F = vp.deformation_gradient(u, section)
    theta, linear = ufl.variable(value(dilatation)), space.dofmap.index_map_bs > 1
    forms = {
        "volume": summed(lambda m: value(q) * ufl.det(F)),
        "law": summed(lambda m: value(q) * ufl.diff(density(m), theta)),
        "stiffness": summed(lambda m: value(q) * value(dq) * ufl.diff(ufl.diff(density(m), theta), theta)),
        "mass": summed(lambda m: value(q) * value(dq)),
        "coupling": summed(lambda m: value(q) * vp.dilatation_rate(u, du, section)),
    }
    if degree == 2:
        forms["cross"] = ufl.derivative(forms["law"], u, du)
    forms = {name: compat.compile_form(form) for name, form in forms.items()}
    power = sum(vp.stress_power(material, u, v, dx, section) for material, dx in stressed(pressure))
    rate = sum(vp.stress_power_rate(material, u, du, v, dx, section) for material, dx in stressed(predicted))
    laws = [material for material, _ in stressed(pressure)]
    energy = _energy([(material, density(material), dx) for material, dx in measured])
    return CondensedPressure((power - loads_power(v), rate), forms, u, fields, laws, energy)


def _energy(parts: Sequence[tuple[Material, Expr, Measure]]) -> Energy:
    """Strain energy of bodies (material, energy per volume, dx), and its rates with the ratios of those that swell."""
    numbers, fields = [], []
    for material, density, dx in parts:
        if material.swelling is not None:
            ratio, variable = material.swelling
            rate = ufl.diff(density, variable)
            if isinstance(ratio, ufl.Coefficient):
                fields.append((ratio, rate * ufl.TestFunction(ratio.function_space) * dx))
            else:
                numbers.append((ratio, rate * dx))
    return Energy(sum(density * dx for _, density, dx in parts), numbers, fields)


def pressure_space(mesh: Mesh, degree: int) -> tuple[Space, Callable[[Function], Expr]]:
    """Space of pressures for displacements of a degree, and value(q): the UFL scalar of one of its functions.

    One value per cell, or in hexahedra and quadrilaterals of degree 2 linear in X: in the reference position itself and not
    in the parent cell's coordinates, which distorted cells would spoil.
    """
    # tetrahedra and triangles have too few nodes for a volume that is linear in a cell
    if degree == 1 or compat.cell_name(mesh) in ("tetrahedron", "triangle"):
        return compat.constant_space(mesh), lambda q: q
    vectors = compat.constant_space(mesh, (3,))
    centre, size = compat.Function(vectors), compat.Function(vectors)
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    cells = compat.cell_dofs(vectors)[:, 0]
    centre.x.array.reshape(-1, 3)[cells], size.x.array.reshape(-1, 3)[cells] = x.mean(axis=1), np.ptp(x, axis=1)
    X = ufl.SpatialCoordinate(mesh)
    dim = mesh.topology.dim
    place = [(X[i] - centre[i]) / size[i] for i in range(dim)]
    return compat.constant_space(mesh, (dim + 1,)), lambda q: q[0] + sum(q[i + 1] * place[i] for i in range(dim))
