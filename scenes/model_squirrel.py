"""The squirrel: it sits upright, its paws at its chest, before the tail that rises above its head."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.scenes.model_solids import ellipsoid, mirrored, round_cone, smooth_union, tube

CELL = 0.0316


def squirrel() -> PolygonMesh:
    """Return a squirrel 1 m tall, facing +z, before inflation: tail and feet are flat."""
    return surface_nets(_distance, lower=[-0.35, -0.05, -0.55], upper=[0.35, 1.1, 0.45], cell=CELL)


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    both = mirrored(points)
    torso = smooth_union(
        0.10,
        ellipsoid(points, (0.0, 0.22, 0.0), (0.162, 0.208, 0.137)),
        ellipsoid(points, (0.0, 0.38, 0.03), (0.11, 0.135, 0.105)),
    )
    head = smooth_union(
        0.05,
        ellipsoid(points, (0.0, 0.625, 0.06), (0.165, 0.143, 0.143)),
        ellipsoid(both, (0.08, 0.575, 0.11), (0.085, 0.078, 0.085)),
        ellipsoid(points, (0.0, 0.575, 0.2), (0.052, 0.045, 0.06)),
    )
    flat_ear = both * [1.0, 1.0, 1.3]
    ear = round_cone(flat_ear, (0.085, 0.73, 0.04), (0.112, 0.835, 0.03), 0.064, 0.036)
    arm = tube(both, [(0.10, 0.44, 0.05), (0.14, 0.335, 0.10), (0.032, 0.395, 0.175)], [0.05, 0.048, 0.044])
    thigh = ellipsoid(both, (0.125, 0.15, 0.06), (0.08, 0.125, 0.14))
    foot = ellipsoid(both, (0.115, 0.036, 0.18), (0.068, 0.036, 0.13))
    animal = smooth_union(0.05, torso, head)
    animal = smooth_union(0.03, animal, ear, arm, thigh, foot)
    return smooth_union(0.05, animal, _tail(points))


def _tail(points: NDArray[np.float64]) -> NDArray[np.float64]:
    # Almost twice as wide as thick: squeezed sideways, it is a round tube.
    squeezed = points * [0.56, 1.0, 1.0]
    path = [
        (0.0, 0.10, -0.10),
        (0.0, 0.11, -0.23),
        (0.0, 0.24, -0.335),
        (0.0, 0.42, -0.33),
        (0.0, 0.60, -0.25),
        (0.0, 0.76, -0.20),
        (0.0, 0.88, -0.22),
        (0.0, 0.955, -0.285),
        (0.0, 0.99, -0.36),
    ]
    return tube(squeezed, path, [0.044, 0.05, 0.062, 0.073, 0.081, 0.083, 0.071, 0.044, 0.019])
