"""Bifurcations: passed ones are said, critical loads and branches from closed forms, without a bias."""

from functools import cache
from types import SimpleNamespace

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from refusals import refused
from scipy.optimize import brentq
from test_arc_length import STIFF
from test_stages import Killed, dying

from fenics_contact import (
    ArcSteps,
    Body,
    Branch,
    Displacement,
    Load,
    Method,
    Motion,
    Output,
    Scene,
    Travel,
    from_elastic,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.meshes import box, rectangles, ring_sector
from fenics_contact.solvers.pivots import PivotWatch
from fenics_contact.solvers.report import StepReport
from fenics_contact.solvers.softest import Softest
from fenics_contact.solvers.verdict import Verdict

COMM = MPI.COMM_WORLD


# -- Rivlin's cube ----------------------------------------------------------------------------------------------------
def cube():
    """A neo-Hookean cube of mu = 1 under equal dead tensions t on all faces: one element per process."""
    mesh = read_gmsh(box.build, cells=(MPI.COMM_WORLD.size, 1, 1))
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, STIFF)), element="mixed")
    for axis, letter in enumerate("xyz"):
        scene.fix(f"{letter}min", letter)
        scene.traction(f"{letter}max", np.eye(3)[axis])
    return scene


def nominal(x, y):
    """Nominal stresses along x, and along y and z, at stretches x, y, y: homogeneous, compressible, exact."""
    J, I1 = x * y**2, x**2 + 2 * y**2
    return np.array([J ** (-2 / 3) * (s - I1 / (3 * s)) + STIFF * (J - 1) * J / s for s in (x, y)])


def critical():
    """Dead tension at which a cube of equal stretches s resists 2, -1, -1 no more: K (s^3 - 1) s^3 = 2 mu."""
    s = brentq(lambda s: STIFF * (s**3 - 1) * s**3 - 2.0, 1.0, 1.01, xtol=1e-15)
    np.testing.assert_allclose(nominal(s, s), 2.0 / s, rtol=1e-9)
    return 2.0 / s


def on_branch(wide):
    """Dead tension at which stretches `wide` along y and z stand with another one along x."""
    x = brentq(lambda x: np.subtract(*nominal(x, wide)), 0.98 * wide**-2, 1.02 * wide**-2, xtol=1e-15)
    return nominal(x, wide)[1]


@pytest.mark.parallel
@pytest.mark.parametrize(("towards", "wide"), [(-1.0, 1.5), (1.0, 0.8)])
def test_rivlins_cube_leaves_the_symmetric_state_at_its_critical_load(towards, wide):
    """Flat cubes one way, rods the other; the branch crosses: one of its arms starts with a falling load."""
    assert abs(critical() - 2.0) < 1e-3  # 2 mu where it is incompressible
    branch = Branch("xmax", "x", towards)
    result = solve(
        cube(), steps=ArcSteps(until=Displacement("ymax", "y", wide - 1.0), first=0.3, largest=0.05, branch=branch)
    )
    assert result.converged, result.verdict.reason
    at = result.column("bifurcation") == 1
    np.testing.assert_allclose(result.column("t")[at][0], critical(), rtol=1e-5)
    np.testing.assert_allclose(result.column("t")[-1], on_branch(wide), rtol=1e-5)
    z = result.scene.space.tabulate_dof_coordinates()[:, 2] > 0.5
    np.testing.assert_allclose(result.u.x.array.reshape(-1, 3)[z, 2], wide - 1.0, atol=1e-5)
    assert any("is to go on along another branch" in note for note in result.verdict.notes)


@pytest.mark.parallel
def test_a_run_resumed_at_a_bifurcation_goes_on_along_its_branch(tmp_path):
    folder = MPI.COMM_WORLD.bcast(tmp_path)

    def go(out, last=100, resume=False):
        branch = Branch("xmax", "x", -1.0)
        steps = ArcSteps(until=Displacement("ymax", "y", 0.1), first=0.3, largest=0.05, branch=branch)
        kept = Output(folder / out, checkpoint=True, resume=resume)
        return solve(cube(), steps=steps, out=kept, record=dying(last))

    whole = go("whole").require()
    landed = int(np.argmax(whole.column("bifurcation"))) + 1
    with pytest.raises(Killed):
        go("parts", landed + 1)
    resumed = go("parts", resume=True).require()
    for name in ("t", "bifurcation", "limit_point", "energy_error_Nmm"):
        np.testing.assert_allclose(resumed.column(name), whole.column(name), atol=1e-7)


@pytest.mark.parallel
def test_a_branch_that_begins_beyond_the_end_of_the_path_is_said_not_to_be_taken():
    steps = ArcSteps(until=Load(0.5 * critical()), first=0.3, branch=Branch("xmax", "x", -1.0))
    result = solve(cube(), steps=steps).require()
    (note,) = (note for note in result.verdict.notes if "the branch has not been taken" in note)
    assert "bifurcation 1 has not been met, but 0" in note and not result.column("bifurcation").any()


@pytest.mark.parallel
def test_a_bifurcation_that_is_passed_is_said():
    result = solve(cube(), steps=ArcSteps(until=Load(2.1), first=0.1, largest=1e-5)).require()
    t, negative = result.column("t"), result.column("negative_pivots")
    assert np.all(negative[t < critical()] == 0) and np.all(negative[t > critical()] == 2)  # two motions, alike
    assert result.column("bifurcation").sum() == 1 and result.column("bifurcation")[np.argmax(t > critical())] == 1
    assert sum("the tangent has 2 negative pivots, none in the step before" in note for note in result.verdict.notes) == 1


@pytest.mark.parallel
def test_load_steps_that_pass_a_bifurcation_say_so_once():
    result = solve(cube(), steps=[1.0, 1.9, 2.05, 2.1]).require()
    (said,) = (note for note in result.verdict.notes if "pivots" in note)
    assert said.startswith("step 3 to t = 2.05: the tangent has 2 negative pivots, none in the step before: a bifurcation")
    assert "follow the path by steps=ArcSteps(" in said


def shortened(cells, degree, friction, travel, points=None):
    """A clamped column of 1 x 1 x 12, whose other end is clamped too or pressed by a rough plate; and the plate's way."""
    scene = Scene(
        Body(read_gmsh(box.build, size=(1.0, 1.0, 12.0), cells=cells), "box", from_elastic(1.0, 0.3)), degree=degree
    )
    scene.fix("zmin")
    if friction is None:
        scene.fix("zmax", "xy")
        scene.prescribe("zmax", "z", -travel)
        return scene, {}
    plate = rigid_plane((0, 0, 12), (0, 0, -1), name="plate")
    scene.contact("zmax", plate, friction, **({} if points is None else {"points": points}))
    return scene, {plate: (0, 0, -travel)}


@pytest.mark.parallel
@pytest.mark.parametrize(("friction", "linear"), [(None, "auto"), (0.5, "auto"), (0.5, "iterative")])
def test_what_is_not_factorised_anew_is_looked_at_too(friction, linear):
    """The column is shortened past Euler's 4 pi^2 / 12 / 12^2 of its length, 0.274, in steps of 0.1; its mesh is straight.
    An old factorisation serves all steps, or a hierarchy."""
    scene, move = shortened((6, 6, 48), 1, friction, 0.4)
    result = solve(scene, move=move, steps=4, method=Method(linear=linear)).require()
    (said,) = (note for note in result.verdict.notes if "bifurcation" in note)
    assert said.startswith("step 3 to t = 0.75: the ") and "tangent" in said
    assert result.summary["method"]["factorisations"] < result.summary["method"]["tangents"] / 2


@pytest.mark.parallel
def test_two_motions_that_a_determinant_hides_are_found():
    """The same column on a rough plate, which may bend along x or y; each tangent is factorised."""
    for travel, passed in (0.2, 0), (0.4, 1):
        scene, move = shortened((1, 1, 12), 2, 0.5, travel, points=3)
        result = solve(scene, move=move, steps=4).require()
        said = [note for note in result.verdict.notes if "bifurcation" in note]
        assert result.summary["method"]["factorisations"] >= result.verdict.iterations and len(said) == passed
    assert said[0].startswith("step 3 to t = 0.75: the tangent no longer resists every motion")


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("friction", "linear", "cells", "degree"),
    [
        (None, "direct", (6, 6, 48), 1),  # an older factorisation serves the second tangent
        (0.5, "direct", (1, 1, 12), 2),  # what is next to zero is stiff again
        (0.5, "iterative", (1, 1, 12), 2),  # a hierarchy of one level
    ],
)
def test_one_step_far_past_a_bifurcation_says_so(friction, linear, cells, degree):
    """Of the same column, to one and a half times Euler's shortening and more."""
    for travel in (0.2, 0.5, 0.7, 1.1):
        scene, move = shortened(cells, degree, friction, travel, points=3)
        notes = solve(scene, move=move, steps=1, method=Method(linear=linear)).require().verdict.notes
        assert sum("a bifurcation" in note for note in notes) == (travel > 0.3)


@pytest.mark.parallel
@pytest.mark.parametrize("skewed", [0.0, 0.3])
def test_the_softest_motion_is_found_and_followed(skewed):
    """Of a known matrix: the eigenvalue of one motion goes through zero, and then that of another one, in which the vector
    found before has no part."""
    n = 90
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(n, n)))[0]
    skew = skewed * np.triu(np.random.default_rng(2).normal(size=(n, n)), 1)
    values = 1.0 + np.arange(n) / n
    pc, loads = PETSc.PC().create(COMM), PETSc.Vec().createMPI(n, comm=COMM)
    first, end = loads.getOwnershipRange()
    loads.array_w[:] = np.cos(1.7 * np.arange(first, end) ** 1.5)
    pc.setType("none")
    softest, found = Softest(loads), []
    for changed in ({}, {0: 0.1}, {0: -0.1}, {1: 0.2}, {1: -0.2}, {0: -0.1, 1: -0.2}):
        now = values.copy()
        now[list(changed)] = list(changed.values())
        dense = turn @ (np.diag(now) + skew / n) @ turn.T
        A = PETSc.Mat().createDense((n, n), array=dense[first:end].copy(), comm=COMM)
        pc.setOperators(A)
        found.append(softest.resists(A, pc, not skewed))
        A.destroy()
    assert found == [True, True, False, True, False, False]
    pc.destroy()


@pytest.mark.parallel
def test_nothing_is_soft_over_a_tangents_own_factors():
    """Where all eigenvalues are 1 the first product leaves round-off alone, time and again."""
    n = 30
    skew = np.triu(np.random.default_rng(2).normal(size=(n, n)), 1)
    dense = np.diag(1.0 + np.arange(n)) + skew - skew.T
    ksp, loads = PETSc.KSP().create(COMM), PETSc.Vec().createMPI(n, comm=COMM)
    first, end = loads.getOwnershipRange()
    loads.array_w[:] = np.cos(1.7 * np.arange(first, end) ** 1.5)
    A = PETSc.Mat().createAIJ((n, n), comm=COMM)
    A.setUp()
    for row in range(first, end):
        A.setValues(row, range(n), dense[row])
    A.assemble()
    pc = ksp.getPC()
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    pc.setOperators(A)
    softest = Softest(loads)
    assert [softest.resists(A, pc, False) for _ in range(20)] == [True] * 20
    ksp.destroy()
    A.destroy()


@pytest.mark.parallel
def test_what_cannot_be_followed_is_not_told_to_be():
    """Springs do not go with arc length."""
    result = solve(cube(), steps=[1.0, 1.9, 2.05], method=Method(stabilise=True)).require()
    (said,) = (note for note in result.verdict.notes if "pivots" in note)
    assert "a bifurcation has been passed" in said and "ArcSteps" not in said and "shorter steps" in said


def ring(unit):
    """A whole ring of quadrilaterals, its outer radius 10 units; the inner point at its foot has a name."""
    geo, faces, rim = gmsh.model.geo, [], []
    foot = geo.addPoint(0, -8 * unit, 0)
    end = 1, geo.addLine(foot, geo.addPoint(0, -10 * unit, 0))
    for _ in range(4):
        end, (_, face), (_, outside), _ = geo.revolve([end], 0, 0, 0, 0, 0, 1, np.pi / 2, [8], recombine=True)
        faces, rim = [*faces, face], [*rim, outside]
    geo.removeAllDuplicates()
    geo.synchronize()
    for dim, tags, name in (2, faces, "ring"), (1, rim, "outside"), (0, [foot], "foot"):
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
    gmsh.model.mesh.generate(2)


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_a_ring_that_may_turn_between_smooth_walls_has_not_bifurcated(degree, unit):
    """It is round: as a body it rests at every turn, as a mesh at some."""
    rubber = neo_hooke(1.0 / unit, 10.0 / unit)
    scene = Scene(Body(read_gmsh(ring, unit=unit), "ring", rubber), degree=degree, plane="strain")
    scene.fix("foot", "x")
    lid = rigid_plane((0, 10.0 * unit, 0), (0, -1, 0), name="lid")
    scene.contact("outside", rigid_plane((0, -10.0 * unit, 0), (0, 1, 0), name="floor"), name="bottom")
    scene.contact("outside", lid, name="top")
    notes = solve(scene, move={lid: (0, -unit, 0)}, steps=2).require().verdict.notes
    said = [note for note in notes if "negative pivots" in note]
    # none where springs have held it on its way to balance
    assert all("body 'ring' moves along x, turns about z nearly as a rigid one" in note for note in said)
    assert not any("bifurcation" in note for note in notes)


def sector(radii, swell):
    """A quarter of a ring that goes on all round, free to turn between smooth round tools."""
    mesh = read_gmsh(ring_sector.build, radii=radii, cells=(4, 8), order=2)
    scene = Scene(Body(mesh, "ring", neo_hooke(1.0, 10.0)), plane="strain", degree=2)
    scene.cyclic("ymin", "xmin")
    scene.swell("ring", swell)
    for side, radius, hollow in ("inner", 0.99 * radii[0], False), ("outer", 1.01 * radii[1], True):
        tool = rigid_cylinder(radius, (0, 0, 0), (0, 0, 1), hollow=hollow, name=f"{side} tool")
        scene.contact(side, tool, points=3, name=side)
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize("swell", [1.1, 1.3])
def test_a_sector_that_nothing_keeps_from_turning_has_not_bifurcated(swell):
    """The pivot of its turn is zero, of either sign by round-off."""
    notes = solve(sector((1.0, 2.0), swell), steps=4).require().verdict.notes
    assert not any("pivots" in note or "resists" in note for note in notes)


@pytest.mark.parallel
def test_a_ring_that_may_turn_buckles_when_a_ring_does():
    """Under a pressure of (n^2 - 1) E I / R^3 along its normals, into n = 4 waves of which one is in a quarter (Timoshenko
    and Gere, Theory of Elastic Stability, 1961, section 7.2); its turn is a zero pivot, its buckling one below zero."""
    thin, scene = 0.05, sector((0.975, 1.025), 1.0)
    plane = 9 * 10.0 / 31 / (1 - (28 / 62) ** 2)  # E / (1 - nu^2) of mu = 1, K = 10
    critical = 15 * plane * thin**3 / 12
    scene.pressure("outer", lambda t: critical * t)
    result = solve(scene, steps=[0.5, 0.9, 1.1]).require()
    (said,) = (note for note in result.verdict.notes if "pivots" in note)
    assert said.startswith("step 3") and "a bifurcation has been passed" in said


class Watched:
    """A System and its LinearSolver with the pivots (at the last iterate of a step, in the state that is accepted) of steps,
    and what a PivotWatch says of them."""

    def __init__(self, symmetric, *steps, arcs=True):
        self.symmetric, self.scales, self.still = symmetric, SimpleNamespace(accepted=0.0), lambda: ()
        self.assemble_residual = self.assemble_tangent = self.forget = lambda: None
        self.fresh, self.negative, self.verdict = True, 0, Verdict()
        self.stalls = SimpleNamespace(resume=lambda verdict: None, accepted=lambda verdict: None)
        self.vector = SimpleNamespace(getSize=lambda: np.inf)  # too large to look for motions
        watch = PivotWatch(self, self, self.verdict, lambda *_: None, arcs)
        for self.negative, self.accepted in steps:
            self.verdict.residuals.append([1e-5, 1e-9])
            watch(StepReport(residuals=[1e-5, 1e-9]), 0.0, True)

    def count_negative(self, before):
        return self.negative

    def solve(self, *_):
        self.negative = self.accepted


@pytest.mark.serial
@pytest.mark.parametrize("arcs", [True, False])
def test_an_unsymmetric_tangent_is_weak_evidence(arcs):
    """With friction a determinant that changes its sign is no proof."""
    (said,) = Watched(False, (0, 0), (1, 1), arcs=arcs).verdict.notes
    assert "may have been passed" in said and "let go" in said and ("ArcSteps" in said) == arcs


@pytest.mark.serial
def test_the_pivots_of_an_iterate_say_nothing_of_the_state():
    """In balance to 1e-5 of the force, where cells are nearly incompressible the last iterate has pivots of its own."""
    assert not Watched(True, (0, 0), (16, 0), (0, 0)).verdict.notes
    (said,) = Watched(True, (0, 0), (16, 0), (16, 2)).verdict.notes
    assert said.startswith("step 3") and "2 negative pivots, none in the step before" in said


@pytest.mark.serial
def test_a_determinant_that_changes_its_sign_again_and_again_is_said_once():
    verdict = Watched(False, *[(0, 0), (1, 1)] * 5).verdict
    assert len(verdict.notes) == 1 and len(verdict.said) == 4
    (more,) = verdict.last_notes()
    assert more.startswith("4 more steps, the last one step 10 to t = 0: the determinant")


# -- a column ---------------------------------------------------------------------------------------------------------
LONG, E = 20.0, 1000.0
EULER = np.pi**2 * E / 12 / (4 * LONG**2)  # of a clamped column 1 mm thick, Poisson's ratio 0 [N]
# first orders of what Euler leaves out: shear, with the stiffness of a rectangle, and shortening
LEFT_OUT = EULER / (5 / 6 * E / 2) + EULER / E


@cache
def column_mesh():
    return read_gmsh(box.build, size=(1.0, 1.0, LONG), cells=(1, 1, 16))


def column(rough=False, free=False):
    """Clamped at its foot, pressed on its head by a dead load, 1 at Euler's; it bends along x alone, or free along y, too.
    rough: beside a wall far away that makes its tangent unsymmetric."""
    scene = Scene(Body(column_mesh(), "box", from_elastic(E, 0.0)), degree=2)
    scene.fix("zmin")
    if not free:
        scene.fix("ymin", "y")
    scene.traction("zmax", (0, 0, -EULER))
    if rough:
        scene.contact("xmin", rigid_plane((-9.0, 0, 0), (1, 0, 0)), 0.3, points=1)
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize(("rough", "axis"), [(False, "x"), (True, "x"), (True, "y")])
def test_a_column_buckles_at_eulers_load_and_follows_the_elastica(rough, axis):
    """Along y where it may bend either way: two motions lose their stiffness together, which a determinant hides."""
    sideways = 2.0
    until = Displacement("zmax", axis, sideways)
    steps = ArcSteps(until=until, first=0.3, largest=0.5, branch=Branch("zmax", axis))
    result = solve(column(rough, axis == "y"), steps=steps)
    assert result.converged and result.system.symmetric != rough, result.verdict.reason
    load = result.column("t")[result.column("bifurcation") == 1][0]
    np.testing.assert_allclose(load, 1.0, atol=LEFT_OUT)
    turned = np.pi * sideways / (2 * LONG)  # of the head; the elastica's load is 1 + turned^2 / 8 of the critical one
    np.testing.assert_allclose(result.column("t")[-1] / load - 1.0, turned**2 / 8, rtol=turned**2)


@pytest.mark.slow
@pytest.mark.parallel
def test_a_column_tied_to_a_hub_buckles_alike_however_it_is_pressed():
    """The hub takes part in what is softest; where the surface named is tied, so does its branch."""
    sideways, found = 2.0, {}
    presses = {"pushed": {"force": (0, 0, -EULER)}, "moved": {"z": -3 * LONG * EULER / E}}
    for how, press in presses.items():
        scene, hub = column(), rigid_hub("hub", (0.5, 0.5, LONG))
        scene.loads.clear()
        scene.tie("zmax", hub)
        free = Motion(**press, free="x ry")
        branch = Branch("zmax" if how == "pushed" else "xmin", "x", towards=-1)
        until = [Travel(hub, "x", way) for way in (-2.0, 2.0)]
        result = solve(scene, move={hub: free}, steps=ArcSteps(until=until, first=0.3, largest=0.5, branch=branch))
        assert result.verdict.reason == "reached travel of 'hub' along x = -2", result.verdict.reason
        (at,) = np.flatnonzero(result.column("bifurcation") == 1)
        found[how] = -result.column("hub_force_z_N")[[at, -1]] / EULER
    turned = np.pi * sideways / (2 * LONG)
    for critical_load, load in found.values():
        np.testing.assert_allclose(critical_load, 1.0, atol=LEFT_OUT)
        np.testing.assert_allclose(load / critical_load - 1.0, turned**2 / 8, rtol=turned**2)
    np.testing.assert_allclose(found["moved"], found["pushed"], rtol=1e-6)


@pytest.mark.parallel
def test_wrong_branches_are_refused():
    for branch, *words in (
        ("zmax", "branch = 'zmax'", "Branch"),
        (Branch("lid", "x"), "'lid'", "zmax"),
        (Branch("zmax", "r"), "'r'", "x, y, z"),
        (Branch("zmax", "x", 2.0), "towards = 2.0"),
        (Branch("zmax", "x", number=0), "number"),
    ):
        refused(lambda: solve(column(), steps=ArcSteps(until=Load(1.0), branch=branch)), *words)  # noqa: B023


# -- a column between walls -------------------------------------------------------------------------------------------
def leaning(gap, walls=2, **arcs):
    """A column of 1 x 20, clamped below and led above, that dead loads buckle until it leans on smooth walls beside it; its
    head's load is 1 by Euler. Until six times that."""
    mesh = read_gmsh(rectangles.build, rectangles={"column": ((0, 0), (1, 20), (1, 16))})
    scene = Scene(Body(mesh, "column", from_elastic(1000.0, 0.0)), degree=2, plane="strain")
    scene.fix("column_ymin")
    scene.fix("column_ymax", "x")
    scene.contact("column_xmax", rigid_plane((1 + gap, 0, 0), (-1, 0, 0), name="right"), name="r")
    if walls == 2:
        scene.contact("column_xmin", rigid_plane((-gap, 0, 0), (1, 0, 0), name="left"), name="l")
    scene.force("column_ymax", (0.0, -1000 / 12 * (np.pi / (0.69916 * 20)) ** 2, 0.0))
    return solve(scene, steps=ArcSteps(until=Load(6.0), first=0.3, branch=Branch("column_xmax", "x"), **arcs))


@pytest.mark.parametrize("gap", [0.15, 0.2])
def test_a_branch_is_left_along_its_null_vector_where_a_wall_is_as_near_as_the_first_arc(gap):
    """Of that arc the straight column, let go, is a balance, too."""
    result = leaning(gap, largest=0.6).require()
    after = 1 + int(result.column("bifurcation").argmax())
    assert result.column("t")[after] > 1.0 and result.column("r_load_N")[after + 1] > 0.0
    assert not any("a bifurcation within" in note for note in result.verdict.notes)


@pytest.mark.parametrize("walls", [1, 2])
def test_arcs_pass_kinks_where_the_load_turns_back(walls):
    """The node on which the column leans lets go as it tips over: the load turns back by more than a right angle at a kink,
    where no smaller angle leads on, and pivots alone tell the way. Short arcs meet the same limit loads."""
    long, short = (leaning(0.3, walls, largest=largest).require() for largest in (0.6, 0.1))
    first, last = ([point["t"] for point in result.summary["limit_points"]] for result in (long, short))
    np.testing.assert_allclose((first[0], first[-1]), (last[0], last[-1]), rtol=1e-4)
    assert first[-1] < 0.8 * first[0]
