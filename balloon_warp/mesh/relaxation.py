"""Even quads: vertices of a closed quad mesh slide along the zero level of a signed distance."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh

SLIDES = 60
PROJECTIONS = 4


def relax(
    mesh: PolygonMesh, distance: Callable[[NDArray[np.float64]], NDArray[np.float64]], cell: float
) -> PolygonMesh:
    """Slide each vertex towards the middle of its neighbors, along the zero level of `distance`, and end on it.

    Args:
        mesh: closed quad mesh within a cell of the zero level.
        distance: signed distance of points of shape (n, 3), negative inside, shape (n,).
        cell: about the length of an edge.
    """
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    points = mesh.points
    for _ in range(SLIDES):
        normals = vertex_normals(replace(mesh, points=points))
        slide = _middles(points, quads) - points
        slide -= _dot(slide, normals)[:, None] * normals
        points = points + 0.5 * slide
        points = points - _limited(distance(points), cell)[:, None] * normals
    for _ in range(PROJECTIONS):
        points = _project(points, distance, cell)
    return replace(mesh, points=points)


def _middles(points: NDArray[np.float64], quads: NDArray[np.int32]) -> NDArray[np.float64]:
    """Mean of the neighbors of each vertex, the larger faces counting more."""
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


def _project(
    points: NDArray[np.float64], distance: Callable[[NDArray[np.float64]], NDArray[np.float64]], cell: float
) -> NDArray[np.float64]:
    """A Newton step along the gradient of the distance, taken by central differences."""
    step = 0.02 * cell
    offsets = step * np.concatenate([np.eye(3), -np.eye(3)])
    around = distance((points[:, None] + offsets).reshape(-1, 3)).reshape(-1, 6)
    gradient = (around[:, :3] - around[:, 3:]) / (2.0 * step)
    scale = np.maximum(_dot(gradient, gradient), 1e-2)
    return points - _limited(distance(points) / scale, cell)[:, None] * gradient


def _limited(step: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    return np.clip(step, -0.5 * cell, 0.5 * cell)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)
