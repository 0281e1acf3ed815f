"""Edges at which a surface is sharp."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.geometry import face_vector_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh

CREASE = 40.0
"""Angle between two faces' normals above which their edge is sharp, on rigid meshes [degrees]"""
SOFT_CREASE = 60.0
"""Angle above which an edge is sharp at the start on deformable meshes [degrees]: a balloon is rounder than its
faces"""


class Folds(NamedTuple):
    """Edges that two faces share, as the corner of each at which it begins there."""

    one: NDArray[np.integer]
    """Corners at the edges, shape (edge_count,)"""
    other: NDArray[np.integer]
    """Corners of the faces across the edges, shape (edge_count,)"""
    sharp: NDArray[np.bool_]
    """Mask of sharp edges, shape (edge_count,)"""


def find_folds(mesh: PolygonMesh, angle: float) -> Folds:
    """Find the edges that two faces share, and which of them are sharp.

    Sharp edges go around or from border to border. An edge that ends on a smooth face is a bump of a coarse mesh.

    Args:
        angle: between two faces' normals, beyond which their edge is sharp [degrees].
    """
    tails = mesh.face_vertex_indices
    ends = np.sort(np.stack([tails, tails[next_corners(mesh)]], axis=1), axis=1)
    order = np.lexsort(ends.T)
    one, other = order[:-1], order[1:]
    neighbors = (ends[one] == ends[other]).all(axis=1)
    alone = np.ones(len(ends), bool)
    alone[one[neighbors]] = alone[other[neighbors]] = False
    one, other = one[neighbors], other[neighbors]
    normals = face_vector_areas(mesh)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    faces = corner_faces(mesh)
    first, second = normals[faces[one]], normals[faces[other]]
    has_sides = first.any(axis=1) & second.any(axis=1)  # faces of no area have no side to be on
    sharp = has_sides & (np.einsum("ij,ij->i", first, second) < np.cos(np.radians(angle)))
    at_border = np.zeros(mesh.vertex_count, bool)
    at_border[ends[alone]] = True
    return Folds(one, other, _that_lead_on(sharp, ends[one], at_border))


def sharp_edges(mesh: PolygonMesh, angle: float) -> NDArray[np.int32]:
    """Find the vertices of each sharp edge, shape (n, 2); see `find_folds`."""
    found = find_folds(mesh, angle)
    tails, begins = mesh.face_vertex_indices, found.one[found.sharp]
    return np.stack([tails[begins], tails[next_corners(mesh)[begins]]], axis=1).astype(np.int32)


def _that_lead_on(sharp: NDArray[np.bool_], ends: NDArray[np.int32], at_border: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of the sharp edges that remain after dead ends are removed repeatedly."""
    remaining = sharp.copy()
    while True:
        degrees = np.bincount(ends[remaining].ravel(), minlength=len(at_border))
        loose = remaining & ((degrees == 1) & ~at_border)[ends].any(axis=1)
        if not loose.any():
            return remaining
        remaining &= ~loose
