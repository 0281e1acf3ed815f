"""Kernels of observations of each world's balloons after a frame, summed in a fixed order.

Each observes the worlds that a mask chooses; one without entries chooses all.
"""

import warp as wp

from balloon_warp.kernels.laws.membrane import invariants_of, mixed_stretch
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import is_chosen

wp.set_module_options(OPTIONS)


@wp.struct
class MotionPart:
    """A thread's part of a balloon; places are from the balloon's first particle, which keeps float32's digits."""

    places: wp.vec3
    velocities: wp.vec3


@wp.kernel
def sum_motion(
    mask: wp.array[wp.int32],
    # model
    balloon_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # out
    parts: wp.array3d[MotionPart],
):
    """Sum places and velocities; a thread a (world, balloon, thread)."""
    world, balloon, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    places = wp.vec3()
    speeds = wp.vec3()
    begin = balloon_particles[balloon]
    origin = points[world, begin]
    for particle in range(begin + thread, balloon_particles[balloon + 1], parts.shape[2]):
        places += points[world, particle] - origin
        speeds += velocities[world, particle]
    part = MotionPart()
    part.places = places
    part.velocities = speeds
    parts[world, balloon, thread] = part


@wp.kernel
def join_motion(
    mask: wp.array[wp.int32],
    # model
    balloon_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    parts: wp.array3d[MotionPart],
    # out
    centers: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
):
    """Find centers and mean velocities; a thread a (world, balloon)."""
    world, balloon = wp.tid()
    if not is_chosen(mask, world):
        return
    places = wp.vec3()
    speeds = wp.vec3()
    for thread in range(parts.shape[2]):
        places += parts[world, balloon, thread].places
        speeds += parts[world, balloon, thread].velocities
    begin = balloon_particles[balloon]
    count = float(balloon_particles[balloon + 1] - begin)
    centers[world, balloon] = points[world, begin] + places / count
    velocities[world, balloon] = speeds / count


@wp.kernel
def sum_volumes(
    mask: wp.array[wp.int32],
    # model
    balloon_particles: wp.array[wp.int32],
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    # out
    parts: wp.array3d[float],
):
    """Sum the volumes between faces and a balloon's first particle; a thread a (world, balloon, thread)."""
    world, balloon, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    volume = float(0.0)
    origin = points[world, balloon_particles[balloon]]
    for face in range(balloon_faces[balloon] + thread, balloon_faces[balloon + 1], parts.shape[2]):
        begin = face_offsets[face]
        end = face_offsets[face + 1]
        arm = points[world, face_particles[end - 1]] - origin
        corners = wp.vec3()
        twice_area = wp.vec3()
        for corner in range(begin, end):
            next_arm = points[world, face_particles[corner]] - origin
            twice_area += wp.cross(arm, next_arm)
            corners += next_arm
            arm = next_arm
        volume += wp.dot(corners, twice_area) / (6.0 * float(end - begin))
    parts[world, balloon, thread] = volume


@wp.kernel
def join_volumes(mask: wp.array[wp.int32], parts: wp.array3d[float], volumes: wp.array2d[float]):
    """Find volumes; a thread a (world, balloon)."""
    world, balloon = wp.tid()
    if not is_chosen(mask, world):
        return
    volume = float(0.0)
    for thread in range(parts.shape[2]):
        volume += parts[world, balloon, thread]
    volumes[world, balloon] = volume


@wp.kernel
def clear_stretches(mask: wp.array[wp.int32], stretches: wp.array2d[float]):
    """Clear the largest stretches; a thread a (world, balloon)."""
    world, balloon = wp.tid()
    if is_chosen(mask, world):
        stretches[world, balloon] = 0.0


@wp.kernel
def stretch_springs(
    mask: wp.array[wp.int32],
    # model
    particle_balloon: wp.array[wp.int32],
    spring_particles: wp.array[wp.vec2i],
    spring_rest_length: wp.array[float],
    threads: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    # out
    stretches: wp.array2d[float],
):
    """Find the largest stretch of each balloon's springs; a thread a (world, thread)."""
    world, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    most = float(0.0)
    balloon = wp.int32(0)
    for spring in range(thread, spring_rest_length.shape[0], threads):
        ends = spring_particles[spring]
        if spring_rest_length[spring] > 0.0:
            if particle_balloon[ends[0]] != balloon:
                wp.atomic_max(stretches, world, balloon, most)
                balloon = particle_balloon[ends[0]]
                most = 0.0
            length = wp.length(points[world, ends[1]] - points[world, ends[0]])
            most = wp.max(most, length / spring_rest_length[spring])
    wp.atomic_max(stretches, world, balloon, most)


@wp.kernel
def stretch_membranes(
    mask: wp.array[wp.int32],
    # model
    particle_balloon: wp.array[wp.int32],
    membrane_corners: wp.array[wp.vec3i],
    membrane_rests: wp.array[wp.vec4],
    threads: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    # out
    stretches: wp.array2d[float],
):
    """Find the largest principal stretch of each balloon's membrane; a thread a (world, thread)."""
    world, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    most = float(0.0)
    balloon = wp.int32(0)
    for triangle in range(thread, membrane_corners.shape[0], threads):
        p = membrane_corners[triangle]
        d1 = points[world, p[1]] - points[world, p[0]]
        d2 = points[world, p[2]] - points[world, p[0]]
        metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
        trace, _det, spread = invariants_of(mixed_stretch(metric, membrane_rests[triangle]))
        if particle_balloon[p[0]] != balloon:
            wp.atomic_max(stretches, world, balloon, most)
            balloon = particle_balloon[p[0]]
            most = 0.0
        most = wp.max(most, wp.sqrt(0.5 * (trace + spread)))
    wp.atomic_max(stretches, world, balloon, most)


@wp.kernel
def choose_particles(
    mask: wp.array[wp.int32], particles: wp.array[wp.int32], points: wp.array2d[wp.vec3], chosen: wp.array2d[wp.vec3]
):
    """Copy chosen particles; a thread a (world, chosen particle)."""
    world, number = wp.tid()
    if not is_chosen(mask, world):
        return
    chosen[world, number] = points[world, particles[number]]


@wp.kernel
def find_obstacles(
    mask: wp.array[wp.int32],
    rows: wp.array2d[wp.vec3],
    motion: wp.array2d[wp.transform],
    frames: wp.array[wp.int32],
    # out
    places: wp.array2d[wp.vec3],
):
    """Find where obstacles are that the scene and controls move; a thread a (world, obstacle)."""
    world, obstacle = wp.tid()
    if not is_chosen(mask, world):
        return
    frame = wp.min(frames[world % frames.shape[0]], motion.shape[0] - 1)
    shift = wp.transform_get_translation(motion[frame, obstacle])
    places[world, obstacle] = rows[world % rows.shape[0], obstacle] + shift


@wp.kernel
def sum_particle_contacts(
    mask: wp.array[wp.int32], impulses: wp.array3d[wp.vec4], seconds: float, forces: wp.array2d[wp.vec3]
):
    """Sum the impulses of all things on each particle in a frame, as mean forces [N]; a thread a (world, particle)."""
    world, particle = wp.tid()
    if not is_chosen(mask, world):
        return
    total = wp.vec3()
    for thing in range(impulses.shape[1]):
        impulse = impulses[world, thing, particle]
        total += wp.vec3(impulse[0], impulse[1], impulse[2])
    forces[world, particle] = total / seconds
