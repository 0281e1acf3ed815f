"""Least squares from many starts at once: Levenberg and Marquardt's method, in lockstep.

All starts, and all their differences, are asked for together, so that they can be worlds of one batch.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Forward = Callable[[Values], Values]
"""Function from rows of values, shape (n, p), to residuals, shape (n, m); not finite where there are none"""
DIFFERENCE = 0.002
"""Step of finite differences, over the range between the bounds"""
FIRST_DAMPING = 1.0e-2
EASED, STIFFENED = 5.0, 10.0
LONGEST = 0.15
"""Longest step, over the range between the bounds"""
SETTLED = 1.0e-5
"""Step below which the best start has converged"""


@dataclass
class Starts:
    """State of the starts; places are from 0 to 1 between the bounds."""

    places: Values
    """Places, shape (s, p)"""
    costs: Values
    """Mean squares, shape (s,)"""
    dampings: Values
    residuals: Values
    """Residuals, shape (s, m)"""
    jacobians: Values
    """Jacobians by places, shape (s, m, p)"""

    @property
    def best(self) -> int:
        """The number of the best."""
        return int(np.argmin(self.costs))


def descend(
    forward: Forward, first: Values, rounds: int, on_round: Callable[[float], None], differences: Values | None = None
) -> Starts:
    """Go down from all starts, so many rounds at most, until the best has converged.

    Args:
        first: places, shape (s, p).
        on_round: told the least misfit before each round.
        differences: steps of finite differences, shape (p,).
    """
    steps = np.full(first.shape[1], DIFFERENCE) if differences is None else differences
    starts = _begun(forward, first, steps)
    for _ in range(rounds):
        on_round(float(np.sqrt(starts.costs.min())))
        trial = _steps(starts)
        if np.abs(trial - starts.places)[starts.best].max() < SETTLED:
            break
        _take(starts, _begun(forward, trial, steps))
    return starts


def _begun(forward: Forward, places: Values, differences: Values) -> Starts:
    """Return the residuals and differences of all places, asked for at once."""
    count, width = places.shape
    steps = np.where(places > 0.5, -differences, differences)
    rows = np.repeat(places[:, None], width + 1, axis=1)
    for column in range(width):
        rows[:, column + 1, column] += steps[:, column]
    found = forward(rows.reshape(-1, width)).reshape(count, width + 1, -1)
    base, moved = found[:, 0], found[:, 1:]
    jacobians = ((moved - base[:, None]) / steps[:, :, None]).transpose(0, 2, 1)
    good = np.asarray(np.isfinite(found).all(axis=(1, 2)))
    costs = np.where(good, (np.where(good[:, None], base, 0.0) ** 2).mean(axis=1), np.inf)
    return Starts(places.copy(), costs, np.full(count, FIRST_DAMPING), base, jacobians)


def _steps(starts: Starts) -> Values:
    """Return the next place of each start."""
    trial = starts.places.copy()
    for row, cost in enumerate(starts.costs):
        if not np.isfinite(cost):
            continue
        jacobian, residual = starts.jacobians[row], starts.residuals[row]
        square = jacobian.T @ jacobian
        damped = square + starts.dampings[row] * np.diag(np.diag(square) + 1.0e-12 * np.trace(square) + 1.0e-300)
        step = -np.linalg.lstsq(damped, jacobian.T @ residual, rcond=None)[0]
        trial[row] = np.clip(starts.places[row] + np.clip(step, -LONGEST, LONGEST), 0.0, 1.0)
    return trial


def _take(starts: Starts, trial: Starts) -> None:
    """Keep the trials that lower the cost, and adapt the dampings."""
    better = np.asarray(trial.costs < starts.costs)
    for name in ("places", "costs", "residuals", "jacobians"):
        kept, new = getattr(starts, name), getattr(trial, name)
        kept[better] = new[better]
    starts.dampings = np.where(better, starts.dampings / EASED, starts.dampings * STIFFENED)
