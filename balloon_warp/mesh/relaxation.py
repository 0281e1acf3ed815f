"""Relaxation of quads: vertices of a closed quad mesh slide along the zero level of a signed distance."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh

Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Signed distance, negative inside: points of shape (n, 3) to distances of shape (n,), in the unit of the points."""

SLIDES = 20
PROJECTIONS = 3
LOOSE = 0.25


def relax(mesh: PolygonMesh, distance: Distance, cell: float) -> PolygonMesh:
    """Slide each vertex towards the middle of its neighbors, along the zero level of `distance`, and end on it.

    Args:
        mesh: closed quad mesh within a cell of the zero level.
        distance: signed distance, whose zero level is the surface.
        cell: about the length of an edge.
    """
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    points, at_points = mesh.points, distance(mesh.points)
    for _ in range(SLIDES):
        normals = vertex_normals(replace(mesh, points=points))
        slide = middles(points, quads) - points
        # Vertices that no step brings to the zero level, where the distance jumps as across a hole, form a membrane.
        held = np.abs(at_points) < LOOSE * cell
        slide[held] -= (_dot(slide, normals)[:, None] * normals)[held]
        points, at_points = nearer(points + 0.5 * slide, normals, distance, cell)
    for _ in range(PROJECTIONS):
        held = np.abs(at_points) < LOOSE * cell
        newton = newton_direction(points, distance, cell) * held[:, None]
        points, at_points = nearer(points, newton, distance, cell)
    return replace(mesh, points=points)


def middles(points: NDArray[np.float64], quads: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the mean of the neighbors of each vertex, the larger faces counting more."""
    corners = points[quads]
    neighbors = np.roll(corners, 1, axis=1) + np.roll(corners, -1, axis=1)
    diagonals = corners[:, 2:] - corners[:, :2]
    area = np.linalg.norm(np.cross(diagonals[:, 0], diagonals[:, 1]), axis=1)
    weights = np.repeat(area, 4)
    vertex = quads.ravel()
    sums = np.stack(
        [np.bincount(vertex, weights * neighbors[..., axis].ravel(), len(points)) for axis in range(3)], axis=1
    )
    return sums / (2.0 * np.bincount(vertex, weights, len(points)))[:, None]


def newton_direction(points: NDArray[np.float64], distance: Distance, cell: float) -> NDArray[np.float64]:
    """Return the gradient of the distance over its square, by central differences."""
    step = 0.02 * cell
    offsets = step * np.concatenate([np.eye(3), -np.eye(3)])
    around = distance((points[:, None] + offsets).reshape(-1, 3)).reshape(-1, 6)
    gradient = (around[:, :3] - around[:, 3:]) / (2.0 * step)
    # In a crease narrower than a cell the gradient may vanish.
    return gradient / np.maximum(_dot(gradient, gradient), 0.1)[:, None]


def nearer(
    points: NDArray[np.float64], direction: NDArray[np.float64], distance: Distance, cell: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points moved against `direction` by their distance, where that brings them nearer to the zero level.

    Returns:
        The points and their distances.
    """
    before = distance(points)
    steps = np.clip(before, -0.5 * cell, 0.5 * cell)
    moved = points - steps[:, None] * direction
    after = distance(moved)
    gain = np.abs(before) - np.abs(after)
    accepted = gain > 0.25 * np.abs(steps)
    return np.where(accepted[:, None], moved, points), np.where(accepted, after, before)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)
