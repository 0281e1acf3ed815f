"""Links of pages to files outside of docs/: to the page that has them, or to a page made of the file."""

import re
from pathlib import Path
from typing import Any

from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_for_filename
from sphinx.application import Sphinx

ROOT = Path(__file__).parent.parent.parent
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "CHANGES.md",
    "SECURITY.md": "SAFETY.md",
    "benchmarks/RESULTS.md": "PERFORMANCE.md",
}
"""what stands elsewhere and is a page of the site"""
_wanted: set[str] = set()


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", _lead_to_pages, priority=900)  # once pages are whole
    app.connect("build-finished", _write_sources)
    return {"parallel_read_safe": False, "parallel_write_safe": True}


def within(folder: str, text: str) -> str:
    """Return a text from a folder of the repository, with its links as from docs/."""
    return re.sub(r"\]\((?!\w+:|#)([^)]+)\)", lambda link: f"]({_from_docs(folder, link[1])})", text)


def _from_docs(folder: str, link: str) -> str:
    return f"../{folder}{link}" if not link.startswith("docs/") else link.removeprefix("docs/")


def _lead_to_pages(app: Sphinx, name: str, text: list[str]) -> None:
    text[0] = re.sub(r"\]\(examples/(\w+)\.py\)", r"](example_pages/\1.md)", text[0])
    text[0] = re.sub(r"\]\(notebooks/(\w+)\.ipynb\)", r"](notebook_pages/\1.md)", text[0])
    if "/" in name:  # its links to files go up one folder more
        text[0] = text[0].replace("](../../", "](../")
    up = "../" * ("/" in name)
    text[0] = re.sub(r"\]\(\.\./([^)#]+)(#[^)]*)?\)", lambda link: f"]({_target(link[1], up)}{link[2] or ''})", text[0])


def _target(path: str, up: str) -> str:
    """Say where a link leads from a page.

    Args:
        up: to docs/ from where the page stands.
    """
    if path in PAGES:
        return up + PAGES[path]
    file = ROOT / path
    if file.is_dir():
        file = file / "__init__.py"
    if not file.is_file():
        return f"../{path}"  # Sphinx says that it leads nowhere
    name = file.resolve().relative_to(ROOT).as_posix()
    if name.startswith("docs/") and name.endswith(".md"):
        return up + name.removeprefix("docs/")
    _wanted.add(name)
    return f"{'above-' if up else ''}source:{name}"


def _write_sources(app: Sphinx, failed: Exception | None) -> None:
    """Write a page of each file that a link leads to, its lines numbered."""
    for name in sorted(_wanted) if failed is None else ():
        page = Path(app.outdir) / "source" / f"{name}.html"
        page.parent.mkdir(parents=True, exist_ok=True)
        code = (ROOT / name).read_text(encoding="utf-8")
        style = HtmlFormatter(full=True, title=name, linenos="inline", lineanchors="L")
        page.write_text(highlight(code, get_lexer_for_filename(name), style), encoding="utf-8")
