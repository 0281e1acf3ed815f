"""Directions of an inflation by normal forces, once the faces have been measured."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import cross_product
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, entry_at, of_lane, set_lane
from balloon_warp.kernels.laws.inflation import FAR, inflation_direction_of, nearer_area, vertex_normal_of
from balloon_warp.kernels.tables import FaceTable


@cache
def direction_loop(at: Any) -> Any:
    """Return the function for a particle's direction."""

    @wp.func
    def direction_of_particle(
        faces: FaceTable, centers: Any, area_vectors: Any, particle: wp.int32, point: wp.vec3, total_area: float
    ):
        """Return the direction (A_p / A_total) n of a particle."""
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
            face = faces.around_particles[incidence]
            area_vector = at(area_vectors, face)
            normal += wp.normalize(area_vector)
            nearest = nearer_area(nearest, point, at(centers, face), area_vector)
        return inflation_direction_of(vertex_normal_of(normal, nearest), total_area)

    return direction_of_particle


@cache
def direction_loop_of_eight(at: Any) -> Any:
    """Return the function for the directions of eight particles."""

    @wp.func
    def directions_of_eight(
        faces: Any, centers: Any, area_vectors: Any, eight: wp.int32, points: Lanes3, total_areas: Lanes
    ):
        """Return (A_p / A_total) n of each."""
        normals = Lanes3()
        squared_distances = Lanes(FAR)
        areas = Lanes()
        for incidence in range(faces.particle_offsets[eight], faces.particle_offsets[eight + 1]):
            face = entry_at(faces.around_particles, incidence)
            center = at(centers, face)
            area_vector = at(area_vectors, face)
            for lane in range(LANE_COUNT):
                of_one = of_lane(area_vector, lane)
                normal = wp.normalize(of_one)
                nearest = wp.vec2(squared_distances[lane], areas[lane])
                nearest = nearer_area(nearest, of_lane(points, lane), of_lane(center, lane), of_one)
                squared_distances[lane] = nearest[0]
                areas[lane] = nearest[1]
                normals[0, lane] += normal[0]
                normals[1, lane] += normal[1]
                normals[2, lane] += normal[2]
        inflation_directions = Lanes3()
        for lane in range(LANE_COUNT):
            nearest = wp.vec2(squared_distances[lane], areas[lane])
            inflation_directions = set_lane(
                inflation_directions,
                lane,
                inflation_direction_of(vertex_normal_of(of_lane(normals, lane), nearest), total_areas[lane]),
            )
        return inflation_directions

    return directions_of_eight


@wp.func
def see_quad(normal: wp.vec3, nearest: wp.vec2, before: wp.vec3, across: wp.vec3, along: wp.vec3):
    """Add a quad to the sum of unit normals around a particle, and update its nearest face.

    The arguments are the vectors to the quad's other corners. Distances are four times as long, and areas twice as
    large as they are.
    """
    area_vector = cross_product(across, before - along)
    return normal + wp.normalize(area_vector), nearer_area(nearest, wp.vec3(), before + across + along, area_vector)


@wp.func
def normal_of_quads(normal: wp.vec3, nearest: wp.vec2):
    """Return A_p n, when all quads around a particle have been seen [m^2]."""
    return 0.5 * vertex_normal_of(normal, nearest)
