"""What the `block` schedule's kernel for worlds of any size consists of, and what it shares with the resident ones.

A tile holds two buffers of points, of which a substep reads one and writes the other.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.inflation import FAR, NORMAL_FORCE, aim_of, face_area_vector, face_center, nearer_area
from balloon_warp.kernels.tables import AirTable, BodyTable, FaceTable, WorldState


@wp.func
def balloon_area(faces: FaceTable, points: Any, first: wp.int32, balloon: wp.int32, lane: wp.int32):
    """Area of a balloon, summed by the whole block in the same order every time."""
    part = float(0.0)
    for face in range(faces.balloon_offsets[balloon] + lane, faces.balloon_offsets[balloon + 1], wp.block_dim()):
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, first, faces.particles, begin, end)
        part += wp.length(face_area_vector(points, first, faces.particles, begin, end, center))
    total = wp.tile_sum(wp.tile(part))
    return total[0]


@wp.func
def aim_in_tile(faces: FaceTable, points: Any, first: wp.int32, particle: wp.int32, point: wp.vec3, total_area: float):
    """(A_p / A_total) n of a particle, its faces measured on the way."""
    normal = wp.vec3()
    nearest = wp.vec2(FAR, 0.0)
    for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
        face = faces.around_particles[incidence]
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, first, faces.particles, begin, end)
        area_vector = face_area_vector(points, first, faces.particles, begin, end, center)
        normal += wp.normalize(area_vector)
        nearest = nearer_area(nearest, point, center, area_vector)
    return aim_of(normal, nearest, total_area)


@wp.func
def refresh_aims(
    bodies: BodyTable,
    faces: FaceTable,
    air: AirTable,
    state: WorldState,
    points: Any,
    first: wp.int32,
    world: wp.int32,
    lane: wp.int32,
):
    """The aims of all balloons that normal forces inflate, by the whole block."""
    for balloon in range(state.inflation_ramp.shape[1]):
        if air.kind[balloon] == NORMAL_FORCE:
            area = balloon_area(faces, points, first, balloon, lane)
            for particle in range(lane, state.points.shape[1], wp.block_dim()):
                if bodies.balloon[particle] == balloon:
                    state.inflation_aims[world, particle] = aim_in_tile(
                        faces, points, first, particle, points[first + particle], area
                    )


@wp.func
def count_frame_in_block(state: WorldState, world: wp.int32, lane: wp.int32):
    """By one thread of all: the frame has passed. It was read before this launch."""
    if world == 0 and lane == 0:
        state.frame[0] = state.frame[0] + 1
