"""Pressure, gas and air in the `gather` schedule."""

from typing import Any

import warp as wp

from balloon_warp.kernels.air import move_gases
from balloon_warp.kernels.gather import force_kernel
from balloon_warp.kernels.gather_air import finishing_kernel, start_particles, weigh_gases
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.tables import air_table, body_table, face_table, obstacle_table, string_table, water_table
from balloon_warp.schedules.traits import model_traits

WEIGHING_THREADS = 256
"""that sum up a balloon on a GPU; more would have too few registers"""


class GatherAir:
    """A substep of the particles in two halves.

    Args:
        springs: the spring table.
    """

    def __init__(self, model: Model, springs: Any):
        worlds, device = model.world_count, model.device
        self.model, self._traits = model, model_traits(model)
        self._masses = wp.zeros((worlds, model.balloon_count), dtype=float, device=device)
        self._bodies, self.bodies_with_gas = body_table(model), body_table(model, self._masses)
        self._faces, self._air, self._obstacles = face_table(model), air_table(model), obstacle_table(model)
        self._force_tables = [
            *(self._bodies, springs, string_table(model), water_table(model), self._faces, self._air),
        ]
        self._force_kernel = force_kernel(self._traits)
        self._finish_particles = finishing_kernel(self._traits.impulses)
        self._forces = wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world."""
        return VECTOR_BYTES * model.particle_count + 4 * model.balloon_count

    def advance_particles(
        self,
        state: State,
        time_in_frame: float,
        old: tuple[wp.array, wp.array],
        new: tuple[wp.array, wp.array],
        sphere_quanta: wp.array,
    ) -> None:
        """One substep from the old points and velocities to the new, all of shape (world_count, particle_count)."""
        m = self.model
        points, velocities = old
        new_points, new_velocities = new
        particles = (m.world_count, m.particle_count)
        self._launch(
            move_gases,
            m.world_count,
            *(self._bodies, self._air, time_in_frame, m.step_seconds),
            *(state.inflation_ramp, state.pressures, state.gas_amounts, self._masses),
        )
        self._launch(
            self._force_kernel,
            particles,
            *(*self._force_tables, m.step_seconds, points, velocities),
            *(state.inflation_aims, self._forces),
        )
        self._launch(
            start_particles,
            particles,
            *(self.bodies_with_gas, m.step_seconds, self._forces, velocities, new_velocities),
        )
        wp.launch_tiled(
            weigh_gases,
            dim=(m.world_count, m.balloon_count),
            inputs=[
                *(self.bodies_with_gas, self._faces, self._obstacles, self._air),
                *(time_in_frame, m.step_seconds),
                *(points, new_velocities, state.inflation_aims, state.inflation_ramp, state.gas_amounts),
                state.sphere_positions,
                *(state.inflation_loads, state.pressures),
            ],
            block_dim=WEIGHING_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        self._launch(
            self._finish_particles,
            particles,
            *(self.bodies_with_gas, self._obstacles, self._air),
            *(self._traits.forward_euler, self._traits.corrected, m.step_seconds, time_in_frame),
            *(state.inflation_aims, state.inflation_ramp, state.inflation_loads),
            *(state.sphere_positions, state.sphere_velocities, points, velocities),
            *(new_velocities, new_points, sphere_quanta),
        )

    def _launch(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        wp.launch(kernel, dim, inputs=list(arguments), device=self.model.device)
