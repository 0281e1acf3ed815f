"""The `gather` schedule: a thread a particle, which sums the forces of its own springs. Bit-reproducible.

For one large balloon: two buffers of points, one kernel a substep, and one more for the spheres where there are any.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.gather import meeting_kernel, particle_kernel
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.correct import Corrector
from balloon_warp.schedules.gather_air import GatherAir
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.refresh import AimRefresher, refresh_ramp
from balloon_warp.schedules.spheres import SphereMover
from balloon_warp.schedules.tables import (
    air_table,
    body_table,
    face_table,
    obstacle_table,
    spring_ends,
    spring_table,
    string_table,
    water_table,
)
from balloon_warp.schedules.traits import model_traits


class GatherSchedule:
    """Advances a state by whole frames, in place."""

    name = "gather"
    capturable = True

    def __init__(self, model: Model):
        self.model = model
        self._health = HealthCheck(model)
        self._bodies = body_table(model)
        ends = spring_ends(model)
        self._traits = model_traits(model)
        self._kernel = particle_kernel(self._traits)
        self._meet_obstacles = meeting_kernel(self._traits.impulses)
        self._corrector = Corrector(model)
        self._springs = spring_table(model, ends)
        self._strings = string_table(model)
        self._obstacles = obstacle_table(model)
        self._water = water_table(model)
        self._air_table = air_table(model)
        self._faces = face_table(model)
        self._aims = AimRefresher(model)
        self._air = GatherAir(model, self._springs) if model.in_air else None
        shape = model.world_count, model.particle_count
        self._other_points = wp.zeros(shape, dtype=wp.vec3, device=model.device)
        self._other_velocities = None
        if self._traits.keeps_velocities:
            self._other_velocities = wp.zeros(shape, dtype=wp.vec3, device=model.device)
        self._spheres = SphereMover(model, self._bodies, self._obstacles)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        vectors = 2 if model_traits(model).keeps_velocities else 1
        refreshed = AimRefresher.world_bytes(model) + (GatherAir.world_bytes(model) if model.in_air else 0)
        return VECTOR_BYTES * vectors * model.particle_count + SphereMover.world_bytes(model) + refreshed

    def advance_frame(self, state: State) -> None:
        """One frame: the inflation refreshed, then every substep."""
        model = self.model
        bodies = self._air.bodies_with_gas if self._air else self._bodies
        refresh_ramp(model, state)
        self._spheres.begin_frame(state)
        points, new_points = state.points, self._other_points
        velocities = state.velocities
        new_velocities = velocities if self._other_velocities is None else self._other_velocities
        for substep in range(model.substeps):
            if substep == 0 or model.scene.normals == "fresh":
                self._aims.refresh(points, state.inflation_aims)
            self._spheres.move(state)
            old, new = (points, velocities), (new_points, new_velocities)
            self._advance_particles(state, substep * model.step_seconds, old, new)
            if self._traits.corrected:
                self._corrector.correct(*new)
                self._launch(
                    self._meet_obstacles,
                    (model.world_count, model.particle_count),
                    *(bodies, self._obstacles, self._air_table, model.step_seconds, substep * model.step_seconds),
                    *(state.inflation_aims, state.inflation_ramp, state.inflation_loads),
                    *(state.sphere_positions, state.sphere_velocities),
                    *(*new, self._spheres.forces),
                )
            points, new_points = new_points, points
            velocities, new_velocities = new_velocities, velocities
        if points is not state.points:
            wp.copy(state.points, points)
        if velocities is not state.velocities:
            wp.copy(state.velocities, velocities)
        self._spheres.end_frame(state)
        self._health.end_frame(state)

    def _advance_particles(
        self, state: State, time_in_frame: float, old: tuple[wp.array, wp.array], new: tuple[wp.array, wp.array]
    ) -> None:
        """One substep from the old points and velocities to the new."""
        model = self.model
        if self._air:
            self._air.advance_particles(state, time_in_frame, old, new, self._spheres.forces)
            return
        self._launch(
            self._kernel,
            (model.world_count, model.particle_count),
            *(self._bodies, self._springs, self._strings, self._obstacles, self._water, self._faces),
            *(model.step_seconds, time_in_frame),
            *(state.inflation_aims, state.inflation_ramp, state.sphere_positions, state.sphere_velocities),
            *old,
            *new,
            self._spheres.forces,
        )

    def _launch(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        wp.launch(kernel, dim, inputs=list(arguments), device=self.model.device)
