"""Signed distance to a mesh that may have holes, cracks and parts without thickness, through Warp's mesh queries."""

from typing import Any

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.measure.signed_distance import signed_distances, unsigned_distances
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.warp_lock import lock_of

SLAB = 1.5
"""Thickness below which something is thin, and of its slab, over the given thickness"""


class MeshDistance:
    """Distance to a triangle mesh, negative inside, where its winding number is above one half.

    Parts thinner than 1.5 times `thickness`, a sheet among them, count as a slab of that about the surface: a rod that
    is thicker has a node of a grid of that width in every cell along it, wherever it lies. So does such a slab;
    but not the edge of a wedge nor the tip of a cone, which are thin for a short way only. With 0, no part does.
    """

    def __init__(self, points: NDArray[np.float64], triangles: NDArray[np.integer[Any]], thickness: float):
        """Take points of shape (n, 3), outward triangles of shape (m, 3), and a thickness in the points' unit."""
        self._farthest = 10.0 * float(np.linalg.norm(np.ptp(points, axis=0))) + 10.0 * thickness
        self.half_slab = 0.5 * SLAB * thickness
        """Distance of a slab's surface from its source"""
        self._mesh = _warp_mesh(points, triangles, winding_number=True)
        self._sheets = self._thin_parts(points, triangles, thickness) if thickness > 0.0 else None

    @property
    def has_thin_parts(self) -> bool:
        """Return whether any part counts as a slab."""
        return self._sheets is not None

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of points of shape (n, 3), shape (n,)."""
        distances = self.solid(points)
        if self._sheets is None:
            return distances
        return np.minimum(distances, self._query(unsigned_distances, self._sheets, points) - self.half_slab)

    def solid(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of points of shape (n, 3) to the mesh itself, without slabs, shape (n,)."""
        return self._query(signed_distances, self._mesh, points)

    def on_slabs(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the points of shape (n, 3) at the zero level that are about at a slab's, shape (n,)."""
        if self._sheets is None:
            return np.zeros(len(points), dtype=bool)
        return self._query(unsigned_distances, self._sheets, points) < 1.3 * self.half_slab

    def _thin_parts(
        self, points: NDArray[np.float64], triangles: NDArray[np.integer[Any]], thickness: float
    ) -> wp.Mesh | None:
        """Return the surface where nothing solid lies behind it, in pieces no longer than the thickness."""
        points, triangles, *_ = trimesh.remesh.subdivide_to_size(points, triangles, thickness, max_iter=30)
        corners = points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        triangles, centers = triangles[lengths > 0.0], corners.mean(axis=1)[lengths > 0.0]
        depth = SLAB * thickness * normals[lengths > 0.0] / lengths[lengths > 0.0, None]
        behind = self._query(signed_distances, self._mesh, centers - depth)
        thin = behind > 0.0

        # Worth it only where a part reaches away from anything thick.
        reaching = thin.copy()
        if not thin.all():
            thick = _warp_mesh(points, triangles[~thin])
            reaching[thin] = self._query(unsigned_distances, thick, centers[thin]) > 2.0 * thickness
        parts = _part_labels(points, triangles[thin])
        parts_kept = np.isin(parts, parts[reaching[thin]])
        return _warp_mesh(points, triangles[thin][parts_kept]) if parts_kept.any() else None

    def _query(self, kernel: Any, mesh: wp.Mesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
        with lock_of(wp.get_device()):
            distances = wp.empty(len(points), dtype=float)
            at = wp.array(points, dtype=wp.vec3)
            wp.launch(kernel, len(points), inputs=[mesh.id, at, self._farthest], outputs=[distances])
            return distances.numpy().astype(np.float64)


def _part_labels(points: NDArray[np.float64], triangles: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return labels that connected triangles share, shape (triangle_count,)."""
    a, b, c = first_coincident(points)[triangles].T
    return component_labels(len(points), np.concatenate([a, a]), np.concatenate([b, c]))[a]


def _warp_mesh(
    points: NDArray[np.float64], triangles: NDArray[np.integer[Any]], winding_number: bool = False
) -> wp.Mesh:
    with lock_of(wp.get_device()):
        return wp.Mesh(
            points=wp.array(points, dtype=wp.vec3),
            indices=wp.array(triangles.ravel(), dtype=wp.int32),
            support_winding_number=winding_number,
        )
