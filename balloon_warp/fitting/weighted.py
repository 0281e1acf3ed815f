"""Least squares of a curve's rows, weighed by the noise of both of their columns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, root_scalar
from scipy.special import stdtrit

Values = NDArray[np.float64]
Function = Callable[[Values], Values]
ROUNDS, SETTLED = 8, 1.0e-2
"""Most rounds of weights that follow from slopes, and their relative change at the last one"""
EVALUATIONS = 300
LEAST_NOISE = 1.0e-4
"""Least noise of loads over their largest, where it is estimated"""
TWO_DEVIATIONS = 0.97725
"""Probability below two deviations of a normal distribution"""
UNSEEN = 1.0e-7
"""Singular value over the largest below which data do not determine a direction"""
MOST_LEVERAGE = 0.99
AT_BOUND = 0.01
"""Distance to a bound over the range between both, in logarithms, within which a value lies at it"""
WORST, TINY = 1.0e6, 1.0e-300


@dataclass(frozen=True)
class Rows:
    """Measured loads of all curves."""

    loads: Values
    """Loads [Pa], shape (n,)"""
    largest: Values
    """Largest load of the curve of each [Pa], shape (n,)"""
    load_deviations: Values | None
    """Standard deviations of the loads [Pa], shape (n,)"""
    size_deviations: Values | None
    """Standard deviations of the sizes, shape (n,)"""


@dataclass(frozen=True)
class Solution:
    """Values for which loads come nearest to measured ones."""

    names: tuple[str, ...]
    values: Values
    residuals: Values
    """Measured less fitted loads [Pa], shape (n,)"""
    pulls: Values
    """Residuals over the noise, shape (n,)"""
    jacobian: Values
    """Derivatives of loads over the noise by the logarithms of the values, shape (n, p)"""
    squares: float
    """Sum of the squares of the residuals, over the given noise or the largest loads"""
    starts: Values
    """Sums of all starts"""
    at_bounds: dict[str, float]
    """Bounds that values lie at"""


def solved(
    rows: Rows, loads: Function, slopes: Function, names: tuple[str, ...], starts: Sequence[Sequence[float]],
    bounds: tuple[Values, Values], on_stage: Callable[[str], None],
) -> Solution:  # fmt: skip
    """Find values by least squares of their logarithms, from all starts.

    Noise of sizes counts as that of loads times the slope of the curve, which follows from the fit: a few rounds. If
    only that noise is known, that of the loads is as large as the residuals ask for.

    Args:
        rows: measured loads, with their deviations.
        loads: function from values to loads, shape (n,).
        slopes: function from values to derivatives of loads by sizes, shape (n,).
        names: of the values.
        starts: values where searches begin; their signs are kept.
        bounds: least and largest sizes of the values.
        on_stage: called with a few words at each stage.
    """
    signs = np.sign(starts[0])
    given = rows.largest if rows.load_deviations is None else rows.load_deviations

    def residuals(logs: Values) -> Values:
        with np.errstate(all="ignore"):
            return rows.loads - loads(signs * np.exp(logs))

    found = []
    for number, start in enumerate(starts, start=1):
        on_stage(f"start {number} of {len(starts)}")
        found.append(_descent(residuals, np.log(np.abs(start)), given, bounds))
    costs = np.array([float(pulls @ pulls) for _, pulls, _ in found])
    logs, pulls, jacobian = found[int(np.argmin(costs))]
    noise = given
    for number in range(ROUNDS if rows.size_deviations is not None else 0):
        on_stage(f"weights {number + 1}")
        tilted = np.abs(slopes(signs * np.exp(logs))) * rows.size_deviations
        own = given
        if rows.load_deviations is None:
            own = rows.largest * _noise_left(residuals(logs), tilted, rows.largest, len(names))
        last, noise = noise, np.hypot(own, tilted)
        logs, pulls, jacobian = _descent(residuals, logs, noise, bounds)
        if np.allclose(last, noise, rtol=SETTLED, atol=0.0):
            break
    left = residuals(logs)
    counted = pulls if rows.load_deviations is not None else left / given
    ends = _at_bounds(names, logs, bounds)
    return Solution(names, signs * np.exp(logs), left, pulls, jacobian, float(counted @ counted), np.sort(costs), ends)


def _at_bounds(names: tuple[str, ...], logs: Values, bounds: tuple[Values, Values]) -> dict[str, float]:
    """Return the bounds that values came as near to as a descent does."""
    near = AT_BOUND * np.log(bounds[1] / bounds[0])
    return {
        name: float(bound[number])
        for bound in bounds
        for number, name in enumerate(names)
        if abs(logs[number] - np.log(bound[number])) < near[number]
    }


def _descent(
    residuals: Function, logs: Values, noise: Values, bounds: tuple[Values, Values]
) -> tuple[Values, Values, Values]:
    """Return the logarithms that a descent comes to, with residuals over the noise and the slopes of loads over it."""

    def pulls(logs: Values) -> Values:
        found = np.nan_to_num(residuals(logs) / noise, nan=WORST, posinf=WORST, neginf=-WORST)
        return np.clip(found, -WORST, WORST)

    least, most = np.log(bounds[0]), np.log(bounds[1])
    found = least_squares(pulls, logs, bounds=(least, most), diff_step=1e-5, x_scale=1.0, max_nfev=EVALUATIONS)
    return found.x, found.fun, -found.jac


def _noise_left(residuals: Values, tilted: Values, largest: Values, count: int) -> float:
    """Return the noise of loads over the largest that explains residuals beside that of sizes."""
    freedom = max(len(residuals) - count, 1)

    def excess(logarithm: float) -> float:
        return float((residuals**2 / (tilted**2 + (np.exp(logarithm) * largest) ** 2)).sum() - freedom)

    least, most = log(LEAST_NOISE), log(10.0 * max(float(np.abs(residuals / largest).max()), LEAST_NOISE) * freedom)
    return LEAST_NOISE if excess(least) <= 0.0 else float(np.exp(root_scalar(excess, bracket=(least, most)).root))


def covariance_of(found: Solution, trusted: bool) -> Values:
    """Return the covariance of the values, shape (p, p).

    Args:
        found: the solution.
        trusted: whether the noise of each row is known. Otherwise the residuals themselves tell it, row by row
            (MacKinnon and White 1985, HC3): it need not be alike for all rows. Student's factor for few rows is part of
            it, so that 95% of draws are within two deviations.
    """
    sizes = np.maximum(np.linalg.norm(found.jacobian, axis=0), TINY)
    left, singular, right = np.linalg.svd(found.jacobian / sizes, full_matrices=False)
    singular = np.maximum(singular, UNSEEN * singular[0])
    inverse = right.T / singular  # of J^T J, a root
    covariance = inverse @ inverse.T
    if not trusted:
        freedom = max(len(found.pulls) - len(found.names), 1)
        leverage = np.minimum((left**2).sum(axis=1), MOST_LEVERAGE)
        spread = inverse @ (left * (found.pulls / (1.0 - leverage))[:, None]).T
        unseen = inverse * (singular <= 2.0 * UNSEEN * singular[0])
        covariance = spread @ spread.T + unseen @ unseen.T * (found.pulls @ found.pulls / freedom)
        covariance *= (stdtrit(freedom, TWO_DEVIATIONS) / 2.0) ** 2
    scales = np.abs(found.values) / sizes
    return covariance * np.outer(scales, scales) * np.outer(np.sign(found.values), np.sign(found.values))
