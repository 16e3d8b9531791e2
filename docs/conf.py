"""Sphinx: `make docs` builds these pages and the reference from the docstrings, without a network."""

import inspect
import re
import shutil
from pathlib import Path

import fenics_contact

project, release, author = "fenics_contact", fenics_contact.__version__, "the fenics_contact team"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build"]
default_role = "literal"  # of `words` in docstrings
html_theme = "furo"
html_title = f"{project} {release}"
html_copy_source = False
myst_heading_anchors = 3
myst_enable_extensions = ["amsmath", "dollarmath"]
autodoc_typehints = "none"  # the docstrings say what an argument is, with shape and unit
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True

# Debian's MathJax, as much of it as draws TeX as SVG, goes into the pages: formulas need no network
MATHJAX = Path("/usr/share/javascript/mathjax")
NEEDED = (
    "MathJax.js",
    "config/TeX-AMS_SVG.js",
    "extensions",
    "jax/element",
    "jax/input/TeX",
    "jax/output/SVG/autoload",
    "jax/output/SVG/config.js",
    "jax/output/SVG/jax.js",
    "jax/output/SVG/fonts/TeX",
)
mathjax_path = "mathjax/MathJax.js?config=TeX-AMS_SVG"
mathjax2_config = {"messageStyle": "none"}
myst_update_mathjax = False  # it would write the settings of MathJax 3


def copy_mathjax(app, exception):
    if exception is None and app.builder.format == "html":
        for part in NEEDED:
            source, target = MATHJAX / part, Path(app.outdir) / "_static" / "mathjax" / part
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, target, dirs_exist_ok=True)
            else:
                shutil.copy(source, target)


def list_arguments(app, what, name, thing, options, lines):
    """A docstring's `this: what it is; that: what it is` becomes a list, a line for each argument."""
    if what not in ("function", "method", "class"):
        return
    one = "|".join(map(re.escape, inspect.signature(thing).parameters))
    if not one:
        return
    names = rf"`?(?:{one})`?(?: [(\[][\w, /^]*[)\]])?"  # with a shape or a unit
    start = re.compile(rf"(?:(?<=; )|(?<=\. )|^)({names}(?:, {names})*): ")
    told = []
    for paragraph in re.split(r"\n\s*\n", "\n".join(lines)):
        words = " ".join(paragraph.split())
        found = list(start.finditer(words))
        if not found or re.search(r"^\s*[*-] |::", paragraph, re.M):
            told += [paragraph, ""]
            continue
        told += [words[: found[0].start()].strip().rstrip(";"), ""]
        for one, after in zip(found, [*found[1:], None], strict=True):
            text = words[one.end() : after.start() if after else None].strip().rstrip(";")
            text, *more = re.split(r"(?<=\. )(?=Raises |Collective|A Figure|[A-Z]\w+Error\b)", text, maxsplit=1)
            told.append(f"* **{one[1].replace('`', '')}**: {text}")
        told += ["", *more, ""]
    lines[:] = "\n".join(told).split("\n")


def setup(app):
    app.connect("build-finished", copy_mathjax)
    app.connect("autodoc-process-docstring", list_arguments)
