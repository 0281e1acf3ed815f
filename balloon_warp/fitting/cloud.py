"""Least squares on a rough misfit: slopes by regression over clouds of worlds, ever narrower.

Where a balloon bounces, a contact that comes a step earlier lets residuals jump: differences see jumps in place of
slopes, and a descent stops in one of many small minima. A cloud is as wide in each direction as the data leave it
open, so that the least determined value is searched the widest, and its regression averages over the jumps. Each world
of it then goes a step along these slopes, into the minimum of its own branch.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Forward = Callable[[Values], Values]
"""Function from rows of values, shape (n, p), to residuals, shape (n, m); not finite where there are none"""
FIRST = 0.01
"""Deviation of the first cloud, over the range between the bounds: the slopes until then may be those of a jump"""
WIDEST, NARROWING = 1.0, 0.5
"""Change of the residuals over the misfit, root mean square, in the second cloud; and of a cloud over the last"""
LAST_DEVIATIONS = 1.5
"""Width of the last cloud, over the standard deviations of the values"""
LEAST, MOST = 1.0e-4, 0.1
"""Least and largest deviation of a cloud in a direction, over the range between the bounds"""
LONGEST = 2.0
"""Longest step, over the deviation of a cloud"""
AT_REST = 1.0
"""Step of a cloud's minimum, over its deviation, below which the next is narrower"""
LITTLE = 1.0e-3
"""Part of the mean square by which one of the last clouds must be better than before, for there to be another"""
APART = 1.0
"""Least distance of places that the data tell apart, over the standard deviation"""
PER_VALUE = 4
"""Least number of worlds in a cloud, for each value and one more"""
SURELY = 2.0
"""Deviations of the sum of squares above which the best place misses more than noise can"""
TINY = 1.0e-300


@dataclass(frozen=True)
class Narrowed:
    """The best place that clouds came to."""

    place: Values
    """Between the bounds, from 0 to 1, shape (p,)"""
    cost: float
    """Mean square of the residuals there"""
    jacobian: Values
    """Slopes of the residuals by places, averaged over the last cloud, shape (m, p)"""
    ends: Values
    """Minima of branches: where steps brought the worlds of the last cloud, and descents, shape (k, p)"""
    end_costs: Values
    """Mean squares there, shape (k,)"""
    met: Values
    """Places that were met, the best first, shape (n, p)"""

    def roughness(self, noise_known: bool) -> Values:
        """Return the covariance of the place over the branches of the misfit, shape (p, p).

        Each counts by its likelihood beside the best one, so that one that explains the data worse adds nothing. Where
        the best one misses more than noise can, all that miss not much more count.
        """
        rows = len(self.jacobian)
        missed = rows * (self.cost - 1.0) - SURELY * np.sqrt(2.0 * rows) if noise_known else 0.0
        lost = 0.5 * rows * (self.end_costs / max(self.cost, TINY) - 1.0) / max(missed, 1.0)
        likely = np.exp(-np.maximum(lost, 0.0))
        away = self.ends - self.place
        return (likely * away.T) @ away / (1.0 + likely.sum())

    def with_ends(self, places: Values, costs: Values) -> "Narrowed":
        """Return the place with more minima of branches; minima that are not finite are left out."""
        good = np.isfinite(costs)
        ends, end_costs = np.concatenate([self.ends, places[good]]), np.append(self.end_costs, costs[good])
        return replace(self, ends=ends, end_costs=end_costs)

    def apart(self, count: int) -> Values:
        """Return the best places, at most so many, that the data tell apart."""
        chosen = [self.place]
        for place in self.met:
            away = (place - np.array(chosen)) @ self.jacobian.T
            if (np.linalg.norm(away, axis=1) > APART * np.sqrt(self.cost)).all():
                chosen.append(place)
            if len(chosen) == count:
                break
        return np.array(chosen)


@dataclass(frozen=True)
class _Cloud:
    """Worlds around a place, and the regression of their residuals."""

    places: Values
    residuals: Values
    slopes: Values
    """Derivatives of the residuals by deviations of the cloud, shape (m, p)"""
    shift: float
    """Distance of the regression's minimum from the middle, over the cloud's deviation"""


def narrowed(
    forward: Forward, start: Narrowed, count: int, rounds: int, seed: int, on_round: Callable[[float], None]
) -> Narrowed:
    """Search around a place, and return the best that was met.

    Args:
        start: with slopes there.
        count: of the worlds of a cloud.
        rounds: largest number of clouds.
        on_round: told the least misfit before each cloud.
    """
    met: list[tuple[Values, Values]] = []
    rng, best, width = np.random.default_rng(seed), start, WIDEST
    size = max(count, PER_VALUE * (len(start.place) + 1))
    for _ in range(rounds):
        on_round(float(np.sqrt(best.cost)))
        spread, last = _spread(best, width) if met else (FIRST * np.eye(len(best.place)), False)
        cloud = _cloud(forward, best.place, spread, size, rng)
        if cloud is None:
            break
        stepped = _stepped(cloud, spread)
        met += [(cloud.places, _costs(cloud.residuals)), (stepped, _costs(forward(stepped)))]
        slopes = cloud.slopes @ np.linalg.inv(spread)
        best = replace(best, jacobian=slopes, ends=stepped[:0], end_costs=np.zeros(0)).with_ends(*met[-1])
        before, best = best, _better(_better(best, *met[-2]), *met[-1])
        if last and best.cost > (1.0 - LITTLE) * before.cost:
            break
        if cloud.shift < AT_REST and len(met) > 2:
            width *= NARROWING
    places, costs = (np.concatenate(parts) for parts in zip((start.place[None], [start.cost]), *met, strict=True))
    return replace(best, met=places[np.argsort(costs)[: np.isfinite(costs).sum()]])


def _spread(best: Narrowed, width: float) -> tuple[Values, bool]:
    """Return the deviations of a cloud as columns, shape (p, p), and whether it is as narrow as the last."""
    squares, directions = np.linalg.eigh(best.jacobian.T @ best.jacobian)
    rows, values = best.jacobian.shape
    deviations = width * np.sqrt(rows / values)
    scale = max(deviations, LAST_DEVIATIONS) * np.sqrt(best.cost)
    lengths = np.clip(scale / np.sqrt(np.maximum(squares, TINY)), LEAST, MOST)
    return directions * lengths, bool(deviations <= LAST_DEVIATIONS)


def _cloud(forward: Forward, middle: Values, spread: Values, size: int, rng: np.random.Generator) -> _Cloud | None:
    """Return a cloud in pairs of opposite worlds; None if too few of them can be simulated."""
    drawn = rng.standard_normal((size // 2, len(middle)))
    places = np.clip(middle + np.concatenate([np.zeros((1, len(middle))), drawn, -drawn]) @ spread.T, 0.0, 1.0)
    residuals = forward(places)
    good = _finite(residuals)
    places, residuals = places[good], residuals[good]
    if len(places) < len(middle) + 2:
        return None
    away = np.linalg.solve(spread, (places - middle).T).T
    known = np.column_stack([np.ones(len(away)), away])
    fitted: Values = np.linalg.lstsq(known, residuals, rcond=None)[0].astype(np.float64)
    shift = float(np.linalg.norm(np.linalg.pinv(fitted[1:].T) @ fitted[0]))
    return _Cloud(places, residuals, fitted[1:].T, shift)


def _stepped(cloud: _Cloud, spread: Values) -> Values:
    """Return where a step along the slopes brings each world of a cloud."""
    steps = -cloud.residuals @ np.linalg.pinv(cloud.slopes).T
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    return np.clip(cloud.places + (steps * np.minimum(1.0, LONGEST / np.maximum(lengths, TINY))) @ spread.T, 0.0, 1.0)


def _finite(residuals: Values) -> NDArray[np.bool_]:
    """Return which worlds could be simulated."""
    return np.asarray(np.isfinite(residuals).all(axis=1))


def _costs(residuals: Values) -> Values:
    """Return the mean squares of worlds, infinite of those that could not be simulated."""
    good = _finite(residuals)
    return np.where(good, (np.where(good[:, None], residuals, 0.0) ** 2).mean(axis=1), np.inf)


def _better(best: Narrowed, places: Values, costs: Values) -> Narrowed:
    """Return the best, or a place that is better."""
    least = int(np.argmin(costs))
    return replace(best, place=places[least], cost=float(costs[least])) if costs[least] < best.cost else best
