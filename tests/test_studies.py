"""Sweeps: every run is a row whatever becomes of it, an interrupted study goes on, charts come from the file alone."""

import os
import signal
import time

import numpy as np
import pytest

from fenics_contact.studies import Study, grid, stability_map, work_precision
from fenics_contact.studies.charts import cheapest, medians, pareto, slope
from fenics_contact.studies.runner import read

pytestmark = pytest.mark.serial


def case(h, way):
    """An invented method of second order whose time grows with h^-3, and ways in which a run may end."""
    if way == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if way == "hangs":
        time.sleep(60)
    if way == "raises":
        raise RuntimeError("no such luck")
    if way == "refused":
        raise ValueError("the scene is wrong")
    good = way != "diverges"
    verdict = {"verdict": "converged", "t_reached": 1.0} if good else {"verdict": "limit point", "t_reached": 0.25}
    return {"error": h**2, "converged": good, "iterations": int(10 / h), "cut_backs": 0, "seconds": h**-3} | verdict


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("studies")


def test_every_end_is_a_row_and_a_second_call_runs_nothing(folder):
    ways = ["good", "diverges", "dies", "hangs", "raises", "refused"]
    study = Study("ends", case, grid(h=[1.0], way=ways), limit=8.0)
    path = study.run(folder, progress=False)
    rows = {row["way"]: row for row in read(path)}
    assert list(rows) == ways
    assert rows["good"]["converged"] is True and rows["good"]["error"] == 1.0
    assert all(rows[way]["converged"] is False for way in ways[1:])
    assert rows["diverges"]["t_reached"] == 0.25
    assert "no such luck" in rows["raises"]["verdict"] and "the scene is wrong" in rows["refused"]["verdict"]
    assert "8 s" in rows["hangs"]["verdict"] and rows["dies"]["verdict"].startswith("stopped")
    assert all("numpy" in row["versions"] and row["machine"] for row in rows.values())
    before = path.read_text()
    study.run(folder, progress=False)
    assert path.read_text() == before


def test_an_interrupted_study_goes_on_where_it_stopped(folder):
    runs = grid(h=[1.0, 0.5], way=["good"])
    path = Study("stopped", case, runs[:1], repeats=2).run(folder, progress=False)
    first = path.read_text()
    Study("stopped", case, runs, repeats=2).run(folder, progress=False)
    assert path.read_text().startswith(first)
    assert sorted((row["h"], row["repeat"]) for row in read(path)) == [(0.5, 0), (0.5, 1), (1.0, 0), (1.0, 1)]


def test_a_parameter_may_not_hide_a_metric():
    with pytest.raises(ValueError, match="'error'"):
        Study("clash", case, [{"error": 1.0}])


def test_charts(folder):
    """Front, medians, slope and the answer to "what for 1 %" on rows whose truth is known; both pictures are drawn."""
    rows = [r | case(r["h"], "good") | {"way": w} for w, s in (("a", 1), ("b", 3)) for r in grid(h=[1.0, 0.5, 0.25, 0.1])
            for _ in range(s)]  # fmt: skip
    for row in rows:
        row["seconds"] *= 1.0 if row["way"] == "a" else 2.0
    assert len(medians(rows, ["h", "way"])) == 8
    assert cheapest(rows, 0.0101)["way"] == "a" and cheapest(rows, 0.0101)["h"] == 0.1
    assert cheapest(rows, 1e-9) is None
    sizes = np.array([1.0, 0.5, 0.25])
    assert abs(slope(sizes, sizes**2) - 2.0) < 1e-12
    assert pareto([(3.0, 1.0), (1.0, 2.0), (2.0, 2.5), (4.0, 0.5)]) == [1, 0, 3]
    front = work_precision(folder / "work.png", rows, lambda r: r["way"], lambda r: r["h"] == 1.0 and r["way"] == "a",
                           parameters=["h", "way"])  # fmt: skip
    assert {row["way"] for row in front} == {"a"}
    failed = case(1.0, "diverges") | {"h": 1.0, "way": "a"}
    stability_map(folder / "map.png", [failed, *rows[1:]], "h", "way", title="where it fails")
    stability_map(folder / "panels.png", rows, "h", "iterations", panel="way")
    assert all((folder / name).stat().st_size > 5000 for name in ("work.png", "map.png", "panels.png"))
