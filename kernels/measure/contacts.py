"""Net forces of each pair of things that press each other, summed on the device in a fixed order."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)

MEASURES = ("force", "torque", "area", "pressure")
"""Measures of a pair in contact: magnitudes of the net force [N] and torque [N m], area [m^2], largest pressure [Pa]"""


@wp.struct
class FaceTable:
    """Faces around each particle, as `Model` has them."""

    particle_face_offsets: wp.array[wp.int32]
    particle_faces: wp.array[wp.int32]
    face_offsets: wp.array[wp.int32]
    face_particles: wp.array[wp.int32]


@wp.struct
class PairSums:
    """Contact of one thing with the particles of one balloon, summed over a frame."""

    impulse: wp.vec3
    """Impulse [N s]"""
    moment: wp.vec3
    """Moment of the impulses [N m s]"""
    strength: float
    """Sum of the magnitudes of all impulses [N s]"""
    place: wp.vec3
    """Sum of the arms to particles, weighted by the magnitudes of their impulses [N s m]"""
    area: float
    """Integral of the area over time [m^2 s]"""
    pressure: float
    """Integral of the pressure over time, the largest of a particle [Pa s]"""


@wp.func
def vertex_area(faces: FaceTable, points: wp.array2d[wp.vec3], world: wp.int32, particle: wp.int32):
    """Share of a particle in the areas of the faces around it, each shared out among its corners [m^2]."""
    area = float(0.0)
    for place in range(faces.particle_face_offsets[particle], faces.particle_face_offsets[particle + 1]):
        face = faces.particle_faces[place]
        begin = faces.face_offsets[face]
        end = faces.face_offsets[face + 1]
        origin = points[world, particle]
        vector = wp.vec3()
        arm = points[world, faces.face_particles[end - 1]] - origin
        for corner in range(begin, end):
            next_arm = points[world, faces.face_particles[corner]] - origin
            vector += 0.5 * wp.cross(arm, next_arm)
            arm = next_arm
        area += wp.length(vector) / float(end - begin)
    return area


@wp.func
def sum_of_pair(
    faces: FaceTable,
    points: wp.array2d[wp.vec3],
    impulses: wp.array3d[wp.vec4],
    world: wp.int32,
    thing: wp.int32,
    particles: wp.vec2i,
    center: wp.vec3,
):
    """Sum the impulses of a thing on the particles from the first to before the last; moments are about a center."""
    sums = PairSums()
    for particle in range(particles[0], particles[1]):
        entry = impulses[world, thing, particle]
        if entry[3] > 0.0:
            impulse = wp.vec3(entry[0], entry[1], entry[2])
            area = vertex_area(faces, points, world, particle)
            arm = points[world, particle] - center
            sums.impulse += impulse
            sums.moment += wp.cross(arm, impulse)
            sums.strength += wp.length(impulse)
            sums.place += wp.length(impulse) * arm
            sums.area += area * entry[3]
            if area > 0.0:
                sums.pressure = wp.max(sums.pressure, wp.length(impulse) / area)
    return sums


@wp.func
def mean_arm(points: wp.array2d[wp.vec3], world: wp.int32, particles: wp.vec2i):
    """Return the vector from the first of some points to their mean [m]."""
    origin = points[world, particles[0]]
    total = wp.vec3()
    for particle in range(particles[0], particles[1]):
        total += points[world, particle] - origin
    return total / float(particles[1] - particles[0])


@wp.kernel(enable_backward=False)
def sum_contacts(
    # model
    offsets: wp.array[wp.int32],
    faces: FaceTable,
    frame_seconds: float,
    # state in
    points: wp.array2d[wp.vec3],
    impulses: wp.array3d[wp.vec4],
    # state out
    forces: wp.array3d[wp.vec3],
    torques: wp.array3d[wp.vec3],
    areas: wp.array3d[float],
    pressures: wp.array3d[float],
    places: wp.array3d[wp.vec3],
):
    """Sum the contacts of a pair; a thread a (world, balloon, thing).

    Balloons are the last of the things: these press with particles of their own, too, and the balloon with its own on
    their triangles.
    """
    world, balloon, thing = wp.tid()
    particles = wp.vec2i(offsets[balloon], offsets[balloon + 1])
    origin = points[world, particles[0]]
    sums = sum_of_pair(faces, points, impulses, world, thing, particles, origin)
    first = forces.shape[2] - forces.shape[1]
    if thing >= first:
        its = wp.vec2i(offsets[thing - first], offsets[thing - first + 1])
        back = sum_of_pair(faces, points, impulses, world, first + balloon, its, origin)
        sums.impulse -= back.impulse
        sums.moment -= back.moment
        sums.strength += back.strength
        sums.place += back.place
        sums.area = wp.max(sums.area, back.area)
        sums.pressure += back.pressure  # each bears a part of the pressure between them
    if sums.area > 0.0:
        sums.moment -= wp.cross(mean_arm(points, world, particles), sums.impulse)
    forces[world, balloon, thing] = sums.impulse / frame_seconds
    torques[world, balloon, thing] = sums.moment / frame_seconds
    areas[world, balloon, thing] = sums.area / frame_seconds
    pressures[world, balloon, thing] = sums.pressure / frame_seconds
    places[world, balloon, thing] = origin + sums.place / wp.max(sums.strength, 1.0e-30)


@wp.kernel(enable_backward=False)
def note_contacts(
    # state in
    frame: wp.array[wp.int32],
    healthy: wp.array[wp.int32],
    forces: wp.array3d[wp.vec3],
    torques: wp.array3d[wp.vec3],
    areas: wp.array3d[float],
    pressures: wp.array3d[float],
    # in and out
    means: wp.array3d[wp.vec4],
    peaks: wp.array3d[wp.vec4],
):
    """Store `MEASURES` of each frame, as long as the world is good; a thread a (world, balloon, thing)."""
    world, balloon, thing = wp.tid()
    if healthy[world] == 1 and frame[0] > 0:
        now = wp.vec4(
            wp.length(forces[world, balloon, thing]),
            wp.length(torques[world, balloon, thing]),
            areas[world, balloon, thing],
            pressures[world, balloon, thing],
        )
        mean = means[world, balloon, thing]
        means[world, balloon, thing] = mean + (now - mean) / float(frame[0])
        peaks[world, balloon, thing] = wp.max(now, peaks[world, balloon, thing])
