"""Frames backwards: from the derivatives by where a frame ends to those by where it begins.

A frame is computed again from its beginning, and the values of each substep are kept. Then its substeps run backwards.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.sums import Bars, sum_kernel
from balloon_warp.kernels.compose import derive_helpers
from balloon_warp.kernels.schedules.writer import Step, values_of
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model, State, copy_of
from balloon_warp.model.memory import Room
from balloon_warp.schedules.backward_parts import TubesBackward
from balloon_warp.schedules.backward_spheres import SpheresBackward
from balloon_warp.schedules.backward_touch import STATE_OF_TOUCH, TouchBackward
from balloon_warp.schedules.launched import team_threads
from balloon_warp.schedules.tables import world_state
from balloon_warp.warp_lock import recording, replay

KEPT = (
    *("frame", "points", "velocities", "inflation_loads", "pressures", "gas_amounts", "free_volumes", "air_along"),
    *("sphere_positions", "sphere_velocities", "sphere_spins", "sphere_forces"),
)
"""Arrays of the state that a frame begins with"""


class BackwardFrames(ABC):
    """Run frames of a model backwards.

    Args:
        state: of the simulation, whose arrays hold the start of a frame; it stays as it is.
        columns: of the numbers of laws, those that are derived by.
        step: phases in pieces, as they are computed again.
        tables: of the model.
        one_by_one: whether kernels leave the bars of numbers with each particle; otherwise with its balloon.
    """

    carries_loads: bool
    """Whether the pressure of one substep is read in the next"""
    recorded = True
    """Whether a frame is recorded once, and replayed; not where threads share it, or launches are too many"""
    spheres: SpheresBackward | None = None
    """Adjoint of spheres, where there are any"""
    touch: TouchBackward | None = None
    """Adjoint of balloons that touch, where any may"""
    tubes: TubesBackward | None = None
    """Adjoint of gas that flows through tubes, where there are any"""

    def __init__(
        self, model: Model, state: State, columns: Sequence[int], step: Step, tables: Any, room: Room,
        one_by_one: bool = True,
    ):  # fmt: skip
        derive_helpers()
        self.model, self.columns, self.step, self.tables = model, tuple(columns), step, tables
        self.state = copy_of(state)
        self._sum_bars = sum_kernel(step.features, self.columns, one_by_one)
        self._first_pressures = wp.clone(state.pressures)
        self.bars, self.arrays = bar_arrays(model, step, len(self.columns), room, one_by_one)
        self._graph: Any = None

    @staticmethod
    @abstractmethod
    def room_of_frame(model: Model, room: Room) -> None:
        """Ask for the memory that the substeps of a frame keep."""

    @abstractmethod
    def frame(self) -> None:
        """Compute a frame again, and run its substeps backwards."""

    @property
    def carried_bars(self) -> dict[str, wp.array]:
        """Bars of the values that spheres and contacts carry from frame to frame, by their names in the state."""
        return {
            **(self.spheres.carried_bars if self.spheres else {}),
            **(self.touch.carried_bars if self.touch else {}),
        }

    def checkpoint(self, state: State, but: Collection[str] = ()) -> dict[str, wp.array]:
        """Return a copy of the arrays that a frame begins with, but for those that somebody else keeps."""
        return {name: wp.clone(getattr(state, name)) for name in self.kept_names if name not in but}

    @property
    def kept_names(self) -> tuple[str, ...]:
        """Names of the arrays of the state that a frame begins with."""
        return (*KEPT, *STATE_OF_TOUCH) if self.step.features.touches else KEPT

    def turn_back(self, checkpoint: Mapping[str, Any]) -> None:
        """Turn the bars of where a frame ends into those of where it begins.

        Args:
            checkpoint: arrays of the device, or of NumPy.
        """
        for name, array in checkpoint.items():
            getattr(self.state, name).assign(array)
        self._first_pressures.assign(checkpoint["pressures"])
        if not self.recorded:
            self.frame()
            self._add_up()
            return
        if self._graph is None:
            with recording(self.model.device) as capture:
                self.frame()
                self._add_up()
            self._graph = capture.graph
        replay(self._graph)

    def _add_up(self) -> None:
        inputs = [self.tables, world_state(self.state), self._first_pressures, self.bars]
        dim = self.model.world_count, self.model.balloon_count
        threads = team_threads(self.model)
        launch_tiled(self._sum_bars, dim=dim, inputs=inputs, block_dim=threads, device=self.model.device)

    def add(self, points: NDArray[np.float64], velocities: NDArray[np.float64], pressures: NDArray[np.float64]) -> None:
        """Add to the bars of where a frame ends, as they are now: arrays of all worlds."""
        bars = self.bars.points, self.arrays["all_velocity_bar"], self.bars.pressures
        for array, more in zip(bars, (points, velocities, pressures), strict=True):
            if more.any():
                array.assign((array.numpy() + more).astype(np.float32))

    def by_state(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of where a frame begins."""
        names = {"points": "all_point_bar", "velocities": "all_velocity_bar"}
        return {name: self.arrays[array].numpy().astype(np.float64) for name, array in names.items()} | self.by_gas()

    def by_gas(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of the pressures with which a frame begins."""
        found = {"pressures": self.arrays["all_pressure_bar"].numpy().astype(np.float64)}
        found["loads"] = np.zeros((self.model.world_count, self.model.balloon_count, 2))
        if self.carries_loads:
            loads, offsets = self.arrays["all_load_bar"].numpy().astype(np.float64), self.model.particle_offsets
            found["loads"] += np.stack([loads[:, a:b].sum(axis=1) for a, b in pairwise(offsets)], axis=1)
        return found


def bar_arrays(model: Model, step: Step, count: int, room: Room, one_by_one: bool) -> tuple[Any, dict[str, wp.array]]:
    """Allocate all bars, and return them as kernels once a frame take them, and as those of a substep do, by name."""
    particles, balloons = (model.world_count, model.particle_count), (model.world_count, model.balloon_count)
    each = (model.world_count, model.particle_count if one_by_one else 1)
    bars = Bars()
    bars.points, bars.pressures = room.array(particles, wp.vec3), room.array(balloons, wp.float32)
    bars.gas_masses_of_balloons = room.array(balloons, wp.float32)
    bars.gas_masses, bars.keyed = room.array(each, wp.float32), room.array(each, wp.vec2)
    bars.keyed_of_balloons, bars.gas = room.array(balloons, wp.vec2), room.array(balloons, wp.vec2)
    bars.numbers = room.array((*each, count), wp.float32)
    bars.numbers_of_balloons = room.array((*balloons, count), wp.float32)
    bars.number_totals = room.array((*balloons, count), wp.float64)
    bars.gas_totals, bars.keyed_totals = room.array(balloons, wp.vec2d), room.array(balloons, wp.vec2d)
    values = {
        f"all_{value}_bar": room.array(
            balloons if step.owner(value) == "balloon" else particles, wp.float32 if dtype is float else dtype
        )
        for value, dtype in values_of(step).items()
    }
    arrays = values | {
        "all_point_bar": bars.points, "all_velocity_bar": room.array(particles, wp.vec3),
        "all_pressure_bar": bars.pressures, "all_load_bar": room.array(particles, wp.vec2),
        "all_slope_bar": room.array(balloons, wp.float32),
        "all_gas_mass_bar": bars.gas_masses, "all_keyed_bar": bars.keyed,
        "all_keyed_bar_of_balloons": bars.keyed_of_balloons, "all_gas_bar": bars.gas,
        "number_bars": bars.numbers, "number_bars_of_balloons": bars.numbers_of_balloons,
    }  # fmt: skip
    return bars, arrays
