"""The toy: a party balloon with a neck, which is a little bent, as they are."""

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.scenes.model_solids import ellipsoid, smooth_union, tube

CELL = 0.0125
BEND = 0.0005
"""how far the neck's end is beside the middle [m]"""


def toy() -> PolygonMesh:
    """Return the toy, 17 cm long and 9 cm across before it is inflated."""

    def distance(points: np.ndarray) -> np.ndarray:
        body = ellipsoid(points, (0.0, 0.115, 0.0), (0.045, 0.05, 0.045))
        neck = tube(points, [(BEND, 0.01, 0.0), (0.3 * BEND, 0.04, 0.0), (0.0, 0.075, 0.0)], [0.012, 0.01, 0.018])
        return smooth_union(0.02, body, neck)

    return surface_nets(distance, lower=[-0.06, -0.02, -0.06], upper=[0.06, 0.18, 0.06], cell=CELL)
