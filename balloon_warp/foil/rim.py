"""The rim of a sheet: vertices along the rings of an outline, and the quads that join them to the squares within."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

SHARP = np.radians(35.0)
"""Least turn of an outline at a corner that the rim keeps"""
EVENINGS = 30
"""Number of initial smoothing passes of vertices along a ring"""
REACH = 2
"""Number of vertices along a loop within which one is sought that turns as the corner of its ring does"""


@dataclass
class Ring:
    """A closed line of an outline, and where the rim's vertices are along it."""

    corners: NDArray[np.float64]
    """Corners of the line, the first at the end again, shape (corner_count + 1, 2)"""
    vertices: NDArray[np.int64]
    """Vertices of the rim, in the order in which they lie along the line"""
    places: NDArray[np.float64]
    """Distance of each from the line's start along it, ascending, within one length from the first to the last"""
    pinned: NDArray[np.bool_]
    """Mask of the vertices that stay, at corners"""

    def __post_init__(self):
        steps = np.diff(self.corners, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self._along = np.append(0.0, np.cumsum(lengths))
        self._headings = steps / lengths[:, None]

    @property
    def length(self) -> float:
        """Length of the line."""
        return float(self._along[-1])

    def points(self) -> NDArray[np.float64]:
        """Return the points of the vertices, shape (count, 2)."""
        return np.stack([np.interp(self.places % self.length, self._along, each) for each in self.corners.T], axis=1)

    def slide_towards(self, wanted: NDArray[np.float64]) -> None:
        """Move each vertex along the line towards its wanted place, past none of its neighbors.

        The move is a little to the middle between them, too: a notch attracts many.
        """
        segments = np.searchsorted(self._along, self.places % self.length, side="right") - 1
        headings = self._headings[np.minimum(segments, len(self._headings) - 1)]
        moves = ((wanted - self.points()) * headings).sum(axis=1)
        ahead = np.roll(self.places, -1) - self.places
        ahead[-1] += self.length
        most = 0.4 * np.minimum(ahead, np.roll(ahead, 1))
        self.places += np.where(self.pinned, 0.0, np.clip(moves, -most, most))
        self.even(1)

    def even(self, times: int) -> None:
        """Move each towards the middle between its neighbors."""
        for _ in range(times):
            before, after = np.roll(self.places, 1), np.roll(self.places, -1)
            before[0] -= self.length
            after[-1] += self.length
            self.places = np.where(self.pinned, self.places, 0.5 * self.places + 0.25 * (before + after))


def ring_around(
    line: Any, loop: NDArray[np.int64], points: NDArray[np.float64], squares: NDArray[np.int64], first: int
) -> tuple[Ring, NDArray[np.int64]]:
    """Return the ring that a loop of vertices grows onto, and the quads between.

    Each vertex of the loop gets one of the ring. At a corner of the outline one that turns outward gets three, so that
    a quad ends in the corner; and one that turns inward has none of its own, nor have its neighbors, but that in the
    corner.

    Args:
        line: runs around as the loop does.
        points: of the loop's vertices, shape (count, 2).
        squares: that meet in each of them, 1 to 3.
        first: number of the ring's first vertex.
    """
    corners = _corners_at(line, _places_along(line, points), squares)
    inward = {at for at in corners if squares[at] == 3}
    center = {(at + side) % len(loop): at for at in inward for side in (-1, 1)}
    begins, pins, count = np.zeros(len(loop), dtype=np.int64), {}, first
    for number in range(len(loop)):
        if number not in center:
            begins[number] = count
            outward = number in corners and squares[number] == 1
            if number in corners:
                pins[count - first + outward] = corners[number]
            count += 3 if outward else 1
    ends = begins + np.array([2 * (number in corners and squares[number] == 1) for number in range(len(loop))])
    for number, at in center.items():
        begins[number] = ends[number] = begins[at]

    quads = []
    for number, vertex in enumerate(loop):
        after = (number + 1) % len(loop)
        if number in inward:
            quads.append([loop[after], vertex, loop[number - 1], begins[number]])
        elif ends[number] > begins[number]:
            quads.append([vertex, *range(begins[number], ends[number] + 1)])
        if number not in inward and after not in inward:
            quads.append([loop[after], vertex, ends[number], begins[after]])
    places, pinned = _spread(line, count - first, pins, points)
    ring = Ring(np.asarray(line.coords), np.arange(first, count), places, pinned)
    ring.even(EVENINGS)
    return ring, np.array(quads)


def _places_along(line: Any, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places along a line of each of the points around it, ascending."""
    import shapely

    nearest = shapely.line_locate_point(line, shapely.points(points))
    steps = np.roll(nearest, -1) - nearest
    steps = np.maximum(steps - line.length * np.round(steps / line.length), 1e-3 * line.length / len(points))
    return nearest[0] + np.append(0.0, np.cumsum(steps * (line.length / steps.sum()))[:-1])


def _corners_at(line: Any, places: NDArray[np.float64], squares: NDArray[np.int64]) -> dict[int, float]:
    """Return the vertices of the loop at sharp corners of a line, with the corners' places along it.

    At each corner it is the nearest vertex that turns as the corner does, if there is one for it alone.
    """
    count, taken = len(places), np.zeros(len(places), dtype=bool)
    found: dict[int, float] = {}
    for place, outward in zip(*_corners_of(line), strict=True):
        apart = np.abs(places - place - line.length * np.round((places - place) / line.length))
        near = int(apart.argmin())
        around = sorted(range(near - REACH, near + REACH + 1), key=lambda number: apart[number % count])
        for at in around:
            span = np.arange(at - 2, at + 3) % count
            if squares[at % count] == (1 if outward else 3) and not taken[span].any():
                found[at % count] = place
                taken[np.arange(at - 1, at + 2) % count] = True
                break
    return found


def _corners_of(line: Any) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the sharp corners of a ring of Shapely's: places along it, and whether they turn outward, to the left."""
    corners = np.asarray(line.coords)[:-1]
    steps = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(steps, axis=1)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = headings - np.roll(headings, 1)
    turns -= 2.0 * np.pi * np.round(turns / (2.0 * np.pi))
    sharp = np.abs(turns) > SHARP
    return (np.cumsum(lengths) - lengths)[sharp], turns[sharp] > 0.0


def _spread(
    line: Any, count: int, pins: dict[int, float], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the places of so many vertices along a line, evenly from pin to pin, and which are pinned."""
    import shapely

    pinned = np.zeros(count, dtype=bool)
    if not pins:
        begin = float(shapely.line_locate_point(line, shapely.points(points[0])))
        return begin + line.length * np.arange(count) / count, pinned
    numbers = sorted(pins)
    pinned[numbers] = True
    at = np.array([pins[number] for number in numbers])
    at = at[0] + np.append(0.0, np.cumsum(np.diff(at) % line.length))
    numbers, at = [*numbers, numbers[0] + count], np.append(at, at[0] + line.length)
    places = np.interp(np.arange(numbers[0], numbers[0] + count), numbers, at)
    places[count - numbers[0] :] -= line.length
    return np.roll(places, numbers[0]), pinned
