"""Limits on changes of a surface, so that it does not cross itself."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import NearPairs
from balloon_warp.mesh.geometry import triangulate

Values = NDArray[np.float64]
ROUNDS, LEFT = 8, 0.4
"""Number of times that changes are held back in part, and the fraction that each time leaves where it crosses"""
STOPPED = 8
"""Number of times more that they are stopped there"""
AROUND = 2
"""Number of rings of neighbors that are held back, too, ever less"""


def uncrossed(
    mesh: PolygonMesh, moves: Values, together: Any, spoiled: Callable[[Values], Any] = lambda points: []
) -> Values:
    """Return moves of a mesh's vertices, less of them where it would cross itself, shape (n, 3).

    It may still cross itself after the last round.

    Args:
        together: Means over neighbors, shape (n, n).
        spoiled: Function that returns further vertices to be held back, where the vertices are at these points.
    """
    near = NearPairs.of(mesh.points, triangulate(mesh)[0], float(np.linalg.norm(moves, axis=1).max()))
    for number in range(ROUNDS + STOPPED):
        crossing = near.crossing(mesh.points + moves)
        further = spoiled(mesh.points + moves)
        if not crossing.any() and not len(further):
            break
        held = np.zeros(mesh.vertex_count)
        held[further] = 1.0
        held[near.ends[crossing]] = 1.0
        held[near.corners[crossing]] = 1.0
        left = LEFT if number < ROUNDS else 0.0
        for _ in range(AROUND):
            held = np.maximum(held, np.minimum(1.0, 2.0 * (together @ held)))
        moves = moves * (1.0 - (1.0 - left) * held)[:, None]
    return moves
