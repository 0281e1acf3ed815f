"""Derivatives by the strings' own numbers, where they are asked for; by launches."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.strings import StringBars, strings_back_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.launching import launch
from balloon_warp.model import Model

ANCHOR, LENGTH, STIFFNESS = "string_anchor", "string_length", "string_stiffness"
OF_STRINGS = (ANCHOR, LENGTH, STIFFNESS)
"""Names of the parameters"""


class StringsBackward:
    """Add up the bars of strings, a substep at a time.

    Args:
        arrays: bars of the substep that runs backwards, by name.
    """

    def __init__(self, model: Model, features: Features, tables: Any, arrays: Mapping[str, wp.array]):
        self._model, self._tables, self._force_bars = model, tables, arrays["all_force_bar"]
        self._back = strings_back_kernel(features)
        with wp.ScopedDevice(model.device):
            self._bars = wp.zeros((model.world_count, model.string_count), dtype=StringBars)

    def turn_back(self, frame: wp.array, time_in_frame: float, points: wp.array, velocities: wp.array) -> None:
        """Add the derivatives of a substep, once its particles have run backwards."""
        inputs = [self._tables, frame, time_in_frame, points, velocities, self._force_bars, self._bars]
        launch(self._back, (self._model.world_count, self._model.string_count), inputs, device=self._model.device)

    def taken_numbers(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars since they were last taken, by the names of the parameters."""
        totals = np.asarray(self._bars.numpy(), dtype=np.float64).copy()
        self._bars.zero_()
        return {ANCHOR: totals[..., :3], LENGTH: totals[..., 3], STIFFNESS: totals[..., 4]}
