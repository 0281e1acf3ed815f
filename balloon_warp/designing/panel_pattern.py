"""The pattern of panels: seams, the line to cut along, and numbered marks that meet when they are sewn."""

from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from balloon_warp.designing.panels import Panels
from balloon_warp.designing.pattern import MARGIN, SEAM
from balloon_warp.designing.seam_lines import seam_lines
from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.foil.outlines import from_extra

Values = NDArray[np.float64]
SPACING = 0.06
"""Distance between marks along a seam [m]"""
LETTERS, NAMES = 0.005, 0.014
"""Height of the marks' numbers and of the panels' [m]"""
PIXELS = 1500
LOOKS = {"seam": (30, 90, 170), "cut": (40, 40, 40), "mark": (190, 70, 40), "panel": (120, 120, 120)}


@dataclass(frozen=True)
class Line:
    """Drawn line of a pattern."""

    kind: str
    places: Values
    """Places, shape (k, 2)"""
    closed: bool = True


@dataclass(frozen=True)
class Label:
    """Text at a place."""

    kind: str
    place: Values
    text: str
    height: float


@dataclass(frozen=True)
class PanelPattern:
    """Pattern of flat panels."""

    panels: Panels
    flat: Values
    """Flat places, laid out [m], shape (m, 2)"""

    @cached_property
    def drawn(self) -> tuple[list[Line], list[Label]]:
        """Lines and labels, in meters.

        Raises:
            InputError: a panel lies on itself.
        """
        lines, labels = [], []
        for number, border in enumerate(self.panels.borders, start=1):
            outline = require_simple(number, self.flat[border])
            lines.append(Line("seam", self.flat[border]))
            lines.append(Line("cut", np.asarray(outline.buffer(SEAM).exterior.coords)[:-1]))
            middle = np.array(outline.representative_point().coords[0])
            labels.append(Label("panel", middle, str(number), NAMES))
        for number, seam in enumerate(seam_lines(self.panels), start=1):
            places, out = seam.marks(self.flat, SPACING)
            for side in range(2):
                for mark, (place, way) in enumerate(zip(places[side], out[side], strict=True), start=1):
                    lines.append(Line("mark", np.array([place, place + SEAM * way]), closed=False))
                    labels.append(Label("mark", place - 0.8 * LETTERS * way, f"{number}.{mark}", LETTERS))
        return lines, labels

    @cached_property
    def _bounds(self) -> tuple[Values, Values]:
        places = np.concatenate([line.places for line in self.drawn[0]])
        return places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN

    def write(self, path: Path) -> None:
        """Write the drawing in millimeters."""
        lines, labels = self.drawn
        low, high = self._bounds
        width, height = 1000.0 * (high - low)
        parts = [_path(line, self._in(line.places, 1000.0)) for line in lines]
        parts += [_text(label, self._in(label.place[None], 1000.0)[0]) for label in labels]
        head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
        text = f'{head}viewBox="0 0 {width:.2f} {height:.2f}">\n' + "\n".join(parts) + "\n</svg>\n"
        with whole_file(path) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def picture(self) -> Image.Image:
        """Draw the pattern as a picture."""
        lines, labels = self.drawn
        low, high = self._bounds
        scale = PIXELS / float(high[0] - low[0])
        image = Image.new("RGB", (PIXELS, round(scale * float(high[1] - low[1]))), (255, 255, 255))
        draw = ImageDraw.Draw(image)
        for line in lines:
            places = [tuple(place) for place in self._in(line.places, scale).tolist()]
            draw.line(places + places[:1] * line.closed, LOOKS[line.kind], 2)
        for label in labels:
            font = ImageFont.load_default(max(8.0, scale * label.height))
            draw.text(tuple(self._in(label.place[None], scale)[0].tolist()), label.text, LOOKS[label.kind], font, "mm")
        return image

    def _in(self, places: Values, scale: float) -> Values:
        """Return the places on the sheet, from its upper left corner, in a unit."""
        low, high = self._bounds
        return scale * np.stack([places[:, 0] - low[0], high[1] - places[:, 1]], axis=1)


def require_simple(number: int, border: Values):
    """Make sure that a panel does not lie on itself, and return its outline.

    Raises:
        InputError: it does, so that it cannot be cut.
    """
    outline = from_extra("shapely").Polygon(border)
    if not outline.is_valid:
        raise InputError(
            f"panels: panel {number} overlaps itself when flat and cannot be cut; expected more seams through it"
        )
    return outline


def _path(line: Line, places: Values) -> str:
    corners = " ".join(f"{x:.3f},{y:.3f}" for x, y in places.tolist())
    dashes = ' stroke-dasharray="3 2"' if line.kind == "seam" else ""
    name = "polygon" if line.closed else "polyline"
    return f'<{name} class="{line.kind}" points="{corners}" fill="none" stroke="black" stroke-width="0.3"{dashes}/>'


def _text(label: Label, place: Values) -> str:
    return (
        f'<text class="{label.kind}" x="{place[0]:.2f}" y="{place[1]:.2f}" font-family="sans-serif" '
        f'font-size="{1000.0 * label.height:g}" text-anchor="middle" dominant-baseline="central">'
        f"{escape(label.text)}</text>"
    )
