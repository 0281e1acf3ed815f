"""A camera that goes along with the balloons, and rays by a click."""

import threading
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

HELD_SECONDS = 0.4
"""Time for which a camera that a user turns is left alone [s], so that it is not pulled back"""
TURNED = 1e-3
"""Displacement of a camera over its distance from which on a user has turned it"""
AWAY = 1.1
"""Distance of a camera from its target, over the target's size: it fills most of the view"""
NARROW = 0.75
"""Width over height of a window in which a view that fills its height is as wide as it"""


class Follower:
    """The windows whose cameras follow."""

    def __init__(self) -> None:
        self._turn = threading.Lock()
        """Held by whoever reads or writes the windows: each key runs in a thread of its own, beside the drawing"""
        self._following: dict[int, tuple[NDArray[np.float64], float]] = {}
        """Vector to each window's camera from its target [m], and the time until which it is left alone"""

    def follows(self, window: Any) -> bool:
        """Return whether a window's camera follows."""
        return window.client_id in self._following

    def toggle(self, window: Any, center: NDArray[np.floating], distance: float) -> None:
        """Look at the balloons, shape (3,) [m], from a distance [m], and follow them; or stop, if it followed."""
        with self._turn:
            if self._following.pop(window.client_id, None) is not None:
                return
            away = _away(window)
            look_at(window, center, away * (distance / max(float(np.linalg.norm(away)), 1e-9)))
            self._following[window.client_id] = _away(window), 0.0

    def follow(self, windows: dict[int, Any], center: NDArray[np.floating]) -> None:
        """Move the cameras of windows along to where the balloons are, shape (3,) [m]; as somebody turned them."""
        now = time.monotonic()
        with self._turn:
            for number, (before, until) in list(self._following.items()):
                if number not in windows:
                    del self._following[number]
                    continue
                window = windows[number]
                away = _away(window)
                if np.linalg.norm(away - before) > TURNED * np.linalg.norm(before):
                    until = now + HELD_SECONDS
                self._following[number] = away, until
                if now >= until and np.isfinite(center).all():
                    look_at(window, center, away)


def look_at(window: Any, center: NDArray[np.floating], away: NDArray[np.floating]) -> None:
    """Turn a window's camera to a place, and put it so far away from it, shape (3,) each [m]."""
    with window.atomic():  # the place first: where it looks moves along with it
        window.camera.position = tuple((center + away).tolist())
        window.camera.look_at = tuple(center.tolist())


def go_home(camera: Any, position: NDArray[np.floating], middle: NDArray[np.floating]) -> None:
    """Move a camera to where it sees everything, farther away in a narrow window; shape (3,) each [m]."""
    width, height = getattr(camera, "image_width", 1), getattr(camera, "image_height", 1)
    away = (position - middle) * max(NARROW * height / max(width, 1), 1.0)
    camera.position, camera.look_at = tuple((middle + away).tolist()), tuple(middle.tolist())


def home_of(
    points: NDArray[np.floating], up: NDArray[np.floating], side: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return a camera's place to see points from a side and a little above, and its target; shape (3,) each."""
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2, float((high - low).max())
    return center + AWAY * size * (side / np.linalg.norm(side)) + 0.4 * size * up, center


def _away(window: Any) -> NDArray[np.float64]:
    """Return the vector from a camera's target to the camera [m], shape (3,)."""
    return np.array(window.camera.position, float) - np.array(window.camera.look_at, float)


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
