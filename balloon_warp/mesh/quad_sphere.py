"""A sphere of quads."""

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def quad_sphere(cells: int, radius: float) -> PolygonMesh:
    """Return a cube of cells by cells quads a side, blown up to a sphere: 6 cells^2 + 2 vertices, winding outward."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    square = np.stack([[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]])  # (axis, corner, quad)
    corners = []
    for axis in range(3):
        for side in (0, cells):
            quads = np.empty((*square.shape[1:], 3), dtype=np.int64)
            quads[..., axis] = side
            quads[..., (axis + 1) % 3], quads[..., (axis + 2) % 3] = square
            corners.append((quads if side else quads[::-1]).transpose(1, 0, 2))
    places, indices = np.unique(np.concatenate(corners).reshape(-1, 3), axis=0, return_inverse=True)
    points = np.tan((2.0 * places / cells - 1.0) * np.pi / 4.0)  # equal angles, which keeps the quads even
    return PolygonMesh(
        points=radius * points / np.linalg.norm(points, axis=1, keepdims=True),
        face_vertex_counts=np.full(6 * cells**2, 4, dtype=np.int32),
        face_vertex_indices=indices.ravel().astype(np.int32),
        name="balloon",
    )
