"""Strain energies on one hexahedron: closed forms, tables, stiffness at rest, and how wrong parameters are refused."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.optimize import brentq

from fenics_contact import compat
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import box
from fenics_contact.solid import materials, virtual_power
from fenics_contact.solid.powers import power_sum

pytestmark = pytest.mark.serial

A1, A2, K = 0.1863, 0.0098, 5.0
YEOH = (0.2, -0.01, 0.003)
CHAIN = (0.4, 2.5)
SERIES = [c / CHAIN[1] ** (2 * i) for i, c in enumerate((1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750))]
LAWS = {
    "A": materials.mooney_paper(A1, A2, K),
    "B": materials.mooney_rivlin(A1, A2, K),
    "neo-Hooke": materials.neo_hooke(0.4, K),
    "Yeoh": materials.yeoh(*YEOH, K),
    "Arruda-Boyce": materials.arruda_boyce(*CHAIN, K),
}


# ---- oracles: the energies in principal stretches and of a matrix F, without UFL


def energy(law, F):
    """W(F) in numpy, complex F allowed."""
    J = np.linalg.det(F)
    C = F.T @ F / J ** (2 / 3)
    I1, trace2 = np.trace(C), np.trace(C @ C)
    volume = K / 2 * (J - 1) ** 2
    if law == "A":
        return A1 * (I1 - 3) + A2 * (trace2 - 3) + volume
    if law == "B":
        return A1 * (I1 - 3) + A2 * ((I1**2 - trace2) / 2 - 3) + volume
    if law == "neo-Hooke":
        return 0.2 * (I1 - 3) + volume
    if law == "Arruda-Boyce":
        return CHAIN[0] * sum(c * (I1 ** (i + 1) - 3.0 ** (i + 1)) for i, c in enumerate(SERIES)) + volume
    return sum(c * (I1 - 3) ** (i + 1) for i, c in enumerate(YEOH)) + volume


def nominal_by_complex_step(law, F):
    """dW/dF without cancellation (Squire & Trapp 1998, doi:10.1137/S003614459631241X)."""
    P = np.empty((3, 3))
    for i, j in np.ndindex(3, 3):
        step = np.zeros((3, 3), complex)
        step[i, j] = 1e-30j
        P[i, j] = energy(law, F + step).imag / 1e-30
    return P


def principal_kirchhoff(law, stretches):
    """tau_i = lambda_i dW/dlambda_i from the isochoric stretches b_i^(1/2)."""
    J = np.prod(stretches)
    b = np.asarray(stretches) ** 2 / J ** (2 / 3)
    if law == "A":
        part = 2 * A1 * b + 4 * A2 * b**2
    elif law == "B":
        part = 2 * A1 * b - 2 * A2 / b  # for the isochoric part I2 is the sum of 1/b
    elif law == "neo-Hooke":
        part = 0.4 * b
    elif law == "Arruda-Boyce":
        part = 2 * CHAIN[0] * sum((i + 1) * c * b.sum() ** i for i, c in enumerate(SERIES)) * b
    else:
        I = b.sum() - 3
        part = 2 * (YEOH[0] + 2 * YEOH[1] * I + 3 * YEOH[2] * I**2) * b
    return part - part.mean() + K * J * (J - 1)


def free_stretch(law, stretch, third):
    """Lateral stretch with no lateral stress; `third` maps it to the third stretch."""
    return brentq(lambda s: principal_kirchhoff(law, [stretch, s, third(s)])[1], 0.2, 3.0, xtol=1e-15, rtol=1e-15)


STATES = {"uniaxial": lambda s: s, "plane strain": lambda s: 1.0}
TABLE = {  # nominal stress [MPa]: state, law, then stretches 0.5, 0.9, 1.5, 3.0
    ("uniaxial", "A"): (-1.5656006, -0.1458523, 0.4866384, 1.6818203),
    ("uniaxial", "B"): (-1.4045219, -0.1288051, 0.3910385, 0.9819937),
    ("plane strain", "A"): (-2.7188588, -0.1935905, 0.5327122, 1.6911715),
    ("plane strain", "B"): (-2.3087755, -0.1702282, 0.4422309, 1.0217042),
}
STRETCHES = (0.5, 0.9, 1.5, 3.0)


# ---- the solid under test: one cube of side one


@dataclass
class Cube:
    """Residual and rate tangent of one hexahedron; `weights` choose among LAWS without compiling a form for each."""

    u: object
    weights: object
    residual: object
    tangent: object

    def evaluate(self, F, want_tangent=False):
        """Nodal forces (8, 3), or the tangent (24, 24), under the deformation x = F X."""
        space = self.u.function_space
        self.X = space.tabulate_dof_coordinates()
        self.u.x.array[:] = (self.X @ (np.asarray(F) - np.eye(3)).T).ravel()
        if not want_tangent:
            forces = np.zeros(24)
            compat.assemble_vector(forces, self.residual)
            return forces.reshape(-1, 3)
        matrix = compat.create_matrix(self.tangent)
        compat.assemble_matrix(matrix, self.tangent)
        matrix.assemble()
        dense = matrix.convert("dense").getDenseArray().copy()
        matrix.destroy()
        return dense

    def nominal(self, F):
        """P: its column j is the force on the face X_j = 1, of area one."""
        forces = self.evaluate(F)
        return np.stack([forces[self.X[:, j] > 0.5].sum(axis=0) for j in range(3)], axis=1)

    def cauchy(self, F):
        return self.nominal(F) @ np.transpose(F) / np.linalg.det(F)

    def use(self, law):
        self.weights.value[:] = [float(name == law) for name in LAWS]
        return self


def make_cube(make_material):
    domain = read_gmsh(box.build, MPI.COMM_SELF).domain
    space = compat.lagrange_space(domain, 1, (3,))
    u, v, du = compat.Function(space), ufl.TestFunction(space), ufl.TrialFunction(space)
    weights = compat.Constant(domain, np.zeros(len(LAWS)))
    material = make_material(weights)
    dx = ufl.Measure("dx", domain=domain, metadata={"quadrature_degree": 2})  # exact for homogeneous strain
    return Cube(
        u,
        weights,
        compat.compile_form(virtual_power.stress_power(material, u, v, dx)),
        compat.compile_form(virtual_power.stress_power_rate(material, u, du, v, dx)),
    )


def weighted(weights):
    """The energy sum_i w_i psi_i: with one weight at one and the others at zero it is that law."""

    def psi(*invariants):
        return sum(weights[i] * law.psi(*invariants) for i, law in enumerate(LAWS.values()))

    return materials.Isotropic("weighted", psi, 1.0, 1.0)


def users_mooney(F):
    """Law A as a user would write it."""
    J = ufl.det(F)
    B = J ** (-2 / 3) * F * F.T
    return A1 * (ufl.tr(B) - 3) + A2 * (ufl.inner(B, B) - 3) + K / 2 * (J - 1) ** 2


@cache
def isotropic_cube():
    return make_cube(weighted)


@cache
def user_cube():
    return make_cube(lambda weights: materials.user_energy(users_mooney, 0.451, K))


def some_F(seed):
    F = np.eye(3) + 0.3 * np.random.default_rng(seed).uniform(-1, 1, (3, 3))
    assert np.linalg.det(F) > 0.3
    return F


@pytest.mark.parametrize("i", range(4))
@pytest.mark.parametrize(("state", "law"), TABLE)
def test_tabulated_nominal_stress(state, law, i):
    stretch = STRETCHES[i]
    lateral = free_stretch(law, stretch, STATES[state])
    stretches = np.array([stretch, lateral, STATES[state](lateral)])
    exact = principal_kirchhoff(law, stretches) / stretches
    # targets: seven decimals, half a digit of the last one and the rounding of the comparison
    assert abs(exact[0] - TABLE[state, law][i]) < 5.1e-8
    P = isotropic_cube().use(law).nominal(np.diag(stretches))
    # eight points' sums round at 1e-15; J - 1 loses a digit and K = 5 amplifies it
    assert np.abs(P - np.diag(exact)).max() < 1e-13
    assert abs(P[1, 1]) < 1e-13


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("stretch", STRETCHES)
def test_closed_forms_in_principal_stretches(law, state, stretch):
    lateral = free_stretch(law, stretch, STATES[state])
    stretches = np.array([stretch, lateral, STATES[state](lateral)])
    exact = np.diag(principal_kirchhoff(law, stretches) / stretches)
    assert np.abs(isotropic_cube().use(law).nominal(np.diag(stretches)) - exact).max() < 1e-13  # as above


def test_neo_hooke_and_yeoh_in_simple_shear():
    """Isochoric, so B^ = B: s12 = mu gamma for neo-Hooke, 2 W'(I1) gamma with I1 - 3 = gamma^2 for Yeoh."""
    F = np.array([[1.0, 0.7, 0], [0, 1, 0], [0, 0, 1]])
    neo, yeoh = isotropic_cube().use("neo-Hooke").cauchy(F), isotropic_cube().use("Yeoh").cauchy(F)
    slope = 2 * (YEOH[0] + 2 * YEOH[1] * 0.49 + 3 * YEOH[2] * 0.49**2)
    assert abs(neo[0, 1] - 0.4 * 0.7) < 1e-14 and abs(yeoh[0, 1] - slope * 0.7) < 1e-14  # rounding


@pytest.mark.parametrize(
    ("law", "table"),
    [("A", (0.0800667, -0.0351333, -0.0449333, 0.2304)), ("B", (0.0637333, -0.0343167, -0.0294167, 0.1961))],
)
def test_tabulated_simple_shear(law, table):
    s = isotropic_cube().use(law).cauchy([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]])
    assert np.abs(np.array([s[0, 0], s[1, 1], s[2, 2], s[0, 1]]) - table).max() < 5.1e-8  # seven decimals
    assert np.abs(s - s.T).max() < 1e-14 and np.abs(s[2, :2]).max() < 1e-14


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("gamma", [0.05, 0.5, 2.0])
def test_universal_relation_of_simple_shear(law, gamma):
    s = isotropic_cube().use(law).cauchy([[1, gamma, 0], [0, 1, 0], [0, 0, 1]])
    assert abs(s[0, 0] - s[1, 1] - gamma * s[0, 1]) < 1e-13  # rounding of stresses up to 10


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", range(3))
def test_nominal_stress_is_the_energy_s_derivative(law, seed):
    F = some_F(seed)
    # the complex step is exact to rounding; volume terms of size K
    assert np.abs(isotropic_cube().use(law).nominal(F) - nominal_by_complex_step(law, F)).max() < 1e-13


@pytest.mark.parametrize("law", LAWS)
def test_stress_turns_with_the_body_and_does_not_know_rotations_before(law):
    c, s = np.cos(0.8), np.sin(0.8)
    Q = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, s, c], [0, -c, s]])
    cube, F = isotropic_cube().use(law), some_F(5)
    assert np.abs(cube.cauchy(Q @ F) - Q @ cube.cauchy(F) @ Q.T).max() < 1e-13
    assert np.abs(cube.cauchy(F @ Q) - cube.cauchy(F)).max() < 1e-13


@pytest.mark.parametrize("law", LAWS)
def test_no_stress_at_rest_and_the_stated_moduli(law):
    cube = isotropic_cube().use(law)
    assert np.abs(cube.evaluate(np.eye(3))).max() < 1e-15
    stiffness, X = cube.evaluate(np.eye(3), want_tangent=True), cube.X
    shear, swell = np.zeros((8, 3)), X.copy()
    shear[:, 0] = X[:, 1]
    material = LAWS[law]
    # the quadratic form of a unit shear is mu, that of a unit swelling K (tr 1)^2; rounding of K = 5 in the sums
    assert abs(shear.ravel() @ stiffness @ shear.ravel() - material.shear_modulus) < 1e-13
    assert abs(swell.ravel() @ stiffness @ swell.ravel() - 9 * material.bulk_modulus) < 1e-12


def test_moduli_of_the_two_readings():
    assert abs(LAWS["A"].shear_modulus - 0.4510) < 1e-15 and abs(LAWS["B"].shear_modulus - 0.3922) < 1e-15  # rounding
    assert "tr(B.B)" in LAWS["A"].name and "classical" in LAWS["B"].name  # every result says which one


def test_from_elastic_has_the_elastic_constants():
    law = materials.from_elastic(210.0, 0.3)
    G, bulk = law.shear_modulus, law.bulk_modulus
    assert abs(9 * bulk * G / (3 * bulk + G) - 210) < 1e-12 and abs((3 * bulk - 2 * G) / (6 * bulk + 2 * G) - 0.3) < 1e-14


@pytest.mark.parametrize("seed", range(3))
def test_a_user_s_energy_is_the_built_in_law(seed):
    F = some_F(seed)
    mine, built_in = user_cube(), isotropic_cube().use("A")
    # two routes to the same numbers: rounding of stresses up to 10
    assert np.abs(mine.evaluate(F) - built_in.evaluate(F)).max() < 1e-13
    K_mine, K_built_in = mine.evaluate(F, want_tangent=True), built_in.evaluate(F, want_tangent=True)
    assert np.abs(K_mine - K_built_in).max() < 1e-13 * np.abs(K_built_in).max() * 10


OGDEN = (0.63, 0.0012, -0.01), (1.3, 5.0, -2.0)


@pytest.mark.parametrize("exponent", [0.05, 0.5, 0.95, 1.0, 2.0, 2.5, 5.75, 12.5, -0.3, -1.0, -1.65, -3.2])
def test_sums_of_powers_of_eigenvalues(exponent):
    """Whole ones exactly, any other to 2e-8, also where eigenvalues are equal."""
    stretches = np.exp(np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2)))
    stretches[:20, 1], stretches[20] = stretches[:20, 0], 1.0
    for one, two in stretches:
        b = np.array([one, two, 1.0 / (one * two)]) ** 2
        error = abs(power_sum(exponent, b.sum(), (1.0 / b).sum()) / (b**exponent).sum() - 1.0)
        assert error < (1e-12 if exponent == round(exponent) else 2e-8)


@cache
def ogden_cube():
    return make_cube(lambda weights: materials.ogden(*OGDEN, K))


@pytest.mark.parametrize(
    "stretches", [(1.0, 1.0, 1.0), (0.5, 1.3, 1.3), (3.0, 0.6, 0.55), (1.2, 1.2, 1.2), (7.0, 0.38, 0.38)]
)
def test_ogden_in_principal_stretches(stretches):
    """tau_i = sum mu_p l_i^alpha_p less its mean, plus the volume's, in a frame that is none of the cube's."""
    J, cube = np.prod(stretches), ogden_cube()
    part = sum(m * (np.array(stretches) / J ** (1 / 3)) ** a for m, a in zip(*OGDEN, strict=True))
    exact = np.diag((part - part.mean() + K * J * (J - 1)) / stretches)
    Q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    P = cube.nominal(Q @ np.diag(stretches) @ Q.T)
    assert np.abs(P - Q @ exact @ Q.T).max() < 2e-7 * max(np.abs(part / stretches).max(), 1.0)  # 2e-8, and the rates'


def test_ogden_with_whole_exponents_is_mooney_rivlin():
    """mu = 2 a1 with alpha 2, -2 a2 with alpha -2."""
    law, mooney = materials.ogden([2 * A1, -2 * A2], [2.0, -2.0], K), LAWS["B"]
    assert abs(law.psi(3.4, 4.1, 1.1) - mooney.psi(3.4, 4.1, 1.1)) < 1e-14
    assert abs(law.shear_modulus - mooney.shear_modulus) < 1e-15


def test_ogden_s_modulus_at_rest():
    cube = ogden_cube()
    stiffness, shear = cube.evaluate(np.eye(3), want_tangent=True), np.zeros((8, 3))
    shear[:, 0] = cube.X[:, 1]
    stated = materials.ogden(*OGDEN, K).shear_modulus
    assert abs(stated - 0.4225) < 1e-12 and abs(shear.ravel() @ stiffness @ shear.ravel() / stated - 1) < 1e-7


@pytest.mark.parametrize("J", [0.7, 1.0, 1.2])
def test_the_barrier_in_pure_swelling(J):
    """No isochoric stress in F = J^(1/3) I, and the pressure U' = K/2 (J - 1/J): any law may take another volume energy."""
    cube = barrier_cube()
    swollen = cube.cauchy(J ** (1 / 3) * np.eye(3))
    assert np.abs(swollen - K / 2 * (J - 1 / J) * np.eye(3)).max() < 1e-13  # rounding of K = 5


@cache
def barrier_cube():
    return make_cube(lambda weights: materials.mooney_rivlin(A1, A2, K, volumetric=materials.barrier))


def test_the_parts_of_a_law_sum_to_it_and_its_name_says_which_volume():
    for make in (materials.mooney_paper, materials.mooney_rivlin):
        law = make(A1, A2, K)
        assert law.psi(3.4, 3.9, 1.3) == pytest.approx(law.isochoric(3.4, 3.9) + law.volumetric(1.3), rel=1e-15)
    assert "barrier" in materials.yeoh(*YEOH, K, volumetric=materials.barrier).name


BAD = {
    "a1": lambda v: materials.mooney_paper(v, A2, K),
    "a1 ": lambda v: materials.mooney_rivlin(v, A2, K),
    "K": lambda v: materials.mooney_paper(A1, A2, v),
    "K ": lambda v: materials.mooney_rivlin(A1, A2, v),
    "mu": lambda v: materials.neo_hooke(v, K),
    "K  ": lambda v: materials.neo_hooke(0.4, v),
    "c1": lambda v: materials.yeoh(v, 0.0, 0.0, K),
    "K   ": lambda v: materials.yeoh(0.2, 0.0, 0.0, v),
    "mu ": lambda v: materials.arruda_boyce(v, 2.5, K),
    "locking": lambda v: materials.arruda_boyce(0.4, v, K),
    "E": lambda v: materials.from_elastic(v, 0.3),
    "shear_modulus": lambda v: materials.user_energy(users_mooney, v, K),
    "bulk_modulus": lambda v: materials.user_energy(users_mooney, 0.4, v),
}


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("name", BAD)
def test_a_bad_modulus_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=rf"\b{name.strip()}\b"):
        BAD[name](value)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("a2", lambda: materials.mooney_paper(A1, np.nan, K)),
        ("a2", lambda: materials.mooney_rivlin(A1, np.nan, K)),
        ("c2", lambda: materials.yeoh(0.2, np.nan, 0.0, K)),
        ("c3", lambda: materials.yeoh(0.2, 0.0, np.inf, K)),
        ("locking", lambda: materials.arruda_boyce(0.4, 1.0, K)),
        ("mu", lambda: materials.ogden([np.nan], [2.0], K)),
        ("alpha", lambda: materials.ogden([1.0], [0.0], K)),
        ("alpha", lambda: materials.ogden([1.0, 2.0], [2.0], K)),
        ("shear modulus", lambda: materials.ogden([1.0], [-2.0], K)),
        ("nu", lambda: materials.from_elastic(1.0, 0.5)),
        ("nu", lambda: materials.from_elastic(1.0, np.nan)),
        ("shear modulus", lambda: materials.mooney_paper(0.1, -0.03, K)),
        ("shear modulus", lambda: materials.mooney_rivlin(0.1, -0.2, K)),
    ],
)
def test_other_bad_parameters_are_refused_by_name(name, make):
    with pytest.raises(ValueError, match=name):
        make()


def test_a_user_s_energy_must_be_a_scalar():
    with pytest.raises(TypeError, match="scalar"):
        materials.user_energy(lambda F: F, 1.0, 1.0)
    with pytest.raises(TypeError, match="scalar"):
        materials.user_energy(lambda F: "0", 1.0, 1.0)


def test_a_negative_second_parameter_is_fine_while_the_law_is_stable_at_rest():
    assert materials.mooney_rivlin(0.2, -0.05, K).shear_modulus > 0
