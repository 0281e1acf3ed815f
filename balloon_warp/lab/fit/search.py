"""Least squares and minima between bounds, from many starts at once.

Least squares from many starts at once: Levenberg and Marquardt's method, in lockstep.

All starts, and all their differences, are asked for together, so that they can be worlds of one batch.

Least squares on a rough misfit: slopes by regression over clouds of worlds, ever narrower.

Where a balloon bounces, a contact that comes a step earlier lets residuals jump: differences see jumps in place of
slopes, and a descent stops in one of many small minima. A cloud is as wide in each direction as the data leave it
open, so that the least determined value is searched the widest, and its regression averages over the jumps. Each world
of it then goes a step along these slopes, into the minimum of its own branch.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from threading import Condition, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

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


Ask = Callable[[Values], tuple[Values, Values]]
"""Function from places, shape (n, p), to numbers, shape (n,), and their derivatives, shape (n, p)"""
STEEP = 1.0e3
"""Stand-in for a number that is not finite, over that of the start: a step there is taken back"""


class _BatchBarrier:
    """Barrier at which starts hand in places and get the values there, all from one batch."""

    def __init__(self, places: Values):
        self.places = places.copy()
        self._asking: set[int] = set()
        self._going = set(range(len(places)))
        self._changed = Condition()
        self._found: tuple[Values, Values] = np.empty(0), np.empty((0, 0))

    def ask(self, start: int, place: Values) -> tuple[float, Values]:
        """Hand in a place, and return its value and derivatives once all have."""
        with self._changed:
            self.places[start] = place
            self._asking.add(start)
            self._changed.notify_all()
            self._changed.wait_for(lambda: start not in self._asking)
            return float(self._found[0][start]), self._found[1][start]

    def leave(self, start: int) -> None:
        """Withdraw a start."""
        with self._changed:
            self._going.discard(start)
            self._changed.notify_all()

    def serve(self, ask: Ask) -> bool:
        """Wait for all, and answer them; return False once all have left."""
        with self._changed:
            self._changed.wait_for(lambda: self._asking == self._going)
            if not self._going:
                return False
        try:
            found = ask(self.places)
        except BaseException:
            self.close()
            raise
        with self._changed:
            self._found = found
            self._asking.clear()
            self._changed.notify_all()
        return True

    def close(self) -> None:
        """Answer all with zeros, on which a descent ends."""
        with self._changed:
            count, width = self.places.shape
            self._found = np.zeros(count), np.zeros((count, width))
            self._asking.clear()
            self._changed.notify_all()


def minima_together(ask: Ask, first: Values, rounds: int, on_round: Callable[[int, float], None]) -> tuple[Values, int]:
    """Return the places of the minima between 0 and 1, shape (n, p), by L-BFGS-B, and how often was asked.

    Args:
        first: where starts begin; those whose number is not finite stay there.
        on_round: told the number of the answer, and the least number so far.
    """
    values, slopes = ask(first)
    scales = np.where(np.isfinite(values) & (values != 0.0), np.abs(values), 1.0)
    meeting, places = _BatchBarrier(first), first.copy()
    known = {start: (first[start], values[start], slopes[start]) for start in range(len(first))}

    def descend(start: int) -> None:
        def told(place: Values) -> tuple[float, Values]:
            begin, value, slope = known[start]
            if not (place == begin).all():
                value, slope = meeting.ask(start, place)
            if not np.isfinite(value):
                return STEEP, np.zeros_like(place)
            return value / scales[start], slope / scales[start]

        try:
            bounds = [(0.0, 1.0)] * first.shape[1]
            options: Any = {"maxiter": rounds, "maxfun": 3 * rounds, "ftol": 1e-9}
            places[start] = minimize(told, first[start], jac=True, method="L-BFGS-B", bounds=bounds, options=options).x
        finally:
            meeting.leave(start)

    threads = [Thread(target=descend, args=(start,), daemon=True) for start in np.flatnonzero(np.isfinite(values))]
    for start in np.flatnonzero(~np.isfinite(values)):
        meeting.leave(int(start))
    for thread in threads:
        thread.start()
    asked, least = 1, float(np.nanmin(np.where(np.isfinite(values), values, np.inf)))

    def counted(asking: Values) -> tuple[Values, Values]:
        nonlocal asked, least
        found = ask(asking)
        asked += 1
        least = min(least, float(np.min(np.where(np.isfinite(found[0]), found[0], np.inf))))
        on_round(asked, least)
        return found

    while meeting.serve(counted):
        pass
    for thread in threads:
        thread.join()
    return places, asked


Forward = Callable[[Values], Values]
"""Function from rows of values, shape (n, p), to residuals, shape (n, m); not finite where there are none"""
DIFFERENCE = 0.002
"""Step of finite differences, over the range between the bounds"""
FIRST_DAMPING = 1.0e-2
EASED, STIFFENED = 5.0, 10.0
LONGEST_STEP = 0.15
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
        trial[row] = np.clip(starts.places[row] + np.clip(step, -LONGEST_STEP, LONGEST_STEP), 0.0, 1.0)
    return trial


def _take(starts: Starts, trial: Starts) -> None:
    """Keep the trials that lower the cost, and adapt the dampings."""
    better = np.asarray(trial.costs < starts.costs)
    for name in ("places", "costs", "residuals", "jacobians"):
        kept, new = getattr(starts, name), getattr(trial, name)
        kept[better] = new[better]
    starts.dampings = np.where(better, starts.dampings / EASED, starts.dampings * STIFFENED)


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
