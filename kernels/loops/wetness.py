"""Loads of a liquid on the faces around a particle.

Each face is the fan of triangles about its center, cut at the level.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.water import TriangleLoad, corner_load, triangle_load
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.loops.slots import ring_ends
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.tables import SLICE, FaceTable, RingTable


@cache
def ring_wetness_loop(at: Any) -> Any:
    """Return the function that sums a particle's load over the quads that go all around it."""
    ends_at = ring_ends(at)

    @wp.func
    def load_through_center(load: TriangleLoad):
        """Return a quad corner's share of the load on the center."""
        return corner_load(load, 0.25 * load.moments[2], 0.25 * load.areas[2])

    @wp.func
    def load_of_quad(before: wp.vec3, across: wp.vec3, along: wp.vec3, level: float, up: wp.vec3):
        """Return the load of a quad on one of its corners.

        The arguments are the vectors to the other corners [m], and the height of the water over the corner [m].
        """
        here = wp.vec3()
        center = 0.25 * (before + across + along)
        coming = triangle_load(before, here, center, level, up)
        going = triangle_load(here, along, center, level, up)
        far = triangle_load(along, across, center, level, up)
        last = triangle_load(across, before, center, level, up)
        load = corner_load(coming, coming.moments[1], coming.areas[1]) + load_through_center(coming)
        load += corner_load(going, going.moments[0], going.areas[0]) + load_through_center(going)
        return load + load_through_center(far) + load_through_center(last)

    @wp.func
    def water_load(rings: RingTable, points: Any, particle: wp.int32, water_level: float, up: wp.vec3):
        """Return the wetted faces' load on a particle, depth times area vector [m^3], and their area [m^2]."""
        total = wp.vec4()
        place = four_ints_at(rings.places, particle)
        point = at(points, particle)
        level = water_level - wp.dot(point, up)
        before = at(points, place[3]) - point
        for entry in range(place[0], place[0] + SLICE * place[1], SLICE):
            ends = ends_at(rings, entry)
            across = at(points, ends[0]) - point
            along = at(points, ends[1]) - point
            lowest = wp.min(wp.min(wp.dot(before, up), wp.dot(across, up)), wp.min(wp.dot(along, up), 0.0))
            if lowest < level:
                total += load_of_quad(before, across, along, level, up)
            before = along
        return total

    return water_load


@cache
def wetness_loop(at: Any) -> Any:
    """Return the function that sums a particle's load over its faces."""
    center_of_face, _ = face_measures(at)

    @wp.func
    def is_dry(faces: FaceTable, points: Any, begin: wp.int32, end: wp.int32, level: float, up: wp.vec3):
        """Return whether all corners of a face, and so the face, are above the water."""
        lowest = wp.dot(at(points, faces.particles[begin]), up)
        for corner in range(begin + 1, end):
            lowest = wp.min(lowest, wp.dot(at(points, faces.particles[corner]), up))
        return lowest >= level

    @wp.func
    def water_load(faces: FaceTable, points: Any, particle: wp.int32, level: float, up: wp.vec3):
        """Return the wetted faces' load on a particle, depth times area vector [m^3], and their area [m^2]."""
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
