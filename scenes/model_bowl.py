"""The bowl: half of a thick spherical shell, open to above, with a round rim."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets

CELL = 0.044
MIDDLE_RADIUS = 0.445
WALL = 0.11


def bowl() -> PolygonMesh:
    """Return a bowl 1 m across, its wall 0.11 m thick."""
    return surface_nets(_distance, lower=[-0.55, -0.55, -0.55], upper=[0.55, 0.1, 0.55], cell=CELL)


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from the middle of the wall, half of a sphere around the origin, less half the wall."""
    x, y, z = points.T
    from_rim = np.hypot(np.hypot(x, z) - MIDDLE_RADIUS, y)
    from_sphere = np.abs(np.linalg.norm(points, axis=1) - MIDDLE_RADIUS)
    return np.where(y > 0.0, from_rim, from_sphere) - 0.5 * WALL
