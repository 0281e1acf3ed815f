"""What is refreshed once a frame, or once a substep, beside the particles: the inflation's ramp and aims."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.areas import sum_face_areas
from balloon_warp.kernels.frame import aim_inflation, measure_faces, ramp_inflation
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES

GPU_SUM_THREADS = 1024
"""threads that sum the faces of a balloon"""


def refresh_ramp(model: Model, state: State) -> None:
    """The inflation coefficients of the frame that begins."""
    wp.launch(
        ramp_inflation,
        (model.world_count, model.balloon_count),
        inputs=[model.keyframe_times, model.keyframe_values, model.frame_seconds, state.frame, state.inflation_ramp],
        device=model.device,
    )


class AimRefresher:
    """Refreshes `State.inflation_aims` from points, the same to the last bit every time."""

    def __init__(self, model: Model):
        worlds, device = model.world_count, model.device
        face_counts = [shape.mesh.face_count for shape in model.shapes]
        self.model = model
        self._balloon_face_offsets = wp.array(np.cumsum([0, *face_counts]), dtype=wp.int32, device=device)
        self._face_centers = wp.zeros((worlds, model.face_count), dtype=wp.vec3, device=device)
        self._face_area_vectors = wp.zeros((worlds, model.face_count), dtype=wp.vec3, device=device)
        self._balloon_areas = wp.zeros((worlds, model.balloon_count), dtype=float, device=device)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world."""
        return 2 * VECTOR_BYTES * model.face_count + 4 * model.balloon_count

    def refresh(self, points: wp.array, aims: wp.array) -> None:
        """Fill `aims` for `points`, both of shape (world_count, particle_count)."""
        m = self.model
        self._launch(
            measure_faces,
            (m.world_count, m.face_count),
            *(m.face_offsets, m.face_particles),
            points,
            *(self._face_centers, self._face_area_vectors),
        )
        wp.launch_tiled(
            sum_face_areas,
            dim=(m.world_count, m.balloon_count),
            inputs=[self._balloon_face_offsets, self._face_area_vectors, self._balloon_areas],
            block_dim=GPU_SUM_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        self._launch(
            aim_inflation,
            (m.world_count, m.particle_count),
            *(m.particle_balloon, m.particle_face_offsets, m.particle_faces),
            *(points, self._face_centers, self._face_area_vectors, self._balloon_areas),
            aims,
        )

    def _launch(self, kernel: Any, dim: tuple[int, int], *arguments: Any) -> None:
        wp.launch(kernel, dim, inputs=list(arguments), device=self.model.device)
