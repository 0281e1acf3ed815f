"""Inflation and deflation in a measured curve, by the order of its rows."""

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
TURNED = 0.1
"""Least change of volume over the curve's range after which its direction has changed"""
LEAST_RUN = 4
"""Least mean number of rows in a run for the rows to be in order of time"""
APART = 0.02
"""Difference of pressures over the largest from which on deflation is told from inflation"""


def inflating(volumes: Values) -> NDArray[np.bool_]:
    """Return which rows inflate, shape (n,); all where rows are in no order, or go one way."""
    turns, up = [0], True
    extreme, least = 0, TURNED * np.ptp(volumes)
    for row, volume in enumerate(volumes):
        ahead = (volume - volumes[extreme]) * (1.0 if up else -1.0)
        if ahead > 0.0:
            extreme = row
        elif -ahead > least:
            turns.append(extreme)
            extreme, up = row, not up
    directions = np.zeros(len(volumes), bool)
    for number, begin in enumerate(turns):
        directions[begin + (begin > 0) :] = number % 2 == 0
    if len(volumes) < LEAST_RUN * len(turns) or not directions.any():
        return np.ones(len(volumes), bool)
    return directions


def drop_of(volumes: Values, pressures: Values, rising: NDArray[np.bool_]) -> float:
    """Return by how much pressures are lower as it deflates, over those as it inflates, on the volumes of both."""
    order = np.argsort(volumes[rising])
    up_volumes, up_pressures = volumes[rising][order], pressures[rising][order]
    falling = ~rising & (volumes >= up_volumes[0]) & (volumes <= up_volumes[-1])
    if not falling.any():
        return 0.0
    expected = np.interp(volumes[falling], up_volumes, up_pressures)
    return float((expected - pressures[falling]).mean() / max(np.abs(expected).mean(), 1e-300))
