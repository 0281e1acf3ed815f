"""Boxes as quads whose edges are a little round, as those of all real things are: they catch the light."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh

OF_LARGEST, OF_LEAST = 0.02, 0.25
"""Largest radius of the edges over the largest and over the least side"""
STEPS = np.radians([15.0, 30.0, 45.0])
"""Angles along an edge's quarter circle, from either side to its middle"""
RIM = 0.3
"""Width of the flat strip beside the edges, in radii: normals that a renderer finds bend there alone"""


def beveled_box(half: NDArray[np.float64]) -> tuple[PolygonMesh, NDArray[np.float64]]:
    """Return a box about the origin, and the unit normal of each of its points, shape (vertex_count, 3).

    Args:
        half: half its sides, shape (3,); the flat parts of its faces lie there exactly.
    """
    radius = 2.0 * min(OF_LARGEST * float(half.max()), OF_LEAST * float(half.min()))
    inner = half - radius
    edge = np.concatenate([[-RIM, 0.0], np.tan(STEPS)]) * radius
    lines = [np.concatenate([-(length + edge)[::-1], length + edge]) for length in inner]
    count = 2 * len(edge)
    corner = count * np.arange(count - 1)[:, None] + np.arange(count - 1)
    quad = np.stack([corner, corner + count, corner + count + 1, corner + 1], axis=-1).reshape(-1, 4)
    points, quads = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            u, v = np.meshgrid(lines[(axis + 1) % 3], lines[(axis + 2) % 3], indexing="ij")
            side = np.empty((count * count, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign * half[axis], u.ravel(), v.ravel()
            quads.append(len(points) * count * count + (quad if sign > 0.0 else quad[:, ::-1]))
            points.append(side)
    cube = np.concatenate(points)
    core = np.clip(cube, -inner, inner)
    normals = (cube - core) / np.linalg.norm(cube - core, axis=1, keepdims=True)
    _, first, same = np.unique(np.round(cube / half, 9), axis=0, return_index=True, return_inverse=True)
    corners = same.ravel()[np.concatenate(quads)].astype(np.int32)
    box = PolygonMesh((core + radius * normals)[first], np.full(len(corners), 4, np.int32), corners.ravel())
    return box, normals[first]
