"""Parts of pages that are made of the code, or that stand elsewhere in the repository."""

from collections.abc import Callable
from dataclasses import is_dataclass
from types import ModuleType
from typing import Any

from sphinx.application import Sphinx

import balloon_warp as bw
from building.commands import command_reference
from building.examples import cards
from building.sources import ROOT, within

INSTEAD = "<!-- instead, on the site -->"


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", _add)
    return {"parallel_read_safe": False, "parallel_write_safe": True}


def _add(app: Sphinx, name: str, text: list[str]) -> None:
    """Add text at the page's end, or in place of everything below the mark."""
    if name in ADDED:
        text[0] = f"{text[0].partition(INSTEAD)[0]}\n\n{ADDED[name]()}\n"


def _file(path: str) -> str:
    """Return a file of Markdown, without its title."""
    folder = path.rpartition("/")[0]
    text = (ROOT / path).read_text(encoding="utf-8").partition("\n")[2]
    return within(f"{folder}/" if folder else "", text)


def _python_names() -> str:
    """Every public name with its docstring."""
    parts = []
    for name in bw.__all__:
        found = getattr(bw, name)
        parts.append(f"## {name}\n\n```{{eval-rst}}\n{_directive(name, found)}\n```")
    return "\n\n".join(parts)


def _directive(name: str, found: object) -> str:
    if isinstance(found, ModuleType):
        return f".. automodule:: {found.__name__}\n   :members:"
    if not isinstance(found, type):
        return f".. autofunction:: balloon_warp.{name}"
    if hasattr(found, "model_fields"):  # its fields stand in SCENE.md
        return f".. autoclass:: balloon_warp.{name}\n   :exclude-members: __init__, __new__"
    if issubclass(found, BaseException):  # members of all exceptions are Python's
        return f".. autoexception:: balloon_warp.{name}\n   :exclude-members: __init__, __new__"
    excluded = "\n   :exclude-members: __init__" if is_dataclass(found) else ""
    return f".. autoclass:: balloon_warp.{name}\n   :members:\n   :inherited-members: object{excluded}"


ADDED: dict[str, Callable[[], str]] = {
    "COMMANDS": command_reference,
    "API": _python_names,
    "EXAMPLES": cards,
    "PERFORMANCE": lambda: _file("benchmarks/RESULTS.md"),
    "CHANGES": lambda: _file("CHANGELOG.md"),
    "SAFETY": lambda: _file("SECURITY.md"),
}
