"""Edges that others may meet between particles: rims of open sheets, and sharp ones."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.geometry import face_vector_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges

SHARP = 0.5
"""Cosine of the initial angle between the normals of an edge's two faces below which it is sharp: 60 degrees"""


def sharp_edges(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the ends of a mesh's sharp edges, shape (E, 2).

    They are in the order and direction in which faces first traverse them, independent of vertex numbers.
    """
    edges = mesh_edges(mesh)
    areas = face_vector_areas(mesh)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    normals = normals[corner_faces(mesh)[edges.corners]] * np.where(edges.forward, 1.0, -1.0)[:, None]
    other = np.minimum(edges.starts + 1, len(edges.corners) - 1)
    cosine = -(normals[edges.starts] * normals[other]).sum(axis=1)  # the faces of an edge run along it both ways
    firsts = np.sort(edges.corners[edges.starts[(edges.face_counts != 2) | (cosine < SHARP)]])
    following = next_corners(mesh)[firsts]
    return mesh.face_vertex_indices[np.stack([firsts, following], axis=1)].astype(np.int64)
