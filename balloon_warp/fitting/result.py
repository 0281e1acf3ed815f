"""What a fit found, and how surely."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.shown import Shown, described

VAGUE = 0.05
"""of a value: what is seen no better is said"""
MISSES = 1.02
"""times the noise: a misfit above may be another minimum"""
TWINS = 0.98
"""correlation from which on two values are hardly told apart"""


@described
@dataclass(frozen=True, repr=False)
class Fit(Shown):
    """Values that explain what was measured, with what is known of them."""

    values: dict[str, float]
    """by path, or by name"""
    errors: dict[str, float]
    """one standard deviation of each, in its unit"""
    correlations: NDArray[np.float64]
    """of the errors, in the order of `values`, shape (n, n)"""
    misfit: float
    """root mean square of what is left, over the noise where that is known [1], else in the unit of the data"""
    noise_known: bool
    starts: NDArray[np.float64]
    """the misfit that each start came to, ascending"""

    @property
    def doubts(self) -> list[str]:
        """What is not known well, a sentence each."""
        names = list(self.values)
        said = [
            f"{name} is seen to {100.0 * abs(self.errors[name] / value):.2g}% only"
            for name, value in self.values.items()
            if value and abs(self.errors[name]) > VAGUE * abs(value)
        ]
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            if abs(self.correlations[i, j]) > TWINS:
                said.append(
                    f"{names[i]} and {names[j]} are hardly told apart (correlation {self.correlations[i, j]:.3f})"
                )
        if self.noise_known and self.misfit > MISSES:
            said.append(f"the misfit is {self.misfit:.3g} times the noise: more starts may find a better minimum")
        return said

    def report(self) -> dict[str, Any]:
        """All of it that fits into JSON."""
        return {
            "values": self.values,
            "errors": self.errors,
            "correlations": self.correlations.tolist(),
            "misfit": self.misfit,
            "doubts": self.doubts,
        }

    def __repr__(self) -> str:
        said = ", ".join(f"{name} {value:.6g} ± {self.errors[name]:.2g}" for name, value in self.values.items())
        return f"Fit({said}; misfit {self.misfit:.4g})"


def fit_of(
    names: list[str], values: NDArray[np.float64], jacobian: NDArray[np.float64], misfit: float, noise_known: bool,
    starts: NDArray[np.float64],
) -> Fit:  # fmt: skip
    """The fit whose residuals have these derivatives by the values.

    Args:
        jacobian: of residuals over the noise, or in the data's unit where that is not known, shape (m, n).
    """
    size = np.maximum(np.abs(values), 1.0e-300)
    scaled = jacobian * size
    covariance = np.linalg.pinv(scaled.T @ scaled) * (1.0 if noise_known else misfit**2)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1.0e-300))
    return Fit(
        values=dict(zip(names, values.tolist(), strict=True)),
        errors=dict(zip(names, (deviations * size).tolist(), strict=True)),
        correlations=covariance / np.outer(deviations, deviations),
        misfit=misfit,
        noise_known=noise_known,
        starts=np.sort(starts),
    )
