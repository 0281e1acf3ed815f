"""Walking the corners of a mesh: a corner is one entry of `face_vertex_indices`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def face_starts(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the first corner of each face, shape (face_count,)."""
    return np.cumsum(mesh.face_vertex_counts, dtype=np.int64) - mesh.face_vertex_counts


def corner_faces(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the face of each corner, shape (corner_count,)."""
    return np.repeat(np.arange(mesh.face_count), mesh.face_vertex_counts)


def next_corners(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the corner that follows each corner around its face, shape (corner_count,)."""
    following = np.arange(1, len(mesh.face_vertex_indices) + 1)
    starts = face_starts(mesh)
    following[starts + mesh.face_vertex_counts - 1] = starts
    return following


def corners_beside(mesh: PolygonMesh, gone: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the corners of all faces; those of a face that is gone are all at its first vertex.

    Args:
        gone: shape (face_count,).
    """
    places = np.arange(len(mesh.face_vertex_indices))
    faces = corner_faces(mesh)
    return mesh.face_vertex_indices[np.where(gone[faces], face_starts(mesh)[faces], places)]


def beside_faces(mesh: PolygonMesh, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of the vertices that still have a face, shape (vertex_count,); all where no face is left.

    Args:
        gone: shape (face_count,).
    """
    held = np.zeros(mesh.vertex_count, dtype=bool)
    held[mesh.face_vertex_indices[~gone[corner_faces(mesh)]]] = True
    return held if held.any() else ~held


def with_corners(mesh: PolygonMesh, corners: NDArray[np.integer | np.bool_]) -> PolygonMesh:
    """Return the mesh with some of its corners, in order or by a mask, and all that belongs to them."""
    textures = mesh.texture_coordinates
    return replace(
        mesh,
        face_vertex_indices=mesh.face_vertex_indices[corners],
        texture_coordinates=None if textures is None else textures[corners],
        looks=mesh.looks and mesh.looks.at(corners),
    )


def backward_corners(mesh: PolygonMesh) -> NDArray[np.integer]:
    """Return the corners of all faces with each face run backwards, as numbers for `with_corners`."""
    return flip_faces(mesh.face_vertex_counts, np.arange(len(mesh.face_vertex_indices)))


def flipped(mesh: PolygonMesh, flip: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with some faces, by a mask of shape (face_count,), run backwards."""
    at_corners = flip[corner_faces(mesh)]
    return with_corners(mesh, np.where(at_corners, backward_corners(mesh), np.arange(len(at_corners))))


def flip_faces(counts: NDArray[np.integer], indices: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the corners of all faces with each face run backwards from the same first corner.

    Args:
        counts: corners of each face, shape (face_count,), all at least 1.
        indices: corners of all faces, shape (corner_count,).
    """
    starts = np.cumsum(counts, dtype=np.int64) - counts
    place = np.arange(len(indices)) - np.repeat(starts, counts)
    sizes = np.repeat(counts, counts)
    return indices[np.repeat(starts, counts) + (sizes - place) % sizes]


def edges_of(mesh: PolygonMesh) -> NDArray[np.int32]:
    """Return each pair of vertices that is a side of a face, once, lower first, shape (edge_count, 2)."""
    corners = mesh.face_vertex_indices
    sides = np.stack([corners, corners[next_corners(mesh)]], axis=1)
    return np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32)
