"""Gas that comes and goes, backwards: its amount in a substep is found again, and its bar carried on."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.gas_changes import pump_again_kernel, pump_back_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.schedules.tables import world_state


class GasBackward:
    """Run the gas of balloons backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        working: of the launches that compute frames again.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, working: Any, bars: Any
    ):
        self._model, self._tables, self._working, self._bars = model, tables, working, bars
        self._pump_again = pump_again_kernel(features)
        self._pump_back = pump_back_kernel(features, columns)
        places = (model.world_count, model.balloon_count)
        self._amounts, self._free_volumes = (wp.zeros(places, dtype=wp.float64, device=model.device) for _ in range(2))

    def found_again(self, state: State, carried: Mapping[str, wp.array], substep: int) -> dict[str, wp.array]:
        """Find how much gas there was in a substep, and return it by its names in the state."""
        found = {"gas_amounts": self._amounts, "free_volumes": self._free_volumes}
        for name, array in found.items():
            wp.copy(array, carried[name])
        pumping = replace(state, **found, pressures=carried["pressures"])
        inputs = [self._tables, world_state(pumping), self._working, substep * self._model.step_seconds]
        launch(self._pump_again, self._model.world_count, inputs, device=self._model.device)
        return found

    def turn_back(self, state: State, carried: Mapping[str, wp.array], substep: int) -> None:
        """Run the gas update of a substep backwards."""
        before = replace(state, **carried)
        inputs = [
            self._tables, world_state(before), self._amounts, substep * self._model.step_seconds, self._bars,
        ]  # fmt: skip
        places = (self._model.world_count, self._model.balloon_count)
        launch(self._pump_back, places, inputs, device=self._model.device)
