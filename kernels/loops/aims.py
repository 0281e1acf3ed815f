"""The aims of an inflation by normal forces, once the faces have been measured."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.inflation import FAR, aim_of, nearer_area
from balloon_warp.kernels.tables import FaceTable


@cache
def aim_loop(at: Any) -> Any:
    """The function that aims a particle.

    Args:
        at: the function that reads a face's center or area vector.
    """

    @wp.func
    def aim_of_particle(
        faces: FaceTable, centers: Any, area_vectors: Any, particle: wp.int32, point: wp.vec3, total_area: float
    ):
        """(A_p / A_total) n"""
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
            face = faces.around_particles[incidence]
            area_vector = at(area_vectors, face)
            normal += wp.normalize(area_vector)
            nearest = nearer_area(nearest, point, at(centers, face), area_vector)
        return aim_of(normal, nearest, total_area)

    return aim_of_particle
