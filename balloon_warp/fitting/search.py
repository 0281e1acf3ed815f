"""Least squares between bounds: a descent from many starts, and from the best of them clouds."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from balloon_warp.fitting.cloud import TINY, Forward, Narrowed, Values, narrowed
from balloon_warp.fitting.marquardt import DIFFERENCE, descend

DESCENT, FEWEST = 3, 4
"""Part of the rounds in which starts descend, one in so many; and how many of them at least"""
LAST = 4
"""Rounds in which the best places that clouds met descend"""
SMALLEST = 1.0e-6
"""Smallest step of their differences, over the range between the bounds"""


@dataclass(frozen=True)
class Found:
    """The best place, and the costs that the starts reached."""

    best: Narrowed
    costs: Values
    """Mean squares of all starts, infinite of those that could not be simulated; the best is that of the clouds"""


def search(
    forward: Forward, first: Values, rounds: int, on_round: Callable[[int, float], None], seed: int = 0
) -> Found:
    """Find the least mean square of residuals, in so many rounds at most.

    Args:
        first: places of the starts, from 0 to 1, shape (s, p).
        on_round: told the round, and the least misfit until then.
        seed: of the clouds.
    """
    done = 0

    def told(misfit: float) -> None:
        nonlocal done
        done += 1
        on_round(done, misfit)

    starts = descend(forward, first, min(rounds, max(rounds // DESCENT, FEWEST)), told)
    number, width = starts.best, first.shape[1]
    best = Narrowed(
        starts.places[number], float(starts.costs[number]), starts.jacobians[number], np.zeros((0, width)), np.zeros(0),
        starts.places[[number]],
    )  # fmt: skip
    left = rounds - done - LAST
    if np.isfinite(best.cost) and left > 1:
        best = narrowed(forward, best, len(first) * (width + 1), left // 2, seed, told)
        best = _descended(forward, best, best.apart(len(first)), told)
        best = replace(best, jacobian=_slopes_there(forward, best))
    return Found(best, np.append(np.delete(starts.costs, number), best.cost))


def _descended(forward: Forward, best: Narrowed, first: Values, told: Callable[[float], None]) -> Narrowed:
    """Return the best that descents from places come to, each with differences within its branch."""
    ends = descend(forward, first, LAST, told, _differences(best))
    least, best = ends.best, best.with_ends(ends.places, ends.costs)
    if ends.costs[least] >= best.cost:
        return best
    return replace(best, place=ends.places[least], cost=float(ends.costs[least]))


def _differences(best: Narrowed) -> Values:
    """Return steps of finite differences that change the residuals as much as noise does, shape (p,)."""
    steps = np.sqrt(best.cost) / np.maximum(np.linalg.norm(best.jacobian, axis=0), TINY)
    return np.clip(steps, SMALLEST, DIFFERENCE)


def _slopes_there(forward: Forward, best: Narrowed) -> Values:
    """Return the slopes of the residuals at the best place, within its branch, shape (m, p).

    The side with the smaller slopes counts: a jump makes them larger.
    """
    steps = np.diag(_differences(best))
    rows = np.concatenate([best.place[None], best.place + steps, best.place - steps])
    found = forward(rows)
    count, slopes = len(steps), best.jacobian.copy()
    for column, step in enumerate(np.diag(steps)):
        sides = [(found[1 + column + side * count] - found[0]) / (step * (1.0 - 2.0 * side)) for side in (0, 1)]
        inside = [bool(0.0 <= rows[1 + column + side * count, column] <= 1.0) for side in (0, 1)]
        sides = [slope for slope, good in zip(sides, inside, strict=True) if good and np.isfinite(slope).all()]
        if sides:
            slopes[:, column] = min(sides, key=lambda slope: float(np.linalg.norm(slope)))
    return slopes
