"""Pages of the programs in docs/examples: text, picture, code, and the cards that lead to them."""

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from building.sources import ROOT
from building.written_pages import write_pages

PROGRAMS = ROOT / "docs" / "examples"
FOLDER = "example_pages"
"""Folder in docs/ of the pages"""


@dataclass(frozen=True)
class Example:
    """Example program, as its docstring describes it."""

    file: Path
    title: str
    text: str
    code: str

    @property
    def page(self) -> str:
        return f"{FOLDER}/{self.file.stem}.md"

    @property
    def picture(self) -> str | None:
        """Path of the picture that the example draws, from docs/."""
        path = f"pictures/example_{self.file.stem}.png"
        return path if (ROOT / "docs" / path).exists() else None


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", _write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def examples() -> list[Example]:
    return [_read(file) for file in sorted(PROGRAMS.glob("[0-9]*.py"))]


def cards() -> str:
    """Return cards of the examples, each with picture and title, and their entries in the site's contents."""
    shown = [f"```{{container}} card\n{_image(each)}[{each.title}]({each.page})\n```" for each in examples()]
    listed = "\n".join(each.page for each in examples())
    grid = "````{container} cards\n" + "\n\n".join(shown) + "\n````"
    return f"{grid}\n\n```{{toctree}}\n:hidden:\n\n{listed}\n```"


def _read(file: Path) -> Example:
    source = file.read_text(encoding="utf-8")
    module = ast.parse(source)
    first, _, rest = (ast.get_docstring(module) or "").partition("\n")
    title, _, about = first.rstrip(".").partition(": ")
    text = f"{about[:1].upper()}{about[1:]}.\n\n{rest.strip()}" if about else rest.strip()
    lines = source.splitlines(keepends=True)
    return Example(file, title, text, "".join(lines[module.body[0].end_lineno :]).lstrip("\n"))


def _image(example: Example) -> str:
    return f"[![{example.title}]({example.picture})]({example.page})\n\n" if example.picture else ""


def _page(example: Example) -> str:
    parts = [f"# {example.title}", example.text]
    if example.picture:
        parts.append(f"![What it draws](../{example.picture})")
    parts.append(f"```python\n{example.code}```")
    path = f"docs/examples/{example.file.name}"
    parts.append(f"It stands in [{path}](../../{path}). Run it with `python {path}`.")
    return "\n\n".join(parts) + "\n"


def _write_pages(app: Sphinx) -> None:
    write_pages(app, FOLDER, {f"{each.file.stem}.md": _page(each) for each in examples()})
