"""Runs the code of the pages of the documents: `python3 docs/pages.py [NAME ...]` draws their pictures anew.

Those are the front page, the lessons of the tutorial and the how-to pages. The blocks marked `python` of a page are one
script, in their order. Blocks marked `py` need packages that may not be installed, and are shown only. `pictures/NAME.png`
of a page is the file NAME.png that its script writes.
"""

import contextlib
import re
import runpy
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
PICTURES = DOCS / "pictures"
WIDTH, COLOURS = 850, 192  # of committed pictures: pixels, and colours of their palette


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


def keep(source, name):
    """A picture for the documents, small enough to be committed."""
    with Image.open(source) as picture:
        flat = Image.new("RGB", picture.size, "white")
        flat.paste(picture, mask=picture.getchannel("A") if picture.mode == "RGBA" else None)
    flat.thumbnail((WIDTH, 2 * WIDTH), Image.LANCZOS)
    flat.quantize(COLOURS, dither=Image.Dither.NONE).save(PICTURES / name, optimize=True)


def main(names):
    for page in pages():
        if not names or page.stem in names:
            with tempfile.TemporaryDirectory() as folder:
                run(page, folder)
                for name in pictures(page):
                    keep(Path(folder) / name, name)


if __name__ == "__main__":
    main(sys.argv[1:])
