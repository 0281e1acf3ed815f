"""Spheres beside schedules whose particles leave them by themselves."""

from typing import Any

import warp as wp

from balloon_warp.kernels.gather import move_gathered_spheres, read_sphere_forces, write_sphere_forces
from balloon_warp.model import Model, State


class SphereMover:
    """Moves the spheres, and keeps the forces on them as whole numbers, which add up alike in any order."""

    def __init__(self, model: Model, bodies: Any, obstacles: Any):
        self._model = model
        self._bodies, self._obstacles = bodies, obstacles
        self.forces = wp.zeros((model.world_count, model.sphere_count, 3), dtype=wp.int64, device=model.device)
        """since the spheres last moved, see `kernels.fixed_point`, shape (world_count, sphere_count, 3)"""

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world."""
        return 24 * model.sphere_count

    def begin_frame(self, state: State) -> None:
        """Read the forces that the last frame left."""
        self._launch(read_sphere_forces, state.sphere_forces, self.forces)

    def move(self, state: State) -> None:
        """One substep under the forces since the last."""
        self._launch(
            move_gathered_spheres,
            *(self._bodies, self._obstacles, self._model.step_seconds),
            *(state.sphere_positions, state.sphere_velocities, self.forces),
        )

    def end_frame(self, state: State) -> None:
        """Leave the forces to the next frame."""
        self._launch(write_sphere_forces, self.forces, state.sphere_forces)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        model = self._model
        if model.sphere_count:
            shape = (model.world_count, model.sphere_count)
            wp.launch(kernel, shape, inputs=list(arguments), device=model.device)
