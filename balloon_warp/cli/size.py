"""Picture sizes from the command line's words."""

import re

from balloon_warp.errors import InputError


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of `WIDTHxHEIGHT`.

    Raises:
        InputError: the text has another form.
    """
    match = re.fullmatch(r"(\d{1,12})[xX](\d{1,12})", text)
    if not match:
        raise InputError(f"size: {text[:40]!r}; expected WIDTHxHEIGHT in pixels, such as 960x540")
    return int(match[1]), int(match[2])
