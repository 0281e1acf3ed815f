"""The bead: a little round balloon of few particles, of which a scene may have many."""

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scenes.model_solids import cubes

RADIUS = 0.1
CELLS = 3
"""quads along an edge of the cube that it is blown up from"""


def bead() -> PolygonMesh:
    """Return a sphere 20 cm across, of 56 particles."""
    mesh = cubes(np.ones((CELLS,) * 3, bool))
    # places at equal angles, so that quads are as even on the sphere
    angles = np.tan(0.25 * np.pi * (2.0 * mesh.points / CELLS - 1.0))
    sphere = angles / np.linalg.norm(angles, axis=1, keepdims=True)
    return PolygonMesh(RADIUS * sphere, mesh.face_vertex_counts, mesh.face_vertex_indices)
