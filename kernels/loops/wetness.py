"""What a liquid puts on the faces around a particle, each the fan of triangles about its center, cut at the level."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.water import corner_load, triangle_load
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.tables import FaceTable


@cache
def wetness_loop(at: Any) -> Any:
    """The function that sums a particle's load over its faces."""
    center_of_face, _ = face_measures(at)

    @wp.func
    def is_dry(faces: FaceTable, points: Any, begin: wp.int32, end: wp.int32, level: float, up: wp.vec3):
        """Whether all corners of a face are above the water: then the face is."""
        lowest = wp.dot(at(points, faces.particles[begin]), up)
        for corner in range(begin + 1, end):
            lowest = wp.min(lowest, wp.dot(at(points, faces.particles[corner]), up))
        return lowest >= level

    @wp.func
    def water_load(faces: FaceTable, points: Any, particle: wp.int32, level: float, up: wp.vec3):
        """Depth times area vector over the wetted faces around a particle [m^3], and their wetted area [m^2]."""
        total = wp.vec4()
        for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
            face = faces.around_particles[incidence]
            begin = faces.offsets[face]
            end = faces.offsets[face + 1]
            if not is_dry(faces, points, begin, end, level, up):
                center = center_of_face(faces, points, face)
                of_center = wp.vec4()
                visits = float(0.0)
                p = faces.particles[end - 1]
                for corner in range(begin, end):
                    q = faces.particles[corner]
                    load = triangle_load(at(points, p), at(points, q), center, level, up)
                    if p == particle:
                        total += corner_load(load, load.moments[0], load.areas[0])
                    if q == particle:
                        total += corner_load(load, load.moments[1], load.areas[1])
                        visits += 1.0
                    of_center += corner_load(load, load.moments[2], load.areas[2])
                    p = q
                total += (visits / float(end - begin)) * of_center
        return total

    return water_load
