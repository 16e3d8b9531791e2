"""Default penalties are raised where points sink in too far; friction goes on as it was, and nothing else depends on it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from by_node import displacements, of_all
from mpi4py import MPI

from fenics_contact import (
    ArcSteps,
    Body,
    Load,
    Method,
    Motion,
    Output,
    Penalty,
    Scene,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    rigid_sphere,
    rigid_surface,
    solve,
)
from fenics_contact.contact import penalties
from fenics_contact.meshes import box, rectangles, ring, tool_surfaces, two_blocks
from fenics_contact.solvers.augmented import Adapted
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.verdict import StepFailed, Verdict

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
SHEAR, BULK = 0.4, 40.0  # squeezed in a box it resists with 33 times Young's modulus
SAME = 1e-10


def confined(**options):
    """A block of 2 x 2 x 2 in a smooth box, its top pressed by a plane."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", neo_hooke(SHEAR, BULK)))
    for side in ("xmin", "xmax", "ymin", "ymax", "zmin"):
        scene.fix(side, side[0])
    plate = rigid_plane((0, 0, 2.0), (0, 0, -1.0))
    scene.contact("zmax", plate, name="c", **options)
    return scene, {"move": {plate: (0, 0, -0.2)}}


def confined_force(squeeze):
    """Nominal force of neo-Hooke under F = diag(1, 1, J), from psi = mu/2 (J^-2/3 I1 - 3) + K/2 (J - 1)^2."""
    J = 1.0 - squeeze / 2.0
    I1 = 2.0 + J**2
    return -4.0 * (SHEAR / 2 * (2 * J ** (1 / 3) - 2 / 3 * I1 * J ** (-5 / 3)) + BULK * (J - 1.0))


def test_a_confined_block_is_held_where_it_should_be(tmp_path):
    folder = COMM.bcast(tmp_path)
    scene, drive = confined()
    result = solve(scene, **drive, steps=2, out=folder).require()
    depth = result.history[-1]["c_penetration_mm"]
    assert 0.0 < depth <= penalties.DEEPEST * 1.0  # cells of 1 mm
    notes = [note for note in result.verdict.notes if "penalties raised to" in note]
    assert notes and "contact 'c': its penalties hold 17% of the bodies' energy" in notes[0]
    COMM.Barrier()
    said = json.loads((folder / "summary.json").read_text())["scene"]["contacts"][0]
    raised, young = said["penalty_raised"], 9 * BULK * SHEAR / (3 * BULK + SHEAR)
    assert penalties.LARGEST < raised <= penalties.STIFFEST
    np.testing.assert_allclose(said["penalty_MPa_per_mm"], 100.0 * young * raised, rtol=1e-9)
    # the penalty is a spring in series: what it does not give way the block must, in closed form
    force = -result.history[-1]["c_force_z_N"]
    np.testing.assert_allclose(force, confined_force(0.2 - depth), rtol=1e-7)
    np.testing.assert_allclose(depth, force / 4.0 / (100.0 * young * raised), rtol=1e-7)
    np.testing.assert_allclose(force, confined_force(0.2), rtol=5e-3)  # it takes KEPT of the way
    assert not [note for note in result.verdict.notes if "change the force" in note]


@pytest.mark.parametrize("degree", [1, 2])
def test_walls_that_each_hold_little_and_all_hold_much(degree):
    """K/mu = 100 in a box of three smooth walls that are contacts, pushed: neo-Hooke's closed form in uniaxial strain."""
    mesh, mu, K, along = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (2.0, 2.0), (4, 4))}), 0.5, 50.0, 0.95
    scene = Scene(Body(mesh, "pad", neo_hooke(mu, K)), plane="strain", element="mixed", degree=degree)
    hub = rigid_hub("hub", (1.0, 2.0, 0.0))
    scene.tie("pad_ymax", hub)
    for side, point, normal in (
        ("xmin", (0, 0, 0), (1, 0, 0)),
        ("xmax", (2, 0, 0), (-1, 0, 0)),
        ("ymin", (0, 0, 0), (0, 1, 0)),
    ):
        scene.contact(f"pad_{side}", rigid_plane(point, normal, name=side), name=f"on_{side}")
    pressure = -(mu * along ** (-5 / 3) * 2 / 3 * (along**2 - 1.0) + K * (along - 1.0))
    result = solve(scene, move={hub: Motion(force=(0.0, -2.0 * pressure, 0.0))}, steps=3).require()
    # beneath it, and along both sides, penalties hold KEPT of the energy each: what is beneath takes as much of the way
    assert result.column("hub_travel_y_mm")[-1] == pytest.approx(2.0 * (along - 1.0), rel=4 * penalties.KEPT)
    row = result.history[-1]
    assert row["penalty_energy_Nmm"] < 4 * penalties.KEPT * row["strain_energy_Nmm"]


def test_walls_that_hold_little_of_what_shear_has():
    """A bonded bush swells on a rough shaft that turns there and back: shear has most of the energy, and hides that the
    shaft gives way to rubber that cannot escape. It takes the same moment both ways, and that of multipliers."""
    moments = []
    for kept in ({}, {"penetration": 1e-6}):
        mesh = read_gmsh(ring.build, inner=5.0, outer=8.0, width=1.0, cells=(24, 3, 1))
        scene = Scene(Body(mesh, "ring", neo_hooke(1.0, 100.0)), element="mixed")
        scene.fix("outside")
        scene.fix(("left", "right"), "y")
        shaft = rigid_cylinder(5.0, (0, 0, 0), axis=(0, 1, 0), name="shaft")
        scene.contact("inside", shaft, 0.3, name="c", **kept)
        scene.swell("ring", lambda t: 1.0 + 0.02 * min(1.0, 4.0 * t))
        turn = Motion(ry=lambda t: 0.5 * (min(1.0, 4.0 * t) - 2.0 * max(0.0, t - 0.5)))
        result = solve(scene, move={shaft: turn}, steps=8).require()
        moments.append(result.column("c_moment_y_Nmm")[[2, -1]])
    there, back = np.abs(moments[0])
    assert moments[0][0] * moments[0][1] < 0.0 and back == pytest.approx(there, rel=1e-3)
    np.testing.assert_allclose(moments[0], moments[1], rtol=0.01)


@pytest.mark.parametrize("free", [False, True])
def test_rubber_that_cannot_escape_raises_penalties_and_that_which_can_does_not(free):
    """K/mu = 1000 in a box, or on its floor alone."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (2.0, 2.0), (4, 4))})
    scene = Scene(Body(mesh, "pad", neo_hooke(1.0, 1e3)), plane="strain", element="mixed")
    for side in ("ymin", "xmin", *(() if free else ("xmax",))):
        scene.fix(f"pad_{side}", side[0])
    lid = rigid_plane((0, 2, 0), (0, -1, 0), name="lid")
    scene.contact("pad_ymax", lid, name="c")
    result = solve(scene, move={lid: (0, -0.02, 0)}, steps=2).require()
    assert any("penalties hold" in note for note in result.verdict.notes) != free
    if not free:
        assert result.column("c_force_y_N")[-1] == pytest.approx(-(1e3 + 4 / 3) * 0.02, rel=5e-3)


@pytest.mark.parametrize("typed", [{"penalty": 119.5}, {"penalty": Penalty(factor=100.0)}])
def test_a_number_typed_is_not_changed(typed):
    scene, drive = confined(**typed)
    result = solve(scene, **drive, steps=2).require()
    assert result.history[-1]["c_penetration_mm"] > penalties.DEEPEST
    assert result.summary["scene"]["contacts"][0]["penalty_raised"] == 1.0
    assert not [note for note in result.verdict.notes if "raised" in note]


def test_the_largest_factor_is_kept():
    scene, drive = confined()
    drive = {"move": {tool: (0, 0, -1.2) for tool in drive["move"]}}
    result = solve(scene, **drive, steps=3).require()
    assert result.summary["scene"]["contacts"][0]["penalty_raised"] == penalties.LARGEST
    assert result.history[-1]["c_penetration_mm"] > penalties.DEEPEST


# -- friction ---------------------------------------------------------------------------------------------------------
def dragged(kind):
    """A block pressed on something by 0.3 and dragged by 0.3 mm: points stick, and points slip."""
    if kind == "bodies":
        mesh = read_gmsh(two_blocks.build, lower_cells=(6, 6, 2), upper_cells=(4, 4, 2))
        scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
        scene.fix("lower_bottom")
        led, slave, master, way = "upper_top", "upper_bottom", "lower_top", -0.3
    else:
        scene = Scene(Body(read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(4, 4, 2), origin=(0, 0, -2)), "box", RUBBER))
        led, slave, way = "zmin", "zmax", 0.3
        ball = {"radius": 10.0, "centre": (2.0, 2.0, 10.0)}
        master = rigid_sphere(**ball, name="ball")
        if kind == "meshed":
            master = rigid_surface(tool_surfaces.ball, "ball", mesh_size=1.5, **ball)
    scene.prescribe(led, "z", lambda X, t: np.full(len(X), way * min(2.0 * t, 1.0)))
    scene.prescribe(led, "x", lambda X, t: np.full(len(X), 0.3 * max(2.0 * t - 1.0, 0.0)))
    scene.fix(led, "y")
    scene.contact(slave, master, 0.4, name="c")
    return scene


KINDS = ["analytic", "meshed", "bodies"]


@pytest.mark.parametrize("kind", KINDS)
def test_friction_is_felt_unchanged(kind):
    """At the accepted state greater penalties give the same friction traction, in stick as in slip."""
    scene = dragged(kind)
    system = solve(scene, steps=4).require().system
    contact = system.contact_terms[0]
    before, trial = contact.response(system.state), contact.trial
    counts = COMM.allreduce(np.bincount(before.status.ravel(), minlength=4))
    assert counts[2] > 0 and counts[3] > 0  # some stick, some slip
    held = contact.forces.split_traction(system.state)[1]
    stiffer = replace(trial.law, eps_t=4.0 * trial.law.eps_t)
    friction = contact.forces.split_traction(system.state, contact.penalties.friction_kept(trial, 4.0).under(stiffer))[1]
    size = max(COMM.allgather(np.abs(before.traction).max(initial=0.0)))
    np.testing.assert_allclose(friction, held, rtol=0, atol=1e-9 * size)  # round-off of anchors over an elastic slip


def carried(kind, times, folder=None, resume=False):
    kept = folder and Output(folder, checkpoint=True, resume=resume)
    return solve(dragged(kind), steps=times, method=Method(tolerance=1e-11), out=kept).require()


def numbers(result):
    forces = np.array([result.column(f"c_force_{axis}_N") for axis in "xyz"])
    return np.append(forces.ravel(), result.system.vector.norm())


def raises(result):
    """The notes on raised penalties."""
    return [note for note in result.verdict.notes if "penalties raised" in note]


@pytest.mark.parametrize("kind", ["analytic", "bodies"])  # a meshed tool is a pair of bodies, too
def test_resumed_is_continuous(kind, monkeypatch, tmp_path):
    monkeypatch.setattr(penalties, "DEEPEST", {"analytic": 1e-3, "bodies": 2e-4}[kind])  # raised twice
    folder, times = COMM.bcast(tmp_path), [0.25, 0.5, 0.75, 1.0]
    whole = carried(kind, times)
    raised = [note.split()[1] for note in raises(whole)]
    assert len(set(raised)) >= 2 and whole.history[-1]["c_sticking_points"] < whole.history[-1]["c_active_points"]
    carried(kind, times[:2], folder)
    resumed = carried(kind, times, folder, resume=True)
    np.testing.assert_allclose(numbers(resumed), numbers(whole), rtol=0, atol=SAME * np.abs(numbers(whole)).max())
    said = [[(note.split()[1], note.split(" lies ")[1]) for note in raises(r)] for r in (resumed, whole)]
    assert said[0] == said[1]  # steps and factors; of several points equally deep round-off chooses one


class Stumbling(Newton):
    """Newton that fails in every other solve of a kind: the `name`d method."""

    def __init__(self, linear, name, tolerance=1e-11):
        super().__init__(linear, tolerance)
        self.name = name

    def step(self, system, t):
        return self._fail_after(super().step, system, t, "step")

    def settle(self, system, t):
        return self._fail_after(super().settle, system, t, "settle")

    def _fail_after(self, solve_it, system, t, name):
        report = solve_it(system, t)
        if name == self.name:
            self.name = None
            raise StepFailed("stumbled")
        return report


def final(times, fails=None, lost=None):
    """(displacement, penalties) at the end; fails: what stumbles once in the second step; lost: a step tried and dropped."""
    system = dragged("bodies").system()
    linear = LinearSolver(system)
    for i, t in enumerate(times):
        stepper = Adapted(Stumbling(linear, fails if i == 1 else None), linear)
        if lost and i == 1:
            stepper.step(system, lost)
            system.trail.rollback()
        report = stepper.step(system, t)
        Verdict().accept(report, system)
        system.trail.commit()
    contact = system.contact_terms[0]
    return displacements(system.state.u), of_all(contact.key, contact.trial.law.eps_n), report, system


def raise_factor(system):
    return system.contact_terms[0].penalties.raise_factor(system.state)


def test_a_dropped_step_leaves_no_trace(monkeypatch):
    monkeypatch.setattr(penalties, "DEEPEST", 1e-4)
    direct, cut = final([0.4, 0.7, 1.0]), final([0.4, 0.7, 1.0], lost=1.0)
    np.testing.assert_allclose(cut[0], direct[0], rtol=0, atol=SAME)
    np.testing.assert_allclose(cut[1], direct[1], rtol=SAME)
    assert raise_factor(direct[3]) > 1.0


def test_a_step_that_greater_penalties_spoil_is_taken_without(monkeypatch):
    monkeypatch.setattr(penalties, "DEEPEST", 1e-4)
    system = final([0.4, 0.7], fails="settle")[3]
    contact = system.contact_terms[0]
    first = raise_factor(final([0.4])[3])
    # those of the step before; on several ranks MUMPS adds in the order of arrival, so two runs differ in their last bits
    np.testing.assert_allclose(raise_factor(system), first, rtol=SAME)
    held = 2 * (contact.penalties.stored(system.state),)
    assert (
        contact.penalties.raised(system.state, system.strain_energy, lambda: 0.0, held, 0.0) is None
    )  # and nothing tries again
    monkeypatch.setattr(penalties, "DEEPEST", 1.0)
    spared = final([0.4, 0.7])  # never raised: same law but for the first step
    assert raise_factor(spared[3]) == 1.0


def test_on_an_arc():
    scene, drive = confined()
    arc = solve(scene, **drive, steps=ArcSteps(until=Load(1.0), first=0.5)).require()
    assert [note for note in arc.verdict.notes if "penalties raised" in note]
    squeeze, depth = 0.2 * arc.column("t"), arc.column("c_penetration_mm")
    assert depth.max() < penalties.DEEPEST
    np.testing.assert_allclose(-arc.column("c_force_z_N"), confined_force(squeeze - depth), rtol=1e-7)


def test_in_the_incremental_scheme():
    """Raised between two steps by one more solve; what is left out of balance falls with the square of the step."""
    errors = []
    for steps in (5, 10, 20):
        scene, drive = confined()
        result = solve(scene, **drive, steps=steps, method="incremental").require()
        depth, force = result.history[-1]["c_penetration_mm"], -result.history[-1]["c_force_z_N"]
        assert 0.0 < depth <= penalties.DEEPEST and result.verdict.cuts == 0
        notes = [note for note in result.verdict.notes if "penalties raised to" in note]
        assert len(notes) == 1 and result.verdict.iterations == steps + 1
        errors.append(force / confined_force(0.2 - depth) - 1.0)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.2)  # as of the scheme itself on smooth paths (test_steppers.py)


def test_a_point_that_has_just_closed_raises_nothing():
    """It lies as deep as the step is long before the next solve has seen it: no measure of its pressure."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", neo_hooke(1.0, 1.0)))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 2.01), (0, 0, -1.0))
    scene.contact("zmax", plate, name="c")
    result = solve(scene, move={plate: (0, 0, -0.2)}, steps=4, method="incremental").require()
    assert result.history[0]["c_penetration_mm"] > penalties.DEEPEST >= result.history[-1]["c_penetration_mm"]
    assert result.summary["scene"]["contacts"][0]["penalty_raised"] == 1.0
