"""Crossings of a surface with itself, and limits on changes so that it has none.

Crossings of a surface with itself: edges that go through triangles with which they share no corner.

Where an edge meets a triangle at its rim, in its plane or at an end, signs of volumes do not tell. Such a place crosses
if it does so however slightly all points are moved: outward or inward, which parts faces that only touch, and a little
at random, which undoes symmetries (as in Edelsbrunner and Muecke 1990).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import first_coincident, triangulate
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import component_labels, face_starts, mesh_edges

Values = NDArray[np.float64]
Numbers = NDArray[np.int64]
MOVED, RANDOM = 1.0e-9, 0.3
"""Distance by which points are moved along their normals, over the size; and at random, over that distance"""
DRAWS = 16
"""Number of ways in which they are moved: half of them outward"""
CLEAR = 20.0
"""Volume from which on its sign is certain, over that of the move"""
ROWS = 4096
"""Number of triangles whose surroundings are looked at together, to bound the memory"""


class Crossings(NamedTuple):
    """Edges that go through triangles."""

    edges: Numbers
    """Ends of each edge, shape (n, 2)"""
    triangles: Numbers
    """Number of the triangle that it goes through, shape (n,)"""
    depths: Values
    """Distance of the nearer end from the plane of the triangle [m], shape (n,)"""
    places: Values
    """Position [m], shape (n, 3)"""


@dataclass(frozen=True)
class NearPairs:
    """Edges and triangles of a surface that are near each other, and share no corner."""

    surface: Numbers
    """Corners of its triangles, shape (t, 3)"""
    ends: Numbers
    """Ends of each edge, shape (n, 2)"""
    numbers: Numbers
    """Number of each triangle, shape (n,)"""

    @classmethod
    def of(cls, points: Values, triangles: NDArray[np.integer], moves: float = 0.0) -> "NearPairs":
        """Return the pairs that may cross once every vertex has moved by at most so much [m]; open seams are closed."""
        surface = _closed_seams(points, triangles.astype(np.int64))
        found = [(np.zeros((0, 2), np.int64), np.zeros(0, np.int64)), *_near(points, surface, 2.0 * moves)]
        return cls(surface, *(np.concatenate(parts) for parts in zip(*found, strict=True)))

    @property
    def corners(self) -> Numbers:
        """Corners of each triangle, shape (n, 3)."""
        return self.surface[self.numbers]

    def crossing(self, points: Values) -> NDArray[np.bool_]:
        """Return which pairs cross where the vertices are at these points, shape (n,)."""
        points = points - points.mean(axis=0)
        moved = MOVED * _size(points)
        crosses, doubtful = _goes_through(points, self.ends, self.corners, moved)
        rows = np.flatnonzero(doubtful)
        if len(rows):
            few = replace(self, ends=self.ends[rows], numbers=self.numbers[rows])
            crosses[rows] = few._however_moved(points, moved)
        return crosses

    def _however_moved(self, points: Values, moved: float) -> NDArray[np.bool_]:
        """Return which pairs are of places that cross, however the points are moved."""
        normals, random = _normals(points, self.surface), np.random.default_rng(0)
        sides = np.concatenate([self.ends, self.corners], axis=1)
        ever, draws = np.zeros(len(sides), dtype=bool), []
        for draw in range(DRAWS):
            shift = (-1.0) ** draw * normals + RANDOM * random.uniform(-1.0, 1.0, points.shape)
            draws.append(_goes_through(points + moved * shift, self.ends, self.corners, 0.0)[0])
            if not draws[-1].any():
                return draws[-1]
            ever |= draws[-1]
        linked = sides[ever]
        labels = component_labels(len(points), np.repeat(linked[:, 0], 4), linked[:, 1:].ravel())[sides[:, 0]]
        always = np.ones(len(points), dtype=bool)
        for crosses in draws:
            always &= np.bincount(labels[crosses], minlength=len(points)) > 0
        return draws[0] & always[labels]


def find_crossings(points: Values, triangles: NDArray[np.integer]) -> Crossings:
    """Return the edges of a surface that go through triangles with which they share no corner.

    Two triangles that cross have such an edge: of the one or of the other. Triangles that only touch do not cross.
    """
    pairs = NearPairs.of(points, triangles)
    crosses = pairs.crossing(points)
    edges, corners = pairs.ends[crosses], points[pairs.corners[crosses]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    begins, ends = (np.einsum("ij,ij->i", points[edges[:, end]] - corners[:, 0], normals) for end in (0, 1))
    parts = np.clip(begins / np.where(begins == ends, 1.0, begins - ends), 0.0, 1.0)[:, None]
    places = points[edges[:, 0]] + parts * (points[edges[:, 1]] - points[edges[:, 0]])
    return Crossings(edges, pairs.numbers[crosses], np.minimum(np.abs(begins), np.abs(ends)), places)


def crossings_of(mesh: PolygonMesh) -> Crossings:
    """Return the crossings of a mesh with itself, along whichever diagonal its quads are cut."""
    return find_crossings(mesh.points, both_cuts(mesh))


def crossings_said(mesh: PolygonMesh) -> str | None:
    """Return "crosses itself at 2 places", as the end of a sentence on a mesh; None if it does not."""
    count = len(crossings_of(mesh).edges)
    return f"crosses itself at {count:,} place{'s' if count > 1 else ''}" if count else None


def both_cuts(mesh: PolygonMesh) -> Numbers:
    """Return the triangles of a mesh, those of quads by either diagonal, shape (n, 3)."""
    firsts = face_starts(mesh)[mesh.face_vertex_counts == 4]
    others = [mesh.face_vertex_indices[firsts[:, None] + corners] for corners in ([1, 2, 3], [3, 0, 1])]
    return np.concatenate([triangulate(mesh)[0], *others]).astype(np.int64)


def _near(points: Values, surface: Numbers, room: float) -> Iterator[tuple[Numbers, Numbers]]:
    """Yield ends of edges and numbers of triangles whose boxes, wider by some room, overlap; without shared corners."""
    from scipy.spatial import KDTree  # takes long to load

    sides = np.sort(np.stack([surface, np.roll(surface, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)
    if not len(edges):
        return
    room = room + 4.0 * MOVED * _size(points)
    low, high = (bound(points[edges], axis=1) for bound in (np.min, np.max))
    halves = 0.5 * np.linalg.norm(high - low, axis=1)
    corners, joint = points[surface], _joined_by_slivers(points, surface)
    lower, upper = corners.min(axis=1) - room, corners.max(axis=1) + room
    tree = KDTree(0.5 * (low + high))
    centers, radii = 0.5 * (lower + upper), 0.5 * np.linalg.norm(upper - lower, axis=1) + halves.max()
    for first in range(0, len(surface), ROWS):
        near = tree.query_ball_point(centers[first : first + ROWS], radii[first : first + ROWS], return_sorted=False)
        numbers = np.repeat(np.arange(first, first + len(near)), [len(each) for each in near])
        beside = np.fromiter(chain.from_iterable(near), np.int64, len(numbers))
        for begin, end, least, most in zip(low.T, high.T, lower.T, upper.T, strict=True):
            meet = (begin[beside] <= most[numbers]) & (end[beside] >= least[numbers])
            beside, numbers = beside[meet], numbers[meet]
        apart = (joint[edges[beside]][:, :, None] != joint[surface[numbers]][:, None, :]).all(axis=(1, 2))
        yield edges[beside[apart]], numbers[apart]


def _goes_through(
    points: Values, ends: Numbers, corners: Numbers, moved: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which edges go through their triangles, and for which that is in doubt.

    Args:
        moved: Distance by which points may be off [m].
    """
    (start, end), of_triangle = np.moveaxis(points[ends], 1, 0), points[corners]
    first, second, third = np.moveaxis(of_triangle, 1, 0)
    way, normals = end - start, np.cross(second - first, third - first)
    before, after = ((place - first) * normals for place in (start, end))
    begins, stops = before.sum(axis=1), after.sum(axis=1)
    arms = of_triangle - start[:, None]
    around = np.stack([(way * np.cross(arms[:, k], arms[:, (k + 1) % 3])).sum(axis=1) for k in range(3)])
    lengths = np.linalg.norm(way, axis=1) + np.linalg.norm(np.ptp(of_triangle, axis=1), axis=1)
    sure = CLEAR * moved * lengths**2
    least, most = np.minimum(begins, stops), np.maximum(begins, stops)
    lowest, highest = around.min(axis=0), around.max(axis=0)
    crosses = (least < -sure) & (most > sure) & ((lowest > sure) | (highest < -sure))
    misses = (least > sure) | (most < -sure) | ((lowest < -sure) & (highest > sure))
    return crosses, ~(crosses | misses)


def _normals(points: Values, surface: Numbers) -> Values:
    """Return the unit normals at vertices, shape (n, 3); zeros where there is none."""
    corners = points[surface]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.stack([np.bincount(surface.ravel(), np.repeat(area, 3), len(points)) for area in areas.T], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0.0)


def _joined_by_slivers(points: Values, surface: Numbers) -> Numbers:
    """Return the lowest number of the vertices that triangles of no area join with each, shape (n,).

    Such triangles stand between faces that meet along a line, cut finer on one side of it.
    """
    corners = points[surface]
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    slivers = surface[doubled <= CLEAR * MOVED * _size(points) * longest]
    return component_labels(len(points), np.repeat(slivers[:, 0], 2), slivers[:, 1:].ravel())


def _closed_seams(points: Values, surface: Numbers) -> Numbers:
    """Return the corners of triangles, those on open borders that coincide as one, shape (t, 3)."""
    sides = np.sort(np.stack([surface, np.roll(surface, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    ends, counts = np.unique(sides, axis=0, return_counts=True)
    border = np.unique(ends[counts == 1])
    same = np.arange(len(points))
    same[border] = border[first_coincident(points[border])]
    return same[surface]


def _size(points: Values) -> float:
    return float(np.ptp(points, axis=0).max()) if len(points) else 0.0


ROUNDS, LEFT = 8, 0.4
"""Number of times that changes are held back in part, and the fraction that each time leaves where it crosses"""
STOPPED = 8
"""Number of times more that they are stopped there"""
AROUND = 2
"""Number of rings of neighbors that are held back, too, ever less"""


def uncrossed(
    points: Values,
    triangles: NDArray[np.integer],
    moves: Values,
    together: Any,
    spoiled: Callable[[Values], Any] = lambda points: [],
) -> Values:
    """Return moves of a surface's vertices, less of them where it would cross itself, shape (n, 3).

    It may still cross itself after the last round.

    Args:
        points: of the vertices before they move, shape (n, 3).
        triangles: corners of the surface's triangles, shape (t, 3).
        together: Means over neighbors, shape (n, n).
        spoiled: Function that returns further vertices to be held back, where the vertices are at these points.
    """
    near = NearPairs.of(points, triangles, float(np.linalg.norm(moves, axis=1).max()))

    def wrong(points: Values) -> NDArray[np.int64]:
        crossing = near.crossing(points)
        further = np.asarray(spoiled(points), dtype=np.int64)
        return np.concatenate([near.ends[crossing].ravel(), near.corners[crossing].ravel(), further])

    return _held_back(points, moves, together, wrong)


def without_crossings(before: PolygonMesh, after: PolygonMesh) -> PolygonMesh:
    """Return a mesh whose vertices have moved, less of them where it would cross itself.

    Args:
        before: the same mesh, which does not cross itself, along whichever diagonal its quads are cut.
    """
    triangles, moves = both_cuts(before), after.points - before.points

    def wrong(points: Values) -> NDArray[np.int64]:
        found = find_crossings(points, triangles)
        return np.concatenate([found.edges.ravel(), triangles[found.triangles].ravel()])

    if not len(wrong(after.points)):
        return after
    return replace(after, points=before.points + _held_back(before.points, moves, means_over_neighbors(before), wrong))


def means_over_neighbors(mesh: PolygonMesh) -> Any:
    """Return the matrix of means over each vertex and its neighbors, shape (n, n)."""
    from scipy import sparse  # takes long to load

    ends, count = mesh_edges(mesh).ends, mesh.vertex_count
    both = np.concatenate([ends, ends[:, ::-1], np.stack([np.arange(count)] * 2, axis=1)])
    beside = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
    return sparse.diags(1.0 / np.asarray(beside.sum(axis=1)).ravel()) @ beside


def _held_back(points: Values, moves: Values, together: Any, wrong: Callable[[Values], NDArray[np.int64]]) -> Values:
    """Return moves, less of them around the vertices that are wrong at the points reached."""
    for number in range(ROUNDS + STOPPED):
        vertices = wrong(points + moves)
        if not len(vertices):
            break
        held = np.zeros(len(points))
        held[vertices] = 1.0
        left = LEFT if number < ROUNDS else 0.0
        for _ in range(AROUND):
            held = np.maximum(held, np.minimum(1.0, 2.0 * (together @ held)))
        moves = moves * (1.0 - (1.0 - left) * held)[:, None]
    return moves
