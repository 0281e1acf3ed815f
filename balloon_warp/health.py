"""Whether each world is still one: a look at every particle and sphere after each frame, on the device."""

import numpy as np
import warp as wp

from balloon_warp.kernels.frame import find_bad
from balloon_warp.model import Model, State

HEALTHY = np.iinfo(np.int32).max
"""no particle or sphere of a world is bad"""
MOST_SPAN = 1.0e5
"""from one particle of a balloon to another, over its size at the start: float32 then resolves a hundredth of that, and
no spring's length any more"""
FARTHEST = 1.0e7
"""from the origin, over the size of the largest thing in the world: float32 then resolves no more than that thing as a
whole. From rest, what is a meter large gets there by falling freely for 24 minutes."""
LEAST_SIZE = 1.0
"""[m], of that largest thing: small balloons may fall or rise as long as large ones"""
PARTICLES_A_THREAD = 4
"""on a GPU"""
LARGEST_ROOT = 1.0e19
"""whose square is a float32"""


class HealthCheck:
    """Finds the worlds that left the finite numbers, or whose particles or spheres are where they cannot be.

    It reads the points that the frame has just written, once, and nothing else that grows with the number of worlds: no
    spring's length, no velocity. A velocity that is not finite makes a place that is not, a substep later; so do gas
    and pressure. What is written is looked at on the host again: see `Frame.is_finite`.

    Args:
        model: what is simulated.
        lanes: threads that share a balloon; as many as suit the device, when missing.
    """

    def __init__(self, model: Model, lanes: int | None = None):
        if lanes is None:
            largest = max(shape.mesh.vertex_count for shape in model.shapes)
            lanes = 1 if model.device.is_cpu else -(-largest // PARTICLES_A_THREAD)
        self._shape = (model.world_count, model.balloon_count, lanes)
        origins, sizes, farthest = [], [LEAST_SIZE], [0.0]
        for shape, first in zip(model.shapes, model.particle_offsets, strict=False):
            used = shape.mesh.points[shape.mesh.face_vertex_indices]
            origins.append(first + int(shape.mesh.face_vertex_indices[0]))
            sizes.append(float(np.ptp(used, axis=0).max()))
            farthest.append(float(np.abs(used).max()))
        spheres = model.initial_sphere_positions.numpy()
        reach = FARTHEST * max(sizes) + max([*farthest, float(np.abs(spheres).max(initial=0.0))])
        self._tables = [
            wp.array(model.particle_offsets, dtype=wp.int32, device=model.device),
            wp.array(origins, dtype=wp.int32, device=model.device),
            wp.array(np.square(MOST_SPAN * np.array(sizes[1:])), dtype=float, device=model.device),
            min(reach, LARGEST_ROOT) ** 2,
            model.particle_mass_share,
            lanes,
        ]

    def look(self, state: State, first_bad: wp.array) -> None:
        """Lower a world's entry to its first bad particle or sphere.

        Args:
            first_bad: particles of the world, then its spheres, shape (world_count,), int32.
        """
        wp.launch(
            find_bad,
            self._shape,
            inputs=[*self._tables, state.points, state.sphere_positions],
            outputs=[first_bad],
            device=state.points.device,
        )
