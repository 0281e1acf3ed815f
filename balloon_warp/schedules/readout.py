"""Forces as they are shown and written, whatever the schedule."""

import warp as wp

from balloon_warp.kernels.gather import force_kernel
from balloon_warp.model import Model, State
from balloon_warp.schedules.refresh import AimRefresher, refresh_ramp
from balloon_warp.schedules.tables import body_table, face_table, spring_ends, spring_table, string_table, water_table
from balloon_warp.schedules.traits import model_traits


class ForceReader:
    """Finds the forces of a state, which a schedule need not keep."""

    def __init__(self, model: Model):
        self.model = model
        self._aims = AimRefresher(model)
        ends = spring_ends(model)
        self._kernel = force_kernel(model_traits(model))
        self._tables = [
            body_table(model),
            spring_table(model, ends),
            string_table(model),
            water_table(model),
            face_table(model),
        ]
        self._forces = wp.zeros((model.world_count, model.particle_count), dtype=wp.vec3, device=model.device)

    def refresh_inflation(self, state: State) -> None:
        """What a frame begins with: its ramp of k_normal, and each particle's aim."""
        refresh_ramp(self.model, state)
        self._aims.refresh(state.points, state.inflation_aims)

    def net_forces(self, state: State) -> wp.array:
        """On each particle at the start of a frame [N], shape (world_count, particle_count), vec3."""
        wp.launch(
            self._kernel,
            self._forces.shape,
            inputs=[*self._tables, 0.0, state.inflation_aims, state.inflation_ramp, state.points, state.velocities],
            outputs=[self._forces],
            device=self.model.device,
        )
        return self._forces
