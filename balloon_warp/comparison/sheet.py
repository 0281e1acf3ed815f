"""The picture of a comparison: labeled tiles in a grid."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from balloon_warp.outputs.render.files import Picture

PAPER, INK, FAINT, ALARM = (255, 255, 255), (40, 40, 40), (238, 238, 238), (150, 40, 30)
"""Colors of the sheet, sRGB"""
LEAST_LETTERS = 12
"""Least height of letters [pixels]"""


class Tile(NamedTuple):
    """Run's part of the sheet."""

    label: Sequence[str]
    """Lines above the picture"""
    picture: Picture | None
    """Picture of shape (height, width, 3), or None"""
    sentence: str
    """Reason for a missing picture"""


def compose_sheet(tiles: Sequence[Tile], columns: int, size: tuple[int, int]) -> Picture:
    """Lay tiles out in rows, each under its label; shape (height, width, 3).

    Args:
        tiles: row by row.
        columns: tiles in a row.
        size: width and height of a tile's picture in pixels.
    """
    font = ImageFont.load_default(letter_height(size))
    line = round(1.4 * letter_height(size))
    gap = line // 2
    labels = [[part for text in tile.label for part in _wrapped(text, font, size[0])] for tile in tiles]
    head = gap + line * max(map(len, labels), default=0)
    rows = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * (size[0] + gap) + gap, rows * (head + size[1] + gap) + gap), PAPER)
    draw = ImageDraw.Draw(sheet)
    for place, (tile, label) in enumerate(zip(tiles, labels, strict=True)):
        row, column = divmod(place, columns)
        left, top = gap + column * (size[0] + gap), gap + row * (head + size[1] + gap)
        draw.multiline_text((left, top + gap // 2), "\n".join(label), INK, font, spacing=line - letter_height(size))
        if tile.picture is not None:
            sheet.paste(Image.fromarray(tile.picture), (left, top + head))
            continue
        draw.rectangle((left, top + head, left + size[0] - 1, top + head + size[1] - 1), FAINT)
        lines = _wrapped(tile.sentence, font, size[0] - 2 * line)
        draw.multiline_text((left + line, top + head + line), "\n".join(lines), ALARM, font)
    return np.asarray(sheet)


def letter_height(size: tuple[int, int]) -> int:
    """Return the height of the letters [pixels] over pictures of this size."""
    return max(LEAST_LETTERS, round(size[1] / 16))


def _wrapped(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> list[str]:
    """Return the lines of at most `width` pixels; a longer word gets a line of its own."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
