"""The code of the pages runs as it stands there, asserts what they say and draws what they show."""

import importlib.util
from pathlib import Path

import pytest

pytestmark = pytest.mark.serial

SPEC = importlib.util.spec_from_file_location("pages", Path(__file__).parents[1] / "docs" / "pages.py")
pages = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(pages)


@pytest.mark.parametrize("page", pages.pages(), ids=lambda page: page.stem)
def test_the_code_of_a_page_runs(page, tmp_path):
    pages.run(page, tmp_path)
    for name in pages.pictures(page):
        assert (tmp_path / name).stat().st_size > 10_000, name


def test_lessons_show_and_assert_something():
    lessons = [page for page in pages.pages() if page.parent.name == "tutorial"]
    assert len(lessons) == 5
    for lesson in lessons:
        assert pages.pictures(lesson) and "\nassert " in pages.script(lesson), lesson.name
