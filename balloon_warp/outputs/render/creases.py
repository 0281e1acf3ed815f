"""Creases of a mesh: sharp edges split vertices, so that each side has normals of its own."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import next_corners
from balloon_warp.mesh.folds import find_folds
from balloon_warp.mesh.polygon_mesh import PolygonMesh


class Cut(NamedTuple):
    """A mesh in vertices of one normal each."""

    corner_vertices: NDArray[np.int32]
    """Vertex of each corner of the mesh's faces, shape (corner_count,)"""
    vertex_points: NDArray[np.integer]
    """Point of each vertex, shape (vertex_count,)"""
    creases: NDArray[np.int32]
    """Sharp edges, a pair of vertices each, lower first, those of both sides, shape (crease_count, 2)"""


def leave_whole(mesh: PolygonMesh) -> Cut:
    """Return a vertex for each point."""
    return Cut(mesh.face_vertex_indices, np.arange(mesh.vertex_count), np.empty((0, 2), np.int32))


def cut_at_creases(mesh: PolygonMesh, angle: float) -> Cut:
    """Return a vertex for each point and each smooth part of the surface about it.

    Args:
        angle: between two faces' normals, beyond which their edge is sharp [degrees].
    """
    tails, following = mesh.face_vertex_indices, next_corners(mesh)
    one, other, sharp = find_folds(mesh, angle)
    # Corners at one point are one vertex if faces lead from one to the other across smooth edges.
    pairs = [(a, b) for a in (one, following[one]) for b in (other, following[other])]
    first_corners, second_corners = (np.concatenate(corners) for corners in zip(*pairs, strict=True))
    joined = np.tile(~sharp, len(pairs)) & (tails[first_corners] == tails[second_corners])
    groups = component_labels(len(tails), first_corners[joined], second_corners[joined])
    _, representative, vertices = np.unique(groups, return_index=True, return_inverse=True)
    vertices = vertices.ravel().astype(np.int32)
    creases = np.concatenate([one[sharp], other[sharp]])
    ends = np.sort(np.stack([vertices[creases], vertices[following[creases]]], axis=1), axis=1)
    return Cut(vertices, tails[representative], ends)
