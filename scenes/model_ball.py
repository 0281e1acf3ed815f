"""The ball: a round toy balloon."""

from dataclasses import replace

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets

CELL, FINE_CELL = 0.03, 0.015
RADIUS = 0.14


def ball(cell: float = CELL) -> PolygonMesh:
    """Return a sphere 28 cm across."""
    reach = 1.2 * RADIUS
    mesh = surface_nets(
        lambda points: np.linalg.norm(points, axis=1) - RADIUS, lower=[-reach] * 3, upper=[reach] * 3, cell=cell
    )
    return replace(mesh, points=RADIUS * mesh.points / np.linalg.norm(mesh.points, axis=1, keepdims=True))


def fine_ball() -> PolygonMesh:
    """Return the ball with smaller faces, between which a tear is narrow."""
    return ball(FINE_CELL)
