"""Gas that flows through tubes, and openings beside them, backwards: a substep's flow is found again."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.tubes import TubeBars, tubes_back_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.tubes import SWEEPS
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.schedules.tables import world_state

CONDUCTANCE = "tube_conductance"
"""Name of the parameter"""


class TubesBackward:
    """Run the flow through tubes backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        arrays: bars of the substep that runs backwards, by name.
        of_frame: bars of the frame.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, arrays: Mapping[str, wp.array],
        of_frame: Any,
    ):  # fmt: skip
        self._model, self._tables, self._of_frame = model, tables, of_frame
        self._back = tubes_back_kernel(features, columns)
        vented = model.balloon_count if features.vents else 0
        worlds, balloons, tubes = model.world_count, model.balloon_count, model.tube_count
        self._bars = bars = TubeBars()
        with wp.ScopedDevice(model.device):
            bars.loads, bars.slopes = arrays["all_load_bar"], arrays["all_slope_bar"]
            bars.pressures = wp.zeros((worlds, balloons), dtype=wp.float32)
            bars.flows = wp.zeros((worlds, tubes), dtype=wp.float32)
            bars.conductances = wp.zeros((worlds, tubes), dtype=wp.float64)
            bars.vents = wp.zeros((worlds, vented), dtype=wp.float32)
            bars.swept = wp.zeros((worlds, (tubes + vented) * SWEEPS), dtype=wp.vec3)
            bars.moved = wp.zeros((worlds, tubes + 1, balloons), dtype=wp.vec2d)
            self._again = {
                "pressures": wp.zeros((worlds, balloons), dtype=wp.float32),
                "pressure_slopes": wp.zeros((worlds, balloons), dtype=wp.float32),
                "inflation_loads": wp.zeros((worlds, balloons), dtype=wp.vec2),
                "tube_flows": wp.zeros((worlds, tubes), dtype=wp.float32),
                "vent_flows": wp.zeros((worlds, vented), dtype=wp.float32),
                "gas_amounts": wp.zeros((worlds, balloons), dtype=wp.float64),
                "free_volumes": wp.zeros((worlds, balloons), dtype=wp.float64),
            }

    def turn_back(self, state: State, gas: Mapping[str, wp.array], loads: wp.array, substep: int) -> None:
        """Turn the bars of pressures and gases after the flow in a substep into those before.

        Args:
            gas: amounts and free volumes before the flow, by their names in the state.
            loads: of the gas before the flow.
        """
        for name, array in gas.items():
            wp.copy(self._again[name], array)
        again = world_state(replace(state, **self._again))
        inputs = [self._tables, again, loads, substep * self._model.step_seconds, self._bars, self._of_frame]
        launch(self._back, self._model.world_count, inputs, device=self._model.device)

    def taken_numbers(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of conductances since they were last taken, by the name of the parameter."""
        totals = np.asarray(self._bars.conductances.numpy(), dtype=np.float64).copy()
        self._bars.conductances.zero_()
        return {CONDUCTANCE: totals}
