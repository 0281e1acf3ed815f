"""Exchange of momentum between spheres and particles, a block a world.

Each piece of a substep is a launch, which loops over the marked particles in the same order every time.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.near import PARTICLES_A_MARK
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.impulse import MOST_ITERATIONS, Press, is_converged, is_met, shift_of_body
from balloon_warp.kernels.loops.fixtures import friction_on, number_of_sphere
from balloon_warp.kernels.loops.net_force import inertia_function
from balloon_warp.kernels.loops.obstacles import around_function, standing_function
from balloon_warp.kernels.loops.spheres import (
    answer_of_ball,
    answer_to_ball,
    ball_function,
    change_of_ball,
    press_on_ball,
    rub_on_ball,
    rubbed_ball,
    rubbed_point,
)
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@cache
def marked_functions(features: Features, at: Any, put: Any) -> tuple[Any, Any, Any]:
    """Return functions for the particles of a mark: their pressing, response and friction, and their support.

    The first returns the sums of their pressing on a sphere, the second applies the response and returns the friction,
    the last puts them on the ground and on obstacles. `at` reads a point or velocity, `put` writes it.
    """
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)
    stand = standing_function(features)
    around_particle = around_function(features)

    @wp.func
    def end_of_mark(mark: wp.int32, count: wp.int32):
        """Return the end of a mark's particles."""
        return wp.min((mark + 1) * PARTICLES_A_MARK, count)

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
    def answer_at_mark(
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
                point, velocity = answer_to_ball(t, ball, last, change, shift, start, speed)
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
    def stand_at_mark(t: Tables, world: wp.int32, time: float, mark: wp.int32, points: Any, velocities: Any):
        for particle in range(mark * PARTICLES_A_MARK, end_of_mark(mark, t.particles.balloon.shape[0])):
            params = read_params(t, world, particle)
            if params.share > 0.0:
                point, velocity = stand(
                    t, around_particle(params, time), at(points, particle), at(velocities, particle)
                )
                put(points, particle, point)
                put(velocities, particle, velocity)

    return press_at_mark, answer_at_mark, stand_at_mark


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
    _, answer_at_mark, stand_at_mark = marked_functions(features, at, put)

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
                            mine += answer_at_mark(
                                t, working, world, mark, sphere, ball, press, last, change, shift, points,
                                velocities,
                            )  # fmt: skip
                    center, motion, force = answer_of_ball(t, ball, change, shift)
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
                        stand_at_mark(t, world, end, mark, points, velocities)
                    working.near[world, mark] = 0
            if thread == 0:
                working.near[world, marks] = 0

    return touch_spheres
