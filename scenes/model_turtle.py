"""The turtle: a domed shell with a flat belly, a slim neck, and four flippers."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.scenes.model_solids import ellipsoid, mirrored, round_cone, smooth_union, tube

CELL = 0.0265


def turtle() -> PolygonMesh:
    """A turtle 1 m long, facing +z. It is a balloon before inflation: its neck is slim and its belly flat."""
    return surface_nets(_distance, lower=[-0.6, -0.05, -0.6], upper=[0.6, 0.55, 0.75], cell=CELL)


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    both = mirrored(points)
    dome = ellipsoid(points, (0.0, 0.11, -0.06), (0.275, 0.235, 0.335))
    belly = 0.085 - points[:, 1]
    shell = -smooth_union(0.05, -dome, -belly)
    rim = ellipsoid(points, (0.0, 0.115, -0.06), (0.325, 0.035, 0.385))
    neck = tube(points, [(0.0, 0.13, 0.22), (0.0, 0.17, 0.34), (0.0, 0.25, 0.42)], [0.06, 0.042, 0.042])
    head = smooth_union(
        0.03,
        ellipsoid(points, (0.0, 0.285, 0.45), (0.085, 0.08, 0.095)),
        ellipsoid(points, (0.0, 0.265, 0.51), (0.06, 0.05, 0.07)),
    )
    flat = both * [1.0, 1.8, 1.0]
    front = round_cone(flat, (0.23, 0.15, 0.16), (0.40, 0.09, 0.30), 0.065, 0.08)
    back = round_cone(flat, (0.20, 0.15, -0.30), (0.30, 0.09, -0.42), 0.055, 0.065)
    tail = round_cone(points, (0.0, 0.10, -0.40), (0.0, 0.07, -0.50), 0.04, 0.015)
    return smooth_union(0.03, shell, rim, smooth_union(0.03, neck, head), front, back, tail)
