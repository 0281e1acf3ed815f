"""Configuration of Sphinx, which makes the site of these pages.

Build it by sphinx-build -W docs build/site.

Nothing is fetched while it is built, nor while it is read: the theme has no fonts or scripts of others, and formulas
are MathML, which browsers set themselves.
"""

import os
import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "Balloon Warp"
release = metadata.version("balloon-warp")
version = release.partition("+")[0]  # without the commit
copyright = "the contributors of Balloon Warp, Apache-2.0"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "building.formulas",
    "building.examples",
    "building.notebooks",
    "building.pages",
    "building.sources",
    "building.docstrings",
]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["building", "container", "examples", "notebooks", "paper"]
html_extra_path = ["llms.txt"]
html_static_path = ["building/static"]
html_css_files = ["site.css"]
html_theme = "furo"
html_title = f"Balloon Warp {version}"
html_math_renderer = "mathml"
html_copy_source = False
html_context = {"versions": os.environ.get("DOCS_VERSIONS", "").split()}
html_sidebars = {
    "**": [
        *("sidebar/brand.html", "sidebar/search.html", "sidebar/scroll-start.html", "sidebar/navigation.html"),
        *("versions.html", "sidebar/scroll-end.html"),
    ]
}
html_show_sourcelink = False
templates_path = ["building/templates"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_url_schemes = {
    "http": None,
    "https": None,
    "source": "source/{{path}}.html",
    "above-source": "../source/{{path}}.html",
}

default_role = "code"
nitpicky = False
autodoc_preserve_defaults = True
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
suppress_warnings = ["myst.header"]
