"""Parsers of picture sizes and ranges of frames on the command line."""

import re

from balloon_warp.errors import InputError


def parse_size(text: str) -> tuple[int, int]:
    """Return the width and height of `WIDTHxHEIGHT`.

    Raises:
        InputError: the text has another form.
    """
    match = re.fullmatch(r"(\d{1,12})[xX](\d{1,12})", text)
    if not match:
        raise InputError(f"size: {text[:40]!r}; expected WIDTHxHEIGHT in pixels, such as 960x540")
    return int(match[1]), int(match[2])


def parse_frames(text: str) -> tuple[int | None, int | None]:
    """Read the first and the last of `FIRST:LAST`, either of which may be missing.

    Raises:
        InputError: the text has another form.
    """
    match = re.fullmatch(r"(-?\d{1,9})?:(-?\d{1,9})?", text)
    if not match:
        raise InputError(f"--frames {text[:40]}: expected FIRST:LAST, such as 10:90, :90 or 10:")
    first, last = (int(word) if word else None for word in match.groups())
    return first, last


def parse_place(text: str, option: str = "look-at") -> str | tuple[float, float, float]:
    """Read a point of `X,Y,Z`, or a name, which has no comma.

    Raises:
        InputError: the text has commas and is no point.
    """
    if "," not in text:
        return text
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise InputError(f"--{option} {text[:40]}: expected X,Y,Z in the stage's unit, or a prim's name") from None
    return x, y, z
