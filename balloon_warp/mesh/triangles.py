"""Faces as the triangles that contact takes them for."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import face_starts, triangulate
from balloon_warp.mesh.polygon_mesh import PolygonMesh

SHORTER = 1.0 - 1.0e-5
"""Ratio of diagonals above which they count as equal, and the first corner's is taken"""


def triangles_of(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Cut quads along their shorter diagonal, and others into fans from the first corner, shape (triangle_count, 3)."""
    corners = np.array(mesh.face_vertex_indices, dtype=np.int64)
    firsts = face_starts(mesh)[mesh.face_vertex_counts == 4]
    quads = corners[firsts[:, None] + np.arange(4)]
    ends = mesh.points[quads]
    first, second = (np.linalg.norm(ends[:, corner] - ends[:, corner + 2], axis=1) for corner in (0, 1))
    turned = second < SHORTER * first
    corners[firsts[turned, None] + np.arange(4)] = np.roll(quads[turned], -1, axis=1)
    cut = PolygonMesh(mesh.points, mesh.face_vertex_counts, corners.astype(np.int32))
    return triangulate(cut)[0].astype(np.int64).reshape(-1, 3)
