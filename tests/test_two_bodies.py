"""Contact of two deformable bodies: patch test, exact tangent in a System, objectivity, ranks, bad input."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from petsc4py import PETSc
from taylor import forces, foreseen_left, orders, remainders

from fenics_contact import Body, Method, Scene, SceneError, Stage, compat, mooney_rivlin, read_gmsh, solve
from fenics_contact.assembly.pose import rotation
from fenics_contact.contact.master import MasterSurface
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK
from fenics_contact.meshes import two_blocks
from fenics_contact.studies.tubes import BASE as TUBES
from fenics_contact.studies.tubes import tubes

RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
STACK = {"lower": (20, 20, 10), "lower_origin": (0, 0, -10), "upper": (20, 20, 10), "upper_origin": (0, 0, 0)}
COARSE = {"lower_cells": (8, 8, 2), "upper_cells": (5, 5, 2)}
ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def blocks(**parameters):
    mesh = read_gmsh(two_blocks.build, **parameters)
    return mesh, Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))


def sliding(drag=4.0, steps=12, tolerance=None, ranks=None, **contact):
    """The sliding blocks of demos/block_on_block.py, coarse: pressed until t = 0.25, then dragged by `drag` mm."""
    mesh, scene = blocks(**COARSE, ranks=ranks)
    for name, rank in (ranks or {}).items():
        cells = mesh.cell_tags.values == mesh.volume_tag(name)
        assert cells.any() == (mesh.comm.rank == rank)
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), drag * max(t - 0.25, 0.0) / 0.75))
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -2.0 * min(t / 0.25, 1.0)))
    scene.contact("upper_bottom", "lower_top", 0.3, name="c", **contact)
    return solve(scene, steps=steps, method=Method(tolerance=tolerance))


# ---- patch test

# classical Mooney-Rivlin, uniaxial stretch 0.9: nominal stress [MPa] times area [mm^2]; ODE-free closed form
EXACT = 0.1288051 * 400


def stacked(points, penalty, lower, upper):
    """Two frictionless blocks squeezed by 10 %: vertical force [N], spread of the interface pressure over its mean."""
    _, scene = blocks(**STACK, lower_cells=lower, upper_cells=upper)
    for body in ("lower", "upper"):
        scene.fix(f"{body}_xmin", "x")
        scene.fix(f"{body}_ymin", "y")
    scene.fix("lower_bottom", "z")
    scene.prescribe("upper_top", "z", -2.0)
    scene.contact("upper_bottom", "lower_top", penalty=penalty, points=points, name="c")
    result = solve(scene, steps=2)
    assert result.converged
    pressure = result.system.contact_terms[0].forces.split_traction(result.system.state)[0]
    return result.history[-1]["c_force_z_N"], np.ptp(pressure) / pressure.mean()


@pytest.mark.parametrize("points", ["nodes", "corners", "averages", 2])
def test_matching_blocks_are_exact_up_to_the_penalty(points):
    errors = []
    for penalty in (50.0, 500.0):
        force, spread = stacked(points, penalty, (3, 3, 2), (3, 3, 2))
        errors.append(EXACT - force)
        assert spread < 1e-9  # homogeneous: round-off and the solver's tolerance
    assert abs(errors[0] / errors[1] - 10.0) < 0.2  # the compliance is 1/eps; EXACT has seven digits
    assert errors[1] < 2e-4 * EXACT


@pytest.mark.parametrize("lower, upper", [((5, 5, 2), (3, 3, 2)), ((3, 3, 2), (5, 5, 2))])
def test_gauss_points_pass_the_patch_test_in_the_force(lower, upper):
    force, _ = stacked(2, 500.0, lower, upper)
    # the compliance costs 1.4e-4; the scatter of the pressure (one-sided integration) 2e-5 more
    assert abs(force / EXACT - 1.0) < 2e-4


# ---- sliding


def test_sliding_block_obeys_coulomb():
    result = sliding()
    assert result.converged and result.verdict.cuts == 0
    ratio = -result.column("c_force_x_N") / result.column("c_force_z_N")
    assert np.all(np.diff(result.column("c_force_x_N")) < 1e-9)
    # normals are those of the deformed faces, so the ratio of the forces is not mu itself
    assert 0.2 < ratio[-1] < 0.31
    assert np.all(np.abs(result.column("c_force_y_N")) < 1e-6 * 100)  # symmetry, to the solver's tolerance
    assert result.system.matrix.getInfo()["mallocs"] == 0


# ---- tangent of a System


def deformed(points, friction, shift):
    """A System of two coarse blocks, pressed 0.3 mm into each other and roughened, committed, then shifted on."""
    mesh, scene = blocks(lower_cells=(6, 6, 2), upper_cells=(4, 4, 1))
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact("upper_bottom", "lower_top", friction, points=points, name="c")
    return roughened(mesh, scene, 0.05, shift)


def roughened(mesh, scene, size, shift):
    """The System and contact of a scene of a lower and an upper body; size: of the roughness [mm]."""
    system = scene.system()
    state, contact = system.state, system.contact_terms[0]
    cells = mesh.cell_tags.indices[mesh.cell_tags.values == mesh.volume_tag("upper")]
    upper = np.unique(compat.cell_dofs(scene.space)[cells])
    u = size * np.random.default_rng(1).uniform(-1, 1, (len(state.u.x.array) // 3, 3))
    u[upper, 2] -= 0.3
    state.u.x.array[:] = u.ravel()
    contact.commit(state)
    u[upper] += shift
    state.u.x.array[:] = u.ravel()
    return system, contact


@pytest.mark.serial
@pytest.mark.parametrize("points", ["nodes", "corners", "averages", 2])
@pytest.mark.parametrize(
    "friction, shift, status",
    [(0.0, (0.4, 0.1, -0.02), CLOSED), (0.1, (1.5, 0.3, -0.02), SLIP), (5.0, (0.03, 0.01, -0.02), STICK)],
)
def test_tangent_is_the_derivative_of_the_residual(points, friction, shift, status):
    system, contact = deformed(points, friction, shift)
    contact.response(system.state)
    assert (contact.statuses() == status).all()
    assert orders(remainders(system, contact, 1e-3)).min() > 1.99
    if contact.symmetric:
        assert system.matrix.convert("aij", out=PETSc.Mat()).isSymmetric(1e-9)  # entries of size eps times area: 1e2


@pytest.mark.serial
@pytest.mark.parametrize("points", ["nodes", "corners", "averages", 2])
def test_a_trial_is_tried_without_the_contact_s_own(points, monkeypatch):
    """Residual and tangent of points that the trial alone has pressing, on facets that they did not meet before."""
    system, contact = deformed(points, 0.1, (1.5, 0.3, -0.02))
    system.assemble_tangent()
    system.state.u.x.array.reshape(-1, 3)[np.unique(contact.surface.nodes)] += (6.0, 0.0, 5.0)
    trial = contact.trial.nearer(contact.response(system.state).gap + 0.02)
    assert (contact.response(system.state).status == OPEN).all()
    with monkeypatch.context() as patch:
        patch.setattr(contact, "take", None)
        size = system.assemble_residual(trials={contact: trial})
        system.assemble_tangent(trials={contact: trial})
    tried = system.matrix.getValuesCSR()[2].copy()
    contact.take(trial)
    assert size == system.assemble_residual()
    system.assemble_tangent()
    assert np.array_equal(tried, system.matrix.getValuesCSR()[2]) and (contact.statuses() != OPEN).any()


def turned_about(system, contact, turns):
    """Forces are in balance, and turning everything by turns (3, 3), accepted one after the other, changes no traction and
    no status; returns the statuses."""
    state = system.state
    on_nodes = forces(contact, state).reshape(-1, 3)
    assert np.abs(on_nodes.sum(axis=0)).max() < 1e-11 * np.abs(on_nodes).max()
    response = contact.response(state)
    contact.commit(state)
    size, status = np.linalg.norm(response.traction, axis=2), response.status.ravel()
    X = system.space.tabulate_dof_coordinates()
    x = X + state.u.x.array.reshape(-1, 3)
    for turn in turns:
        state.u.x.array[:] = (x @ turn.T - X).ravel()
        contact.commit(state)
        assert (contact.statuses() == status).all()
        # coordinates of size 40 round at 1e-14; times a penalty of 50
        assert np.abs(np.linalg.norm(contact.response(state).traction, axis=2) - size).max() < 1e-10 * size.max()
    return status


@pytest.mark.serial
@pytest.mark.parametrize("points", ["nodes", "corners", "averages", 2])
def test_forces_balance_and_a_turn_of_everything_changes_no_traction(points):
    turns = [rotation(np.array([0.0, 2 * np.pi * step / 20, 0.0])) for step in range(1, 21)]
    assert (turned_about(*deformed(points, 5.0, (0.03, 0.01, -0.02)), turns) == STICK).all()


# ---- a stuck pair turned by its supports


def test_a_stuck_pair_turned_by_its_supports_keeps_its_tractions():
    """Pressed, held for three steps, as edges press along the master's normals of the step before, then turned by 360
    degrees in 20 steps, every support moving along a circle in each step."""
    _, scene = blocks(lower_cells=(3, 3, 1), upper_cells=(2, 2, 1))
    pressed, held, centre = 0.1, 0.2, np.array([15.0, 20.0, 0.0])

    def moved(X, t, down):
        angle = 2 * np.pi * max(t - held, 0.0) / (1.0 - held)
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        place = X - [0.0, 0.0, down * min(t / pressed, 1.0)]
        return centre + (place - centre) @ turn.T - X

    for face, down in (("lower_bottom", 0.0), ("upper_top", 1.0)):
        for i, axis in enumerate("xyz"):
            scene.prescribe(face, axis, lambda X, t, i=i, down=down: moved(X, t, down)[:, i])
    scene.contact("upper_bottom", "lower_top", 5.0, name="c")
    times = [pressed, 0.13, 0.16, held, *(held + (1.0 - held) * np.arange(1, 21) / 20)]
    found = []
    for last in (4, 5, 11, 24):  # states after holding, one step, a third of a turn, the whole turn
        result = solve(scene, steps=times[:last], method=Method(tolerance=1e-10))
        assert result.converged and result.verdict.cuts == 0
        contact = result.system.contact_terms[0]
        response = contact.response(result.system.state)
        found.append((np.linalg.norm(response.traction, axis=2), response.status, response.gap))
    size, status, gap = found[0]
    assert (status[gap <= contact.trial.law.touch] == STICK).all() and (status == STICK).any()
    for other, now, _ in found[1:]:
        assert (now == status).all()
        assert np.abs(other - size).max() < 1e-7 * size.max()  # forces balanced to 1e-10 of the largest, per point


# ---- ranks


def numbers(bodies=None):
    """What must not depend on the ranks, for all kinds of slave points. bodies: {body: rank that holds all of it}."""
    rows = []
    for points in ("nodes", "corners", "averages", 2):
        result = sliding(drag=1.0, steps=4, tolerance=1e-11, points=points, penalty=10.0, ranks=bodies)
        names = [f"c_force_{a}_N" for a in "xyz"] + ["c_area_mm2", "c_active_points", "c_sticking_points"]
        rows += [row[name] for row in result.history for name in names]
        rows.append(float(result.converged))
        rows.append(result.system.matrix.getInfo(3)["mallocs"])  # summed over ranks
    return [float(value) for value in rows]


@pytest.mark.slow
@pytest.mark.serial
def test_ranks_give_the_same_numbers():
    """On 1 and 2 ranks as dolfinx parts the mesh, and with slave and master on two of 2 and of 3, either way round."""
    found = [np.array(numbers())]
    for ranks, bodies in ((2, None), (2, {"lower": 0, "upper": 1}), (3, {"lower": 2, "upper": 0})):
        code = (
            "import sys, json; from mpi4py import MPI; sys.path[:0] = ['tests', '.'];"
            f"import test_two_bodies as t; v = t.numbers({bodies});"
            "MPI.COMM_WORLD.rank == 0 and print('NUMBERS', json.dumps(v))"
        )
        command = ["mpirun", "-n", str(ranks), sys.executable, "-c", code]
        path = os.pathsep.join([ROOT, os.environ.get("PYTHONPATH", "")])
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path})
        line = [text for text in run.stdout.splitlines() if text.startswith("NUMBERS")]
        assert line, run.stderr
        found.append(np.array(json.loads(line[0][8:])))
    # 1e-9 of forces of 100 N, which are balanced to 1e-11
    assert all(np.abs(other - found[0]).max() < 1e-7 for other in found[1:])
    assert found[0][-1] == 0.0 and found[0][-2] == 1.0


# ---- bad input


def refuse(text, *, slave="upper_bottom", master="lower_top", scene=None, **parameters):
    scene = scene or blocks(**{**COARSE, **parameters})[1]
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    with pytest.raises(SceneError, match=text):
        scene.contact(slave, master, 0.3)
        scene.system()


def test_same_group_is_refused():
    refuse("both 'lower_top'", slave="lower_top")


def test_unknown_group_lists_the_known_ones():
    refuse("no surface group 'lid'", master="lid")


def test_deep_overlap_is_refused():
    refuse("6 inside body 'upper', where a cell is 5 high", upper_origin=(5.0, 10.0, -6.0))


@pytest.mark.parametrize("slave", ["upper_bottom", "lower_top"])
def test_bodies_apart_are_not_taken_for_overlapped(slave):
    """A plate below a block, whose bottom and the block's top are stated: a ray from the top, back through its own body and
    the room between them, meets that bottom from behind."""
    _, scene = blocks(**COARSE, upper=(20.0, 20.0, 2.0), upper_origin=(5.0, 10.0, -13.0))
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact(slave, "lower_top" if slave == "upper_bottom" else "upper_bottom", 0.3)
    scene.system()


@pytest.mark.parametrize("ranks", [{"lower": 0}, {"lower": 0, "upper": 99}])
def test_wrong_ranks_are_refused(ranks):
    with pytest.raises(ValueError, match="give each of the volumes lower, upper a rank below"):
        blocks(**COARSE, ranks=ranks)


def test_a_loose_block_is_refused():
    scene = blocks(**COARSE)[1]
    scene.fix("lower_bottom")
    scene.contact("upper_bottom", "lower_top", 0.0)
    with pytest.raises(SceneError, match="nothing holds body 'upper' along x, y"):
        scene.system()


def test_blocks_that_hold_only_each_other_are_refused():
    scene = blocks(**COARSE)[1]
    scene.contact("upper_bottom", "lower_top", 0.3)
    with pytest.raises(SceneError, match="nothing holds body 'lower' along x, y, z.*loose together"):
        scene.system()


def test_blocks_apart_meet_without_friction_history():
    """An open gap of 1 mm, closed after two of four steps: round-off within `touch` is all the force before."""
    _, scene = blocks(**COARSE, upper_origin=(5.0, 10.0, 1.0))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -2.0)
    scene.contact("upper_bottom", "lower_top", 0.3, name="c")
    result = solve(scene, steps=4)
    assert result.converged
    force = result.column("c_force_z_N")
    assert np.all(np.abs(force[:2]) < 1e-9) and force[3] > force[2] > 1.0


def test_master_facets_without_area_are_found():
    mesh, scene = blocks(**COARSE)
    master = MasterSurface(scene.space, mesh.facets("lower_top"))
    assert len(master.degenerate()) == 0
    place = master.X[master.facets[0][5]].mean(axis=0)
    master.X[master.facets[0][5]] = place
    found = master.degenerate()
    assert len(found) == 1 and np.allclose(found[0], place)


@pytest.mark.serial
@pytest.mark.parametrize("points", ["nodes", "corners", "averages", 2])
def test_foreseen_gaps_are_linear_in_the_motion(points):
    """What Newton judges by: the gaps' first-order change, second order away from the true gaps."""
    system, contact = deformed(points, 0.3, (0.4, 0.1, -0.02))
    way = np.random.default_rng(3).uniform(-1, 1, len(system.state.u.x.array))
    errors = foreseen_left(system, contact, way, 1e-3)
    assert orders(errors).min() > 1.98 and errors[0] < 1e-2 * np.sqrt(contact.surface.count) * 1e-3


@pytest.mark.parametrize("steps", [3, 6])
def test_long_steps_do_not_carry_bodies_through_each_other(steps):
    """Nested tubes whose steps are several cells long: a start beyond the outer tube must not pass for an open contact."""
    scene = {name: value for name, value in TUBES.items() if name != "processes"} | {"cells": 48, "steps": steps}
    found = tubes(**scene)
    assert found["converged"] and found["error"] < 1e-2  # the mesh's own error is 8e-4, bodies passed through err by 3


@pytest.mark.parametrize("points", ["averages", "nodes", 2])
def test_what_has_opened_wide_has_not_slid_off(points):
    """Farther than partners are looked for; beside its master it has."""
    _, scene = blocks(**COARSE)
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact("upper_bottom", "lower_top", points=points, name="c")
    stages = [
        Stage("press", prescribe={("upper_top", "z"): -0.1}, steps=1),
        Stage("lift", prescribe={("upper_top", "z"): 25.0}, steps=1),
        Stage("beside", prescribe={("upper_top", "x"): 80.0}, steps=1),
    ]
    lifted = solve(scene, stages=stages[:2]).require().system
    assert lifted.contact_terms[0].findings.trouble(lifted.state) is None
    beside = solve(scene, stages=stages).require().system
    assert "has no partner on 'lower_top' any more" in beside.contact_terms[0].findings.trouble(beside.state).reason


@pytest.mark.parametrize("points", ["averages", "nodes", 3])
@pytest.mark.parametrize(
    ("low", "high", "slave", "depth"),
    [(0.6, 1.2, "lower_bottom", None), (-0.3, 0.7, "upper_bottom", 0.7), (-0.3, 0.7, "lower_top", 0.7)],
    ids=["above", "through the slab", "the slab within"],
)
def test_a_body_behind_the_slave_s_own_is_not_inside_it(points, low, high, slave, depth):
    """Normals of a slab's lower side meet the upper side of a block that lies above it, as those of a block's lower side do
    that goes through the slab."""
    sizes = {
        "lower": (4.0, 2.0, 0.4),
        "lower_origin": (0.0, 0.0, 0.0),
        "upper": (2.0, 2.0, high - low),
        "upper_origin": (1.0, 0.0, low),
    }
    _, scene = blocks(**sizes, lower_cells=(8, 4, 1), upper_cells=(4, 4, 2))
    scene.fix("lower_bottom" if slave == "upper_bottom" else "lower_top")
    scene.fix("upper_top", "xy")
    other = "lower" if slave == "upper_bottom" else "upper"
    scene.contact(slave, (f"{other}_bottom", f"{other}_top"), points=points)
    if depth is None:
        scene.system()
    else:
        with pytest.raises(SceneError, match=f"starts {depth} inside body '{slave.split('_')[0]}'"):
            scene.system()


@pytest.mark.parametrize("points", ["averages", 3])
def test_a_far_side_that_thin_bodies_would_meet_through_themselves_is_refused(points):
    """The lower side of a slab a tenth thick, under a plate two tenths thick whose upper side is among the master."""
    sizes = {
        "lower": (4.0, 2.0, 0.1),
        "lower_origin": (0.0, 0.0, 0.0),
        "upper": (2.0, 2.0, 0.2),
        "upper_origin": (1.0, 0.0, 0.15),
    }
    _, scene = blocks(**sizes, lower_cells=(8, 4, 1), upper_cells=(4, 4, 1))
    scene.fix("lower_top")
    scene.fix("upper_top")
    scene.contact("lower_bottom", ("upper_bottom", "upper_top"), points=points)
    with pytest.raises(SceneError, match="lead back through its body to facets of 'upper_bottom.upper_top', 0.35 behind it"):
        scene.system()
