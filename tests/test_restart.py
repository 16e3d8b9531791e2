"""A resumed run goes on to the same result on any number of ranks, and a run killed at any moment can be resumed."""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from vtu_files import times_of_fields

from fenics_contact import (
    ArcSteps,
    Body,
    Displacement,
    Load,
    Method,
    Motion,
    Output,
    Scene,
    SceneError,
    Travel,
    coulomb,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box, dome, punch_plate, two_blocks
from fenics_contact.output.checkpoint import CheckpointFiles, Torn

ROOT = Path(__file__).resolve().parent.parent
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
ALL = [0.25, 0.5, 0.75, 1.0]
# the same where rotations are free: their torques balance to the forces' 1e-11 times the bodies' size
TURNING = 1e-9
DIRECTED = coulomb(0.3, across=0.5, along=(1.0, 2.0, 0.0))
SAME = 1e-10  # resumed against continuous: steps end at 1e-11 or, on one number of ranks, with the same iterates


def pushed_punch(degree=1, element="displacement", **options):
    """A rough punch pushed down and aside on a rough floor; its travel is unknown and it slips."""
    scene = Scene(
        Body(read_gmsh(punch_plate.build, inside=3, outside=2, layers=2, ratio=1.0), "plate", RUBBER),
        degree=degree,
        element=element,
    )
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, 0.3, name="c", **options)
    scene.contact("bottom", rigid_plane(name="floor"), 0.2, name="bottom", **options)
    return scene, {"push": {punch: lambda t: (20.0 * max(t - 0.25, 0.0), 0.0, -60.0 * t)}}


def sliding_blocks(points, degree=1, friction=0.3, **options):
    """A block pressed on another and dragged by half a facet of it: anchors on the master, slip."""
    lower, upper = ((6, 6, 2), (4, 4, 1)) if degree == 1 else ((4, 4, 1), (3, 3, 1))
    mesh = read_gmsh(two_blocks.build, lower_cells=lower, upper_cells=upper)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER), degree=degree)
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 4.0 * max(t - 0.25, 0.0)))
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -1.0 * min(t / 0.25, 1.0)))
    scene.contact("upper_bottom", "lower_top", friction, penalty=10.0, points=points, name="c", **options)
    return scene, {}


def swelling_blocks():
    """The same blocks, of which one swells alike all over and the other more and more along x."""
    scene, drive = sliding_blocks("averages")
    scene.swell("lower", lambda t: 1.0 + 0.1 * t)
    scene.swell("upper", lambda X, t: 1.0 + 0.01 * t * (X[:, 0] - X[:, 0].min()))
    return scene, drive


def dropped_tetrahedra():
    """A block of tetrahedra that nothing holds, dropped on a rough plane by its weight and blown aside: stabilised."""
    scene = Scene(Body(read_gmsh(draw_tetrahedra), "box", RUBBER), degree=2)
    scene.contact("bottom", rigid_plane((0, 0, -0.05)), 0.4, name="c", points=3)
    scene.body_force(lambda t: (0.03 * max(t - 0.25, 0.0), 0.0, -0.1 * t))
    return scene, {"method": Method(stabilise=True)}


def draw_tetrahedra(size=0.7):
    box = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [box]), "box")
    faces = [tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getBoundingBox(2, tag)[5] < 0.1]
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), "bottom")
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(3)


def turning_ball():
    """A rough ball that a force presses, a moment twists and a drive carries along, free to turn about all axes."""
    scene = Scene(
        Body(read_gmsh(box.build, size=(6.0, 6.0, 3.0), cells=(4, 4, 2), origin=(-3.0, -3.0, -3.0)), "box", RUBBER)
    )
    scene.fix("zmin")
    ball = rigid_sphere(20.0, (0.1, 0.2, 20.0), name="ball")
    scene.contact("zmax", ball, 0.4, name="c")
    loads = {"force": lambda t: (0, 0, -0.6 * min(4 * t, 1.0)), "moment": lambda t: (0, 0, 0.05 * t), "free": "rx ry"}
    return scene, {"move": {ball: Motion(x=lambda t: 0.3 * t, **loads)}, "method": Method(stabilise=True)}


def hub_and_tread():
    """A block tied by its top to a hub that presses it on a rough floor, carries it along and is free to tilt."""
    mesh = read_gmsh(box.build, size=(4.0, 2.0, 1.0), cells=(4, 2, 2), origin=(-2.0, -1.0, 0.0))
    scene = Scene(Body(mesh, "box", RUBBER))
    hub = rigid_hub("hub", (0, 0, 3.0))
    scene.tie("zmax", hub)
    scene.contact("zmin", rigid_plane(), 0.3, name="c")
    return scene, {"move": {hub: Motion(x=lambda t: 0.5 * t**2, force=(0, 0, -0.5), free="ry")}}


SCENES = {
    "hub": hub_and_tread,
    "ball that turns": turning_ball,
    "punch": pushed_punch,
    "punch of degree 2": lambda: pushed_punch(2),
    "punch, mixed element": lambda: pushed_punch(1, "mixed"),
    "blocks by nodes": lambda: sliding_blocks("nodes"),
    "blocks by Gauss points": lambda: sliding_blocks(2),
    "blocks of degree 2": lambda: sliding_blocks(3, degree=2),
    "blocks of degree 2 by averages": lambda: sliding_blocks("averages", degree=2),
    "blocks by averages": lambda: sliding_blocks("averages"),
    "blocks by averages, two directions": lambda: sliding_blocks("averages", friction=DIRECTED),
    "blocks by Gauss points, two directions": lambda: sliding_blocks(2, friction=DIRECTED),
    "blocks by averages, augmented": lambda: sliding_blocks("averages", penetration=1e-3),
    "blocks that swell": swelling_blocks,
    "tetrahedra, stabilised": dropped_tetrahedra,
    "punch, augmented": lambda: pushed_punch(penetration=1e-4),
    "blocks, augmented": lambda: sliding_blocks(1, penetration=1e-3),
}


# -- continuations: scene, its drive, until, back, steps after which it is stopped --------------------------------------
def snapped_dome():
    """A rough ball pushed through a dome's snap and back over its second limit point: stopped at the first, within the
    snap, at the end of the first leg, and at the second's return."""
    scene = Scene(Body(read_gmsh(dome.build, thickness=1.0, boss=5.0, cells=4), "dome", RUBBER))
    for group, axes in (("symmetry_x", "x"), ("symmetry_y", "y"), ("rim", "xyz")):
        scene.fix(group, axes)
    ball = rigid_sphere(8.0, (0, 0, 48.5), name="ball")
    scene.contact("outer", ball, 0.3, name="c")
    until = [Load(9.0), Travel(ball, "z", -15.2)]
    return scene, {"push": {ball: (0, 0, -1.0)}}, until, Travel(ball, "z", -14.0), (9, 13, 15, 16)


def caving_cube():
    """A cube under dead pressure caves in on a soft floor, multipliers and all, and comes back over the limit point."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", neo_hooke(5.0, 5.0)))
    scene.contact("zmin", rigid_plane(), penalty=20.0, penetration=1e-4, name="c")
    for i, axis in enumerate("xyz"):
        scene.traction(f"{axis}max", -2.0 * np.eye(3)[i])
        if axis != "z":
            scene.fix(f"{axis}min", axis)
    return scene, {}, Displacement("zmax", "z", -0.6), Displacement("zmax", "z", -0.55), (2, 4)


def confined_block():
    """A block in a smooth box, stiffer there than its default penalty, which is raised; a rough plate drags its top."""
    law = neo_hooke(0.4, 40.0)
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", law))
    for side in ("xmin", "xmax", "ymin", "ymax", "zmin"):
        scene.fix(side, side[0])
    plate = rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="plate")
    scene.contact("zmax", plate, 0.1, name="c")
    return scene, {"move": {plate: lambda t: (0.1 * t**2, 0, -0.3 * t)}}, Load(1.0), Load(0.6), (1, 2)


ARCS = {"dome": snapped_dome, "cave": caving_cube, "box": confined_block}


def follow(name, folder, stop=None, resume=False):
    """The path of one of ARCS to its end or, in vain, to one of its stops."""
    scene, drive, until, back, stops = ARCS[name]()
    steps = ArcSteps(until=until, back=back, first=0.6, turn=0.5, most=200 if stop is None else stops[stop])
    kept = folder and Output(Path(folder) / name, checkpoint=True, resume=resume)
    result = solve(scene, **drive, method=Method(tolerance=1.5e-12), steps=steps, out=kept)
    assert result.converged == (stop is None), result.verdict.reason
    assert stop is None or len(result.history) == stops[stop]
    return result


def carry(name, folder, times, resume=False):
    if name in ARCS:
        return follow(name, folder, None if times == ALL else 0, resume)
    scene, drive = SCENES[name]()
    method = replace(drive.pop("method", Method()), tolerance=1e-11)
    kept = folder and Output(Path(folder) / name, checkpoint=True, resume=resume)
    result = solve(scene, **drive, steps=times, method=method, out=kept)
    assert result.converged, result.verdict.reason
    return result


def numbers(result):
    """What a partition may not change: {quantity: its values in all steps}."""
    skip = ("seconds", "residual", "iterations")  # times, and what round-off may change at the last iteration
    contact = result.system.contact_terms[0]
    path = COMM.allreduce(float((contact.accepted.history.slip_path * contact.surface.area).sum()))
    columns = {key: [row[key] for row in result.history] for key in result.history[0] if key not in skip}
    return columns | {"slip path": [path], "norm": [result.system.vector.norm()]}


def apart(one, other):
    """Largest difference over the size of the quantities of its kind: force, moment, length, ..."""
    assert one.keys() == other.keys()
    worst = 0.0
    for key in one:
        kind = [np.abs(other[k]).max() for k in other if k.rsplit("_", 1)[-1] == key.rsplit("_", 1)[-1]]
        worst = max(worst, np.abs(np.subtract(one[key], other[key])).max() / max(*kind, 1e-300, 0.0))
    return worst


@pytest.fixture
def folder(tmp_path):
    return COMM.bcast(tmp_path)


@pytest.mark.parallel
@pytest.mark.parametrize(
    "name",
    ["punch", "blocks by Gauss points", "blocks by averages", "blocks by averages, two directions", "blocks that swell"],
)
def test_a_resumed_run_equals_a_continuous_one(name, folder):
    whole = carry(name, folder / "whole", ALL)
    continuous = numbers(whole)
    carry(name, folder / "parts", ALL[:2])
    result = carry(name, folder / "parts", ALL, resume=True)
    assert [row["step"] for row in result.history] == [1, 2, 3, 4]
    assert result.history[-1]["c_sticking_points"] < result.history[-1]["c_active_points"]  # history matters
    assert apart(numbers(result), continuous) < SAME
    again = carry(name, folder / "parts", ALL, resume=True)  # nothing left to do
    assert apart(numbers(again), continuous) < SAME
    assert result.summary["resumed_after_steps"] == [2] and again.summary["resumed_after_steps"] == [2, 4]
    assert whole.summary["energy"]["error_growth"] is not None
    for one in (result, again):  # and says the same: what steps twice as long would have left is known of all of them
        for word in ("error_growth", "normal_work_error_growth"):
            assert one.summary["energy"][word] == pytest.approx(whole.summary["energy"][word], rel=1e-6), word
        assert one.measured.within_facets == pytest.approx(whole.measured.within_facets, rel=1e-6)
    if COMM.rank == 0:
        tables = [(folder / f / name / "history.csv").read_text().splitlines() for f in ("whole", "parts")]
        whole, parts = (list(csv.DictReader(lines)) for lines in tables)
        assert [row["t"] for row in parts] == [row["t"] for row in whole] == ["0.25", "0.5", "0.75", "1"]
        assert parts[0].keys() == whole[0].keys()
        fields = [times_of_fields(folder / f / name) for f in ("whole", "parts")]
        assert fields[0] == fields[1] and fields[0]["displacement_mm"] == [0.0, *ALL]


@pytest.mark.serial
@pytest.mark.parametrize("stop", [1, 2, 4])
@pytest.mark.parametrize("name", ["blocks by Gauss points", "blocks by averages, two directions"])
def test_a_resumed_run_takes_the_same_iterations(tmp_path, name, stop):
    """Its next steps start from the same extrapolation: without it they take more, and are cut where others are not."""
    times = [i / 8 for i in range(1, 9)]

    def go(out, times, resume=False):
        scene, drive = SCENES[name]()
        return solve(scene, **drive, steps=times, out=Output(out, checkpoint=True, resume=resume)).require()

    whole = go(tmp_path / "whole", times)
    go(tmp_path / "parts", times[:stop])
    result = go(tmp_path / "parts", times, True)
    assert list(result.column("t")) == times
    assert list(result.column("iterations")) == list(whole.column("iterations"))
    assert apart(numbers(result), numbers(whole)) < 1e-13  # the same iterates


@pytest.mark.parametrize(
    "name",
    [  # on 2 ranks: the smallest here, all of them below
        pytest.param(name, marks=pytest.mark.parallel if name == "box" else pytest.mark.serial) for name in ARCS
    ],
)
def test_a_resumed_continuation_equals_a_continuous_one(name, folder):
    whole = follow(name, None)
    stops = range(len(ARCS[name]()[-1]))
    for stop in stops:
        follow(name, folder / "parts", stop, resume=stop > 0)
    result = follow(name, folder / "parts", resume=True)
    again = follow(name, folder / "parts", resume=True)  # nothing left to do
    for resumed in (result, again):
        assert apart(numbers(resumed), numbers(whole)) < SAME
        assert resumed.verdict.reason == whole.verdict.reason and resumed.verdict.cuts == whole.verdict.cuts
        assert len(resumed.verdict.residuals) == len(whole.history) > ARCS[name]()[-1][-1]
    points = [p["kind"][:3] for p in whole.summary["limit_points"]]
    assert points == {"dome": ["max", "min", "min"], "cave": ["max"], "box": []}[name]
    if name == "box":
        assert whole.summary["scene"]["contacts"][0]["penalty_raised"] > 1.0
    if name == "dome":
        assert 0 < min(whole.column("c_sticking_points") / whole.column("c_active_points")) < 1  # history matters


@pytest.mark.parallel
def test_a_continuation_goes_on_to_another_target(folder):
    """A leg that has ended can be made longer, not one before the way back has begun."""
    scene, drive, *_ = confined_block()
    kept = Output(folder, checkpoint=True)
    options = drive | {"method": Method(tolerance=1e-11)}
    solve(scene, steps=ArcSteps(until=Load(0.5), first=0.1), out=kept, **options).require()
    on = replace(kept, resume=True)
    result = solve(scene, steps=ArcSteps(until=Load(0.8), back=Load(0.7), first=0.1), out=on, **options).require()
    t = result.column("t")
    np.testing.assert_allclose([t[-1], t.max(), *t[np.abs(t - 0.5) < 1e-3]], [0.7, 0.8, 0.5], rtol=2e-6)  # TARGET_TOLERANCE
    for steps in (ArcSteps(until=Load(0.9), back=Load(0.7), first=0.1), ArcSteps(until=Load(0.8), first=0.1)):
        with pytest.raises(SceneError, match="gone beyond load t = 0.8, then load t = 0.7"):
            solve(scene, steps=steps, out=on, **options)


@pytest.mark.parallel
def test_load_steps_and_continuations_do_not_resume_each_other(folder):
    scene, drive, *_ = confined_block()
    ways = {"arcs": ArcSteps(until=Load(0.5), first=0.1), "steps": [0.25, 0.5]}
    for name, steps in ways.items():
        solve(scene, **drive, steps=steps, out=Output(folder / name, checkpoint=True)).require()
    for name, words in (
        ("arcs", "method: arc_length there, newton here"),
        ("steps", "method: newton there, arc_length here"),
    ):
        other = ways["steps" if name == "arcs" else "arcs"]
        with pytest.raises(SceneError, match=f"another scene, {words}; resume with the script that wrote it") as caught:
            solve(scene, **drive, steps=other, out=Output(folder / name, resume=True))
        assert len(set(COMM.allgather(str(caught.value)))) == 1


def alone():
    """Environment of a program: the pytest process may itself be an MPI process, whose identity a child must not inherit."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX", "PRTE", "OMPI_MCA_orte"))}
    return env | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}


def mpirun(count):
    return ["mpirun", "--oversubscribe", "-n", str(count)]


def on_ranks(count, *arguments):
    """Run this file's main program under `mpirun -n count`; returns what it prints last."""
    command = [*mpirun(count), sys.executable, __file__, *map(str, arguments)]
    done = subprocess.run(command, env=alone(), cwd=ROOT, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.strip().splitlines()[-1])


def resumed_across(ranks, names, folder):
    """Begun on one process and resumed on several, and the reverse, in one mpirun: what both give and one process does."""
    many, one = folder / "many", folder / "one"
    for name in names:
        carry(name, one, ALL[:2])
    found = on_ranks(ranks, many, "across", one, *names)
    for name in names:
        yield numbers(carry(name, None, ALL)), numbers(carry(name, many, ALL, resume=True)), found[name]


@pytest.mark.slow
@pytest.mark.serial
def test_resumed_on_another_number_of_ranks(tmp_path):
    names = [name for name in SCENES if name not in ("punch", "tetrahedra, stabilised")] + list(ARCS)
    for name, (continuous, two_to_one, one_to_two) in zip(names, resumed_across(2, names, tmp_path), strict=True):
        same = TURNING if name in ("hub", "ball that turns") else SAME
        assert apart(two_to_one, continuous) < same and apart(one_to_two, continuous) < same


@pytest.mark.slow
@pytest.mark.serial
def test_resumed_from_and_on_three_ranks(tmp_path):
    ((continuous, three_to_one, one_to_three),) = resumed_across(3, ["tetrahedra, stabilised"], tmp_path)
    assert continuous["c_sticking_points"][-1] > 0
    assert apart(three_to_one, continuous) < SAME and apart(one_to_three, continuous) < SAME


@pytest.mark.parallel
def test_another_scene_is_refused(folder):
    carry("punch", folder, ALL[:1])
    scene, drive = pushed_punch(2)
    with pytest.raises(SceneError, match="another scene, degree: 1 there, 2 here"):
        solve(scene, **drive, out=Output(folder / "punch", resume=True))
    out = folder / "box"
    for size, refused in (((10.0, 10.0, 5.0), False), ((10.0, 11.0, 5.0), True)):
        scene = Scene(Body(read_gmsh(box.build, size=size, cells=(2, 2, 2)), "box", RUBBER))
        scene.fix("zmin")
        scene.prescribe("zmax", "z", -0.1)
        if refused:
            with pytest.raises(SceneError, match="nodes lie in other places"):
                solve(scene, steps=1, out=Output(out, resume=True))
        else:
            solve(scene, steps=1, out=Output(out, checkpoint=True))


@pytest.mark.parallel
def test_a_checkpoint_needs_a_folder():
    scene, drive = pushed_punch()
    with pytest.raises(SceneError, match='need a folder: out=Output\\("folder"'):
        solve(scene, **drive, out=Output(checkpoint=True))
    with pytest.raises(SceneError, match="give True, or the number"):
        solve(scene, **drive, out=Output(checkpoint=-1))


@pytest.mark.serial
def test_a_torn_file_leaves_the_generation_before(tmp_path):
    files = CheckpointFiles(tmp_path)
    assert files.read() is None
    for step in (1, 2, 3):
        files.write(step, {"u": np.full(1000, float(step))}, {"rows": [step]})
    arrays, content = files.read()
    assert content["step"] == 3 and arrays["u"][0] == 3.0
    newest = tmp_path / "checkpoint_0.npz"
    whole = newest.read_bytes()
    for torn in (whole[: len(whole) // 2], whole[:3000] + b"x" + whole[3001:], b""):
        newest.write_bytes(torn)
        assert files.read()[1]["step"] == 2
    files.write(4, {"u": np.zeros(1)}, {})  # in the place of the damaged one
    assert CheckpointFiles(tmp_path).read()[1]["step"] == 4 and len(list(tmp_path.iterdir())) == 2
    for path in tmp_path.iterdir():
        path.write_bytes(b"")
    with pytest.raises(Torn, match="checkpoint_0.npz and checkpoint_1.npz: damaged"):
        files.read()


def small(folder, resume, steps):
    """Accepted steps of a few milliseconds each, nearly all of them spent in writing."""
    scene = Scene(Body(read_gmsh(box.build, size=(10.0, 10.0, 5.0), cells=(2, 2, 1)), "box", RUBBER))
    scene.fix("zmin")
    tool = rigid_plane((0, 0, 5.0), (0, 0, -1.0))
    scene.contact("zmax", tool, 0.3, name="c")
    return solve(scene, move={tool: (1.0, 0, -1.0)}, steps=steps, out=Output(folder, checkpoint=True, resume=resume))


@pytest.mark.serial
def test_a_checkpoint_of_another_version_is_refused(tmp_path):
    small(tmp_path, resume=False, steps=2)
    files = CheckpointFiles(tmp_path)
    arrays, content = files.read()
    content["verdict"]["formerly"] = 0
    files.write(content.pop("step") + 1, arrays, content)
    with pytest.raises(SceneError, match="written by another version .*'formerly'.*overwrite=True"):
        small(tmp_path, resume=True, steps=3)


def accepted(folder):
    """Number of rows in the history a killed run left: steps it had said to be accepted."""
    path = folder / "history.csv"
    return max(path.read_text().count("\n") - 1, 0) if path.exists() else 0


@pytest.mark.slow
@pytest.mark.serial
def test_killed_at_any_moment(tmp_path):
    kill_and_resume(tmp_path, kills=3, steps=30)


def kill_and_resume(tmp_path, kills, steps, ranks=1, sign=signal.SIGKILL):
    """Kill a run, on several ranks one of them, again and again; rows in the history and step of the checkpoint each time.

    Each time the fields of all accepted steps must be whole.
    """
    rng = random.Random(time.time_ns())
    out, log = tmp_path / "run", []
    kept = 0
    for _ in range(kills):
        command = [*(mpirun(ranks) if ranks > 1 else ()), sys.executable, __file__, out, "small", str(steps)]
        run = subprocess.Popen(list(map(str, command)), cwd=ROOT, env=alone())
        deadline = time.monotonic() + 60.0
        while accepted(out) <= kept and run.poll() is None and time.monotonic() < deadline:
            time.sleep(0.001)
        time.sleep(rng.uniform(0.0, 0.1))  # three to four steps
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        victims = list(map(int, children.read_text().split())) if ranks > 1 and children.exists() else [run.pid]
        if run.poll() is None:
            os.kill(rng.choice(victims or [run.pid]), sign)
        run.wait()
        rows = accepted(out)
        found = CheckpointFiles(out).read()
        assert found is not None and found[1]["step"] >= rows >= kept, (log, rows)
        assert len(times_of_fields(out)["displacement_mm"]) >= rows + 1
        log.append((rows, found[1]["step"]))
        kept = found[1]["step"]
        if kept == steps:
            break
    result = small(out, True, steps)
    assert result.converged and [row["step"] for row in result.history] == list(range(1, steps + 1)), log
    whole = small(tmp_path / "whole", False, steps)
    assert apart(numbers(result), numbers(whole)) < SAME
    times = times_of_fields(out)
    assert times == times_of_fields(tmp_path / "whole") and len(times["displacement_mm"]) == steps + 1
    return log


if __name__ == "__main__":
    where, what = Path(sys.argv[1]), sys.argv[2]
    if what == "small":
        small(where, True, int(sys.argv[3]))
    elif what in ("kill", "term"):  # by hand: python3 tests/test_restart.py FOLDER kill 20 times 400 steps 2 ranks
        sign = signal.SIGKILL if what == "kill" else signal.SIGTERM
        print(kill_and_resume(where, int(sys.argv[3]), int(sys.argv[5]), int(sys.argv[7]), sign))
    else:
        found = {}
        for name in sys.argv[4:]:
            carry(name, where, ALL[:2])
            found[name] = numbers(carry(name, sys.argv[3], ALL, resume=True))
        if COMM.rank == 0:
            print(json.dumps(found))
