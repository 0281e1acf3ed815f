"""The shape of a string between its anchor and its particle."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

POINT_COUNT = 17


def string_curve(
    anchor: ArrayLike, end: ArrayLike, length: float, up: ArrayLike, ground_height: float
) -> NDArray[np.float32]:
    """Return the points along a string: straight when taut, hanging in a parabola of about its length when slack.

    A shallow parabola of sag s over a chord c is 8 s^2 / 3 c longer than the chord. It lies on the ground where it
    would sink below.

    Returns:
        positions [m], shape (POINT_COUNT, 3)
    """
    anchor, end, up = np.asarray(anchor, float), np.asarray(end, float), np.asarray(up, float)
    chord = end - anchor
    distance = max(float(np.linalg.norm(chord)), 1e-12)
    sag = np.sqrt(0.375 * distance * max(length - distance, 0.0))
    t = np.linspace(0.0, 1.0, POINT_COUNT)[:, None]
    points = anchor + t * chord + 4.0 * t * (1.0 - t) * sag * _across(chord / distance, -up)
    below = np.maximum(ground_height - points @ up, 0.0)
    below[0] = 0.0  # the anchor stays where the scene put it
    return (points + below[:, None] * up).astype(np.float32)


def _across(direction: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector across `direction`, as much along `wanted` as can be."""
    across = wanted - (wanted @ direction) * direction
    if np.linalg.norm(across) < 1e-6:
        across = np.roll(wanted, 1) - (np.roll(wanted, 1) @ direction) * direction
    return across / np.linalg.norm(across)
