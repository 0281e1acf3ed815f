"""Outlines of the paths and shapes in an SVG file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.foil.outlines import enclosed, from_extra, united

PARTS_OF_CURVE = 32
"""Number of straight lines that a curve is divided into, between two of its points in the file"""
DAMAGED = (
    ParseError,
    ValueError,
    TypeError,
    AttributeError,
    LookupError,
    ArithmeticError,
    RecursionError,
    AssertionError,
)
"""Errors of svgelements for a file that is not as it expects"""


def outlines_of_drawing(path: Path) -> list[Any]:
    """Return polygons of Shapely's of all closed paths and shapes of a drawing together.

    From left to right, y up, in some unit. Paint does not matter; polygons of one path cut holes into each other by its
    fill rule.

    Raises:
        InputError: the file cannot be read, or has none.
        MissingExtraError: svgelements or Shapely is not installed.
    """
    svg = from_extra("svgelements")
    try:
        shapes = [(list(_closed_loops(svg, shape)), shape.values.get("fill-rule")) for shape in _shapes(svg, path)]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except DAMAGED:
        raise InputError(f"{path}: is no SVG drawing, or a damaged one") from None
    if not all(np.isfinite(loop).all() for loops, _ in shapes for loop in loops):
        raise InputError(f"{path}: has a coordinate that is not finite")
    outlines = [
        each for loops, rule in shapes for each in enclosed(loops, "evenodd" if rule == "evenodd" else "nonzero")
    ]
    if not outlines:
        raise InputError(f"{path}: has no closed path with an area; expected one (convert text to paths)")
    return united(outlines)


def _shapes(svg: Any, path: Path) -> Iterator[Any]:
    for element in svg.SVG.parse(str(path), reify=True).elements():
        if isinstance(element, svg.Shape):
            yield element


def _closed_loops(svg: Any, shape: Any) -> Iterator[NDArray[np.float64]]:
    """Return the points along each closed path of a shape, shape (count, 2), y up."""
    for part in svg.Path(shape.segments(transformed=True)).as_subpaths():
        segments = [segment for segment in svg.Path(part) if not isinstance(segment, svg.Move)]
        if not segments or not _is_closed(svg, segments):
            continue
        points: list[complex] = []
        for segment in segments:
            straight = isinstance(segment, svg.Line | svg.Close)
            for part_of_one in [1.0] if straight else np.linspace(0.0, 1.0, PARTS_OF_CURVE + 1)[1:]:
                point = segment.end if straight else segment.point(float(part_of_one))
                if point is not None:
                    points.append(complex(point.real, point.imag))
        yield np.array([[point.real, -point.imag] for point in points]).reshape(-1, 2)


def _is_closed(svg: Any, segments: list[Any]) -> bool:
    if isinstance(segments[-1], svg.Close):
        return True
    begin, end = complex(segments[0].start or 0.0), complex(segments[-1].end or 0.0)
    return abs(begin - end) < 1e-9 * (1.0 + abs(end))
