"""Follower pressure: no resultant on a closed surface, exact tangent, symmetry where it has a potential, closed forms."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

from fenics_contact import Body, Scene, SceneError, compat, mooney_rivlin, neo_hooke, read_gmsh, solve
from fenics_contact.assembly.blocks import insert
from fenics_contact.assembly.exchange import copy_to_ghosts, sum_to_owners
from fenics_contact.meshes import box

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
ALL = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")


@pytest.fixture(scope="module")
def mesh():
    return read_gmsh(box.build, size=(3.0, 2.0, 1.0), cells=(3, 2, 2))


def loaded(mesh, groups=ALL, degree=1, planes="xyz"):
    """A system with pressure 0.4 on some faces of a block, deformed at random within its supports."""
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), degree=degree)
    for axis in planes:
        scene.fix(f"{axis}min", axis)
    scene.fix("zmin", "xyz".replace(planes, "") if len(planes) == 1 else "z")
    scene.pressure(groups, 0.4)
    system = scene.system()
    system.set_loads(1.0)
    disturb(system, 0.05)
    return scene, system


def disturb(system, size, supported=True):
    """Add a smooth field that does not depend on the partition and vanishes on supported dofs; returns the increment."""
    X = system.space.tabulate_dof_coordinates()
    field = size * np.column_stack([np.sin(1.3 * X @ k + p) for k, p in (((1, 2, 1), 0), ((2, -1, 1), 1), ((-1, 1, 2), 2))])
    du = system.new_vector()
    with du.localForm() as local:
        local.array_w[:] = field.ravel()
        if supported:
            local.array_w[system.supports.dofs] = 0.0
    copy_to_ghosts(du)
    system.update(du, 0.0)
    return du


def pressure_forces(system):
    vector = system.new_vector()
    with vector.localForm() as local:
        local.set(0.0)
        system.terms[1].add_residual(system.state, local.array_w, None)
    sum_to_owners(vector)
    return vector


@pytest.mark.parametrize("degree", [1, 2])
def test_no_resultant_on_a_closed_surface(mesh, degree):
    _, system = loaded(mesh, degree=degree)
    disturb(system, 0.3, supported=False)
    forces = pressure_forces(system).array.reshape(-1, 3)
    X = system.space.tabulate_dof_coordinates()[: len(forces)]
    x = X + system.state.u.x.array.reshape(-1, 3)[: len(forces)]
    total = COMM.allreduce(np.concatenate([forces.sum(axis=0), np.cross(x, forces).sum(axis=0)]))
    largest = COMM.allreduce(np.abs(forces).sum())
    assert np.abs(total).max() < 1e-13 * largest  # the facets' integrals are exact polynomials: round-off only


@pytest.mark.parametrize("degree", [1, 2])
def test_load_tangent_taylor(mesh, degree):
    """|f(u + s w) - f(u) - s K w| falls with s^2, down to where round-off would show."""
    _, system = loaded(mesh, degree=degree)
    before = pressure_forces(system)
    matrix = compat.create_matrix(system.terms[1].tangent_form)
    insert(system.terms[1].tangent(system.state), matrix, None)
    matrix.assemble()
    start, remainders = system.vector.copy(), []
    direction = disturb(system, 1.0)
    for s in (1e-1, 1e-2, 1e-3):
        start.copy(system.vector)
        step = direction.copy()
        step.scale(s)
        system.update(step, 0.0)
        rest = pressure_forces(system)
        rest.axpy(-1.0, before)
        rest.axpy(-1.0, matrix * step)
        remainders.append(rest.norm())
    orders = np.log10(np.array(remainders[:-1]) / remainders[1:])
    assert np.all(np.abs(orders - 2.0) < 0.1), orders


def test_symmetric_where_it_has_a_potential(mesh):
    """Between symmetry planes the pressure's surface cannot leave a potential; with a free edge it does."""
    assert loaded(mesh, ("xmax", "ymax", "zmax"))[1].symmetric
    assert not loaded(mesh, "zmax", planes="x")[1].symmetric


def test_equal_pressure_on_a_cube(mesh):
    """Pressure p on every deformed face leaves J with K (J - 1) = -p: volume change only."""
    scene = Scene(Body(mesh, "box", mooney_rivlin(0.1863, 0.0098, 5.0)))
    for axis in "xyz":
        scene.fix(f"{axis}min", axis)
    scene.pressure(("xmax", "ymax", "zmax"), 0.5)
    result = solve(scene, steps=2)
    assert result.converged and result.column("iterations").max() <= 5
    size = COMM.allreduce(np.max(result.u.x.array.reshape(-1, 3)[:, 0] * -1.0, initial=0.0), op=MPI.MAX)
    assert abs((1 - size / 3.0) ** 3 - 0.9) < 1e-9  # solver tolerance


def test_pressure_follows_the_stretched_face(mesh):
    """One face pressed, sides free: Cauchy stress, not nominal stress, equals -p (neo-Hooke, uniaxial)."""
    mu, K, p = 1.0, 5.0, 0.6
    scene = Scene(Body(mesh, "box", neo_hooke(mu, K)))
    for axis in "xyz":
        scene.fix(f"{axis}min", axis)
    scene.pressure("zmax", lambda t: p * t * t)
    result = solve(scene, steps=4)

    def stresses(stretch):
        def lateral(b):
            J = stretch * b * b
            return mu * J ** (-5 / 3) * (b * b - (stretch**2 + 2 * b * b) / 3) + K * (J - 1)

        b = brentq(lateral, 0.9, 1.5, xtol=1e-14)
        J = stretch * b * b
        return mu * J ** (-5 / 3) * (stretch**2 - (stretch**2 + 2 * b * b) / 3) + K * (J - 1)

    exact = brentq(lambda s: stresses(s) + p, 0.5, 1.0, xtol=1e-14)
    down = COMM.allreduce(np.max(-result.u.x.array[2::3], initial=0.0), op=MPI.MAX)
    assert abs((1.0 - down) - exact) < 1e-8  # solver tolerance


def inner():
    """A block of two layers, one volume on either side of the surface "middle"."""
    base = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    low = gmsh.model.occ.extrude([(2, base)], 0, 0, 1, numElements=[2], recombine=True)
    high = gmsh.model.occ.extrude([low[0]], 0, 0, 1, numElements=[2], recombine=True)
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getEntities(1):
        gmsh.model.mesh.setTransfiniteCurve(curve, 3)
    gmsh.model.mesh.setTransfiniteSurface(base)
    gmsh.model.mesh.setRecombine(2, base)
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [low[1][1], high[1][1]]), "box")
    for name, surface in (("middle", low[0]), ("top", high[0])):
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [surface[1]]), name)


def test_pressure_inside_the_body_is_refused():
    scene = Scene(Body(read_gmsh(inner), "box", neo_hooke(1.0, 5.0)))
    with pytest.raises(SceneError, match="inside the material"):
        scene.pressure("middle", 1.0)
    with pytest.raises(SceneError, match="inside the material"):
        scene.traction("middle", (0, 0, 1.0))
    with pytest.raises(ValueError, match="'lid'"):
        scene.pressure("lid", 1.0)
    with pytest.raises(SceneError, match="one finite number"):
        scene.pressure("top", float("nan"))
