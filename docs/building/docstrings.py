"""Docstrings as reStructuredText: what they say in plain text is kept from meaning something to it."""

import re
from typing import Any

from sphinx.application import Sphinx

_properties: dict[str, list[str]] = {}
"""lines by name: napoleon takes what comes before a colon for a type"""


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", _escape, priority=100)  # before napoleon
    app.connect("autodoc-process-docstring", _restore, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _escape(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """|d| is no substitution, and * multiplies."""
    lines[:] = [line if "`" in line else re.sub(r"([|*])", r"\\\1", line) for line in lines]
    if what in ("property", "attribute"):
        _properties[name] = list(lines)


def _restore(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    lines[:] = _properties.pop(name, lines)
