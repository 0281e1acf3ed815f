"""The table: a top and four legs, of cubes."""

from dataclasses import replace

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scenes.model_solids import cubes

CELL = 0.08
CELLS = (15, 9, 15)
"""cubes along each side; the top is one thick, and so are the legs"""


def table() -> PolygonMesh:
    """Return a square table 1.2 m wide and 0.72 m high."""
    filled = np.zeros(CELLS, bool)
    filled[:, -1] = True
    filled[np.ix_((0, -1), range(CELLS[1]), (0, -1))] = True
    mesh = cubes(filled)
    return replace(mesh, points=CELL * (mesh.points - [CELLS[0] / 2, 0.0, CELLS[2] / 2]))
