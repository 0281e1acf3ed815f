"""The ball: a round toy balloon."""

from dataclasses import replace

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets

CELL, FINE_CELL = 0.03, 0.015
RADIUS = 0.14


def ball() -> PolygonMesh:
    """Return a sphere 28 cm across, around which an image is wound: its middle is in front, toward +Z."""
    mesh = sphere(CELL)
    x, y, z = mesh.points[mesh.face_vertex_indices].T
    around = np.arctan2(x, z) / (2.0 * np.pi)
    first = np.repeat(around[np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts], mesh.face_vertex_counts)
    around -= np.round(around - first)  # faces behind reach beyond the image's edge, where it repeats
    places = np.stack([0.5 + around, 0.5 + np.arcsin(np.clip(y / RADIUS, -1.0, 1.0)) / np.pi], axis=1)
    return replace(mesh, texture_coordinates=np.round(places, 4).astype(np.float32))


def fine_ball() -> PolygonMesh:
    """Return the ball with smaller faces, between which a tear is narrow."""
    return sphere(FINE_CELL)


def sphere(cell: float) -> PolygonMesh:
    """Return a sphere of quads of about a size."""
    reach = 1.2 * RADIUS
    mesh = surface_nets(
        lambda points: np.linalg.norm(points, axis=1) - RADIUS, lower=[-reach] * 3, upper=[reach] * 3, cell=cell
    )
    return replace(mesh, points=RADIUS * mesh.points / np.linalg.norm(mesh.points, axis=1, keepdims=True))
