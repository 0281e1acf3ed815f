"""Thinness of solids: sheets, rods, and things with walls, legs or fins, however large they are as a whole."""

import numpy as np
import warp as wp

from balloon_warp.mesh.samples import even_samples
from balloon_warp.model.obstacles import ObstacleShape

SAMPLES = 1000
"""Number of samples on the surface of a mesh, spread evenly by area"""
DEPTHS = np.array([0.1, 0.2, 0.4, 0.6, 0.8, 1.0])
"""Depths below a sample at which the mesh is looked for, over the width: walls with a gap behind them count, too"""
PART = 0.02
"""Least part of the surface that is on thin walls, for a thing that is thin: the edge of a wedge is not"""


def is_thin(solid: ObstacleShape, width: float) -> bool:
    """Return whether a solid, or a part of it, is narrower than a width [m]; a sheet is, a plane is not."""
    if solid.kind == "box":
        return 2.0 * float(solid.size.min()) < width
    if solid.kind == "capsule":
        return 2.0 * float(solid.size[0]) < width
    if solid.mesh is None:
        return False
    used = solid.mesh.points[solid.mesh.face_vertex_indices]
    return not solid.closed or float(np.ptp(used, axis=0).min()) < width or _has_thin_parts(solid, width)


def _has_thin_parts(solid: ObstacleShape, width: float) -> bool:
    """Return whether the way straight inward leaves a closed mesh again within a width, from `PART` of its surface."""
    from balloon_warp.mesh.mesh_distance import MeshDistance  # takes long to load

    assert solid.mesh is not None  # as its kind says
    points, normals, _ = even_samples(solid.mesh, SAMPLES)
    behind = points[:, None] - width * DEPTHS[:, None] * normals[:, None]
    with wp.ScopedDevice("cpu"):
        distances = MeshDistance(solid.mesh.points, solid.triangles, thickness=0.0)(behind.reshape(-1, 3))
    leaves = (distances.reshape(SAMPLES, -1) > 0.0).any(axis=1)
    return bool(np.count_nonzero(leaves) >= PART * SAMPLES)
