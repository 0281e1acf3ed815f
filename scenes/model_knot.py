"""The knot: a long balloon, tied in an overhand knot that is still loose."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.scenes.model_solids import tube

CELL = 0.018
RADIUS = 0.035
SIZE = 0.075
"""of the trefoil, which is six times as wide"""
OPENING = 0.25
"""of the trefoil, where its tails go out"""
TAIL = 6.0
"""how far along x, over `SIZE`"""


def knot() -> PolygonMesh:
    """Return a tube 1 m wide from tip to tip, along x."""
    path = SIZE * _path()
    reach = 1.5 * RADIUS

    def distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return tube(points, path, np.full(len(path), RADIUS))

    lower, upper = path.min(axis=0) - reach, path.max(axis=0) + reach
    return surface_nets(distance, lower=lower.tolist(), upper=upper.tolist(), cell=CELL)


def _path() -> NDArray[np.float64]:
    """Return a trefoil (sin t + 2 sin 2t, 2 cos 2t - cos t, -1.4 sin 3t), shape (n, 3).

    It is open at its top, from where tails go on past each other to both sides.
    """
    t = np.linspace(np.pi + OPENING, 3.0 * np.pi - OPENING, 60)
    across, up = np.sin(t) + 2.0 * np.sin(2.0 * t), 2.0 * np.cos(2.0 * t) - np.cos(t)
    loop = np.stack([across, up, -1.4 * np.sin(3.0 * t)], axis=1)
    far = np.linspace(1.0, TAIL, 11)
    tail = np.stack([far, np.full(11, 3.0), (far - TAIL) / (TAIL - 1.0)], axis=1)
    return np.concatenate([tail[::-1] * [-1.0, 1.0, -1.0], loop, tail])
