"""Notes on results reach the tables and charts of studies: a row that a direct run would doubt does not look right."""

import csv

import pytest

from fenics_contact import Body, Output, Scene, neo_hooke, read_gmsh, rigid_sphere, solve
from fenics_contact.meshes import box
from fenics_contact.solvers.verdict import Verdict
from fenics_contact.studies import Study, curves, failures, grid, read, stability_map

pytestmark = pytest.mark.serial


def ball(squeeze_mm, steps):
    """Pressed on cells as wide as itself; or, drawn back, never there."""
    mesh = read_gmsh(box.build, size=(4, 4, 2), cells=(4, 4, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix("zmin")
    tool = rigid_sphere(0.5, (2, 2, 2.5), name="ball")
    scene.contact("zmax", tool, name="lid")
    return solve(scene, move={tool: (0, 0, -squeeze_mm)}, steps=steps, out=Output(progress=False))


def pressed(squeeze_mm):
    """What nobody doubts."""
    scene = Scene(Body(read_gmsh(box.build, cells=(1, 1, 1)), "box", neo_hooke(1.0, 5.0)))
    for axis in "xyz":
        scene.fix(f"{axis}min", axis)
    scene.prescribe("zmax", "z", -squeeze_mm)
    return solve(scene, steps=1, out=Output(progress=False))


def test_notes_of_runs_are_in_the_table_in_full(tmp_path):
    study = Study("noted", ball, grid(squeeze_mm=[0.1, -0.1], steps=[1, [0.5]]), outputs=["lid_load_N"])
    rows = read(study.run(tmp_path, progress=False, isolated=False))
    assert all(row["converged"] is True and row["verdict"] == "converged" for row in rows)
    assert all("1 slave node carries all of its greatest load" in row["notes"] for row in rows[:2])
    assert all("never closed" in row["notes"] for row in rows[2:])
    assert ["go to t = 0.5" in row["notes"] for row in rows] == [False, True, False, True]
    direct = ball(-0.1, [0.5]).verdict
    assert rows[3]["notes"].split(" | ") == direct.doubts == direct.notes and len(direct.notes) > 1
    sure = read(Study("sure", pressed, grid(squeeze_mm=[0.1])).run(tmp_path, progress=False, isolated=False))
    assert sure[0]["notes"] == "" and sure[0]["converged"] is True


def test_what_was_overcome_is_no_doubt():
    notes = ["1 slave node carries all", "2 cut-backs, which leave nothing in the result: cycling (2 of 2)"]
    assert Verdict(notes=notes).doubts == notes[:1]


def rows_of(notes):
    end = {"verdict": "converged", "t_reached": 1.0, "iterations": 3, "cut_backs": 0}
    return [
        {"depth_mm": depth, "friction": 0.0, "repeat": 0, "force_N": depth**2, "converged": True, **end, "notes": note}
        for depth, note in enumerate(notes, start=1)
    ]


def test_charts_mark_rows_with_notes(tmp_path, monkeypatch):
    """Dotted, where failed ones are hatched; the note stands below the panels on a line and is returned in full."""
    drawn = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *a, **k: drawn.append(figure))
    note = "contact 'lid': 1 slave node carries all of its greatest load: " + "so few know the force " * 9
    rows = rows_of(["", note, "", ""])
    rows[3] |= {"converged": False, "verdict": "limit point"}
    said = curves(tmp_path / "noted.png", rows, "depth_mm", ["force_N"])
    assert said == ["depth_mm 4: limit point at t = 1", f"depth_mm 2: {note}"] and failures(rows, ["depth_mm"]) == said[:1]
    (axes,) = drawn[0].axes
    assert [patch.get_hatch() for patch in axes.patches] == ["////", "...."]
    assert axes.patches[1].get_extents().transformed(axes.transData.inverted()).contains(2.0, 0.5)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["failed", "with notes"]
    foot = drawn[0]._supxlabel.get_text().splitlines()
    assert foot[-2].startswith("With notes") and foot[-1].startswith("depth_mm 2: contact 'lid': 1 slave node carries all")
    assert axes.lines[0].get_ydata()[1] == 4.0  # drawn, for the run has converged
    for kept in (rows, rows_of(["", "", "", ""])):
        stability_map(tmp_path / "map.png", kept, "depth_mm", "friction", wrong=lambda row: row["depth_mm"] == 3)
    frames = [[patch.get_linestyle() for patch in one.axes[0].patches if not patch.get_fill()] for one in drawn[1:]]
    assert frames == [[":", "-"], ["-"]]
    assert ["notes" in one.axes[-1].get_xlabel() for one in drawn[1:]] == [True, False]


def test_tables_of_before_are_read_and_gain_the_column(tmp_path):
    """Their rows say nothing of notes; runs that they lack do."""
    path = tmp_path / "old.csv"
    Study("old", pressed, grid(squeeze_mm=[0.1])).run(tmp_path, progress=False, isolated=False)
    (row,) = list(csv.DictReader(path.open(newline="")))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [name for name in row if name != "notes"], extrasaction="ignore")
        writer.writeheader(), writer.writerow(row)
    assert curves(tmp_path / "old.png", read(path), "squeeze_mm", ["t_reached"]) == []
    short = Study("old", lambda squeeze_mm: {"verdict": "converged", "notes": "few"}, grid(squeeze_mm=[0.1, 0.2]))
    assert [row["notes"] for row in read(short.run(tmp_path, progress=False, isolated=False))] == ["", "few"]
