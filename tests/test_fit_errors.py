"""Error bars of fits to a misfit with jumps: as wide as the values are off."""

from collections.abc import Callable

import numpy as np
import pytest

from balloon_warp.fitting.result import fit_of
from balloon_warp.fitting.search import search

Values = np.ndarray
ROWS, STARTS, ROUNDS, SEEDS = 3000, 8, 16, 20
SLOPES = np.random.default_rng(5).standard_normal((ROWS, 2)) * [30.0, 60.0]
"""of residuals over the noise, by places"""
CONTACTS = 6
"""Number of contacts, each of which comes a step earlier or later as the first value changes"""


def jumps(strength: float) -> Callable[[Values], Values]:
    """Return a function of residuals by rounding a contact's time to steps: a sawtooth for each contact."""
    rng = np.random.default_rng(7)
    widths, phases = rng.uniform(0.01, 0.04, CONTACTS), rng.uniform(size=CONTACTS)
    ways = rng.standard_normal((CONTACTS, ROWS)) * strength / np.sqrt(ROWS)

    def rough(places: Values) -> Values:
        teeth = places[:, :1] / widths + phases
        return (teeth - np.floor(teeth) - 0.5) @ ways

    return rough


def pulls(strength: float) -> Values:
    """Return the pulls of both values, errors over the reported standard deviations, of all seeds, shape (SEEDS, 2)."""
    rough, found = jumps(strength), []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        true, noise = rng.uniform(0.3, 0.7, 2), rng.standard_normal(ROWS)
        there = rough(true[None])

        def forward(places: Values, true: Values = true, noise: Values = noise, there: Values = there) -> Values:
            return (places - true) @ SLOPES.T + rough(places) - there + noise

        best = search(forward, rng.uniform(0.1, 0.9, (STARTS, 2)), ROUNDS, lambda number, misfit: None, seed).best
        fit = fit_of(
            ["a", "b"], best.place, best.jacobian, np.sqrt(best.cost), True, np.zeros(1), None, best.roughness(True)
        )
        found.append((best.place - true) / np.array(list(fit.errors.values())))
    return np.array(found)


@pytest.mark.parametrize("strength", [0.0, 100.0], ids=["smooth", "rough"])
def test_error_bars_are_as_wide_as_values_are_off(strength: float):
    """Pulls have a deviation of 1, which 20 draws of it know to 0.16; clouds that see jumps would tell 0.02."""
    deviations = np.sqrt((pulls(strength) ** 2).mean(axis=0))
    assert (deviations > 0.5).all()
    assert (deviations < 1.5).all()
