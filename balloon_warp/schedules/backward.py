"""Frames backwards: directions, each spring, obstacles, gas, strings and tubes, by launches.

Derivatives by where obstacles are, by the keyframes of their motion, and by the friction of balloons on them.

Particles note their derivatives by each obstacle, which are added up once a frame.

Frames backwards: from the derivatives by where a frame ends to those by where it begins.

A frame is computed again from its beginning, and the values of each substep are kept. Then its substeps run backwards.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.gas import TubeBars, pump_again_kernel, pump_back_kernel, tubes_back_kernel
from balloon_warp.kernels.adjoints.pull import DirectionBars, add_up_totals, gather_from_faces, hand_on_to_faces
from balloon_warp.kernels.adjoints.solids import WIDTH, Totals, sum_fixture_bars
from balloon_warp.kernels.adjoints.springs import (
    StringBars,
    springs_back_kernel,
    strings_back_kernel,
    triangles_back_kernel,
)
from balloon_warp.kernels.adjoints.sums import Bars, sum_kernel
from balloon_warp.kernels.compose import derive_helpers
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.gas import SWEEPS
from balloon_warp.kernels.schedules.writer import Step, values_of
from balloon_warp.kernels.working import FixtureBars
from balloon_warp.model import Model, State, copy_of
from balloon_warp.model.state import Allocating, Room
from balloon_warp.schedules.backward_contact import STATE_OF_TOUCH, BackwardModel, SpheresBackward, TouchBackward
from balloon_warp.schedules.launched import team_threads
from balloon_warp.schedules.tables import world_state
from balloon_warp.system.warp_threads import launch, launch_tiled, recording, replay


class DirectionsBackward:
    """Run the directions of normal forces backwards: once a frame, or every substep.

    Args:
        working: of the launches that compute frames again; particles leave the bars of their directions there.
        point_bars: by where particles are, to which is added.
    """

    def __init__(self, model: Model, tables: Any, working: Any, point_bars: wp.array, room: Room):
        self._model, self._tables, self._working, self._point_bars = model, tables, working, point_bars
        particles, balloons = (model.world_count, model.particle_count), (model.world_count, model.balloon_count)
        working.direction_bars = room.array(particles, wp.vec3)
        self._bars = DirectionBars()
        self._bars.of_sums, self._bars.nearest = room.array(particles, wp.vec3), room.array(particles, wp.int32)
        self._bars.of_areas, self._bars.of_totals = (room.array(particles, wp.float32) for _ in range(2))
        self._bars.totals = room.array(balloons, wp.float32)

    def turn_back(self, points: wp.array, areas: wp.array) -> None:
        """Backward pass of directions into bars of points.

        Args:
            points: from which the directions were found.
            areas: of balloons then [m^2].
        """
        model, bars = self._model, self._bars
        places, device = (model.world_count, model.particle_count), model.device
        launch(hand_on_to_faces, places, [self._tables, self._working, points, areas, bars], device=device)
        balloons, threads = (model.world_count, model.balloon_count), team_threads(model)
        launch_tiled(add_up_totals, dim=balloons, inputs=[self._tables, bars], block_dim=threads, device=device)
        launch(gather_from_faces, places, [self._tables, points, bars, self._point_bars], device=device)


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


class GasBackward:
    """Run the gas of balloons backwards, a substep at a time."""

    def __init__(self, of: BackwardModel):
        self._model, self._tables, self._working, self._bars = of.model, of.tables, of.working, of.bars
        self._pump_again = pump_again_kernel(of.features)
        self._pump_back = pump_back_kernel(of.features, of.columns)
        places, device = (of.model.world_count, of.model.balloon_count), of.model.device
        self._amounts, self._free_volumes = (wp.zeros(places, dtype=wp.float64, device=device) for _ in range(2))

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


CONDUCTANCE = "tube_conductance"
"""Name of the parameter"""


class TubesBackward:
    """Run the flow through tubes backwards, a substep at a time."""

    def __init__(self, of: BackwardModel):
        self._model, self._tables, self._of_frame = of.model, of.tables, of.bars
        self._back = tubes_back_kernel(of.features, of.columns)
        model, arrays = of.model, of.arrays
        vented = model.balloon_count if of.features.vents else 0
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
        """Backward pass of pressures and gases through a substep's flow.

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
        self, model: Model, state: State, columns: Sequence[int], step: Step, tables: Any, one_by_one: bool = True
    ):
        derive_helpers()
        self.room = Allocating(model.device)
        self.model, self.columns, self.step, self.tables = model, tuple(columns), step, tables
        self.state = copy_of(state)
        self._sum_bars = sum_kernel(step.features, self.columns, one_by_one)
        self._first_pressures = wp.clone(state.pressures)
        self.bars, self.arrays = bar_arrays(model, step, len(self.columns), self.room, one_by_one)
        self._graph: Any = None

    @staticmethod
    @abstractmethod
    def room_of_frame(model: Model, room: Room) -> None:
        """Allocate the memory of a frame's substeps."""

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
        """Backward pass of a frame: from the bars of its end to those of its start.

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
