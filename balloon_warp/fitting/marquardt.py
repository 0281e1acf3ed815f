"""Least squares from many starts at once: Levenberg and Marquardt's method, in lockstep.

All starts, and all their differences, are asked for together, so that they can be worlds of one batch. From half-way on
all but the best begin anew around it, several times and ever nearer, with the first value scanned: the stiffest is what
starts get stuck in, where a bounce makes many small minima.
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
SCANS = (0.06, 0.02, 0.01)
"""Widths of successive scans around the best, over the range between the bounds"""
SCAN_ROUNDS = 3
"""Number of rounds from one scan to the next"""
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


def search(forward: Forward, first: Values, rounds: int, on_round: Callable[[int, float], None]) -> Starts:
    """Go from all starts, so many rounds at most.

    Args:
        first: places, shape (s, p).
        on_round: told the round, and the least misfit until then.
    """
    starts, scans = _begun(forward, first), list(SCANS[: None if len(first) > 1 else 0])
    due = (rounds + 1) // 2
    for number in range(1, rounds + 1):
        on_round(number, float(np.sqrt(starts.costs.min())))
        trial = _steps(starts)
        settled = np.abs(trial - starts.places)[starts.best].max() < SETTLED
        anew = bool(scans) and (number >= due or (settled and len(scans) < len(SCANS)))
        if anew:
            trial, due = _around_best(starts, scans.pop(0)), number + SCAN_ROUNDS
        elif settled and not scans:
            break
        _take(starts, _begun(forward, trial), anew)
    return starts


def _begun(forward: Forward, places: Values) -> Starts:
    """Return the residuals and differences of all places, asked for at once."""
    count, width = places.shape
    steps = np.where(places > 0.5, -DIFFERENCE, DIFFERENCE)
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


def _around_best(starts: Starts, width: float) -> Values:
    """Return all around the best, with the first value scanned."""
    trial = np.tile(starts.places[starts.best], (len(starts.places), 1))
    trial[:, 0] = np.clip(trial[:, 0] + np.linspace(-width, width, len(trial)), 0.0, 1.0)
    return trial


def _take(starts: Starts, trial: Starts, anew: bool) -> None:
    """Keep what is better; where all begin anew, all but the best start."""
    better = np.asarray(trial.costs < starts.costs)
    if anew:
        others = np.arange(len(better)) != starts.best
        better = np.where(others, np.isfinite(trial.costs), better)
    for name in ("places", "costs", "residuals", "jacobians"):
        kept, new = getattr(starts, name), getattr(trial, name)
        kept[better] = new[better]
    changed = np.where(better, starts.dampings / EASED, starts.dampings * STIFFENED)
    starts.dampings = np.where(better & anew, FIRST_DAMPING, changed)
