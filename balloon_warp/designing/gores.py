"""Gores: a round shape as strips from pole to pole, around its vertical axis."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume

Values = NDArray[np.float64]
LEAST_GORES, MOST_GORES = 3, 64
ASIDE = 1.0e-9
"""Distance from a plane over the size up to which something lies in it"""
Meridian = Callable[[float], Values]
"""Function for the line from pole to pole at an angle, shape (k, 3)"""


def gores_of(mesh: PolygonMesh, count: int, edge: float) -> tuple[PolygonMesh, NDArray[np.int64]]:
    """Divide the surface anew, so that seams of gores run along its edges.

    Args:
        mesh: closed and centered.
        edge: about how long the edges become [m].

    Returns:
        The triangles, and the edges along the seams, shape (k, 2).

    Raises:
        InputError: the shape does not go around its axis once.
    """
    if not LEAST_GORES <= count <= MOST_GORES:
        raise InputError(f"panels: must be from {LEAST_GORES} to {MOST_GORES} gores (got {count})")
    line = _meridians(mesh)
    length = max(_lengths(line(2.0 * np.pi * k / count))[-1] for k in range(count))
    rows = max(4, round(length / edge))
    grid = _Grid(line, count, rows, edge)
    points, triangles, seams = grid.build()
    found = PolygonMesh(
        points, np.full(len(triangles), 3, dtype=np.int32), triangles.ravel().astype(np.int32), mesh.name
    )
    if signed_volume(found) < 0.0:
        found = replace(found, face_vertex_indices=triangles[:, ::-1].ravel().astype(np.int32))
    return found, seams


class _Grid:
    """Rows of vertices on all gores, from pole to pole."""

    def __init__(self, line: Meridian, count: int, rows: int, edge: float):
        self._line, self._count, self._rows, self._edge = line, count, rows, edge
        self._places: dict[tuple[float, int], int] = {}
        self._points: list[Values] = []

    def build(self) -> tuple[Values, NDArray[np.int64], NDArray[np.int64]]:
        """Return the points, triangles, and edges along the seams."""
        triangles: list[tuple[int, int, int]] = []
        seams = set()
        for gore in range(self._count):
            lines = [self._row(gore, row) for row in range(self._rows + 1)]
            for low, high in pairwise(lines):
                triangles += _zipped(low, high)
                seams |= {(low[0], high[0])}
        return np.array(self._points), np.array(triangles), np.array(sorted(seams))

    def _row(self, gore: int, row: int) -> list[int]:
        """Return the vertices of a gore's row, from seam to seam."""
        if row in (0, self._rows):
            return [self._vertex(0.0, row)]
        ends = self._at(gore / self._count, row), self._at((gore + 1) / self._count, row)
        parts = max(1, round(float(np.linalg.norm(ends[1] - ends[0])) / self._edge))
        return [self._vertex((gore + k / parts) / self._count, row) for k in range(parts + 1)]

    def _vertex(self, turn: float, row: int) -> int:
        key = round(turn % 1.0, 9) % 1.0, row
        if key not in self._places:
            self._places[key] = len(self._points)
            self._points.append(self._at(turn, row))
        return self._places[key]

    def _at(self, turn: float, row: int) -> Values:
        line = self._line(2.0 * np.pi * (round(turn % 1.0, 9) % 1.0))
        along = _lengths(line)
        where = along[-1] * row / self._rows
        return np.array([np.interp(where, along, line[:, axis]) for axis in range(3)])


def _zipped(low: list[int], high: list[int]) -> list[tuple[int, int, int]]:
    """Return the triangles between two rows."""
    found, i, j = [], 0, 0
    while i < len(low) - 1 or j < len(high) - 1:
        next_low, next_high = (i + 1) / max(len(low) - 1, 1e-9), (j + 1) / max(len(high) - 1, 1e-9)
        if next_low <= next_high:
            found.append((low[i], low[i + 1], high[j]))
            i += 1
        else:
            found.append((low[i], high[j + 1], high[j]))
            j += 1
    return found


def _lengths(line: Values) -> Values:
    """Return the length of a line up to each of its points."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _meridians(mesh: PolygonMesh) -> Meridian:
    """Return the lines of a mesh from its lower pole to the upper one, by angle."""
    triangles, up = Ruler(mesh).triangles, "XYZ".index(mesh.up_axis)
    size = float(np.ptp(mesh.points, axis=0).max())
    across = [axis for axis in range(3) if axis != up]

    @cache
    def line(angle: float) -> Values:
        away, beside = np.zeros(3), np.zeros(3)
        away[across] = np.cos(angle), np.sin(angle)
        beside[across] = -np.sin(angle), np.cos(angle)
        places = mesh.points - 0.0
        heights = places @ beside
        loops = _loops(places, triangles, np.where(np.abs(heights) < ASIDE * size, ASIDE * size, heights))
        parts = [part for loop in loops for part in _outward(loop, loop @ away, up)]
        if len(parts) != 1:
            raise InputError(
                f"panels: the half-plane at {np.degrees(angle):.0f} degrees meets {mesh.name} in {len(parts)} lines "
                "from pole to pole; gores need one, as of a shape around its vertical axis; a file of seams cuts other "
                "shapes"
            )
        return parts[0] if parts[0][0, up] < parts[0][-1, up] else parts[0][::-1]

    return line


def _loops(points: Values, triangles: NDArray[np.int64], heights: Values) -> list[Values]:
    """Return the closed lines in which a plane meets a closed surface.

    Args:
        heights: of the points over the plane, none of them 0.
    """
    over = heights[triangles] > 0.0
    cut = triangles[over.any(axis=1) & ~over.all(axis=1)]
    beside: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for corners in cut.tolist():
        pairs = ((corners[k], corners[(k + 1) % 3]) for k in range(3))
        first, second = (tuple(sorted(pair)) for pair in pairs if (heights[pair[0]] > 0.0) != (heights[pair[1]] > 0.0))
        beside.setdefault(first, []).append(second)  # pyright: ignore[reportArgumentType]
        beside.setdefault(second, []).append(first)  # pyright: ignore[reportArgumentType]
    loops, left = [], dict(beside)
    while left:
        here, order = next(iter(left)), []
        while here in left:
            order.append(here)
            ways = left.pop(here)
            here = next((way for way in ways if way in left), here)
        ends = np.array(order)
        part = heights[ends[:, 0]] / (heights[ends[:, 0]] - heights[ends[:, 1]])
        loops.append(points[ends[:, 0]] + part[:, None] * (points[ends[:, 1]] - points[ends[:, 0]]))
    return loops


def _outward(loop: Values, reach: Values, up: int) -> list[Values]:
    """Return the parts of a closed line on the one side of the axis, with the points on the axis at their ends.

    Args:
        reach: how far each point is from the axis, to that side.
    """
    out = reach > 0.0
    if out.all() or not out.any():
        return [loop] if out.all() else []
    begins = np.flatnonzero(out & ~np.roll(out, 1))
    parts = []
    for begin in begins.tolist():
        order = np.roll(np.arange(len(loop)), -begin)
        run = order[: int(np.argmin(out[order]))]
        ends = [(order[-1], run[0]), (order[len(run)], run[-1])]
        poles = [loop[a] + (loop[b] - loop[a]) * (reach[a] / (reach[a] - reach[b])) for a, b in ends]
        parts.append(np.concatenate([[poles[0]], loop[run], [poles[1]]]))
    return parts
