"""Spheres backwards: their bars from particles in a substep are added up, and carried on.

The events that change their courses in a substep are computed again from its start.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.rolling import roll_back_kernel
from balloon_warp.kernels.adjoints.spheres import (
    COLUMNS,
    EVENTS_OF_A_SPHERE,
    BarsOfSpheres,
    Event,
    LoggedSpheres,
    roll_again_kernel,
    sum_sphere_bars,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import SphereBars
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.model.obstacles import FRICTION
from balloon_warp.schedules.launched import team_threads
from balloon_warp.schedules.tables import world_state

STATE_OF_SPHERES = ("sphere_positions", "sphere_velocities", "sphere_spins")
"""Arrays of the state that a substep takes from the one before"""
OF_OBSTACLES = "obstacle_restitution"
"""Name of the restitution of obstacles in the parameters"""


class SpheresBackward:
    """Run the spheres of all worlds backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        working: of the launches that compute frames again.
        bars: of the frame.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, working: Any, bars: Any,
        room: Room,
    ):  # fmt: skip
        self._model, self._tables, self._working, self._of_frame = model, tables, working, bars
        self._roll_again, self._roll_back = roll_again_kernel(features), roll_back_kernel(features, columns)
        worlds, spheres = model.world_count, model.sphere_count
        working.sphere_bars = room.array((worlds, model.particle_count, spheres), SphereBars)
        working.sphere_push_bars = room.array((worlds, spheres), wp.vec3)
        self.bars = BarsOfSpheres()
        for name in ("positions", "velocities", "spins", "starts"):
            setattr(self.bars, name, room.array((worlds, spheres), wp.vec3))
        self.bars.totals = room.array((worlds, spheres), SphereBars)
        self.bars.numbers = room.array((worlds, spheres, len(COLUMNS)), wp.float64)
        things = model.parameters[FRICTION].shape[1]
        self.bars.frictions = room.array((worlds, things, things), wp.float64)
        of_exchange = model.particle_count if features.impulses and features.spheres_rub else 0
        self.bars.rubs = room.array((worlds, of_exchange, spheres), wp.float32)
        self.bars.fixture_restitutions = room.array((worlds, len(model.obstacles)), wp.float64)
        self.bars.crowded = room.array(worlds, wp.int32)
        self.log = log_of_spheres(model, room)
        """Courses of spheres in the substep that runs backwards"""
        of_penalties = spheres if features.penalties else 0
        self._quanta = [room.array((worlds, of_penalties, 3), wp.int64) for _ in range(model.substeps)]
        """Forces on spheres as each substep begins, by the paper's rule"""

    @property
    def carried_bars(self) -> dict[str, wp.array]:
        """Bars of the values that go on into the next frame, by their names in the state."""
        bars = self.bars.positions, self.bars.velocities, self.bars.spins
        return {**dict(zip(STATE_OF_SPHERES, bars, strict=True)), "sphere_forces": self._working.sphere_push_bars}

    def note(self, substep: int) -> None:
        """Keep the forces with which a substep begins."""
        wp.copy(self._quanta[substep], self._working.sphere_quanta)

    def found_again(self, state: State, carried: Mapping[str, wp.array], substep: int) -> dict[str, wp.array]:
        """Move spheres again, and return where they were as particles moved, by its names in the state.

        Args:
            carried: the arrays that the substep began with, by their names in the state.
        """
        model, time = self._model, substep * self._model.step_seconds
        inputs = [self._tables, world_state(replace(state, **carried)), self._quanta[substep], time, self.log]
        launch(self._roll_again, model.world_count, inputs, device=model.device)
        return {name: getattr(self.log, name) for name in STATE_OF_SPHERES}

    def turn_back(self, substep: int) -> None:
        """Run the motion of spheres in a substep, which has been computed again, backwards."""
        device, model, time = self._model.device, self._model, substep * self._model.step_seconds
        inputs = [self._working, self.bars]
        places = (model.world_count, model.sphere_count)
        launch_tiled(sum_sphere_bars, dim=places, inputs=inputs, block_dim=team_threads(model), device=device)
        quanta = self._quanta[substep]
        inputs = [self._tables, self.log, quanta, self._working, time, self.bars, self._of_frame]
        launch(self._roll_back, model.world_count, inputs, device=device)

    def add(self, positions: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Add to the bars of where a frame ends, as they are now: arrays of all worlds."""
        for array, more in ((self.bars.positions, positions), (self.bars.velocities, velocities)):
            if more.any():
                array.assign((array.numpy() + more).astype(np.float32))

    def by_start(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of where spheres start, by the names of parameters."""
        return {
            f"initial_sphere_{name}": getattr(self.bars, name).numpy().astype(np.float64)
            for name in ("positions", "velocities", "spins")
        }

    def taken_numbers(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of spheres' numbers since they were last taken, by the names of parameters."""
        arrays = (self.bars.numbers, self.bars.frictions, self.bars.fixture_restitutions)
        numbers, frictions, restitutions = (np.asarray(array.numpy(), dtype=np.float64).copy() for array in arrays)
        for array in arrays:
            array.zero_()
        rubs, first = np.asarray(self.bars.rubs.numpy(), dtype=np.float64), 1 + len(self._model.obstacles)
        self.bars.rubs.zero_()
        balloons = frictions[:, -self._model.balloon_count :, first : first + self._model.sphere_count]
        for number, (begin, end) in enumerate(pairwise(self._model.particle_offsets)):
            balloons[:, number] += rubs[:, begin:end].sum(axis=1)
        of_columns = {name: numbers[..., column] for column, name in enumerate(COLUMNS)}
        return of_columns | {FRICTION: frictions, OF_OBSTACLES: restitutions}

    def crowded_worlds(self) -> NDArray[np.intp]:
        """Return the worlds in which spheres have met more in a substep than there is room for."""
        return np.flatnonzero(self.bars.crowded.numpy())


def log_of_spheres(model: Model, room: Room) -> Any:
    """Allocate the courses of spheres in a substep, and the events that change them."""
    worlds, spheres = model.world_count, model.sphere_count
    log = LoggedSpheres()
    for name in ("positions", "velocities", "spins", "starts"):
        setattr(log, f"sphere_{name}", room.array((worlds, spheres), wp.vec3))
    log.events = room.array((worlds, EVENTS_OF_A_SPHERE * spheres), Event)
    log.counts = room.array(worlds, wp.int32)
    return log
