"""Kernels around the substeps of a frame: ramps, rounds, the air, spheres that start late.

They share one module without adjoints: every module and every adjoint adds to the time that a user waits for a first
frame.

The air at balloons, and its added mass, are updated as a frame begins: neither a balloon's height nor its volume
changes much in a frame.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import Clock, function_here, numbers_reader, ramp_at
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import air_of_height
from balloon_warp.kernels.laws.gas import air_along
from balloon_warp.kernels.laws.outer import GAS, NORMAL_FORCE
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.tables import (
    HealthTable,
    ParticleTable,
    Tables,
    WorldState,
    check_particle,
    check_sphere,
    is_chosen,
    row_of_world,
)

wp.set_module_options(OPTIONS)


@wp.func
def keyframed_value(
    times: wp.array2d[float], values: wp.array3d[float], world: wp.int32, balloon: wp.int32, time: float
):
    """Interpolate keyframes linearly, constant before the first and after the last."""
    row = row_of_world(world, values.shape[0])
    value = values[row, balloon, 0]
    for key in range(times.shape[1] - 1):
        begin = times[balloon, key]
        end = times[balloon, key + 1]
        if time > begin and end > begin:
            blend = wp.min((time - begin) / (end - begin), 1.0)
            value = wp.lerp(values[row, balloon, key], values[row, balloon, key + 1], blend)
    return value


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
    """Compute keyframed values, such as k_normal, at the start of the frame, and their slope over the frame [1/s].

    A thread a (world, balloon).
    """
    world, balloon = wp.tid()
    begin = float(frame[row_of_world(world, frame.shape[0])]) * frame_seconds
    first = keyframed_value(keyframe_times, keyframe_values, world, balloon, begin)
    last = keyframed_value(keyframe_times, keyframe_values, world, balloon, begin + frame_seconds)
    inflation_ramp[world, balloon] = wp.vec2(first, (last - first) / frame_seconds)


@wp.kernel
def place_fixtures(
    # model
    motion: wp.array2d[wp.transform],
    # state in
    frame: wp.array[wp.int32],
    # out
    placed: wp.array2d[wp.transform],
):
    """Place obstacles as the frame begins, and then as it ends, when the last of their motion is one of rest.

    A thread a (row of worlds, obstacle).
    """
    row, fixture = wp.tid()
    begin = wp.clamp(frame[row_of_world(row, frame.shape[0])], 0, motion.shape[0] - 2)
    placed[2 * row, fixture] = motion[begin, fixture]
    placed[2 * row + 1, fixture] = motion[begin + 1, fixture]


@wp.kernel
def move_anchors(
    # model
    motion: wp.array2d[wp.transform],
    carriers: wp.array[wp.vec2i],
    centers: wp.array[wp.vec3],
    anchors: wp.array2d[wp.vec3],
    positions: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    steered: wp.int32,
    frame_seconds: float,
    # state in
    frame: wp.array[wp.int32],
    own_frame: wp.array[wp.int32],
    body_positions: wp.array2d[wp.vec3],
    body_turns: wp.array2d[wp.quat],
    # out
    placed: wp.array2d[wp.vec3],
):
    """Place anchors of strings as the frame begins, and find how fast they move until it ends.

    Those on bodies are placed again in each substep, see `phases.motion`. A thread a (world, string).
    """
    world, string = wp.tid()
    begin = wp.clamp(own_frame[row_of_world(world, own_frame.shape[0])], 0, motion.shape[0] - 2)
    anchor = anchors[row_of_world(world, anchors.shape[0]), string] - centers[string]
    first = wp.transform_point(motion[begin, string], anchor)
    speed = (wp.transform_point(motion[begin + 1, string], anchor) - first) / frame_seconds
    carrier = carriers[string][0]
    body = carriers[string][1]
    if carrier >= 0:
        first += positions[row_of_world(world, positions.shape[0]), carrier]
        if steered != 0:
            speed += velocities[row_of_world(world, velocities.shape[0]), carrier]
    if body >= 0:
        first = body_positions[world, body] + wp.quat_rotate(body_turns[world, body], anchor)
        speed = wp.vec3()
    placed[3 * world, string] = first
    placed[3 * world + 1, string] = speed
    placed[3 * world + 2, string] = anchor
    if string == 0:
        placed[3 * world, placed.shape[1] - 1] = wp.vec3(float(frame[0]) * frame_seconds, 0.0, 0.0)


@wp.kernel
def note_given_loads(
    # model
    inflation_kind: wp.array[wp.int32],
    time_in_frame: float,
    # state in and out
    state: WorldState,
):
    """Store given pressures of the last substep of a frame; a thread a (world, balloon)."""
    world, balloon = wp.tid()
    if inflation_kind[balloon] != NORMAL_FORCE:
        given = ramp_at(state, world, balloon, time_in_frame)
        state.pressures[world, balloon] = given
        state.inflation_loads[world, balloon] = wp.vec2(given, 0.0)


@wp.kernel
def place_balloons(
    # model
    points: wp.array[wp.vec3d],
    particle_balloon: wp.array[wp.int32],
    particle_mass_share: wp.array[float],
    origins: wp.array[wp.vec3d],
    turns: wp.array2d[wp.mat33d],
    shifts: wp.array2d[wp.vec3d],
    centers: wp.array2d[wp.vec3d],
    starts: wp.array2d[wp.vec3],
    spins: wp.array2d[wp.vec3],
    mask: wp.array[wp.int32],
    threads: wp.int32,
    # out
    every: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
):
    """Place particles: rotate each balloon about the mesh's origin, shift it, and set the velocities.

    A thread a (world, thread), which takes every n-th particle. The velocity is the balloon's plus that of its spin
    about its center; zero if the particle is fixed. In double precision, so that the place is what the host would place
    there. Worlds for which a mask is 0 stay as they are; without one all are placed.
    """
    world, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    for particle in range(thread, points.shape[0], threads):
        balloon = particle_balloon[particle]
        arm = points[particle] - origins[balloon]
        place = points[particle] + turns[row_of_world(world, turns.shape[0]), balloon] * arm
        place += shifts[row_of_world(world, shifts.shape[0]), balloon]
        every[world, particle] = wp.vec3(place)
        velocity = wp.vec3()
        if particle_mass_share[particle] > 0.0:
            lever = wp.vec3(place - centers[row_of_world(world, centers.shape[0]), balloon])
            spin = spins[row_of_world(world, spins.shape[0]), balloon]
            velocity = starts[row_of_world(world, starts.shape[0]), balloon] + wp.cross(spin, lever)
        velocities[world, particle] = velocity


@wp.kernel
def end_frame(
    # model
    particles: ParticleTable,
    health: HealthTable,
    threads: wp.int32,
    seen: wp.int32,
    frames: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    sphere_positions: wp.array2d[wp.vec3],
    # state out
    frame: wp.array[wp.int32],
    first_bad: wp.array[wp.int32],
):
    """Check the state that a frame wrote, of the particles that are to be seen, and count the frame.

    A thread a (world, thread), which takes every n-th particle and sphere. A single thread counts the frames that have
    passed.
    """
    world, thread = wp.tid()
    for particle in range(thread, seen, threads):
        balloon = particles.balloon[particle]
        share = particles.mass_share[particle]
        check_particle(health, first_bad, world, particle, particle, balloon, share, points[world])
    for sphere in range(thread, sphere_positions.shape[1], threads):
        check_sphere(health, first_bad, world, points.shape[1], sphere, sphere_positions[world, sphere])
    if world == 0 and thread == 0:
        frame[0] = frame[0] + frames


@wp.kernel
def begin_round(clock: Clock, depth: wp.int32, turns: wp.int32):
    """Set how many turns a round has; one thread."""
    clock.left[depth] = turns


@wp.kernel
def end_turn(clock: Clock, depth: wp.int32, substeps: wp.int32):
    """End a turn of a round: the next is so many substeps later; one thread."""
    clock.left[depth] -= 1
    clock.done[0] += substeps


@wp.kernel(enable_backward=False)
def hold_spheres(
    # model
    first_frames: wp.array[wp.int32],
    initial_positions: wp.array2d[wp.vec3],
    initial_velocities: wp.array2d[wp.vec3],
    initial_spins: wp.array2d[wp.vec3],
    # state in
    frame: wp.array[wp.int32],
    # state out
    positions: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    spins: wp.array2d[wp.vec3],
):
    """Hold spheres at their place until their first frame, at the end of a frame; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    if frame[row_of_world(world, frame.shape[0])] <= first_frames[sphere]:
        positions[world, sphere] = initial_positions[world % initial_positions.shape[0], sphere]
        velocities[world, sphere] = initial_velocities[world % initial_velocities.shape[0], sphere]
        spins[world, sphere] = initial_spins[world % initial_spins.shape[0], sphere]


@cache
def air_kernel(features: Features) -> Any:
    """Return the kernel that updates added mass and air at balloons."""
    read_numbers = numbers_reader(features.columns)
    air_of = function_here(air_along, ["height", "pressure", "free_volume"], features.columns)
    air_at_height = function_here(air_of_height, ["height"], features.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def update_air(
        # model
        t: Tables,
        of_places: wp.array[wp.int32],
        # state in and out
        state: WorldState,
    ):
        """Compute the added mass and the air at each balloon; a thread a (world, balloon).

        Args:
            of_places: numbers of particles in the state, if tables have them in another order; empty otherwise.
        """
        world, balloon = wp.tid()
        if t.inflation_kind[balloon] == GAS:
            free_volume = float(state.free_volumes[world, balloon])
            numbers = read_numbers(t, world, balloon)
            origin = volume_origin(t, balloon)
            if of_places.shape[0] > 0:
                origin = of_places[origin]
            height = wp.dot(state.points[world, origin], t.up)
            if wp.static(features.takes_air_along):
                along = air_of(height, state.pressures[world, balloon], free_volume, numbers)
                state.air_along[world, balloon] = along
            if wp.static(features.gas_meets_air):
                state.airs[world, balloon] = air_at_height(height, numbers)

    return update_air
