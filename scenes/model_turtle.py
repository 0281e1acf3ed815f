"""The turtle: a domed shell with a flat belly, a slim neck, and four flippers."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.scenes.model_solids import ellipsoid, mirrored, round_cone, smooth_union, torus, tube

CELL = 0.0275


def turtle() -> PolygonMesh:
    """Return a turtle 1 m long, facing +z, before inflation: its neck is slim and its belly flat."""
    return surface_nets(_distance, lower=[-0.6, -0.05, -0.6], upper=[0.6, 0.55, 0.75], cell=CELL)


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    both = mirrored(points)
    # Round in a space that is shorter along the animal.
    oval = points * [1.0, 1.0, 0.84]
    dome = ellipsoid(oval, (0.0, 0.09, -0.06), (0.29, 0.27, 0.29))
    belly = 0.075 - points[:, 1]
    shell = smooth_union(0.02, -smooth_union(0.04, -dome, -belly), torus(oval, (0.0, 0.115, -0.06), 0.285, 0.042))
    neck = tube(points, [(0.0, 0.14, 0.22), (0.0, 0.17, 0.34), (0.0, 0.26, 0.42)], [0.06, 0.046, 0.046])
    head = smooth_union(
        0.05,
        ellipsoid(points, (0.0, 0.31, 0.44), (0.10, 0.092, 0.10)),
        ellipsoid(points, (0.0, 0.28, 0.505), (0.075, 0.06, 0.075)),
    )
    # Flippers are wider than thick.
    flat = both * [1.0, 1.7, 1.0]
    front = tube(flat, [(0.18, 0.18, 0.18), (0.32, 0.15, 0.29), (0.44, 0.08, 0.24)], [0.06, 0.078, 0.045])
    back = tube(flat, [(0.16, 0.17, -0.28), (0.25, 0.13, -0.42), (0.31, 0.08, -0.49)], [0.06, 0.07, 0.045])
    tail = round_cone(points, (0.0, 0.11, -0.38), (0.0, 0.085, -0.51), 0.055, 0.028)
    animal = smooth_union(0.03, shell, neck, front, back, tail)
    return smooth_union(0.03, animal, head)
