"""Picking by a click, and the path of a thrown sphere."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def hit_distance(
    origin: ArrayLike, direction: ArrayLike, points: NDArray[np.floating], triangles: NDArray[np.integer]
) -> float | None:
    """Return the distance along a ray to the nearest triangle (Moeller and Trumbore 1997), or None.

    Args:
        direction: Unit vector.
        points: Points, shape (point_count, 3).
        triangles: Corners, shape (triangle_count, 3).
    """
    origin, direction = np.asarray(origin, float), np.asarray(direction, float)
    a, b, c = (points[triangles[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(direction, c - a)
    determinant = np.einsum("ij,ij->i", b - a, across)
    inverse = 1.0 / np.where(np.abs(determinant) < 1e-30, np.inf, determinant)
    u = np.einsum("ij,ij->i", origin - a, across) * inverse
    beside = np.cross(origin - a, b - a)
    v = beside @ direction * inverse
    distances = np.einsum("ij,ij->i", c - a, beside) * inverse
    hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distances > 0.0) & (inverse != 0.0)
    return float(distances[hit].min()) if hit.any() else None


def ground_distance(origin: ArrayLike, direction: ArrayLike, up: ArrayLike, height: float) -> float | None:
    """Return the distance along a ray to a level ground, or None if the ray does not meet it from above."""
    descent = -float(np.dot(direction, up))
    above = float(np.dot(origin, up)) - height
    return above / descent if descent > 1e-6 and above > 0.0 else None


def throw_at(target: ArrayLike, start: ArrayLike, speed: float, gravity: float, up: ArrayLike) -> NDArray[np.float64]:
    """Return the velocity [m/s] that brings a body from `start` to `target` in the time that `speed` takes there."""
    target, start, up = (np.asarray(each, float) for each in (target, start, up))
    seconds = max(float(np.linalg.norm(target - start)), 1e-9) / speed
    return (target - start) / seconds + 0.5 * gravity * seconds * up


def nearest_particle(points: NDArray[np.floating], place: NDArray[np.floating]) -> int:
    """Return the particle that is nearest to a place."""
    return int(np.argmin(((points - place) ** 2).sum(axis=1)))
