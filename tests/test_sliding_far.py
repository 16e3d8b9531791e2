"""A block drawn far over an irregular mesh of tetrahedra: friction feels no facets. And two cylinders that slip in part."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Scene, from_elastic, read_gmsh
from fenics_contact.kernels.status import OPEN, SLIP
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton

FRICTION, PRESSURE, WAY = 0.3, 0.05, 27.0  # MPa, mm


def strip(size=0.7):
    """A small block on a long thin strip, both unstructured tetrahedra."""
    occ = gmsh.model.occ
    volumes = [occ.addBox(0, 0, -1, 31, 3, 1), occ.addBox(1, 0.5, 0, 2, 2, 1)]
    occ.synchronize()
    places = {"bottom": (0, -1), "top": (0, 0), "foot": (1, 0), "head": (1, 1)}
    for name, volume in zip(("strip", "block"), volumes, strict=True):
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
    for name, (body, height) in places.items():
        faces = gmsh.model.getBoundary([(3, volumes[body])], oriented=False)
        flat = [f for _, f in faces if abs(gmsh.model.occ.getCenterOfMass(2, f)[2] - height) < 1e-6]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, flat), name)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(3)


@pytest.mark.serial
@pytest.mark.parametrize("points", [2, "nodes"])
def test_a_block_drawn_over_fifty_facets_feels_none_of_them(points):
    mesh = read_gmsh(strip)
    scene = Scene(Body(mesh, "strip", from_elastic(100.0, 0.3)), Body(mesh, "block", from_elastic(100.0, 0.3)))
    scene.fix("bottom")
    scene.fix("head", "y")
    # pressed until t = 0.1, then drawn
    scene.prescribe("head", "x", lambda X, t: np.full(len(X), WAY * max(t - 0.1, 0.0) / 0.9))
    scene.traction("head", lambda t: np.array([0.0, 0.0, -PRESSURE * min(t / 0.1, 1.0)]))
    scene.contact("foot", "top", FRICTION, points=points, name="c")
    system = scene.system()
    contact, state = system.contacts[0], system.state
    stepper = Newton(LinearSolver(system, "direct"))
    found, visited = [], set()
    for t in [0.05, 0.1, *(0.1 + 0.9 * np.array([1e-4, 1e-3, 4e-3, *np.linspace(0, 1, 91)[1:]]))]:
        its=stepper.step(system, t).iterations
        system.commit()
        if t < 0.2:
            continue
        pressure, along = contact.split_traction(state)
        touching = contact.status != OPEN
        assert (contact.status[touching] == SLIP).all()
        law = np.linalg.norm(along, axis=2)[touching] - FRICTION * pressure[touching]
        assert np.abs(law).max() < 1e-9 * pressure.max()
        visited.add(int(contact._project(state)[2][0][0]))
        found.append(contact.measures(state, system.comm)["force"])
    force = np.array(found)
    ratio = -force[:, 0] / force[:, 2]
    print(points, len(visited), np.ptp(force[:, 2]), force[0], ratio.min(), ratio.max(), np.abs(np.diff(ratio)).max(), np.abs(force[:,1]).max())
