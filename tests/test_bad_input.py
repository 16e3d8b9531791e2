"""A wrong statement is refused on all ranks before any solve, with the thing and the remedy named, and leaves no files."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from refusals import refused

import fenics_contact as fc
from fenics_contact import (
    ArcSteps,
    Body,
    Method,
    Output,
    Scene,
    read_gmsh,
    rigid_cone,
    rigid_cylinder,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    rigid_surface,
    solve,
)
from fenics_contact.meshes import box, two_blocks
from fenics_contact.scene.build import build

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
NAN = float("nan")


@pytest.fixture(scope="module")
def mesh():
    return read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(4, 4, 2))


@pytest.fixture
def out(tmp_path):
    """One folder name for all ranks; nothing may be left in it."""
    folder = COMM.bcast(tmp_path) / "results"
    yield folder
    COMM.Barrier()
    assert not folder.exists() or not list(folder.iterdir()), "a refused run left files behind"


def held(mesh, material=None):
    """A block held at its bottom, as a start for one mistake."""
    scene = Scene(Body(mesh, "box", material or fc.neo_hooke(1.0, 5.0)))
    scene.fix("zmin")
    return scene


def pressed(mesh, **contact):
    scene = held(mesh)
    tool = rigid_punch(half_width=1.0, height=2.0, face=(2.0, 2.0, 2.0))
    scene.contact("zmax", tool, **{"name": "top", **contact})
    return scene, tool


def solved(scene, **options):
    return solve(scene, **{"steps": 1, **options})


def driven(mesh, out, **options):
    """The pressed block solved with one option wrong."""
    scene, tool = pressed(mesh)
    return solved(scene, **{"move": {tool: (0, 0, -0.1)}, "out": out, **options})


def stacked(pair, **contact):
    """Two blocks, the upper one pressed on the lower."""
    law = fc.neo_hooke(1.0, 5.0)
    scene = Scene(Body(pair, "lower", law), Body(pair, "upper", law), degree=contact.pop("degree", 1))
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "z", -0.1)
    scene.fix("upper_top", "xy")
    scene.contact(**{"slave": "upper_bottom", "master": "lower_top", "name": "joint", **contact})
    return scene


# -- groups and meshes ------------------------------------------------------------------------------------------------
def test_unknown_surface_lists_the_known_ones(mesh):
    refused(lambda: held(mesh).fix("lid"), "'lid'", "xmin", "zmax")
    refused(lambda: held(mesh).contact("lid", rigid_plane()), "'lid'", "zmax")
    refused(lambda: held(mesh).traction("lid", (0, 0, 1)), "'lid'", "zmax")


def test_unknown_volume_lists_the_known_ones(mesh):
    refused(lambda: Scene(Body(mesh, "rubber", fc.neo_hooke(1.0, 5.0))), "'rubber'", "box")


def with_empty_surface():
    box.build(cells=(2, 2, 2))
    point = gmsh.model.addDiscreteEntity(2)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [point]), "ghost")


def test_empty_surface():
    refused(lambda: read_gmsh(with_empty_surface), "'ghost'", "no facets", "surfaces")


def prisms():
    base = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    out = gmsh.model.occ.extrude([(2, base)], 0, 0, 1, numElements=[2], recombine=True)  # triangles swept: prisms
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for dim, tag in out if dim == 3]), "box")


def test_unsupported_cell_type():
    refused(lambda: read_gmsh(prisms), "Prism", "hexahedra or tetrahedra")


def inside_out():
    """One hexahedron whose upper corner has been pulled through its bottom."""
    tag = gmsh.model.addDiscreteEntity(3)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, -2], [0, 1, 1]], float)
    gmsh.model.mesh.addNodes(3, tag, list(range(1, 9)), corners.ravel())
    gmsh.model.mesh.addElementsByType(tag, 5, [1], list(range(1, 9)))
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), "box")


def test_inverted_element():
    refused(lambda: read_gmsh(inside_out), "inverted", "element 1")


@pytest.fixture(scope="module")
def pair():
    lower = {"lower": (4.0, 4.0, 2.0), "lower_cells": (2, 2, 1), "lower_origin": (0.0, 0.0, -2.0)}
    return read_gmsh(two_blocks.build, **lower, upper=(2.0, 2.0, 2.0), upper_cells=(1, 1, 1), upper_origin=(1.0, 1.0, 0.0))


def test_failing_script_and_missing_file_and_unnamed_group():
    refused(lambda: read_gmsh("no_such_file.msh"), "no_such_file.msh")
    refused(lambda: read_gmsh(box.build, cells=(1, 1)), "index out of range")
    refused(lambda: read_gmsh(lambda: box.build(name="")), "no name", "setPhysicalName")


# -- numbers ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("bad", [0.0, -1.0, NAN, float("inf")])
def test_modulus_must_be_positive(bad):
    refused(lambda: fc.mooney_paper(0.1, 0.1, bad), "mooney_paper", "K", "positive")
    refused(lambda: fc.mooney_rivlin(bad, 0.1, 5.0), "mooney_rivlin", "a1", "positive")
    refused(lambda: fc.neo_hooke(bad, 5.0), "neo_hooke", "mu", "positive")
    refused(lambda: fc.yeoh(bad, 0.1, 0.1, 5.0), "yeoh", "c1", "positive")
    refused(lambda: fc.from_elastic(bad, 0.3), "from_elastic", "E", "positive")


def test_parameters_must_be_finite_and_stable():
    refused(lambda: fc.yeoh(0.1, NAN, 0.1, 5.0), "yeoh", "c2")
    refused(lambda: fc.yeoh(0.1, 0.1, NAN, 5.0), "yeoh", "c3")
    refused(lambda: fc.mooney_paper(0.1, NAN, 5.0), "mooney_paper", "nan")
    refused(lambda: fc.mooney_rivlin(0.1, -0.2, 5.0), "mooney_rivlin", "positive")
    refused(lambda: fc.from_elastic(1.0, 0.5), "nu", kind=fc.SceneError)
    refused(lambda: fc.ogden([1.0], [-2.0], 5.0), "ogden", "shear modulus", kind=fc.SceneError)
    refused(lambda: fc.ogden([1.0, 2.0], [2.0], 5.0), "ogden", "as many", kind=fc.SceneError)
    refused(lambda: fc.from_elastic(1.0, NAN), "nu")


@pytest.mark.parametrize("bad", [0.0, -1.0, NAN])
@pytest.mark.parametrize("which", ["normal", "tangential", "factor", "share"])
def test_penalty_must_be_positive(mesh, which, bad):
    refused(lambda: pressed(mesh, penalty=fc.Penalty(**{which: bad})), "top", which, "positive")


def test_a_penalty_is_stated_once(mesh):
    refused(lambda: pressed(mesh, penalty=fc.Penalty(normal=10.0, factor=100.0)), "top", "twice", "normal or factor")
    refused(lambda: pressed(mesh, penalty=fc.Penalty(tangential=1.0, share=0.1)), "top", "twice", "tangential or share")


@pytest.mark.parametrize("bad", [-0.1, NAN])
def test_friction_must_not_be_negative(mesh, bad):
    refused(lambda: pressed(mesh, friction=bad), "top", "friction", "positive")


@pytest.mark.parametrize(("name", "bad"), [("exponent", -1.0), ("reference", 0.0), ("shear_limit", -1.0), ("exponent", NAN)])
def test_a_friction_law_needs_numbers_that_make_one(name, bad):
    refused(lambda: fc.coulomb(0.3, **{name: bad}), "friction", f"{name} = {bad}", "must be")


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda: fc.coulomb(lambda p: 0.5 - 0.1 * p, up_to=50.0), ["mu(p) = -", "at p = ", "zero or a positive number"]),
        (lambda: fc.coulomb(lambda p: NAN, up_to=50.0), ["mu(p) = nan", "positive number"]),
        (lambda: fc.coulomb(lambda p: "much", up_to=50.0), ["mu(p) = 'much'", "positive number"]),
        (lambda: fc.coulomb(lambda p: 0.3 if p < 1.0 else 0.2, up_to=50.0), ["mu(p) jumps at p = 1", "continuous"]),
        (lambda: fc.coulomb(lambda p, t: 0.3, up_to=50.0), ["(p, t)", "mu(p)"]),
        (lambda: fc.coulomb(lambda p: 0.3), ["largest pressure", "up_to="]),
        (lambda: fc.coulomb(lambda p: 0.3, up_to=-1.0), ["up_to = -1.0", "pressure"]),
        (lambda: fc.coulomb(lambda p: 0.3, exponent=-0.5, up_to=50.0), ["mu(p) says all", "exponent="]),
        (lambda: fc.coulomb(0.3, up_to=50.0), ["up_to=", "a number mu has none"]),
        (lambda: fc.coulomb("rough"), ["friction = 'rough'", "positive"]),
        (lambda: fc.coulomb(0.3, across=0.5), ["across=", "along="]),
        (lambda: fc.coulomb(0.3, across=0.0, along=(1, 0, 0)), ["across = 0.0", "positive"]),
        (lambda: fc.coulomb(0.0, across=0.5, along=(1, 0, 0)), ["across=", "positive"]),
        (lambda: fc.coulomb(0.3, across=0.5, along=(0, 0, 0)), ["along", "length zero"]),
        (lambda: fc.coulomb(0.3, across=0.5, along=(1, 0)), ["along", "three finite numbers"]),
        (lambda: fc.coulomb(0.3, across=0.5, along=(1, 0, 0), shear_limit=1.0), ["shear_limit=", "all directions"]),
    ],
)
def test_what_is_no_law_of_friction(law, words):
    refused(law, "friction", *words)


def test_a_function_of_the_pressure_is_stated_with_its_range(mesh):
    refused(lambda: pressed(mesh, friction=lambda p: 0.3), "top", "friction", "coulomb(...) of this function", "up_to=")


def test_friction_is_a_number_or_a_law(mesh):
    refused(lambda: pressed(mesh, friction="rough"), "top", "friction = 'rough'", "coulomb(...)")


def test_tools_must_have_sane_lengths():
    refused(lambda: rigid_punch(half_width=-1.0, height=1.0), "half_width", "positive")
    refused(lambda: rigid_punch(half_width=1.0, height=NAN), "height", "positive")
    refused(lambda: rigid_punch(half_width=1.0, height=1.0, fillet=2.0), "fillet", "smaller")
    refused(lambda: rigid_sphere(0.0, (0, 0, 0)), "radius", "positive")
    refused(lambda: rigid_sphere(1.0, (0, NAN, 0)), "centre", "finite")
    refused(lambda: rigid_cone(70.0, (0, 0, 0)), "half_angle = 70", "up to 1.5708", "radians")
    refused(lambda: rigid_cone(1.2, (0, 0, 0), tip=-1.0), "tip", "length")
    refused(lambda: rigid_plane(normal=(0, 0, 0)), "normal", "zero")


@pytest.mark.parametrize("steps", [0, -3, 2.5, NAN, [], [0.5, 0.2], [0.5, NAN]])
def test_steps(mesh, out, steps):
    scene, tool = pressed(mesh)
    refused(lambda: solve(scene, move={tool: (0, 0, -0.1)}, steps=steps, out=out), "steps", "increasing")


@pytest.mark.parametrize("drive", ["move", "push"])
def test_nan_in_a_tools_drive(mesh, out, drive):
    scene, tool = pressed(mesh)
    refused(lambda: solve(scene, **{drive: {tool: (0, 0, NAN)}}, out=out), drive, "punch", "finite")

    def late(t):  # fine at first: a run that only looks at the present step would fail half-way
        return (0.0, 0.0, -0.1 * t if t < 0.8 else NAN)

    refused(lambda: solve(scene, **{drive: {tool: late}}, out=out), drive, "punch", "finite")


def test_nan_in_loads_and_supports(mesh, out):
    refused(lambda: held(mesh).traction("zmax", (0, NAN, 0)), "traction", "zmax", "finite")
    refused(lambda: held(mesh).body_force((0, 0, NAN)), "body force", "finite")
    refused(lambda: held(mesh).prescribe("zmax", "z", NAN), "zmax", "finite")
    scene = held(mesh)
    scene.prescribe("zmax", "z", lambda X, t: np.where((t > 0.8) & (X[:, 0] > 3.5), NAN, -0.1 * t))
    refused(lambda: solve(scene, steps=10, out=out), "zmax", "finite")


# -- values of the wrong kind: one clear error each, no raw one of Python's ---------------------------------------------
LAW = fc.neo_hooke(1.0, 5.0)
BALL = rigid_sphere(1.0, (2.0, 2.0, 3.0), name="ball")
AT_TOP = {"slave": "zmax", "master": BALL, "name": "top"}
WRONG_VALUES = {
    # material laws
    "modulus text": (lambda s: fc.neo_hooke("1", 5.0), "neo_hooke", "mu", "'1'", "positive"),
    "modulus none": (lambda s: fc.mooney_rivlin(0.1, 0.1, None), "mooney_rivlin", "K", "None", "positive"),
    "modulus truth": (lambda s: fc.yeoh(True, 0.1, 0.1, 5.0), "yeoh", "c1", "True", "positive"),
    "modulus array": (lambda s: fc.mooney_paper([0.1, 0.2], 0.1, 5.0), "mooney_paper", "a1", "positive"),
    "parameter text": (lambda s: fc.yeoh(0.1, "0", 0.1, 5.0), "yeoh", "c2", "finite number"),
    "elastic text": (lambda s: fc.from_elastic("1", 0.3), "from_elastic", "E", "positive"),
    "elastic nu": (lambda s: fc.from_elastic(1.0, "0.3"), "from_elastic", "nu", "finite"),
    "volumetric number": (lambda s: fc.neo_hooke(1.0, 5.0, volumetric=3.0), "neo-Hooke", "volumetric(J, K)", "3.0"),
    "volumetric of J": (lambda s: fc.neo_hooke(1.0, 5.0, volumetric=lambda J: J), "volumetric(J, K)", "(J)"),
    "energy number": (lambda s: fc.user_energy(3.0, 1.0, 5.0, "mine"), "mine", "psi(F)", "3.0"),
    "energy arguments": (lambda s: fc.user_energy(lambda F, J: J, 1.0, 5.0, "mine"), "mine", "psi(F)", "(F, J)"),
    "energy moduli": (lambda s: fc.user_energy(lambda F: F[0, 0], "1", 5.0, "mine"), "mine", "shear_modulus", "positive"),
    "energy name": (lambda s: fc.user_energy(lambda F: F[0, 0], 1.0, 5.0, name=5), "name", "5", "text"),
    # tools
    "radius text": (lambda s: rigid_sphere("1", (0, 0, 0)), "radius", "'1'", "positive"),
    "radius none": (lambda s: rigid_cylinder(None, (0, 0, 0)), "radius", "None", "positive"),
    "centre two": (lambda s: rigid_sphere(1.0, (0, 0)), "centre", "three finite numbers"),
    "centre text": (lambda s: rigid_sphere(1.0, "top"), "centre", "'top'", "three finite numbers"),
    "centre ragged": (lambda s: rigid_sphere(1.0, (0, (1, 2), 0)), "centre", "three finite numbers"),
    "normal letter": (lambda s: rigid_plane(normal="z"), "normal", "'z'", "three finite numbers"),
    "point of texts": (lambda s: rigid_plane(("0", "0", "0")), "point", "three finite numbers"),
    "half_width text": (lambda s: rigid_punch("1", 1.0), "half_width", "positive"),
    "fillet none": (lambda s: rigid_punch(1.0, 1.0, fillet=None), "fillet", "None", "zero or a positive"),
    "tool name": (lambda s: rigid_plane(name=5), "name of a rigid tool", "5"),
    "hollow text": (lambda s: rigid_sphere(1.0, (0, 0, 0), hollow="yes"), "sphere", "hollow = 'yes'", "within"),
    "tube number": (lambda s: fc.rigid_torus(2.0, 0.0, (0, 0, 0)), "torus", "tube", "positive"),
    "tube wide": (lambda s: fc.rigid_torus(2.0, 2.5, (0, 0, 0)), "torus", "2.5", "smaller"),
    "profile number": (lambda s: fc.rigid_extrusion(3.0), "profile", "profile = 3", "corners (p, z)"),
    "profile one": (lambda s: fc.rigid_extrusion([(0, 0)]), "profile", "at least 2"),
    "profile closed two": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0)], closed=True), "profile", "at least 3"),
    "profile in space": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0, 0, 0)]), "profile: point 2", "(p, z, fillet)"),
    "profile nan": (lambda s: fc.rigid_extrusion([(0, 0), (1, NAN)]), "profile: point 2", "finite"),
    "profile fillet": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0, -1), (1, -1)]), "point 2: fillet", "zero or a positive"),
    "profile same": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0), (1, 0), (1, -1)]), "the same", "leave one out"),
    "profile corner": (lambda s: fc.rigid_extrusion([(0, 1), (0, 0), (1, 0)]), "[0. 0.]", "into the tool", "fillet"),
    "profile back": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0), (0.5, 0)]), "turns back", "[1. 0.]"),
    "profile narrow": (lambda s: fc.rigid_extrusion([(-1, 0), (0, 0, 0.8), (0, -1, 0.8), (9, -1)]), "fillets", "smaller"),
    "profile end": (lambda s: fc.rigid_extrusion([(0, 0, 0.1), (1, 0)]), "ends", "no fillet"),
    "profile crosses": (lambda s: fc.rigid_extrusion([(0, 0), (2, 0), (2, -1), (1, -1), (1, 1)]), "cross", "move a point"),
    "profile axes": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0)], along=(0, 1, 1)), "along", "up", "perpendicular"),
    "profile along": (lambda s: fc.rigid_extrusion([(0, 0), (1, 0)], along=(0, 0, 0)), "along", "zero vector"),
    "turned beyond": (lambda s: fc.rigid_revolution([(-1, 0), (1, 0)]), "r = -1", "beyond the axis"),
    "turned to the axis": (lambda s: fc.rigid_revolution([(1, 0), (2, 0)]), "goes on to the axis", "end there"),
    "turned on the axis": (lambda s: fc.rigid_revolution([(1, 1), (0, 0), (1, -1)]), "only the ends", "axis"),
    "turned tip": (lambda s: fc.rigid_revolution([(0, 1), (1, 0)]), "tip", "fillet", "rigid_cone"),
    "union of one": (lambda s: fc.rigid_union(BALL), "union", "two or more"),
    "union of names": (lambda s: fc.rigid_union("ball", BALL), "union", "analytic tools"),
    "union of sharp": (lambda s: fc.rigid_union(BALL, rigid_punch(1.0, 1.0)), "'punch'", "sharp edges", "fillet"),
    "union of unions": (lambda s: fc.rigid_union(fc.rigid_union(BALL, rigid_plane()), BALL), "'union'", "its parts"),
    # bodies and scenes
    "material number": (lambda s: Body(s.mesh, "box", 5.0), "'box'", "material", "5.0", "neo_hooke"),
    "material not called": (lambda s: Body(s.mesh, "box", fc.neo_hooke), "'box'", "material", "neo_hooke(mu, K)"),
    "mesh path": (lambda s: Body("plate.msh", "box", LAW), "'box'", "mesh", "read_gmsh"),
    "volume number": (lambda s: Body(s.mesh, 1, LAW), "volume group", "1", "text"),
    "no body": (lambda s: Scene(), "at least one Body"),
    "list of bodies": (lambda s: Scene([Body(s.mesh, "box", LAW)]), "Scene(Body(...), Body(...))"),
    "body twice": (lambda s: Scene(Body(s.mesh, "box", LAW), Body(s.mesh, "box", LAW)), "'box'", "2 bodies"),
    "degree text": (lambda s: Scene(Body(s.mesh, "box", LAW), degree="1"), "degree", "'1'", "1 and 2"),
    "degree truth": (lambda s: Scene(Body(s.mesh, "box", LAW), degree=True), "degree", "True", "1 and 2"),
    "degree 3": (lambda s: Scene(Body(s.mesh, "box", LAW), degree=3), "degree", "3", "1 and 2"),
    "element number": (lambda s: Scene(Body(s.mesh, "box", LAW), element=2), "element", "2", "mixed"),
    "units text": (lambda s: Scene(Body(s.mesh, "box", LAW), units="mm"), "units", "'mm'", "Units("),
    "unit number": (lambda s: fc.Units("mm", "N", 1e6), "Units: pressure", "text"),
    "units that differ": (lambda s: fc.Units("mm", "N", "Pa"), "Units", "Pa is not N per mm squared"),
    "units in a wrong order": (lambda s: fc.Units("N", "mm", "MPa"), "Units: length = 'N' is a unit of force"),
    "unit empty": (lambda s: fc.Units(""), "Units: length", "text"),
    # supports
    "fix nothing": (lambda s: held(s.mesh).fix("zmax", ""), "fix 'zmax'", "axis ''"),
    "fix unknown": (lambda s: held(s.mesh).fix("zmax", "xw"), "fix 'zmax'", "axis 'xw'"),
    "fix number": (lambda s: held(s.mesh).fix("zmax", 2), "fix 'zmax'", "axis 2"),
    "fix none": (lambda s: held(s.mesh).fix(None), "None", "name of a surface group"),
    "fix facets": (lambda s: held(s.mesh).fix([1, 2]), "[1, 2]", "name of a surface group"),
    "fix no group": (lambda s: held(s.mesh).fix(()), "()", "name of a surface group"),
    "prescribe two": (lambda s: held(s.mesh).prescribe("zmax", "xy", 0.1), "prescribe 'zmax'", "'xy'", "one of x, y, z"),
    "prescribe vector": (lambda s: held(s.mesh).prescribe("zmax", "z", (0, 0, 1)), "'zmax'", "one finite number"),
    "prescribe text": (lambda s: held(s.mesh).prescribe("zmax", "z", "0.1"), "'zmax'", "along z", "one finite number"),
    "prescribe none": (lambda s: held(s.mesh).prescribe("zmax", "z", None), "'zmax'", "one finite number", "None"),
    "prescribe of t": (lambda s: held(s.mesh).prescribe("zmax", "z", lambda t: t), "'zmax'", "value(X, t)", "(t)"),
    "prescribe gives vectors": (lambda s: s.led(lambda X, t: t * X), "zmax along z", "shape", "number"),
    "prescribe gives three": (lambda s: s.led(lambda X, t: (0, 0, t)), "zmax along z", "shape", "number"),
    "prescribe gives text": (lambda s: s.led(lambda X, t: "0.1"), "zmax along z", "number"),
    "prescribe gives nothing": (lambda s: s.led(lambda X, t: None), "zmax along z", "number"),
    "prescribe gives nan": (lambda s: s.led(lambda X, t: NAN), "zmax along z", "finite", "mend"),
    # loads
    "traction number": (lambda s: held(s.mesh).traction("zmax", 0.1), "traction", "'zmax'", "three finite numbers"),
    "traction text": (lambda s: held(s.mesh).traction("zmax", "down"), "traction", "'zmax'", "'down'"),
    "traction of three": (lambda s: held(s.mesh).traction("zmax", lambda X, t, n: t), "'zmax'", "value(t)", "(X, t, n)"),
    "traction of X gives numbers": (lambda s: s.loaded("traction", lambda X, t: t * X[:, 0]), "'zmax'", "row of shape (3,)"),
    "traction group": (lambda s: held(s.mesh).traction(6, (0, 0, 1)), "6", "name of a surface group"),
    "traction gives number": (lambda s: s.loaded("traction", lambda t: t), "traction", "'zmax'", "three finite numbers"),
    "traction gives nothing": (lambda s: s.loaded("traction", lambda t: None), "'zmax'", "three finite numbers", "None"),
    "pressure vector": (lambda s: held(s.mesh).pressure("zmax", (0, 0, 1)), "pressure", "'zmax'", "one finite number"),
    "pressure text": (lambda s: held(s.mesh).pressure("zmax", "0.1"), "pressure", "'zmax'", "'0.1'"),
    "pressure gives text": (lambda s: s.loaded("pressure", lambda t: "0.1"), "pressure", "'zmax'", "one finite number"),
    "pressure of X gives rows": (lambda s: s.loaded("pressure", lambda X, t: t * X), "pressure", "'zmax'", "one number per"),
    "pressure of X gives nan": (lambda s: s.loaded("pressure", lambda X, t: NAN), "pressure", "'zmax'", "finite", "mend"),
    "fluid where": (lambda s: held(s.mesh).pressure("zmax", 1.0, where="shut"), "'zmax'", "where = 'shut'", '"open"'),
    "fluid from all": (lambda s: held(s.mesh).pressure("zmax", 1.0, from_="xmax"), "'zmax'", "from_=", 'where="open"'),
    "fluid unknown": (lambda s: s.wet("lid"), "'lid'", "zmax"),
    "fluid apart": (lambda s: s.wet("zmin"), "pressure on 'zmax'", "from_ = 'zmin'", "no node of that surface"),
    "fluid no contact": (lambda s: s.wet("xmax", met=False), "pressure on 'zmax'", "asks for contact", "leave where= out"),
    "fluid negative": (lambda s: s.wet("xmax", -1.0), "pressure on 'zmax'", "-0.5", "must not be negative"),
    "fluid incremental": (lambda s: s.wet("xmax", method="incremental"), 'where="open"', "'newton' or 'snes'", "'incremen"),
    "body force number": (lambda s: held(s.mesh).body_force(-9.81), "body force", "three finite numbers"),
    "body force complex": (lambda s: held(s.mesh).body_force((0, 0, 1j)), "body force", "three finite numbers"),
    # contacts
    "friction text": (lambda s: pressed(s.mesh, friction="0.3"), "top", "friction", "'0.3'", "positive"),
    "friction none": (lambda s: pressed(s.mesh, friction=None), "top", "friction", "None", "positive"),
    "friction truth": (lambda s: pressed(s.mesh, friction=True), "top", "friction", "True", "positive"),
    "friction infinite": (lambda s: pressed(s.mesh, friction=float("inf")), "top", "friction", "inf", "positive"),
    "penalty text": (lambda s: pressed(s.mesh, penalty="1"), "top", "penalty", "'1'", "positive"),
    "penalty truth": (lambda s: pressed(s.mesh, penalty=True), "top", "penalty", "True", "positive"),
    "penetration of rounding": (
        lambda s: solved(pressed(s.mesh, penetration=1e-16)[0]), "top", "penetration = 1e-16", "last places", "greater"
    ),
    "penetration list": (lambda s: pressed(s.mesh, penetration=[1e-5]), "top", "penetration", "positive"),
    "factor zero": (lambda s: pressed(s.mesh, penalty=fc.Penalty(factor=0)), "top", "factor", "positive"),
    "points truth": (lambda s: pressed(s.mesh, points=True), "top", "points", "True", "Gauss"),
    "points word": (lambda s: pressed(s.mesh, points="gauss"), "top", "points", "'gauss'", "corners"),
    "points part": (lambda s: pressed(s.mesh, points=1.5), "top", "points", "1.5", "Gauss"),
    "points list": (lambda s: pressed(s.mesh, points=[1]), "top", "points", "[1]", "Gauss"),
    "contact name": (lambda s: pressed(s.mesh, name=7), "contact: name", "7", "text"),
    "contact no name": (lambda s: pressed(s.mesh, name=""), "contact: name", "text"),
    "swapped": (lambda s: held(s.mesh).contact(slave=BALL, master="zmax"), "slave", "tool 'ball'", "master="),
    "slave number": (lambda s: held(s.mesh).contact(6, BALL), "slave", "6", "surface group"),
    "master number": (lambda s: held(s.mesh).contact("zmax", 6), "master", "6", "rigid_plane"),
    "master not called": (lambda s: held(s.mesh).contact("zmax", rigid_plane), "master", "rigid_plane(...)"),
    "master tools": (lambda s: held(s.mesh).contact("zmax", (BALL, BALL)), "master", "surface group"),
    "tools of one name": (lambda s: pressed(s.mesh)[0].contact("zmax", rigid_plane(name="punch")), "two tools", "'punch'"),
    "contacts of one name": (lambda s: pressed(s.mesh)[0].contact(**AT_TOP), "two contacts", "'top'", "name="),
    "itself": (lambda s: held(s.mesh).contact("zmax", ("zmin", "zmax")), "both 'zmax'", "two walls of one body"),
    "one body": (lambda s: s.met("xmin", "zmax", points=2).system(), "share nodes", "averages", "separate volumes"),
    "degree 2 nodes": (lambda s: stacked(s.pair, degree=2, points="nodes"), "joint", "nodes", "points=3"),
    "degree 2 corners": (lambda s: stacked(s.pair, degree=2, points="corners"), "joint", "corners", "points=3"),
    "multipliers at nodes": (lambda s: stacked(s.pair, points="corners", penetration=1e-5), "joint", "points=1"),
    # tools' drives
    "move two": (lambda s: s.drive(move=(0, 0)), "move", "punch", "three finite numbers"),
    "move number": (lambda s: s.drive(move=-1.0), "move", "punch", "three finite numbers"),
    "move text": (lambda s: s.drive(move="down"), "move", "punch", "'down'"),
    "move none": (lambda s: s.drive(move=None), "move", "punch", "three finite numbers"),
    "move of X": (lambda s: s.drive(move=lambda X, t: (0, 0, t)), "move", "punch", "value(t)", "(X, t)"),
    "move gives two": (lambda s: s.drive(move=lambda t: (0, t)), "move", "punch", "three finite numbers"),
    "move no tool": (lambda s: driven(s.mesh, s.out, move=(0, 0, -1)), "move", "(0, 0, -1)", "{tool: (x, y, z)}"),
    "move a name": (lambda s: driven(s.mesh, s.out, move={"punch": (0, 0, -1)}), "'punch'", "the tool itself"),
    "push text": (lambda s: s.drive(push="down"), "push", "punch", "'down'"),
    "push nothing": (lambda s: s.drive(push=(0, 0, 0)), "push", "punch", "no force"),
    "push a list": (lambda s: driven(s.mesh, s.out, move=None, push=[BALL]), "push", "{tool: (x, y, z)}"),
    "moved and pushed": (lambda s: s.drive(move=(0, 0, -1), push=(0, 0, -1)), "punch", "both moved and pushed"),
    # options of a run
    "steps text": (lambda s: driven(s.mesh, s.out, steps="10"), "steps", "'10'", "whole number"),
    "steps truth": (lambda s: driven(s.mesh, s.out, steps=True), "steps", "True", "whole number"),
    "steps none": (lambda s: driven(s.mesh, s.out, steps=None), "steps", "None", "whole number"),
    "steps texts": (lambda s: driven(s.mesh, s.out, steps=["0.5", "1"]), "steps", "increasing", "finite numbers"),
    "steps table": (lambda s: driven(s.mesh, s.out, steps=[[0.5, 1.0]]), "steps", "increasing", "finite numbers"),
    "method number": (lambda s: driven(s.mesh, s.out, method=1), "method", "1", "newton"),
    "method list": (lambda s: driven(s.mesh, s.out, method=["newton"]), "method", "newton", "snes"),
    "stabilise text": (lambda s: driven(s.mesh, s.out, method=Method(stabilise="no")), "stabilise", "'no'", "True or False"),
    "resume text": (lambda s: driven(s.mesh, Output(s.out, resume="yes")), "resume", "'yes'", "True or False"),
    "Method in a stage": (lambda s: s.stage(method=Method("snes")), "'in'", "is a name", "whole run"),
    "linear number": (lambda s: driven(s.mesh, s.out, method=Method(linear=1)), "1", "direct"),
    "tolerance zero": (lambda s: driven(s.mesh, s.out, method=Method(tolerance=0)), "tolerance", "0", "positive"),
    "tolerance negative": (lambda s: driven(s.mesh, s.out, method=Method(tolerance=-1e-8)), "tolerance", "positive"),
    "tolerance text": (lambda s: driven(s.mesh, s.out, method=Method(tolerance="1e-8")), "tolerance", "'1e-8'", "positive"),
    "tolerance large": (lambda s: driven(s.mesh, s.out, method=Method(tolerance=10)), "tolerance", "10", "up to 1"),
    "tolerance unused": (
        lambda s: driven(s.mesh, s.out, method=Method("incremental", tolerance=1e-8)), "tolerance", "incremental",
    ),
    "record list": (lambda s: driven(s.mesh, s.out, record=[lambda view: 1.0]), "record", "function of a View"),
    "record comma": (lambda s: driven(s.mesh, s.out, record={"a,b": float}), "record 'a,b'", "choose another name"),
    "record break": (lambda s: driven(s.mesh, s.out, record={"a\nb": float}), "record 'a\\nb'", "choose another name"),
    "record quote": (lambda s: driven(s.mesh, s.out, record={'a"b': float}), "record 'a\"b'", "choose another name"),
    "record number": (lambda s: driven(s.mesh, s.out, record={1: float}), "record: name = 1", "as text"),
    "smallest text": (lambda s: driven(s.mesh, s.out, method=Method(smallest_step="1e-4")), "smallest_step", "positive"),
    "ArcSteps with snes": (lambda s: s.followed(until=fc.Load(1.0), method="snes"), "go by arc length", "'snes'"),
    "ArcSteps with smallest_step": (
        lambda s: s.followed(until=fc.Load(1.0), method=Method(smallest_step=0.1)), "smallest_step", "ArcSteps(smallest=",
    ),
    "ArcSteps in a stage": (lambda s: s.stage(steps=ArcSteps(until=fc.Load(1.0)), method="newton"), "'in'", "by arc length"),
    "method arc length": (lambda s: driven(s.mesh, s.out, method="arc_length"), "give steps=ArcSteps(until=...)"),
    "arc length in a stage": (lambda s: s.stage(method="arc_length"), "'in'", "give steps=ArcSteps(until=...)"),
    "no until": (lambda s: s.followed(until=None), "until", "Load"),
    "until number": (lambda s: s.followed(until=1.0), "until = 1.0", "Load"),
    "until of two": (lambda s: s.followed(until=lambda u, t: t), "until(state)", "(u, t)"),
    "load text": (lambda s: s.followed(until=fc.Load("1")), "Load: value", "'1'"),
    "travel of a name": (lambda s: s.followed(until=fc.Travel("punch", "z", -1.0)), "Travel", "'punch'", "the tool itself"),
    "displacement axis": (lambda s: s.followed(until=fc.Displacement("zmax", "xy", 1.0)), "'zmax'", "'xy'", "one of x"),
    "displacement group": (lambda s: s.followed(until=fc.Displacement("lid", "z", 1.0)), "'lid'", "zmax"),
    "displacement groups": (lambda s: s.followed(until=fc.Displacement(6, "z", 1.0)), "6", "surface group"),
    "first text": (lambda s: s.followed(until=fc.Load(1.0), first="0.1"), "first", "positive"),
    "most part": (lambda s: s.followed(until=fc.Load(1.0), most=2.5), "most", "whole number"),
    "checkpoint text": (lambda s: driven(s.mesh, Output(s.out, checkpoint="yes")), "checkpoint", "'yes'", "whole number"),
    "checkpoint part": (lambda s: driven(s.mesh, Output(s.out, checkpoint=1.5)), "checkpoint", "1.5", "whole number"),
    "checkpoint nowhere": (lambda s: driven(s.mesh, Output(checkpoint=True)), "checkpoint", "out="),
    "out number": (lambda s: driven(s.mesh, 5), "out = 5", "folder"),
}  # fmt: skip


class Start:
    """Where the mistakes of the table begin."""

    def __init__(self, mesh, pair, out):
        self.mesh, self.pair, self.out = mesh, pair, out

    def led(self, value):
        scene = held(self.mesh)
        scene.prescribe("zmax", "z", value)
        return solved(scene, out=self.out)

    def wet(self, source, value=1.0, met=True, **options):
        scene = pressed(self.mesh)[0] if met else held(self.mesh)
        scene.pressure("zmax", value, where="open", from_=source)
        return solved(scene, out=self.out, steps=[0.5, 1.0], **options)

    def loaded(self, kind, value):
        scene = held(self.mesh)
        getattr(scene, kind)("zmax", value)
        return solved(scene, out=self.out)

    def met(self, slave, master, **how):
        scene = held(self.mesh)
        scene.contact(slave, master, **how)
        return scene

    def drive(self, **drives):
        scene, tool = pressed(self.mesh)
        return solved(scene, out=self.out, **{word: {tool: value} for word, value in drives.items()})

    def followed(self, method="newton", **arcs):
        return driven(self.mesh, self.out, steps=ArcSteps(**arcs), method=method)

    def stage(self, **options):
        scene, tool = pressed(self.mesh)
        return solved(scene, out=self.out, stages=[fc.Stage("in", move={tool: (0, 0, -0.1)}, **options)])


@pytest.mark.parametrize("name", WRONG_VALUES)
def test_a_wrong_value_is_named(mesh, pair, out, name):
    action, *words = WRONG_VALUES[name]
    refused(lambda: action(Start(mesh, pair, out)), *words)


def test_numbers_of_numpy_and_one_number_for_all_places_are_right(mesh):
    """Numbers that loops over arrays give, a function of t alone in effect, and a group named twice."""
    found = []
    for way, group, count in (
        (-0.1, "zmax", 2),
        (lambda X, t: -0.1 * t, ("zmax", "zmax"), np.int64(2)),
        (-0.1, "zmax", 2.0),
    ):
        scene, tool = pressed(mesh, points=count, friction=np.float32(0.25), penalty=np.array(10.0))
        scene.prescribe("zmax", "x", way)
        scene.traction(group, (0.0, 0.1, 0.0))
        method = Method(smallest_step=np.float64(0.1))
        result = solved(scene, move={tool: np.array([0, 0, -1]) / 10}, steps=count, method=method)
        assert result.converged
        found.append([result.history[-1][f"top_force_{axis}_N"] for axis in "xyz"])
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-10)


# -- statements that go together in words, but not in the scene -------------------------------------------------------
def glued():
    """Two bonded layers, the surface between them a group."""
    occ = gmsh.model.occ
    boxes = [occ.addBox(0, 0, z, 1, 1, 1) for z in (0, 1)]
    occ.fragment([(3, boxes[0])], [(3, boxes[1])])
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, boxes), "box")
    for place, name in enumerate(("zmin", "between", "zmax")):
        faces = [f for _, f in gmsh.model.getEntities(2) if abs(occ.getCenterOfMass(2, f)[2] - place) < 1e-9]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)


def test_contact_inside_the_material():
    mesh = read_gmsh(glued)
    refused(lambda: held(mesh).contact("between", rigid_plane(), name="c"), "'c'", "'between'", "inside the material")
    refused(lambda: held(mesh).contact(("zmax", "between"), rigid_plane()), "'zmax+between'", "inside the material")


def test_what_is_measured_over_a_surface_inside_the_material():
    """It has the cells of two bodies behind it, in which stresses differ."""
    scene = held(read_gmsh(glued))
    refused(lambda: scene.area("between"), "'between'", "inside the material")
    refused(lambda: scene.area(("zmax", "between")), "'between'", "inside the material")
    scene.prescribe("zmax", "z", -0.1)
    until = fc.Displacement("between", "z", -0.02)
    refused(lambda: solve(scene, steps=ArcSteps(until=until)), "'between'", "inside the material")
    refused(lambda: solve(scene, steps=1, record={"u": lambda view: view.at("between").J}),
            "'between'", "inside the material")  # fmt: skip


def test_the_same_contact_twice(mesh, pair):
    scene, tool = pressed(mesh)
    refused(lambda: scene.contact(("xmin", "zmax"), tool, name="again"), "'top'", "'again'", "the same", "leave one")
    scene.contact("xmin", tool, name="side")  # other facets of the body may meet the same tool
    scene = stacked(pair)
    refused(lambda: scene.contact("upper_bottom", "lower_top", name="again"), "'joint'", "'again'", "leave one")
    scene.contact("lower_top", "upper_bottom", name="back")  # two passes, each surface once the slave


def test_a_slave_that_cannot_give_way(mesh, pair, out):
    """A support along the contact's normal at every slave node; one that leaves the normal free is right."""
    scene, tool = pressed(mesh)
    scene.fix("zmax", "xy")
    assert scene.system({tool: (0, 0, -0.1)})
    scene.prescribe("zmax", "z", -0.1)
    refused(lambda: solved(scene, move={tool: (0, 0, -0.1)}, out=out), "'top'", "'zmax'", "normal", "leave out")
    scene = held(mesh)
    face = rigid_surface(flat, "face", height=2.0, flip=True)
    scene.contact("zmax", face, name="top")
    scene.fix("zmax", "z")
    refused(lambda: solved(scene, move={face: (0, 0, -0.1)}, out=out), "'top'", "'zmax'", "normal", "leave out")
    scene = stacked(pair)
    scene.fix("upper_bottom", "z")
    assert scene.system()  # the other body gives way
    scene.fix("lower_top")
    refused(lambda: solved(scene, out=out), "'joint'", "'upper_bottom'", "normal", "leave out")


def flat(height):
    """A square that looks up."""
    gmsh.model.occ.addRectangle(-1.0, -1.0, height, 6.0, 6.0)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(2)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [1]), "face")


@pytest.mark.parametrize("kind", ["ball", "face", "pair"])
def test_a_start_overlapped(mesh, out, kind):
    """0.04 of a cell goes unsaid, 0.4 of one is noted, 0.6 of one is refused."""

    def scene(depth):
        if kind == "pair":
            lower = {"lower": (4.0, 4.0, 2.0), "lower_cells": (2, 2, 2), "lower_origin": (0.0, 0.0, -2.0)}
            upper = {"upper": (2.0, 2.0, 2.0), "upper_cells": (1, 1, 2), "upper_origin": (1.0, 1.0, -depth)}
            return stacked(read_gmsh(two_blocks.build, **lower, **upper))
        scene = held(mesh)
        face = partial(rigid_surface, flat, "face", height=2.0 - depth, flip=True)
        scene.contact("zmax", rigid_sphere(3.0, (2.0, 2.0, 5.0 - depth)) if kind == "ball" else face(), name="top")
        return scene

    name = "joint" if kind == "pair" else "top"
    assert build(scene(0.04)).notes == []
    result = solved(scene(0.4), out=None)
    assert result.converged
    notes = [note for note in result.summary["verdict"]["notes"] if "starts" in note]
    assert len(notes) == 1 and f"'{name}'" in notes[0] and "0.4 inside" in notes[0] and "friction" not in notes[0]
    # two bodies may be meant to press each other
    assert ("start it outside" in notes[0]) is (kind != "pair") and ("swell()" in notes[0]) is (kind == "pair")
    refused(lambda: solved(scene(0.6), out=out), f"'{name}'", "0.6 inside", "outwards", *(["swell()"] * (kind == "pair")))


def test_a_bore_that_is_stated_as_a_shaft(mesh, out):
    scene = held(mesh)
    scene.contact("zmax", rigid_cylinder(30.0, (0, 0, 0)), name="top")
    refused(lambda: solved(scene, out=out), "'top'", "inside", "hollow=True")


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_a_plane_that_looks_away_from_the_body(mesh, out, gap):
    scene = held(mesh)
    scene.contact("zmax", rigid_plane((0, 0, 2.0 + gap), (0, 0, 1)), name="top")
    refused(lambda: solved(scene, out=out), "'top'", "inside", "turn its normal round")


def test_a_path_that_does_not_start_at_rest(mesh, out):
    scene, tool = pressed(mesh)
    way = {tool: lambda t: (0.0, 0.0, -0.1 - 0.1 * t)}
    refused(lambda: solved(scene, move=way, out=out), "'punch'", "-0.1", "t = 0", "start from 0")
    scene = held(mesh)
    scene.prescribe("zmax", "z", lambda X, t: np.where(X[:, 0] > 3.5, -0.1, -0.1 * t))
    refused(lambda: solved(scene, out=out), "zmax along z", "0.1 at t = 0", "multiply it by t")


def test_loads_that_jump_are_noted_and_round_off_is_not(mesh):
    def noted(scene, **options):
        result = solved(scene, **options)
        assert result.converged
        return [note for note in result.summary["verdict"]["notes"] if "at t = 0" in note and "steps=" not in note]

    scene, tool = pressed(mesh, friction=0.3)
    scene.prescribe("xmax", "y", lambda X, t: np.full(len(X), 0.1 * np.sin(2.0 * np.pi * (t - 1.0))))  # -2.4e-17 at 0
    scene.body_force(lambda t: (1e-5 * (t - 1.0) + 1e-5, 0.0, 0.0))
    assert noted(scene, push={tool: (0, 0, -0.1)}, steps=[0.5]) == []
    scene = held(mesh)
    scene.traction("zmax", lambda t: (0.0, 0.0, -0.01))
    scene.pressure("xmax", lambda t: 0.01 * (1.0 + t))
    assert ["traction on 'zmax' is 0.01 at t = 0" in noted(scene)[0], "pressure on 'xmax' is 0.01" in noted(scene)[1]]


def test_a_contact_that_never_closed_is_noted(mesh, pair, capsys):
    """A tool drawn in metres beside a body in millimetres, and a body out of reach."""
    scene = held(mesh)
    tool = rigid_sphere(0.01, (2.0, 2.0, 2.51))
    scene.contact("zmax", tool, name="top")
    result = solve(scene, move={tool: (0, 0, -1e-3)}, steps=1)
    notes = [note for note in result.summary["verdict"]["notes"] if "never" in note]
    assert result.converged and len(notes) == 1
    assert "'top' never closed: 'sphere' ends 0.499 away" in notes[0] and "units" in notes[0]
    assert (notes[0] in capsys.readouterr().err) == (COMM.rank == 0)
    scene = stacked(pair)
    scene.contact("upper_xmin", rigid_plane((-0.5, 0, 0), (1, 0, 0)), name="wall")
    notes = [note for note in solved(scene).summary["verdict"]["notes"] if "never" in note]
    assert len(notes) == 1 and "'wall' never closed" in notes[0]


# -- statements that cannot be computed -----------------------------------------------------------------------------
def test_tool_deep_inside_the_body(mesh, out):
    """1.5 mm inside a block 2 mm high with cells of 1 mm."""
    scene = held(mesh)
    tool = rigid_punch(half_width=5.0, height=10.0, face=(2.0, 2.0, 0.5))
    scene.contact("zmax", tool, name="top")
    refused(lambda: solve(scene, move={tool: (0, 0, -0.1)}, out=out), "top", "inside", "outwards")


def test_narrow_tool_deep_inside_the_body(mesh):
    """As deep, but the punch's back (0.5 mm above the surface) is nearer than its face."""
    scene = held(mesh)
    tool = rigid_punch(half_width=1.0, height=2.0, face=(2.0, 2.0, 0.5))
    scene.contact("zmax", tool, name="top")
    refused(lambda: scene.system({tool: (0, 0, -0.1)}), "top", "inside", "outwards")


def test_a_profile_whose_points_go_the_wrong_way(mesh):
    """From right to left a floor lies above its line, where the block is."""
    scene = held(mesh)
    lid = fc.rigid_extrusion([(9.0, 0.0), (-9.0, 0.0)], (2.0, 2.0, 2.5), up=(0, 0, -1.0))
    scene.contact("zmax", lid, name="top")
    refused(lambda: scene.system({lid: (0, 0, -0.1)}), "top", "inside", "the other way round", "on their right")


def test_contradictory_supports(mesh, out):
    scene = held(mesh)
    scene.prescribe("xmin", "z", 0.1)
    refused(lambda: solve(scene, out=out), "zmin", "xmin", "contradict")


@pytest.mark.skipif(COMM.size == 1, reason="one rank alone states one thing")
def test_stages_that_differ_from_rank_to_rank(mesh, out):
    """Their number above all, for what follows goes through them on all ranks together."""
    scene, tool = pressed(mesh)
    down = {"move": {tool: (0, 0, -0.1)}, "steps": 1}
    run = {"out": out}
    stages = [fc.Stage(f"down {i}", **down) for i in range(1 + COMM.rank)]
    refused(lambda: solve(scene, stages=stages, **run), "number of stages", "1 on rank 0", "2 on rank 1")
    refused(lambda: solve(scene, stages=[fc.Stage(f"down {COMM.rank}", **down)], **run), "stage 1", "down 0 on rank 0")
    apart = down | {"steps": [0.5, 1.0] if COMM.rank else 1}
    refused(lambda: solve(scene, stages=[fc.Stage("down", **apart)], **run), "steps of stage 1", "rank 1")


def test_supports_that_contradict_each_other_at_some_step_alone(mesh, out):
    """They agree at the start, half way and at the end."""
    scene = held(mesh)
    scene.prescribe("xmin", "z", lambda X, t: 0.1 * np.sin(8 * np.pi * t))
    run = {"out": out}
    refused(lambda: solve(scene, steps=[0.3, 1.0], **run), "t = 0.3", "zmin", "xmin", "contradict")
    stages = [fc.Stage("rest", prescribe={("xmin", "z"): 0.0}, steps=1)]
    stages += [fc.Stage("shake", prescribe={("xmin", "z"): lambda X, s: 0.1 * np.sin(4 * np.pi * s)}, steps=[0.3, 1.0])]
    refused(lambda: solve(scene, stages=stages, **run), "stage 'shake'", "t = 1.3", "zmin", "xmin", "contradict")


@pytest.mark.parametrize("held_axes", ["", "z", "xy"])
def test_nothing_against_rigid_motion(mesh, out, held_axes):
    scene = Scene(Body(mesh, "box", fc.neo_hooke(1.0, 5.0)))
    if held_axes:
        scene.fix("zmin", held_axes)
    scene.traction("zmax", (0, 0, -0.1))
    loose = ", ".join(a for a in "xyz" if a not in held_axes)
    refused(lambda: solve(scene, out=out), "box", f"along {loose}:", "fix")


def test_frictionless_floor_does_not_hold_sideways(mesh, out):
    scene = Scene(Body(mesh, "box", fc.neo_hooke(1.0, 5.0)))
    scene.contact("zmin", rigid_plane(), name="floor")
    refused(lambda: solve(scene, out=out), "box", "along x, y:")


def test_unknown_words(mesh, out):
    scene, tool = pressed(mesh)
    other = rigid_plane(name="other")
    refused(lambda: solve(scene, move={other: (0, 0, 1)}, out=out), "other", "in no contact")
    refused(lambda: solve(scene, move={tool: (0, 0, 0)}, method="magic", out=out), "magic", "newton")
    refused(lambda: solve(scene, move={tool: (0, 0, 0)}, method=Method(linear="magic"), out=out), "magic", "direct")
    refused(lambda: scene.fix("zmin", "w"), "'w'", "x, y, z")
    refused(lambda: pressed(mesh, points=0), "top", "points", "Gauss")


def test_unwritable_folder(mesh, tmp_path):
    blocker = COMM.bcast(tmp_path) / "a_file"
    if COMM.rank == 0:
        blocker.write_text("not a folder")
    COMM.Barrier()
    scene, tool = pressed(mesh)
    action = lambda: solve(scene, move={tool: (0, 0, -0.1)}, out=blocker / "results")  # noqa: E731
    refused(action, "a_file", "out=")
    COMM.Barrier()
    assert blocker.read_text() == "not a folder"


@pytest.mark.parametrize(
    ("missing", "package"),
    [
        *((name, f"python3-{name}") for name in "dolfinx gmsh numba petsc4py mpi4py tqdm matplotlib ufl".split()),
        ("dolfinx ufl basix ffcx petsc4py", "python3-dolfinx"),
    ],
)
def test_a_missing_module_is_named_with_its_debian_package(missing, package):
    if COMM.rank != 0:
        return
    block = f"import sys; sys.modules.update(dict.fromkeys({missing.split()!r})); import fenics_contact"
    said = last_line(block)
    assert said.startswith(f"ImportError: {missing.split()[0]} is missing") and f"package {package} " in said, said


def test_studies_name_scipy():
    if COMM.rank == 0:
        assert "package python3-scipy " in last_line(
            "import sys; sys.modules['scipy'] = None; import fenics_contact.studies.sphere"
        )


def last_line(code):
    """What a Python process that fails says last."""
    root = Path(__file__).resolve().parent.parent
    alone = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMIX_", "PRTE_", "PMI_"))}
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, timeout=60, env=alone)
    assert done.returncode != 0
    return done.stderr.strip().splitlines()[-1]


def test_frictionless_punch_does_not_hold_sideways(mesh, out):
    scene = Scene(Body(mesh, "box", fc.neo_hooke(1.0, 5.0)))
    scene.fix("zmin", "xz")
    tool = rigid_punch(half_width=5.0, height=2.0, face=(2.0, 2.0, 2.0))
    scene.contact("zmax", tool, name="top")
    refused(lambda: solve(scene, move={tool: (0, 0, -0.1)}, out=out), "box", "along y:")
