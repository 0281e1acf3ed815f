"""The squirrel: it sits upright, its paws at its chest, before the tail that rises above its head."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.scenes.model_solids import ellipsoid, mirrored, round_cone, smooth_union, tube

CELL = 0.0295


def squirrel() -> PolygonMesh:
    """A squirrel 1 m tall, facing +z. It is a balloon before inflation: tail and feet are flat."""
    return surface_nets(_distance, lower=[-0.35, -0.05, -0.55], upper=[0.35, 1.1, 0.45], cell=CELL)


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    both = mirrored(points)
    torso = smooth_union(
        0.10,
        ellipsoid(points, (0.0, 0.22, 0.0), (0.165, 0.205, 0.15)),
        ellipsoid(points, (0.0, 0.38, 0.03), (0.115, 0.14, 0.11)),
    )
    head = smooth_union(
        0.04,
        ellipsoid(points, (0.0, 0.605, 0.06), (0.16, 0.135, 0.14)),
        ellipsoid(both, (0.085, 0.555, 0.125), 0.075),
        ellipsoid(points, (0.0, 0.57, 0.205), (0.055, 0.047, 0.06)),
    )
    flat_ear = both * [1.0, 1.0, 1.4]
    ear = round_cone(flat_ear, (0.095, 0.70, 0.06), (0.145, 0.825, 0.05), 0.065, 0.024)
    arm = tube(both, [(0.10, 0.43, 0.06), (0.145, 0.34, 0.11), (0.03, 0.36, 0.185)], [0.05, 0.05, 0.042])
    thigh = ellipsoid(both, (0.13, 0.15, 0.06), (0.08, 0.13, 0.145))
    foot = ellipsoid(both, (0.115, 0.036, 0.18), (0.068, 0.036, 0.13))
    animal = smooth_union(0.05, torso, head)
    animal = smooth_union(0.03, animal, ear, arm, thigh, foot)
    return smooth_union(0.05, animal, _tail(points))


def _tail(points: NDArray[np.float64]) -> NDArray[np.float64]:
    # Wider than thick: squeezed sideways, it is a round tube.
    squeezed = points * [0.62, 1.0, 1.0]
    path = [
        (0.0, 0.10, -0.10),
        (0.0, 0.11, -0.23),
        (0.0, 0.24, -0.335),
        (0.0, 0.42, -0.33),
        (0.0, 0.60, -0.25),
        (0.0, 0.77, -0.20),
        (0.0, 0.90, -0.245),
        (0.0, 0.965, -0.32),
        (0.0, 0.98, -0.375),
    ]
    return tube(squeezed, path, [0.05, 0.055, 0.07, 0.08, 0.088, 0.088, 0.07, 0.045, 0.024])
