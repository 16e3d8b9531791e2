"""What must not matter does not: units, the frame, numbering, the order of contacts, ranks, restarts, steps cut back."""

import json
from dataclasses import dataclass, field, replace
from functools import partial

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from test_steppers import on_ranks

from fenics_contact import (
    Body,
    Method,
    Output,
    Scene,
    Stage,
    Units,
    from_elastic,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box, ironing, rectangles, two_blocks
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.softened import Softened

COMM = MPI.COMM_WORLD
SAME = 1e-8  # Newton ends at 1e-11 of the force; stiffness and history of a few steps enlarge that by far less than 1e3
EXACT = 1e-10  # the same numbers in the same order, or steps that end at 1e-11
COUNTS = ("points", "sticking")
UNITS = {"m, Pa": (1e-3, 1e6), "um, GPa": (1e3, 1e-3), "odd": (3.7e5, 1.9e-7)}


@dataclass
class Frame:
    """How a scene is written: lengths and pressures in other units, turned by Q, numbered by chance, contacts reversed."""

    length: float = 1.0
    pressure: float = 1.0
    Q: np.ndarray = field(default_factory=lambda: np.eye(3))
    seed: int | None = None
    turn_contacts: bool = False

    def vector(self, *v):
        return self.length * self.Q @ v

    def mesh(self, build, **parameters):
        return read_gmsh(turned, build=partial(build, **parameters), length=self.length, Q=self.Q, seed=self.seed)

    def lead(self, scene, group, path):
        """Displacement of a group along path(t) -> (3,) in the first frame's units."""
        for i, axis in enumerate("xyz"):
            scene.prescribe(group, axis, lambda X, t, i=i: np.full(len(X), self.vector(*path(t))[i]))

    def tool(self, tool):
        lengths = {"shape": self.length * tool.shape, "extent": self.length * tool.extent}
        return replace(tool, axes=self.Q @ tool.axes, origin=self.vector(*tool.origin), **lengths)

    def contacts(self, scene, statements, options):
        for slave, master, friction, name in reversed(statements) if self.turn_contacts else statements:
            scene.contact(slave, master, friction, name=name, **options)

    def rubber(self):
        return mooney_rivlin(*(self.pressure * a for a in (0.1863, 0.0098, 5.0)))


def turned(build, length, Q, seed):
    """A mesh with its nodes at Q X times a length, and with nodes and cells numbered by chance where a seed is given."""
    rng = np.random.default_rng(seed)
    build()
    tags, X, _ = gmsh.model.mesh.getNodes()
    numbers = tags if seed is None else rng.permutation(tags)
    new = dict(zip(tags.tolist(), numbers.tolist(), strict=True))
    places = dict(zip(tags.tolist(), length * X.reshape(-1, 3) @ Q.T, strict=True))
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


# -- three scenes, each pressed and then dragged with friction --------------------------------------------------------
def on_a_floor(frame, tool, friction, **options):
    """A block on a rough floor, pressed by a rough tool and then dragged by it."""
    mesh = frame.mesh(box.build, size=(8.0, 8.0, 4.0), cells=(4, 4, 2), origin=(-4.0, -4.0, -4.0))
    scene = Scene(Body(mesh, "box", frame.rubber()), units=Units("L", "F", "P"))
    tool, floor = (frame.tool(t) for t in (tool, rigid_plane((0, 0, -4.0), name="floor")))
    frame.contacts(scene, [("zmax", tool, friction, "top"), ("zmin", floor, 0.9, "floor")], options)

    def path(t):
        return frame.vector(0.6 * max(t - 1 / 3, 0.0), 0.2 * max(t - 1 / 3, 0.0), -0.5 * min(3.0 * t, 1.0))

    return scene, {"move": {tool: path}, "steps": 3}


def punch(frame, **options):
    return on_a_floor(frame, rigid_punch(half_width=2.1, height=4.0, fillet=0.5), 0.3, **options)


def ball(frame, **options):
    return on_a_floor(frame, rigid_sphere(10.0, (0.2, -0.1, 10.0)), 0.5, **options)


def iron(frame, **options):
    """A short strip of the ironing scene, free at its ends: a stiff round indenter is pressed in and drawn along, and so is
    a rigid roller beside it, the other way."""
    mesh = frame.mesh(ironing.build, length=4.0, height=2.0, foundation=(12, 3), indenter=(6, 2), depth=0.5, growth=1.2)
    soft, stiff = (from_elastic(E * frame.pressure, 0.32) for E in (689.6, 6896.0))
    scene = Scene(Body(mesh, "foundation", soft), Body(mesh, "indenter", stiff), units=Units("L", "F", "P"))
    scene.fix("foundation_bottom")
    frame.lead(scene, "indenter_top", lambda t: (0.2 * max(t - 0.5, 0.0), 0.05 * max(t - 0.5, 0.0), -min(1.2 * t, 0.6)))
    roller = frame.tool(rigid_cylinder(0.6, (2.9, 0.0, 0.65), name="roller"))
    pairs = [("foundation_top", "indenter_under", 0.3, "top"), ("foundation_top", roller, 0.4, "roller")]
    frame.contacts(scene, pairs, options)

    def path(t):
        return frame.vector(-0.2 * max(t - 0.5, 0.0), 0.05 * max(t - 0.5, 0.0), -min(0.5 * t, 0.25))

    return scene, {"move": {roller: path}, "steps": np.arange(1, 7) / 6}


SCENES = {"punch": punch, "ball": ball, "ironing": iron}


def run(name, frame=None, **options):
    frame = frame or Frame()
    scene, drive = SCENES[name](frame, **options)
    return rows(solve(scene, **drive, method=Method(tolerance=1e-11)).require(), frame)


def rows(result, frame):
    """What a run gives per accepted step: forces and moments turned back, everything else in the units of the start."""
    length, force = frame.length, frame.pressure * frame.length**2
    units = {"force": ("F", force), "moment": ("FL", force * length)}
    out = []
    for row in result.history:
        found = {"smallest J": row["smallest_J"]}
        for contact in (contact.name for contact in result.system.contact_terms):
            for what, (label, unit) in units.items():
                found[f"{contact} {what}"] = frame.Q.T @ [row[f"{contact}_{what}_{a}_{label}"] for a in "xyz"] / unit
            found[f"{contact} area"] = row[f"{contact}_area_L2"] / length**2
            found[f"{contact} penetration"] = row[f"{contact}_penetration_L"] / length
            found |= {f"{contact} points": row[f"{contact}_active_points"]}
            found |= {f"{contact} sticking": row[f"{contact}_sticking_points"]}
        out.append(found)
    return [*out, {"displacement": result.system.vector.norm() / length}]


_known = {}


@pytest.fixture(params=SCENES)
def scene(request):
    """Name of a scene, and what it gives as it is written first."""
    name = request.param
    if name not in _known:
        _known[name] = run(name)
        last = _known[name][-2]
        assert 0 < last["top sticking"] < last["top points"]  # friction in both its states
        assert min(count for kind, count in last.items() if kind.endswith(" points")) > 0  # every contact carries
    return name, _known[name]


def assert_same(found, others, same=SAME):
    size = {"force": 0.0, "moment": 0.0, "penetration": 1e-13 / same}  # coordinates of 4 have round-off 1e-15
    for row in others:
        for name in row:
            kind = name.rsplit(" ", 1)[-1]
            if kind in ("force", "moment"):
                size[kind] = max(size[kind], np.abs(row[name]).max())
    for row, other in zip(found, others, strict=True):
        for name in other:
            kind = name.rsplit(" ", 1)[-1]
            if kind in COUNTS:
                assert row[name] == other[name], name
            else:
                np.testing.assert_allclose(row[name], other[name], rtol=same, atol=same * size.get(kind, 0.0), err_msg=name)


def rotation():
    """By 1.1 radians about an axis along none of x, y, z."""
    a = np.array([0.3, -0.8, 0.5]) / np.linalg.norm([0.3, -0.8, 0.5])
    cross = np.cross(np.eye(3), a)
    return np.eye(3) + np.sin(1.1) * cross + (1 - np.cos(1.1)) * cross @ cross


@pytest.mark.serial
@pytest.mark.parametrize("units", UNITS.values(), ids=UNITS)
def test_units(scene, units):
    name, plain = scene
    assert_same(run(name, Frame(*units)), plain)


@pytest.mark.serial
def test_rotation_of_the_whole_scene(scene):
    name, plain = scene
    assert_same(run(name, Frame(Q=rotation())), plain)


@pytest.mark.serial
def test_numbering(scene):
    name, plain = scene
    assert_same(run(name, Frame(seed=1)), plain)


@pytest.mark.serial
def test_order_of_the_contacts(scene):
    name, plain = scene
    assert_same(run(name, Frame(turn_contacts=True)), plain)


@pytest.mark.parallel
def test_all_of_it_at_once(scene):
    name, plain = scene
    assert_same(run(name, Frame(*UNITS["odd"], rotation(), seed=2, turn_contacts=True)), plain)


@pytest.mark.parallel
def test_augmented_contact_in_other_units_and_turned():
    """Multipliers add lengths of their own to the history."""
    one = run("punch", penetration=1e-6)
    assert_same(run("punch", Frame(1e-3, 1e6, rotation()), penetration=1e-9), one)


# -- ways to the same end ---------------------------------------------------------------------------------------------
@pytest.mark.parallel
@pytest.mark.parametrize(("plane", "degree"), [(None, 1), ("strain", 1), ("strain", 2)])
def test_two_bodies_far_from_the_origin(plane, degree):
    """Their gap is a difference of coordinates, which are known to 1e-16 of themselves: forces that make no difference to
    these are no more out of balance."""

    def build(far):
        if plane:
            rectangles.build({"lower": ((0, 0), (4, 1), (8, 3)), "upper": ((1, 1.0), (1.5, 1), (4, 3))})
        else:
            two_blocks.build((4, 4, 1), (8, 8, 3), (0, 0, -1), (1.5, 1.5, 1), (4, 4, 2), (1, 1, 0))
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, place in zip(tags, places.reshape(-1, 3), strict=True):
            gmsh.model.mesh.setNode(tag, place + [far, far, 0.0 if plane else far], [])

    def forces(far):
        mesh = read_gmsh(build, far=far)
        rubber = neo_hooke(mu=1.0, K=5.0)
        scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber), plane=plane, degree=degree)
        names = (
            ("lower_ymin", "upper_ymax", "upper_ymin", "lower_ymax")
            if plane
            else ("lower_bottom", "upper_top", "upper_bottom", "lower_top")
        )
        scene.fix(names[0])
        scene.fix(names[1])
        scene.contact(names[2], names[3], friction=0.3, name="c")
        down = "y" if plane else "z"
        stages = [
            Stage("press", prescribe={(names[1], down): -0.1}),
            Stage("drag", prescribe={(names[1], "x"): 0.3}, steps=2),
        ]
        result = solve(scene, stages=stages).require()
        return np.array([result.history[-1][f"c_force_{axis}_N"] for axis in ("x", down)])

    near = forces(0.0)
    assert np.abs(forces(1e5) / near - 1.0).max() < 1e-5  # coordinates known to 1e-11, of gaps of 1e-4 and more


@pytest.mark.serial  # on 2 ranks: test_restart.py
def test_restart(scene, tmp_path):
    name, plain = scene
    kept, tight = Output(COMM.bcast(tmp_path), checkpoint=True), Method(tolerance=1e-11)
    for part in (2, None):
        statement, drive = SCENES[name](Frame())
        times = drive.pop("steps")
        times = np.arange(1, times + 1) / times if isinstance(times, int) else times
        out = replace(kept, resume=part is None)
        result = solve(statement, **drive, steps=times[:part], method=tight, out=out).require()
    assert_same(rows(result, Frame()), plain, EXACT)


def final(name, times, lost=None):
    """Displacement and the contacts' history at the end; lost: a longer step in place of the last two, tried and dropped."""
    statement, drive = SCENES[name](Frame())
    system = statement.system(drive.get("move"))
    stepper = Softened(Newton(LinearSolver(system), tolerance=1e-11))
    for i, t in enumerate(times):
        if lost and i == len(times) - 2:
            stepper.step(system, lost)
            system.trail.rollback()
        stepper.step(system, t)
        system.trail.commit()
    slid = [contact.accepted.history.slip_path for contact in system.contact_terms]
    return system.state.u.x.array.copy(), np.concatenate([path.ravel() for path in slid])


@pytest.mark.serial
def test_a_step_cut_back(scene):
    name, times = scene[0], [1 / 6, 1 / 3, 0.4, 0.45] if scene[0] != "ironing" else [1 / 6, 1 / 3, 1 / 2, 0.6, 0.7]
    direct, cut = final(name, times), final(name, times, lost=times[-1])
    for one, other in zip(cut, direct, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=EXACT)  # of lengths of about one


@pytest.mark.slow
@pytest.mark.serial
def test_one_two_and_three_ranks():
    one, two, three = np.array(numbers()), *(on_ranks(count, __file__) for count in (2, 3))
    size = np.abs(one).max(axis=1, keepdims=True)
    for other in (two, three):  # each kind against its own largest entry
        np.testing.assert_allclose(other / size, one / size, rtol=0, atol=SAME)


def numbers():
    """(kinds, values) of the scenes, padded with zeros."""
    kinds = {}
    for name in ("ball", "ironing"):  # the punch: test_steppers.py
        for row in run(name):
            for what, value in row.items():
                kinds.setdefault(f"{name} {what.rsplit(' ', 1)[-1]}", []).extend(np.atleast_1d(value).tolist())
    longest = max(len(values) for values in kinds.values())
    return [[float(x) for x in values] + [0.0] * (longest - len(values)) for values in kinds.values()]


# -- slave and master -------------------------------------------------------------------------------------------------
def pressed(kind, cells, swap):
    """Force on a pair, rough; cells: across the finer side's contact zone."""
    if kind == "blocks":
        mesh = read_gmsh(two_blocks.build, lower_cells=(2 * cells, 2 * cells, cells), upper_cells=(cells, cells, cells))
        law = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
        scene = Scene(Body(mesh, "lower", law), Body(mesh, "upper", law))
        scene.fix("lower_bottom")
        scene.prescribe("upper_top", "z", -1.0)
        scene.fix("upper_top", "xy")
        pair = ("upper_bottom", "lower_top")
    else:
        sizes = {"length": 4.0, "height": 2.0, "foundation": (8 * cells, 2 * cells), "indenter": (4 * cells, cells)}
        mesh = read_gmsh(ironing.build, **sizes, depth=0.5 / cells, left=1.4, growth=1.0)
        soft, stiff = (from_elastic(E, 0.32) for E in (689.6, 6896.0))
        scene = Scene(Body(mesh, "foundation", soft), Body(mesh, "indenter", stiff))
        scene.fix("foundation_bottom")
        scene.fix("ends", "y")
        scene.fix("indenter_top", "x")
        scene.prescribe("indenter_top", "z", -0.35)
        pair = ("foundation_top", "indenter_under")
    scene.contact(*(pair[::-1] if swap else pair), 0.3, name="c")
    force = abs(solve(scene, steps=3).require().history[-1]["c_force_z_N"])
    return force if kind == "blocks" else force * cells  # per depth


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize(("kind", "cells"), [("blocks", (2, 8)), ("ironing", (2, 8))])
def test_swap_of_slave_and_master(kind, cells):
    """One pass over one side's points: the sides differ by the discretisation, which goes with the mesh."""
    found = [[pressed(kind, count, swap) for swap in (False, True)] for count in cells]
    coarse, fine = (swapped / as_is - 1.0 for as_is, swapped in found)
    print(f"{kind}: force with slave and master swapped {coarse:+.2%} on the coarse, {fine:+.2%} on the fine mesh")
    # a quarter on cells a quarter as large, were it of first order; single figures scatter
    assert abs(fine) < 0.5 * abs(coarse) and abs(fine) < 0.01, (coarse, fine)


if __name__ == "__main__":
    values = numbers()
    if COMM.rank == 0:
        print(json.dumps(values))
