"""The slot: a plate with a square hole."""

from dataclasses import replace

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scenes.model_solids import cubes

CELL = 0.04
CELLS = (21, 1, 21)
HOLE = 7
"""cells along its edge"""


def slot() -> PolygonMesh:
    """84 cm wide and 4 cm thick, with a hole of 28 cm in its middle."""
    filled = np.ones(CELLS, bool)
    begin = (CELLS[0] - HOLE) // 2
    filled[begin : begin + HOLE, :, begin : begin + HOLE] = False
    mesh = cubes(filled)
    return replace(mesh, points=CELL * (mesh.points - [CELLS[0] / 2, 0.0, CELLS[2] / 2]))
