"""Coulomb's coefficient of each pair of things, resolved from what the scene says of each.

The rule as a table is in docs/CONTACT.md. Things are numbered as in `kernels.loops.friction`: the ground, obstacles,
spheres, free bodies, balloons.
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model.parameters import Parameters

FRICTION = "pair_frictions"
"""the name of the coefficients in the parameters, shape (W, thing_count, thing_count)"""
OF_THINGS = ("ground_friction", "obstacle_friction", "sphere_friction", "body_friction")
"""what things other than balloons say, in order"""
OF_BALLOONS, BETWEEN_BALLOONS = "balloon_friction", "touch_friction"
SAID = (*OF_THINGS, OF_BALLOONS, BETWEEN_BALLOONS)
"""the parameters that the coefficients follow from"""


def settle_friction(parameters: Parameters) -> Parameters:
    """Resolve the coefficient of each pair: the geometric mean of what both say.

    A balloon that says nothing takes what the other says; between balloons it takes `touch.friction`.
    """
    said = {name: _rows(parameters[name]) for name in SAID}
    worlds = max(map(len, said.values()))
    things = np.concatenate([_each_world(said[name], worlds) for name in OF_THINGS], axis=1)
    balloons, touch = _each_world(said[OF_BALLOONS], worlds), _each_world(said[BETWEEN_BALLOONS], worlds)
    silent = balloons < 0.0
    own = np.where(silent, touch, balloons)
    beside = _means(np.where(silent[:, :, None], things[:, None, :], balloons[:, :, None]), things[:, None, :])
    rows = np.concatenate([_means(things[:, :, None], things[:, None, :]), beside.transpose(0, 2, 1)], axis=2)
    of_balloons = np.concatenate([beside, _means(own[:, :, None], own[:, None, :])], axis=2)
    return {FRICTION: np.concatenate([rows, of_balloons], axis=1)}


def _means(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Geometric means; of two that are alike exactly what they are."""
    return np.where(first == second, first, np.sqrt(first * second))


def _rows(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Rows of worlds, shape (W, count); a single one where all are alike."""
    rows = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    return rows[:1] if (rows == rows[:1]).all() else rows


def _each_world(rows: NDArray[np.float64], worlds: int) -> NDArray[np.float64]:
    return np.broadcast_to(rows, (worlds, rows.shape[1]))
