"""A camera that goes along with the balloons."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

HELD_SECONDS = 0.4
"""for which a camera that somebody turns is left alone, or it would be pulled back"""
TURNED = 1e-3
"""part of the distance by which a camera is elsewhere than it was, where somebody turned it"""
AWAY = 1.1
"""how far a camera stands from what it sees, in sizes of that: it fills most of the view"""
NARROW = 0.75
"""width over height of a window in which what fills its height is as wide as it"""


class Follower:
    """The windows whose cameras follow."""

    def __init__(self) -> None:
        self._following: dict[int, tuple[NDArray[np.float64], float]] = {}
        """by window: where its camera stood, from what it looks at [m], and until when it is left alone"""

    def follows(self, window: Any) -> bool:
        """Whether a window's camera does."""
        return window.client_id in self._following

    def begin(self, window: Any) -> None:
        """Follow from now on."""
        self._following[window.client_id] = _away(window), 0.0

    def end(self, window: Any) -> None:
        """Stay."""
        self._following.pop(window.client_id, None)

    def follow(self, windows: dict[int, Any], center: NDArray[np.floating]) -> None:
        """Move the cameras of windows along to where the balloons are, shape (3,) [m]; as somebody turned them."""
        now = time.monotonic()
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
    """Put a camera where it sees everything, farther away where its window is narrow; shape (3,) each [m]."""
    width, height = getattr(camera, "image_width", 1), getattr(camera, "image_height", 1)
    away = (position - middle) * max(NARROW * height / max(width, 1), 1.0)
    camera.position, camera.look_at = tuple((middle + away).tolist()), tuple(middle.tolist())


def home_of(
    points: NDArray[np.floating], up: NDArray[np.floating], side: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Where a camera stands that sees points, from a side and a little above, and what it looks at; shape (3,) each."""
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2, float((high - low).max())
    return center + AWAY * size * (side / np.linalg.norm(side)) + 0.4 * size * up, center


def _away(window: Any) -> NDArray[np.float64]:
    """From what a camera looks at to where it stands [m], shape (3,)."""
    return np.array(window.camera.position, float) - np.array(window.camera.look_at, float)
