"""Properties of some particles of a balloon, given from Python as a mask, or as a rule for points."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError


def pins_of(given: Any) -> Any:
    """Make a list of a single name, and numbers of a mask; other values stay as they are."""
    if isinstance(given, str):
        return [given]
    is_mask = isinstance(given, list) and bool(given) and all(isinstance(pin, bool) for pin in given)
    return np.flatnonzero(given).tolist() if is_mask else given


def pinned_by(rule: Callable[[NDArray[np.float64]], Any], points: NDArray[np.float64]) -> list[int]:
    """Find the points of a mesh that a rule holds for, by their numbers.

    Args:
        points: as the mesh has them, shape (n, 3).

    Raises:
        InputError: the rule does not say yes or no of each point.
    """
    said = np.asarray(rule(points.copy()))
    if said.shape != (len(points),) or said.dtype != bool:
        raise InputError(
            f"the function must return a boolean for each point, of shape ({len(points)},) "
            f"(got {said.dtype} of shape {said.shape})"
        )
    return np.flatnonzero(said).tolist()


def weighed_by(rule: Callable[[NDArray[np.float64]], Any], points: NDArray[np.float64]) -> list[float]:
    """Ask a rule about each point of a mesh.

    Args:
        points: as the mesh has them, shape (n, 3).

    Raises:
        InputError: the rule does not give a number for each point.
    """
    said = np.asarray(rule(points.copy()))
    if said.shape != (len(points),) or said.dtype.kind not in "biuf":
        raise InputError(
            f"the function must return a number for each point, of shape ({len(points)},) "
            f"(got {said.dtype} of shape {said.shape})"
        )
    return said.astype(float).tolist()
