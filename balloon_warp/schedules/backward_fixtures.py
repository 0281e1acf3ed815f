"""Derivatives by where obstacles are, by the keyframes of their motion, and by the friction of balloons on them.

Particles note their derivatives by each obstacle, which are added up once a frame.
"""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.fixture_bars import WIDTH, Totals, sum_fixture_bars
from balloon_warp.kernels.working import FixtureBars
from balloon_warp.launching import launch
from balloon_warp.model import Model

POSITION = "obstacle_position"
"""Name of the parameter"""


def bytes_of_fixtures(model: Model) -> int:
    """Return the device memory of a world."""
    return 4 * WIDTH * (model.particle_count + 2 * model.balloon_count) * len(model.obstacles)


class FixturesBackward:
    """Add up the bars of obstacles, a frame at a time.

    Args:
        working: of the launches that run backwards.
    """

    def __init__(self, model: Model, tables: Any, working: Any):
        self._model, self._tables, self._working = model, tables, working
        worlds, fixtures = model.world_count, len(model.obstacles)
        with wp.ScopedDevice(model.device):
            working.fixture_bars = wp.zeros((worlds, model.particle_count, fixtures), dtype=FixtureBars)
            self._totals = wp.zeros((worlds, model.balloon_count, fixtures), dtype=Totals)

    def add_up(self) -> None:
        """Add up the derivatives that the particles of each balloon have noted in a frame."""
        inputs = [self._tables, self._working, self._totals]
        launch(sum_fixture_bars, self._totals.shape, inputs, device=self._model.device)

    def of_frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a frame's bars by the places of obstacles as it begins and as it ends, shape (W, N, 2, 3).

        And by Coulomb's coefficient of each balloon on each obstacle, shape (W, B, N).
        """
        totals = np.asarray(self._totals.numpy(), dtype=np.float64)
        worlds, balloons, fixtures = self._totals.shape
        totals = totals.reshape(worlds, balloons, fixtures, WIDTH)
        return totals[..., :6].sum(axis=1).reshape(worlds, fixtures, 2, 3), totals[..., 6]
