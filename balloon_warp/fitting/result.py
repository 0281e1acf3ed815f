"""Result of a fit, with its uncertainties."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.shown import Shown, described

VAGUE = 0.05
"""Relative uncertainty above which a value is reported as vague"""
MISSES = 1.02
"""Misfit over the noise above which the fit may be another minimum"""
TWINS = 0.98
"""Correlation from which on two values can hardly be told apart"""


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

    @property
    def doubts(self) -> list[str]:
        """Sentences on values that are not well known."""
        names = list(self.values)
        said = [*self.remarks]
        said += [
            f"{name} is known to {100.0 * abs(self.errors[name] / value):.2g}% only"
            for name, value in self.values.items()
            if value and abs(self.errors[name]) > VAGUE * abs(value)
        ]
        said += [f"{name} lies at its bound, {bound:.4g}" for name, bound in self.at_bounds.items()]
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            if abs(self.correlations[i, j]) > TWINS:
                said.append(
                    f"{names[i]} and {names[j]} can hardly be told apart (correlation {self.correlations[i, j]:.3f})"
                )
        if self.noise_known and self.misfit > MISSES:
            said.append(f"the misfit is {self.misfit:.3g} times the noise: more starts may find a better minimum")
        return said

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
    covariance = np.linalg.pinv(scaled.T @ scaled) * (1.0 if noise_known else misfit**2)
    if roughness is not None:
        covariance += roughness / np.outer(size, size)
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
