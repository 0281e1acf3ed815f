"""Spheres and strings that a user adds to a scene."""

from numpy.typing import NDArray


def as_vector(place: NDArray) -> tuple[float, float, float]:
    """Return a place or velocity as scenes have it."""
    x, y, z = (float(value) for value in place)
    return x, y, z
