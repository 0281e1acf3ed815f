"""Pressure, gas and air in the `scatter` schedule."""

from typing import Any

import warp as wp

from balloon_warp.kernels.air import move_gases
from balloon_warp.kernels.gas import Swelling
from balloon_warp.kernels.scatter_air import (
    add_drag_and_swelling,
    add_faces_to_swelling,
    add_pressure_forces,
    find_loads,
)
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.tables import air_table, body_table, face_table, obstacle_table


class ScatterAir:
    """What a substep does beside the other forces."""

    def __init__(self, model: Model):
        worlds, device = model.world_count, model.device
        self.model = model
        self.masses = wp.zeros((worlds, model.balloon_count), dtype=float, device=device)
        """of the balloons with their gas [kg], shape (world_count, balloon_count)"""
        self._bodies, self._bodies_with_gas = body_table(model), body_table(model, self.masses)
        self._air, self._faces, self._obstacles = air_table(model), face_table(model), obstacle_table(model)
        self._area_vectors = wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device)
        self._swellings = wp.zeros((worlds, model.balloon_count), dtype=Swelling, device=device)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world."""
        return VECTOR_BYTES * model.particle_count + (4 + 20) * model.balloon_count

    def move_gas(self, state: State, time_in_frame: float) -> None:
        """What is pumped, and flows through tubes."""
        m = self.model
        self._launch(
            move_gases,
            m.world_count,
            *(self._bodies, self._air, time_in_frame, m.step_seconds),
            *(state.inflation_ramp, state.pressures, state.gas_amounts, self.masses),
        )

    def add_forces(self, state: State, time_in_frame: float, forces: wp.array) -> None:
        """Drag, and under all forces so far, the pressures and what they push with, to `forces`."""
        m = self.model
        particles = (m.world_count, m.particle_count)
        self._area_vectors.zero_()
        self._swellings.zero_()
        self._launch(
            add_faces_to_swelling,
            (m.world_count, m.face_count),
            *(self._faces, state.points, self._area_vectors, self._swellings),
        )
        self._launch(
            add_drag_and_swelling,
            particles,
            *(self._bodies_with_gas, self._air, self._obstacles, m.step_seconds),
            *(state.points, state.velocities, state.sphere_positions, self._area_vectors, state.inflation_loads),
            *(forces, self._swellings),
        )
        self._launch(
            find_loads,
            (m.world_count, m.balloon_count),
            *(self._bodies, self._air, time_in_frame, m.step_seconds),
            *(state.inflation_ramp, state.gas_amounts, self._swellings),
            *(state.inflation_loads, state.pressures),
        )
        self._launch(
            add_pressure_forces,
            particles,
            *(self._bodies, self._air, state.points, self._area_vectors, state.inflation_loads),
            *(forces, state.inflation_aims),
        )

    def _launch(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        wp.launch(kernel, dim, inputs=list(arguments), device=self.model.device)
