"""A page of each notebook in docs/notebooks, written from its cells, without outputs."""

import json
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from building.sources import ROOT
from building.written_pages import write_pages

NOTEBOOKS = ROOT / "docs" / "notebooks"
FOLDER = "notebook_pages"
"""Folder in docs/ of the pages"""


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", _write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def as_markdown(notebook: Path) -> str:
    """Return the cells of a notebook as a page, with a link to the notebook itself."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    parts = [_part(cell["cell_type"], "".join(cell["source"])) for cell in cells]
    parts.insert(1, f"This page is the notebook [{notebook.name}](../notebooks/{notebook.name}). Jupyter runs it.")
    return "\n\n".join(parts) + "\n"


def _part(kind: str, text: str) -> str:
    return f"```python\n{text}\n```" if kind == "code" else text


def _write_pages(app: Sphinx) -> None:
    write_pages(app, FOLDER, {f"{each.stem}.md": as_markdown(each) for each in sorted(NOTEBOOKS.glob("*.ipynb"))})
