"""Sweeps: every run is a row whatever becomes of it, an interrupted study goes on, charts come from the file alone."""

import os
import signal
import time

import numpy as np
import pytest

from fenics_contact.studies import Study, answer, expand, grid, stability_map, work_precision
from fenics_contact.studies.__main__ import NAMES, run
from fenics_contact.studies.charts import StudyError, _short_panels, cheapest, hold_slope, medians, pareto, savings
from fenics_contact.studies.exact import Radial, boussinesq, under_hertz
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
    ways = ["good", "diverges", "dies", "raises", "refused", "hangs"]
    study = Study("ends", case, grid(h=[1.0], way=ways), limit=60.0)
    Study("ends", case, study.runs[:-1], limit=60.0).run(folder, progress=False)
    path = Study("ends", case, study.runs[-1:], limit=2.0).run(folder, progress=False)  # hangs, or has not even begun
    rows = {row["way"]: row for row in read(path)}
    assert list(rows) == ways
    assert rows["good"]["converged"] is True and rows["good"]["error"] == 1.0
    assert all(rows[way]["converged"] is False for way in ways[1:])
    assert rows["diverges"]["t_reached"] == 0.25
    assert "no such luck" in rows["raises"]["verdict"] and "the scene is wrong" in rows["refused"]["verdict"]
    assert "2 s" in rows["hangs"]["verdict"] and rows["dies"]["verdict"].startswith("stopped")
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
    """Front, medians, slope and the answer to "what for 1 %" on rows whose truth is known; all pictures are drawn."""
    base = {"h": 1.0, "way": "a"}
    panels = {"size": {"good": {"h": [1.0, 0.5, 0.25, 0.08]}, "slow": {"h": [1.0, 0.5, 0.25, 0.08], "way": ["b"]}}}
    runs = expand(base, panels)
    assert len(runs) == 8 and runs[0] == base
    rows = [r | case(r["h"], "good") for r in runs for _ in range(3 if r["way"] == "b" else 1)]
    for i, row in enumerate(rows):
        row["seconds"] *= 1.0 if row["way"] == "a" else (2.0, 9.0, 1.5)[i % 3]
    assert len(medians(rows, ["h", "way"])) == 8
    assert cheapest(rows, 0.0101)["way"] == "a" and cheapest(rows, 0.0101)["h"] == 0.08
    assert cheapest(rows, 1e-9) is None
    assert "h 0.08 (error 0.64%, 1953.12 of" in answer(rows, base, panels, ["h", "way"])
    assert "0.1% no run suffices for sure, the best has 0.64% with h 0.08" in answer(rows, base, panels, ["h", "way"])
    sizes = np.array([1.0, 0.5, 0.25])
    assert "2.00" in hold_slope("error", sizes, sizes**2, 2, 1e-9)
    with pytest.raises(StudyError, match="order 2.00"):
        hold_slope("error", sizes, sizes**2, 1, 0.3)
    assert pareto([(3.0, 1.0), (1.0, 2.0), (2.0, 2.5), (4.0, 0.5)]) == [1, 0, 3]
    front = work_precision(folder / "work.png", rows, base, panels, "a title", ["h", "way"])
    assert {row["way"] for row in front} == {"a"}
    apart = [row | {"error": float("nan"), "value": row["h"]} for row in rows]
    assert work_precision(folder / "values.png", apart, base, panels, parameters=["h", "way"]) == []
    assert "no reference" in answer(apart, base, panels, ["h", "way"])
    many = _short_panels({"many": dict.fromkeys("abcdefghi", {}), "few": {"a": {}}})
    assert [len(curves) for curves in many.values()] == [3, 3, 3, 1]
    failed = case(1.0, "diverges") | {"h": 1.0, "way": "a"}
    stability_map(folder / "map.png", [failed, *rows[1:]], "h", "way", title="where it fails")
    stability_map(folder / "panels.png", rows, "h", "iterations", panel="way", wrong=lambda row: row["error"] > 0.1)
    values = [row | {"value": 1.0 + row["error"]} for row in rows]
    (line,) = savings(folder / "savings.png", values, {"coarse": (base | {"h": 0.08}, base)}, ["h", "way"])
    assert line == "coarse: 0.00 of the time, force differs by 98.73%"  # 1/1953; (1 + 1)/(1 + 0.0064) - 1
    pictures = ("work.png", "values.png", "map.png", "panels.png", "savings.png")
    assert all((folder / name).stat().st_size > 5000 for name in pictures)


# independent scripts: inner stretch or radius [mm], pressure [MPa], contact pressure [MPa] where there is one
@pytest.mark.parametrize(("stretch", "pressure"), [(1.02, 0.917799e-3), (1.4, 5.446230e-3), (3.0, 3.585209e-3)])
def test_exact_sphere(stretch, pressure):
    found, _ = Radial("sphere", 5.0).solve((95.0, 96.0), 95.0 * stretch)
    assert abs(found / pressure - 1) < 1e-6  # printed digits


@pytest.mark.parametrize(("radius", "inside", "contact"), [(104.0, 0.045330, 0.013863), (140.0, 0.079361, 0.031856)])
def test_exact_tubes(radius, inside, contact):
    tube = Radial("tube", 5.0)
    pressure, interface = tube.solve((80.0, 90.0), radius, lambda r: tube.solve((100.0, 110.0), r)[0])
    found = tube.solve((100.0, 110.0), interface)[0]
    assert abs(pressure - inside) < 1e-6 and abs(found - contact) < 1e-6  # printed digits


def test_field_under_hertz_pressure():
    """Surface outside a circular contact (Johnson 1985, 3.42a)."""
    E, nu, a, r = 1000.0, 0.3, 2.0, np.array([6.0, 12.0])
    peak = 3 / (2 * np.pi * a**2)  # of a force of one
    sunk = (1 - nu**2) / E * peak / (2 * a) * ((2 * a**2 - r**2) * np.arcsin(a / r) + r * a * np.sqrt(1 - (a / r) ** 2))
    X = np.column_stack([r * np.cos(0.3), r * np.sin(0.3), 0 * r])
    # rings of 8 points over a disc: (a/r)^8 is 1.5e-4 and 6e-7
    assert abs(under_hertz(boussinesq(1.0, E, nu), a)(X)[:, 2] / -sunk - 1) == pytest.approx(0.0, abs=1.5e-4)
    assert abs(under_hertz(boussinesq(1.0, E, nu), a)(X)[1, 2] / -sunk[1] - 1) < 6e-7


@pytest.mark.parametrize("name", NAMES)
def test_quick_version_of_each_study(name, tmp_path):
    """Fails where a run cannot be made, a chart not be drawn, or a slope contradicts theory."""
    assert run(name, tmp_path, tmp_path, quick=True, progress=False)
    assert list(tmp_path.glob("*.csv")) and all(p.stat().st_size > 10_000 for p in tmp_path.glob("*.png"))
