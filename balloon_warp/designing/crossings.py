"""Crossings of a surface with itself: edges that go through triangles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.designing.measure import Ruler
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges

Values = NDArray[np.float64]
Numbers = NDArray[np.int64]
INSIDE = 1.0e-9
"""Margin inside an edge and a triangle for a crossing, so that touching does not count"""


@dataclass(frozen=True)
class NearPairs:
    """Edges and triangles of a mesh that are near each other, and share no vertex."""

    ends: Numbers
    """Ends of each edge, shape (n, 2)"""
    corners: Numbers
    """Corners of each triangle, shape (n, 3)"""

    @classmethod
    def of(cls, mesh: PolygonMesh, moves: float = 0.0) -> "NearPairs":
        """Return the pairs that may cross once every vertex has moved by at most so much [m]."""
        triangles, ends = Ruler(mesh).triangles, mesh_edges(mesh).ends
        corners, segments = mesh.points[triangles], mesh.points[ends]
        middles, halves = segments.mean(axis=1), 0.5 * np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        centers = corners.mean(axis=1)
        radii = np.linalg.norm(corners - centers[:, None], axis=2).max(axis=1) + 2.0 * moves
        near = KDTree(centers).query_ball_point(middles, halves + radii.max(), return_sorted=False)
        edge = np.repeat(np.arange(len(ends)), [len(each) for each in near])
        triangle = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
        apart = np.linalg.norm(middles[edge] - centers[triangle], axis=1) < halves[edge] + radii[triangle]
        first, second = ends[edge[apart]].astype(np.int64), triangles[triangle[apart]]
        shares = (first[:, :, None] == second[:, None, :]).any(axis=(1, 2))
        return cls(first[~shares], second[~shares])

    def crossing(self, points: Values) -> NDArray[np.bool_]:
        """Return which pairs cross where the vertices are at these points, shape (n,)."""
        return _goes_through(points[self.ends], points[self.corners])


def crossing_count(mesh: PolygonMesh) -> int:
    """Count the pairs of an edge and a triangle that it goes through."""
    return int(NearPairs.of(mesh).crossing(mesh.points).sum())


def _goes_through(segments: Values, corners: Values) -> NDArray[np.bool_]:
    """Return whether each segment goes through its triangle (Moeller and Trumbore), shape (n,)."""
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(way, second)
    det = (first * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        arm = start - corners[:, 0]
        u = (arm * across).sum(axis=1) / det
        other = np.cross(arm, first)
        v, t = (way * other).sum(axis=1) / det, (second * other).sum(axis=1) / det
        return (u > INSIDE) & (v > INSIDE) & (u + v < 1.0 - INSIDE) & (t > INSIDE) & (t < 1.0 - INSIDE)
