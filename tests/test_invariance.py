"""What must not matter does not: units, the frame, the numbering of nodes and cells, the order of contacts."""

from dataclasses import replace

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import Body, Scene, Units, mooney_rivlin, read_gmsh, rigid_plane, rigid_punch, solve
from meshes import box, two_blocks

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
SAME = 1e-8  # Newton ends at 1e-11 of the force; stiffness and history of three steps enlarge that by far less than 1e3
COUNTS = ("active_points", "sticking_points")


def turned(Q=None, seed=None, **parameters):
    """The box with its nodes at Q X, and with nodes and cells numbered by chance where a seed is given."""
    Q = np.eye(3) if Q is None else Q
    rng = np.random.default_rng(seed)
    box.build(**parameters)
    tags, X, _ = gmsh.model.mesh.getNodes()
    numbers = tags if seed is None else rng.permutation(tags)
    new = dict(zip(tags.tolist(), numbers.tolist(), strict=True))
    places = dict(zip(tags.tolist(), X.reshape(-1, 3) @ Q.T, strict=True))
    entities, groups = gmsh.model.getEntities(), gmsh.model.getPhysicalGroups()
    nodes = {e: gmsh.model.mesh.getNodes(*e)[0].tolist() for e in entities}
    elements = {e: gmsh.model.mesh.getElements(*e) for e in entities if e[0] > 1}
    named = [(dim, gmsh.model.getEntitiesForPhysicalGroup(dim, tag), gmsh.model.getPhysicalName(dim, tag))
             for dim, tag in groups]  # fmt: skip
    gmsh.model.add("turned")
    for dim, tag in entities:
        gmsh.model.addDiscreteEntity(dim, tag)
        own = nodes[dim, tag]
        if own:
            x = np.concatenate([places[node] for node in own])
            gmsh.model.mesh.addNodes(dim, tag, [new[node] for node in own], x)
    for (_, tag), (kinds, _, corners) in elements.items():
        for kind, rows in zip(kinds, corners, strict=True):
            rows = rows.reshape(-1, gmsh.model.mesh.getElementProperties(kind)[3])
            rows = rows if seed is None else rng.permutation(rows)
            gmsh.model.mesh.addElementsByType(tag, kind, [], [new[int(node)] for node in rows.ravel()])
    for dim, members, name in named:
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, members), name)


def punched(length=1.0, pressure=1.0, Q=None, seed=None, turn_contacts=False, **options):
    """A block on a rough floor, pressed by a rough punch and then dragged by it; lengths and pressures in other units.

    Returns, per accepted step, forces and moments turned back, and everything else in the units of the start.
    """
    Q = np.eye(3) if Q is None else Q
    size, origin = (np.array(v) * length for v in ((8.0, 8.0, 4.0), (-4.0, -4.0, -4.0)))
    mesh = read_gmsh(turned, size=tuple(size), cells=(4, 4, 2), origin=tuple(origin), Q=Q, seed=seed)
    scene = Scene(
        Body(mesh, "box", mooney_rivlin(a1=0.1863 * pressure, a2=0.0098 * pressure, K=5.0 * pressure)),
        units=Units("L", "F", "P"),
    )
    punch = rigid_punch(half_width=2.1 * length, height=4.0 * length, fillet=0.5 * length)
    floor = rigid_plane((0, 0, -4.0 * length), name="floor")
    punch, floor = (replace(tool, axes=Q @ tool.axes, origin=Q @ tool.origin) for tool in (punch, floor))
    statements = [("zmax", punch, 0.3, "punch"), ("zmin", floor, 0.6, "floor")]
    for slave, tool, friction, name in reversed(statements) if turn_contacts else statements:
        scene.contact(slave, tool, friction, name=name, **options)

    def path(t):
        return length * Q @ [0.6 * max(t - 1 / 3, 0.0), 0.2 * max(t - 1 / 3, 0.0), -0.5 * min(3.0 * t, 1.0)]

    result = solve(scene, move={punch: path}, steps=3, tolerance=1e-11, progress=False).require()
    force = pressure * length**2
    units = {"force": force, "moment": force * length, "area": length**2, "penetration": length}
    rows = []
    for row in result.history:
        found = {}
        for contact in ("punch", "floor"):
            for what in ("force", "moment"):
                unit = {"force": "F", "moment": "FL"}[what]
                found[f"{contact} {what}"] = Q.T @ [row[f"{contact}_{what}_{a}_{unit}"] for a in "xyz"] / units[what]
            found[f"{contact} area"] = row[f"{contact}_area_L2"] / units["area"]
            found[f"{contact} penetration"] = row[f"{contact}_penetration_L"] / length
            found |= {f"{contact} {count}": row[f"{contact}_{count}"] for count in COUNTS}
        rows.append(found | {"smallest J": row["smallest_J"]})
    rows.append({"displacement": result.system.vector.norm() / length})
    return rows


@pytest.fixture(scope="module")
def plain():
    rows = punched()
    assert 0 < rows[2]["punch sticking_points"] < rows[2]["punch active_points"]  # friction in both its states
    return rows


def assert_same(rows, others):
    size = {"force": 0.0, "moment": 0.0, "penetration": 1e-13 / SAME}  # coordinates of 4 have round-off 1e-15
    for row in others:
        for name in row:
            kind = name.rsplit(" ", 1)[-1]
            if kind in ("force", "moment"):
                size[kind] = max(size[kind], np.abs(row[name]).max())
    for row, other in zip(rows, others, strict=True):
        for name in other:
            kind = name.rsplit(" ", 1)[-1]
            if kind in COUNTS:
                assert row[name] == other[name], name
            else:
                np.testing.assert_allclose(row[name], other[name], rtol=SAME, atol=SAME * size.get(kind, 0.0), err_msg=name)


@pytest.mark.parametrize(
    ("length", "pressure"), [(1e-3, 1e6), (1e3, 1e-3), (3.7e5, 1.9e-7)], ids=["m, Pa", "um, GPa", "odd"]
)
def test_units(plain, length, pressure):
    assert_same(punched(length, pressure), plain)


def rotation():
    """By 1.1 radians about an axis along none of x, y, z."""
    a = np.array([0.3, -0.8, 0.5]) / np.linalg.norm([0.3, -0.8, 0.5])
    cross = np.cross(np.eye(3), a)
    return np.eye(3) + np.sin(1.1) * cross + (1 - np.cos(1.1)) * cross @ cross


def test_rotation_of_the_whole_scene(plain):
    assert_same(punched(Q=rotation()), plain)


@pytest.mark.parametrize("seed", [1, 2])
def test_numbering(plain, seed):
    assert_same(punched(seed=seed), plain)


def test_order_of_the_contacts(plain):
    assert_same(punched(turn_contacts=True), plain)


def test_augmented_contact_in_other_units_and_turned():
    """Multipliers add lengths of their own to the history."""
    one = punched(penetration=1e-6)
    assert_same(punched(1e-3, 1e6, rotation(), penetration=1e-9), one)


def test_swap_of_slave_and_master():
    """One pass over one side's points: sides may be swapped at the price of the discretisation, no more."""
    forces = []
    for swap in (False, True):
        law = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
        mesh = read_gmsh(two_blocks.build, lower_cells=(8, 8, 3), upper_cells=(5, 5, 3))
        scene = Scene(Body(mesh, "lower", law), Body(mesh, "upper", law))
        scene.fix("lower_bottom")
        scene.fix("upper_top", "xy")
        scene.prescribe("upper_top", "z", -1.0)
        pair = ("upper_bottom", "lower_top")
        scene.contact(*(pair[::-1] if swap else pair), 0.3, name="c")
        forces.append(abs(solve(scene, steps=2, progress=False).require().history[-1]["c_force_z_N"]))
    # 5 mm cells over a block of 20 mm whose edges press in: the force of either is some percent off its limit
    np.testing.assert_allclose(*forces, rtol=0.05)
    assert abs(forces[0] / forces[1] - 1.0) > 1e-6  # they are not the same contact by chance
