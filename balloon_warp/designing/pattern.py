"""Patterns to cut: the outline of a foil balloon as a drawing, and as a picture beside the inflated outline."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from balloon_warp.files import whole_file
from balloon_warp.foil.outlines import from_extra

Values = NDArray[np.float64]
Loops = Sequence[Sequence[NDArray[np.int64]]]
"""Vertices of each loop, of each part"""
SEAM = 0.008
"""Allowance beyond the seam [m]"""
MARGIN = 0.01
"""Margin of the page [m]"""
PIXELS, GAP, ROW = 920, 36, 30
"""Width of a picture, margin around it, and height of a row of its legend [pixels]"""
FINER = 4
"""Factor by which a picture is drawn larger, so that its lines are smooth"""
COLORS = {
    "wanted": (214, 222, 230),
    "without design": (224, 122, 66),
    "inflated": (26, 84, 160),
    "pattern": (70, 74, 80),
}
WIDTHS = {"without design": 2.2, "inflated": 3.2, "pattern": 1.3}
"""Width of lines [pixels]; what has none is an area"""
NAMES = {"inflated": "designed, inflated", "pattern": "pattern, flat", "without design": "without design, inflated"}


def write_pattern(path: Path, rims: Sequence[Values], loops: Loops) -> None:
    """Write the seam and, outside it, the line to cut along, in millimeters, twice to be cut and sewn.

    Args:
        rims: of each part [m], its loops one after the other, shape (r, 2).
    """
    shapely = from_extra("shapely")
    lines: list[tuple[str, Values]] = []
    for rim, of_part in zip(_apart(rims), loops, strict=True):
        outer, *holes = _split(rim, of_part)
        lines += [("seam", line) for line in (outer, *holes)]
        cut = shapely.Polygon(outer, holes).buffer(SEAM)
        for polygon in getattr(cut, "geoms", [cut]):
            lines += [("cut", np.asarray(line.coords)[:-1, :2]) for line in (polygon.exterior, *polygon.interiors)]
    low, high = _bounds([line for _, line in lines])
    width, height = 1000.0 * (high - low + 2.0 * MARGIN)
    placed = ((kind, 1000.0 * (line - low + MARGIN) * [1.0, -1.0] + [0.0, height]) for kind, line in lines)
    drawn = "\n".join(_path(kind, line) for kind, line in placed)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
    text = f'{head}viewBox="0 0 {width:.2f} {height:.2f}">\n{drawn}\n</svg>\n'
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def outline_picture(lines: Mapping[str, Sequence[Values]], loops: Loops, got: str) -> Image.Image:
    """Draw rims over each other, by name, those of each part apart from the next one's.

    Args:
        got: stands beside the name of the inflated rims.
    """
    lines = _beside(lines)
    low, high = _bounds([rim for rims in lines.values() for rim in rims])
    scale = FINER * PIXELS / float(high[0] - low[0])
    width, height = (scale * (high - low)).astype(int) + 2 * FINER * GAP
    image = Image.new("RGB", (width, height + FINER * (ROW * len(lines) + GAP // 2)), (255, 255, 255))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(18 * FINER)
    for row, (name, rims) in enumerate(lines.items()):
        color, thick = COLORS[name], round(FINER * WIDTHS.get(name, 0))
        for rim, of_part in zip(rims, loops, strict=True):
            for number, line in enumerate(_split(rim, of_part)):
                places = (scale * (line - low) * [1.0, -1.0] + [FINER * GAP, height - FINER * GAP]).tolist()
                corners = [tuple(place) for place in (*places, *places[:2])]
                if thick:
                    draw.line(corners, color, thick, joint="curve")
                else:
                    draw.polygon(corners, (255, 255, 255) if number else color)
        told = f"{NAMES.get(name, name)}: {got}" if name == "inflated" else NAMES.get(name, name)
        left, middle = FINER * GAP, height + FINER * ROW * (row + 0.5)
        half = 0.5 * (thick or 14 * FINER)
        draw.rectangle((left, middle - half, left + 34 * FINER, middle + half), color)
        draw.text((left + 48 * FINER, middle), told, (40, 40, 40), font, anchor="lm")
    return image.resize((image.width // FINER, image.height // FINER), Image.Resampling.LANCZOS)


def _beside(lines: Mapping[str, Sequence[Values]]) -> dict[str, list[Values]]:
    """Return the rims of all names with each part to the right of all rims of the part before."""
    moved: dict[str, list[Values]] = {name: [] for name in lines}
    right, gap = -np.inf, SEAM
    for rims in zip(*lines.values(), strict=True):
        low, high = _bounds(rims)
        shift = [max(0.0, right + gap - float(low[0])), 0.0]
        for name, rim in zip(lines, rims, strict=True):
            moved[name].append(rim + shift)
        right = float(high[0]) + shift[0]
    return moved


def _apart(rims: Sequence[Values]) -> list[Values]:
    """Return the parts side by side, so far apart that the lines to cut along do not meet."""
    placed, right = [], -np.inf
    for rim in rims:
        shift = max(0.0, right + 2.0 * SEAM + MARGIN - float(rim[:, 0].min()))
        placed.append(rim + np.array([shift, 0.0]))
        right = float(placed[-1][:, 0].max())
    return placed


def _split(rim: Values, loops: Sequence[NDArray[Any]]) -> list[Values]:
    """Return a part's loops, the longest first."""
    lines = np.split(rim, np.cumsum([len(loop) for loop in loops])[:-1])
    return sorted(lines, key=lambda line: -float(np.ptp(line, axis=0).sum()))


def _bounds(lines: Sequence[Values]) -> tuple[Values, Values]:
    points = np.concatenate(lines)
    return points.min(axis=0), points.max(axis=0)


def _path(kind: str, line: Values) -> str:
    places = " ".join(f"{x:.3f},{y:.3f}" for x, y in line.tolist())
    dashes = ' stroke-dasharray="3 2"' if kind == "seam" else ""
    return f'<polygon class="{kind}" points="{places}" fill="none" stroke="black" stroke-width="0.3"{dashes}/>'
