"""Necks of foil between the parts of a letter, such as an i and its dot, so that they are one balloon."""

from collections.abc import Sequence
from typing import Any

from balloon_warp.foil.outlines import from_extra, united

WIDTH = 0.24
"""Width of a neck, over the horizontal overlap of the parts"""
ABOVE = 0.5
"""Least overlap of two parts, one above the other, over the narrower one's width"""


def with_necks(outlines: Sequence[Any]) -> list[Any]:
    """Join polygons of Shapely's that are above each other to one each, from left to right.

    A neck is straight and upright. Parts beside each other, as those of a percent sign, stay apart.
    """
    lowest_first = sorted(outlines, key=lambda outline: outline.bounds[1])
    necks = [
        neck
        for number, lower in enumerate(lowest_first)
        for upper in lowest_first[number + 1 :]
        if (neck := _neck(lower, upper)) is not None
    ]
    return united([*outlines, *necks]) if necks else list(outlines)


def _neck(lower: Any, upper: Any) -> Any | None:
    """Return the rectangle that joins two parts; None where neither is above the other."""
    box, line = (getattr(from_extra("shapely"), name) for name in ("box", "LineString"))
    left, right = max(lower.bounds[0], upper.bounds[0]), min(lower.bounds[2], upper.bounds[2])
    narrower = min(part.bounds[2] - part.bounds[0] for part in (lower, upper))
    if right - left < ABOVE * narrower or upper.bounds[1] < lower.bounds[3]:
        return None
    middle, half = 0.5 * (left + right), 0.5 * WIDTH * (right - left)
    upright = line([(middle, lower.bounds[1]), (middle, upper.bounds[3])])
    begin, end = lower.intersection(upright), upper.intersection(upright)
    if begin.is_empty or end.is_empty:
        return None
    return box(middle - half, begin.bounds[3] - half, middle + half, end.bounds[1] + half)
