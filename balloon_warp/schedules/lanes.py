"""The `lanes` schedule: eight worlds side by side in a CPU core's vector registers, shared out to threads."""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.lanes import advance_groups
from balloon_warp.kernels.lanes_state import BALLOON_NUMBERS, LaneState, LaneTraits
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.refresh import refresh_ramp
from balloon_warp.schedules.tables import (
    air_table,
    body_table,
    correction_table,
    face_table,
    obstacle_table,
    spring_ends,
    spring_table,
    string_table,
    water_table,
    world_state,
)
from balloon_warp.schedules.traits import model_traits


class LanesSchedule:
    """Advances a state by whole frames, in place. Bit-reproducible, whatever the number of threads.

    A launch on the CPU runs on the thread that calls it and leaves the interpreter free meanwhile, so that each Python
    thread advances its own groups of worlds.

    Raises:
        InputError: the device is not the CPU.
    """

    name = "lanes"
    capturable = False

    def __init__(self, model: Model, thread_count: int | None = None):
        if not model.device.is_cpu:
            raise InputError(f"--schedule lanes: runs on the CPU (got {model.device}); block is its like for a GPU")
        self.model = model
        self._health = HealthCheck(model)
        group_count = -(-model.world_count // LANE_COUNT)
        thread_count = min(thread_count or os.cpu_count() or 1, group_count)
        self._threads = ThreadPoolExecutor(thread_count)
        self._shares = np.array_split(np.arange(group_count), thread_count)
        self._tables = [
            body_table(model),
            spring_table(model, spring_ends(model)),
            string_table(model),
            obstacle_table(model),
            face_table(model),
            water_table(model),
            air_table(model),
            correction_table(model),
        ]
        self._traits = _lane_traits(model)
        self._lanes = _lane_state(model, group_count)
        wp.load_module("balloon_warp.kernels.lanes", device=model.device)  # before the threads do

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        traits = model_traits(model)
        of_particles = 4 + traits.in_water + traits.in_air + traits.keeps_velocities
        vectors = of_particles * model.particle_count + 2 * model.face_count + model.sphere_count
        numbers = (BALLOON_NUMBERS + 1) * model.balloon_count + model.sphere_count + 1
        filled_up = LANE_COUNT * -(-model.world_count // LANE_COUNT)
        loads = 16 * traits.in_water * model.particle_count // LANE_COUNT
        return filled_up * (VECTOR_BYTES * vectors + 4 * numbers + loads) // model.world_count

    def advance_frame(self, state: State) -> None:
        """One frame: the groups of worlds on as many threads as there are cores."""
        refresh_ramp(self.model, state)
        worlds = world_state(state)
        for done in [self._threads.submit(self._advance_groups, worlds, share) for share in self._shares]:
            done.result()
        self._health.end_frame(state)

    def _advance_groups(self, worlds: Any, groups: np.ndarray) -> None:
        model = self.model
        wp.launch(
            advance_groups,
            len(groups),
            inputs=[
                *self._tables,
                self._traits,
                model.substeps,
                model.step_seconds,
                int(groups[0]),
                worlds,
                self._lanes,
            ],
            device=model.device,
        )


def _lane_traits(model: Model) -> Any:
    used = model_traits(model)
    traits = LaneTraits()
    traits.fresh_normals = model.scene.normals == "fresh"
    traits.rubber = used.rubber
    traits.in_air = used.in_air
    traits.forward_euler = used.forward_euler
    traits.impulses = used.impulses
    return traits


def _lane_state(model: Model, group_count: int) -> Any:
    def rows(count: int, dtype: Any) -> Any:
        return wp.zeros((group_count, count), dtype=dtype, device=model.device)

    lanes = LaneState()
    lanes.points = rows(model.particle_count, Lanes3)
    lanes.other_points = rows(model.particle_count, Lanes3)
    lanes.velocities = rows(model.particle_count, Lanes3)
    lanes.old_velocities = rows(model.particle_count if model_traits(model).keeps_velocities else 0, Lanes3)
    lanes.aims = rows(model.particle_count, Lanes3)
    lanes.area_vectors = rows(model.particle_count if model.in_air else 0, Lanes3)
    lanes.face_centers = rows(model.face_count, Lanes3)
    lanes.face_area_vectors = rows(model.face_count, Lanes3)
    lanes.balloon_areas = rows(model.balloon_count, Lanes)
    lanes.balloons = wp.zeros((group_count, model.balloon_count, BALLOON_NUMBERS), dtype=Lanes, device=model.device)
    lanes.sphere_centers = rows(model.sphere_count, Lanes3)
    lanes.sphere_squared_radii = rows(model.sphere_count, Lanes)
    lanes.water_forces = rows(model.particle_count if model.has_water else 0, Lanes3)
    lanes.water_loads = rows(model.particle_count if model.has_water else 0, wp.vec4)
    lanes.ground_heights = wp.zeros(group_count, dtype=Lanes, device=model.device)
    return lanes
