"""Meshes as rays see them: triangles, refined until their outline looks round, with smooth normals."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate, vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh

MOST_TRIANGLES = 25_000
"""refine no further than this: beyond it, triangles are small enough in a picture"""


class SmoothSurface:
    """The fixed part of a mesh: what its triangles are, and between which vertices new ones are put.

    A new vertex lies on the curve through an edge's ends that meets their normals at right angles, as in PN triangles
    (Vlachos et al. 2001, "Curved PN Triangles"); the old vertices stay where they are.

    Args:
        mesh: its topology is kept; its points may differ from frame to frame.
    """

    def __init__(self, mesh: PolygonMesh):
        self._mesh = mesh
        self.triangles, _ = triangulate(mesh)
        self._edges: list[NDArray[np.int32]] = []
        vertex_count = mesh.vertex_count
        while 0 < 4 * len(self.triangles) <= MOST_TRIANGLES and len(self._edges) < 2:
            edges, self.triangles = _split(self.triangles, vertex_count)
            vertex_count += len(edges)
            self._edges.append(edges)

    def refined(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values at the mesh's points, shape (point_count, k), and midway at the new vertices."""
        for edges in self._edges:
            values = np.concatenate([values, 0.5 * (values[edges[:, 0]] + values[edges[:, 1]])])
        return values

    def place(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """All vertices for some points, and their unit normals, each of shape (vertex_count, 3)."""
        normals = vertex_normals(replace(self._mesh, points=points))
        for edges in self._edges:
            begin, end = points[edges[:, 0]], points[edges[:, 1]]
            normal_begin, normal_end = normals[edges[:, 0]], normals[edges[:, 1]]
            span = end - begin
            bulge = _dot(span, normal_end) * normal_end - _dot(span, normal_begin) * normal_begin
            points = np.concatenate([points, 0.5 * (begin + end) + 0.125 * bulge])
            between = normal_begin + normal_end
            length = np.linalg.norm(between, axis=1, keepdims=True)
            normals = np.concatenate(
                [normals, np.where(length > 0.0, between / np.maximum(length, 1e-30), normal_begin)]
            )
        return points, normals


def _split(triangles: NDArray[np.int32], vertex_count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Each triangle in four: the edges that get a vertex, in order, and the new triangles."""
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges, side_edge = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    middle = (vertex_count + side_edge.reshape(-1, 3)).astype(np.int32)
    corners = np.concatenate([triangles, middle], axis=1)
    return edges, corners[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)[:, None]
