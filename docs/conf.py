"""Sphinx: `make docs` builds these pages and the reference from the docstrings, without a network."""

import fenics_contact

project, release, author = "fenics_contact", fenics_contact.__version__, "the fenics_contact team"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"{project} {release}"
html_copy_source = False
myst_heading_anchors = 3
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
