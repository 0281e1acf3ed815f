"""Derivatives by the numbers of each spring and each triangle, where they are asked for; by launches."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.each import springs_back_kernel, triangles_back_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.launching import launch
from balloon_warp.model import Model

BYTES = {"springs": 16, "triangles": 32}
"""Device memory that each takes in a world"""


def bytes_of_each(model: Model) -> int:
    """Return the device memory of a world."""
    return BYTES["springs"] * model.spring_count + BYTES["triangles"] * model.triangle_count


class EachBackward:
    """Add up the bars of each spring and each triangle, a substep at a time.

    Args:
        arrays: bars of the substep that runs backwards, by name.
    """

    def __init__(self, model: Model, features: Features, tables: Any, arrays: Mapping[str, wp.array]):
        self._model, self._tables, self._force_bars = model, tables, arrays["all_force_bar"]
        self._of_springs = springs_back_kernel(features) if model.spring_count else None
        self._of_triangles = triangles_back_kernel(features) if model.triangle_count else None
        with wp.ScopedDevice(model.device):
            self._springs = wp.zeros((model.world_count, model.spring_count), dtype=wp.vec2d)
            self._triangles = wp.zeros((model.world_count, model.triangle_count), dtype=wp.vec4d)

    def turn_back(self, frame: wp.array, time_in_frame: float, points: wp.array, velocities: wp.array) -> None:
        """Add the derivatives of a substep, once its particles have run backwards."""
        model, device = self._model, self._model.device
        moving = [points, velocities, self._force_bars]
        if self._of_springs:
            inputs = [self._tables, frame, time_in_frame, *moving, self._springs]
            launch(self._of_springs, (model.world_count, model.spring_count), inputs, device=device)
        if self._of_triangles:
            inputs = [self._tables, *moving, self._triangles]
            launch(self._of_triangles, (model.world_count, model.triangle_count), inputs, device=device)

    def found(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the bars of rest lengths and constants, shape (W, springs, 2), and of rest metrics, (W, T, 4)."""
        springs, triangles = (np.asarray(array.numpy(), dtype=np.float64) for array in (self._springs, self._triangles))
        return springs.reshape(*self._springs.shape, 2), triangles.reshape(*self._triangles.shape, 4)
