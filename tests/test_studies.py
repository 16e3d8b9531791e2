"""Sweeps: every run is a row whatever becomes of it, an interrupted study goes on, charts come from the file alone."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from mpi4py import MPI

from fenics_contact import Body, Output, Scene, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box
from fenics_contact.studies import (
    Study,
    answer,
    curves,
    expand,
    failures,
    grid,
    metrics,
    speed,
    sphere,
    stability_map,
    work_precision,
)
from fenics_contact.studies.__main__ import NAMES, main, run
from fenics_contact.studies.charts import cheapest, hold_slope, medians, pareto, savings, short_panels
from fenics_contact.studies.exact import Radial, boussinesq, under_hertz
from fenics_contact.studies.runner import StudyError, read, row_of
from fenics_contact.studies.speed import race

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


@pytest.mark.slow
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


def failing(way):
    """Ways in which a case fails on any number of processes."""
    if way == "one rank" and MPI.COMM_WORLD.rank > 0:
        raise RuntimeError("on one alone")
    if way == "one rank":
        return {"F_N": 1.0}
    if way == "wrong on one rank" and MPI.COMM_WORLD.rank == 1:
        raise ValueError("no such scene")
    if "on one rank" in way:
        MPI.COMM_WORLD.barrier()
    if way == "raises":
        raise NameError("two lines\nof words")
    if way == "is ended":
        os.kill(os.getpid(), signal.SIGKILL)
    if way == "exits":
        os._exit(3)
    return {"F_N": 1j} if way == "no number" else None


FAILING = {
    "one rank": "stopped: RuntimeError: on one alone",
    "wrong on one rank": "refused: no such scene",
    "raises": "stopped: NameError: two lines\nof words",
    "is ended": "stopped: exit 137",
    "exits": "stopped: exit 3",
    "nothing": "refused: a case returns a Result or a dict, and this one has returned None",
    "no number": "stopped: TypeError: float() argument must be a string or a real number, not 'complex'",
}


@pytest.mark.parametrize("processes, shared", [(2, False), (1, True)])
def test_a_case_that_fails_says_why_on_any_number_of_processes(tmp_path, processes, shared):
    """In its own words, or with its exit code, and at once where one rank alone has failed and another one waits for it."""
    alone = ["raises", "is ended", "exits", "nothing", "no number"]
    ways = alone if processes == 1 else ["one rank", "wrong on one rank", "exits", "nothing"]
    runs = grid(way=ways, processes=[processes])
    rows = read(Study("failing", failing, runs, limit=25.0, shared=shared).run(tmp_path, progress=False))
    assert {row["way"]: row["verdict"] for row in rows} == {way: FAILING[way] for way in ways}
    assert not any(row["converged"] for row in rows)
    with pytest.raises(StudyError, match="a case returns a Result or a dict, and this one has returned None"):
        Study("here", failing, [{"way": "nothing"}]).run(tmp_path, progress=False, isolated=False)


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


def outputs_of(depth_mm, stiff, way):
    """Force and width of an invented indentation."""
    if way == "gives up":
        raise SystemExit("limit point: the dome snaps")
    return {"force_N": depth_mm**2 * stiff, "width_mm": 2.0 * depth_mm} if way == "good" else {"force_N": 1.0}


def test_a_case_may_give_outputs_alone(folder):
    runs = [*grid(depth_mm=[1.0, 2.0], stiff=[3.0], way=["good"]), {"depth_mm": 3.0, "stiff": 3.0, "way": "gives up"},
            {"depth_mm": 4.0, "stiff": 3.0, "way": "less"},
            {"depth_mm": float("nan"), "stiff": 3.0, "way": "good"}]  # fmt: skip
    study = Study("outputs", outputs_of, runs, shared=True, outputs=["force_N", "width_mm"])
    rows = read(study.run(folder, progress=False))
    assert [row["force_N"] for row in rows][:4] == [3.0, 12.0, "", ""] and rows[1]["width_mm"] == 4.0
    assert [row["converged"] for row in rows] == [True, True, False, False, False]
    before = (folder / "outputs.csv").read_text()
    study.run(folder, progress=False)
    assert (folder / "outputs.csv").read_text() == before
    assert failures(rows, ["depth_mm"]) == [
        "depth_mm 3: limit point: the dome snaps",
        "depth_mm 4: refused: the case gives no 'width_mm'; it gives converged, verdict, t_reached, force_N",
        "depth_mm nan: 'force_N' is not a number",
    ]
    with pytest.raises(ValueError, match="no column 'torque_Nmm'; move it away"):
        Study("outputs", outputs_of, runs, outputs=["force_N", "torque_Nmm"]).run(folder, progress=False)
    with pytest.raises(ValueError, match="'stiff' is a parameter and an output"):
        Study("clash", outputs_of, runs, outputs=["stiff"])
    with pytest.raises(StudyError, match="differ in 'way' too"):
        curves(folder / "mixed.png", rows, "depth_mm", ["force_N"])
    with pytest.raises(StudyError, match="no column 'torque_N'"):
        curves(folder / "none.png", rows, "depth_mm", ["torque_N"])
    with pytest.raises(StudyError, match="'way' is not a number"):
        curves(folder / "words.png", rows, "way", ["force_N"])


def test_a_parameter_that_a_table_lacks_is_refused_and_one_that_it_has_alone_tells_rows_apart(folder):
    """Else a run would count as done for a row that differs in that parameter only."""

    def counted(depth_mm, cells=8):
        return {"force_N": depth_mm * cells}

    def study(runs):
        return Study("fewer", counted, runs)

    def swept(runs):
        return read(study(runs).run(folder, progress=False, isolated=False))

    swept(grid(depth_mm=[1.0]))
    with pytest.raises(StudyError, match="no column 'cells'; move it away, or rename the study"):
        swept(grid(depth_mm=[1.0], cells=[16]))
    (folder / "fewer.csv").write_text((folder / "fewer.csv").read_text().splitlines()[0] + "\n")  # nor by columns alone
    with pytest.raises(StudyError, match="no column 'cells'"):
        swept(grid(depth_mm=[1.0], cells=[16]))
    (folder / "fewer.csv").write_text("")
    swept(grid(depth_mm=[1.0], cells=[16]))
    rows = swept(grid(depth_mm=[1.0]))
    assert [(row["cells"], row["force_N"]) for row in rows] == [(16, 16.0), ("", 8.0)]
    assert study(grid(depth_mm=[1.0])).mine(rows) == rows[1:]
    assert len(swept(grid(depth_mm=[1.0]))) == 2


def test_parameters_are_known_again_as_the_table_has_them(folder):
    """None, text that reads as a number and numbers of NumPy; what no run can take is refused before the first one."""

    def case_of(size, count=1):
        return {"force_N": 1.0, "processes": 1}

    def swept(runs):
        return read(Study("again", case_of, runs).run(folder, progress=False, isolated=False))

    runs = [{"size": 2.0, "processes": 1}, {"size": 2.0}]
    runs += [*grid(size=[None, "1.50", "1e5", "", True]), *grid(size=[1.0], count=np.arange(2))]
    rows = swept(runs)
    assert [row["size"] for row in rows] == [2.0, 2.0, "None", 1.5, 1e5, "", True, 1.0, 1.0]
    assert [row["processes"] for row in rows[:2]] == [1, ""] and rows == swept(runs)
    assert expand(runs[-1], {}) == runs[-1:]
    with pytest.raises(StudyError, match="cannot be run with {'sizes': 1.0}: .* 'si"):
        Study("again", case_of, grid(sizes=[1.0]))
    with pytest.raises(StudyError, match="study 'again': its case cannot be run with {'size': <class 'object'>}"):
        Study("again", case_of, grid(size=[object]))


def test_runs_with_equal_numbers_are_one(tmp_path):
    """In a chart, in a study, and with what a table has; truth is no number."""

    def study(sizes):
        return Study("equal", lambda size: {"force_N": 1.0}, grid(size=sizes))

    sizes = [1, 1.0, np.float32(1.0), True, [1, 2.0], (np.float64(1.0), 2), 1.5, np.nan]
    assert expand({"size": 1}, {"": {"": {"size": [1.0, np.int64(1), True, 2]}}}) == grid(size=[1, True, 2])
    assert [repr(run["size"]) for run in study(sizes).runs] == ["1", "True", "[1, 2.0]", "1.5", "nan"]
    for stated in (sizes, sizes[::-1]):
        rows = read(study(stated).run(tmp_path, progress=False, isolated=False))
        assert len(rows) == len(study(stated).mine(rows)) == 5


def test_all_figures_of_a_case_are_columns_of_its_table(folder):
    """Also those that its first run did not give, or that `outputs` does not name; none may take a parameter's place."""

    def figures(depth_mm):
        if depth_mm == 1.0:
            raise SystemExit("it snaps")
        return {"force_N": depth_mm, "odd": float("nan")} | ({"late_mm": 7.0} if depth_mm == 3.0 else {})

    def swept(depths):
        return read(Study("figures", figures, grid(depth_mm=depths), outputs=["force_N"]).run(folder, False, isolated=False))

    with pytest.raises(SystemExit):
        swept([1.0])
    swept([2.0])
    rows = swept([2.0, 3.0])
    assert list(rows[0])[:6] == ["depth_mm", "repeat", "force_N", "odd", "late_mm", "error"]
    assert [(row["force_N"], row["late_mm"], row["converged"]) for row in rows] == [(2.0, "", True), (3.0, 7.0, True)]
    assert curves(folder / "figures.png", rows, "depth_mm", ["late_mm", "odd"]) == []
    with pytest.raises(StudyError, match="its case gives 'depth_mm'"):
        Study("taken", lambda depth_mm: {"depth_mm": 2.0}, [{"depth_mm": 1.0}]).run(folder, progress=False, isolated=False)


def test_figures_of_metrics_stand_beside_columns_of_the_history():
    scene = Scene(Body(read_gmsh(box.build, cells=(1, 1, 1)), "box", neo_hooke(1.0, 5.0)))
    scene.fix("zmin")
    scene.prescribe("zmax", "z", -0.1)
    result = solve(scene, steps=1, out=Output(progress=False))
    row = row_of(metrics(result, mine_N=2.0), ["mine_N", "zmin_reaction_z_N"])
    assert row["mine_N"] == 2.0 and row["zmin_reaction_z_N"] == result.history[-1]["zmin_reaction_z_N"]
    assert row["iterations"] == result.verdict.iterations
    with pytest.raises(StudyError, match="the case gives no 'lid_load_N'; it gives step, t, "):
        row_of(metrics(result), ["lid_load_N"])


def invented(stiffs):
    """Rows of a sweep over depth and stiffness in which some of the deep ones failed."""
    rows = []
    for one in grid(depth_mm=[0.5, 1.0, 1.5, 2.0, 2.5], stiff_MPa=stiffs):
        number = stiffs.index(one["stiff_MPa"]) + 1.0
        good = one["depth_mm"] < 2.5 or number % 3
        end = {"converged": True, "verdict": "converged"} if good else {"converged": False, "verdict": "limit point"}
        forces = {"force_N": number * one["depth_mm"] ** 1.5, "peak_pressure_MPa": number, "width_x_mm": one["depth_mm"]}
        rows.append({**one, "repeat": 0, **(forces if good else dict.fromkeys(forces, "")), **end, "t_reached": 0.75})
    return rows


@pytest.mark.parametrize(
    ("stiffs", "panels"), [([1.0, 2.0, 3.0], 1), ([1.0 * i for i in range(1, 8)], 1), (list("abcdefg"), 2)]
)
def test_curves_of_a_sweep(folder, stiffs, panels, monkeypatch):
    """A panel for each output, at most four names beside it, all within a page's width; failures are hatched and named."""
    drawn = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *a, **k: drawn.append(figure))
    rows, outputs = invented(stiffs), ["force_N", "peak_pressure_MPa", "width_x_mm"]
    said = curves(folder / f"sweep{len(stiffs)}{panels}.png", rows, "depth_mm", outputs, by="stiff_MPa", title="A sweep")
    assert len(said) == len(stiffs) // 3 and all(
        "depth_mm 2.5" in words and "limit point at t = 0.75" in words for words in said
    )
    (figure,) = drawn
    axes = [one for one in figure.axes if one.get_ylabel() != "stiff [MPa]"]
    assert len(axes) == 3 * panels and len(figure.axes) == len(axes) + (len(stiffs) > 4 and panels == 1)
    assert axes[0].get_ylabel() == "force [N]" and axes[-1].get_xlabel() == "depth [mm]"
    assert all(len(one.get_legend().get_texts()) <= 4 + 1 for one in axes)  # and "failed"
    told = [[text.get_text() for text in one.get_legend().get_texts()] for one in axes if one.get_legend().get_visible()]
    assert told and all(one != before for one, before in zip(told[1:], told, strict=False))  # said once if the same
    assert len(stiffs) != 3 or "stiff 1 MPa" in told[0]
    first = axes[0].lines[2].get_ydata()
    np.testing.assert_allclose(first[:4], 3.0 * np.array([0.5, 1.0, 1.5, 2.0]) ** 1.5)
    assert np.isnan(first[4]) and any(patch.get_hatch() for patch in axes[0].patches)
    bands = [patch.get_window_extent().width for one in axes for patch in one.patches]
    assert np.ptp(bands) < 0.01 * max(bands)  # as wide in each panel
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert min(text.get_fontsize() for text in texts) >= 9.0 and figure.get_size_inches()[0] <= 6.3
    box, (width, height) = figure.get_tightbbox(canvas.get_renderer()), figure.get_size_inches()
    assert box.x0 > -0.01 and box.y0 > -0.01 and box.x1 < width + 0.01 and box.y1 < height + 0.01
    assert "limit point" in figure._supxlabel.get_text()


def test_rows_of_a_case_s_own_dict_do_not_know_what_a_run_took(folder):
    """Charts of iterations and of seconds say so; with metrics a case gives outputs of its own and knows them."""
    rows = [{"a": a, "b": 1.0, "converged": True, "verdict": "converged", "iterations": "", "seconds": ""} for a in (1, 2)]
    with pytest.raises(ValueError, match="do not know their iterations"):
        stability_map(folder / "map.png", rows, "a", "b")
    with pytest.raises(StudyError, match="do not know their seconds"):
        work_precision(folder / "wp.png", rows, {"a": 1}, {"p": {"c": {"a": [1, 2]}}}, parameters=["a"])


def test_the_example_of_the_documents(folder):
    """The first block of code in docs/studies.md, as a script."""
    text = (Path(__file__).parents[1] / "docs" / "studies.md").read_text()
    (folder / "example.py").write_text(text.split("```python\n")[1].split("```")[0])
    subprocess.run([sys.executable, "example.py"], cwd=folder, check=True, timeout=300.0, stderr=subprocess.DEVNULL)
    rows = read(folder / "results" / "ball.csv")
    assert len(rows) == 6 and all(row["converged"] is True for row in rows)
    smooth = [row["lid_load_N"] for row in rows if row["friction"] == 0.0]
    assert 0.0 < smooth[0] < smooth[1] < smooth[2]
    assert (folder / "results" / "ball.png").stat().st_size > 20_000


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
    front = work_precision(folder / "work.png", rows, base, panels, title="a title", parameters=["h", "way"])
    assert {row["way"] for row in front} == {"a"}
    apart = [row | {"error": float("nan"), "value": row["h"]} for row in rows]
    assert work_precision(folder / "values.png", apart, base, panels, parameters=["h", "way"]) == []
    with pytest.raises(StudyError, match="neither errors nor values"):
        work_precision(folder / "none.png", [row | {"value": float("nan")} for row in apart], base, panels)
    assert "no reference" in answer(apart, base, panels, ["h", "way"])
    many = short_panels({"many": dict.fromkeys("abcdefghi", {}), "few": {"a": {}}})
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
@pytest.mark.parametrize(
    ("stretch", "reading", "pressure"),
    [
        (1.02, "A", 0.917799e-3),
        (1.4, "A", 5.446230e-3),
        (3.0, "A", 3.585209e-3),
        (1.1, "B", 2.995435e-3),
        (3.0, "B", 2.928653e-3),
    ],
)
def test_exact_sphere(stretch, reading, pressure):
    found, _ = Radial("sphere", 5.0, reading).solve((95.0, 96.0), 95.0 * stretch)
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


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) if name == "maps" else name for name in NAMES])
def test_quick_version_of_each_study(name, tmp_path):
    """Fails where a run cannot be made, a chart not be drawn, or a slope contradicts theory."""
    assert run(name, tmp_path, tmp_path, quick=True, progress=False)
    assert list(tmp_path.glob("*.csv")) and all(p.stat().st_size > 10_000 for p in tmp_path.glob("*.png"))


def test_what_a_study_cannot_do_is_said_in_a_line(tmp_path, monkeypatch):
    """Where it has no table, contradicts theory, cannot draw without runs that failed, or cannot write."""

    def said(*words):
        monkeypatch.setattr(sys, "argv", ["studies", "sphere", "--quick", *words])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code  # a text is printed, and the exit code 1

    monkeypatch.chdir(tmp_path)
    table = Path("results/studies/sphere.csv")
    assert said("--draw") == f"sphere: {table} is not there: run the study before, without --draw"
    case = {1.0: {"value": 1.0}, 2.0: {"converged": False, "verdict": "it burst"}}.get
    monkeypatch.setattr(sphere, "studies", lambda quick: [Study("sphere", lambda h: case(h), grid(h=[1.0, 2.0]))])
    monkeypatch.setattr(sphere, "report", lambda *_: hold_slope("error", [1.0, 0.5], [1.0, 0.5], 2, 0.1))
    assert said().startswith("sphere: error: order 1.00, theory says 2")
    monkeypatch.setattr(sphere, "report", lambda rows, *_: sum(row["value"] for row in rows["sphere"]))
    assert (
        said() == f"sphere: no charts without the runs that are lost: {table}, h 2: it burst; drop such rows to repeat them"
    )
    table.unlink()
    table.mkdir()
    assert "Is a directory" in said()


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_the_race_s_scene_is_the_same_for_calculix():
    """Nodes led down: one law, one integration, one force."""
    ours, theirs = (race("parity", 4, 2, code, 1) for code in ("ours", "calculix"))
    assert ours["value"] == pytest.approx(theirs["value"], rel=1e-6) and ours["unknowns"] == theirs["unknowns"]


def test_what_a_race_says(tmp_path, monkeypatch):
    """The run of median time, ratios, and the table between its marks."""
    page = tmp_path / "speed.md"
    page.write_text("before\n" + "\n".join(mark.strip() for mark in speed.MARKS) + "\nafter\n")
    monkeypatch.setattr(speed, "PAGE", page)
    rows = [
        {"scene": "parity", "cells": 10, "layers": 5, "code": code, "ranks": ranks, "converged": True, "value": 5.0,
         "unknowns": 7938, "cpu_s": seconds, "wall_s": seconds, "machine": "some"}
        for code, ranks, times in (("ours", 1, (3.0, 1.0, 2.0)), ("ours", 2, (1.0,) * 3), ("calculix", 1, (8.0, 8.0, 4.0)))
        for seconds in times
    ]  # fmt: skip
    said = speed.report({"speed": rows}, tmp_path, False)
    assert said == ["nodes led, 20×20×5: 0.25 of CalculiX's time; 2.00 times as fast on two processes"]
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "**0.25** (5)" in text
    speed.report({"speed": rows}, tmp_path, False)
    assert page.read_text() == text


def test_a_sweep_from_no_friction_on_has_zeros_there(folder):
    def dragged(friction):
        mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1))
        scene = Scene(Body(mesh, "box", neo_hooke(mu=0.5, K=1.0)))
        scene.fix("zmin")
        lid = rigid_plane((0.0, 0.0, 1.0), normal=(0.0, 0.0, -1.0))
        scene.contact("zmax", lid, friction, name="lid")
        return solve(scene, move={lid: (0.1, 0.0, -0.1)}, steps=2, out=Output(progress=False))

    outputs = ["lid_friction_x_N", "lid_friction_work_Nmm"]
    study = Study("rough", dragged, grid(friction=[0.0, 0.1]), outputs=outputs)
    smooth, rough = read(study.run(folder, progress=False, isolated=False))
    assert [smooth[name] for name in outputs] == [0.0, 0.0] and abs(rough[outputs[0]]) > 1e-3
    with pytest.raises(StudyError, match="the case gives no 'lid_friction_N'"):
        Study("misspelt", dragged, [{"friction": 0.0}], outputs=["lid_friction_N"]).run(folder, False, isolated=False)
