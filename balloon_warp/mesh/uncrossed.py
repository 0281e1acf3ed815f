"""Limits on changes of a surface, so that it does not cross itself."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.crossings import NearPairs, both_cuts, find_crossings
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges

Values = NDArray[np.float64]
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
