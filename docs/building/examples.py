"""A page of each program in docs/examples: its text, its picture, its code. And the cards that lead to them."""

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from building.sources import ROOT

PROGRAMS = ROOT / "docs" / "examples"
FOLDER = "example_pages"
"""in docs/, made anew by each build and no part of the repository"""


@dataclass(frozen=True)
class Example:
    """One program, by what its docstring says of it."""

    file: Path
    title: str
    text: str
    code: str

    @property
    def page(self) -> str:
        return f"{FOLDER}/{self.file.stem}.md"

    @property
    def picture(self) -> str | None:
        """What it draws, from docs/."""
        path = f"pictures/example_{self.file.stem}.png"
        return path if (ROOT / "docs" / path).exists() else None


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", _write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def examples() -> list[Example]:
    return [_read(file) for file in sorted(PROGRAMS.glob("[0-9]*.py"))]


def cards() -> str:
    """All of them, each with its picture and its title, and what the site's contents have of them."""
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
    """Files that are as they should be are left alone: Sphinx then reads nothing twice."""
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(exist_ok=True)
    pages = {f"{each.file.stem}.md": _page(each) for each in examples()}
    for old in folder.glob("*.md"):
        if old.name not in pages:
            old.unlink()
    for name, text in pages.items():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")
