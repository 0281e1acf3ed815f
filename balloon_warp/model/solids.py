"""Distances to obstacles and bodies, on the host in float64."""

from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp.mesh.surface_nets import MeshDistance
from balloon_warp.model.obstacles import ObstacleShape


class Solid:
    """An obstacle or a body, turned, and how far points are from its surface."""

    def __init__(self, shape: ObstacleShape, up: NDArray[np.float64], turn: Rotation):
        self.shape, self._up = shape, up
        self.matrix = turn.as_matrix()

    def seen(self, points: NDArray[np.float64], centers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the world, shape (W, n, 3), relative to the obstacle's center in each, shape (W or 1, 3)."""
        return (points - centers[:, None]) @ self.matrix

    @cached_property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest corner of the box around it, as seen from its center, shape (3,)."""
        if self.shape.mesh is not None:
            used = self.shape.mesh.points[self.shape.mesh.face_vertex_indices]
            lowest, highest = used.min(axis=0), used.max(axis=0)
        elif self.shape.kind == "plane":
            highest = np.where(self._up > 0.0, 0.0, np.inf)
            lowest = np.full(3, -np.inf)
        else:
            highest = self.shape.size
            if self.shape.kind == "capsule":
                highest = self.shape.size[0] + self.shape.size[1] * self._up
            lowest = -highest
        return lowest - self.shape.thickness, highest + self.shape.thickness

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances of points, relative to the center, to the surface less its thickness, shape (n,)."""
        size = self.shape.size
        if self.shape.kind == "box":
            beyond = np.abs(points) - size
            found = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
        elif self.shape.kind == "capsule":
            along = np.clip(points @ self._up, -size[1], size[1])
            found = np.linalg.norm(points - np.outer(along, self._up), axis=1) - size[0]
        elif self.shape.kind == "plane":
            found = points @ self._up
        else:
            found = self._to_mesh(points)
        return found - self.shape.thickness

    def _to_mesh(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        with wp.ScopedDevice("cpu"):
            return self._mesh_distance(points)

    @cached_property
    def _mesh_distance(self) -> MeshDistance:
        assert self.shape.mesh is not None
        return MeshDistance(self.shape.mesh.points, self.shape.triangles, thickness=0.0)
