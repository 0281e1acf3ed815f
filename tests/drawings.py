"""SVG files."""

from pathlib import Path


def drawing(folder: Path, content: str, attributes: str = "") -> Path:
    path = folder / "drawing.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100" {attributes}>{content}</svg>')
    return path
