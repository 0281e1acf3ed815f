"""Where a mesh is sharp: its vertices come apart there, so that each side has normals of its own."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.geometry import face_vector_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh

CREASE = np.cos(np.radians(40.0))
"""cosine of the angle between two faces' normals beyond which their edge is sharp"""


class Cut(NamedTuple):
    """A mesh in vertices of one normal each."""

    corner_vertices: NDArray[np.int32]
    """the vertex of each corner of the mesh's faces, shape (corner_count,)"""
    vertex_points: NDArray[np.integer]
    """the point that each vertex is at, shape (vertex_count,)"""
    creases: NDArray[np.int32]
    """sharp edges, a pair of vertices each, lower first, those of both sides, shape (crease_count, 2)"""


def leave_whole(mesh: PolygonMesh) -> Cut:
    """A vertex for each point."""
    return Cut(mesh.face_vertex_indices, np.arange(mesh.vertex_count), np.empty((0, 2), np.int32))


def cut_at_creases(mesh: PolygonMesh) -> Cut:
    """A vertex for each point and each smooth part of the surface about it."""
    tails = mesh.face_vertex_indices
    following = next_corners(mesh)
    ends = np.sort(np.stack([tails, tails[following]], axis=1), axis=1)
    order = np.lexsort(ends.T)
    one, other = order[:-1], order[1:]
    neighbors = (ends[one] == ends[other]).all(axis=1)
    one, other = one[neighbors], other[neighbors]
    normals = face_vector_areas(mesh)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    faces = corner_faces(mesh)
    first, second = normals[faces[one]], normals[faces[other]]
    flat = ~first.any(axis=1) | ~second.any(axis=1)  # faces of no area have no side to be on
    smooth = flat | (np.einsum("ij,ij->i", first, second) >= CREASE)

    # Corners at one point are one vertex if faces lead from one to the other across smooth edges.
    pairs = [(a, b) for a in (one, following[one]) for b in (other, following[other])]
    first_corners, second_corners = (np.concatenate(corners) for corners in zip(*pairs, strict=True))
    joined = np.tile(smooth, len(pairs)) & (tails[first_corners] == tails[second_corners])
    groups = component_labels(len(tails), first_corners[joined], second_corners[joined])
    _, representative, vertices = np.unique(groups, return_index=True, return_inverse=True)
    vertices = vertices.ravel().astype(np.int32)
    creases = np.concatenate([one[~smooth], other[~smooth]])
    sharp = np.sort(np.stack([vertices[creases], vertices[following[creases]]], axis=1), axis=1)
    return Cut(vertices, tails[representative], sharp)
