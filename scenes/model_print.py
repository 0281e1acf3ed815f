"""Prints: white dots and a border for the pillow, names of gases for balls."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

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


GASES = {
    "helium": ("He", (222, 44, 40), (255, 248, 232)),
    "air": ("air", (246, 240, 224), (40, 52, 84)),
    "sulfur_hexafluoride": ("SF", (26, 70, 160), (255, 248, 232)),
}
"""Word, ground and ink of each gas, sRGB"""
WORD, INDEX = 92.0, 50.0
"""Height of letters, and of the six below the line of SF6 [pixels]"""


def label(gas: str) -> NDArray[np.uint8]:
    """Return an image around a ball with a gas's name in front, sRGB, shape (SIZE, 2 SIZE, 3)."""
    word, ground, ink = GASES[gas]
    image = Image.new("RGB", (2 * SIZE, SIZE), ground)
    draw, font, small = ImageDraw.Draw(image), ImageFont.load_default(WORD), ImageFont.load_default(INDEX)
    index = "6" if word == "SF" else ""
    width, below = draw.textlength(word, font), draw.textlength(index, small)
    left, line = SIZE - 0.5 * (width + below), 0.5 * SIZE + 0.36 * WORD
    draw.text((left, line), word, ink, font, anchor="ls", stroke_width=2)
    draw.text((left + width + 4.0, line + 0.3 * INDEX), index, ink, small, anchor="ls", stroke_width=1)
    return np.asarray(image)
