"""Two sheets sewn at their rims."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.foil.sheet import Sheet
from balloon_warp.mesh.polygon_mesh import PolygonMesh

SLACK = 0.05
"""Distance of either sheet from the plane of the rim, so that there is an inside [edges]; edges are 0.1% longer"""

DIGITS = 4
"""Number of digits of coordinates after the first of an edge"""


def sewn(sheets: Sequence[Sheet], edge: float, name: str) -> PolygonMesh:
    """Return a closed mesh of two of each of these sheets, back to back, which share the rim's vertices.

    It has y up and faces z.

    Args:
        edge: about how long edges are [m].
    """
    points, quads, count = [], [], 0
    for sheet in sheets:
        inner = np.flatnonzero(~sheet.rim)
        lift = np.where(sheet.rim, 0.0, SLACK * edge)
        front = np.column_stack([sheet.points, lift])
        back = np.arange(len(front))
        back[inner] = len(front) + np.arange(len(inner))
        points += [front, front[inner] * [1.0, 1.0, -1.0]]
        quads += [count + sheet.quads, count + back[sheet.quads[:, ::-1]]]
        count += len(front) + len(inner)
    corners = np.concatenate(quads).astype(np.int32)
    decimals = DIGITS - int(np.floor(np.log10(edge)))
    return PolygonMesh(
        points=np.asarray(np.round(np.concatenate(points), decimals) + 0.0, dtype=np.float64),  # turns -0.0 into 0.0
        face_vertex_counts=np.full(len(corners), 4, dtype=np.int32),
        face_vertex_indices=corners.ravel(),
        name=name,
        unit_known=True,
    )
