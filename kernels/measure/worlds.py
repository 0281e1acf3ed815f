"""Measures of each world in a batch's table, reduced on the device in a fixed order: every run gives the same bits.

Each balloon is summed by a number of threads that each take every n-th face, spring and particle; then a thread a world
sums their parts, and the balloons.

Volume, first and second moments of closed balloons as solids, exact for their polyhedra (Kim et al. 2006). A face is
the fan of triangles about its center, and each triangle spans a tetrahedron with a fixed apex, over which 1, x and x
x^T have integrals in closed form. In double precision, and in a fixed order: every run gives the same bits.
"""

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.frame import keyframed_value
from balloon_warp.kernels.laws.gas import max_pressure
from balloon_warp.kernels.laws.membrane import LEAST_DET, invariants_of, is_taut, locking_room, mixed_stretch
from balloon_warp.kernels.laws.outer import NORMAL_FORCE, normal_push
from balloon_warp.kernels.tables import row_of_world

wp.set_module_options(OPTIONS)


@wp.struct
class BalloonSums:
    """A thread's part of one balloon. Places are from one of the balloon's own points, which keeps float32's digits."""

    volume: float
    """Volume about that point [m^3]"""
    area: float
    """Area [m^2]"""
    area_vector: wp.vec3
    """Sum of the faces' area vectors [m^2]; over all threads, zero for a closed balloon"""
    corners: wp.vec3
    """Sum of the faces' corners, relative to that point [m]"""
    stretch: float
    """Largest length of a spring over its rest length, or principal stretch of a membrane"""
    kinetic_energy: float
    """Kinetic energy [J]"""


@wp.func
def is_torn(torn: wp.array2d[float], world: wp.int32, face: wp.int32):
    """Return whether a face is torn, where any may be."""
    found = bool(False)
    if torn.shape[1] > 0:
        found = torn[world, face] >= 0.0
    return found


@wp.func
def is_torn_triangle(torn: wp.array2d[float], faces: wp.array[wp.int32], world: wp.int32, triangle: wp.int32):
    """Return whether a triangle's face is torn, where any may be."""
    found = bool(False)
    if torn.shape[1] > 0:
        found = torn[world, faces[triangle]] >= 0.0
    return found


@wp.kernel(enable_backward=False)
def sum_balloons(
    # model
    balloon_particles: wp.array[wp.int32],
    balloon_faces: wp.array[wp.int32],
    balloon_springs: wp.array[wp.int32],
    balloon_triangles: wp.array[wp.int32],
    particle_mass_share: wp.array[float],
    mass: wp.array2d[float],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    spring_particles: wp.array[wp.vec2i],
    spring_rest_length: wp.array[float],
    membrane_corners: wp.array[wp.vec3i],
    membrane_rests: wp.array[wp.vec4],
    triangle_faces: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    torn: wp.array2d[float],
    # out
    sums: wp.array3d[BalloonSums],
):
    """Sum the measures of balloons; a thread a (world, balloon, thread).

    The `balloon_` arrays hold the begin and end of each balloon's items. Faces that are torn have no area of their own,
    and their triangles no stretch.
    """
    world, balloon, thread = wp.tid()
    threads = sums.shape[2]
    part = BalloonSums()
    origin = points[world, face_particles[face_offsets[balloon_faces[balloon]]]]
    for face in range(balloon_faces[balloon] + thread, balloon_faces[balloon + 1], threads):
        begin = face_offsets[face]
        end = face_offsets[face + 1]
        corners = wp.vec3()
        for corner in range(begin, end):
            corners += points[world, face_particles[corner]] - origin
        center = corners / float(end - begin)
        area_vector = wp.vec3()
        arm = points[world, face_particles[end - 1]] - origin - center
        for corner in range(begin, end):
            next_arm = points[world, face_particles[corner]] - origin - center
            area_vector += 0.5 * wp.cross(arm, next_arm)
            arm = next_arm
        part.volume += wp.dot(center, area_vector) / 3.0
        part.area_vector += area_vector
        if not is_torn(torn, world, face):
            part.area += wp.length(area_vector)
        part.corners += corners
    for spring in range(balloon_springs[balloon] + thread, balloon_springs[balloon + 1], threads):
        ends = spring_particles[spring]
        length = wp.length(points[world, ends[1]] - points[world, ends[0]])
        if spring_rest_length[spring] > 0.0:
            part.stretch = wp.max(part.stretch, length / spring_rest_length[spring])
    for triangle in range(balloon_triangles[balloon] + thread, balloon_triangles[balloon + 1], threads):
        if is_torn_triangle(torn, triangle_faces, world, triangle):
            continue
        p = membrane_corners[triangle]
        d1 = points[world, p[1]] - points[world, p[0]]
        d2 = points[world, p[2]] - points[world, p[0]]
        metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
        trace, _det, spread = invariants_of(mixed_stretch(metric, membrane_rests[triangle]))
        part.stretch = wp.max(part.stretch, wp.sqrt(0.5 * (trace + spread)))
    for particle in range(balloon_particles[balloon] + thread, balloon_particles[balloon + 1], threads):
        particle_mass = particle_mass_share[particle] * mass[world % mass.shape[0], balloon]
        part.kinetic_energy += 0.5 * particle_mass * wp.length_sq(velocities[world, particle])
    sums[world, balloon, thread] = part


@wp.func
def in_box(place: wp.vec3, lower: wp.vec3, upper: wp.vec3):
    """Return 1 if a balloon's center is in the box, else 0."""
    return wp.where(wp.min(wp.min(place - lower, upper - place)) >= 0.0, 1.0, 0.0)


@wp.func
def whole_balloon(sums: wp.array3d[BalloonSums], world: wp.int32, balloon: wp.int32):
    """Return the sum of all threads' parts of a balloon."""
    total = BalloonSums()
    for thread in range(sums.shape[2]):
        part = sums[world, balloon, thread]
        total.volume += part.volume
        total.area += part.area
        total.area_vector += part.area_vector
        total.corners += part.corners
        total.kinetic_energy += part.kinetic_energy
        total.stretch = wp.max(total.stretch, part.stretch)
    return total


@wp.func
def are_finite(places: wp.array[wp.vec3]):
    """Return whether all places are finite."""
    finite = bool(True)
    for place in range(places.shape[0]):
        finite = finite and wp.isfinite(places[place])
    return finite


@wp.func
def note_further(
    measures: wp.array2d[float],
    world: wp.int32,
    sphere_positions: wp.array2d[wp.vec3],
    body_positions: wp.array2d[wp.vec3],
    up: wp.vec3,
    box_column: wp.int32,
    inside: float,
    burst_column: wp.int32,
    bursts: wp.array2d[wp.vec4],
):
    """Store the columns that not every table has."""
    for sphere in range(sphere_positions.shape[1]):
        measures[world, 6 + sphere] = wp.dot(sphere_positions[world, sphere], up)
    for body in range(body_positions.shape[1]):
        measures[world, 6 + sphere_positions.shape[1] + body] = wp.dot(body_positions[world, body], up)
    if box_column >= 0:
        measures[world, box_column] = inside
    if burst_column >= 0:
        count = float(0.0)
        for balloon in range(bursts.shape[1]):
            count += wp.where(bursts[world, balloon][0] >= 0.0, 1.0, 0.0)
        measures[world, burst_column] = count


@wp.kernel(enable_backward=False)
def measure_worlds(
    # model
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    mass: wp.array2d[float],
    inflation_kind: wp.array[wp.int32],
    keyframe_times: wp.array2d[float],
    keyframe_values: wp.array3d[float],
    frame_seconds: float,
    up: wp.vec3,
    box_lower: wp.vec3,
    box_upper: wp.vec3,
    # state in
    frame: wp.array[wp.int32],
    pressures: wp.array2d[float],
    points: wp.array2d[wp.vec3],
    sphere_positions: wp.array2d[wp.vec3],
    body_positions: wp.array2d[wp.vec3],
    sums: wp.array3d[BalloonSums],
    first_bad: wp.array[wp.int32],
    no_body: wp.int32,
    box_column: wp.int32,
    burst_column: wp.int32,
    bursts: wp.array2d[wp.vec4],
    # out
    measures: wp.array2d[float],
    healthy: wp.array[wp.int32],
):
    """Write the measures of worlds, a thread each.

    They are volume, area, pressure, height of the center, largest stretch, kinetic energy, heights of the spheres and
    of free bodies; and where their columns are not negative, how many balloons are in a box, and how many have burst.
    A balloon's volume is taken about its own center, the mean of its faces' corners; the world's center is the mean of
    its balloons' by mass, and its pressure that by area, of normal forces 100 k_normal over the area. A world that is
    no longer finite keeps its last good measures. A balloon that burst encloses nothing.
    """
    world = wp.tid()
    volume = float(0.0)
    area = float(0.0)
    pushed = float(0.0)
    height = float(0.0)
    total_mass = float(0.0)
    stretch = float(0.0)
    kinetic_energy = float(0.0)
    inside = float(0.0)
    for balloon in range(sums.shape[1]):
        total = whole_balloon(sums, world, balloon)
        stretch = wp.max(stretch, total.stretch)
        first = face_offsets[balloon_faces[balloon]]
        corner_count = face_offsets[balloon_faces[balloon + 1]] - first
        center = total.corners / float(corner_count)
        balloon_mass = mass[world % mass.shape[0], balloon]
        if burst_column < 0 or bursts[world, balloon][1] >= 0.0:
            volume += total.volume - wp.dot(center, total.area_vector) / 3.0
        area += total.area
        if inflation_kind[balloon] == NORMAL_FORCE:
            time = float(frame[0]) * frame_seconds
            pushed += normal_push(keyframed_value(keyframe_times, keyframe_values, world, balloon, time))
        else:
            pushed += pressures[world, balloon] * total.area
        kinetic_energy += total.kinetic_energy
        height += balloon_mass * (wp.dot(points[world, face_particles[first]], up) + wp.dot(center, up))
        inside += in_box(points[world, face_particles[first]] + center, box_lower, box_upper)
        total_mass += balloon_mass
    height /= total_mass
    pressure = pushed / wp.max(area, 1.0e-20)
    finite = are_finite(sphere_positions[world]) and are_finite(body_positions[world])
    finite = finite and wp.isfinite(volume) and wp.isfinite(area) and wp.isfinite(height)
    finite = finite and wp.isfinite(pressure) and wp.isfinite(stretch) and wp.isfinite(kinetic_energy)
    if first_bad[world] != no_body or not finite:
        healthy[world] = 0
    if healthy[world] == 1:
        measures[world, 0] = volume
        measures[world, 1] = area
        measures[world, 2] = pressure
        measures[world, 3] = height
        measures[world, 4] = stretch
        measures[world, 5] = kinetic_energy
        note_further(measures, world, sphere_positions, body_positions, up, box_column, inside, burst_column, bursts)


@wp.kernel(enable_backward=False)
def measure_gas(
    # model
    first_area: float,
    first_column: wp.int32,
    # state in
    gas_amounts: wp.array2d[wp.float64],
    thrusts: wp.array2d[float],
    healthy: wp.array[wp.int32],
    # in and out
    measures: wp.array2d[float],
):
    """Measure moles of gas, mean stretch and thrust of a measured world; a thread a world.

    The mean stretch is weighted by the area at the start.
    """
    world = wp.tid()
    if healthy[world] == 1:
        moles = float(0.0)
        pushed = float(0.0)
        for balloon in range(gas_amounts.shape[1]):
            moles += float(gas_amounts[world, balloon])
            pushed += thrusts[world, balloon]
        measures[world, first_column] = moles
        measures[world, first_column + 1] = wp.sqrt(measures[world, 1] / wp.max(first_area, 1.0e-20))
        measures[world, first_column + 2] = pushed


ROUNDED = wp.constant(1.0001)
"""Factor on I1 above which a state counts as beyond the limit"""


@wp.kernel(enable_backward=False)
def note_overstretched(
    # model
    triangles: wp.array[wp.int32],
    triangle_faces: wp.array[wp.int32],
    membrane_corners: wp.array[wp.vec3i],
    membrane_rests: wp.array[wp.vec4],
    particle_balloon: wp.array[wp.int32],
    gent_limit: wp.array2d[float],
    most_stretch: wp.array2d[float],
    wrinkling: wp.array2d[float],
    # state in
    frame: wp.array[wp.int32],
    points: wp.array2d[wp.vec3],
    torn: wp.array2d[float],
    # state out
    overstretched: wp.array[wp.int32],
):
    """Record the first frame of overstretch; a thread a (world, triangle of such rubber)."""
    world, number = wp.tid()
    triangle = triangles[number]
    if overstretched[world] > 0 or is_torn_triangle(torn, triangle_faces, world, triangle):
        return
    p = membrane_corners[triangle]
    balloon = particle_balloon[p[0]]
    d1 = points[world, p[1]] - points[world, p[0]]
    d2 = points[world, p[2]] - points[world, p[0]]
    metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
    trace, det, spread = invariants_of(mixed_stretch(metric, membrane_rests[triangle]))
    major = wp.max(0.5 * (trace + spread), 1.0)
    first = trace + 1.0 / wp.max(det, LEAST_DET)
    if not is_taut(det, wp.sqrt(major), wrinkling[row_of_world(world, wrinkling.shape[0]), balloon]):
        first = major + 2.0 / wp.sqrt(major)
    limit = gent_limit[row_of_world(world, gent_limit.shape[0]), balloon]
    most = most_stretch[row_of_world(world, most_stretch.shape[0]), balloon]
    _, most_first = locking_room(limit, most)
    if first > ROUNDED * most_first:
        wp.atomic_max(overstretched, world, frame[0])


@wp.kernel(enable_backward=False)
def note_pressed(
    # model
    bounds: wp.array[float],
    step_seconds: float,
    mass: wp.array2d[float],
    # state in
    frame: wp.array[wp.int32],
    pressures: wp.array2d[float],
    # state out
    pressed: wp.array2d[wp.int32],
):
    """Record the first frame at whose end a gas pushes no harder for that; a thread a (world, balloon)."""
    world, balloon = wp.tid()
    most = max_pressure(bounds[balloon], mass[row_of_world(world, mass.shape[0]), balloon], step_seconds)
    if pressed[world, balloon] == 0 and pressures[world, balloon] >= most:
        pressed[world, balloon] = frame[0]


@wp.kernel(enable_backward=False)
def pick_healthy_worlds(
    every: wp.array2d[wp.uint32], healthy: wp.array[wp.int32], chosen: wp.array[wp.int32], picked: wp.array2d[wp.uint32]
):
    """Copy a word of a chosen world, or keep the last good copy if it is not healthy; a thread a (world, word).

    Words of any array, and no generic kernel: Warp replays all forms of one in a graph of a CPU as the last that it
    recorded.
    """
    place, word = wp.tid()
    world = chosen[place]
    if healthy[world] == 1:
        picked[place, word] = every[world, word]


@wp.kernel(enable_backward=False)
def pick_torn_faces(
    torn: wp.array2d[float], healthy: wp.array[wp.int32], chosen: wp.array[wp.int32], picked: wp.array2d[wp.int8]
):
    """Copy 1 where a face of a chosen world is torn, as `pick_healthy_worlds` does; a thread a (world, face)."""
    place, face = wp.tid()
    world = chosen[place]
    if healthy[world] == 1:
        picked[place, face] = wp.where(torn[world, face] >= 0.0, wp.int8(1), wp.int8(0))


@wp.struct
class SolidSums:
    """Integrals over a balloon's inside, or a thread's part of it. Places are from one of the balloon's own points."""

    volume: wp.float64
    """Integral of 1 [m^3]"""
    first: wp.vec3d
    """Integral of x [m^4]"""
    second: wp.mat33d
    """Integral of x x^T [m^5]"""


@wp.func
def add_tetrahedron(sums: SolidSums, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Return the sums with the integrals over the tetrahedron of the origin and three points."""
    corners = a + b + c
    volume = wp.dot(a, wp.cross(b, c)) / wp.float64(6.0)
    products = wp.outer(a, a) + wp.outer(b, b) + wp.outer(c, c) + wp.outer(corners, corners)
    sums.volume += volume
    sums.first += (volume / wp.float64(4.0)) * corners
    sums.second += (volume / wp.float64(20.0)) * products
    return sums


@wp.func
def first_particle(
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    balloon: wp.int32,
):
    """Return the balloon's particle that its sums are taken about."""
    return face_particles[face_offsets[balloon_faces[balloon]]]


@wp.kernel(enable_backward=False)
def sum_solids(
    # model
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    # out
    sums: wp.array3d[SolidSums],
):
    """Sum integrals over every n-th face of a balloon; a thread a (world, balloon, thread)."""
    world, balloon, thread = wp.tid()
    part = SolidSums()
    origin = wp.vec3d(points[world, first_particle(balloon_faces, face_offsets, face_particles, balloon)])
    for face in range(balloon_faces[balloon] + thread, balloon_faces[balloon + 1], sums.shape[2]):
        begin = face_offsets[face]
        end = face_offsets[face + 1]
        center = wp.vec3d()
        for corner in range(begin, end):
            center += wp.vec3d(points[world, face_particles[corner]]) - origin
        center /= wp.float64(end - begin)
        before = wp.vec3d(points[world, face_particles[end - 1]]) - origin
        for corner in range(begin, end):
            here = wp.vec3d(points[world, face_particles[corner]]) - origin
            part = add_tetrahedron(part, before, here, center)
            before = here
    sums[world, balloon, thread] = part


@wp.kernel(enable_backward=False)
def measure_solids(
    # model
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    sums: wp.array3d[SolidSums],
    # out
    volumes: wp.array2d[wp.float64],
    centers: wp.array2d[wp.vec3d],
    inertias: wp.array2d[wp.mat33d],
):
    """Compute volume, center of mass, and inertia tensor about it at a density of 1; a thread a (world, balloon).

    A balloon without volume has its center at its first point, and no inertia.
    """
    world, balloon = wp.tid()
    total = SolidSums()
    for thread in range(sums.shape[2]):
        part = sums[world, balloon, thread]
        total.volume += part.volume
        total.first += part.first
        total.second += part.second
    center = wp.vec3d()
    inertia = wp.mat33d()
    if total.volume != wp.float64(0.0):
        center = total.first / total.volume
        spread = total.second - total.volume * wp.outer(center, center)
        inertia = wp.trace(spread) * wp.identity(n=3, dtype=wp.float64) - spread
    origin = points[world, first_particle(balloon_faces, face_offsets, face_particles, balloon)]
    volumes[world, balloon] = total.volume
    centers[world, balloon] = wp.vec3d(origin) + center
    inertias[world, balloon] = inertia
