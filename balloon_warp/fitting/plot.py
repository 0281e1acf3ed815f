"""A plot of measured curves and of those that were found."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from balloon_warp.fitting.measured_curve import Curve

Values = NDArray[np.float64]
SIZE, MARGIN = (720, 480), (80, 24, 24, 56)
"""Size and margins [pixels]; left, top, right, bottom"""
PAPER, INK, FAINT = (255, 255, 255), (40, 40, 40), (225, 225, 225)
COLORS = (((40, 105, 160), (200, 60, 30)), ((60, 130, 60), (120, 60, 150)), ((150, 110, 20), (30, 120, 130)))
"""Colors of the line and the dots of each curve"""
TICKS = 5


def curves_plot(curves: Sequence[Curve], found: Sequence[Values]) -> Image.Image:
    """Draw loads over sizes: dots that were measured, and the lines that were found; inflations above other tests."""
    both = list(zip(curves, found, strict=True))
    parts = [[each for each in both if (each[0].test == "inflation") == inflated] for inflated in (True, False)]
    drawn = [_plot(part) for part in parts if part]
    image = Image.new("RGB", (SIZE[0], SIZE[1] * len(drawn)), PAPER)
    for number, part in enumerate(drawn):
        image.paste(part, (0, SIZE[1] * number))
    return image


def _plot(curves: Sequence[tuple[Curve, Values]]) -> Image.Image:
    image = Image.new("RGB", SIZE, PAPER)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    left, top, right, bottom = MARGIN
    inflated = curves[0][0].test == "inflation"
    sizes = np.concatenate([curve.sizes for curve, _ in curves])
    loads = np.concatenate([both for curve, found in curves for both in (curve.loads, found)])
    across = (0.0 if inflated else min(1.0, sizes.min()), 1.05 * sizes.max())
    up = (min(0.0, loads.min()), 1.1 * loads.max() if loads.max() > 0.0 else 0.0)

    def place(x: float, y: float) -> tuple[float, float]:
        return (
            left + (SIZE[0] - left - right) * (x - across[0]) / (across[1] - across[0]),
            SIZE[1] - bottom - (SIZE[1] - top - bottom) * (y - up[0]) / (up[1] - up[0]),
        )

    for x in ticks(*across):
        draw.line([place(x, up[0]), place(x, up[1])], FAINT)
        text = f"{1000.0 * x if inflated else x:.6g}"
        draw.text((place(x, up[0])[0], SIZE[1] - bottom + 6), text, INK, font, anchor="ma")
    for y in ticks(*up):
        draw.line([place(across[0], y), place(across[1], y)], FAINT)
        text = f"{y if inflated else 1e-6 * y:.6g}"
        draw.text((left - 8, place(across[0], y)[1]), text, INK, font, anchor="rm")
    draw.text((SIZE[0] // 2, SIZE[1] - 24), "volume [l]" if inflated else "stretch", INK, font, anchor="ma")
    what = "pressure [Pa]" if inflated else "nominal stress [MPa]"
    draw.text((8, 4), f"{what}: dots measured, line fitted", INK, font)
    for number, (curve, found) in enumerate(curves):
        line, dot = COLORS[number % len(COLORS)]
        draw.line(_joined([place(x, y) for x, y in zip(curve.sizes, found, strict=True)]), line, 3)
        for x, y in zip(curve.sizes, curve.loads, strict=True):
            (u, v), r = place(x, y), 4
            draw.ellipse((u - r, v - r, u + r, v + r), dot)
        if not inflated:
            draw.text((left + 12, top + 4 + 18 * number), curve.test, dot, font)
    return image


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers of a range, a few."""
    rough = (high - low) / TICKS
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(each for each in (1.0, 2.0, 5.0, 10.0) if each * power >= rough)
    return [float(k * step) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _joined(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(float(u), float(v)) for u, v in places]
