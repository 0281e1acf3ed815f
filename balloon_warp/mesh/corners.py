"""Walking the corners of a mesh: a corner is one entry of `face_vertex_indices`."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def face_starts(mesh: PolygonMesh) -> NDArray[np.int64]:
    """The first corner of each face, shape (face_count,)."""
    return np.cumsum(mesh.face_vertex_counts, dtype=np.int64) - mesh.face_vertex_counts


def corner_faces(mesh: PolygonMesh) -> NDArray[np.int64]:
    """The face of each corner, shape (corner_count,)."""
    return np.repeat(np.arange(mesh.face_count), mesh.face_vertex_counts)


def next_corners(mesh: PolygonMesh) -> NDArray[np.int64]:
    """The corner that follows each corner around its face, shape (corner_count,)."""
    following = np.arange(1, len(mesh.face_vertex_indices) + 1)
    starts = face_starts(mesh)
    following[starts + mesh.face_vertex_counts - 1] = starts
    return following


def flip_faces(counts: NDArray[np.int32], indices: NDArray[np.int32]) -> NDArray[np.int32]:
    """The corners of all faces with each face run backwards from the same first corner.

    Args:
        counts: corners of each face, shape (face_count,), all at least 1.
        indices: corners of all faces, shape (corner_count,).
    """
    starts = np.cumsum(counts, dtype=np.int64) - counts
    place = np.arange(len(indices)) - np.repeat(starts, counts)
    sizes = np.repeat(counts, counts)
    return indices[np.repeat(starts, counts) + (sizes - place) % sizes]
