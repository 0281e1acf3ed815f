"""Result of a fit, with its uncertainties."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.shown import Shown, described

VAGUE = 0.05
"""Relative uncertainty above which a value is reported as vague"""
TWINS, MOST_TWINS = 0.98, 2
"""Correlation from which on two values can hardly be told apart, and most pairs that are named"""


@described
@dataclass(frozen=True, repr=False)
class Fit(Shown):
    """Values that explain measured data, with their uncertainties."""

    values: dict[str, float]
    """Values by path, or by name"""
    errors: dict[str, float]
    """Standard deviation of each, in its unit"""
    correlations: NDArray[np.float64]
    """Correlations of the errors, in the order of `values`, shape (n, n)"""
    misfit: float
    """Root mean square of the residuals, over the noise where that is known [1], else in the unit of the data"""
    noise_known: bool
    starts: NDArray[np.float64]
    """Misfit that each start reached, ascending"""
    at_bounds: dict[str, float] = field(default_factory=dict)
    """Bounds at which values lie, by path: the data may ask for values beyond"""
    remarks: tuple[str, ...] = ()
    """Sentences on the data and on how well the law has them"""
    derived: tuple[str, ...] = ()
    """Names of values that follow from the others"""

    @property
    def doubts(self) -> list[str]:
        """Sentences on values that are not well known."""
        names, said = list(self.values), [*self.remarks]
        vague = {
            name: f"{100.0 * abs(self.errors[name] / value):.2g}%"
            for name, value in self.values.items()
            if value and name not in self.at_bounds and abs(self.errors[name]) > VAGUE * abs(value)
        }
        if vague:
            said.append(
                f"{_listed(vague)} {'is' if len(vague) == 1 else 'are'} known to {_listed(vague.values())} only"
            )
        said += [f"{name} lies at its bound, {bound:.4g}" for name, bound in self.at_bounds.items()]
        twins = {
            (names[i], names[j]): float(self.correlations[i, j])
            for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
            if abs(self.correlations[i, j]) > TWINS and not {names[i], names[j]} & set(self.derived)
        }
        if len(twins) > MOST_TWINS:
            largest = max(map(abs, twins.values()))
            return [*said, f"{len(twins)} pairs of values can hardly be told apart (correlations to {largest:.3f})"]
        return said + [
            f"{first} and {second} can hardly be told apart (correlation {correlation:.3f})"
            for (first, second), correlation in twins.items()
        ]

    def report(self) -> dict[str, Any]:
        """Return the fit's figures as JSON."""
        return {
            "values": self.values,
            "errors": self.errors,
            "correlations": self.correlations.tolist(),
            "misfit": self.misfit,
            "at_bounds": self.at_bounds,
            "doubts": self.doubts,
        }

    def __repr__(self) -> str:
        said = ", ".join(f"{name} {value:.6g} ± {self.errors[name]:.2g}" for name, value in self.values.items())
        return f"Fit({said}; misfit {self.misfit:.4g})"


def fit_of(
    names: list[str], values: NDArray[np.float64], jacobian: NDArray[np.float64], misfit: float, noise_known: bool,
    starts: NDArray[np.float64], at_bounds: Mapping[str, float] | None = None,
    roughness: NDArray[np.float64] | None = None,
) -> Fit:  # fmt: skip
    """Return the fit whose residuals have these derivatives by the values.

    Args:
        jacobian: of residuals over the noise, or in the data's unit where that is not known, shape (m, n).
        roughness: covariance of the values over the minima that jumps of the residuals leave, shape (n, n).
    """
    size = np.maximum(np.abs(values), 1.0e-300)
    scaled = jacobian * size
    covariance = np.linalg.pinv(scaled.T @ scaled) * np.outer(size, size) * (1.0 if noise_known else misfit**2)
    if roughness is not None:
        covariance += roughness
    return fit_with(names, values, covariance, misfit, noise_known, starts, at_bounds)


def fit_with(
    names: list[str], values: NDArray[np.float64], covariance: NDArray[Any], misfit: float, noise_known: bool,
    starts: NDArray[np.float64], at_bounds: Mapping[str, float] | None = None,
) -> Fit:  # fmt: skip
    """Return the fit of values with this covariance, shape (n, n)."""
    size = np.maximum(np.abs(values), 1.0e-300)
    covariance = covariance / np.outer(size, size)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1.0e-300))
    return Fit(
        values=dict(zip(names, values.tolist(), strict=True)),
        errors=dict(zip(names, (deviations * size).tolist(), strict=True)),
        correlations=covariance / np.outer(deviations, deviations),
        misfit=misfit,
        noise_known=noise_known,
        starts=np.sort(starts),
        at_bounds=dict(at_bounds or {}),
    )


def _listed(words: Iterable[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last
