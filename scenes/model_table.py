"""The table: a top and four legs, of cubes."""

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh

CELL = 0.08
CELLS = (15, 9, 15)
"""cubes along each side; the top is one thick, and so are the legs"""


def table() -> PolygonMesh:
    """A square table 1.2 m wide and 0.72 m high: the faces between cubes that are filled and those that are not."""
    filled = np.zeros(CELLS, bool)
    filled[:, -1] = True
    filled[np.ix_((0, -1), range(CELLS[1]), (0, -1))] = True
    quads = []
    for axis in range(3):
        across, along = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        for side in (0, 1):
            beyond = np.roll(np.pad(filled, 1), -1 if side else 1, axis)[1:-1, 1:-1, 1:-1]
            corner = np.argwhere(filled & ~beyond) + side * np.eye(3, dtype=int)[axis]
            quad = np.stack([corner, corner + across, corner + across + along, corner + along], axis=1)
            quads.append(quad if side else quad[:, ::-1])  # they look outward
    places, indices = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    return PolygonMesh(
        points=CELL * (places - [CELLS[0] / 2, 0.0, CELLS[2] / 2]),
        face_vertex_counts=np.full(len(indices.ravel()) // 4, 4, dtype=np.int32),
        face_vertex_indices=indices.ravel().astype(np.int32),
    )
