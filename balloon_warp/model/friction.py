"""Coulomb's coefficient of each pair of things, resolved from the scene's coefficient of each.

The rule as a table is in docs/CONTACT.md. Things are numbered as in `kernels.loops.friction`: the ground, obstacles,
spheres, free bodies, balloons.
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.contact import AS_OTHERS
from balloon_warp.model.parameters import Parameters

FRICTION = "pair_frictions"
"""Name of the coefficients in the parameters, shape (W, thing_count, thing_count)"""
OF_THINGS = ("ground_friction", "obstacle_friction", "sphere_friction", "body_friction")
"""Coefficients of things other than balloons, in order"""
OF_BALLOONS, BETWEEN_BALLOONS = "balloon_friction", "touch_friction"
SAID = (*OF_THINGS, OF_BALLOONS, BETWEEN_BALLOONS)
"""Parameters that the coefficients follow from"""


def settle_friction(parameters: Parameters, rounded: bool = True) -> Parameters:
    """Resolve the coefficient of each pair: the geometric mean of the coefficients of both.

    A balloon without one takes that of the other; between balloons it takes `touch.friction`.

    Args:
        rounded: whether coefficients are as devices keep them, so that resolving them again gives the same.
    """
    rows = {name: _rows(parameters[name], rounded) for name in SAID}
    worlds = max(map(len, rows.values()))
    each = {name: np.broadcast_to(values, (worlds, values.shape[1])) for name, values in rows.items()}
    said = np.concatenate([each[name] for name in (*OF_THINGS, OF_BALLOONS)], axis=1)
    is_balloon = np.arange(said.shape[1]) >= said.shape[1] - each[OF_BALLOONS].shape[1]
    otherwise = np.where(is_balloon, each[BETWEEN_BALLOONS], said)
    beside = np.where((said == AS_OTHERS)[:, :, None], otherwise[:, None, :], said[:, :, None])
    return {FRICTION: _means(beside, beside.transpose(0, 2, 1))}


def _means(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the geometric means; of two that are alike exactly their value."""
    return np.where(first == second, first, np.sqrt(first * second))


def _rows(values: NDArray[np.floating], rounded: bool) -> NDArray[np.float64]:
    """Return the rows of worlds, shape (W, count), a single one where all are alike."""
    kept = np.asarray(values, dtype=np.float32 if rounded else np.float64)
    rows = kept.astype(np.float64).reshape(len(values), -1)
    return rows[:1] if (rows == rows[:1]).all() else rows
