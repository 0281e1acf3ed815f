"""Inflation along Gouraud normals: F = 100 k_normal (A_p / A_total) n (paper, "Particle Simulation").

A_p is the area of the incident face whose center is nearest to the particle, n the particle's Gouraud normal: the mean
of the unit normals of its incident faces, normalized. `aim` stands for (A_p / A_total) n, which the paper caches over a
frame.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.lanes_types import cross_product

NORMAL_FORCE = wp.constant(0)
"""the kind of inflation that is this one"""
FAR = wp.constant(1.0e30)
"""a squared distance [m^2] beyond all others"""


@wp.func
def push(k_normal: float):
    """Force along an aim of length one [N]."""
    return 100.0 * k_normal


@wp.func
def inflation_force(k_normal: float, aim: wp.vec3):
    """Force on a particle [N] from the inflation coefficient and its aim."""
    return push(k_normal) * aim


@wp.func
def keyframed_value(
    times: wp.array2d[float], values: wp.array3d[float], world: wp.int32, balloon: wp.int32, time: float
):
    """Piecewise linear through the keyframes, constant before the first and after the last."""
    row = world % values.shape[0]
    value = values[row, balloon, 0]
    for key in range(times.shape[1] - 1):
        begin = times[balloon, key]
        end = times[balloon, key + 1]
        if time > begin and end > begin:
            blend = wp.min((time - begin) / (end - begin), 1.0)
            value = wp.lerp(values[row, balloon, key], values[row, balloon, key + 1], blend)
    return value


@wp.func
def face_center(points: Any, first: wp.int32, face_particles: wp.array[wp.int32], begin: wp.int32, end: wp.int32):
    """Mean of a face's corners, which are `face_particles[begin:end]`; particle p stands at `points[first + p]`.

    A point is a vector, or the vectors of eight worlds.
    """
    total = points[first + face_particles[begin]]
    for corner in range(begin + 1, end):
        total = total + points[first + face_particles[corner]]
    return total / float(end - begin)


@wp.func
def face_area_vector(
    points: Any, first: wp.int32, face_particles: wp.array[wp.int32], begin: wp.int32, end: wp.int32, center: Any
):
    """Area times unit normal of a polygon, flat or not: half the sum of (a - c) x (b - c) over its edges a b."""
    arm = points[first + face_particles[begin]] - center
    total = cross_product(points[first + face_particles[end - 1]] - center, arm)
    for corner in range(begin + 1, end):
        next_arm = points[first + face_particles[corner]] - center
        total = total + cross_product(arm, next_arm)
        arm = next_arm
    return 0.5 * total


@wp.func
def nearer_area(nearest: wp.vec2, point: wp.vec3, center: wp.vec3, area_vector: wp.vec3):
    """Squared distance and area of the face whose center is nearest so far, or of this one if it is nearer."""
    squared_distance = wp.length_sq(center - point)
    return wp.where(squared_distance < nearest[0], wp.vec2(squared_distance, wp.length(area_vector)), nearest)


@wp.func
def aim_of(normal_sum: wp.vec3, nearest: wp.vec2, total_area: float):
    """(A_p / A_total) n from the sum of the unit normals around a particle, and its nearest face."""
    return (nearest[1] / wp.max(total_area, 1.0e-20)) * wp.normalize(normal_sum)


@wp.kernel
def ramp_inflation(
    # model
    keyframe_times: wp.array2d[float],
    keyframe_values: wp.array3d[float],
    frame_seconds: float,
    # state in
    frame: wp.array[wp.int32],
    # state out
    inflation_ramp: wp.array2d[wp.vec2],
):
    """A thread a (world, balloon): what is keyframed, such as k_normal, at the start of the frame, and its
    slope [1/s] over the frame."""
    world, balloon = wp.tid()
    begin = float(frame[0]) * frame_seconds
    first = keyframed_value(keyframe_times, keyframe_values, world, balloon, begin)
    last = keyframed_value(keyframe_times, keyframe_values, world, balloon, begin + frame_seconds)
    inflation_ramp[world, balloon] = wp.vec2(first, (last - first) / frame_seconds)


@wp.kernel
def measure_faces(
    # model
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    face_centers: wp.array2d[wp.vec3],
    face_area_vectors: wp.array2d[wp.vec3],
):
    """A thread a (world, face): its center, and its area vector (area times unit normal)."""
    world, face = wp.tid()
    begin = face_offsets[face]
    end = face_offsets[face + 1]
    center = face_center(points[world], 0, face_particles, begin, end)
    face_centers[world, face] = center
    face_area_vectors[world, face] = face_area_vector(points[world], 0, face_particles, begin, end, center)


@wp.kernel
def add_face_areas(
    # model
    face_balloon: wp.array[wp.int32],
    # state in
    face_area_vectors: wp.array2d[wp.vec3],
    # state out
    balloon_areas: wp.array2d[float],
):
    """A thread a (world, face): its area to that of its balloon."""
    world, face = wp.tid()
    wp.atomic_add(balloon_areas, world, face_balloon[face], wp.length(face_area_vectors[world, face]))


@wp.kernel
def aim_inflation(
    # model
    particle_balloon: wp.array[wp.int32],
    particle_face_offsets: wp.array[wp.int32],
    particle_faces: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    face_centers: wp.array2d[wp.vec3],
    face_area_vectors: wp.array2d[wp.vec3],
    balloon_areas: wp.array2d[float],
    # state out
    inflation_aims: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): (A_p / A_total) n."""
    world, particle = wp.tid()
    point = points[world, particle]
    normal = wp.vec3()
    nearest = wp.vec2(FAR, 0.0)
    for incidence in range(particle_face_offsets[particle], particle_face_offsets[particle + 1]):
        face = particle_faces[incidence]
        area_vector = face_area_vectors[world, face]
        normal += wp.normalize(area_vector)
        nearest = nearer_area(nearest, point, face_centers[world, face], area_vector)
    inflation_aims[world, particle] = aim_of(normal, nearest, balloon_areas[world, particle_balloon[particle]])
