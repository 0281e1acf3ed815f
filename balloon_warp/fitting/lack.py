"""Lack of fit: residuals that are no noise, and moduli that no rubber has."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

Values = NDArray[np.float64]
RUBBERS = (3.0e3, 3.0e7)
"""Shear moduli from the softest gels to hard rubber [Pa]"""
LARGE_MISFIT, SMALL_MISFIT, FEW_RUNS = 0.05, 0.005, -3.0
"""Misfit over the largest load above which a law does not fit, or does not with so few runs of one sign; and the
deviations from the mean number of runs from which on they are few"""
UNLIKELY = 1.0e-3
"""Probability of a misfit below which it is more than the deviations that were given"""


def lack_of_fit(
    residuals: Values, share: float, name: str = "the curve", load: str = "pressure", noise_known: bool = False
) -> list[str]:
    """Return a sentence if residuals, in the order of sizes, are no noise: too large, or of one sign for long.

    Args:
        residuals: measured less fitted loads, shape (n,).
        share: misfit over the largest load.
        name: of the curve.
        load: name of the load.
        noise_known: whether deviations are given, which then bound the misfit.
    """
    signs = residuals > 0.0
    above, count = int(signs.sum()), len(signs)
    below, runs = count - above, 1 + int(np.count_nonzero(signs[1:] != signs[:-1]))
    # Wald and Wolfowitz 1940: the number of runs in a random order
    mean = 1.0 + 2.0 * above * below / count
    variance = (mean - 1.0) * (mean - 2.0) / (count - 1.0)
    few = variance > 0.0 and (runs - mean) / np.sqrt(variance) < FEW_RUNS
    if (share > LARGE_MISFIT and not noise_known) or (few and share > SMALL_MISFIT):
        shape = f", and it lies above or below the rows for long ({runs} runs in {count} rows)" if few else ""
        return [f"the law misses {name} by {100.0 * share:.2g}% of its largest {load}{shape}: another kind may fit"]
    return []


def beyond_deviations(pulls: Values, freedom: float, name: str) -> list[str]:
    """Return a sentence if residuals are more than their deviations explain.

    Args:
        pulls: residuals over their deviations, shape (n,).
        freedom: rows less the values that they determine.
        name: of the curve.
    """
    squares = float(pulls @ pulls)
    if freedom <= 0.0 or chdtrc(freedom, squares) >= UNLIKELY:
        return []
    return [
        f"the law misses {name} by {np.sqrt(squares / freedom):.2g} times its deviations: another kind may fit, or "
        "they are too small"
    ]


def no_rubber(shear_modulus: float, inflated: bool) -> list[str]:
    """Return a sentence if no rubber has such a shear modulus [Pa]."""
    least, most = RUBBERS
    if least <= shear_modulus <= most:
        return []
    return [
        f"a shear modulus of {shear_modulus:.3g} Pa is no rubber's, {least:g} to {most:g} Pa: are the units right"
        f"{', and the thickness and the radius' if inflated else ''}?"
    ]
