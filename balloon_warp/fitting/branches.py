"""Loading and unloading in a measured curve, by the order of its rows."""

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Rows = NDArray[np.bool_]
TURNED = 0.1
"""Least change of size over the curve's range after which its direction has changed"""
LEAST_RUN = 4
"""Least mean number of rows in a run for the rows to be in order of time"""
APART = 0.02
"""Difference of loads over the largest from which on one branch is told from another"""


def rising(sizes: Values) -> tuple[Rows, Rows]:
    """Return which rows load, and which of them no row before had stretched as far, each of shape (n,).

    All do where rows are in no order, or go one way.
    """
    turns, up = [0], True
    extreme, least = 0, TURNED * np.ptp(sizes)
    for row, size in enumerate(sizes):
        ahead = (size - sizes[extreme]) * (1.0 if up else -1.0)
        if ahead > 0.0:
            extreme = row
        elif -ahead > least:
            turns.append(extreme)
            extreme, up = row, not up
    loads, first = np.zeros(len(sizes), bool), np.zeros(len(sizes), bool)
    largest = -np.inf
    for number, begin in enumerate(turns):
        start, end = begin + (begin > 0), turns[number + 1] + 1 if number + 1 < len(turns) else len(sizes)
        if number % 2 == 0 and end - start > 1:
            loads[start:end] = True
            first[start:end] = sizes[start:end] > largest
            largest = max(largest, sizes[start:end].max())
    if len(sizes) < LEAST_RUN * len(turns) or not loads.any():
        return np.ones(len(sizes), bool), np.ones(len(sizes), bool)
    return loads, first


def drop_of(sizes: Values, loads: Values, reference: Rows, others: Rows) -> float:
    """Return by how much loads of other rows are lower than those of reference rows, on the sizes of both."""
    order = np.argsort(sizes[reference])
    known_sizes, known = sizes[reference][order], loads[reference][order]
    others = others & (sizes >= known_sizes[0]) & (sizes <= known_sizes[-1])
    if not others.any():
        return 0.0
    expected = np.interp(sizes[others], known_sizes, known)
    return float((expected - loads[others]).mean() / max(np.abs(expected).mean(), 1e-300))
