"""The rate form of the virtual power: derivative of its residual on hexahedra of degree 1 and 2 and on tetrahedra."""

from dataclasses import dataclass
from functools import cache

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from fenics_contact import compat
from fenics_contact.assembly.facet_points import skin_of
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import box
from fenics_contact.solid import materials, virtual_power

pytestmark = pytest.mark.serial

A1, A2, K = 0.1863, 0.0098, 5.0
LAWS = {
    "Mooney, paper": materials.mooney_paper(A1, A2, K),
    "Mooney-Rivlin": materials.mooney_rivlin(A1, A2, K),
    "neo-Hooke": materials.neo_hooke(0.4, K),
    "Yeoh": materials.yeoh(0.2, -0.01, 0.003, K),
    # product terms of the invariants, which none of the above has: every mixed second derivative counts
    "coupled": materials.Isotropic("coupled", lambda I1, I2, J: 0.1 * I1 * I2 / J + 0.2 * I1**2 * J + 2 * J**3, 1, 1),
}


def draw_tetrahedra():
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.6)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "box")


def weighted(weights):
    """The energy sum_i w_i psi_i: one compiled form serves every law."""

    def psi(*invariants):
        return sum(weights[i] * law.psi(*invariants) for i, law in enumerate(LAWS.values()))

    return materials.Isotropic("weighted", psi, 1.0, 1.0)


def users_energy(F):
    """Neither isotropic nor one of the built-in laws: a matrix with a fibre along (1, 2, 0)."""
    C, J = F.T * F, ufl.det(F)
    fibre = ufl.as_vector([5**-0.5, 2 * 5**-0.5, 0.0])
    return 0.3 * (ufl.tr(C) - 3 - 2 * ufl.ln(J)) + K / 2 * ufl.ln(J) ** 2 + 0.2 * (ufl.inner(C * fibre, fibre) - 1) ** 2


@dataclass
class Solid:
    """A distorted mesh with residual, rate tangent and the derivative UFL takes of the residual."""

    u: object
    weights: object
    forms: dict

    def use(self, law):
        self.weights.value[:] = [float(name == law) for name in LAWS]
        return self

    def residual(self, values):
        self.u.x.array[:] = values
        out = np.zeros(len(values))
        compat.assemble_vector(out, self.forms["residual"])
        return out

    def matrix(self, name, values):
        self.u.x.array[:] = values
        A = compat.create_matrix(self.forms[name])
        compat.assemble_matrix(A, self.forms[name])
        A.assemble()
        rows, columns, entries = A.getValuesCSR()
        out = csr_matrix((entries.copy(), columns.copy(), rows.copy()))
        A.destroy()
        return out

    def displacement(self):
        """Some smooth finite strain with a random part on top that inverts nothing (J is checked by the tests)."""
        X = self.u.function_space.tabulate_dof_coordinates()
        rng = np.random.default_rng(8)
        smooth = np.stack([0.3 * X[:, 0] + 0.2 * X[:, 1] ** 2, -0.2 * X[:, 1] * X[:, 2], 0.25 * np.sin(X[:, 0])], axis=1)
        return (smooth + 0.02 * rng.uniform(-1, 1, X.shape)).ravel()


def distort(domain, size):
    """Move every vertex a little: no cell is a box any more."""
    x = domain.geometry.x
    x += size * np.random.default_rng(3).uniform(-1, 1, x.shape)


MESHES = {
    # script, its parameters, degree, Gauss order, distortion
    "hex 1": (box.build, {"cells": (2, 2, 2)}, 1, 3, 0.08),
    "hex 2": (box.build, {"cells": (2, 1, 1)}, 2, 4, 0.06),
    "tet 1": (draw_tetrahedra, {}, 1, 1, 0.03),
}


@cache
def solid(mesh, kind="isotropic"):
    script, parameters, degree, order, distortion = MESHES[mesh]
    domain = read_gmsh(script, MPI.COMM_SELF, **parameters).domain
    distort(domain, distortion)
    space = compat.lagrange_space(domain, degree, (3,))
    u, v, du = compat.Function(space), ufl.TestFunction(space), ufl.TrialFunction(space)
    weights = compat.Constant(domain, np.zeros(len(LAWS)))
    material = weighted(weights) if kind == "isotropic" else materials.user_energy(users_energy, 0.6, K)
    dx = ufl.Measure("dx", domain=domain, metadata={"quadrature_degree": order})
    power = virtual_power.stress_power(material, u, v, dx)
    forms = {
        "residual": power,
        "rate": virtual_power.stress_power_rate(material, u, du, v, dx),
        "derivative": ufl.derivative(power, u, du),
    }
    return Solid(u, weights, {name: compat.compile_form(form) for name, form in forms.items()})


CASES = [(mesh, "isotropic", law) for mesh in MESHES for law in LAWS] + [
    ("hex 1", "user", "user"),
    ("tet 1", "user", "user"),
]


@pytest.mark.parametrize(("mesh", "kind", "law"), CASES)
def test_tangent_is_the_derivative_of_the_residual(mesh, kind, law):
    s = solid(mesh, kind).use(law)
    u = s.displacement()
    R, A = s.residual(u), s.matrix("rate", u)
    direction = np.random.default_rng(1).uniform(-1, 1, len(u))
    steps = 2e-3 / 2.0 ** np.arange(4)
    remainders = np.array([np.linalg.norm(s.residual(u + h * direction) - R - h * A @ direction) for h in steps])
    # third-order terms shift the order by about step over cell size, 2e-3 / 0.3, times a few
    assert np.log2(remainders[:-1] / remainders[1:]).min() > 1.9
    assert remainders[-1] > 1e-9 and np.linalg.norm(steps[0] * A @ direction) > 5 * remainders[0]


@pytest.mark.parametrize(("mesh", "kind", "law"), CASES)
def test_tangent_is_ufl_s_derivative_to_round_off(mesh, kind, law):
    s = solid(mesh, kind).use(law)
    u = s.displacement()
    rate, derivative = s.matrix("rate", u).toarray(), s.matrix("derivative", u).toarray()
    # two orders of summing the same some hundred products
    assert np.abs(rate - derivative).max() < 1e-12 * np.abs(derivative).max()


@pytest.mark.parametrize(("mesh", "kind", "law"), CASES)
def test_tangent_is_symmetric_and_indifferent(mesh, kind, law):
    s = solid(mesh, kind).use(law)
    u = s.displacement()
    R, A = s.residual(u), s.matrix("rate", u)
    scale = abs(A).max()
    assert abs(A - A.T).max() < 1e-13 * scale  # sums in another order
    x = (s.u.function_space.tabulate_dof_coordinates() + u.reshape(-1, 3)).reshape(-1, 3)
    assert np.abs(R.reshape(-1, 3).sum(axis=0)).max() < 1e-13 * scale  # no resultant force
    assert np.abs(np.cross(x, R.reshape(-1, 3)).sum(axis=0)).max() < 1e-12 * scale  # nor moment, over 100 nodes
    for axis in range(3):
        spin = np.cross(np.eye(3)[axis], x).ravel()
        turned = np.cross(np.eye(3)[axis], R.reshape(-1, 3)).ravel()
        assert np.abs(A @ spin - turned).max() < 1e-12 * scale  # the forces turn with the body
        assert np.abs(A @ np.tile(np.eye(3)[axis], len(x))).max() < 1e-12 * scale


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("law", ["Mooney, paper", "Mooney-Rivlin"])
def test_patch(mesh, law):
    """A linear displacement on the boundary of an irregular mesh: linear inside, constant stress, no force inside."""
    s = solid(mesh).use(law)
    space = s.u.function_space
    X = space.tabulate_dof_coordinates()
    F = np.array([[1.3, 0.2, -0.1], [0.05, 0.8, 0.15], [0.1, -0.1, 1.1]])
    exact = (X @ (F - np.eye(3)).T).ravel()
    domain = space.mesh
    domain.topology.create_connectivity(2, 3)
    facets = np.flatnonzero(np.diff(domain.topology.connectivity(2, 3).offsets) == 1)
    held = np.repeat(np.isin(np.arange(len(X)), compat.locate_blocks(space, facets)), 3)
    free = np.flatnonzero(~held)
    assert len(free) > 0
    assert np.abs(s.residual(exact)[free]).max() < 1e-14 * 10  # cancelling sums of forces of size 1

    u = np.where(held, exact, exact + 0.01 * np.sin(np.arange(len(exact))))  # solve from beside the answer
    for _ in range(6):
        A = s.matrix("rate", u)[free][:, free]
        u[free] -= splu(A.tocsc()).solve(s.residual(u)[free])
    assert np.abs(u - exact).max() < 1e-13

    # stress of Mooney's law in B^ = J^(-2/3) F F^T, (20)
    J = np.linalg.det(F)
    B = F @ F.T / J ** (2 / 3)
    second = 2 * B @ B if law == "Mooney, paper" else np.trace(B) * B - B @ B
    tau = 2 * (A1 * B + A2 * second)
    sigma = (tau - np.trace(tau) / 3 * np.eye(3)) / J + K * (J - 1) * np.eye(3)
    stress = virtual_power.cauchy_stress(LAWS[law], s.u)
    point = np.full((1, 3), 0.21)
    seen = compat.cell_evaluator(domain, stress, point)().reshape(-1, 3, 3)
    assert len(seen) > 1 and np.abs(seen - sigma).max() < 1e-12  # gradients of u good to 1e-13, times K


def test_loads():
    """Dead traction and body force give their resultants; the current area is Nanson's."""
    mesh = read_gmsh(box.build, MPI.COMM_SELF, size=(2.0, 1.0, 1.0), cells=(2, 1, 1))
    space = compat.lagrange_space(mesh.domain, 1, (3,))
    v = ufl.TestFunction(space)
    load = compat.Constant(mesh.domain, np.array([0.3, -0.2, 0.7]))
    order = {"quadrature_degree": 2}  # exact for loads; the strain is constant
    ds = ufl.Measure("ds", domain=mesh.domain, subdomain_data=mesh.facet_tags, metadata=order)
    ds = ds(mesh.surface_tags("zmax")[0])
    out = np.zeros((2, 36))
    compat.assemble_vector(out[0], compat.compile_form(virtual_power.dead_traction_power(load, v, ds)))
    compat.assemble_vector(out[1], compat.compile_form(virtual_power.body_force_power(load, v, ufl.dx(mesh.domain))))
    X = space.tabulate_dof_coordinates()
    for forces in out.reshape(2, -1, 3):
        assert np.abs(forces.sum(axis=0) - 2 * load.value).max() < 1e-14  # area and volume are two
    assert not out[0].reshape(-1, 3)[X[:, 2] < 0.5].any()

    F = np.array([[1.3, 0.2, -0.1], [0.05, 0.8, 0.15], [0.1, -0.1, 1.1]])
    skin = skin_of(space, mesh.facets("zmax"))
    assert abs(skin.area.sum() - 2.0) < 1e-14
    area = skin.current_area(skin.X @ F.T)
    assert abs(area.sum() - 2 * np.linalg.norm(np.cross(F[:, 0], F[:, 1]))) < 1e-14 * 10  # |F e_x x F e_y| per area
