"""The documents: their links lead somewhere, the README stays short and its scene runs, the package says what it is."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import fenics_contact
from fenics_contact import __main__ as itself
from fenics_contact import __version__, studies
from fenics_contact.assembly import finding

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        assert "://" in target or (page.parent / target).exists(), target


def test_every_kind_of_verdict_has_its_section():
    kinds = {value for name, value in vars(finding).items() if name.isupper() and isinstance(value, str)}
    text = (ROOT / "docs" / "when_a_run_fails.md").read_text()
    sections = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", text, re.M | re.S))
    assert finding.LIMIT_POINT in kinds and set(sections) == kinds
    assert [kind for kind, words in sections.items() if "](pictures/fails_" not in words] == [finding.CONVERGED]


def test_every_page_is_in_the_contents():
    """Of the front page, or of the index of its folder."""
    listed = {
        (page.parent / name).relative_to(DOCS)
        for page in PAGES[1:]
        for tree in re.findall(r"^```{toctree}\n(.*?)^```", page.read_text(), re.M | re.S)
        for name in re.findall(r"^([\w/]+)$", tree, re.M)
    }
    pages = {page.relative_to(DOCS).with_suffix("") for page in [*PAGES[1:], *DOCS.glob("*.rst")]}
    assert pages - {Path("index")} == listed


def test_every_demo_is_in_the_gallery():
    text = (DOCS / "gallery.md").read_text()
    demos = {path.stem for path in (ROOT / "demos").glob("*.py")}
    assert set(re.findall(r"`demos/(\w+)\.py`", text)) == demos
    assert set(re.findall(r"demo_(\w+)\.png", text)) == demos


def test_benchmarks_name_what_computes_them():
    rows = re.findall(r"^\|.*\| (.*) \|$", (DOCS / "benchmarks.md").read_text(), re.M)
    cases = [row for row in rows if row not in ("computed by", "---")]
    assert len(cases) > 25
    for named in cases:
        files = re.findall(r"`([\w/]+\.py)`", named)
        assert files or "](" in named, named
        assert all((ROOT / file).exists() for file in files), named


def test_the_picture_of_the_rooms_is_that_of_their_table():
    spec = importlib.util.spec_from_file_location("house", DOCS / "house.py")
    house = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(house)
    assert house.PICTURE.read_text() == house.picture(), "python3 docs/house.py"


def test_pictures_are_small_and_shown():
    text = "".join(page.read_text() for page in PAGES)
    for picture in (DOCS / "pictures").iterdir():
        assert picture.stat().st_size < 100_000 and picture.name in text, picture


def test_the_reference_has_what_is_offered():
    text = (DOCS / "reference.rst").read_text()
    offered, studied = text.split(".. currentmodule:: fenics_contact.studies")
    named = r"^\.\. auto(?:function|class|exception):: (\w+)$"
    assert set(re.findall(named, offered, re.M)) == set(fenics_contact.__all__)
    assert set(re.findall(named, studied, re.M)) == set(studies.__all__)


def test_the_readme_is_short_and_its_scene_runs(tmp_path):
    """As it stands, on fewer cells."""
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120
    script = text.split("```python\n")[1].split("```")[0]
    assert "inside=12, outside=10" in script and "steps=10" in script
    script = script.replace("inside=12, outside=10", "inside=4, outside=3").replace("steps=10", "steps=2")
    (tmp_path / "scene.py").write_text(f"import sys\nsys.path.insert(0, {str(ROOT)!r})\n{script}")
    run = subprocess.run([sys.executable, "scene.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300.0)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("converged [-0.75 -1.5 ]")
    assert (tmp_path / "pressure.png").stat().st_size > 20_000
    assert {"history.csv", "summary.json", "results.pvd"} <= {
        path.name for path in (tmp_path / "results" / "punch").iterdir()
    }


def test_the_package_checks_its_installation(capsys):
    itself.main()
    said = capsys.readouterr().out
    assert f"fenics_contact {__version__}: dolfinx" in said and "forces are in balance and all tangents are right" in said
    assert len(re.findall(r"^  python3 -m fenics_contact \w+ +\S", said, re.M)) == len(list((ROOT / "demos").glob("*.py")))


def test_help_names_the_demos(capsys):
    itself.main("--help")
    said = capsys.readouterr().out
    assert "compiles ahead" in said and len(re.findall(r"^  python3 -m fenics_contact \w+ +\S", said, re.M)) == len(
        itself.demos()
    )


def test_what_is_out_of_balance_is_told(monkeypatch):
    monkeypatch.setattr(itself, "SHUT", -1.0)
    with pytest.raises(SystemExit, match="something is wrong: the plate presses with .* N"):
        itself.check()


def test_an_unknown_demo_is_named():
    with pytest.raises(SystemExit, match="no demo 'punch'; there are: .*punch_on_plate"):
        itself.main("punch")
