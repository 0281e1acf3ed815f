"""Forces as they are shown and written, whatever the schedule."""

from functools import cached_property
from typing import Any

import warp as wp

from balloon_warp.kernels.frame import add_inflation_forces
from balloon_warp.model import Model, State
from balloon_warp.schedules.refresh import AimRefresher, refresh_ramp
from balloon_warp.schedules.tables import (
    air_table,
    body_table,
    face_table,
    spring_ends,
    spring_table,
    string_table,
    water_table,
)
from balloon_warp.schedules.traits import model_traits


class ForceReader:
    """Finds the forces of a state, which a schedule need not keep."""

    def __init__(self, model: Model):
        self.model = model
        self._aims = AimRefresher(model)
        self._bodies, self._air = body_table(model), air_table(model)
        self._forces = wp.zeros((model.world_count, model.particle_count), dtype=wp.vec3, device=model.device)

    def refresh_inflation(self, state: State) -> None:
        """What a frame begins with: its ramp, such as of k_normal, and each particle's aim."""
        refresh_ramp(self.model, state)
        self._aims.refresh(state.points, state.inflation_aims)
        if self.model.in_air:
            self._sum_forces(state)

    def inflation_forces(self, state: State) -> wp.array:
        """On each particle at the start of a frame [N], shape (world_count, particle_count), vec3."""
        self._forces.zero_()
        self._add_inflation_forces(state)
        return self._forces

    def net_forces(self, state: State) -> wp.array:
        """On each particle at the start of a frame [N], shape (world_count, particle_count), vec3."""
        self._sum_forces(state)
        self._add_inflation_forces(state)
        return self._forces

    def _sum_forces(self, state: State) -> None:
        """All but the inflation's, and the aims that are area vectors."""
        kernel, tables = self._force_kernel
        self._launch(
            kernel,
            *(*tables, 0.0, state.points, state.velocities),
            *(state.inflation_aims, self._forces),
        )

    @cached_property
    def _force_kernel(self) -> tuple[Any, list[Any]]:
        """The kernel and its tables, of which most scenes have no need."""
        from balloon_warp.kernels.gather import force_kernel

        model = self.model
        springs, strings = spring_table(model, spring_ends(model)), string_table(model)
        tables = [self._bodies, springs, strings, water_table(model), face_table(model), self._air]
        return force_kernel(model_traits(model)), tables

    def _add_inflation_forces(self, state: State) -> None:
        self._launch(
            add_inflation_forces,
            *(self._bodies, self._air),
            *(state.points, state.inflation_aims, state.inflation_ramp, state.inflation_loads),
            self._forces,
        )

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        wp.launch(kernel, self._forces.shape, inputs=list(arguments), device=self.model.device)
