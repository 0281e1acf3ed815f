"""Contact of spheres: momentum exchanged with particles, and small spheres that meet faces.

A block has a world, and each piece of a substep is a launch. Momentum is exchanged by a loop over the particles near a
sphere, which any thread has marked: in the same order every time.

Of small spheres and faces the earliest contact comes first, until none is left. Between faces that are folded around a
sphere this takes long. Then the sphere and the corners of all faces that it meets from there on become a lump, which
moves with its mean velocity: this conserves momentum and takes energy, and where nothing moves relative to the sphere,
nothing passes through (Provot 1997, *Collision and self-collision handling in cloth*).
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import params_functions
from balloon_warp.kernels.contact.boxes import boxes_meet
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import (
    MOST_ITERATIONS,
    NEVER,
    Press,
    is_converged,
    is_met,
    shift_of_body,
    spin_by,
)
from balloon_warp.kernels.laws.touch import Impact, facing_of, impact, part_until_contact
from balloon_warp.kernels.loops.contact import around_function, solid_contact_function
from balloon_warp.kernels.loops.fixtures import friction_on, number_of_sphere
from balloon_warp.kernels.loops.net_force import inertia_function, inverse_mass_function
from balloon_warp.kernels.loops.spheres import (
    ball_function,
    change_of_ball,
    is_near_sphere,
    press_on_ball,
    response_of_ball,
    response_to_ball,
    rub_on_ball,
    rubbed_ball,
    rubbed_point,
)
from balloon_warp.kernels.tables import Tables, sphere_mass, sphere_radius
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

PARTICLES_A_MARK = wp.constant(8)


def mark_count(particle_count: int) -> int:
    """Return the number of marks of a world; the last is that of the world itself."""
    return -(-particle_count // PARTICLES_A_MARK) + 1


@wp.func
def are_noted(working: Working, world: wp.int32):
    """Return whether any particle of a world is."""
    return working.near[world, working.near.shape[1] - 1] > 0


@cache
def noting_function(features: Features, sphere_at: Any) -> Any:
    """Return the function that marks a particle."""
    spheres_there = features.spheres

    @wp.func
    def is_noted(
        t: Tables,
        spheres: Any,
        near: wp.array2d[wp.int32],
        world: wp.int32,
        particle: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """Return whether a particle may touch a sphere, and mark it.

        All threads that write a mark write the same.
        """
        noted = bool(False)
        for sphere in range(spheres_there):
            center, motion, radius = sphere_at(t, spheres, world, sphere)
            noted = noted or is_near_sphere(t, center, motion, radius, point, velocity)
        if noted:
            near[world, particle // PARTICLES_A_MARK] = 1
            near[world, near.shape[1] - 1] = 1
        return noted

    return is_noted


@wp.func
def end_of_mark(mark: wp.int32, count: wp.int32):
    """Return the end of a mark's particles."""
    return wp.min((mark + 1) * PARTICLES_A_MARK, count)


@cache
def marked_functions(features: Features, at: Any, put: Any) -> tuple[Any, Any, Any]:
    """Return functions for the particles of a mark: their pressing, response and friction, and their support.

    The first returns the sums of their pressing on a sphere, the second applies the response and returns the friction,
    the last puts them on the ground and on obstacles. `at` reads a point or velocity, `put` writes it.
    """
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)
    stand = solid_contact_function(features)
    around_particle = around_function(features)

    @wp.func
    def press_at_mark(
        t: Tables,
        working: Working,
        world: wp.int32,
        mark: wp.int32,
        ball: Any,
        change: wp.vec3,
        points: Any,
        velocities: Any,
    ):
        total = Press()
        for particle in range(mark * PARTICLES_A_MARK, end_of_mark(mark, t.particles.balloon.shape[0])):
            params = read_params(t, world, particle)
            if params.share > 0.0:
                mass = inertia(working, params)
                total += press_on_ball(t, ball, change, mass, at(points, particle), at(velocities, particle))
        return total

    @wp.func
    def respond_at_mark(
        t: Tables,
        working: Working,
        world: wp.int32,
        mark: wp.int32,
        sphere: wp.int32,
        ball: Any,
        press: Press,
        last: wp.vec3,
        change: wp.vec3,
        shift: wp.vec3,
        points: Any,
        velocities: Any,
    ):
        total = wp.spatial_vector()
        for particle in range(mark * PARTICLES_A_MARK, end_of_mark(mark, t.particles.balloon.shape[0])):
            if t.particles.mass_share[particle] > 0.0:
                start = at(points, particle)
                speed = at(velocities, particle)
                point, velocity = response_to_ball(t, ball, last, change, shift, start, speed)
                if wp.static(features.spheres_rub):
                    params = read_params(t, world, particle)
                    mass = inertia(working, params)
                    friction = friction_on(t, world, params.balloon, number_of_sphere(t, sphere))
                    rub = rub_on_ball(t, ball, press, last, change, mass, friction, start, speed)
                    total += rub
                    point, velocity = rubbed_point(t, rub, mass, point, velocity)
                put(points, particle, point)
                put(velocities, particle, velocity)
        return total

    @wp.func
    def resolve_solids_at_mark(t: Tables, world: wp.int32, time: float, mark: wp.int32, points: Any, velocities: Any):
        for particle in range(mark * PARTICLES_A_MARK, end_of_mark(mark, t.particles.balloon.shape[0])):
            params = read_params(t, world, particle)
            if params.share > 0.0:
                point, velocity = stand(
                    t, around_particle(params, time), at(points, particle), at(velocities, particle)
                )
                put(points, particle, point)
                put(velocities, particle, velocity)

    return press_at_mark, respond_at_mark, resolve_solids_at_mark


@cache
def settling_function(features: Features, at: Any, put: Any, total_of: Any) -> Any:
    """Return the function that finds the change of a sphere's velocity by particles; `total_of` sums over threads."""
    press_at_mark, _, _ = marked_functions(features, at, put)

    @wp.func
    def press_of_thread(
        t: Tables,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        ball: Any,
        change: wp.vec3,
        points: Any,
        velocities: Any,
    ):
        """Return the pressing of the particles in a thread's marks."""
        part = Press()
        for mark in range(thread, working.near.shape[1] - 1, wp.block_dim()):
            if working.near[world, mark] > 0:
                part += press_at_mark(t, working, world, mark, ball, change, points, velocities)
        return part

    @wp.func
    def settle(t: Tables, working: Working, world: wp.int32, thread: wp.int32, ball: Any, points: Any, velocities: Any):
        """Return the pressing on a sphere, and the change of its velocity before it was settled, and after."""
        last = wp.vec3()
        change = wp.vec3()
        part = press_of_thread(t, working, world, thread, ball, last, points, velocities)
        press = total_of(part)
        if is_met(press):
            change = change_of_ball(t, ball, press, last)
            turn = wp.int32(1)
            while turn < MOST_ITERATIONS and not is_converged(change, last):
                last = change
                part = press_of_thread(t, working, world, thread, ball, last, points, velocities)
                press = total_of(part)
                change = change_of_ball(t, ball, press, last)
                turn += 1
        return press, last, change

    return settle


@cache
def spheres_function(features: Features, at: Any, put: Any, total_of: Any) -> Any:
    """Return the function that exchanges momentum between spheres and particles; `total_of` sums over threads."""
    ball_at, settle = ball_function(features), settling_function(features, at, put, total_of)
    _, respond_at_mark, resolve_solids_at_mark = marked_functions(features, at, put)

    @wp.func
    def touch_spheres(
        t: Tables,
        spheres: Any,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        end: float,
        points: Any,
        velocities: Any,
    ):
        """Exchange momentum with the marked particles of a world, by all threads of a block, and clear marks."""
        marks = working.near.shape[1] - 1
        if working.near[world, marks] > 0:
            for sphere in range(t.spheres.numbers.shape[1]):
                ball = ball_at(t, spheres, world, sphere)
                press, last, change = settle(t, working, world, thread, ball, points, velocities)
                if is_met(press):
                    shift = shift_of_body(press, ball.mass, t.up)
                    mine = wp.spatial_vector()
                    for mark in range(thread, marks, wp.block_dim()):
                        if working.near[world, mark] > 0:
                            mine += respond_at_mark(
                                t, working, world, mark, sphere, ball, press, last, change, shift, points,
                                velocities,
                            )  # fmt: skip
                    center, motion, force = response_of_ball(t, ball, change, shift)
                    if wp.static(features.spheres_rub):
                        rub = total_of(mine)
                        center, motion, spin = rubbed_ball(t, ball, press, change, center, motion, rub)
                        if thread == 0:
                            spheres.sphere_spins[world, sphere] = spin
                    if thread == 0:
                        spheres.sphere_positions[world, sphere] = center
                        spheres.sphere_velocities[world, sphere] = motion
                        spheres.sphere_forces[world, sphere] = spheres.sphere_forces[world, sphere] + force
            for mark in range(thread, marks, wp.block_dim()):
                if working.near[world, mark] > 0:
                    if wp.static(features.stands):
                        resolve_solids_at_mark(t, world, end, mark, points, velocities)
                    working.near[world, mark] = 0
            if thread == 0:
                working.near[world, marks] = 0

    return touch_spheres


MOST_MEETINGS = wp.constant(16)
"""Largest number of a sphere's contacts with faces in a step before they merge; a few usually suffice"""
MOST_LUMPED = wp.constant(48)
"""Largest number of additional contacts of merged bodies, each with another face"""
SHRINKING, LEAST_PART = wp.constant(0.03), wp.constant(0.5)
"""Fraction of its radius by which a sphere may come nearer after each contact, so that contacts end; and its limit"""
MOST_IN_LUMP = wp.constant(128)
"""Largest number of merged particles"""
MOST_SWEEPS = wp.constant(4)
"""Largest number of sweeps over all spheres"""
NONE = wp.constant(2147483647)


@wp.func
def corner_rows(points: wp.array[wp.vec3], corners: wp.vec3i):
    """Return the vectors of three particles, row by row."""
    return wp.matrix_from_rows(points[corners[0]], points[corners[1]], points[corners[2]])


@wp.func
def part_until_face(
    t: Tables,
    triangle: wp.int32,
    start: wp.vec3,
    end: wp.vec3,
    radius: float,
    nearest: float,
    starts: wp.array[wp.vec3],
    points: wp.array[wp.vec3],
):
    """Return the fraction of the step after which a sphere meets a triangle; `NEVER` if it does not.

    Args:
        nearest: part of the radius to which the center may come.
    """
    corners = t.spheres.triangles[triangle]
    before = corner_rows(starts, corners)
    after = corner_rows(points, corners)
    lower = wp.min(wp.min(wp.min(before[0], after[0]), wp.min(before[1], after[1])), wp.min(before[2], after[2]))
    upper = wp.max(wp.max(wp.max(before[0], after[0]), wp.max(before[1], after[1])), wp.max(before[2], after[2]))
    part = float(NEVER)
    if boxes_meet(lower, upper, wp.min(start, end), wp.max(start, end), radius + 0.01 * wp.length(upper - lower)):
        facing = facing_of(start, end, radius, before, after)
        found, _looks = part_until_contact(facing, nearest * facing.radius)
        part = found
    return part


@wp.func
def find_soonest(
    t: Tables,
    spheres: Any,
    working: Working,
    world: wp.int32,
    thread: wp.int32,
    sphere: wp.int32,
    radius: float,
    nearest: float,
    points: wp.array[wp.vec3],
):
    """Find the triangle that a sphere meets first, and the fraction of the step, among those of a thread."""
    start = working.sphere_starts[world, sphere]
    end = spheres.sphere_positions[world, sphere]
    soonest = float(NEVER)
    which = wp.int32(NONE)
    for triangle in range(thread, t.spheres.triangles.shape[0], wp.block_dim()):
        part = part_until_face(t, triangle, start, end, radius, nearest, working.point_starts[world], points)
        if part < soonest:
            soonest = part
            which = triangle
    return soonest, which


@wp.func
def add_to_merged(merged: wp.array[wp.int32], count: wp.int32, corners: wp.vec3i):
    """Add corners to the merged particles, and return their number."""
    for corner in range(3):
        known = bool(False)
        for place in range(count):
            known = known or merged[place] == corners[corner]
        if not known and count < MOST_IN_LUMP:
            merged[count] = corners[corner]
            count += 1
    return count


@cache
def changing_function(features: Features) -> Any:
    """Return the function for the shift and gain of the sphere, or of a corner, by a contact."""

    @wp.func
    def change_of(met: Impact, number: wp.int32):
        """Return the shift [m] and gain [m/s] of the sphere, which is number 0, or of a corner: 1, 2 or 3."""
        gain = met.gains[number] * met.normal
        shift = met.shifts[number] * met.normal
        if wp.static(features.spheres_rub):
            rub = met.pulled[number] * met.rub
            gain += rub
            shift += met.seconds * rub
        return shift, gain

    return change_of


@cache
def meet_face_function(features: Features) -> Any:
    """Return the function by which a sphere and a triangle exchange momentum."""
    inverse_mass_of, change_of = inverse_mass_function(features), changing_function(features)

    @wp.func
    def meet_face(
        t: Tables,
        spheres: Any,
        working: Working,
        world: wp.int32,
        sphere: wp.int32,
        triangle: wp.int32,
        part: float,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Exchange momentum between a sphere and a triangle after a fraction of the step."""
        corners = t.spheres.triangles[triangle]
        radius = sphere_radius(t.spheres, world, sphere)
        end = spheres.sphere_positions[world, sphere]
        velocity = spheres.sphere_velocities[world, sphere]
        facing = facing_of(
            working.sphere_starts[world, sphere], end, radius,
            corner_rows(working.point_starts[world], corners), corner_rows(points, corners),
        )  # fmt: skip
        inverse_masses = wp.vec4(
            1.0 / sphere_mass(t.spheres, world, sphere),
            inverse_mass_of(t, working, world, corners[0]),
            inverse_mass_of(t, working, world, corners[1]),
            inverse_mass_of(t, working, world, corners[2]),
        )
        spin = wp.vec3()
        friction = float(0.0)
        if wp.static(features.spheres_rub):
            spin = spheres.sphere_spins[world, sphere]
            friction = friction_on(t, world, t.particles.balloon[corners[0]], number_of_sphere(t, sphere))
        met = impact(
            facing, part, velocity, corner_rows(velocities, corners), inverse_masses, spin, friction, t.step_seconds
        )
        if wp.static(features.spheres_rub):
            torque = wp.cross(met.arm, met.rub)
            spheres.sphere_spins[world, sphere] = spin + spin_by(1.0 / inverse_masses[0], radius, torque)
        shift, gain = change_of(met, 0)
        spheres.sphere_positions[world, sphere] = end + shift
        spheres.sphere_velocities[world, sphere] = velocity + gain
        for corner in range(3):
            particle = corners[corner]
            way, more = change_of(met, corner + 1)
            points[particle] = points[particle] + way
            velocities[particle] = velocities[particle] + more

    return meet_face


@cache
def move_merged_function(features: Features) -> Any:
    """Motion of a sphere and its merged particles as one."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def move_merged(
        t: Tables,
        spheres: Any,
        working: Working,
        world: wp.int32,
        sphere: wp.int32,
        count: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Move a sphere and its merged particles by their mean displacement and velocity, unless one is fixed."""
        mass = sphere_mass(t.spheres, world, sphere)
        way = mass * (spheres.sphere_positions[world, sphere] - working.sphere_starts[world, sphere])
        momentum = mass * spheres.sphere_velocities[world, sphere]
        held = bool(False)
        for place in range(count):
            particle = working.merged[world, place]
            its_mass = inertia(working, read_params(t, world, particle))
            held = held or its_mass == 0.0
            mass += its_mass
            way += its_mass * (points[particle] - working.point_starts[world, particle])
            momentum += its_mass * velocities[particle]
        inverse_mass = wp.where(held, 0.0, 1.0 / mass)
        for place in range(count):
            particle = working.merged[world, place]
            points[particle] = working.point_starts[world, particle] + inverse_mass * way
            velocities[particle] = inverse_mass * momentum
        spheres.sphere_positions[world, sphere] = working.sphere_starts[world, sphere] + inverse_mass * way
        spheres.sphere_velocities[world, sphere] = inverse_mass * momentum

    return move_merged


@cache
def faces_function(features: Features, note: Any = None) -> Any:
    """Return the function that resolves contacts of small spheres with faces, once all have moved.

    Args:
        note: function that notes a contact before it acts; None to note nothing.
    """
    meet_face, move_merged = meet_face_function(features), move_merged_function(features)

    @wp.func
    def meet_faces(
        t: Tables,
        state: Any,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Resolve contacts of small spheres with faces in a world, by all threads of a block."""
        moved = bool(True)
        sweep = wp.int32(0)
        while moved and sweep < MOST_SWEEPS:
            moved = bool(False)
            sweep += 1
            for sphere in range(state.sphere_positions.shape[1]):
                radius = sphere_radius(t.spheres, world, sphere)
                meetings = wp.int32(0)
                lumped = wp.int32(0)
                while radius > 0.0 and t.spheres.small[sphere] == 1 and meetings < MOST_MEETINGS + MOST_LUMPED:
                    nearest = wp.max(1.0 - SHRINKING * float(meetings), LEAST_PART)
                    soonest, which = find_soonest(t, state, working, world, thread, sphere, radius, nearest, points)
                    first = wp.tile_min(wp.tile(soonest))[0]
                    if soonest > first:
                        which = wp.int32(NONE)
                    chosen = wp.tile_min(wp.tile(which))[0]
                    meetings = wp.where(first <= 1.0, meetings + 1, int(MOST_MEETINGS + MOST_LUMPED))
                    if first <= 1.0:
                        moved = bool(True)
                        if thread == 0:
                            if wp.static(note is not None):
                                so_far = wp.where(meetings <= MOST_MEETINGS, -1, lumped)
                                corners = t.spheres.triangles[chosen]
                                note(state, world, sphere, nearest, so_far, corners, points, velocities)
                            if meetings <= MOST_MEETINGS:
                                meet_face(t, state, working, world, sphere, chosen, first, points, velocities)
                            else:
                                lumped = add_to_merged(working.merged[world], lumped, t.spheres.triangles[chosen])
                                move_merged(t, state, working, world, sphere, lumped, points, velocities)
                        block_barrier()

    return meet_faces
