"""Observations of worlds: balloons, contacts, and forces of springs and laws.

All are summed on the device in a fixed order. Each kernel observes the worlds that a mask chooses; one without entries
chooses all.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.compose import params_functions
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.membrane import invariants_of, mixed_stretch
from balloon_warp.kernels.loops.net_force import face_loop, held_string_pull, net_force_function, scalar_loops
from balloon_warp.kernels.loops.springs import pair_pull
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.tables import Tables, is_chosen

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


@wp.kernel
def sum_turning(
    mask: wp.array[wp.int32],
    # model
    balloon_particles: wp.array[wp.int32],
    rest_arms: wp.array[wp.vec3],
    # state in
    points: wp.array2d[wp.vec3],
    # out
    parts: wp.array3d[wp.mat33],
):
    """Sum products of places and arms from the center at rest; a thread a (world, balloon, thread)."""
    world, balloon, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    total = wp.mat33()
    begin = balloon_particles[balloon]
    origin = points[world, begin]
    for particle in range(begin + thread, balloon_particles[balloon + 1], parts.shape[2]):
        total += wp.outer(points[world, particle] - origin, rest_arms[particle])
    parts[world, balloon, thread] = total


@wp.kernel
def join_turning(mask: wp.array[wp.int32], parts: wp.array3d[wp.mat33], turns: wp.array2d[wp.quat]):
    """Find the turns: the rotation of least squares (Kabsch); a thread a (world, balloon)."""
    world, balloon = wp.tid()
    if not is_chosen(mask, world):
        return
    total = wp.mat33()
    for thread in range(parts.shape[2]):
        total += parts[world, balloon, thread]
    left = wp.mat33()
    sizes = wp.vec3()
    right = wp.mat33()
    wp.svd3(total, left, sizes, right)
    mirrored = wp.determinant(left) * wp.determinant(right)
    upright = wp.diag(wp.vec3(1.0, 1.0, wp.sign(mirrored)))
    turn = wp.quat_from_matrix(left * upright * wp.transpose(right))
    turns[world, balloon] = wp.where(turn[3] < 0.0, -turn, turn)


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


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
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


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
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


@cache
def pull_kernel(measure: Any) -> Any:
    """Return the kernel that measures forces.

    Args:
        measure: the function that does so, one of those that are made below.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def measure_pulls(
        # model
        t: Tables,
        time: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        pulls: wp.array3d[float],
    ):
        """Measure the forces of springs, strings and laws; a thread a (world, item)."""
        world, item = wp.tid()
        measure(t, world, item, points[world], velocities[world], time, pulls[world])

    return measure_pulls


@cache
def spring_measure(features: Features) -> Any:
    """Return the function that measures a spring."""
    pull_of_pair = pair_pull(features)

    @wp.func
    def measure_spring(
        t: Tables, world: wp.int32, spring: wp.int32, points: Any, velocities: Any, time: float, pulls: Any
    ):
        """Measure the tension of a spring, negative if it pushes [N]."""
        d, coefficient = pull_of_pair(t, world, spring, points, velocities, time)
        pulls[0, spring] = wp.sqrt(squared_length(d)) * coefficient

    return measure_spring


@cache
def string_measure(features: Features) -> Any:
    """Return the function that measures a string."""
    pull_of_held_string = held_string_pull(features)

    @wp.func
    def measure_string(
        t: Tables, world: wp.int32, held: wp.int32, points: Any, velocities: Any, time: float, pulls: Any
    ):
        """Measure the force of a string on its particle [N]."""
        pull = pull_of_held_string(t, world, held, points, velocities, time)
        pulls[0, t.strings.order[held][0]] = wp.length(pull)

    return measure_string


@cache
def law_measure(alones: tuple[Features, ...], number: int = 0) -> Any:
    """Return the function that measures the laws on a particle, one by one.

    Args:
        alones: the features with one law on particles, hinges or faces alone, or with membranes.
    """
    features = alones[0]
    alone = features._replace(pressures=False)
    _, read_params = params_functions(features.columns, features.balloons)
    loops = scalar_loops(alone, vector_at)
    net_force, load_of_particle = net_force_function(alone, loops), loops.water_load
    push_of_faces = face_loop(alone, vector_at, vector_at) if alone.has("face") else None
    others = law_measure(alones[1:], number + 1) if len(alones) > 1 else None

    @wp.func
    def measure_laws(
        t: Tables, world: wp.int32, particle: wp.int32, points: Any, velocities: Any, time: float, pulls: Any
    ):
        """Measure the force of each law [N]."""
        params = read_params(t, world, particle)
        point = points[particle]
        load = wp.vec4()
        if wp.static(alone.in_water):
            load = load_of_particle(t, points, params)
        force, _area, _facing = net_force(
            t, points, velocities, params, particle, point, velocities[particle], load, time
        )
        if wp.static(push_of_faces is not None):
            force += push_of_faces(t, points, velocities, world, particle, time)
        pulls[number, particle] = wp.length(force)
        if wp.static(others is not None):
            others(t, world, particle, points, velocities, time, pulls)

    return measure_laws
