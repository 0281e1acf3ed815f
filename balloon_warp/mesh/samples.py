"""Samples of a surface, spread evenly by area."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.polygon_mesh import PolygonMesh


def even_samples(mesh: PolygonMesh, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.integer]]:
    """Return samples of the surface, shape (count, 3), their normals, and the vertices next to them, shape (count,).

    As many for each triangle as its area has, in a fixed order (the golden ratio's, within a triangle).
    """
    triangles, _ = triangulate(mesh)
    corners = mesh.points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    ends = np.cumsum(areas) / areas.sum()
    places = (np.arange(count) + 0.5) / count
    chosen = np.minimum(np.searchsorted(ends, places), len(areas) - 1)
    u, v = (places * count * 0.7548776662) % 1.0, (places * count * 0.5698402910) % 1.0
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    points = np.einsum("nc,nci->ni", weights, corners[chosen])
    nearest = triangles[chosen, weights.argmax(axis=1)]
    return points, normals[chosen] / areas[chosen, None], nearest
