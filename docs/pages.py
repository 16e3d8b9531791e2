"""Runs the code of the pages of the documents: `python3 docs/pages.py [NAME ...]` draws their pictures anew.
`python3 docs/pages.py gallery [DEMO ...]` runs demos in full, a few minutes, and draws those of the gallery;
`python3 docs/pages.py failures` draws those of when_a_run_fails.md.

Those are the front page, the lessons of the tutorial and the how-to pages. The blocks marked `python` of a page are one
script, in their order. Blocks marked `py` need packages that may not be installed, and are shown only. `pictures/NAME.png`
of a page is the file NAME.png that its script writes.
"""

import contextlib
import importlib
import re
import resource
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
PICTURES = DOCS / "pictures"
WIDTH, COLOURS, LARGEST = 850, 256, 100_000  # of committed pictures: pixels, colours of their palette, bytes


def script(page):
    """The code of a page, "" where it has none."""
    return "\n\n".join(re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S))


def pages():
    """The pages with code."""
    places = [DOCS / "index.md", *sorted((DOCS / "tutorial").glob("*.md")), *sorted((DOCS / "howto").glob("*.md"))]
    return [page for page in places if script(page)]


def pictures(page):
    """Names of the pictures that a page shows and its script writes."""
    shown = re.findall(r"\]\((?:\.\./)?pictures/(\w+\.png)\)", page.read_text())
    return [name for name in shown if f'"{name}"' in script(page)]


def run(page, folder):
    """A page's script, as its reader would run it in an empty folder."""
    file = Path(folder) / f"{page.stem}.py"
    file.write_text(script(page))
    with contextlib.chdir(folder):
        runpy.run_path(str(file), run_name="__main__")


def keep(source, name, width=WIDTH):
    """A picture for the documents, small enough to be committed."""
    with Image.open(source) as picture:
        flat = Image.new("RGB", picture.size, "white")
        flat.paste(picture, mask=picture.getchannel("A") if picture.mode == "RGBA" else None)
    while True:
        flat.thumbnail((width, 2 * width), Image.LANCZOS)
        flat.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE).save(
            PICTURES / name, optimize=True
        )
        if (PICTURES / name).stat().st_size < LARGEST:
            return
        width = int(0.9 * width)


def demos():
    """{demo: its picture among its results} of those that the gallery shows."""
    names = sorted(path.stem for path in (DOCS.parent / "demos").glob("*.py"))
    return {name: f"{name}.png" for name in names} | {"punch_on_plate": "deformed_quarters.png"}


def draw_gallery(names):
    """Run demos in full, keep their pictures, print the CPU seconds that they took."""
    for name, picture in demos().items():
        if not names or name in names:
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            with tempfile.TemporaryDirectory() as folder:
                subprocess.run([sys.executable, DOCS.parent / "demos" / f"{name}.py"], cwd=folder, check=True)
                keep(Path(folder) / "results" / name / picture, f"demo_{name}.png")
            print(f"{name}: {resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before:.0f} s of CPU")


# kind of verdict: a scene of tests/test_verdicts.py that ends so, where it is seen from, and what is drawn
FAILURES = {
    "element inverted": ("pad", None, "J"),
    "limit point": ("blade", (-15, -60)),
    "rigid-body motion": ("drawn off", None),
    "friction used up": ("too great a push", None),
    "status cycling": ("stumbling", (-15, -60)),
    "penalty too soft": ("soft", None),
    "projection lost": ("edge", "y"),
    "no convergence": ("long steps", (-15, -60)),
}


def draw_failures():
    """The last accepted states of scenes that fail, for when_a_run_fails.md."""
    sys.path.insert(0, str(DOCS.parent / "tests"))
    catalogue = importlib.import_module("test_verdicts")
    for kind, (scene, view, *field) in FAILURES.items():
        with tempfile.TemporaryDirectory() as folder:
            result = catalogue.failed(scene)
            assert result.verdict.kind == kind, result.verdict.reason
            result.plot(*(field or ["contact_pressure"]), Path(folder) / "picture.png", view=view)
            print(f"{kind}: {result.verdict.reason}")
            keep(Path(folder) / "picture.png", failure(kind), 560)
    for draw in importlib.import_module("failures").DRAWN:
        with tempfile.TemporaryDirectory() as folder:
            keep(Path(folder) / "picture.png", failure(draw(Path(folder) / "picture.png")), 560)


def failure(kind):
    """Name of the picture of a kind of verdict."""
    return f"fails_{re.sub('[ -]', '_', kind)}.png"


def main(names):
    if names[:1] == ["gallery"]:
        return draw_gallery(names[1:])
    if names == ["failures"]:
        return draw_failures()
    for page in pages():
        if not names or page.stem in names:
            with tempfile.TemporaryDirectory() as folder:
                run(page, folder)
                for name in pictures(page):
                    keep(Path(folder) / name, name)


if __name__ == "__main__":
    main(sys.argv[1:])
