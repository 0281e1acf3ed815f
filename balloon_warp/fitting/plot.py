"""A plot of a measured curve and of the one that was found."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Values = NDArray[np.float64]
SIZE, MARGIN = (720, 480), (80, 24, 24, 56)
"""Size and margins [pixels]; left, top, right, bottom"""
PAPER, INK, FAINT, LINE, DOT = (255, 255, 255), (40, 40, 40), (225, 225, 225), (40, 105, 160), (200, 60, 30)
TICKS = 5


def curve_plot(volumes: Values, measured: Values, found: Values) -> Image.Image:
    """Draw pressures over volumes: dots that were measured, and the line that was found."""
    image = Image.new("RGB", SIZE, PAPER)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    left, top, right, bottom = MARGIN
    across, up = (0.0, 1.05 * volumes.max()), (min(0.0, measured.min()), 1.1 * max(measured.max(), found.max()))

    def place(x: float, y: float) -> tuple[float, float]:
        return (
            left + (SIZE[0] - left - right) * (x - across[0]) / (across[1] - across[0]),
            SIZE[1] - bottom - (SIZE[1] - top - bottom) * (y - up[0]) / (up[1] - up[0]),
        )

    for x in ticks(*across):
        draw.line([place(x, up[0]), place(x, up[1])], FAINT)
        draw.text((place(x, up[0])[0], SIZE[1] - bottom + 6), f"{1000.0 * x:.6g}", INK, font, anchor="ma")
    for y in ticks(*up):
        draw.line([place(across[0], y), place(across[1], y)], FAINT)
        draw.text((left - 8, place(across[0], y)[1]), f"{y:.6g}", INK, font, anchor="rm")
    draw.text((SIZE[0] // 2, SIZE[1] - 24), "volume [l]", INK, font, anchor="ma")
    draw.text((8, 4), "pressure [Pa]: dots measured, line fitted", INK, font)
    draw.line(_joined([place(x, y) for x, y in zip(volumes, found, strict=True)]), LINE, 3)
    for x, y in zip(volumes, measured, strict=True):
        (u, v), r = place(x, y), 4
        draw.ellipse((u - r, v - r, u + r, v + r), DOT)
    return image


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers of a range, a few."""
    rough = (high - low) / TICKS
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(each for each in (1.0, 2.0, 5.0, 10.0) if each * power >= rough)
    return [float(k * step) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _joined(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(float(u), float(v)) for u, v in places]
