"""Docstrings as reStructuredText: what they say in plain text is kept from meaning something to it."""

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

SHORT = (
    (r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+)\]\]", r"NDArray[\1]"),
    (r"_Buffer \| _SupportsArray.*?_NestedSequence\[complex \| bytes \| str\]", "ArrayLike"),
    ("_ScalarT", "Any"),
)
"""what types of arrays are called where they are written, by what Python calls them"""
_properties: dict[str, list[str]] = {}
"""lines by name: napoleon takes what comes before a colon for a type"""


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", _escape, priority=100)  # before napoleon
    app.connect("autodoc-process-docstring", _restore, priority=900)
    app.connect("doctree-read", _shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _escape(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """|d| is no substitution, and * multiplies. Fields of a class have a place of their own."""
    if what == "class" and "Fields:" in lines:
        del lines[lines.index("Fields:") :]
    lines[:] = [line if "`" in line else re.sub(r"([|*])", r"\\\1", line) for line in lines]
    if what in ("property", "attribute"):
        _properties[name] = list(lines)


def _restore(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    lines[:] = _properties.pop(name, lines)


def _shorten(app: Sphinx, doctree: nodes.document) -> None:
    """Types of arrays, in attributes and in lists of parameters."""
    for annotation in doctree.findall(addnodes.desc_annotation):
        _rename(annotation, list(annotation.children))
    for paragraph in doctree.findall(nodes.paragraph):
        texts = [child.astext() for child in paragraph.children]
        if " (" in texts and ")" in texts:  # name (type) -- meaning
            _rename(paragraph, paragraph.children[texts.index(" (") + 1 : texts.index(")")])


def _rename(parent: nodes.Element, parts: list[nodes.Node]) -> None:
    """Put one text in place of several nodes where it is a shorter one."""
    long = short = "".join(part.astext() for part in parts)
    for pattern, word in SHORT:
        short = re.sub(pattern, word, short)
    if short != long:
        parent.insert(parent.index(parts[0]), nodes.Text(short))
        for part in parts:
            parent.remove(part)
