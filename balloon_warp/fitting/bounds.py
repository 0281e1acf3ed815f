"""Values between bounds, as places from 0 to 1."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError

Values = NDArray[np.float64]
Bounds = dict[str, tuple[float, float]]
SPREAD = 0.8
"""Fraction of the range between the bounds that starts are spread over"""


def checked_bounds(name: str, free: Mapping[str, Any] | None) -> Bounds:
    """Return paths with their lowest and highest values, checked.

    Args:
        name: of the argument that says them.

    Raises:
        InputError: there is none, or a bound is wrong.
    """
    if not isinstance(free, Mapping) or not free:
        raise InputError(f"{name}: expected at least one path, such as balloon.inflation.moles, with its bounds")
    bounds = {}
    for path, pair in free.items():
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise InputError(f"{name}: {path}: expected the lowest and the highest value (got {pair})") from None
        if not (isfinite(low) and isfinite(high) and low < high):
            raise InputError(f"{name}: {path}: expected a lowest value below the highest (got {low:g} and {high:g})")
        bounds[path] = (low, high)
    return bounds


def first_places(starts: int, count: int, seed: int) -> Values:
    """Return where starts begin, shape (starts, count)."""
    return 0.5 + SPREAD * (np.random.default_rng(seed).uniform(size=(starts, count)) - 0.5)


def values_at(bounds: Bounds, places: Values) -> Values:
    """Return the values at places between the bounds, shape (n, p), logarithmic where these are above 0."""
    columns = []
    for (low, high), place in zip(bounds.values(), places.T, strict=True):
        columns.append(low * (high / low) ** place if low > 0.0 else low + (high - low) * place)
    return np.stack(columns, axis=1)


def slope_at(low: float, high: float, place: float) -> float:
    """Return the derivative of a value by its place."""
    return float(np.log(high / low) * low * (high / low) ** place) if low > 0.0 else high - low


def at_bounds(bounds: dict[str, tuple[float, float]], places: Values) -> dict[str, float]:
    """Return the bounds that a search ended at."""
    ended = zip(bounds.items(), places.tolist(), strict=True)
    return {path: pair[int(at)] for (path, pair), at in ended if at in (0.0, 1.0)}
