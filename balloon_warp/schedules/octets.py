"""The `octets` schedule: eight particles of a world side by side in a CPU core's vector registers. Bit-reproducible.

For one balloon: a whole frame in one launch.
"""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.octets import octet_kernel
from balloon_warp.kernels.octets_state import OCTET_NUMBERS, OctetState
from balloon_warp.model import Model, State
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.octet_tables import face_octet_count, octet_count, octet_faces, octet_springs
from balloon_warp.schedules.refresh import AimRefresher, refresh_ramp
from balloon_warp.schedules.tables import body_table, obstacle_table, spring_ends, string_table, world_state
from balloon_warp.schedules.traits import beyond_basics, model_traits

FAR_AWAY = 1e16
"""a coordinate [m] at which a face is nearest to no particle, and whose square is a finite float"""


class OctetsSchedule:
    """Advances a state by whole frames, in place.

    Raises:
        InputError: the device is not the CPU, or the model has what octets does not simulate.
    """

    name = "octets"
    capturable = True

    def __init__(self, model: Model):
        if not model.device.is_cpu:
            raise InputError(f"--schedule octets: runs on the CPU (got {model.device}); block is its like for a GPU")
        if beyond := beyond_basics(model):
            raise InputError(f"--schedule octets: does not simulate {beyond}; use gather")
        self.model = model
        self._health = HealthCheck(model)
        self._fresh_normals = model.scene.normals == "fresh"
        self._kernel = octet_kernel(self._fresh_normals, model.sphere_count > 0, model_traits(model).impulses)
        self._aims = AimRefresher(model)
        faces = octet_faces(model)
        self._tables = [
            body_table(model),
            octet_springs(model, spring_ends(model)),
            string_table(model),
            obstacle_table(model),
            faces,
        ]
        self._octets = _octet_state(model, faces)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        of_particles = octet_count(model.particle_count) * 4 * LANE_COUNT * (2 * 4 + 2 * 3 + OCTET_NUMBERS)
        of_faces = face_octet_count(model) * 4 * LANE_COUNT * 2 * 4
        corners = int(np.diff(model.face_offsets.numpy()).max())
        own = of_particles + of_faces + 2 * 16 + 4 * LANE_COUNT * (3 * corners + model.balloon_count)
        return own + AimRefresher.world_bytes(model)

    def advance_frame(self, state: State) -> None:
        """One frame in one launch, after the inflation is refreshed."""
        model = self.model
        refresh_ramp(model, state)
        if not self._fresh_normals:
            self._aims.refresh(state.points, state.inflation_aims)
        wp.launch(
            self._kernel,
            model.world_count,
            inputs=[
                *self._tables,
                model.substeps,
                model.step_seconds,
                world_state(state),
                self._octets,
            ],
            device=model.device,
        )
        self._health.end_frame(state)


def _octet_state(model: Model, faces: Any) -> Any:
    def rows(count: int, dtype: Any) -> Any:
        return wp.zeros((model.world_count, count), dtype=dtype, device=model.device)

    count = octet_count(model.particle_count)
    face_count = LANE_COUNT * faces.balloon.shape[0]
    far_away = np.zeros((model.world_count, face_count + 1, 4))
    far_away[:, face_count] = FAR_AWAY
    octets = OctetState()
    octets.points = rows(LANE_COUNT * count, wp.vec4)
    octets.other_points = rows(LANE_COUNT * count, wp.vec4)
    octets.velocities = rows(count, Lanes3)
    octets.aims = rows(count, Lanes3)
    octets.numbers = wp.zeros((model.world_count, count, OCTET_NUMBERS), dtype=Lanes, device=model.device)
    octets.corner_points = rows(faces.counting.shape[0], Lanes3)
    octets.face_centers = wp.array(far_away, dtype=wp.vec4, device=model.device)
    octets.face_area_vectors = rows(face_count + 1, wp.vec4)
    octets.balloon_areas = rows(model.balloon_count, Lanes)
    return octets
