"""A flat sheet of even quads with a given outline.

The squares of a grid that lie well within the outline are kept; a row of quads joins them to the outline all around,
and then each quad pulls its corners towards those of a square. Where the outline runs aslant to the grid, vertices have
three or five neighbors instead of four.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.foil.grid import squares_within
from balloon_warp.foil.rim import Ring, ring_around

FINE = 1e-3
"""Tolerance to which an outline is followed [edges]"""
TRIES = 9
"""Number of edge lengths tried, from the given one to half of it"""
SHIFTS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""Shifts of the grid [squares]"""
GOOD, BAD = 0.1, 0.01
"""Quality from which a sheet is taken at once, and up to which it is rejected"""
SAME_AREA, LONGEST = 0.005, 2.0
"""Largest relative difference of a sheet's area from its outline's, and longest edge [edges]"""
ROUNDS = 40
"""Number of rounds in which quads pull at their corners"""
WEAKEST = 0.1
"""Least area at a corner of a quad over a square's, below which it pulls no harder"""
IN_PLANE = np.array([1.0, 1.0j])
"""Map of x and y to a complex number, where a product turns"""
QUARTER_TURNS = np.array([1.0, 1.0j, -1.0, -1.0j])


@dataclass(frozen=True)
class Sheet:
    """Quads in a plane."""

    points: NDArray[np.float64]
    """Points, shape (vertex_count, 2)"""
    quads: NDArray[np.int64]
    """Quads, counterclockwise, shape (quad_count, 4)"""
    rim: NDArray[np.bool_]
    """Mask of the vertices on the outline, shape (vertex_count,)"""

    def quality(self, outline: Any, edge: float) -> float:
        """Return the least area of the parallelogram at a quad's corner over a square's.

        1 is best, and less than 0 is a quad that is turned over. As bad as can be where a part of the outline was left
        out.
        """
        corners = np.asarray((self.points @ IN_PLANE)[self.quads], dtype=np.complex128)
        areas = corner_areas(corners)
        if abs(areas.sum() / 4.0 / outline.area - 1.0) > SAME_AREA or longest_edge(corners) > LONGEST * edge:
            return -np.inf
        return float(areas.min()) / edge**2


def sheet_of(outline: Any, edge: float) -> Sheet | None:
    """Return a sheet with the outline of a polygon of Shapely's, or None.

    There is none where the polygon has parts that are too narrow for quads of such edges.

    Args:
        edge: how long edges are, about; they are shorter, by up to a half, where that makes better quads.
    """
    from shapely.geometry.polygon import orient

    outline = orient(outline.simplify(FINE * edge))  # around, clockwise around holes: with the inside on the left
    best, best_quality = None, BAD
    for size in edge * 0.5 ** np.linspace(0.0, 1.0, TRIES):
        for shift in SHIFTS:
            sheet = _sheet_on_grid(outline, size, shift)
            quality = sheet.quality(outline, size) if sheet else -np.inf
            if quality > best_quality:
                best, best_quality = sheet, quality
            if quality > GOOD:
                return best
    return best


def _sheet_on_grid(outline: Any, edge: float, shift: tuple[float, float]) -> Sheet | None:
    """Return a sheet on a shifted grid, or None where its squares are not connected as the outline is."""
    squares = squares_within(outline, edge, shift)
    lines = [outline.exterior, *outline.interiors]
    if squares is None or len(squares.loops) != len(lines):
        return None
    points, quads, rings = squares.points, squares.quads, []
    meeting = np.bincount(quads.ravel())
    for line, loop in _matched(lines, squares.loops, points):
        ring, between = ring_around(line, loop, points[loop], meeting[loop], len(points))
        points, quads = np.concatenate([points, ring.points()]), np.concatenate([quads, between])
        rings.append(ring)
    points = _relaxed(points, quads, rings, edge)
    return Sheet(points, quads, np.arange(len(points)) >= len(squares.points))


def _matched(
    lines: list[Any], loops: list[NDArray[np.int64]], points: NDArray[np.float64]
) -> Iterator[tuple[Any, NDArray[np.int64]]]:
    """Return each line of an outline with the loop of squares beside it: the outer one, and then those around holes."""
    import shapely

    left = list(loops)
    for line in lines:
        apart = [shapely.hausdorff_distance(line, shapely.LineString(points[loop])) for loop in left]
        yield line, left.pop(int(np.argmin(apart)))


def _relaxed(
    points: NDArray[np.float64], quads: NDArray[np.int64], rings: list[Ring], edge: float
) -> NDArray[np.float64]:
    """Return the points after relaxation toward squares.

    Each quad pulls its corners towards the nearest square of such edges, round after round, the worse ones harder;
    those of the rim along their rings.
    """
    place = points @ IN_PLANE
    for _ in range(ROUNDS):
        corners = place[quads]
        spoke = (corners * QUARTER_TURNS.conj()).mean(axis=1, keepdims=True)  # from the middle to the first corner
        spoke *= np.sqrt(0.5) * edge / np.maximum(np.abs(spoke), 1e-9 * edge)
        wanted = corners.mean(axis=1, keepdims=True) + spoke * QUARTER_TURNS
        pull = np.repeat(1.0 / np.maximum(corner_areas(corners).min(axis=1) / edge**2, WEAKEST), 4)
        real, imaginary, total = (
            np.bincount(quads.ravel(), values)
            for values in (pull * wanted.real.ravel(), pull * wanted.imag.ravel(), pull)
        )
        place = (real + 1.0j * imaginary) / total
        for ring in rings:
            there = place[ring.vertices]
            ring.slide_towards(np.stack([there.real, there.imag], axis=1))
            place[ring.vertices] = ring.points() @ IN_PLANE
    return np.stack([place.real, place.imag], axis=1)


def longest_edge(corners: NDArray[np.complex128]) -> float:
    """Return the longest edge of any quad; corners in the complex plane, shape (quad_count, 4)."""
    return float(np.abs(np.roll(corners, -1, axis=1) - corners).max())


def corner_areas(corners: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the areas of the parallelograms at each corner of each quad, negative where turned over.

    The two edges at the corner span it; their sum over a quad is four times its area.

    Args:
        corners: in the complex plane, shape (quad_count, 4), like the result.
    """
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return (after.conj() * before).imag
