"""Pages that each build writes anew into a folder of docs/, and that are no part of the repository."""

from collections.abc import Mapping
from pathlib import Path

from sphinx.application import Sphinx


def write_pages(app: Sphinx, folder: str, pages: Mapping[str, str]) -> None:
    """Write the pages that changed, by file name, and remove all others: Sphinx then reads nothing twice."""
    there = Path(app.srcdir) / folder
    there.mkdir(exist_ok=True)
    for old in there.glob("*.md"):
        if old.name not in pages:
            old.unlink()
    for name, text in pages.items():
        page = there / name
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
