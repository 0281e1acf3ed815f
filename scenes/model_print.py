"""The print of the pillow: white dots and a border on a ground of color."""

import numpy as np
from numpy.typing import NDArray

SIZE = 256
"""pixels to a side"""
GROUND, INK = (226, 54, 42), (250, 244, 228)
"""sRGB"""
DOTS = 5
"""to a side, and as many less one between them"""


def dots() -> NDArray[np.uint8]:
    """Return an image, sRGB, shape (SIZE, SIZE, 3)."""
    fine = 4 * SIZE  # and then the mean of 4 x 4, so that edges are smooth
    y, x = (np.mgrid[:fine, :fine] + 0.5) / fine
    border = (np.abs(np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) - 0.45) < 0.012).astype(float)
    cell = 0.8 / DOTS

    def at_centers(shift: float, most: int) -> NDArray[np.bool_]:
        along = [np.clip(np.round((place - 0.1) / cell - 0.5 - shift), 0, most) for place in (x, y)]
        away = [place - (0.1 + (number + 0.5 + shift) * cell) for place, number in zip((x, y), along, strict=True)]
        return np.hypot(*away) < 0.24 * cell

    ink = np.maximum(border, at_centers(0.0, DOTS - 1) | at_centers(0.5, DOTS - 2))
    share = ink.reshape(SIZE, 4, SIZE, 4).mean(axis=(1, 3))[..., None]
    return np.rint((1.0 - share) * GROUND + share * INK).astype(np.uint8)
