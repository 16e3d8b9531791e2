"""Friction of two bodies: blocks drawn far over irregular meshes of tetrahedra, and cylinders that slip in part."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Motion, Scene, Stage, compat, from_elastic, neo_hooke, read_gmsh, rigid_hub, solve
from fenics_contact.kernels.closest_point import NONE
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.meshes import two_cylinders
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
@pytest.mark.parametrize("points", [pytest.param(2, marks=pytest.mark.slow), "corners"])
def test_a_block_drawn_over_fifty_facets_feels_none_of_them(points):
    mesh = read_gmsh(strip)
    scene = Scene(Body(mesh, "strip", from_elastic(100.0, 0.3)), Body(mesh, "block", from_elastic(100.0, 0.3)))
    scene.fix("bottom")
    scene.fix("head", "y")
    scene.prescribe("head", "x", lambda X, t: np.full(len(X), WAY * max(t - 0.1, 0.0) / 0.9))
    scene.traction("head", lambda t: np.array([0.0, 0.0, -PRESSURE * min(t / 0.1, 1.0)]))
    scene.contact("foot", "top", FRICTION, points=points, name="c")
    system = scene.system()
    contact, state = system.contact_terms[0], system.state
    stepper = Newton(LinearSolver(system, "direct"))
    found, visited = [], set()
    # pressed until t = 0.1, then drawn: at first little, for the block shears before it slides
    for t in [0.05, 0.1, *(0.1 + 0.9 * np.array([1e-4, 1e-3, 4e-3, *np.linspace(0, 1, 91)[1:]]))]:
        stepper.step(system, t)
        system.trail.commit()
        if t < 0.2:
            continue
        pressure, along = contact.forces.split_traction(state)
        status = contact.response(state).status
        touching = status != OPEN
        assert (status[touching] == SLIP).all()
        law = np.linalg.norm(along, axis=2)[touching] - FRICTION * pressure[touching]
        assert np.abs(law).max() < 1e-9 * pressure.max()  # round-off of tractions that penetrations of 1e-5 mm give
        visited.add(int(contact.parts.branches(state)[0, 1]))
        found.append(contact.forces.measures(state)["force"])
    force = np.array(found)
    ratio = -force[:, 0] / force[:, 2]
    assert len(visited) >= 50  # another gmsh, another mesh: 50 to 61
    # what balances the dead pressure is 1e-8 of all forces off; slopes of the faces are strains, PRESSURE/E = 5e-4
    assert np.abs(force[:, 2] / (PRESSURE * 4.0) - 1.0).max() < 1e-5
    assert np.abs(ratio / FRICTION - 1.0).max() < 5e-4 and np.abs(np.diff(ratio)).max() < 5e-4 * FRICTION


# -- a block of degree 2 on a pad that is the slave: samples beside its ends miss it -------------------------------------
def block_on_pad(size=0.4):
    for name, box, h in (("block", (0.4, 0.3, 0, 0.8, 0.6, 0.4), 0.8 * size), ("pad", (0, 0, -0.5, 2.4, 1.2, 0.5), size)):
        tag = gmsh.model.occ.addBox(*box)
        gmsh.model.occ.synchronize()
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), name)
        for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False):
            if abs(gmsh.model.getNormal(face, [0.5, 0.5])[2]) > 0.9:
                side = "bottom" if gmsh.model.occ.getCenterOfMass(2, face)[2] < box[2] + 0.1 else "top"
                gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), f"{name}_{side}")
        gmsh.model.mesh.setSize(gmsh.model.getBoundary([(3, tag)], recursive=True), h)
    gmsh.model.mesh.generate(3)


def on_pad():
    """The mesh, the scene and the hub that leads the block."""
    mesh = read_gmsh(block_on_pad)
    scene = Scene(*(Body(mesh, name, neo_hooke(mu, 4.0 * mu)) for name, mu in (("block", 0.5), ("pad", 1.0))), degree=2)
    scene.fix("pad_bottom")
    hub = rigid_hub("hub", (0.8, 0.6, 0.4))
    scene.tie("block_top", hub)
    scene.contact("pad_top", "block_bottom", 0.3, name="c")
    return mesh, scene, hub


def misses(feet):
    """Which samples have a foot beyond the border of its triangle."""
    s, t = feet.projection[3].T
    return (feet.projection[1] != NONE) & (np.minimum(np.minimum(s, t), 1.0 - s - t) < -1e-6)


@pytest.mark.serial
def test_a_sample_that_misses_the_master_keeps_its_facet_while_sights_are_held():
    """Beyond a corner of its end two facets, continued, lie as near: forces jump from the nodes of one to the other's."""
    mesh, scene, _ = on_pad()
    system = scene.system()
    state, contact = system.state, system.contact_terms[0]
    cells = mesh.cell_tags.indices[mesh.cell_tags.values == mesh.volume_tag("block")]
    block = np.unique(compat.cell_dofs(scene.space)[cells])

    def at(way):
        u = np.zeros((len(state.u.x.array) // 3, 3))
        u[block] = way, 0.3 * way, -0.01
        state.u.x.array[:] = u.ravel()
        force = np.zeros_like(state.u.x.array)
        contact.add_residual(state, force, np.zeros_like(system.tool_residual))
        return contact.places.feet(state), force

    def changed(one, other):
        seen = misses(one) & misses(other) & (one.met[6] > 0.1) & (other.met[6] > 0.1)
        return (seen & (one.projection[0] != other.projection[0])).any()

    ways = np.arange(0.0, 0.4, 0.004)
    before, after = next((a, b) for a, b in zip(ways[:-1], ways[1:], strict=True) if changed(at(a)[0], at(b)[0]))
    while after - before > 1e-9:
        middle = 0.5 * (before + after)
        before, after = (before, middle) if changed(at(before)[0], at(middle)[0]) else (middle, after)
    jump = np.linalg.norm(at(after)[1] - at(before)[1])
    feet, force = at(before)
    contact.hold_sights(state)
    held, now = at(after)
    np.testing.assert_array_equal(held.projection[0][misses(feet)], feet.projection[0][misses(feet)])
    assert np.linalg.norm(now - force) < 1e-4 * jump
    contact.rollback()
    at(0.0)
    assert changed(feet, at(after)[0])  # free again


@pytest.mark.parallel
def test_a_block_dragged_over_a_pad_where_samples_beside_its_end_pass_from_facet_to_facet():
    """On either side of such a place no state was in balance under what it saw itself: "no convergence" after 14 cut-backs,
    whatever the steps. It slides: T = mu N, but for what acts aside at its edges."""
    forces = []
    for steps in (8, 12):
        _, scene, hub = on_pad()
        drag = Stage("drag", move={hub: Motion(x=0.8)}, steps=steps)
        result = solve(scene, stages=[Stage("press", move={hub: Motion(z=-0.04)}, steps=1), drag]).require()
        assert result.verdict.cuts == 0
        forces.append([result.column(f"hub_force_{axis}_N")[-1] for axis in "xz"])
    assert abs(forces[1][0]) == pytest.approx(0.3 * abs(forces[1][1]), rel=0.02)
    np.testing.assert_allclose(*forces, rtol=0.02)


# ---- partial slip of two equal cylinders (Cattaneo 1938, Mindlin 1949; Johnson 1985, 7.2)

R, E, NU, MU, DEPTH = 8.0, 200.0, 0.3, 0.2, 0.1
STAR = E / (2 * (1 - NU**2))
# The published case, 10 N/mm and 0.936 N/mm, strains the cylinders by p0/E = 5 %, which linear theory knows nothing of: its
# half-width comes out 1.2 % too large. In that theory all lengths and pressures go with the root of the forces, so this is
# done at 1/39 of them and strains of 0.8 %. The approach is found by trial: it depends on the bodies' whole shape, and no
# closed form gives it.
DOWN, ALONG, FINE, CELLS = 0.0074, 0.0011, 0.16, 36  # mm
PUBLISHED = {"F": 10.0, "Q": 16 * 0.05851, "a": 0.680778, "p0": 9.35135, "c": 0.496511}  # N/mm, mm, MPa


def pressed_and_drawn():
    """Per point of the rim: place X along it [mm], pressure, friction, status; normal and tangential force [N/mm]."""
    mesh = read_gmsh(two_cylinders.build, radius=R, fine=FINE, cells=CELLS, depth=DEPTH)
    scene = Scene(Body(mesh, "lower", from_elastic(E, NU)), Body(mesh, "upper", from_elastic(E, NU)))
    scene.fix("lower_axis")
    scene.fix("ends", "y")
    scene.prescribe("upper_axis", "x", lambda X, t: np.full(len(X), ALONG * max(2 * t - 1, 0.0)))
    scene.prescribe("upper_axis", "z", lambda X, t: np.full(len(X), -DOWN * min(2 * t, 1.0)))
    scene.contact("upper_rim", "lower_rim", MU, name="c")
    result = solve(scene, steps=4)
    assert result.converged, result.verdict.reason
    contact = result.system.contact_terms[0]
    pressure, along = contact.forces.split_traction(result.system.state)
    force = result.history[-1]
    # per reference area over reference places, so that their integral is the force
    x = contact.spots()[:, 0]
    friction = np.abs(along[..., 0]).ravel()
    return x, pressure.ravel(), friction, contact.statuses(), force["c_force_z_N"] / DEPTH, -force["c_force_x_N"] / DEPTH


def fitted(x, square, reach):
    """Middle, half-width [mm] and top of an ellipse: a parabola through squares (n,) at places x (n,) within `reach`.

    Beyond it, a fifth of the half-width from the rim, the mesh rounds the ellipse's steep end off.
    """
    curve = np.polyfit(x[np.abs(x) < reach], square[np.abs(x) < reach], 2)
    middle = -curve[1] / (2 * curve[0])
    top = np.polyval(curve, middle)
    return middle, np.sqrt(-top / curve[0]), np.sqrt(top)


@pytest.mark.slow
@pytest.mark.serial
def test_two_cylinders_slip_at_the_rim_of_their_contact():
    x, pressure, friction, status, F, Q = pressed_and_drawn()
    assert abs(Q / F / (PUBLISHED["Q"] / PUBLISHED["F"]) - 1) < 0.01
    scale = np.sqrt(F / PUBLISHED["F"])
    a, p0, c = (scale * PUBLISHED[name] for name in ("a", "p0", "c"))
    middle, width, top = fitted(x, pressure**2, 0.8 * a)
    # in stick mu p - |q| is an ellipse too, of half-width c and height mu p0 c/a
    _, stick, rest = fitted(x - middle, (MU * pressure - friction) ** 2, 0.8 * c)
    # 1 %: asked of every published value
    assert abs(width / a - 1) < 0.01 and abs(top / p0 - 1) < 0.01 and abs(stick / c - 1) < 0.01
    assert abs(rest / (MU * p0 * c / a) - 1) < 0.01
    cell, place = 2 * FINE / CELLS, np.abs(x - middle)  # no point within a cell of the stick's edge is judged
    assert (status[place < c - cell] == STICK).all()
    assert (status[(pressure > 0) & (place > c + cell)] == SLIP).all()
    assert np.abs(a - 2 * np.sqrt(F * R / 2 / (np.pi * STAR))) < 1e-3 * a  # the published case is this one
