"""Checks that every mesh must pass, from any kind of file."""

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.mesh.polygon_mesh import PolygonMesh

FLOAT32_MAX = float(np.finfo(np.float32).max)
LARGEST_FACE = 4096
"""Largest number of corners of a face; the springs across it grow with their square"""
LARGEST_FAN = 256
"""Number of neighbors up to which a particle gets flexion springs between all of them; past one with more, as the hub
of a wheel, each neighbor gets one"""


def check_mesh(mesh: PolygonMesh, source: str, least_corners: int = 3) -> None:
    """Check that a mesh has points and faces, and that they fit together.

    Args:
        least_corners: of a face; with 2, a face may be an edge.

    Raises:
        InputError: names `source` and the first face or vertex, from 1, that is wrong.
    """
    if mesh.vertex_count == 0 or mesh.face_count == 0:
        raise InputError(f"{source}: has {mesh.vertex_count} vertices and {mesh.face_count} faces; expected both")
    outside = ~(np.abs(mesh.points) <= FLOAT32_MAX).all(axis=1)
    if outside.any():
        vertex = int(outside.argmax())
        raise InputError(
            f"{source}: vertex {vertex + 1}: coordinates must be finite and fit in 32-bit floats "
            f"(got {' '.join(map(str, mesh.points[vertex]))})"
        )
    if mesh.face_vertex_counts.min() < least_corners:
        face = int(mesh.face_vertex_counts.argmin())
        raise InputError(
            f"{source}: face {face + 1}: a face needs {'three' if least_corners == 3 else 'two'} corners or more "
            f"(got {mesh.face_vertex_counts[face]})"
        )
    if mesh.face_vertex_counts.max() > LARGEST_FACE:
        face = int(mesh.face_vertex_counts.argmax())
        raise InputError(
            f"{source}: face {face + 1}: a face may have at most {LARGEST_FACE:,} corners "
            f"(got {mesh.face_vertex_counts[face]:,})"
        )
    corner_count = int(mesh.face_vertex_counts.sum(dtype=np.int64))
    if corner_count != len(mesh.face_vertex_indices):
        raise InputError(
            f"{source}: the face sizes add up to {corner_count} corners, but {len(mesh.face_vertex_indices)} are given"
        )
    for index in (mesh.face_vertex_indices.min(), mesh.face_vertex_indices.max()):
        if not 0 <= index < mesh.vertex_count:
            raise InputError(f"{source}: a face refers to point {index}; expected 0 to {mesh.vertex_count - 1}")
