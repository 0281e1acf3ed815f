"""Where the inflation of normal forces pushes."""

from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.aims import aim_inflation, measure_faces, sum_face_areas
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model
from balloon_warp.model.memory import Room

SUM_THREADS = 1024
"""that sum the faces of a balloon on a GPU"""


class AimRefresher:
    """Aims the inflation by normal forces, the same to the last bit every time."""

    def __init__(self, model: Model, tables: Any, room: Room):
        self.model, self._tables = model, tables
        self._centers, self._area_vectors, self._areas = self.arrays(model, room)

    @staticmethod
    def arrays(model: Model, room: Room) -> tuple[Any, Any, Any]:
        """What it keeps: centers and area vectors of faces, and areas of balloons."""
        faces = (model.world_count, model.face_count)
        return (
            room.array(faces, wp.vec3),
            room.array(faces, wp.vec3),
            room.array((model.world_count, model.balloon_count), wp.float32),
        )

    def refresh(self, points: wp.array, aims: wp.array) -> None:
        """Fill `aims` for `points`, both of shape (world_count, particle_count)."""
        m, t = self.model, self._tables
        measured = [self._centers, self._area_vectors]
        launch(measure_faces, (m.world_count, m.face_count), [t.faces, points], measured, device=m.device)
        launch_tiled(
            sum_face_areas,
            dim=(m.world_count, m.balloon_count),
            inputs=[t.faces, self._area_vectors],
            outputs=[self._areas],
            block_dim=SUM_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        inputs = [t.particles, t.faces, points, *measured, self._areas]
        launch(aim_inflation, points.shape, inputs, [aims], device=m.device)
