"""The aims of an inflation by normal forces, once the faces have been measured."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes, Lanes2, Lanes3, cross_product, of_lane, scaled, set_lane
from balloon_warp.kernels.laws.inflation import FAR, aim_of, facing_of, nearer_area
from balloon_warp.kernels.loops.ring_ends import ring_ends
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.tables import SLICE, RingTable


@wp.func
def none_near(point: wp.vec3):
    """Squared distance and area of the nearest face, before any has been seen."""
    return wp.vec2(FAR, 0.0)


@wp.func
def none_near(point: Lanes3):  # noqa: F811 - an overload
    """The same in each lane."""
    nearest = Lanes2()
    nearest[0] = Lanes(FAR)
    return nearest


@wp.func
def see_face(normal: wp.vec3, nearest: wp.vec2, point: wp.vec3, center: wp.vec3, area_vector: wp.vec3):
    """The sum of the unit normals around a particle, and its nearest face, with one more face."""
    return normal + wp.normalize(area_vector), nearer_area(nearest, point, center, area_vector)


@wp.func
def see_face(  # noqa: F811 - an overload
    normals: Lanes3, nearest: Lanes2, points: Lanes3, centers: Lanes3, area_vectors: Lanes3
):
    """The same in each lane."""
    for lane in range(LANE_COUNT):
        of_one = of_lane(area_vectors, lane)
        normal = wp.normalize(of_one)
        nearer = nearer_area(
            wp.vec2(nearest[0, lane], nearest[1, lane]), of_lane(points, lane), of_lane(centers, lane), of_one
        )
        nearest[0, lane] = nearer[0]
        nearest[1, lane] = nearer[1]
        normals[0, lane] += normal[0]
        normals[1, lane] += normal[1]
        normals[2, lane] += normal[2]
    return normals, nearest


@wp.func
def aim_by(normal: wp.vec3, nearest: wp.vec2, total_area: float):
    """(A_p / A_total) n, once all faces around a particle have been seen."""
    return aim_of(facing_of(normal, nearest), total_area)


@wp.func
def aim_by(normals: Lanes3, nearest: Lanes2, total_areas: Lanes):  # noqa: F811 - an overload
    """The same in each lane."""
    aims = Lanes3()
    for lane in range(LANE_COUNT):
        of_one = aim_by(of_lane(normals, lane), wp.vec2(nearest[0, lane], nearest[1, lane]), total_areas[lane])
        aims = set_lane(aims, lane, of_one)
    return aims


@cache
def aim_loop(at: Any) -> Any:
    """The function that aims a particle, or eight.

    Args:
        at: the function that reads a face's center or area vector.
    """

    @wp.func
    def aim_of_particle(faces: Any, centers: Any, area_vectors: Any, particle: wp.int32, point: Any, total_area: Any):
        """(A_p / A_total) n"""
        normal = scaled(point, 0.0)
        nearest = none_near(point)
        for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
            face = faces.around_particles[incidence]
            more, nearer = see_face(normal, nearest, point, at(centers, face), at(area_vectors, face))
            normal = more
            nearest = nearer
        return aim_by(normal, nearest, total_area)

    return aim_of_particle


@wp.func
def see_quad(normal: wp.vec3, nearest: wp.vec2, before: wp.vec3, across: wp.vec3, along: wp.vec3):
    """The sum of the unit normals around a particle, and its nearest face, with one more quad, from the vectors to its
    other corners. Distances are four times as long, and areas twice as large as they are."""
    area_vector = cross_product(across, before - along)
    return normal + wp.normalize(area_vector), nearer_area(nearest, wp.vec3(), before + across + along, area_vector)


@wp.func
def facing_of_quads(normal: wp.vec3, nearest: wp.vec2):
    """A_p n, when all quads around a particle have been seen [m^2]."""
    return 0.5 * facing_of(normal, nearest)


@cache
def ring_aim_loop(at: Any) -> Any:
    """The function that aims a particle by the quads that go all around it, which it measures itself.

    Args:
        at: the function that reads a point.
    """
    ends_at = ring_ends(at)

    @wp.func
    def aim_of_particle(rings: RingTable, points: Any, particle: wp.int32, point: wp.vec3, total_area: float):
        """(A_p / A_total) n"""
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        place = four_ints_at(rings.places, particle)
        before = at(points, place[3]) - point
        next_ends = ends_at(rings, place[0])
        for entry in range(place[0], place[0] + SLICE * place[1], SLICE):
            ends = next_ends
            next_ends = ends_at(rings, entry + SLICE)
            across = at(points, ends[0]) - point
            along = at(points, ends[1]) - point
            turned, nearer = see_quad(normal, nearest, before, across, along)
            normal = turned
            nearest = nearer
            before = along
        return aim_of(facing_of_quads(normal, nearest), total_area)

    return aim_of_particle
