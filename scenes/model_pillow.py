"""The pillow: a square cushion, pinched along its seam, with pointed corners."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh

QUADS_A_SIDE = 26
HALF_WIDTH = 0.5
HALF_THICKNESS = 0.125
HALF_SEAM = 0.012
PULLED_IN = 0.09


def pillow() -> PolygonMesh:
    """Return a cushion 1 m wide and 0.25 m thick: two square sheets of quads, and a band of quads as its seam.

    Each sheet shows all of an image, as it is seen from above.
    """
    steps = QUADS_A_SIDE + 1
    u, v = np.meshgrid(*[np.linspace(-1.0, 1.0, steps)] * 2, indexing="ij")
    # The middle of each side is pulled in, so that the corners point.
    x = HALF_WIDTH * u * (1.0 - PULLED_IN * u**2 * (1.0 - v**2))
    z = HALF_WIDTH * v * (1.0 - PULLED_IN * v**2 * (1.0 - u**2))
    y = HALF_SEAM + (HALF_THICKNESS - HALF_SEAM) * ((1.0 - u**2) * (1.0 - v**2)) ** 0.6
    above = np.stack([x, y, z], axis=-1).reshape(-1, 3)

    top = np.arange(steps * steps).reshape(steps, steps)
    bottom = top + steps * steps
    seam = np.concatenate([top[:-1, 0], top[-1, :-1], top[:0:-1, -1], top[0, :0:-1]])
    after = np.roll(seam, -1)
    band = np.stack([seam, after, after + steps * steps, seam + steps * steps], axis=1)
    quads = np.concatenate([_sheet(top.T), _sheet(bottom), band]).astype(np.int32)
    above_places = 0.5 + 0.5 * np.stack([u, -v], axis=-1).reshape(-1, 2)
    places = np.concatenate([above_places, above_places]).astype(np.float32)
    return PolygonMesh(
        points=np.concatenate([above, above * [1.0, -1.0, 1.0]]),
        face_vertex_counts=np.full(len(quads), 4, dtype=np.int32),
        face_vertex_indices=quads.ravel(),
        texture_coordinates=places[quads.ravel()],
    )


def _sheet(vertices: NDArray[np.int_]) -> NDArray[np.int_]:
    """Quads of a grid of vertices, shape (quad_count, 4)."""
    return np.stack([vertices[:-1, :-1], vertices[1:, :-1], vertices[1:, 1:], vertices[:-1, 1:]], axis=-1).reshape(
        -1, 4
    )
