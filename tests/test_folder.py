"""A results folder at any end of a run: what was accepted is whole, what is not a run's own stays, nothing goes unasked."""

import csv
import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from refusals import refused
from test_restart import alone, mpirun
from vtu_files import times_of_fields

from fenics_contact import (
    Body,
    FolderError,
    Method,
    Output,
    Scene,
    SceneError,
    neo_hooke,
    read_gmsh,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box
from fenics_contact.output import checkpoint
from fenics_contact.output.checkpoint import CheckpointFiles
from fenics_contact.output.history import HistoryFile
from fenics_contact.restart import first_difference
from fenics_contact.solid.materials import Isotropic

ROOT = Path(__file__).resolve().parent.parent
COMM = MPI.COMM_WORLD
RADIUS = 20.0


@pytest.fixture
def folder(tmp_path):
    return COMM.bcast(tmp_path) / "run"


def scene_of(radius=RADIUS, lid=0.0, traction=0.0, penalty=None, friction=0.3, law=None):
    """A block on its bottom, pressed by a ball."""
    mesh = read_gmsh(box.build, size=(10.0, 10.0, 5.0), cells=(2, 2, 1))
    scene = Scene(Body(mesh, "box", law or neo_hooke(1.0, 5.0)))
    scene.fix("zmin")
    scene.prescribe("xmin", "x", lambda X, t: lid * t * X[:, 2])
    scene.traction("ymax", lambda t: (0.0, traction * t, 0.0))
    ball = rigid_sphere(radius, (5, 5, 5.0 + radius), name="ball")
    scene.contact("zmax", ball, friction, name="c", penalty=penalty)
    return scene, ball


def press(out, depth=-1.0, steps=4, method="newton", record=None, **options):
    scene, ball = scene_of(**options)
    drive = {"move": {ball: lambda t: (0.5 * t, 0.0, depth * t)}}
    return solve(scene, **drive, steps=steps, out=out, method=method, record=record)


def raised(kind, action, *words):
    refused(action, *words, kind=kind)


def rows_in(folder):
    with open(folder / "history.csv", newline="") as file:
        return [int(row["step"]) for row in csv.DictReader(file)]


def whole(folder, steps):
    """That many accepted steps are in the folder, whole, and nothing half-written is."""
    COMM.Barrier()
    assert rows_in(folder) == list(range(1, steps + 1))
    fields = times_of_fields(folder)
    bodies = fields["displacement_mm"]
    assert len(bodies) >= steps + 1
    for name, times in fields.items():  # a tool's file is there before its step's
        assert times == bodies or (name.startswith("tool") and times[:-1] == bodies), name
    assert "tool ball" in fields
    assert not list(folder.rglob("*part*"))
    COMM.Barrier()


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


# -- a full disk --------------------------------------------------------------------------------------------------------
@pytest.fixture
def file_size():
    """A function that bounds the size of files, as a full disk does: longer ones are cut, and the system says so."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parallel
@pytest.mark.parametrize("keep", [False, True])
def test_no_room_for_fields(folder, file_size, keep):
    def fill(state):
        file_size(2000 if state.t > 0.3 else resource.RLIM_INFINITY)
        return 0.0

    run = lambda: press(Output(folder, checkpoint=keep), record={"fill": fill})  # noqa: E731
    raised(FolderError, run, str(folder), "the fields of step 2", "OSError", os.strerror(errno.EFBIG))
    file_size(resource.RLIM_INFINITY)
    whole(folder, 1)
    if keep:
        assert press(Output(folder, resume=True), record={"fill": lambda state: 0.0}).converged
        whole(folder, 4)


@pytest.mark.parallel
def test_no_room_for_a_checkpoint(folder, monkeypatch):
    savez, count = np.savez, []

    def cut(file, **arrays):
        count.append(1)
        if len(count) < 3:
            return savez(file, **arrays)
        file.write(b"half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(checkpoint.np, "savez", cut)
    kept = Output(folder, checkpoint=True)
    raised(FolderError, lambda: press(kept), str(folder), "a checkpoint", "No space left on device")
    whole(folder, 1)
    monkeypatch.undo()
    assert COMM.rank > 0 or CheckpointFiles(folder).read()[1]["step"] == 1
    assert press(Output(folder, resume=True)).converged
    whole(folder, 4)


@pytest.mark.serial
def test_a_row_is_written_at_once_or_not_at_all(tmp_path, file_size):
    file = HistoryFile(tmp_path)
    file.write({"step": 1, "t": 0.1})
    size = (tmp_path / "history.csv").stat().st_size
    file_size(size + 3)
    with pytest.raises(OSError, match="space|large"):
        file.write({"step": 2, "t": 0.123456789})
    file_size(resource.RLIM_INFINITY)
    assert rows_in(tmp_path) == [1] and (tmp_path / "history.csv").stat().st_size == size
    file.write({"step": 2, "t": 0.2})
    file.close()
    assert rows_in(tmp_path) == [1, 2]


# -- what is in the folder already ----------------------------------------------------------------------------------------
@pytest.mark.parallel
@pytest.mark.parametrize("keep", [False, True])
def test_results_are_replaced_only_where_that_is_asked_for(folder, keep):
    if COMM.rank == 0:
        (folder / "steps" / "mine").mkdir(parents=True)
        (folder / "tools").mkdir()
        for name in ("notes.txt", "steps/notes.txt", "steps/999999.vtu", "steps/mine/a.txt", "tools/ball_999999.vtu"):
            (folder / name).write_text("mine")
        (folder / "tools" / "ball_of_mine.pvd").write_text('<x><DataSet file="ball_999999.vtu"/></x>')
    COMM.Barrier()
    mine = contents(folder)
    press(Output(folder, checkpoint=keep))
    whole(folder, 4)
    before = contents(folder)
    COMM.Barrier()
    for out in (folder, Output(folder, checkpoint=True)):
        raised(SceneError, lambda out=out: press(out), str(folder), "holds results", "overwrite=True", "resume=True")
    raised(SceneError, lambda: press(Output(folder, overwrite=True, resume=True)), "give one of them")
    assert contents(folder) == before
    stale = []

    def look(state):
        old = ("summary.json", "body.png", "steps/000004.vtu", "tools/ball_000004.vtu")
        stale.extend(name for name in old if (folder / name).exists())
        return 0.0

    press(Output(folder, checkpoint=not keep, overwrite=True), steps=2, record={"look": look})
    whole(folder, 2)
    assert not stale, "of the run before"
    assert (folder / "checkpoint_0.npz").exists() is not keep
    assert {path: data for path, data in contents(folder).items() if path in mine} == mine


@pytest.mark.parallel
@pytest.mark.parametrize("file", ["steps/000001.vtu", "tools/ball_000001.vtu"])
def test_a_folder_in_the_place_of_a_file_is_named(folder, file):
    if COMM.rank == 0:
        (folder / file).mkdir(parents=True)
    COMM.Barrier()
    kept = Output(folder, checkpoint=True)
    raised(FolderError, lambda: press(kept), str(folder), "the fields of step 1", "IsADirectoryError")
    whole(folder, 0)


@pytest.mark.parallel
def test_damaged_checkpoints_are_refused_and_nothing_is_lost(folder):
    press(Output(folder, checkpoint=True), steps=2)
    if COMM.rank == 0:
        for i in range(2):
            path = folder / f"checkpoint_{i}.npz"
            path.write_bytes(path.read_bytes()[:1000])
    COMM.Barrier()
    before = contents(folder)
    COMM.Barrier()
    resumed = lambda: press(Output(folder, resume=True))  # noqa: E731
    raised(SceneError, resumed, "checkpoint_0.npz and checkpoint_1.npz", "damaged", "overwrite=True")
    assert contents(folder) == before


@pytest.mark.parallel
def test_results_without_a_checkpoint_are_not_resumed(folder):
    press(folder, steps=1)
    resumed = lambda: press(Output(folder, resume=True))  # noqa: E731
    raised(SceneError, resumed, str(folder), "without a checkpoint", "overwrite=True")
    whole(folder, 1)


# -- another statement ----------------------------------------------------------------------------------------------------
def stiffer(shear):
    """A law whose name does not tell its number."""
    law = neo_hooke(1.0, 5.0)
    return Isotropic("mine", lambda I1, I2, J: shear * law.psi(I1, I2, J), 1.0, 5.0)


OTHERS = {
    "tool 'ball', shape: 20.0 there, 19.0 here": {"radius": 19.0},
    "support of xmin along x: .* there, .* here": {"lid": 0.01},
    "traction on 'ymax': 0.0 there, 0.003.* here": {"traction": 0.01},
    "move of 'ball': -0.3 there, -0.36 here": {"depth": -1.2},
    "contact 'c', penalty normal: None there, 7.0 here": {"penalty": 7.0},
    "contact 'c', friction: 0.3 there, 0.2 here": {"friction": 0.2},
    "energy of 'box': .* there, .* here": {"law": stiffer(1.1)},
    "stabilise: False there, True here": {"method": Method(stabilise=True)},
    "damping: False there, True here": {"method": Method(damping=True)},
    "method: newton there, snes here": {"method": "snes"},
    r"record: \[\] there, \['mine'\] here": {"record": {"mine": lambda state: 1.0}},
}


@pytest.mark.parallel
def test_another_statement_is_refused_and_named(folder):
    law = stiffer(1.0)
    press(Output(folder, checkpoint=True), steps=[0.25], law=law)
    before = contents(folder)
    COMM.Barrier()
    for words, change in OTHERS.items():
        with pytest.raises(SceneError, match=f"another scene, {words}; resume with the script") as caught:
            press(Output(folder, resume=True), **{"law": law, **change})
        assert len(set(COMM.allgather(str(caught.value)))) == 1
    assert contents(folder) == before
    assert press(Output(folder, resume=True), steps=[0.25, 0.5], law=law).converged


@pytest.mark.parallel
def test_paths_are_compared_as_far_as_the_run_has_come(folder):
    """Beyond t = 1 too; where it has not been yet they may differ, or not be defined at all."""

    def way(t, beyond):
        assert t <= 2.0 or beyond is not None
        return (0.0, 0.0, -0.2 * min(t, 1.0) - 0.1 * max(t - 1.0, 0.0) - (beyond or 0.0) * max(t - 2.0, 0.0))

    def go(path, steps, out):
        scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", stiffer(1.0)))
        scene.fix("zmin")
        plane = rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="plane")
        scene.contact("zmax", plane, name="c")
        return solve(scene, move={plane: path}, steps=steps, out=out).require()

    resumed = Output(folder, resume=True)
    go(lambda t: way(t, None), [0.5, 1.0, 2.0], Output(folder, checkpoint=True))
    with pytest.raises(SceneError, match="another scene, move of 'plane'"):
        go(lambda t: (0.0, 0.0, -0.2 * t), [0.5, 1.0, 2.0, 3.0], resumed)
    result = go(lambda t: way(t, 0.3), [0.5, 1.0, 2.0, 3.0], resumed)
    assert list(result.column("t")) == [0.5, 1.0, 2.0, 3.0]
    assert result.history[-1]["plane_travel_z_mm"] == pytest.approx(-0.7)


@pytest.mark.serial
def test_first_difference():
    same = {"a": [1.0, 0.0], "b": None, "c": "x"}
    assert first_difference(same, {"a": [1.0, 1e-12], "b": None, "c": "x"}) is None  # round-off of nodes moved between ranks
    assert first_difference(same, {"a": [1.0, 1e-8], "b": None, "c": "x"}) == ("a", 0.0, 1e-8)
    assert first_difference(same, same | {"d": 1}) == ("d", "nothing", 1)
    assert first_difference(same | {"d": 1}, same) == ("d", 1, "nothing")
    assert first_difference(same, same | {"a": [1.0]}) == ("a", [1.0, 0.0], [1.0])


# -- other ends of a run --------------------------------------------------------------------------------------------------
@pytest.mark.parallel
@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt])
def test_an_exception_leaves_what_was_accepted(folder, kind):
    def stop(state):
        if state.t > 0.6:
            raise kind("enough")
        return 0.0

    with pytest.raises(KeyboardInterrupt if kind is KeyboardInterrupt else SceneError, match="enough"):
        press(folder, record={"stop": stop})
    whole(folder, 2)


@pytest.mark.serial
@pytest.mark.parametrize("ranks", [1, 2])
def test_terminated_without_checkpoints(tmp_path, ranks):
    end_and_look(tmp_path / "run", ranks, signal.SIGTERM)


def end_and_look(out, ranks, sign, after=3):
    """Send a signal to a run once it has accepted `after` steps; its history and fields must be whole."""
    run = subprocess.Popen(
        [*(mpirun(ranks) if ranks > 1 else ()), sys.executable, __file__, str(out)], env=alone(), cwd=ROOT
    )
    deadline = time.monotonic() + 60.0
    while run.poll() is None and time.monotonic() < deadline:
        if (out / "history.csv").exists() and len(rows_in(out)) >= after:
            break
        time.sleep(0.01)
    run.send_signal(sign)
    assert run.wait(timeout=30) != 0
    rows = rows_in(out)
    assert rows == list(range(1, len(rows) + 1)) and len(rows) >= after
    assert len(times_of_fields(out)["displacement_mm"]) >= len(rows) + 1
    return len(rows)


if __name__ == "__main__":
    press(Path(sys.argv[1]), steps=400)
