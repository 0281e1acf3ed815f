"""A surface that is asked for the place that is nearest to a point."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.measure.nearest_place import nearest_places
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import corner_faces, face_starts
from balloon_warp.mesh.geometry import first_coincident, triangulate
from balloon_warp.mesh.polygon_mesh import PolygonMesh


class PaintedSurface:
    """The triangles of a surface, by the corners of its faces, which have the looks."""

    def __init__(self, surface: PolygonMesh):
        apart = PolygonMesh(
            points=surface.points[surface.face_vertex_indices],
            face_vertex_counts=surface.face_vertex_counts,
            face_vertex_indices=np.arange(len(surface.face_vertex_indices), dtype=np.int32),
        )
        self._surface = surface
        self._middle = apart.points.mean(axis=0)
        self._size = float(np.ptp(apart.points, axis=0).max())
        self._points = self._scaled(apart.points)
        corners, _ = triangulate(apart)
        a, b, c = np.moveaxis(self._points[corners], 1, 0)
        flat = (np.cross(b - a, c - a) == 0.0).all(axis=1)
        self.corners = corners[~flat].astype(np.int64)
        """Corners of each triangle, shape (triangle_count, 3)"""

    def nearest(
        self, points: NDArray[np.float64], among: NDArray[np.int64] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the nearest triangle to each point, shape (n,), and the weights of its corners there, shape (n, 3).

        Args:
            points: in the surface's unit, shape (n, 3).
            among: the triangles that count; all, when missing.
        """
        corners = self.corners if among is None else self.corners[among]
        used, numbers = np.unique(corners, return_inverse=True)
        surface = wp.Mesh(
            points=wp.array(self._points[used], dtype=wp.vec3), indices=wp.array(numbers.ravel(), dtype=wp.int32)
        )
        triangles, weights = wp.zeros(len(points), dtype=wp.int32), wp.zeros(len(points), dtype=wp.vec3)
        at = wp.array(self._scaled(points), dtype=wp.vec3)
        wp.launch(nearest_places, len(points), inputs=[surface.id, at, 1e3], outputs=[triangles, weights])
        found = triangles.numpy().astype(np.int64)
        return found if among is None else among[found], weights.numpy().astype(np.float64)

    def charts(self, places: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the chart of a texture that each triangle is in.

        Faces of a chart are connected where they share vertices, places in the image and the material.

        Args:
            places: texture coordinates at the corners of the surface, shape (corner_count, 2).
        """
        vertices = first_coincident(self._surface.points)[self._surface.face_vertex_indices]
        looks = self._surface.looks
        material = np.full(len(vertices), -1) if looks is None else looks.of_corners
        keys = (material, places[:, 1], places[:, 0], vertices)
        order = np.lexsort(keys)
        alike = np.all([key[order[1:]] == key[order[:-1]] for key in keys], axis=0)
        same = order[np.maximum.accumulate(np.where(np.append(True, ~alike), np.arange(len(order)), 0))]
        firsts = face_starts(self._surface)[corner_faces(self._surface)]
        labels = component_labels(
            len(order), np.concatenate([order, np.arange(len(order))]), np.concatenate([same, firsts])
        )
        return labels[self.corners[:, 0]]

    def _scaled(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points centered and scaled to size 1, since Warp measures in float32."""
        return (points - self._middle) / self._size
